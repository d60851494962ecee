"""The fit of every wavelength: few streams first, the exact engine last.

1. Levenberg-Marquardt (optimistix) with the quick engine from the nearest valleys of a coarse
   grid. In a long spectrum only every eighth wavelength starts there; those between start from
   their neighbours' solutions when their captures lie between the neighbours' captures.
2. One evaluation of the exact engine with its derivatives, a Gauss-Newton step, and a second
   step whose residual is moved along by the quick engine (a defect correction: the difference
   of both engines hardly changes over a step). A wavelength is settled when the second step is
   below a tenth of a standard deviation and the derivatives were good for the first.
3. What is not settled after a few rounds, or fits badly, goes to Levenberg-Marquardt with the
   exact engine, from every start.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.least_squares_engine import Engine
from estimators.least_squares_starts import StartGrid
from twin.measurement.model import BoolArray
from twin.spectra import FloatArray

WEAK = np.full(3, 0.01)
"""Damping where the captures say nothing: the precision of ten units of a coordinate."""
SETTLED, GOOD_SLOPE, SHORT = 0.1, 0.1, 0.3
"""Second step [standard deviations]; its ratio to the first; a first step short by itself."""
ROUNDS = 3
ANCHOR = 8
LONG = 8 * ANCHOR
ALIKE = 0.05
"""Relative difference from the neighbours' captures up to which their solution is a start."""
BAD_FIT = 16.3
"""Chi-square beyond the degrees of freedom, (1 in 1000 at 3), from which other starts are tried."""
SAME = 0.05
"""Starts agree when their chi-squares differ by less (and a thousandth)."""


@dataclass(frozen=True, eq=False)
class Whitened:
    """Captures of W wavelengths as the fit sees them, M = 3S.

    Attributes:
        data: relative intensities, (W, M); 0 where masked.
        sigma: standard errors with the engine's, (W, M).
        used: what takes part, (W, M).
        whitener: (W, M, M); see `least_squares_solver.Problem`.
    """

    data: FloatArray
    sigma: FloatArray
    used: BoolArray
    whitener: FloatArray


@dataclass(eq=False)
class Fit:
    """Best coordinates of every wavelength with the exact engine's captures around them.

    Attributes:
        place: (W, 3).
        value: captures at `place`, (W, M).
        slope: their derivatives by the coordinates, (W, M, 3).
        chi_square, steps, starts, agreeing: (W,).
        settled: (W,).
    """

    place: FloatArray
    value: FloatArray
    slope: FloatArray
    chi_square: FloatArray
    steps: NDArray[np.int64]
    starts: NDArray[np.int64]
    agreeing: NDArray[np.int64]
    settled: BoolArray

    @classmethod
    def empty(cls, count: int, captures: int) -> Fit:
        """Nothing is known yet."""
        return cls(
            np.full((count, 3), np.nan),
            np.full((count, captures), np.nan),
            np.full((count, captures, 3), np.nan),
            np.full(count, np.inf),
            np.zeros(count, dtype=np.int64),
            np.zeros(count, dtype=np.int64),
            np.zeros(count, dtype=np.int64),
            np.zeros(count, dtype=bool),
        )


