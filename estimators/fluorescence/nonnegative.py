"""The Gaussian posterior cut to what a matrix can be: no negative cell, no reflectance above 1.

Setting the negative cells of a posterior mode to 0 adds light that the captures do not have. The
mode of the cut posterior does not: of all matrices inside the bounds it is the one nearest to the
free mode in the metric of the posterior covariance, found by block principal pivoting (Portugal,
Judice, Vicente 1994) on the multipliers of the bounds. Draws are cut likewise by a few alternating
projections: on the bounds, and back on the captures that the draw explained before (Dykstra-like,
von Neumann 1950), in the metric of the prior.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimators.fluorescence.background import Reduced
from twin.spectra import FloatArray

TOLERANCE = 1e-7
"""Of a cell outside its bounds."""
ROUNDS = 40
"""Most rounds of pivoting; the last ones exchange one cell at a time."""
BLOCKS = 12
"""Rounds that may exchange all offending cells at once without getting better."""


def posterior_covariance(reduced: Reduced, amplitude: float, sample: int) -> FloatArray:
    """Of one sample's C cells and D reflectances, products given, (C + D, C + D).

    Args:
        reduced: the captures.
        amplitude: of the background.
        sample: index of the sample.
    """
    factor = np.linalg.cholesky(reduced.covariance(amplitude, sample))
    white = np.linalg.solve(factor, reduced.gain(amplitude, sample))
    return np.asarray(reduced.unknowns(amplitude, sample) - white.T @ white)


def nearest(
    mode: FloatArray, covariance: FloatArray, lower: FloatArray, upper: FloatArray
) -> tuple[FloatArray, NDArray[np.bool_], bool]:
    """The mode of a normal distribution that is cut to a box.

    Args:
        mode: of the normal distribution, (N,).
        covariance: (N, N).
        lower: bounds, (N,).
        upper: bounds, (N,).

    Returns:
        The cut mode (N,), which unknowns lie at a bound (N,), whether the bounds are all kept.
    """
    low, high = mode < lower, mode > upper
    fewest, patience, done = low.size + 1, BLOCKS, False
    found = mode
    for _ in range(ROUNDS):
        at = np.flatnonzero(low | high)
        if at.size == 0:
            done = True
            break
        bound = np.where(low, lower, upper)[at]
        block = covariance[np.ix_(at, at)]
        block = block + np.diag(1e-9 * np.diagonal(block) + 1e-300)
        multiplier = np.linalg.solve(block, bound - mode[at])
        found = mode + covariance[:, at] @ multiplier
        found[at] = bound
        free = np.ones(low.size, dtype=bool)
        free[at] = False
        below, above = free & (found < lower - TOLERANCE), free & (found > upper + TOLERANCE)
        let_go = np.zeros(low.size, dtype=bool)
        let_go[at] = np.where(low[at], multiplier < 0.0, multiplier > 0.0)
        wrong = np.flatnonzero(below | above | let_go)
        if wrong.size == 0:
            done = True
            break
        if wrong.size < fewest:
            fewest, patience = wrong.size, BLOCKS
        elif patience > 0:
            patience -= 1
        else:
            wrong = wrong[-1:]
        low[wrong] = below[wrong]
        high[wrong] = above[wrong]
    return (
        np.clip(found, lower, upper),
        (low | high) & (found == np.clip(found, lower, upper)),
        done,
    )


def back_on_captures(
    unknowns: FloatArray, design: FloatArray, move: FloatArray, cells: int, rounds: int = 4
) -> FloatArray:
    """Draws inside the bounds that explain the captures as before, about.

    Args:
        unknowns: draws, (K, C + D).
        design: values of the unknowns, (m, C + D).
        move: how unknowns follow values, (m, C + D).
        cells: C, which have no upper bound.
        rounds: of alternating projections.
    """
    target = unknowns @ design.T
    upper = np.ones(unknowns.shape[1])
    upper[:cells] = np.inf
    found = np.clip(unknowns, 0.0, upper)
    for _ in range(rounds):
        found = np.clip(found + (target - found @ design.T) @ move, 0.0, upper)
    return np.asarray(found)
