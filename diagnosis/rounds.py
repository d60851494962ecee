"""Several rounds: accept the leading effect into the bench's description, and diagnose again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from diagnosis.attribution import PriorOdds
from diagnosis.diagnose import ALPHA, diagnose
from diagnosis.problem import Channel, Problem
from diagnosis.proposals import with_proposals
from diagnosis.screening import NotIdentifiable
from diagnosis.translucent import NAMES, TranslucentCase, translucent_case
from diagnosis.verdict import Diagnosis
from twin.bench import Bench
from twin.effects import Catalogue, EffectEngine, LeftOut, World, accept, catalogue
from twin.errors import InputError
from twin.measurement import Measurement, observations

if TYPE_CHECKING:
    from estimators.map_grid import Map

ACCEPTED = ("effect", "pair", "group")
"""Verdicts whose leading effects are accepted."""

Step = Callable[[str], AbstractContextManager[Callable[[float, float], None]]]
"""Opens a piece of work by its name and yields what is told (done, total)."""


def _silent_step(text: str) -> AbstractContextManager[Callable[[float, float], None]]:
    def silent(done: float, total: float) -> None:
        return None

    return nullcontext(silent)


def _silent(text: str) -> None:
    """Say nothing."""


@dataclass(frozen=True)
class Accepted:
    """An effect that was taken into the description.

    Attributes:
        name: of the candidate.
        title: in plain words.
        values: of its parameters, nominal value included.
        uncertainty: standard errors.
        look_alikes: effects that the data do not tell from it.
    """

    name: str
    title: str
    values: tuple[float, ...]
    uncertainty: tuple[float, ...]
    look_alikes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Round:
    """One diagnosis, and what was accepted after it.

    Attributes:
        bench: the description that was diagnosed.
        case: the problem and what it was made of.
        diagnosis: the verdict.
        accepted: effects that the next description has on top.
    """

    bench: Bench
    case: TranslucentCase
    diagnosis: Diagnosis
    accepted: tuple[Accepted, ...] = ()

    @property
    def chi_square(self) -> tuple[float, float]:
        """Of all data about the description as it is, and its expectation; NaN unknown."""
        null = self.diagnosis.null
        if null is None:
            return float("nan"), float("nan")
        return null.chi_square, float(null.reduction.freedom)

    @property
    def excess(self) -> tuple[float, float] | None:
        """Excess before and after this round's effects, on data that did not choose them."""
        found = self.diagnosis.closure
        return None if found is None else (found.before, found.after)


@dataclass(frozen=True, eq=False)
class Rounds:
    """The whole path.

    Attributes:
        rounds: one at least.
        bench: the description with all accepted effects.
        stopped: why there was no further round.
    """

    rounds: tuple[Round, ...]
    bench: Bench
    stopped: str

    @property
    def first(self) -> Round:
        """The diagnosis of the description as it was given."""
        return self.rounds[0]

    @property
    def last(self) -> Round:
        """The last one."""
        return self.rounds[-1]

    @property
    def accepted(self) -> tuple[Accepted, ...]:
        """All that was accepted, in order."""
        return tuple(each for one in self.rounds for each in one.accepted)

    @property
    def left_out(self) -> tuple[LeftOut, ...]:
        """Entries of the catalogue that a round could not use, as the first such round says."""
        found: dict[str, LeftOut] = {}
        for number, one in enumerate(self.rounds, start=1):
            for each in one.case.left_out:
                reason = each.reason if number == 1 else f"in round {number}: {each.reason}"
                found.setdefault(each.name, LeftOut(each.name, reason))
        return tuple(found.values())


