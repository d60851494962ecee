"""A design study from goal to answer: search, what limits, what money buys, verification."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from scenarios.console import Console
from scenarios.design.candidate import NEEDED, Candidate
from scenarios.design.goal import Goal
from scenarios.design.parts import ESTIMATE, Parts
from scenarios.design.predictor import Predictor, TranslucentPredictor
from scenarios.design.robust import Robustness, robustness
from scenarios.design.search import Found, search
from scenarios.design.verified import PARAMETERS, Verified, meets
from scenarios.design.verify import verify
from scenarios.design.wording import verdict
from scenarios.sweep import Workers
from twin.errors import InputError


@dataclass(frozen=True, eq=False)
class Study:
    """What a study found.

    Attributes:
        goal, parts: what was asked.
        found: the candidates that were looked at.
        compared: assemblies beside them: name, candidate, figures.
        limits: of the answer, by target, input and share.
        verified: candidates simulated in full.
        robust: what the catalogue's effects would do to candidates.
    """

    goal: Goal
    parts: Parts
    found: Found
    compared: tuple[tuple[str, Candidate, tuple[float, ...]], ...]
    limits: dict[str, dict[str, float]]
    verified: tuple[Verified, ...] = ()
    robust: tuple[Robustness, ...] = ()

    @property
    def answer(self) -> int:
        """Number of the cheapest candidate that meets all targets, else of the most accurate."""
        cheapest = self.found.cheapest
        return self.found.best if cheapest is None else cheapest

    @property
    def reached(self) -> bool:
        """Whether a candidate meets all targets."""
        return self.found.cheapest is not None

    @property
    def simulated_answer(self) -> Verified | None:
        """The simulation of the answer; None: there is none."""
        own = self.found.candidates[self.answer]
        return next((each for each in self.verified if each.candidate == own), None)

    @property
    def meets_in_simulation(self) -> str:
        """Whether the answer's simulated figures meet the targets: `in_simulation`."""
        own = self.simulated_answer
        return "not simulated" if own is None else self.in_simulation(own)

    @property
    def confirmed(self) -> Verified | None:
        """The cheapest candidate whose simulation meets the targets; None: there is none."""
        good = [each for each in self.verified if self.in_simulation(each) == "yes"]
        return min(good, key=lambda each: each.candidate.price(self.parts), default=None)

    def in_simulation(self, each: Verified) -> str:
        """Whether a candidate's simulated figures meet the targets.

        Returns:
            "yes"; "no"; "open": a figure is above its target by less than twice its standard error,
            or nothing that has a target is simulated ("de2000"); or "failed".
        """
        if each.failure:
            return "failed"
        if not each.figures:
            return "open"
        said = {
            meets(value, error, getattr(self.goal.targets, name))
            for name, (value, error) in each.figures.items()
        }
        return next(state for state in ("no", "open", "yes") if state in said)

    def verdict(self) -> str:
        """The answer, whether its simulation confirms it, and what it is made of."""
        return verdict(self)

    def as_json(self) -> dict[str, Any]:
        """Everything that the report shows; each candidate reproducible."""
        found, parts = self.found, self.parts
        answer = self.answer
        return {
            "title": self.goal.title,
            "verdict": self.verdict(),
            "reached": self.reached,
            "meets_targets_in_simulation": self.meets_in_simulation,
            "search": {
                "method": found.method, "complete": found.complete,
                "candidates": len(found.candidates),
            },
            "targets": dict(
                zip(self.goal.targets.names, self.goal.targets.values.tolist(), strict=True)
            ),
            "answer": self._row(answer),
            "limits": self.limits,
            "front": [self._row(number) for number in found.front],
            "greedy": [self._row(number) for number in found.path],
            "compared": [
                {
                    "name": name, "price_usd": own.price(parts), "text": own.text,
                    "figures": dict(zip(self.goal.targets.names, figures, strict=True)),
                }
                for name, own, figures in self.compared
            ],
            "verified": [self._verified_row(each) for each in self.verified],
            "robust": [each.as_json(parts) for each in self.robust],
            "estimated_prices": [
                part.name for part in found.candidates[answer].chosen(parts)
                if part.price_source.startswith(ESTIMATE)
            ],
        }  # fmt: skip

    def _row(self, number: int) -> dict[str, Any]:
        own = self.found.candidates[number]
        names = self.goal.targets.names
        return {
            "id": own.id(self.parts),
            "price_usd": float(self.found.price_usd[number]),
            "score": float(self.found.score[number]),
            "figures": dict(zip(names, self.found.figures[number].tolist(), strict=True)),
            "parts": list(own.parts),
            "thickness_mm": list(own.thickness_mm),
            "averages": own.averages,
            "repeats": own.repeats,
            "acceptance_deg": own.acceptance_deg,
            "polar_deg": own.polar_deg,
            "leds": own.leds,
        }

    def _verified_row(self, each: Verified) -> dict[str, Any]:
        parts = self.parts
        row: dict[str, Any] = {
            "id": each.candidate.id(parts), "price_usd": each.candidate.price(parts),
        }  # fmt: skip
        if each.failure:
            return {**row, "failure": each.failure}
        for name, values in (
            ("ratio", each.ratio), ("ratio_error", each.ratio_error), ("bias", each.bias),
            ("width_ratio", each.width_ratio),
        ):  # fmt: skip
            row[name] = dict(zip(PARAMETERS, values.tolist(), strict=True))
        figures = {
            name: {"simulated": value, "standard_error": error}
            for name, (value, error) in each.figures.items()
        }
        return {
            **row, "agrees": each.agrees, "figures": figures,
            "meets_targets": self.in_simulation(each),
        }  # fmt: skip


