"""Bounded least squares for all rows of a visit at once: Levenberg and Marquardt."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.spectra import FloatArray

Predict = Callable[[FloatArray, NDArray[np.int_]], tuple[FloatArray, FloatArray]]
"""(parameters (P, 3), rows (P,)) -> readings (P, 3) and slopes (P, 3, 3)."""


class Box(NamedTuple):
    """Bounds of (albedo, sigma_t [1/mm], g), shape (W, 3) each."""

    low: FloatArray
    high: FloatArray


class Solution(NamedTuple):
    """Where the fit ended (W rows).

    Attributes:
        parameters: (albedo, sigma_t, g), (W, 3); readings: (W, 3); slopes: (W, 3, 3).
        chi_square, steps: (W,); converged: (W,); at_bound: (W, 3).
    """

    parameters: FloatArray
    readings: FloatArray
    slopes: FloatArray
    chi_square: FloatArray
    steps: FloatArray
    converged: NDArray[np.bool_]
    at_bound: NDArray[np.bool_]


def to_free(parameters: FloatArray) -> FloatArray:
    """(logit albedo, ln sigma_t, artanh g), shape (W, 3)."""
    albedo, sigma_t, g = np.moveaxis(parameters, -1, 0)
    return np.stack([np.log(albedo) - np.log1p(-albedo), np.log(sigma_t), np.arctanh(g)], axis=-1)


def from_free(free: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Parameters (W, 3) and their slopes by the free ones, (W, 3) since each has its own."""
    albedo = 1.0 / (1.0 + np.exp(-free[..., 0]))
    sigma_t, g = np.exp(free[..., 1]), np.tanh(free[..., 2])
    rest = 1.0 / (1.0 + np.exp(free[..., 0]))
    return np.stack([albedo, sigma_t, g], axis=-1), np.stack(
        [albedo * rest, sigma_t, 1.0 - g**2], axis=-1
    )


def solve(
    predict: Predict,
    value: FloatArray,
    sigma: FloatArray,
    start: FloatArray,
    searched: NDArray[np.bool_],
    box: Box,
    *,
    max_steps: int = 60,
    tolerance: float = 1e-7,
) -> Solution:
    """Fit every row from its start.

    Damped by Marquardt (1963), J. SIAM 11, 431, with the bounds kept by projection: a
    parameter that rests on a bound and is pushed outwards is held for the step.

    Args:
        predict: readings and slopes of materials in rows.
        value: readings, (W, 3); a NaN reading does not count.
        sigma: their standard deviations, (W, 3).
        start: parameters to begin with, (W, 3).
        searched: which parameters are searched, (W, 3).
        box: bounds of the searched ones.
        max_steps: steps after which a row counts as not converged.
        tolerance: a step below it in all free parameters, or a gain in chi-square below its
            share, ends a row.
    """
    count = len(value)
    weight = np.where(np.isfinite(value), 1.0 / sigma, 0.0)
    target = np.where(np.isfinite(value), value, 0.0)
    low, high = to_free(box.low), to_free(box.high)
    free = np.where(searched, np.clip(to_free(start), low, high), to_free(start))
    every = np.arange(count)
    readings, slopes = predict(from_free(free)[0], every)
    chi = _chi(readings, target, weight)
    damping = np.full(count, 1e-3)
    steps = np.zeros(count)
    converged = np.asarray(~searched.any(axis=1))
    active = ~converged
    for _ in range(max_steps):
        rows = np.flatnonzero(active)
        if rows.size == 0:
            break
        _, scale = from_free(free[rows])
        jacobian = slopes[rows] * scale[:, None, :] * weight[rows, :, None]
        residual = (readings[rows] - target[rows]) * weight[rows]
        gradient = np.einsum("wik,wi->wk", jacobian, residual)
        held = ~searched[rows]
        held |= (free[rows] <= low[rows] + 1e-12) & (gradient > 0.0)
        held |= (free[rows] >= high[rows] - 1e-12) & (gradient < 0.0)
        normal = np.einsum("wik,wil->wkl", jacobian, jacobian)
        step = _damped(normal, gradient, damping[rows], held)
        # a step of more than 3 in a logarithm is a guess, not a slope
        step *= np.minimum(1.0, 3.0 / np.maximum(np.abs(step).max(axis=1), 1e-300))[:, None]
        trial = np.clip(free[rows] + step, low[rows], high[rows])
        trial = np.where(searched[rows], trial, free[rows])
        moved = np.abs(trial - free[rows]).max(axis=1)
        found, found_slopes = predict(from_free(trial)[0], rows)
        found_chi = _chi(found, target[rows], weight[rows])
        better = found_chi <= chi[rows]
        small = (moved < tolerance) | (
            better & (chi[rows] - found_chi <= tolerance * chi[rows]) & (damping[rows] <= 1.0)
        )
        took = rows[better]
        free[took], readings[took], slopes[took] = (
            trial[better],
            found[better],
            found_slopes[better],
        )
        chi[took] = found_chi[better]
        damping[rows] = np.where(better, damping[rows] / 5.0, damping[rows] * 8.0)
        damping = np.clip(damping, 1e-12, 1e12)
        steps[rows] += 1
        converged[rows] = small | (damping[rows] >= 1e11)
        active = ~converged
    at_bound = searched & ((free <= low + 1e-9) | (free >= high - 1e-9))
    return Solution(from_free(free)[0], readings, slopes, chi, steps, converged, at_bound)


