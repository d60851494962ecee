"""What every effect costs every estimator: bias in stated errors, coverage lost, what is said."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from scenarios.stress.parts import Case, Outcome
from scenarios.stress.plan import NONE
from scenarios.stress.score import COVERAGES, PARAMETERS, Answers, Score, Share, status_name
from twin.spectra import FloatArray

NINETY = COVERAGES.index(0.9)


@dataclass(frozen=True)
class ParameterCost:
    """One parameter of one estimator with an effect, beside the same points without.

    The materials, the noise and the random numbers of the light are the same in both.

    Attributes:
        bias: median of estimate minus truth in stated standard errors, where claimed.
        distance: median of its absolute value: an effect that errs one way here and the other
            way there has a small bias and a large distance.
        moved: median change of the estimate by the effect in stated standard errors, where it is
            claimed with and without.
        coverage: of the 90 % intervals with the effect; coverage_none: without.
        error_growth: median absolute error over all points in units of that without.
    """

    bias: float
    distance: float
    moved: float
    coverage: Share
    coverage_none: Share
    error_growth: float

    @property
    def lost(self) -> float:
        """Coverage lost: the share without the effect minus that with it."""
        return self.coverage_none.value - self.coverage.value

    def plain(self) -> dict[str, Any]:
        """As JSON holds it."""
        return {
            "bias_in_stated_errors": self.bias,
            "distance_in_stated_errors": self.distance,
            "moved_in_stated_errors": self.moved,
            "coverage_90": self.coverage.plain(),
            "coverage_90_none": self.coverage_none.plain(),
            "coverage_90_lost": self.lost,
            "error_growth": self.error_growth,
        }


@dataclass(frozen=True)
class Cost:
    """One estimator with one entry of effects.

    Attributes:
        case: which.
        parameters: by name.
        overconfident, overconfident_none: points further than 5 stated standard errors off.
        ok, ok_none: points with the status OK: the others say that something is wrong.
    """

    case: Case
    parameters: Mapping[str, ParameterCost]
    overconfident: Share
    overconfident_none: Share
    ok: Share
    ok_none: Share

    @property
    def error_growth(self) -> float:
        """Geometric mean of the growth of the errors of the parameters that are estimated."""
        known = [one.error_growth for one in self.parameters.values()]
        known = [growth for growth in known if not math.isnan(growth)]
        return math.prod(known) ** (1 / len(known)) if known else math.nan

    def plain(self) -> dict[str, Any]:
        """As JSON holds it."""
        return {
            "bench": self.case.bench,
            "noise": self.case.noise,
            "effects": self.case.effects,
            "estimator": self.case.estimator,
            "error_growth": self.error_growth,
            "overconfident": self.overconfident.plain(),
            "overconfident_none": self.overconfident_none.plain(),
            "ok": self.ok.plain(),
            "ok_none": self.ok_none.plain(),
            "parameters": {name: own.plain() for name, own in self.parameters.items()},
        }


def costs_of(outcome: Outcome, scores: Mapping[Case, Score]) -> list[Cost]:
    """What every entry of effects costs, in the order of the plan; empty without effects."""
    found = []
    for case, answers in outcome.answers.items():
        if case.effects == NONE:
            continue
        none = case._replace(effects=NONE)
        found.append(
            Cost(
                case,
                {
                    name: _parameter(
                        outcome.design.material[:, index],
                        (answers, outcome.answers[none]),
                        (scores[case], scores[none]),
                        index,
                    )
                    for index, name in enumerate(PARAMETERS)
                },
                scores[case].overconfident,
                scores[none].overconfident,
                ok_share(scores[case]),
                ok_share(scores[none]),
            )
        )
    return found


def _parameter(
    truth: FloatArray, answers: tuple[Answers, Answers], scores: tuple[Score, Score], index: int
) -> ParameterCost:
    """Answers and scores with and without the effect."""
    own, none = answers
    with_it, without = (score.parameters[PARAMETERS[index]] for score in scores)
    both = own.claimed[:, index] & none.claimed[:, index]
    off = stated_offsets(truth, own, index)
    with np.errstate(invalid="ignore", divide="ignore"):
        moved = ((own.value - none.value) / own.sigma)[both, index]
    growth = math.nan
    if 0.0 < without.median_error_all < math.inf:
        growth = with_it.median_error_all / without.median_error_all
    return ParameterCost(
        bias=median(off),
        distance=median(np.abs(off)),
        moved=median(moved),
        coverage=with_it.coverage[NINETY],
        coverage_none=without.coverage[NINETY],
        error_growth=growth,
    )


def stated_offsets(truth: FloatArray, answers: Answers, index: int) -> FloatArray:
    """Estimate minus truth (N,) in stated standard errors where one parameter is claimed."""
    claimed = answers.claimed[:, index]
    with np.errstate(invalid="ignore", divide="ignore"):
        off = (answers.value[:, index] - truth) / answers.sigma[:, index]
    return np.asarray(off[claimed])


def median(values: FloatArray) -> float:
    """Median of what is finite; NaN of nothing."""
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if finite.size else math.nan


def ok_share(score: Score) -> Share:
    """Points with the status OK."""
    from estimators import Status

    return Share(score.status.get(status_name(int(Status.OK)), 0), score.points)
