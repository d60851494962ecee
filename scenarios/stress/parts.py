"""The points of a stress test as a sweep sees them, and all their results together.

One point is one estimator on one visit at one noise level with one set of effects: everything that
its values depend on, the source of the program included.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from scenarios.code import code_of
from scenarios.stress.design import Design
from scenarios.stress.plan import NONE, StressPlan
from scenarios.stress.score import COVERAGES, RAISED, Answers
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from estimators import EstimateResult
    from scenarios.stress.simulate import Taken

SOURCES = (
    "twin",
    "estimators",
    "scenarios.simulate",
    "scenarios.light_between",
    "scenarios.worlds",
    "scenarios.stress.effects",
    "scenarios.stress.light",
    "scenarios.stress.simulate",
    "scenarios.stress.world_light",
)
"""Packages and modules on whose source every result depends."""


class Setting(NamedTuple):
    """A world of the test: one bench at one noise level with one set of effects."""

    bench: str
    noise: float
    effects: str = NONE


class Case(NamedTuple):
    """What is scored together: one estimator in one setting."""

    bench: str
    noise: float
    estimator: str
    effects: str = NONE

    @property
    def setting(self) -> Setting:
        """Where the estimator was tried."""
        return Setting(self.bench, self.noise, self.effects)


@dataclass(frozen=True)
class Piece:
    """One estimator on one visit in one setting: one point of the sweep.

    Attributes:
        case: what it is scored with.
        visit: number of the visit.
        point: all that its answer depends on, as JSON holds it.
    """

    case: Case
    visit: int
    point: Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Outcome:
    """Everything a finished run knows.

    Attributes:
        plan: what was run.
        design: the points.
        answers: what every estimator said of them, in the order of the design.
        light_share: standard error of the simulated light in units of the whole standard error,
            by setting, shape (N, S, 3).
        relative_sigma: standard errors of the intensities in units of their value, likewise.
        seconds: [s] per 1000 wavelengths, median over visits, by case.
        raised: sentences about estimators that raised an exception.
    """

    plan: StressPlan
    design: Design
    answers: Mapping[Case, Answers]
    light_share: Mapping[Setting, FloatArray]
    relative_sigma: Mapping[Setting, FloatArray]
    seconds: Mapping[Case, float]
    raised: tuple[str, ...]


def light_points(plan: StressPlan, design: Design) -> list[dict[str, Any]]:
    """Every visit's light, sample by sample, as points of a sweep."""
    code = code_of(*SOURCES)
    return [
        {**visit, "sample": number, "code": code}
        for _, _, _, visit in _visits(plan, design)
        for number in range(len(plan.thickness_mm))
    ]


def pieces_of(plan: StressPlan, design: Design) -> list[Piece]:
    """Every point of a plan in the order in which it is done."""
    own = plan.model_dump(mode="json", include={"protocol", "map"})
    codes = {each.name: code_of(*SOURCES, _home(each.name)) for each in plan.estimators}
    return [
        Piece(
            Case(bench, level, contender.title, effects),
            number,
            {
                **visit,
                **own,
                "noise": level,
                "estimator": contender.name,
                "options": contender.options,
                "code": codes[contender.name],
            },
        )
        for bench, effects, number, visit in _visits(plan, design)
        for level in plan.noise
        for contender in plan.estimators
    ]


def _visits(plan: StressPlan, design: Design) -> Iterator[tuple[str, str, int, dict[str, Any]]]:
    """Bench, effects, number of the visit, and what its light depends on."""
    shared = plan.model_dump(mode="json", include={"seed", "n", "thickness_mm", "light"})
    described = plan.model_dump(mode="json", include={"benches"})["benches"]
    for bench in plan.benches:
        for effects in (NONE, *plan.effects):
            for number in range(design.visits):
                material = design.material[design.visit == number].tolist()
                own = {"visit": number, "material": material, "spectra": plan.materials.spectra}
                # A list keeps the order in which the effects happen; JSON objects are sorted.
                if effects != NONE:
                    own["effects"] = [list(pair) for pair in plan.effects[effects].items()]
                yield bench, effects, number, {"bench": described[bench], **shared, **own}