def _chi(readings: FloatArray, target: FloatArray, weight: FloatArray) -> FloatArray:
    with np.errstate(invalid="ignore"):
        chi = np.sum(((readings - target) * weight) ** 2, axis=1)
    return np.where(np.isfinite(chi), chi, np.inf)


def _damped(
    normal: FloatArray, gradient: FloatArray, damping: FloatArray, held: NDArray[np.bool_]
) -> FloatArray:
    """Solve (N + damping diag N) step = -gradient with some parameters held, (W, 3)."""
    size = np.arange(3)
    diagonal = normal[:, size, size]
    floor = 1e-12 * np.maximum(diagonal.max(axis=1, keepdims=True), 1e-300)
    matrix = normal.copy()
    matrix[:, size, size] += damping[:, None] * np.maximum(diagonal, floor) + floor
    matrix = np.where(held[:, :, None] | held[:, None, :], 0.0, matrix)
    matrix[:, size, size] = np.where(held, 1.0, matrix[:, size, size])
    right = np.where(held, 0.0, -gradient)
    return np.asarray(np.linalg.solve(matrix, right[..., None])[..., 0])


def better(one: Solution, other: Solution) -> Solution:
    """Row by row the fit with the smaller chi-square, a settled one first."""
    take = (other.converged & ~one.converged) | (
        (other.converged == one.converged) & (other.chi_square < one.chi_square)
    )
    fields = []
    for a, b in zip(one, other, strict=True):
        fields.append(np.where(take.reshape(-1, *([1] * (a.ndim - 1))), b, a))
    return Solution(*fields)


def covariance_of(
    solution: Solution, value: FloatArray, sigma: FloatArray, searched: NDArray[np.bool_]
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Covariance from the Fisher information, (W, 3, 3), and which parameters it pins down."""
    weight = np.where(np.isfinite(value), 1.0 / sigma, 0.0)
    # in units that make the three comparable: albedo, ln sigma_t, g
    scale = np.stack([np.ones(len(value)), solution.parameters[:, 1], np.ones(len(value))], axis=1)
    jacobian = solution.slopes * weight[:, :, None] * scale[:, None, :] * searched[:, None, :]
    with np.errstate(invalid="ignore"):
        information = np.einsum("wik,wil->wkl", jacobian, jacobian)
    information = np.where(np.isfinite(information), information, 0.0)
    size = np.arange(3)
    # an open parameter gets a standard error of 1e4: a wide interval, never a division by zero
    information[:, size, size] += np.where(searched, 1e-8, 1.0)
    covariance = np.linalg.inv(information)
    error = np.sqrt(np.maximum(covariance[:, size, size], 0.0))
    identifiable = searched & (error < np.array([0.2, 0.5, 0.3]))
    # without scattering there is no direction of scattering
    identifiable[:, 2] &= solution.parameters[:, 0] > 0.02
    covariance *= np.where(searched[:, :, None] & searched[:, None, :], 1.0, 0.0)
    return covariance * scale[:, :, None] * scale[:, None, :], identifiable
