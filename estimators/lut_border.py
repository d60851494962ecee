"""Draws of the likelihood inside the map, for captures whose noise reaches over the map's border.

The neighbourhood of captures is looked up draw by draw. Where draws fall outside the map, looking
them up says too much: those left out cut the spread off, those put on the border have none across
it, and a sample that looks so sure outweighs the others. Here the question is turned round: which
materials inside the map explain the captures of all samples together? Every material is as
probable as its likelihood (a uniform prior over the map's box); it is drawn by importance
sampling around the best one, with all proposals as one mixture (Veach & Guibas 1995; Cornuet et
al. 2012, Scand. J. Stat. 39, 798).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from estimators.draws import MEDIAN
from estimators.lut_plain import Table
from estimators.result import QUANTILE_LEVELS, normal_deviate
from twin.spectra import FloatArray

PROPOSALS = 800
"""Draws of one round."""
ROUNDS = (2, 8)
"""Least and most rounds; each takes mean and covariance from those before."""
WIDER = 1.4
"""Factor on the standard deviations of a proposal."""
ENOUGH = 100.0
"""Effective number of draws at which the rounds end."""
NEAR = 2.0
"""Standard deviations between the best material and the border below which it is felt."""
CHANCE = 0.001
"""A chi-square less probable says that samples contradict each other."""
HALF_CELL = 0.5
"""Step of derivatives, in cells of the map: inside one cell captures are linear."""


@dataclass(frozen=True, eq=False)
class Likelihood:
    """Captures of one wavelength, all samples that take part together (M captures).

    Attributes:
        tables: maps of these samples.
        power: backgrounds at the wavelength to the maps' exponents, (2B,) each.
        data: captures, (M,): black, white and collimated, without the last where g is held.
        whitener: inverse of the Cholesky factor of their covariance, (M, M).
        fixed_g: g where it is held, or None.
    """

    tables: Sequence[Table]
    power: Sequence[FloatArray]
    data: FloatArray
    whitener: FloatArray
    fixed_g: float | None

    @classmethod
    def of(
        cls,
        tables: Sequence[Table],
        power: Sequence[FloatArray],
        data: FloatArray,
        covariance: FloatArray,
        fixed_g: float | None,
    ) -> Likelihood:
        """Whiten; see the class. Captures are (3 S'), covariance (3 S', 3 S')."""
        kept = np.arange(data.size)
        if fixed_g is not None:
            kept = kept[kept % 3 < 2]
        matrix = covariance[np.ix_(kept, kept)]
        diagonal = np.diagonal(matrix)
        matrix = matrix + np.diag(1e-8 * np.maximum(diagonal, 1e-6 * diagonal.max()) + 1e-300)
        factor = np.linalg.cholesky(matrix)
        return cls(tables, power, data[kept], np.linalg.inv(factor), fixed_g)

    @cached_property
    def box(self) -> tuple[FloatArray, FloatArray]:
        """Least and greatest (albedo, sigma_t, g) that all maps hold, (3,) each."""
        ends = np.array([[(a[0], a[-1]) for a in table.grid.axes] for table in self.tables])
        low, high = ends[..., 0].max(axis=0), ends[..., 1].min(axis=0)
        if self.fixed_g is not None:
            low[2] = high[2] = self.fixed_g
        return low, high

    def rest(self, material: FloatArray) -> FloatArray:
        """Whitened residuals of materials (N, 3) inside the box, (N, M)."""
        columns = []
        for table, power in zip(self.tables, self.power, strict=True):
            triple = table.grid.captures(table.grid.places(material), power[None])
            if self.fixed_g is None:
                triple[:, 2] = np.exp(triple[:, 2])
            else:
                triple = triple[:, :2]
            columns.append(triple)
        return np.asarray((np.concatenate(columns, axis=1) - self.data) @ self.whitener.T)

    def slope(self, material: FloatArray) -> FloatArray:
        """Derivatives of the whitened residuals by the parameters, material (3,), (M, 3)."""
        grid = self.tables[0].grid
        low, high = self.box
        # Both ends of the step along every axis: one row for each, changed in its own column.
        row, axis = np.arange(6), np.repeat(np.arange(3), 2)
        place = np.tile(grid.places(material[None]), (6, 1))
        moved = place[row, axis] + np.tile([-HALF_CELL, HALF_CELL], 3)
        place[row, axis] = np.clip(moved, 0.0, np.array(grid.shape)[axis] - 1)
        ends = np.tile(material, (6, 1))
        ends[row, axis] = np.clip(grid.parameters(place)[row, axis], low[axis], high[axis])
        value = self.rest(ends).reshape(3, 2, -1)
        run = np.diff(ends[row, axis].reshape(3, 2))[:, 0]
        slope = (value[:, 1] - value[:, 0]) / np.where(run > 0.0, run, 1.0)[:, None]
        return np.asarray(np.where(run[:, None] > 0.0, slope, 0.0).T)


class Inside(NamedTuple):
    """What one wavelength's captures say inside the map."""

    draws: FloatArray
    """Materials, (K, 3); spread over the whole map where nothing could be drawn."""
    clipped: FloatArray
    """Quantiles of a Gaussian around the best material, cut at the border, at
    `QUANTILE_LEVELS`, (Q, 3); NaN away from a border."""
    torn: bool
    """Whether the best material of the map does not explain the captures."""


def inside_map(
    likelihood: Likelihood, starts: FloatArray, draws: int, stream: np.random.Generator
) -> Inside:
    """Draw materials of the map by their likelihood; see the module.

    Args:
        likelihood: of one wavelength.
        starts: materials to start the search for the best from, (N, 3).
        draws: K.
        stream: random numbers.
    """
    from scipy.special import chdtri

    low, high = likelihood.box
    span = np.where(high > low, high - low, 1.0)
    best = _best(likelihood, np.clip(starts, low, high))
    rest, slope = likelihood.rest(best[None])[0], likelihood.slope(best)
    freedom = likelihood.data.size - int((high > low).sum())
    squares = float(rest @ rest)
    torn = freedom > 0 and squares > chdtri(freedom, CHANCE)
    # Samples that contradict each other widen everything (Birge 1932).
    scale = max(1.0, squares / freedom) if torn else 1.0
    # The prior of the box, in its units: well conditioned also where the captures say nothing.
    lean = slope * span / np.sqrt(scale)
    precision = lean.T @ lean + 12.0 * np.eye(3)
    covariance = np.linalg.inv(precision) * span[:, None] * span
    centre = best - covariance @ (slope.T @ rest) / scale
    found = _drawn(likelihood, best, covariance, scale, draws, stream)
    if found is None:
        found = low + stream.random((draws, 3)) * (high - low)
    spread = np.sqrt(np.diagonal(covariance))
    felt = (best - low < NEAR * spread) | (high - best < NEAR * spread)
    deviate = normal_deviate(QUANTILE_LEVELS)[:, None]
    clipped = np.clip(centre + deviate * spread, low, high)
    return Inside(found, np.where(felt, clipped, np.nan), torn)


def widened(quantile: FloatArray, clipped: FloatArray) -> FloatArray:
    """The outer of drawn and clipped quantiles, (Q, ..., 3).

    Draws never reach the border itself, where the truth may lie; a Gaussian cut at the border
    does (`least_squares_coordinates.Coordinates.quantiles` treats bounds likewise).
    """
    wide = quantile.copy()
    wide[:MEDIAN] = np.fmin(quantile[:MEDIAN], clipped[:MEDIAN])
    wide[MEDIAN + 1 :] = np.fmax(quantile[MEDIAN + 1 :], clipped[MEDIAN + 1 :])
    return wide


def _best(likelihood: Likelihood, starts: FloatArray) -> FloatArray:
    """The most probable material of the box, from the best of the starts, (3,)."""
    from scipy.optimize import least_squares

    low, high = likelihood.box
    free = np.flatnonzero(high > low)
    span = (high - low)[free]
    squares = np.sum(likelihood.rest(starts) ** 2, axis=1)
    start: FloatArray = starts[int(np.argmin(squares))]

    def whole(share: FloatArray) -> FloatArray:
        material = start.copy()
        material[free] = np.clip(low[free] + share * span, low[free], high[free])
        return material

    solved = least_squares(
        lambda share: likelihood.rest(whole(share)[None])[0],
        np.clip((start - low)[free] / span, 1e-6, 1.0 - 1e-6),
        jac=lambda share: likelihood.slope(whole(share))[:, free] * span,
        bounds=(0.0, 1.0),
        x_scale="jac",
        ftol=1e-4,
        xtol=1e-6,
        gtol=None,
        max_nfev=40,
    )
    return whole(solved.x)


def _drawn(
    likelihood: Likelihood,
    best: FloatArray,
    covariance: FloatArray,
    scale: float,
    draws: int,
    stream: np.random.Generator,
) -> FloatArray | None:
    """Materials drawn by their likelihood, (K, 3), or None where too few proposals hit."""
    low, high = likelihood.box
    free = np.flatnonzero(high > low)
    mean, matrix = best[free], covariance[np.ix_(free, free)]
    proposals: list[tuple[FloatArray, FloatArray]] = []
    points, fits = np.empty((0, 3)), np.empty(0)
    for number in range(ROUNDS[1]):
        factor = WIDER * np.linalg.cholesky(matrix + np.diag(1e-12 * np.diagonal(matrix)))
        proposals.append((mean, np.asarray(factor, dtype=np.float64)))
        material = np.tile(best, (PROPOSALS, 1))
        material[:, free] = mean + stream.standard_normal((PROPOSALS, free.size)) @ factor.T
        inside = ((material >= low) & (material <= high)).all(axis=1)
        log_fit = np.full(PROPOSALS, -np.inf)
        rest = likelihood.rest(material[inside])
        log_fit[inside] = -0.5 / scale * np.sum(rest**2, axis=1)
        points, fits = np.concatenate([points, material]), np.concatenate([fits, log_fit])
        log_weight = fits - _mixture(points[:, free], proposals)
        if not np.isfinite(log_weight).any():
            return None
        weight = np.exp(log_weight - log_weight.max())
        weight /= weight.sum()
        effective = 1.0 / float(np.sum(weight**2))
        if number + 1 >= ROUNDS[0] and effective >= ENOUGH:
            break
        mean = weight @ points[:, free]
        off = points[:, free] - mean
        matrix = (weight[:, None] * off).T @ off + 1e-4 * covariance[np.ix_(free, free)]
    if effective < ENOUGH / 3.0:
        return None
    # Systematic resampling: one random number, no more spread than the weights ask for.
    ladder = (np.arange(draws) + stream.random()) / draws
    chosen = np.minimum(np.searchsorted(np.cumsum(weight), ladder), len(points) - 1)
    return np.asarray(points[chosen])


def _mixture(points: FloatArray, proposals: list[tuple[FloatArray, FloatArray]]) -> FloatArray:
    """Logarithm of the mean density of all proposals but for a constant, (N,)."""
    parts = []
    for mean, factor in proposals:
        standard = np.linalg.solve(factor, (points - mean).T)
        parts.append(-0.5 * np.sum(standard**2, axis=0) - np.log(np.abs(np.diagonal(factor))).sum())
    return np.asarray(np.logaddexp.reduce(parts, axis=0) - np.log(len(parts)))
