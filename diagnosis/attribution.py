"""Which effect: posterior probabilities of none, every single, every pair, and the unknown."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import logsumexp

from diagnosis.evidence import Hypothesis, Scores, hypotheses, log_evidence, turned_scales
from diagnosis.problem import Problem
from diagnosis.refit import Fit, fit, log_evidence_at
from twin.spectra import FloatArray

CREDIBLE = 0.9
"""Probability that a credible set holds."""
SINGLES = 4
"""Singles that are refitted at most."""
PAIRS = 6
"""Pairs that are refitted at most."""
BEHIND = 12.0
"""Log odds behind the best at which a refit can no longer matter, beside `CURVATURE`."""
CURVATURE = 0.1
"""Share of the best evidence that a linear model may be wrong by."""


@dataclass(frozen=True)
class PriorOdds:
    """Prior probabilities, before candidates and pairs share theirs."""

    none: float = 0.5
    single: float = 0.35
    pair: float = 0.1
    unknown: float = 0.05


@dataclass(frozen=True, eq=False)
class Posterior:
    """Probabilities of everything that was considered.

    Attributes:
        tested: singles and pairs.
        log_weight: ln (prior times evidence over no effect), one each.
        none: ln prior of no effect.
        unknown: ln weight of the unknown.
        fits: nonlinear fits of the leaders.
        failed: hypotheses whose fit raised, with what it said; they have no weight left.
    """

    tested: list[Hypothesis]
    log_weight: FloatArray
    none: float
    unknown: float
    fits: dict[Hypothesis, Fit]
    failed: dict[Hypothesis, str] = field(default_factory=dict)

    @property
    def best(self) -> Hypothesis:
        """The leading set of effects."""
        return self.tested[int(np.argmax(self.log_weight))]

    def probability(self, *, gap: bool = False) -> tuple[FloatArray, float, float]:
        """Probabilities of `tested` (T,), of the unknown and of none; `gap` rules none out."""
        none = -np.inf if gap else self.none
        every = np.concatenate([self.log_weight, [self.unknown, none]])
        share = np.exp(every - logsumexp(every))
        return share[:-2], float(share[-2]), float(share[-1])

    def inclusion(self, count: int, *, gap: bool = False) -> FloatArray:
        """Probability that each of `count` candidates is at work, (count,)."""
        share = self.probability(gap=gap)[0]
        result = np.zeros(count)
        for hypothesis, probability in zip(self.tested, share, strict=True):
            result[list(hypothesis)] += probability
        return result


def scores_of(problem: Problem, null: Fit) -> tuple[Scores, FloatArray]:
    """Scores of all candidates about the no-effect fit, and their columns in scaled units."""
    factor, positive = turned_scales(problem.candidates)
    columns = null.reduction(np.moveaxis(problem.signatures, 0, -1)) * factor
    inner = columns.T @ null.residual
    return Scores(columns.T @ columns, inner[None], positive, problem.columns), columns


def log_priors(problem: Problem, tested: list[Hypothesis], odds: PriorOdds) -> FloatArray:
    """Log prior of every hypothesis: effects by weight, instances sharing their effect's."""
    effects = [candidate.effect for candidate in problem.candidates]
    own = np.array([c.weight / effects.count(c.effect) for c in problem.candidates])
    weight = np.array([np.prod(own[list(hypothesis)]) for hypothesis in tested])
    size = np.array([len(hypothesis) for hypothesis in tested])
    result = np.zeros(len(tested))
    for count, total in ((1, odds.single), (2, odds.pair)):
        of_size = size == count
        if of_size.any():
            result[of_size] = np.log(total * weight[of_size] / weight[of_size].sum())
    return result


def linear(
    problem: Problem,
    scores: Scores,
    allowed: list[int],
    log_evidence_unknown: float,
    odds: PriorOdds,
) -> Posterior:
    """Posterior from the linear model about the no-effect fit."""
    tested = hypotheses(allowed)
    weight = log_evidence(scores, tested)[0] + log_priors(problem, tested, odds)
    return Posterior(
        tested, weight, float(np.log(odds.none)), log_evidence_unknown + np.log(odds.unknown), {}
    )


