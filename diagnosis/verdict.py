"""The verdict as numbers: what a report, a JSON file and the blind check are written from."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from diagnosis.adequacy import Adequacy
from diagnosis.attribution import Posterior
from diagnosis.closure import Closure
from diagnosis.groups import Separations
from diagnosis.next_capture import NextCapture
from diagnosis.refit import Fit
from diagnosis.screening import NotIdentifiable
from diagnosis.where import Block, Entry
from twin.spectra import FloatArray

Verdict = Literal["no_gap", "effect", "pair", "group", "none_of_these", "cannot_tell"]


@dataclass(frozen=True)
class ParameterValue:
    """One number of an effect.

    Attributes:
        name: of the parameter.
        unit: its unit.
        value: deviation from nominal.
        sd: standard error.
        interval: of 90 %, within the parameter's bounds.
    """

    name: str
    unit: str
    value: float
    sd: float
    interval: tuple[float, float]


@dataclass(frozen=True)
class RankedEffect:
    """A candidate with its probability.

    Attributes:
        name: of the candidate.
        probability: that it is at work, alone or with another.
        parameters: fitted under the most probable hypothesis that holds it.
        refitted: whether by the nonlinear fit; else by the linear model.
        disagreement: of refit and linear model, relative; above 0.2 it is worth saying.
        adjusted_p: family-wise p of the effect alone against none.
        strength: standard deviations it moves the reduced data by at these values.
    """

    name: str
    probability: float
    parameters: tuple[ParameterValue, ...]
    refitted: bool
    disagreement: float
    adjusted_p: float
    strength: float


@dataclass(frozen=True, eq=False)
class ParameterShift:
    """What the gap does to the material's estimate.

    Attributes:
        names: of the P coordinates.
        shift: with the effects less without, in coordinates of the fit, (W, P).
        sd: standard error of the coordinates without effects, (W, P).
        rms_sd: root mean square of shift over sd, by coordinate.
    """

    names: tuple[str, ...]
    shift: FloatArray
    sd: FloatArray
    rms_sd: tuple[float, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class Diagnosis:
    """What the data say about the gap; see `diagnose`.

    Attributes:
        verdict: one of six.
        reason: in a sentence.
        p: family-wise probability of such data without any effect.
        effects: all that can be seen, the most probable first; probabilities given a gap unless
            the verdict is no_gap.
        leading: names of the most probable set of effects.
        credible_set: names, smallest set that holds an effect at work with 90 %; "none of these"
            may be one.
        leading_set: names of the effects of the most probable hypothesis and of all hypotheses
            within the 90 % of those of its size.
        no_gap_probability: posterior probability of no effect.
        unknown_probability: that something outside the catalogue is at work.
        groups: names of effects that these data cannot tell apart at the fitted size.
        where: blocks in which the gap shows.
        enters: what leaving blocks out does.
        closure: how far the gap shrinks, or none without one.
        parameter_shift: of the material, or none.
        next_measurement: proposals, best first.
        not_identifiable: candidates that cannot be judged.
        adequacy: of the leading effects; of no effect where there is no gap.
        prior_dependent: "" or how the verdict changes with a smoothness prior of the material.
        separations: between all candidates at 3 prior scales.
        names: all candidates that were scored, in the order of `separations`.
        null: the fit without effects.
        best: the fit with the leading ones.
        posterior: of everything.
    """

    verdict: Verdict
    reason: str
    p: float = math.nan
    effects: tuple[RankedEffect, ...] = ()
    leading: tuple[str, ...] = ()
    credible_set: tuple[str, ...] = ()
    leading_set: tuple[str, ...] = ()
    no_gap_probability: float = math.nan
    unknown_probability: float = math.nan
    groups: tuple[tuple[str, ...], ...] = ()
    where: tuple[Block, ...] = ()
    enters: tuple[Entry, ...] = ()
    closure: Closure | None = None
    parameter_shift: ParameterShift | None = None
    next_measurement: tuple[NextCapture, ...] = ()
    not_identifiable: tuple[NotIdentifiable, ...] = ()
    adequacy: Adequacy | None = None
    prior_dependent: str = ""
    separations: Separations | None = None
    names: tuple[str, ...] = ()
    null: Fit | None = None
    best: Fit | None = None
    posterior: Posterior | None = None

    def as_json(self) -> dict[str, object]:
        """The keys of the JSON file; numbers that do not exist are None."""
        return {
            "verdict": self.verdict,
            "reason": self.reason,
            "p": _number(self.p),
            "no_gap_probability": _number(self.no_gap_probability),
            "unknown_probability": _number(self.unknown_probability),
            "effects": [
                {
                    "name": e.name,
                    "probability": _number(e.probability),
                    "parameters": [
                        {
                            "name": v.name,
                            "unit": v.unit,
                            "value": _number(v.value),
                            "sd": _number(v.sd),
                            "interval": [_number(end) for end in v.interval],
                        }
                        for v in e.parameters
                    ],
                    "refitted": e.refitted,
                    "disagreement": _number(e.disagreement),
                    "adjusted_p": _number(e.adjusted_p),
                    "strength": _number(e.strength),
                }
                for e in self.effects
            ],
            "leading": list(self.leading),
            "credible_set": list(self.credible_set),
            "leading_set": list(self.leading_set),
            "groups": [list(group) for group in self.groups],
            "where": [
                {
                    "captures": list(b.captures),
                    "samples": list(b.samples),
                    "band_nm": None if b.band_nm is None else list(b.band_nm),
                    "repeat": b.repeat,
                    "statistic": _number(b.statistic),
                    "p": _number(b.p),
                }
                for b in self.where
            ],
            "enters": [
                {
                    "captures": list(e.captures),
                    "samples": list(e.samples),
                    "repeat": e.repeat,
                    "missed_p": _number(e.missed),
                    "rest_p": _number(e.rest),
                    "healed": _number(e.healed),
                    "heals": e.heals,
                }
                for e in self.enters
            ],
            "closure": None if self.closure is None else _closure(self.closure),
            "parameter_shift": None if self.parameter_shift is None else {
                name: {
                    "rms_sd": _number(self.parameter_shift.rms_sd[i]),
                    "shift": [_number(x) for x in self.parameter_shift.shift[:, i]],
                }
                for i, name in enumerate(self.parameter_shift.names)
            },
            "next_measurement": [
                {
                    "name": n.name,
                    "cost": _number(n.cost),
                    "separation": _number(n.separation),
                    "now": _number(n.now),
                    "enough": n.enough,
                }
                for n in self.next_measurement
            ],
            "not_identifiable": [
                {"name": n.name, "reason": n.reason, "strength": _number(n.strength)}
                for n in self.not_identifiable
            ],
            "prior_dependent": self.prior_dependent,
        }  # fmt: skip


def _closure(found: Closure) -> dict[str, object]:
    return {
        "value": _number(found.value),
        "interval": [_number(end) for end in found.interval],
        "before": _number(found.before),
        "after": _number(found.after),
        "noise_floor": _number(found.noise_floor),
        "oracle_floor": _number(found.oracle_floor),
        "by_repeats": None if found.by_repeats is None else list(found.by_repeats),
    }


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