def study(
    goal: Goal,
    parts: Parts,
    *,
    folder: Path | None = None,
    predictor: Predictor | None = None,
    workers: Workers | None = None,
    console: Console | None = None,
) -> Study:
    """Search, explain, simulate.

    Args:
        goal: what is asked.
        parts: all parts.
        folder: of the simulations' ledger; None: nothing is simulated.
        predictor: of the figures; None: the one of the goal's materials.
        workers: who simulates; None: this process.
        console: is told how far it is.

    Raises:
        InputError: see `search` and `verify`.
    """
    console = console or Console(quiet=True)
    predictor = predictor or predictor_of(goal, parts)
    found = search(goal, parts, predictor, console)
    number = found.best if found.cheapest is None else found.cheapest
    compared = []
    for name in goal.compare:
        own = compared_candidate(name, goal, parts)
        figures = predictor.predict([own])[0]
        compared.append((name, own, tuple(float(each) for each in figures)))
    limits = predictor.limits(found.candidates[number])
    verified: Sequence[Verified] = ()
    robust: Sequence[Robustness] = ()
    if isinstance(predictor, TranslucentPredictor):
        leading = leaders(found, number, goal.verification.candidates)
        chosen = [found.candidates[each] for each in leading]
        with console.step("robustness against the catalogue") as progress:
            rows = []
            for count, each in enumerate(chosen or [found.candidates[number]], 1):
                rows.append(robustness(predictor, each))
                progress(count, max(len(chosen), 1))
            robust = rows
        if folder is not None and chosen:
            verified = verify(goal, predictor, chosen, folder, workers=workers, console=console)
    return Study(goal, parts, found, tuple(compared), limits, tuple(verified), tuple(robust))


def leaders(found: Found, answer: int, count: int) -> list[int]:
    """The answer, and candidates spread over the Pareto front."""
    front = [number for number in found.front if number != answer]
    if count <= 0:
        return []
    places = np.unique(np.linspace(0, len(front) - 1, min(count - 1, len(front))).astype(int))
    return [answer, *(front[place] for place in places)] if front else [answer]


def predictor_of(goal: Goal, parts: Parts) -> Predictor:
    """The predictor of a goal's materials.

    Raises:
        InputError: fluorescent materials where nothing predicts them.
    """
    if not goal.targets.fluorescent:
        return TranslucentPredictor(goal, parts)
    from scenarios.design.fluorescent_goal import FluorescentPredictor

    return FluorescentPredictor(goal, parts)


def compared_candidate(name: str, goal: Goal, parts: Parts) -> Candidate:
    """An assembly with the goal's best protocol.

    Raises:
        InputError: an assembly that lacks a kind of part.
    """
    assembly = parts.assembly(name)
    kinds: dict[str, str] = {parts.part(each).kind: each for each in assembly.parts}
    needed = NEEDED[goal.targets.fluorescent]
    missing = [kind for kind in needed if kind not in kinds]
    if missing:
        raise InputError(
            f"the assembly {name!r} without {', '.join(missing)}", f"one of each of {needed}",
            place="compare",
        )  # fmt: skip
    ranges = goal.protocol
    chosen = tuple(kinds[kind] for kind in needed)
    if goal.targets.fluorescent:
        return Candidate(chosen, averages=ranges.averages[-1], repeats=ranges.repeats[-1],
                         leds=ranges.leds[-1])  # fmt: skip
    thick = ranges.thickness_mm
    places = np.linspace(0, len(thick) - 1, max(ranges.samples)).round().astype(int)
    return Candidate(
        chosen, tuple(thick[p] for p in places), ranges.averages[-1], ranges.repeats[-1],
        ranges.acceptance_deg[0], ranges.polar_deg[0],
    )  # fmt: skip