def fit(
    engine: Engine, grid: StartGrid, seen: Whitened, wavelength_nm: FloatArray, most_starts: int
) -> Fit:
    """Fit every wavelength that has a capture; see the module.

    Args:
        engine: of the bench.
        grid: of the same bench.
        seen: what was measured.
        wavelength_nm: [nm], (W,).
        most_starts: for one wavelength.
    """
    count, captures = seen.data.shape
    found = Fit.empty(count, captures)
    shape = (count, captures // 3, 3)
    starts = grid.starts(
        np.where(seen.used, seen.data, np.nan).reshape(shape),
        np.where(seen.used, seen.sigma, 0.0).reshape(shape),
        engine.rows.rho_black,
        engine.rows.rho_white,
        most_starts,
    )
    todo = np.flatnonzero(seen.used.any(axis=1))
    anchors = todo[::ANCHOR] if len(todo) >= LONG else todo
    _from_grid(engine, grid, seen, anchors, starts, found)
    between = np.setdiff1d(todo, anchors)
    if between.size:
        good = anchors[found.settled[anchors] & _fits(found, seen)[anchors]]
        near = _between(seen, between, good)
        place = (
            np.stack(
                [
                    np.interp(wavelength_nm[near], wavelength_nm[good], found.place[good, p])
                    for p in range(3)
                ],
                axis=-1,
            )
            if near.size
            else np.empty((0, 3))
        )
        found.starts[near] = found.agreeing[near] = 1
        _polish(engine, seen, near, place, found)
        lone = np.setdiff1d(between, near[found.settled[near] & _fits(found, seen)[near]])
        _from_grid(engine, grid, seen, lone, starts, found)
    again = todo[~(found.settled[todo] & _fits(found, seen)[todo])]
    _exactly(engine, grid, seen, again, starts, found)
    return found


def _fits(found: Fit, seen: Whitened) -> BoolArray:
    """Whether the chi-square is no reason to look elsewhere, (W,)."""
    freedom = np.maximum(seen.used.sum(axis=1) - 3, 0)
    return np.asarray(found.chi_square <= BAD_FIT + 2.0 * freedom)


def _between(seen: Whitened, index: NDArray[np.intp], good: NDArray[np.intp]) -> NDArray[np.intp]:
    """Those wavelengths whose captures lie near the line between their neighbours' captures."""
    if good.size < 2:
        return index[:0]
    right = np.clip(np.searchsorted(good, index), 1, good.size - 1)
    before, after = good[right - 1], good[right]
    share = ((index - before) / (after - before))[:, None]
    inside = (index > before) & (index < after)
    line = seen.data[before] + share * (seen.data[after] - seen.data[before])
    alike = np.abs(line - seen.data[index]) <= ALIKE * np.abs(line) + 3.0 * seen.sigma[index]
    same = (seen.used[before] & seen.used[after])[:, :] | ~seen.used[index]
    return index[inside & ((alike & same) | ~seen.used[index]).all(axis=1)]


def _from_grid(
    engine: Engine,
    grid: StartGrid,
    seen: Whitened,
    index: NDArray[np.intp],
    starts: NDArray[np.intp],
    found: Fit,
) -> None:
    """Quick engine from every start, the best of them polished."""
    if not index.size:
        return
    tries = starts[index] >= 0
    which, number = np.nonzero(tries)
    place = engine.coordinates.place(grid.material[starts[index[which], number]])
    square = np.full(len(which), np.inf)
    left = np.arange(len(which))
    # settled wavelengths leave their blocks
    for _ in range(2):
        solved = engine.solve(place[left], index[which[left]], seen.data, seen.whitener, quick=True)
        place[left], square[left] = solved.place, solved.chi_square
        np.add.at(found.steps, index[which[left]], solved.steps)
        left = left[~solved.settled]
        if not left.size:
            break
    table = np.full(tries.shape, np.inf)
    table[which, number] = np.where(np.isfinite(square), square, np.inf)
    best = table.argmin(axis=1)
    lowest = table.min(axis=1)
    found.starts[index] = tries.sum(axis=1)
    found.agreeing[index] = _agreeing(table, lowest)
    row = np.full(tries.shape, -1)
    row[which, number] = np.arange(len(which))
    _polish(engine, seen, index, place[row[np.arange(len(index)), best]], found)


def _agreeing(square: FloatArray, lowest: FloatArray) -> NDArray[np.int64]:
    return np.asarray((square <= lowest[:, None] * 1.001 + SAME).sum(axis=1))


def _polish(
    engine: Engine, seen: Whitened, index: NDArray[np.intp], start: FloatArray, found: Fit
) -> None:
    """Gauss-Newton steps with the exact engine, in place."""
    left, place = index, start
    for _ in range(ROUNDS):
        if not left.size:
            return
        value, slope = engine.evaluate(place, left)
        whitener = seen.whitener[left]
        rest = _white(whitener, value - seen.data[left])
        lean = whitener @ slope
        normal = lean.transpose(0, 2, 1) @ lean
        damped = np.linalg.inv(normal + np.diag(WEAK))
        here = place
        lengths = []
        rows = engine.quick_rows_at(left)
        quick = engine.quick_values(engine.coordinates.natural(here)[0], rows)
        for last in (False, True):
            force = np.einsum("wmp,wm->wp", lean, rest)
            step = -np.einsum("wij,wj->wi", damped, force)
            step *= np.minimum(1.0, 2.0 / np.maximum(np.abs(step).max(axis=1), 1e-9))[:, None]
            lengths.append(np.sqrt(np.einsum("wi,wij,wj->w", step, normal, step)))
            here = here + step
            if last:
                change = np.einsum("wmp,wp->wm", slope, step)
            else:
                moved = engine.quick_values(engine.coordinates.natural(here)[0], rows)
                change = moved - quick
            value = value + change
            rest = rest + _white(whitener, change)
        first, second = lengths
        settled = (second < SETTLED) & ((second < GOOD_SLOPE * first) | (first < SHORT))
        square = np.sum(rest**2, axis=1)
        settled &= np.isfinite(square)
        found.place[left], found.value[left], found.slope[left] = here, value, slope
        found.chi_square[left], found.settled[left] = square, settled
        found.steps[left] += 1
        keep = ~settled & np.isfinite(square)
        left, place = left[keep], here[keep]


def refit(engine: Engine, seen: Whitened, place: FloatArray) -> Fit:
    """Fit again from places (W, 3) that are near: for perturbed captures or inputs."""
    found = Fit.empty(*seen.data.shape)
    index = np.flatnonzero(np.isfinite(place).all(axis=1))
    _polish(engine, seen, index, place[index], found)
    left = index[~found.settled[index]]
    if left.size:
        solved = engine.solve(place[left], left, seen.data, seen.whitener, quick=False)
        found.place[left], found.settled[left] = solved.place, solved.settled
    return found


def _exactly(
    engine: Engine,
    grid: StartGrid,
    seen: Whitened,
    index: NDArray[np.intp],
    starts: NDArray[np.intp],
    found: Fit,
) -> None:
    """Exact engine from the solution so far and every start; the lowest chi-square wins."""
    if not index.size:
        return
    usable = np.isfinite(found.place[index]).all(axis=1)
    candidates = [np.flatnonzero(usable)]
    places = [found.place[index[usable]]]
    columns = [np.zeros(usable.sum(), dtype=np.intp)]
    for number in range(starts.shape[1]):
        here = np.flatnonzero(starts[index, number] >= 0)
        candidates.append(here)
        places.append(engine.coordinates.place(grid.material[starts[index[here], number]]))
        columns.append(np.full(len(here), number + 1, dtype=np.intp))
    which, column = np.concatenate(candidates), np.concatenate(columns)
    solved = engine.solve(
        np.concatenate(places), index[which], seen.data, seen.whitener, quick=False
    )
    table = np.full((len(index), starts.shape[1] + 1), np.inf)
    table[which, column] = np.where(np.isfinite(solved.chi_square), solved.chi_square, np.inf)
    row = np.zeros(table.shape, dtype=np.intp)
    row[which, column] = np.arange(len(which))
    best = table.argmin(axis=1)
    chosen = row[np.arange(len(index)), best]
    lowest = table.min(axis=1)
    np.add.at(found.steps, index[which], solved.steps)
    found.starts[index] = np.isfinite(table[:, 1:]).sum(axis=1)
    found.agreeing[index] = np.minimum(_agreeing(table[:, 1:], lowest), found.starts[index])
    place = np.asarray(solved.place)[chosen]
    value, slope = engine.evaluate(place, index)
    rest = _white(seen.whitener[index], value - seen.data[index])
    found.place[index], found.value[index], found.slope[index] = place, value, slope
    found.chi_square[index] = np.sum(rest**2, axis=1)
    found.settled[index] = np.asarray(solved.settled)[chosen]


def _white(whitener: FloatArray, difference: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("wij,wj->wi", whitener, difference))
