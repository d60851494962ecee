"""All wavelengths together, under the prior that spectra are smooth.

Scattering and absorption have causes of their own (particles and dyes): what is smooth are their
coefficients. The prior is that of the cubic smoothing spline: every coordinate x (ln sigma_s,
ln sigma_a, logit of g) costs L^3 times the integral of (d^2x / d lambda^2)^2 over wavelength, so
that x may bend by about one unit over the length L; in differences over the measured wavelengths,

    L^3 sum_i d_i^2 / ((h_i-1 + h_i) / 2),   d_i = (x_i+1 - x_i) / h_i - (x_i - x_i-1) / h_i-1

with the steps h [nm], which does not depend on how densely the spectrum is sampled. Straight
lines cost nothing. Sources: Reinsch (1967), Numer. Math. 10, 177; Wahba (1978), J. R. Stat. Soc.
B 40, 364 (the posterior that goes with it).

Errors that all wavelengths share (the lamps' drift, the engine's own error) do not average out.
Each is an unknown of its own with a unit normal prior, which moves all captures together.

Where no length is given, each coordinate gets the one that makes the captures most probable
(`estimators.least_squares_smoothness`), and the covariance grows by what the lengths leave open.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from estimators.least_squares_banded import Normal, bend, bending
from estimators.least_squares_coordinates import ROOM
from estimators.least_squares_engine import Engine
from estimators.least_squares_fit import Fit
from estimators.least_squares_input import Seen, apart
from estimators.least_squares_smoothness import best_lengths, spread_of_lengths
from estimators.least_squares_verdict import Linearised, linearise
from twin.spectra import FloatArray

SMOOTH = ("scattering", "absorption", "g")
"""Coordinates of the joint mode: ln sigma_s, ln sigma_a, logit of g."""
STEPS = 30
SETTLED = 0.03
"""Largest step [standard deviations of the captures at one wavelength]."""
SEARCHES = 3
"""Times that lengths are looked for, each time around a better fit."""


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint fit.

    Attributes:
        fit: of W wavelengths; its chi-square is that of each wavelength for itself.
        line: covariances and centres.
        spent: parameters that each wavelength pays for, 0 to 3, (W,).
        length_nm: of the prior of each of `SMOOTH` [nm], (3,); NaN where nothing was smoothed.
    """

    fit: Fit
    line: Linearised
    spent: FloatArray
    length_nm: FloatArray


def fit_jointly(
    engine: Engine,
    alone: Fit,
    seen: Seen,
    wavelength_nm: FloatArray,
    length_nm: float,
    thickness_mm: FloatArray,
) -> Joint:
    """Maximum of the posterior and its covariance at every wavelength.

    Gauss-Newton steps on a banded matrix, damped by Levenberg and Marquardt's rule, from the
    fits of single wavelengths.

    Args:
        engine: of the bench.
        alone: every wavelength fitted by itself.
        seen: what was measured.
        wavelength_nm: [nm], (W,).
        length_nm: L of the prior [nm]; 0: one for each coordinate, from the captures.
        thickness_mm: of the samples, (S,).

    Raises:
        InputError: errors common to all wavelengths that exceed the whole covariance.
    """
    index = np.flatnonzero(np.isfinite(alone.place).all(axis=1))
    single = linearise(alone, seen, engine.coordinates, thickness_mm)
    if index.size < 3:
        spent = np.full(len(alone.place), 3.0)
        return Joint(alone, single, spent, np.full(3, np.nan))
    white, modes = apart(seen, index, engine.forward.relative_error)
    world = _World(engine, index, seen.whitened.data[index], white, modes)
    shape = bending(wavelength_nm[index], 1.0)
    lengths = np.full(3, length_nm)
    start = from_material(np.clip(alone.place[index], -12.0, 12.0))
    state = world.at(start, np.zeros(len(modes)))
    steps = 0
    for _ in range(SEARCHES if length_nm == 0.0 else 1):
        if length_nm == 0.0:
            best = best_lengths(state.normal, shape, wavelength_nm[index], lengths)
            done = bool(np.all(np.abs(np.log(best / np.where(lengths > 0, lengths, 1e-9))) < 0.1))
            lengths = best
            if done:
                break
        state, taken, settled = _climb(world, state, shape[..., None] * lengths**3)
        steps += taken
    prior = shape[..., None] * lengths**3
    blocks = state.normal.solved(prior).blocks
    if length_nm == 0.0:
        blocks = blocks + spread_of_lengths(state.normal, shape, lengths)

    found = replace(
        alone,
        place=alone.place.copy(),
        value=alone.value.copy(),
        slope=alone.slope.copy(),
        chi_square=alone.chi_square.copy(),
        steps=alone.steps.copy(),
        settled=alone.settled.copy(),
    )
    place, turn = to_material(state.place)
    blocks = turn @ blocks @ turn.transpose(0, 2, 1)
    found.place[index], found.value[index], found.slope[index] = place, state.value, state.slope
    whole = seen.whitened.whitener[index]
    rest = np.einsum("wij,wj->wi", whole, state.value - world.data)
    found.chi_square[index] = np.sum(rest**2, axis=1)
    found.steps[index] += steps
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
    lean = whole @ state.slope
    spent = np.full(len(alone.place), 3.0)
    spent[index] = np.clip(np.einsum("wmp,wpq,wmq->w", lean, blocks, lean), 0.0, 3.0)
    return Joint(found, replace(line, covariance=covariance, centre=centre), spent, lengths)