def arrays_of(result: EstimateResult, taken: Taken) -> dict[str, FloatArray]:
    """What is kept of a result and of its visit, W wavelengths first.

    Raises:
        ValueError: arrays of another shape than the protocol's.
    """
    value, sigma = taken.intensities.value, taken.intensities.sigma
    count = value.shape[-1]
    interval = np.full((len(COVERAGES), 2, count, 3), np.nan)
    for index, coverage in enumerate(COVERAGES):
        try:
            interval[index] = result.interval(coverage)
        except ValueError:  # the estimator stores no such quantiles: no interval is stated
            continue
    with np.errstate(invalid="ignore", divide="ignore"):
        relative_sigma = (sigma / np.abs(value)).transpose(2, 0, 1)
        found = {
            "value": result.parameters,
            "sigma": result.standard_error,
            "identifiable": np.asarray(result.identifiable, dtype=np.float64),
            "status": np.asarray(result.status, dtype=np.float64)[:, None],
        }
    for name, array in found.items():
        if len(array) != count or array.ndim != 2:
            raise ValueError(f"{name} of shape {array.shape} for {count} wavelengths")
    return {
        **found,
        "interval": interval.transpose(2, 0, 1, 3),
        "relative_sigma": relative_sigma,
        "light_share": taken.light_share.transpose(2, 0, 1),
    }


def outcome_of(
    plan: StressPlan,
    design: Design,
    pieces: Sequence[Piece],
    results: Iterable[Mapping[str, FloatArray] | None],
    seconds: Sequence[float],
    raised: tuple[str, ...],
) -> Outcome:
    """Everything together; a piece without a result counts as an estimator that raised.

    Args:
        plan: what was run.
        design: its points.
        pieces: from `pieces_of`.
        results: of every piece, in their order; None where its estimator raised.
        seconds: that its estimator took [s]; NaN where it is not known.
        raised: sentences about estimators that raised.
    """
    size = np.bincount(design.visit)
    shape = (len(plan.thickness_mm), 3)
    tables: dict[Case, list[Mapping[str, FloatArray]]] = {}
    rates: dict[Case, list[float]] = {}
    for piece, found, time in zip(pieces, results, seconds, strict=True):
        count = int(size[piece.visit])
        own = _nothing(count, shape) if found is None else found
        tables.setdefault(piece.case, []).append(own)
        if found is not None:
            rates.setdefault(piece.case, []).append(time / count)
    answers: dict[Case, Answers] = {}
    share: dict[Setting, FloatArray] = {}
    sigma: dict[Setting, FloatArray] = {}
    for case, whole in tables.items():
        table = {name: np.concatenate([one[name] for one in whole]) for name in whole[0]}
        answers[case] = Answers(
            value=table["value"],
            sigma=table["sigma"],
            interval=table["interval"].transpose(1, 2, 0, 3),
            identifiable=table["identifiable"] > 0,
            status=table["status"][:, 0].astype(np.int64),
        )
        for target, name in ((share, "light_share"), (sigma, "relative_sigma")):
            if case.setting not in target or np.isnan(target[case.setting]).all():
                target[case.setting] = table[name]
    median = {
        case: 1000.0 * float(np.median(rates[case])) if case in rates else float("nan")
        for case in tables
    }
    return Outcome(plan, design, answers, share, sigma, median, raised)


def _nothing(count: int, shape: tuple[int, int]) -> dict[str, FloatArray]:
    """The answer of an estimator that raised."""
    return {
        "value": np.full((count, 3), np.nan),
        "sigma": np.full((count, 3), np.nan),
        "identifiable": np.zeros((count, 3)),
        "status": np.full((count, 1), float(RAISED)),
        "interval": np.full((count, len(COVERAGES), 2, 3), np.nan),
        "light_share": np.full((count, *shape), np.nan),
        "relative_sigma": np.full((count, *shape), np.nan),
    }


def _home(name: str) -> str:
    """The top-level package of an estimator."""
    from importlib.metadata import entry_points

    from estimators.registry import GROUP

    for point in entry_points(group=GROUP):
        if point.name == name:
            return point.value.partition(":")[0].partition(".")[0]
    return "estimators"
