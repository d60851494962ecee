"""How uncertain inputs move a least-squares estimate: linearly, and by drawing them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from estimators.budget import INPUTS, InputUncertainty
from estimators.least_squares import LeastSquaresEstimator
from estimators.least_squares_engine import Engine, Row
from estimators.least_squares_fit import Fit, Whitened, fit, refit
from estimators.least_squares_input import Seen, prepare
from estimators.least_squares_verdict import Linearised, identifiable, linearise
from twin.adding_doubling import captures_model
from twin.measurement.model import BoolArray
from twin.measurement.relative import RelativeIntensities
from twin.spectra import FloatArray

STEP = 1e-3
"""Relative step of the finite differences by n, thickness and reflectances."""
SMALLEST_N = 1.0


@dataclass(frozen=True, eq=False)
class Work:
    """An estimate with all that its budget needs (W wavelengths, S samples, M = 3S captures).

    Attributes:
        engine: of the bench.
        seen: what was fitted.
        fit: the estimate.
        line: the same, linearised.
        known: identifiable parameters, (W, 3).
        gain: d(parameters) / d(captures), (W, 3, M).
        thickness: d(captures) / d(thickness of each sample) [1/mm], (W, M); of its own sample.
        n, rho_black: derivatives, (W, M).
        rho_white: derivative by the white standard, data's scale included, (W, M).
        aperture: change of the captures by one standard uncertainty, (W, M).
        stated: standard uncertainties.
    """

    engine: Engine
    seen: Seen
    fit: Fit
    line: Linearised
    known: BoolArray
    gain: FloatArray
    thickness: FloatArray
    n: FloatArray
    rho_black: FloatArray
    rho_white: FloatArray
    aperture: FloatArray
    stated: InputUncertainty


def prepared(
    estimator: LeastSquaresEstimator, intensities: RelativeIntensities, stated: InputUncertainty
) -> Work:
    """Estimate, and differentiate the captures by every input."""
    model, options = estimator.model, estimator.settings
    model.check(intensities)
    engine, grid = estimator.engine()
    seen = prepare(intensities, engine.forward.relative_error, options)
    found = fit(engine, grid, seen.whitened, model.wavelength_nm, options.starts)
    thickness = np.asarray(intensities.thickness_mm, dtype=np.float64)
    line = linearise(found, seen, engine.coordinates, thickness)
    quantile = engine.coordinates.quantiles(found.place, line.centre, line.covariance)
    used = seen.whitened.used
    known = identifiable(quantile, line, engine.coordinates, options)
    known &= (found.settled & (used.sum(axis=1) >= 3))[:, None]
    whitener = seen.whitened.whitener
    gain = line.covariance @ (whitener @ line.slope).transpose(0, 2, 1) @ whitener

    good = np.flatnonzero(np.isfinite(found.place).all(axis=1))
    panels = np.tile([1.0, 1.0, 0.0], len(thickness))
    rho_white = _slope(engine, found, good, "rho_white")
    # the white standard is the reference too: captures read by the panels scale with it
    scale = panels * seen.whitened.data / np.maximum(engine.rows.rho_white, 1e-12)[:, None]
    return Work(
        engine,
        seen,
        found,
        line,
        known,
        gain,
        _slope(engine, found, good, "thickness_mm"),
        _slope(engine, found, good, "n"),
        _slope(engine, found, good, "rho_black"),
        rho_white - scale,
        _aperture(estimator, engine, found, good, stated.acceptance_relative),
        stated,
    )


def _slope(engine: Engine, found: Fit, good: NDArray[np.intp], name: str) -> FloatArray:
    """Central difference of the captures by one input, (W, M).

    A capture depends on its own sample's thickness alone: all are moved at once.
    """
    nominal = getattr(engine.rows, name)
    step = STEP * np.maximum(np.abs(nominal), 1e-3)
    # an index of 1 has nothing below it
    low = np.maximum(nominal - step, SMALLEST_N) if name == "n" else nominal - step
    ends = (low, nominal + step)
    sides = []
    for end in ends:
        moved = engine.with_rows(partial(_with, name, end))
        sides.append(moved.evaluate(found.place[good], good)[0])
    width = (ends[1] - ends[0])[good]
    width = np.repeat(width, 3, axis=1) if width.ndim == 2 else width[:, None]
    slope = np.zeros_like(found.value)
    slope[good] = (sides[1] - sides[0]) / width
    return slope


def _with(name: str, value: FloatArray, rows: Row) -> Row:
    return rows._replace(**{name: value})


def _aperture(
    estimator: LeastSquaresEstimator,
    engine: Engine,
    found: Fit,
    good: NDArray[np.intp],
    relative: float,
) -> FloatArray:
    """Half the difference of two benches with acceptance angles one uncertainty apart, (W, M)."""
    change = np.zeros_like(found.value)
    bench = estimator.model.bench
    if relative == 0.0 or bench is None:
        return change
    natural = np.full_like(found.place, 0.5)
    natural[good] = engine.coordinates.natural(found.place[good])[0]
    sides = []
    for factor in (1.0 - relative, 1.0 + relative):
        detector = bench.detector.model_copy(
            update={"acceptance_deg": bench.detector.acceptance_deg * factor}
        )
        captures = captures_model(
            bench.model_copy(update={"detector": detector}),
            estimator.model.samples,
            estimator.model.wavelength_nm,
        )
        value = captures.forward(captures.parameters(*natural.T))
        sides.append(np.asarray(value).reshape(len(natural), -1))
    change[good] = 0.5 * (sides[1] - sides[0])[good]
    return change


def propagated(work: Work) -> FloatArray:
    """Variance of every parameter by input, (3, W, I); JCGM 100:2008, eq. (10) and (13)."""
    stated, rows, gain = work.stated, work.engine.rows, work.gain
    data = work.seen.whitened.data
    engine = work.engine.forward.relative_error.reshape(-1) * data
    noise = work.seen.covariance.copy()
    index = np.arange(data.shape[1])
    noise[:, index, index] = np.maximum(noise[:, index, index] - engine**2, 0.0)
    samples = data.shape[1] // 3
    by_sample = np.zeros((len(data), samples, 3))
    for s in range(samples):
        part = slice(3 * s, 3 * s + 3)
        by_sample[:, s] = np.einsum("wpm,wm->wp", gain[:, :, part], work.thickness[:, part])

    def moved(change: FloatArray) -> FloatArray:
        return np.asarray(np.einsum("wpm,wm->wp", gain, change) ** 2)

    def scattered(error: FloatArray) -> FloatArray:
        return np.asarray(np.einsum("wpm,wm->wp", gain**2, error**2))

    parts = {
        "counts and references": np.einsum("wpm,wmk,wpk->wp", gain, noise, gain),
        "thickness": stated.thickness_mm**2 * np.sum(by_sample**2, axis=1),
        "refractive index": stated.n**2 * moved(work.n),
        "black reflectance": moved(
            work.rho_black * (stated.rho_black_relative * rows.rho_black)[:, None]
        ),
        "white reflectance": moved(
            work.rho_white * (stated.rho_white_relative * rows.rho_white)[:, None]
        ),
        "aperture": moved(work.aperture),
        "engine": scattered(engine),
        "interpolation": scattered(stated.interpolation_relative * data),
    }
    return np.stack([parts[name] for name in INPUTS], axis=-1).transpose(1, 0, 2).copy()


def drawn(work: Work, draws: int, seed: int) -> FloatArray:
    """Standard deviation of estimates with drawn inputs, (3, W); JCGM 101:2008, 7.

    An input is drawn once for the whole spectrum where its error is common to all wavelengths
    (thickness, index, reflectances, aperture, engine); noise is drawn by wavelength. Draws that
    did not settle do not count.
    """
    stated, rows, seen = work.stated, work.engine.rows, work.seen
    random = np.random.Generator(np.random.Philox(key=[seed, 0x627564]))
    count, captures = seen.whitened.data.shape
    samples = captures // 3
    data = seen.whitened.data
    noise = seen.covariance.copy()
    index = np.arange(captures)
    error = work.engine.forward.relative_error.reshape(-1)
    noise[:, index, index] = np.maximum(noise[:, index, index] - (error * data) ** 2, 0.0)
    scale = np.sqrt(np.maximum(noise[:, index, index], 1e-30))
    scaled = noise / (scale[:, :, None] * scale[:, None, :]) + 1e-9 * np.eye(captures)
    factor = np.linalg.cholesky(scaled) * scale[:, :, None]

    shape = (draws, count, captures)
    normal = random.standard_normal
    noisy = data + np.einsum("wmk,dwk->dwm", factor, normal(shape))
    common = np.hypot(error, stated.interpolation_relative) * normal((draws, captures))
    noisy += common[:, None, :] * data
    noisy += normal(draws)[:, None, None] * work.aperture
    thickness = rows.thickness_mm + stated.thickness_mm * normal((draws, 1, samples))
    n = np.maximum(rows.n + stated.n * normal((draws, 1)), SMALLEST_N)
    black = np.maximum(rows.rho_black * (1 + stated.rho_black_relative * normal((draws, 1))), 0.0)
    white_factor = 1 + stated.rho_white_relative * normal((draws, 1))
    white = rows.rho_white * white_factor
    panels = np.tile([1.0, 1.0, 0.0], samples)
    noisy *= 1 + (white_factor[:, :, None] - 1) * panels

    tiled = np.tile(np.arange(count), draws)

    def change(given: Row) -> Row:
        around = type(given.around)(*(leaf[tiled] for leaf in given.around))
        return Row(
            n.reshape(-1),
            black.reshape(-1),
            white.reshape(-1),
            thickness.reshape(-1, samples),
            around,
        )

    used = seen.whitened.used[tiled]
    many = Whitened(
        np.where(used, noisy.reshape(-1, captures), 0.0),
        seen.whitened.sigma[tiled],
        used,
        seen.whitened.whitener[tiled],
    )
    again = refit(work.engine.with_rows(change), many, work.fit.place[tiled])
    natural, _ = work.engine.coordinates.natural(again.place)
    natural = np.where(again.settled[:, None], natural, np.nan).reshape(draws, count, 3)
    enough = np.isfinite(natural[..., 0]).sum(axis=0) >= max(10, draws // 2)
    spread = np.full((count, 3), np.nan)
    spread[enough] = np.nanstd(natural[:, enough], axis=0, ddof=1)
    return spread.T.copy()
