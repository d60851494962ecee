"""Estimates with products fitted to the captures of every candidate, from the truth's products on.

One linear step from the true matrix overshoots where captures say little of the shape of a product:
products are exponentials of their parameters. Here the estimator's own Levenberg-Marquardt goes on
until it settles, in the directions of the pool, and the mode is cut to its bounds as the estimator
cuts it (`nearest`). What is left out of the whole simulation are exposures and calibration on the
candidate's own lights, the coarse backgrounds, and the search: it starts beside the truth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from estimators.fluorescence.fit import Fit, fit
from estimators.fluorescence.nonnegative import nearest
from estimators.fluorescence.posterior_draws import NEGLIGIBLE
from estimators.fluorescence.products import Products
from scenarios.design.fluorescent_linear import LinearEstimates
from twin.spectra import FloatArray

STEPS = 15
"""Most steps, as `DonaldsonSettings`."""
SEARCH = 1.064
"""What the estimator's search, which does not start at the truth, adds to the RMSE of the cells.
Calibrated on the simulated visits to 24 materials each of populations 1 and 3 (8 and 11 set-ups)
on 22 November 2026: simulated over predicted 0.99 +- 0.02 and 1.14 +- 0.05; the mean of all 48 is
1.063 +- 0.026. Population 2 had no part in it."""


@dataclass(frozen=True, eq=False)
class Values:
    """What `fit` asks of reduced captures: N of them, whatever the amplitude.

    Attributes:
        value: captures less those of the mean reflectance, (N, m).
        known: their covariance with all that is Gaussian marginalised, (N, m, m).
    """

    value: FloatArray
    known: FloatArray

    def covariance(self, amplitude: float) -> FloatArray:
        """(N, m, m)."""
        return self.known


@dataclass(frozen=True, eq=False)
class FittedEstimates:
    """Posterior modes of B materials and S draws of the noise.

    Attributes:
        linear: the pool and the linearised priors.
        steps: most steps of the fit.
    """

    linear: LinearEstimates
    steps: int = STEPS

    def estimates(self, members: Sequence[NDArray[np.intp]]) -> FloatArray:
        """Expected answers (N, B, S, C + D) of N candidates, each a choice of lights."""
        return np.array([self._one(each) for each in members])

    @cached_property
    def _background(self) -> tuple[FloatArray, FloatArray]:
        """Covariance (I, L, L) and gain (I, L, C + D) of each prior without its products."""
        known = self.linear
        single = known.pool.design[:, : known.population.size]
        prior, gain = known.prior.copy(), known.gain[:-1].copy()
        for item, jacobian in enumerate(known.jacobian):
            seen = single @ jacobian
            prior[item] -= seen @ seen.T
            gain[item][:, : known.population.size] -= seen @ jacobian.T
        return prior, gain

    @cached_property
    def _design(self) -> FloatArray:
        """Fluorescence cells as matrices, (L, Wo, Wi)."""
        population = self.linear.population
        below = population.cells.below_diagonal
        out = np.zeros((len(self.linear.pool.design), *below.shape))
        out[:, below] = self.linear.pool.design[:, : population.size]
        return out

    def _one(self, lights: NDArray[np.intp]) -> FloatArray:
        known, population = self.linear, self.linear.population
        rows = known.rows(lights)
        part = np.ix_(rows, rows)
        rough, alone, inverse, evidence = known.first_pass(rows, between=True)
        batch, draws = evidence.shape
        prior, gain = self._background
        kept, modes, owner = known.gain[-1][rows], [], [*range(batch)]
        posteriors: list[_Posterior] = []
        for b in range(batch):
            own = _Posterior(self, -1, b, float(rough[b]), rows, kept, inverse[b])
            posteriors.append(own)
            modes.append(own.mode(alone[b]))
        found = [evidence]
        noise = known.pool.noise[:, rows[:, None], rows]
        model = Products(self._design[rows], population.cells, population.model.prior)
        model.__dict__["_bases"] = population.model._bases
        for count in sorted({len(each) for each in known.parameters}):
            items = [i for i, each in enumerate(known.parameters) if len(each) == count]
            material = known.material[items]
            covariance = prior[items][:, rows[:, None], rows] + noise[material]
            covariance = covariance + rough[material][:, None, None] ** 2 * known.rough[part]
            value = known.first[material][..., rows].reshape(-1, rows.size)
            values = Values(value, np.repeat(covariance, draws, axis=0))
            start = np.repeat(np.array([known.parameters[i] for i in items]), draws, axis=0)
            one: Fit = fit(cast(Any, values), model, 0.0, start, self.steps)
            cells = population.model.fluorescence(one.parameters)
            cells = cells.reshape(len(items), draws, -1)
            weighted = one.weighted.reshape(len(items), draws, -1)
            inverses = np.linalg.inv(covariance)
            for n, (item, b) in enumerate(zip(items, material, strict=True)):
                own = _Posterior(
                    self, item, int(b), float(rough[b]), rows, gain[item][rows], inverses[n]
                )
                posteriors.append(own)
                mode = own.mode(weighted[n])
                mode[..., : population.size] += cells[n]
                modes.append(mode)
                owner.append(int(b))
            found.append(one.log_evidence.reshape(len(items), draws))
        return _mean(modes, np.concatenate(found), np.array(owner), posteriors)


@dataclass(frozen=True, eq=False)
class _Posterior:
    """All cells of one material under one prior, products given; `item` -1: without products."""

    estimates: FittedEstimates
    item: int
    material: int
    rough: float
    rows: NDArray[np.intp]
    kept: FloatArray
    inverse: FloatArray

    @property
    def _size(self) -> int:
        return self.estimates.linear.population.size

    @cached_property
    def _gain(self) -> FloatArray:
        out = self.kept.copy()
        design = self.estimates.linear.pool.design[self.rows]
        out[:, : self._size] += self.rough**2 * design[:, : self._size]
        return out

    def mode(self, weighted: FloatArray) -> FloatArray:
        """Cells (S, C + D) of weighed captures (S, m), without the products."""
        return np.asarray(self.estimates.linear.population.mean + weighted @ self._gain)

    @cached_property
    def covariance(self) -> FloatArray:
        """(C + D, C + D)."""
        population, size = self.estimates.linear.population, self._size
        if self.item < 0:
            prior = population.smooth.copy()
        else:
            own = [each for known in population.priors for each in known][self.item]
            prior = own.covariance.copy()
            prior[:size, :size] -= own.jacobian @ own.jacobian.T
        prior[np.arange(size), np.arange(size)] += self.rough**2
        return np.asarray(prior - self._gain.T @ (self.inverse @ self._gain))

    def inside(self, mode: FloatArray) -> FloatArray:
        """The mode (C + D,) of the posterior cut to its bounds."""
        upper = np.ones(mode.size)
        upper[: self._size] = np.inf
        if np.all((mode >= 0.0) & (mode <= upper)):
            return mode
        return nearest(mode, self.covariance, np.zeros(mode.size), upper)[0]


def _mean(
    modes: Sequence[FloatArray], evidence: FloatArray, owner: NDArray[np.intp],
    posteriors: Sequence[_Posterior],
) -> FloatArray:  # fmt: skip
    """Modes inside the bounds, weighed by the evidence of each material's priors, (B, S, C + D)."""
    batch = int(owner.max()) + 1
    out = np.zeros((batch, *modes[0].shape))
    for b in range(batch):
        mine = np.flatnonzero(owner == b)
        share = np.exp(evidence[mine] - evidence[mine].max(axis=0))
        share /= share.sum(axis=0)
        share = np.where(share < NEGLIGIBLE, 0.0, share)
        share /= share.sum(axis=0)
        for number, draw in zip(*np.nonzero(share), strict=True):
            which = mine[number]
            best = posteriors[which].inside(modes[which][draw])
            out[b, draw] += share[number, draw] * best
    return out
