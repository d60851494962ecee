"""All wavelengths together, under the prior that spectra are smooth.

The prior is that of the cubic smoothing spline: every coordinate x (logit of albedo and g,
ln sigma_t) costs L^3 times the integral of (d^2x / d lambda^2)^2 over wavelength, so that x may
bend by about one unit over the length L; in differences over the measured wavelengths,

    L^3 sum_i d_i^2 / ((h_i-1 + h_i) / 2),   d_i = (x_i+1 - x_i) / h_i - (x_i - x_i-1) / h_i-1

with the steps h [nm], which does not depend on how densely the spectrum is sampled. Straight
lines cost nothing. Sources: Reinsch (1967), Numer. Math. 10, 177; Wahba (1978), J. R. Stat. Soc.
B 40, 364 (the posterior that goes with it).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from estimators.least_squares_coordinates import ROOM
from estimators.least_squares_engine import Engine
from estimators.least_squares_fit import Fit
from estimators.least_squares_input import Seen
from estimators.least_squares_verdict import Linearised, linearise
from twin.spectra import FloatArray

BAND = 6
"""Unknowns are ordered by wavelength, then parameter: the prior reaches two wavelengths away."""
STEPS = 30
SETTLED = 0.03
"""Largest step [posterior standard deviations]."""
RIDGE = 1e-9
COLUMNS = 600


def bending(wavelength_nm: FloatArray, length_nm: float) -> FloatArray:
    """The prior's precision for one coordinate, its diagonals: (3, W) for offsets 0, 1, 2."""
    count = len(wavelength_nm)
    diagonals = np.zeros((3, count))
    if count < 3:
        return diagonals
    step = np.diff(wavelength_nm)
    before, after = 1.0 / step[:-1], 1.0 / step[1:]
    weight = length_nm**3 / (0.5 * (step[:-1] + step[1:]))
    stencil = np.stack([before, -(before + after), after])
    for row in range(3):
        for column in range(row, 3):
            first = diagonals[column - row, row : row + count - 2]
            first += weight * stencil[row] * stencil[column]
    return diagonals


def fit_jointly(
    engine: Engine,
    alone: Fit,
    seen: Seen,
    wavelength_nm: FloatArray,
    length_nm: float,
    thickness_mm: FloatArray,
) -> tuple[Fit, Linearised]:
    """Maximum of the posterior and its covariance at every wavelength.

    Gauss-Newton steps on a banded matrix, damped by Levenberg and Marquardt's rule, from the
    fits of single wavelengths. The engine's error is common to all wavelengths: smoothing does
    not average it away, so its whole effect on the estimate is added to the covariance.

    Args:
        engine: of the bench.
        alone: every wavelength fitted by itself.
        seen: what was measured.
        wavelength_nm: [nm], (W,).
        length_nm: L of the prior [nm].
        thickness_mm: of the samples, (S,).
    """
    from scipy.linalg import cho_solve_banded, cholesky_banded

    index = np.flatnonzero(np.isfinite(alone.place).all(axis=1))
    single = linearise(alone, seen, engine.coordinates, thickness_mm)
    if index.size < 3:
        return alone, single
    white = seen.whitened.whitener[index]
    data = seen.whitened.data[index]
    prior = bending(wavelength_nm[index], length_nm)
    place = np.clip(alone.place[index], -12.0, 12.0)
    size = 3 * index.size

    def state(at: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, float]:
        value, slope = engine.evaluate(at, index)
        rest = np.einsum("wij,wj->wi", white, value - data)
        cost = float(np.sum(rest**2) + np.sum(at * _bend(prior, at)))
        return value, slope, rest, cost if np.isfinite(cost) else np.inf

    value, slope, rest, cost = state(place)
    damping, settled = 1e-6, False
    steps = alone.steps.copy()
    for _ in range(STEPS):
        lean = white @ slope
        normal = lean.transpose(0, 2, 1) @ lean
        force = np.einsum("wmp,wm->wp", lean, rest) + _bend(prior, place)
        band = _band(normal, prior)
        damped = band.copy()
        damped[0] += damping * (1.0 + band[0])
        factor = cholesky_banded(damped, lower=True)
        step = -cho_solve_banded((factor, True), force.ravel()).reshape(-1, 3)
        sizes = np.sqrt(np.einsum("wi,wij,wj->w", step, normal, step))
        step *= np.minimum(1.0, 2.0 / max(float(np.abs(step).max()), 1e-9))
        trial = state(place + step)
        steps[index] += 1
        if trial[3] <= cost * (1.0 + 1e-12):
            place = place + step
            value, slope, rest, cost = trial
            damping = max(damping * 0.1, 1e-9)
            if sizes.max() < SETTLED:
                settled = True
                break
        else:
            damping = max(damping, 1e-6) * 10.0
    lean = white @ slope
    band = _band(lean.transpose(0, 2, 1) @ lean, prior)
    band[0] += RIDGE * (1.0 + band[0])
    factor = (cholesky_banded(band, lower=True), True)
    blocks = _inverse_blocks(factor, size)
    blocks += _common_engine_error(factor, lean, white, data, engine.forward.relative_error)

    found = replace(
        alone,
        place=alone.place.copy(),
        value=alone.value.copy(),
        slope=alone.slope.copy(),
        chi_square=alone.chi_square.copy(),
        steps=steps,
        settled=alone.settled.copy(),
    )
    found.place[index], found.value[index], found.slope[index] = place, value, slope
    found.chi_square[index] = np.sum(rest**2, axis=1)
    found.settled[index] = settled
    line = linearise(found, seen, engine.coordinates, thickness_mm)
    natural, stretch = engine.coordinates.natural(place)
    inside = stretch[:, :, None] * blocks * stretch[:, None, :]
    spread = np.sqrt(np.diagonal(line.covariance[index], axis1=1, axis2=2))
    low, high = engine.coordinates.low, engine.coordinates.high
    # At a bound the coordinates stretch without end, and their Gaussian is none.
    free = ((natural - low > ROOM * spread) & (high - natural > ROOM * spread)).all(axis=1)
    covariance, centre = line.covariance.copy(), line.centre.copy()
    covariance[index[free]] = inside[free]
    centre[index[free]] = natural[free]
    return found, replace(line, covariance=covariance, centre=centre)


