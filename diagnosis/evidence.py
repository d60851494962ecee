"""Exact evidence of linear effects with Gaussian and half-Gaussian priors, for many at once.

With r = M a + e, e standard normal and a ~ N(0, S), the evidence of M over no effect is

    ln B = 1/2 b' A^-1 b - 1/2 ln |S A|,  A = G + S^-1,  b = M' r,  G = M' M

(MacKay 1992, "Bayesian interpolation", equation 2.9 for a single level). A parameter that cannot
be negative has a half-Gaussian prior: B is multiplied by the posterior probability of the allowed
orthant over its prior probability. Prior scales are orders of magnitude rather than standard
deviations: the evidence is a mixture over `SCALES` times them.

Only G and b enter, so thousands of simulated residuals cost as many vectors b of E numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.special import log_ndtr, logsumexp, ndtr, owens_t

from diagnosis.problem import Candidate
from twin.spectra import FloatArray

SCALES = (1.0 / 3.0, 1.0, 3.0)
WEIGHTS = (0.25, 0.5, 0.25)
SAFE = 1e-5
"""Orthant probabilities below this lose digits in the closed form."""

Hypothesis = tuple[int, ...]
"""Indices of the candidates at work, increasing."""


@dataclass(frozen=True, eq=False)
class Scores:
    """All that the evidence needs to know of data and signatures.

    Columns are in units of prior scales, turned so that a signed parameter is never negative.

    Attributes:
        gram: G, shape (E, E).
        inner: b, shape (draws, E).
        positive: parameters that cannot be negative, (E,).
        columns: those of every candidate.
    """

    gram: FloatArray
    inner: FloatArray
    positive: np.ndarray
    columns: tuple[tuple[int, ...], ...]

    def of(self, hypothesis: Hypothesis) -> list[int]:
        """The columns of a hypothesis."""
        return [column for index in hypothesis for column in self.columns[index]]


def turned_scales(candidates: tuple[Candidate, ...]) -> tuple[FloatArray, np.ndarray]:
    """Factor of every column to units of `Scores`, and which cannot be negative, (E,) each."""
    scale = np.array([s for c in candidates for s in c.prior_scale])
    sign = np.array([s for c in candidates for s in c.sign])
    return np.where(sign < 0, -scale, scale), sign != 0


def hypotheses(allowed: list[int], pairs: bool = True) -> list[Hypothesis]:
    """Every single and every pair of the allowed candidates."""
    singles: list[Hypothesis] = [(index,) for index in allowed]
    return singles + (list(combinations(allowed, 2)) if pairs else [])


def log_evidence(scores: Scores, tested: list[Hypothesis]) -> FloatArray:
    """Log B of every hypothesis over no effect, shape (draws, hypotheses)."""
    result = np.empty((scores.inner.shape[0], len(tested)))
    by_size: dict[int, list[int]] = {}
    for position, hypothesis in enumerate(tested):
        by_size.setdefault(len(scores.of(hypothesis)), []).append(position)
    for positions in by_size.values():
        columns = np.array([scores.of(tested[position]) for position in positions])
        result[:, positions] = _log_evidence(scores, columns)
    return result


def _log_evidence(scores: Scores, columns: np.ndarray) -> FloatArray:
    gram = scores.gram[columns[:, :, None], columns[:, None, :]]
    inner = np.moveaxis(scores.inner[:, columns], 0, 1)  # (H, draws, k)
    positive = scores.positive[columns]
    size = columns.shape[1]
    parts = []
    for scale, weight in zip(SCALES, WEIGHTS, strict=True):
        precision = gram + np.eye(size) / scale**2
        covariance = np.linalg.inv(precision)
        mean = inner @ covariance
        gain = 0.5 * np.sum(mean * inner, axis=2)
        gain -= 0.5 * (np.linalg.slogdet(precision)[1] + 2 * size * np.log(scale))[:, None]
        gain += _allowed(mean, covariance, positive)
        parts.append(gain + np.log(weight))
    return np.asarray(logsumexp(parts, axis=0).T)


def _allowed(mean: FloatArray, covariance: FloatArray, positive: np.ndarray) -> FloatArray:
    """Log of posterior over prior probability of the allowed orthant, (H, draws)."""
    result = np.zeros(mean.shape[:2])
    for pattern in {tuple(row) for row in positive}:
        signed = np.flatnonzero(pattern)
        if not signed.size:
            continue
        rows = np.flatnonzero((positive == np.array(pattern)).all(axis=1))
        block = covariance[rows][:, signed[:, None], signed[None, :]]
        sd = np.sqrt(np.diagonal(block, axis1=1, axis2=2))
        correlation = block / (sd[:, :, None] * sd[:, None, :])
        height = mean[rows][:, :, signed] / sd[:, None, :]
        result[rows] = log_orthant(height, correlation[:, None]) + signed.size * np.log(2.0)
    return result


def log_orthant(height: FloatArray, correlation: FloatArray) -> FloatArray:
    """Log P(X > 0) for X ~ N(height, correlation); shapes (..., k) and (..., k, k) to (...).

    Exact for one and two variables (Owen 1956); beyond that, and where the probability is tiny,
    one variable after the other is conditioned on, its moments exact and its shape taken as
    normal (Mendell and Elston 1974).
    """
    size = height.shape[-1]
    if size == 1:
        return np.asarray(log_ndtr(height[..., 0]))
    result = _conditioned(height, correlation)
    if size == 2:
        exact = bivariate(height[..., 0], height[..., 1], correlation[..., 0, 1])
        result = np.where(exact > SAFE, np.log(np.maximum(exact, SAFE)), result)
    return np.asarray(result)


def _conditioned(height: FloatArray, correlation: FloatArray) -> FloatArray:
    size = height.shape[-1]
    # The least likely first: the approximation is then best where it matters.
    order = np.argsort(height, axis=-1)
    mean = np.take_along_axis(height, order, axis=-1)
    wide = np.broadcast_to(correlation, (*height.shape, size))
    wide = np.take_along_axis(wide, order[..., :, None], axis=-2)
    cov = np.take_along_axis(wide, order[..., None, :], axis=-1)
    total = np.zeros(height.shape[:-1])
    for first in range(size):
        sd = np.sqrt(np.maximum(cov[..., first, first], 1e-12))
        ratio = mean[..., first] / sd
        log_probability = log_ndtr(ratio)
        total = total + log_probability
        mills = np.exp(-0.5 * ratio**2 - 0.5 * np.log(2 * np.pi) - log_probability)
        slope = cov[..., :, first] / sd[..., None]
        mean = mean + slope * mills[..., None]
        shrink = mills * (mills + ratio)
        cov = cov - shrink[..., None, None] * slope[..., :, None] * slope[..., None, :]
    return total


def bivariate(first: FloatArray, second: FloatArray, correlation: FloatArray) -> FloatArray:
    """P(X > 0, Y > 0) for unit normals of means `first` and `second` (Owen 1956, eq. 2.1)."""
    rho = np.clip(correlation, -1 + 1e-9, 1 - 1e-9)
    h = np.where(np.abs(first) < 1e-12, 1e-12, first)
    k = np.where(np.abs(second) < 1e-12, 1e-12, second)
    root = np.sqrt(1.0 - rho**2)
    value = 0.5 * (ndtr(h) + ndtr(k))
    value = value - owens_t(h, (k - rho * h) / (h * root)) - owens_t(k, (h - rho * k) / (k * root))
    return np.asarray(value - np.where(h * k < 0, 0.5, 0.0))
