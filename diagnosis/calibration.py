"""What the statistics do when no effect is at work: parametric bootstrap in the reduced space.

There a residual of the no-effect model is standard normal, so only the components along the
signatures and along the unknown's directions are drawn: a few dozen numbers each.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from diagnosis.evidence import Hypothesis, Scores, hypotheses, log_evidence
from diagnosis.unknown import Unknown
from twin.spectra import FloatArray

DRAWS = 4000


@dataclass(frozen=True, eq=False)
class Detection:
    """Whether there is a gap at all.

    Attributes:
        statistic: ln of the posterior odds of singles and unknown against no effect.
        p: family-wise probability of more without an effect.
        adjusted: the same for every allowed candidate alone, over the largest of all, (C,); 1
            for those that were not tested.
        threshold: standard deviations at which a single of average shape is found.
    """

    statistic: float
    p: float
    adjusted: FloatArray
    threshold: float


def generator_of(seed: int, purpose: int) -> np.random.Generator:
    """The random numbers of one purpose of one diagnosis."""
    return np.random.Generator(np.random.Philox(key=[seed, purpose]))


def detect(
    scores: Scores,
    columns: FloatArray,
    residual: FloatArray,
    unknown: Unknown,
    allowed: list[int],
    log_prior: FloatArray,
    log_prior_unknown: float,
    *,
    seed: int = 0,
    draws: int = DRAWS,
) -> Detection:
    """Test for any gap, calibrated by simulation.

    Args:
        scores: of the observed residual, one draw.
        columns: scaled reduced signatures, (n, E).
        residual: observed, (n,).
        unknown: the alternative outside the catalogue.
        allowed: candidates that can be seen.
        log_prior: ln prior probability of the singles of `allowed`.
        log_prior_unknown: of the unknown.
        seed: of the simulation.
        draws: simulated residuals.
    """
    both = np.concatenate([columns, unknown.direction], axis=1)
    value, vector = np.linalg.eigh(both.T @ both)
    root = vector * np.sqrt(np.maximum(value, 0.0))
    drawn = generator_of(seed, 1).standard_normal((draws, len(value))) @ root.T
    size = columns.shape[1]
    tested: list[Hypothesis] = hypotheses(allowed, pairs=False)

    def statistics(inner: FloatArray, along: FloatArray) -> tuple[FloatArray, FloatArray]:
        single = log_evidence(Scores(scores.gram, inner, scores.positive, scores.columns), tested)
        other = unknown.log_evidence(along) + log_prior_unknown
        every = np.concatenate([single + log_prior, other[:, None]], axis=1)
        return logsumexp(every, axis=1), single

    null, singles = statistics(drawn[:, :size], drawn[:, size:])
    observed, found = statistics(scores.inner, (residual @ unknown.direction)[None])
    largest = np.max(singles, axis=1, initial=-np.inf)
    adjusted = np.ones(len(scores.columns))
    adjusted[allowed] = [float(_rank(largest, value)) for value in found[0]]
    return Detection(
        statistic=float(observed[0]),
        p=float(_rank(null, observed[0])),
        adjusted=adjusted,
        threshold=loudest(scores, drawn[:, :size]),
    )


def loudest(scores: Scores, drawn: FloatArray) -> float:
    """95 % quantile of the loudest normalised single of simulated components (draws, E)."""
    size = np.sqrt(np.diag(scores.gram))
    seen = size > 1e-12 * np.max(size, initial=1e-300)
    if not seen.any():
        return np.inf
    height = drawn[:, seen] / size[seen]
    signed = np.where(scores.positive[seen], height, np.abs(height))
    return float(np.quantile(signed.max(axis=1), 0.95))


def _rank(null: FloatArray, observed: float) -> float:
    return (1.0 + np.sum(null >= observed)) / (1.0 + null.size)