@dataclass(frozen=True, eq=False)
class _State:
    """Where the climb is.

    Attributes:
        place: coordinates of `SMOOTH`, (W, 3).
        size: of the common errors, (K,).
        value: captures without common errors, (W, M).
        slope: by the engine's own coordinates, (W, M, 3).
        normal: normal equations there.
    """

    place: FloatArray
    size: FloatArray
    value: FloatArray
    slope: FloatArray
    normal: Normal

    def cost(self, prior: FloatArray) -> float:
        """Minus twice the log posterior."""
        cost = self.normal.square + float(np.sum(self.place * bend(prior, self.place)))
        cost += float(self.size @ self.size)
        return cost if np.isfinite(cost) else np.inf


@dataclass(frozen=True, eq=False)
class _World:
    """What does not change over a fit: W wavelengths, M captures, K common errors."""

    engine: Engine
    index: np.ndarray
    data: FloatArray
    white: FloatArray
    modes: FloatArray

    def at(self, place: FloatArray, size: FloatArray) -> _State:
        """Evaluate the engine at coordinates (W, 3), with common errors (K,)."""
        material, turn = to_material(place)
        value, slope = self.engine.evaluate(material, self.index)
        off = value - self.data + np.einsum("k,kwm->wm", size, self.modes)
        rest = np.einsum("wij,wj->wi", self.white, off)
        lean = self.white @ slope @ turn
        common = np.einsum("wij,kwj->wik", self.white, self.modes)
        normal = Normal.of(lean, common, rest, place, size)
        return _State(place, size, value, slope, normal)


def to_material(place: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Engine's coordinates (logit albedo, ln sigma_t, logit g) of `SMOOTH` ones, (W, 3).

    Returns:
        The coordinates (W, 3), and their derivatives by the given ones (W, 3, 3).
    """
    scattering, absorption, g = place.T
    total = np.logaddexp(scattering, absorption)
    albedo = np.exp(scattering - total)
    turn = np.zeros((len(place), 3, 3))
    turn[:, 0, 0], turn[:, 0, 1] = 1.0, -1.0
    turn[:, 1, 0], turn[:, 1, 1] = albedo, 1.0 - albedo
    turn[:, 2, 2] = 1.0
    return np.stack([scattering - absorption, total, g], axis=-1), turn


def from_material(place: FloatArray) -> FloatArray:
    """Inverse of `to_material`, (W, 3)."""
    odds, total, g = place.T
    return np.stack([total - np.logaddexp(0.0, -odds), total - np.logaddexp(0.0, odds), g], axis=-1)


def _climb(world: _World, state: _State, prior: FloatArray) -> tuple[_State, int, bool]:
    """Levenberg-Marquardt to the maximum of the posterior; evaluations, and whether it is one."""
    damping, taken = 1e-6, 0
    for _ in range(STEPS):
        step, size = state.normal.solved(prior, damping, blocks=False).step
        length = state.normal.sizes(step)
        step = step * np.minimum(1.0, 2.0 / max(float(np.abs(step).max()), 1e-9))
        trial = world.at(state.place + step, state.size + size)
        taken += 1
        if trial.cost(prior) <= state.cost(prior) * (1.0 + 1e-12):
            state = trial
            damping = max(damping * 0.1, 1e-9)
            if length.max() < SETTLED:
                return state, taken, True
        else:
            damping = max(damping, 1e-6) * 10.0
    return state, taken, False