def _bend(prior: FloatArray, place: FloatArray) -> FloatArray:
    """The prior's precision times coordinates, (W, 3)."""
    result = prior[0][:, None] * place
    for offset in (1, 2):
        part = prior[offset, :-offset, None]
        result[:-offset] += part * place[offset:]
        result[offset:] += part * place[:-offset]
    return np.asarray(result)


def _band(normal: FloatArray, prior: FloatArray) -> FloatArray:
    """Lower band of the whole precision, (BAND + 1, 3W)."""
    count = len(normal)
    band = np.zeros((BAND + 1, count, 3))
    for row in range(3):
        for column in range(row + 1):
            band[row - column, :, column] += normal[:, row, column]
    for offset in range(3):
        band[3 * offset] += prior[offset][:, None]
    return band.reshape(BAND + 1, 3 * count)


def _inverse_blocks(factor: tuple[FloatArray, bool], size: int) -> FloatArray:
    """Diagonal 3 x 3 blocks of the inverse, (W, 3, 3)."""
    from scipy.linalg import cho_solve_banded

    blocks = np.empty((size // 3, 3, 3))
    for first in range(0, size, COLUMNS):
        width = min(COLUMNS, size - first)
        unit = np.zeros((size, width))
        unit[first + np.arange(width), np.arange(width)] = 1.0
        inverse = cho_solve_banded(factor, unit)[first : first + width]
        for w in range(width // 3):
            blocks[first // 3 + w] = inverse[3 * w : 3 * w + 3, 3 * w : 3 * w + 3]
    return blocks


def _common_engine_error(
    factor: tuple[FloatArray, bool],
    lean: FloatArray,
    white: FloatArray,
    data: FloatArray,
    relative_error: FloatArray,
) -> FloatArray:
    """Covariance from an engine error shared by all wavelengths, (W, 3, 3)."""
    from scipy.linalg import cho_solve_banded

    error = relative_error.reshape(-1) * data
    force = np.einsum("wmp,wmc,wc->wpc", lean, white, error)
    moved = cho_solve_banded(factor, force.reshape(-1, error.shape[1]))
    moved = moved.reshape(len(data), 3, -1)
    return np.asarray(np.einsum("wpc,wqc->wpq", moved, moved))
