"""What each method answers, in one form, so that all are judged alike."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from scenarios.blind.baselines import QUANTILE
from scenarios.blind.suite import VISIBLE

METHODS = ("diagnosis", "chance", "template", "greedy")
NAMED = ("effect", "pair", "group")
"""Verdicts that name effects."""
UNKNOWN = "none of these"


@dataclass(frozen=True)
class Record:
    """One measurement after the opening.

    Attributes:
        number: of the measurement.
        label: what was sealed.
        outcome: what the diagnosis said.
    """

    number: int
    label: Mapping[str, Any]
    outcome: Mapping[str, Any]

    @property
    def arm(self) -> str:
        """One of `ARMS`."""
        return str(self.label["arm"])

    @property
    def effects(self) -> Sequence[Mapping[str, Any]]:
        """What is wrong with the measurement."""
        found: Sequence[Mapping[str, Any]] = self.label["effects"]
        return found

    @property
    def truth(self) -> tuple[str, ...]:
        """Names of its effects."""
        return tuple(each["name"] for each in self.effects)

    @property
    def alike(self) -> tuple[str, ...]:
        """What its only effect may be taken for, itself first."""
        return tuple(self.effects[0]["alike"]) or self.truth

    @property
    def visibility(self) -> float:
        """Of the faintest effect [sigma]; 0 without one."""
        return min((float(each["visibility"]) for each in self.effects), default=0.0)

    @property
    def visible_pair(self) -> bool:
        """Whether two effects are each seen beside the other."""
        loud = all(each["visibility"] >= VISIBLE for each in self.effects)
        return len(self.effects) == 2 and loud and bool(self.label["apart"] >= VISIBLE)

    @property
    def stranger(self) -> bool:
        """Whether something is wrong that the diagnosis has no entry for."""
        return self.arm in ("outside", "removed") and bool(self.effects)


@dataclass(frozen=True)
class Answer:
    """An answer; each "right" is a probability, since chance is right by halves.

    Attributes:
        gap: probability that a gap is claimed.
        effects: named, the leading one first.
        sets: effects of the credible set.
        leading: effects of the leading set.
        unknown: whether the catalogue is refused.
        intervals: by name, of every parameter's deviation from nominal.
        candidates: number of them for a method that draws one; 0 for the others.
    """

    gap: float
    effects: tuple[str, ...] = ()
    sets: tuple[str, ...] = ()
    leading: tuple[str, ...] = ()
    unknown: bool = False
    intervals: Mapping[str, Sequence[tuple[float, float]]] = field(default_factory=dict)
    candidates: int = 0

    def first_in(self, names: Sequence[str]) -> float:
        """Whether the leading effect is one of these."""
        if self.candidates:
            return self.gap * len(names) / self.candidates
        return float(bool(self.effects) and self.effects[0] in names)

    def holds(self, name: str) -> float:
        """Whether the credible set holds an effect."""
        return self.gap / self.candidates if self.candidates else float(name in self.sets)

    def holds_leading(self, name: str) -> bool:
        """Whether the leading set holds an effect."""
        return name in self.leading

    def both(self, names: Sequence[str]) -> float:
        """Whether the leading set holds all of these."""
        if self.candidates:
            return self.gap * 2.0 / (self.candidates * (self.candidates - 1))
        return float(all(name in self.leading for name in names))

    def both_alike(self, groups: Sequence[Sequence[str]]) -> float:
        """Whether the leading set holds one of every group."""
        if self.candidates:
            return min(1.0, self.both(()) * len(groups[0]) * len(groups[1]))
        return float(all(any(name in self.leading for name in group) for group in groups))

    def unknown_or(self, names: Sequence[str]) -> float:
        """Whether the catalogue is refused, or the leading effect is one of these."""
        if self.candidates:
            return self.gap * (1 + len(names)) / (self.candidates + 1)
        return float(self.unknown or self.first_in(names))


def answer_of(record: Record, method: str) -> Answer:
    """What a method said of a measurement."""
    outcome = record.outcome
    if method == "chance":
        return Answer(0.5, candidates=max(2, len(outcome["candidates"])))
    if method == "diagnosis":
        return Answer(
            gap=float(outcome["verdict"] != "no_gap"),
            effects=effects_of(record),
            sets=() if outcome["verdict"] == "no_gap" else tuple(outcome["credible_set"]),
            leading=() if outcome["verdict"] == "no_gap" else tuple(outcome["leading_set"]),
            unknown=outcome["verdict"] == "none_of_these",
            intervals={
                each["name"]: [tuple(p["interval"]) for p in each["parameters"]]
                for each in outcome["effects"]
            },
        )
    found = outcome.get("baselines", {}).get(method)
    if found is None:
        return Answer(0.0)
    named = () if found["unknown"] or not found["gap"] else tuple(found["effects"])
    return Answer(
        gap=float(found["gap"]),
        effects=named,
        sets=named[:1],
        leading=named,
        unknown=bool(found["unknown"]),
        intervals={
            name: [(v - QUANTILE * sd, v + QUANTILE * sd) for v, sd in zip(*pair, strict=True)]
            for name, pair in found.get("values", {}).items()
        },
    )


def effects_of(record: Record) -> tuple[str, ...]:
    """The effects that the diagnosis names, the most probable first."""
    if record.outcome["verdict"] not in NAMED:
        return ()
    return tuple(each["name"] for each in record.outcome["effects"][:2])
