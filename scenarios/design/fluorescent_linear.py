"""Estimates that are linear in the captures, of every candidate of a pool at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf, dpotri

from estimators.fluorescence.background import vertex
from estimators.fluorescence.donaldson import SMOOTHER
from scenarios.design.fluorescent_channels import Pool
from scenarios.design.fluorescent_prior import Population
from twin.errors import InputError
from twin.spectra import FloatArray

PROJECTIONS = 4
"""Times that what the bounds cut off is given back to the captures."""


@dataclass(frozen=True, eq=False)
class LinearEstimates:
    """Posterior means under linearised priors; I priors of B materials, S draws of the noise.

    Attributes:
        pool: lights and channels; population: materials.
        material: of each prior, (I,).
        prior: covariance of the captures under each prior, (I, L, L).
        gain: covariance of captures and cells, (I + 1, L, C + D), the last without products.
        mean: of the cells, (I + 1, C + D).
        left: captures less those of the mean, (I, S, L); first: the same without products,
            (B, S, L), with the covariance `smooth`, (L, L).
        rough: covariance of the captures of single cells with standard deviation 1, (L, L).
        jacobian: of the cells by the products' parameters, I times (C, K P).
        parameters: where products were linearised, I times (K, P).
    """

    pool: Pool
    population: Population
    material: NDArray[np.intp]
    prior: FloatArray
    gain: FloatArray
    mean: FloatArray
    left: FloatArray
    first: FloatArray
    smooth: FloatArray
    rough: FloatArray
    jacobian: tuple[FloatArray, ...]
    parameters: tuple[FloatArray, ...]

    @classmethod
    def of(cls, pool: Pool, population: Population) -> LinearEstimates:
        """What the candidates of a pool share."""
        design = pool.design
        items = [(b, p) for b, each in enumerate(population.priors) for p in each]
        material = np.array([b for b, _ in items], dtype=np.intp)
        mean = np.array([p.mean for _, p in items] + [population.mean])
        covariances = [p.covariance for _, p in items] + [population.smooth]
        gain = np.array([design @ each for each in covariances])
        prior = gain @ design.T
        left = (population.truth[material] - mean[:-1]) @ design.T
        first = (population.truth - population.mean) @ design.T
        single = design[:, : population.size]
        return cls(
            pool, population, material, prior[:-1], gain, mean,
            left[:, None] + pool.draws[material], first[:, None] + pool.draws, prior[-1],
            single @ single.T, tuple(p.jacobian for _, p in items),
            tuple(p.parameters for _, p in items),
        )  # fmt: skip

    def estimates(self, members: Sequence[NDArray[np.intp]]) -> FloatArray:
        """Expected answers (N, B, S, C + D) of N candidates, each a choice of lights."""
        batch, draws, size = self.first.shape
        items, count = len(self.material), len(members)
        rows = [self.rows(each) for each in members]
        alone = np.zeros((batch, count, draws, size))
        alone_inverse = np.zeros((batch, count, size, size))
        rough = np.zeros((batch, count))
        evidence = np.zeros((items + batch, count, draws))
        for n, own in enumerate(rows):
            part = np.ix_(own, own)
            found = self.first_pass(own)
            rough[:, n], alone[:, n][..., own], inverse, evidence[items:, n] = found
            for b in range(batch):
                alone_inverse[b, n][part] = inverse[b]
        out = np.zeros((items + batch, count, draws, self.mean.shape[1]))
        for item, b in enumerate(self.material):
            weight = np.zeros((count, draws, size))
            inverses = np.zeros((count, size, size))
            for n, own in enumerate(rows):
                part = np.ix_(own, own)
                covariance = self.prior[item][part] + self.pool.noise[b][part]
                covariance += rough[b, n] ** 2 * self.rough[part]
                inverse, logarithm = _inverse(covariance)
                values = self.left[item][:, own]
                weighted = values @ inverse
                evidence[item, n] = -0.5 * ((weighted * values).sum(axis=1) + logarithm)
                weight[n][:, own], inverses[n][part] = weighted, inverse
            out[item] = self._answer(item, weight, inverses, rough[b])
        for b in range(batch):
            out[items + b] = self._answer(items, alone[b], alone_inverse[b], rough[b])
        owner = np.concatenate([self.material, np.arange(batch)])
        return mixed(out, evidence, owner, batch)

    def rows(self, lights: NDArray[np.intp]) -> NDArray[np.intp]:
        """Directions that some lights show, (m,).

        Raises:
            InputError: they show nothing to the detector.
        """
        found = np.flatnonzero(np.isin(self.pool.light, lights))
        if not found.size:
            raise InputError(
                "a candidate whose lights show nothing to the detector", "lights that it sees",
                place="setups",
            )  # fmt: skip
        return found

    def first_pass(
        self, rows: NDArray[np.intp], *, between: bool = False
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Without products, with the roughness that the estimator takes: by the evidence, smoother.

        Args:
            rows: directions, (m,).
            between: also between the values that the prior names, as the estimator has it.

        Returns:
            Roughness (B,), weights (B, S, m), inverse covariance (B, m, m), evidence (B, S).
        """
        part = np.ix_(rows, rows)
        values = self.first[..., rows]
        base = self.smooth[part] + self.pool.noise.mean(axis=0)[part]
        grid = np.log(np.array(self.population.roughness))
        tried = [_inverse(base + np.exp(2.0 * level) * self.rough[part]) for level in grid]
        each = np.array([_evidence(values, *one) for one in tried])
        means = each.mean(axis=2)
        best = means.argmax(axis=0)
        level = grid[best]
        if between:
            level = np.array([vertex(grid, means[:, b], int(n)) for b, n in enumerate(best)])
        level = level + np.log(SMOOTHER)
        taken, own = np.unique(level, return_inverse=True)
        tried = [_inverse(base + np.exp(2.0 * each) * self.rough[part]) for each in taken]
        inverses = np.array([tried[n][0] for n in own])
        evidence = np.array(
            [_evidence(value, *tried[n]) for value, n in zip(values, own, strict=True)]
        )
        return np.exp(level), values @ inverses, inverses, evidence

    def _answer(
        self, kind: int, weight: FloatArray, inverse: FloatArray, rough: FloatArray
    ) -> FloatArray:
        """Cells inside their bounds (N, S, C + D) of weighed captures (N, S, L)."""
        count, design = self.population.size, self.pool.design
        single = design[:, :count]

        def cells_of(weighted: FloatArray) -> FloatArray:
            found = weighted @ self.gain[kind]
            found[..., :count] += rough[:, None, None] ** 2 * (weighted @ single)
            return np.asarray(found)

        answer = self.mean[kind] + cells_of(weight)
        if kind < len(self.material):
            answer[..., :count] += self._curvature(kind, weight)
        return inside(answer, design, inverse, cells_of, count)

    def _curvature(self, item: int, used: FloatArray) -> FloatArray:
        """What products at their estimated parameters are more than linearised ones, (N, S, C).

        The parameters are linear in the captures; the products are exponentials of them.
        """
        count, size = self.population.size, self.population.model.size
        jacobian = self.jacobian[item]
        t = used @ (self.pool.design[:, :count] @ jacobian)
        products = self.population.model.fluorescence(
            t.reshape(-1, jacobian.shape[1] // size, size)
        )
        linear = self.mean[item, :count] + t @ jacobian.T
        return np.asarray(products.reshape(linear.shape) - linear)


def inside(
    answer: FloatArray, design: FloatArray, inverse: FloatArray,
    cells_of: Callable[[FloatArray], FloatArray], count: int,
) -> FloatArray:  # fmt: skip
    """Answers with cells at 0 or more and reflectances inside 0 to 1.

    What is cut off at the bounds is given back to the captures a few times (alternating
    projections, von Neumann 1950), so that the answer keeps what was seen.

    Args:
        answer: cells and reflectances, (..., S, C + D).
        design: captures of them, (m, C + D).
        inverse: inverse covariance of the captures, (..., m, m).
        cells_of: cells of weighed captures (..., S, m).
        count: C.
    """
    shown = answer @ design.T
    upper = np.ones(answer.shape[-1])
    upper[:count] = np.inf
    answer = np.clip(answer, 0.0, upper)
    for _ in range(PROJECTIONS):
        missing = (shown - answer @ design.T) @ inverse
        answer = np.clip(answer + cells_of(missing), 0.0, upper)
    return np.asarray(answer)


def mixed(
    answers: FloatArray, evidence: FloatArray, owner: NDArray[np.intp], batch: int
) -> FloatArray:
    """Answers weighed by the evidence of each material's priors, (N, B, S, C + D).

    Args:
        answers: under each of Q priors, (Q, N, S, C + D).
        evidence: its logarithm, (Q, N, S).
        owner: material of each prior, (Q,).
        batch: B.
    """
    _, count, draws, size = answers.shape
    out = np.zeros((count, batch, draws, size))
    for b in range(batch):
        mine = np.flatnonzero(owner == b)
        share = np.exp(evidence[mine] - evidence[mine].max(axis=0))
        share /= share.sum(axis=0)
        for each, number in zip(share, mine, strict=True):
            out[:, b] += each[..., None] * answers[number]
    return out


def _evidence(values: FloatArray, inverse: FloatArray, logarithm: float) -> FloatArray:
    """Log evidence (...) of values (..., m)."""
    return np.asarray(-0.5 * (((values @ inverse) * values).sum(axis=-1) + logarithm))


def _inverse(covariance: FloatArray) -> tuple[FloatArray, float]:
    """Inverse (m, m) of a covariance, and its log determinant."""
    factor, failed = dpotrf(covariance, lower=1, clean=1)
    if failed:
        raise InputError(
            "captures whose covariance has no inverse", "some noise in every capture",
            place="protocol",
        )  # fmt: skip
    logarithm = 2.0 * float(np.log(np.diagonal(factor)).sum())
    half, _ = dpotri(factor, lower=1)
    # above the diagonal are the zeros of the factor
    whole = half + half.T
    whole.flat[:: len(whole) + 1] *= 0.5
    return whole, logarithm