def refine(problem: Problem, null: Fit, first: Posterior, odds: PriorOdds) -> Posterior:
    """Refit the leaders; pairs are judged again about the refit of their better half."""
    weight = first.log_weight.copy()
    prior = log_priors(problem, first.tested, odds)
    place = {hypothesis: index for index, hypothesis in enumerate(first.tested)}
    fits: dict[Hypothesis, Fit] = {}
    margin = BEHIND + CURVATURE * max(float(np.max(weight - prior)), 0.0)
    failed: dict[Hypothesis, str] = {}

    def refit(hypothesis: Hypothesis) -> None:
        try:
            found = fit(problem, hypothesis, null)
        except (ArithmeticError, ValueError) as error:
            # A user's own effect may refuse what it is asked for: it is named and left out.
            failed[hypothesis] = str(error)
            for other, index in place.items():
                if set(hypothesis) <= set(other):
                    weight[index] = -np.inf
            return
        fits[hypothesis] = found
        gain = log_evidence_at(problem, found, null)
        weight[place[hypothesis]] = prior[place[hypothesis]] + gain

    for hypothesis in _leaders(first.tested, weight, 1, SINGLES, margin):
        refit(hypothesis)
    anchors = sorted(fits, key=lambda h: weight[place[h]])
    for anchor in anchors:  # the best one last: it has the last word on its pairs
        with_it: list[Hypothesis] = [
            h for h in first.tested if len(h) == 2 and anchor[0] in h and weight[place[h]] > -np.inf
        ]
        if with_it:
            about = _about(problem, fits[anchor], null, with_it)
            rows = [place[h] for h in with_it]
            weight[rows] = prior[rows] + about
    for hypothesis in _leaders(first.tested, weight, 2, PAIRS, 0.5 * margin):
        refit(hypothesis)
    leader = first.tested[int(np.argmax(weight))]
    while leader not in fits and np.max(weight) > -np.inf:
        refit(leader)
        leader = first.tested[int(np.argmax(weight))]
    return replace(first, log_weight=weight, fits=fits, failed=failed)


def _leaders(
    tested: list[Hypothesis], weight: FloatArray, size: int, most: int, margin: float
) -> list[Hypothesis]:
    ranked = sorted((i for i, h in enumerate(tested) if len(h) == size), key=lambda i: -weight[i])
    best = np.max(weight) if size > 1 else (weight[ranked[0]] if ranked else 0.0)
    return [tested[i] for i in ranked[:most] if weight[i] >= best - margin]


def _about(problem: Problem, anchor: Fit, null: Fit, tested: list[Hypothesis]) -> FloatArray:
    """Log B of pairs, with the anchor's own nonlinearity taken into account."""
    factor, positive = turned_scales(problem.candidates)
    columns = anchor.reduction(np.moveaxis(problem.signatures, 0, -1))
    columns[:, list(problem.columns[anchor.hypothesis[0]])] = anchor.columns
    columns = columns * factor
    target = anchor.residual + anchor.columns @ anchor.value
    scores = Scores(columns.T @ columns, (columns.T @ target)[None], positive, problem.columns)
    gain = log_evidence(scores, tested)[0]
    return np.asarray(gain - 0.5 * target @ target + 0.5 * null.chi_square)


def cover(tested: list[Hypothesis], share: FloatArray, other: float) -> tuple[int, ...]:
    """Smallest (greedy) set of effects of which one is at work with 90 %; -1 is the unknown."""
    left = dict(zip(tested, share, strict=True))
    chosen: list[int] = []
    covered = 0.0
    total = float(share.sum()) + other
    while covered < CREDIBLE * total:
        gain: dict[int, float] = {} if -1 in chosen else {-1: other}
        for hypothesis, probability in left.items():
            for index in hypothesis:
                gain[index] = gain.get(index, 0.0) + float(probability)
        best = max(gain, key=lambda index: gain[index])
        chosen.append(best)
        covered += gain[best]
        left = {h: p for h, p in left.items() if best not in h}
    return tuple(chosen)


def leading_set(posterior: Posterior, share: FloatArray) -> tuple[int, ...]:
    """Effects of the hypotheses of the best one's size that hold 90 % of its probability."""
    size = len(posterior.best)
    same = [i for i, h in enumerate(posterior.tested) if len(h) == size]
    same.sort(key=lambda i: -share[i])
    total, seen, members = float(share[same].sum()), 0.0, dict.fromkeys(posterior.best)
    for index in same:
        if seen >= CREDIBLE * total:
            break
        seen += float(share[index])
        members.update(dict.fromkeys(posterior.tested[index]))
    return tuple(members)
