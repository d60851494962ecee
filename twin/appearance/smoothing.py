"""Local regression along one axis of a Monte Carlo table, with its standard error.

Neighbouring values of sigma_t are simulated with independent random numbers, while the true
intensity is a smooth function of ln sigma_t. A local fit over eleven neighbours (in the manner of
Savitzky and Golay 1964) therefore more than halves the standard error; at the ends the window is
one-sided and the gain fades. Logarithms are averaged: unscattered light falls by orders of
magnitude, and ln f of a noisy f is low by half its relative variance only (0.02 % at 2 %).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from twin.spectra import FloatArray

WINDOW = 11
COARSEST = 0.13  # spacing in ln sigma_t up to which a window of eleven is short against the shape
ROUGH = 0.15  # jitter of ln f beyond which a curve is noise, not shape, and is left alone


def fine_enough(sigma_t: FloatArray) -> bool:
    """Whether an axis of sigma_t, shape (S,), is even in its logarithm and fine enough."""
    steps = np.diff(np.log(sigma_t))
    return bool(len(steps) + 1 >= WINDOW and np.ptp(steps) < 1e-6 and steps[0] <= COARSEST)


@lru_cache(maxsize=8)
def smoothing_matrix(count: int, step: float) -> FloatArray:
    """Weights of the local fit for `count` points a `step` of ln sigma_t apart, (count, count).

    The fit is a parabola in ln sigma_t plus a multiple of sigma_t itself, so that Beer's law
    comes through unchanged at any optical thickness. Fewer than eleven points are left as they
    are (identity).
    """
    if count < WINDOW:
        return np.eye(count)
    weights = np.zeros((count, count))
    for i in range(count):
        first = min(max(0, i - WINDOW // 2), count - WINDOW)
        x = step * (np.arange(first, first + WINDOW) - i)
        basis = np.stack([np.ones_like(x), x, x**2, np.exp(x)], axis=1)
        at_point = np.array([1.0, 0.0, 0.0, 1.0])
        weights[i, first : first + WINDOW] = at_point @ np.linalg.pinv(basis)
    return weights


def smoothed(curves: FloatArray, step: float) -> tuple[FloatArray, np.ndarray]:
    """Smooth positive curves along the second axis; what is not smooth is left alone.

    Args:
        curves: shape (A, S, ...), evenly spaced in ln sigma_t along the second axis.
        step: spacing in ln sigma_t.

    Returns:
        (smoothed curves, where they were smoothed), same shape.
    """
    weights = smoothing_matrix(curves.shape[1], step)
    if curves.shape[1] < WINDOW:
        return curves, np.zeros(curves.shape, dtype=bool)

    def along(values: FloatArray) -> FloatArray:
        return np.moveaxis(np.tensordot(weights, values, axes=(1, 1)), 0, 1)

    positive = curves > 0.0
    log = np.log(np.where(positive, curves, 1.0))
    shape = along(log)
    fine = positive & (np.abs(log - shape) < ROUGH)
    reach = (weights != 0.0).astype(float)
    unfit = np.moveaxis(np.tensordot(reach, (~fine).astype(float), axes=(1, 1)), 0, 1)
    use = unfit < 0.5
    return np.where(use, np.exp(np.where(use, shape, 0.0)), curves), use


def smoothed_error(relative_error: FloatArray, use: np.ndarray, step: float) -> FloatArray:
    """Relative standard error after `smoothed`, for independent points along the second axis.

    Args:
        relative_error: before smoothing, shape (A, S, ...).
        use: where the curve was smoothed, same shape.
        step: spacing in ln sigma_t.
    """
    weights = smoothing_matrix(relative_error.shape[1], step)
    squared = np.moveaxis(np.tensordot(weights**2, relative_error**2, axes=(1, 1)), 0, 1)
    return np.where(use, np.sqrt(squared), relative_error)


def smoothed_ratio(differences: FloatArray, scale: FloatArray, step: float) -> FloatArray:
    """Smooth differences over a known scale along the second axis; linear, so without bias.

    Args:
        differences: noisy, shape (A, S, ...), evenly spaced in ln sigma_t along the second axis.
        scale: what they are a smooth multiple of, same shape, not negative.
        step: spacing in ln sigma_t.
    """
    weights = smoothing_matrix(differences.shape[1], step)
    lit = scale > 1e-9 * scale.max()
    ratio = np.where(lit, differences / np.where(lit, scale, 1.0), 0.0)
    found = np.moveaxis(np.tensordot(weights, ratio, axes=(1, 1)), 0, 1) * scale
    reach = (weights != 0.0).astype(float)
    dark = np.moveaxis(np.tensordot(reach, (~lit).astype(float), axes=(1, 1)), 0, 1)
    return np.where(dark < 0.5, found, differences)


def refined_axis(nodes: FloatArray, parts: int) -> FloatArray:
    """Each step between nodes (N,) divided evenly: shape ((N - 1) parts + 1,)."""
    where = np.linspace(0, len(nodes) - 1, (len(nodes) - 1) * parts + 1)
    return np.interp(where, np.arange(len(nodes)), nodes)


def interpolated(nodes: FloatArray, at: FloatArray, values: FloatArray, axis: int) -> FloatArray:
    """Shape-preserving cubic interpolation along one axis; exact at the nodes.

    Curves that are positive throughout are interpolated as logarithms (Akima 1970, in the
    variant of the makima rule, which does not overshoot at a knee).

    Args:
        nodes: increasing, shape (N,).
        at: where to interpolate, shape (M,).
        values: N entries along `axis`.
        axis: the axis to interpolate along.
    """
    from scipy.interpolate import Akima1DInterpolator

    moved = np.moveaxis(values, axis, 0)
    positive = np.all(moved > 0.0, axis=0)
    curves = np.where(positive, np.log(np.where(moved > 0.0, moved, 1.0)), moved)
    if len(nodes) < 3:
        fine = np.stack([np.interp(at, nodes, c) for c in curves.reshape(len(nodes), -1).T], axis=1)
        fine = fine.reshape(len(at), *moved.shape[1:])
    else:
        fine = Akima1DInterpolator(nodes, curves, axis=0, method="makima")(at)
    return np.moveaxis(np.where(positive, np.exp(np.where(positive, fine, 0.0)), fine), 0, axis)
