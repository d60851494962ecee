"""The most probable material of every wavelength, and the curvature there (Laplace)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.posterior_coordinates import Coordinates
from estimators.posterior_engine import Engine
from twin.spectra import FloatArray

ALBEDOS = (0.05, 0.3, 0.6, 0.85, 0.95, 0.99)
SIGMA_FACTORS = (0.7, 1.0, 1.5, 3.0, 10.0)
ANISOTROPIES = (0.0, 0.4, 0.7, 0.9)
STARTS = 2
ITERATIONS = 25


class Mode(NamedTuple):
    """The most probable materials.

    Attributes:
        x: coordinates, shape (W, 3).
        precision: curvature of minus the log posterior, shape (W, 3, 3).
        captures: there, shape (W, M).
        chi_square: of the residuals, shape (W,).
    """

    x: FloatArray
    precision: FloatArray
    captures: FloatArray
    chi_square: FloatArray


def whiteners(covariance: FloatArray, valid: NDArray[np.bool_]) -> FloatArray:
    """Matrices that turn residuals into standard normal ones, shape (W, M, M).

    Rows and columns of captures that are not valid are zero.

    Args:
        covariance: shape (W, M, M).
        valid: shape (W, M).
    """
    found = np.zeros_like(covariance)
    for w, keep in enumerate(valid):
        some = np.flatnonzero(keep)
        if some.size:
            block = covariance[w][np.ix_(some, some)]
            # Captures that share all their noise: a trace of their own lets Cholesky pass.
            block = block + np.diag(np.diagonal(block) * 1e-9)
            found[w][np.ix_(some, some)] = np.linalg.inv(np.linalg.cholesky(block))
    return found


def starts(
    engine: Engine,
    coordinates: Coordinates,
    value: FloatArray,
    white: FloatArray,
    sigma_t: FloatArray,
) -> FloatArray:
    """The best of a coarse grid, shape (STARTS, W, 3) coordinates.

    Args:
        engine: the engine.
        coordinates: priors.
        value: measured captures, (W, M), 0 where not valid.
        white: whitening matrices.
        sigma_t: first guess [1/mm], (W,).
    """
    grid = np.array([(a, s, g) for a in ALBEDOS for s in SIGMA_FACTORS for g in ANISOTROPIES])
    materials = np.repeat(grid[:, None, :], len(value), axis=1)
    materials[..., 1] *= sigma_t
    x = coordinates.of_material(materials)
    score = _objective(coordinates, engine.at(coordinates.material(x)), x, value, white)[0]
    best = np.argsort(score, axis=0, kind="stable")[:STARTS]
    return np.asarray(np.take_along_axis(x, best[..., None], axis=0))


def find_mode(
    engine: Engine,
    coordinates: Coordinates,
    value: FloatArray,
    white: FloatArray,
    first: FloatArray,
) -> Mode:
    """Levenberg-Marquardt from every start, (K, W, 3) coordinates; the best of them.

    Source: Marquardt (1963), J. SIAM 11, 431; the residuals of the prior are its curvature.
    """
    found = [_climb(engine, coordinates, value, white, start) for start in first]
    score = np.stack(
        [0.5 * mode.chi_square - coordinates.log_prior(mode.x) for mode in found], axis=0
    )
    best = score.argmin(axis=0)
    rows = np.arange(len(best))
    return Mode(*(np.stack(part)[best, rows] for part in zip(*found, strict=True)))


def _objective(
    coordinates: Coordinates,
    captures: FloatArray,
    x: FloatArray,
    value: FloatArray,
    white: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Minus log posterior, whitened residuals and chi-square."""
    residual = np.einsum("wij,...wj->...wi", white, captures - value)
    chi_square = np.sum(residual**2, axis=-1)
    return 0.5 * chi_square - coordinates.log_prior(x), residual, chi_square


def _climb(
    engine: Engine,
    coordinates: Coordinates,
    value: FloatArray,
    white: FloatArray,
    start: FloatArray,
) -> Mode:
    x, count = start.copy(), len(start)
    damping = np.full(count, 1e-2)
    moving = np.ones(count, dtype=bool)

    def evaluate(at: FloatArray) -> tuple[FloatArray, ...]:
        captures, slope = engine.with_jacobian(coordinates.material(at))
        score, residual, chi_square = _objective(coordinates, captures, at, value, white)
        jacobian = white @ slope @ coordinates.slopes(at)
        precision = jacobian.transpose(0, 2, 1) @ jacobian + coordinates.prior_precision(at)
        gradient = np.einsum("wip,wi->wp", jacobian, residual) - coordinates.prior_gradient(at)
        return score, precision, gradient, captures, chi_square

    here = evaluate(x)
    for _ in range(ITERATIONS):
        if not moving.any():
            break
        score, precision, gradient = here[:3]
        diagonal = np.diagonal(precision, axis1=1, axis2=2)
        damped = precision + (damping[:, None] * diagonal)[:, :, None] * np.eye(3)
        step = -np.linalg.solve(damped, gradient[..., None])[..., 0]
        step = np.clip(step, -2.0, 2.0)
        there = evaluate(x + step)
        better = moving & (there[0] < score)
        small = np.abs(score - there[0]) < 1e-7 * (1.0 + np.abs(score))
        x = np.where(better[:, None], x + step, x)
        here = tuple(
            np.where(better.reshape(-1, *[1] * (new.ndim - 1)), new, old)
            for new, old in zip(there, here, strict=True)
        )
        damping = np.where(better, damping * 0.2, damping * 8.0)
        moving &= ~(small | (damping > 1e8))
    return Mode(x, here[1], here[3], here[4])