def diagnose_rounds(
    measurement: Measurement,
    *,
    most: int = 1,
    effects: Catalogue | None = None,
    maps: Sequence[Map] = (),
    folder: Path | None = None,
    threads: int | None = None,
    paths: int = 8192,
    odds: PriorOdds | None = None,
    alpha: float = ALPHA,
    seed: int = 0,
    proposals: bool = True,
    say: Callable[[str], None] = _silent,
    step: Step = _silent_step,
) -> Rounds:
    """Diagnose a visit, accept what leads, and again, until nothing significant is left.

    Accepted effects are kept in `Bench.effects`, with value and standard error: the maps of the
    bench and the cached responses serve every round, and one file holds the result.

    Args:
        measurement: the visit.
        most: diagnoses, at most.
        effects: the catalogue; None takes ours and what is installed.
        maps: appearance maps of the samples.
        folder: of the cached responses.
        threads: of the Monte Carlo.
        paths: of its responses.
        odds: prior probabilities.
        alpha: probability of a false alarm, in every round.
        seed: of the simulations.
        proposals: also work out what to measure next, in the first round.
        say: told of what a person should know.
        step: opens a piece of work.

    Raises:
        InputError: the visit cannot be used, or `most` is below 1.
    """
    if most < 1:
        raise InputError(f"{most} rounds", "1 or more", place="rounds")
    if one_thickness(measurement):
        return _nothing_can_show(measurement, effects or catalogue(), seed)
    bench, stopped = measurement.bench, f"the number of rounds that was asked for ({most})"
    rounds: list[Round] = []
    for number in range(most):
        visit = replace(measurement, bench=bench)
        label = "" if most == 1 else f"round {number + 1}: "
        with step(f"{label}signatures of the effects") as progress:
            case = translucent_case(
                visit, effects=effects, maps=maps, folder=folder, threads=threads, paths=paths,
                say=say if number == 0 else _silent, progress=progress,
            )  # fmt: skip
        if rounds:
            # what the first round left out has been said; material and bench differ from its
            known = {each.name for one in rounds for each in one.case.left_out}
            for each in case.left_out:
                if each.name not in known:
                    say(f"left out in round {number + 1}: {each.name}: {each.reason}")
        with step(f"{label}diagnosis"):
            found = diagnose(case.problem, odds=odds, alpha=alpha, seed=seed)
        if proposals and number == 0:
            with step("what to measure next"):
                found = with_proposals(case, visit, found)
        accepted: tuple[Accepted, ...] = ()
        after = bench
        if found.verdict in ACCEPTED and found.best is not None and found.best.hypothesis:
            after, accepted = _accept(visit, case, found)
        rounds.append(Round(bench, case, found, accepted))
        bench = after
        if not accepted:
            stopped = f"the verdict {found.verdict.replace('_', ' ')}"
            break
    return Rounds(tuple(rounds), bench, stopped)


def one_thickness(measurement: Measurement) -> bool:
    """Whether all samples are equally thick, so that three unknowns fit anything."""
    return len({round(sample.thickness_mm, 9) for sample in measurement.samples}) < 2


def _nothing_can_show(measurement: Measurement, effects: Catalogue, seed: int) -> Rounds:
    """The verdict where no gap can show: nothing is fitted, no effect is evaluated."""
    data = observations(measurement)
    world = World.nominal(measurement.bench, measurement.samples)
    suspects, left_out = effects.candidates(world)
    value = np.where(data.valid, data.value, 0.0)
    wavelengths = len(data.wavelength_nm)
    problem = Problem(
        wavelength_nm=data.wavelength_nm,
        channels=tuple(Channel(row.capture, row.sample, row.repeat) for row in data.rows),
        value=value,
        valid=data.valid,
        independent=data.independent,
        common=data.common,
        material=np.zeros((wavelengths, len(NAMES))),
        forward=lambda material, values: value,
        jacobian=lambda material, values: np.zeros((*value.shape, len(NAMES))),
        signatures=np.empty((0, *value.shape)),
        candidates=(),
        thickness_mm={sample.name: sample.thickness_mm for sample in measurement.samples},
        material_names=NAMES,
    )
    engine = EffectEngine(world, data.wavelength_nm)
    case = TranslucentCase(problem, engine, suspects, left_out, data.reasons)
    hidden = tuple(
        NotIdentifiable(each.name, "no gap can show in these data", float("nan"))
        for each in suspects
    )
    found = replace(diagnose(problem, seed=seed), not_identifiable=hidden)
    only = Round(measurement.bench, case, found)
    return Rounds((only,), measurement.bench, f"the verdict {found.verdict.replace('_', ' ')}")


def _accept(
    visit: Measurement, case: TranslucentCase, found: Diagnosis
) -> tuple[Bench, tuple[Accepted, ...]]:
    """The description with the leading effects of a diagnosis."""
    best = found.best
    if best is None:
        return visit.bench, ()
    sd = np.sqrt(np.diag(best.covariance))
    own = {candidate.name: candidate for candidate in case.problem.candidates}
    suspects = {suspect.name: suspect for suspect in case.suspects}
    bench, start = visit.bench, 0
    accepted = []
    for name, away in best.values.items():
        suspect = suspects[name]
        before = next((e.values for e in bench.effects if e.name == name), suspect.nominal)
        values = tuple(float(v) for v in np.array(before) + away)
        span = slice(start, start + len(away))
        error = own[name].with_response_error(
            best.value[span], sd[span], case.problem.response_error
        )
        errors = tuple(float(v) for v in own[name].physical_sd(best.value[span], error))
        start = span.stop
        bench, _ = accept(bench, visit.samples, suspect, values, errors, plain=False)
        alike = dict.fromkeys(n for g in found.groups if name in g for n in g if n != name)
        accepted.append(Accepted(name, suspect.title, values, errors, tuple(alike)))
    return bench, tuple(accepted)
