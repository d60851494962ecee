"""The finished parts of a stress test: their keys, how they are stored, and all of them together.

One part is one estimator on one visit at one noise level: a file of arrays under a content key of
everything that its values depend on, the source of the program included.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from scenarios.code import code_of
from scenarios.stress.design import Design
from scenarios.stress.plan import Contender, StressPlan
from scenarios.stress.score import COVERAGES, RAISED, Answers
from twin.cache import content_key, load_arrays, store_arrays
from twin.files import write_atomically
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from estimators import EstimateResult
    from scenarios.stress.simulate import Taken

CHUNK_VERSION = 1
SOURCES = ("twin", "estimators", "scenarios.simulate", "scenarios.stress.simulate")
"""Packages and modules on whose source every part depends."""


class Case(NamedTuple):
    """What is scored together: one estimator on one bench at one noise level."""

    bench: str
    noise: float
    estimator: str


@dataclass(frozen=True)
class Chunk:
    """One estimator on one visit at one noise level: what is stored as one file."""

    case: Case
    contender: Contender
    visit: int
    path: Path


@dataclass(frozen=True, eq=False)
class Outcome:
    """Everything a finished run knows.

    Attributes:
        plan: what was run.
        design: the points.
        answers: what every estimator said of them, in the order of the design.
        light_share: standard error of the simulated light in units of the whole standard error,
            by bench and noise level, shape (N, S, 3).
        relative_sigma: standard errors of the intensities in units of their value, likewise.
        seconds: [s] per 1000 wavelengths, median over visits, by case.
        raised: sentences about estimators that raised an exception.
    """

    plan: StressPlan
    design: Design
    answers: Mapping[Case, Answers]
    light_share: Mapping[tuple[str, float], FloatArray]
    relative_sigma: Mapping[tuple[str, float], FloatArray]
    seconds: Mapping[Case, float]
    raised: tuple[str, ...]


def chunks_of(plan: StressPlan, design: Design, parts: Path) -> Iterator[Chunk]:
    """Every part of a plan in the order in which it is done, each with its path in `parts`."""
    for bench_name, bench in plan.benches.items():
        shared = {
            "version": CHUNK_VERSION,
            "bench": bench.model_dump(mode="json"),
            **plan.model_dump(
                mode="json", include={"seed", "n", "thickness_mm", "protocol", "light", "map"}
            ),
        }
        for visit in range(design.visits):
            material = design.material[design.visit == visit].tolist()
            for level in plan.noise:
                for contender in plan.estimators:
                    own = {
                        "visit": visit,
                        "material": material,
                        "spectra": plan.materials.spectra,
                        "noise": level,
                        "estimator": contender.name,
                        "options": contender.options,
                        "code": code_of(*SOURCES, _home(contender.name)),
                    }
                    key = content_key(shared | own)
                    case = Case(bench_name, level, contender.title)
                    yield Chunk(case, contender, visit, parts / f"{key}.part")


def store_part(path: Path, arrays: Mapping[str, FloatArray], taken: Taken, seconds: float) -> None:
    """Store what is kept of a result and of its visit, and beside it the time [s] it took.

    Args:
        path: of the part.
        arrays: from `arrays_of`, W wavelengths first: shape (W, ...).
        taken: the visit.
        seconds: what the estimator took.

    Raises:
        InputError: the folder cannot be written.
    """
    arrays = dict(arrays)
    value, sigma = taken.intensities.value, taken.intensities.sigma
    with np.errstate(invalid="ignore", divide="ignore"):
        arrays["relative_sigma"] = (sigma / np.abs(value)).transpose(2, 0, 1)
    arrays["light_share"] = taken.light_share.transpose(2, 0, 1)
    # The time first: a part that is there has its time.
    write_atomically(_time_path(path), f'{{"seconds": {seconds:.6f}}}\n'.encode())
    store_arrays(path, arrays)


def arrays_of(result: EstimateResult, count: int) -> dict[str, FloatArray]:
    """What is kept of a result, W wavelengths first.

    Raises:
        ValueError: arrays of another shape than the protocol's.
    """
    interval = np.full((len(COVERAGES), 2, count, 3), np.nan)
    for index, coverage in enumerate(COVERAGES):
        try:
            interval[index] = result.interval(coverage)
        except ValueError:  # the estimator stores no such quantiles: no interval is stated
            continue
    with np.errstate(invalid="ignore"):
        found = {
            "value": result.parameters,
            "sigma": result.standard_error,
            "identifiable": np.asarray(result.identifiable, dtype=np.float64),
            "status": np.asarray(result.status, dtype=np.float64)[:, None],
        }
    for name, array in found.items():
        if len(array) != count or array.ndim != 2:
            raise ValueError(f"{name} of shape {array.shape} for {count} wavelengths")
    return {**found, "interval": interval.transpose(2, 0, 1, 3)}


def outcome_of(
    plan: StressPlan, design: Design, chunks: list[Chunk], raised: tuple[str, ...]
) -> Outcome:
    """Everything together; a part that is not there counts as an estimator that raised."""
    answers: dict[Case, Answers] = {}
    share: dict[tuple[str, float], FloatArray] = {}
    sigma: dict[tuple[str, float], FloatArray] = {}
    seconds: dict[Case, float] = {}
    by_case: dict[Case, list[Chunk]] = {}
    for chunk in chunks:
        by_case.setdefault(chunk.case, []).append(chunk)
    shape = (len(plan.thickness_mm), 3)
    for case, mine in by_case.items():
        size = [int((design.visit == chunk.visit).sum()) for chunk in mine]
        loaded = [load_arrays(chunk.path, lambda text: None) for chunk in mine]
        whole = [
            found if found is not None else _nothing(count, shape)
            for found, count in zip(loaded, size, strict=True)
        ]
        table = {name: np.concatenate([one[name] for one in whole]) for name in whole[0]}
        answers[case] = Answers(
            value=table["value"],
            sigma=table["sigma"],
            interval=table["interval"].transpose(1, 2, 0, 3),
            identifiable=table["identifiable"] > 0,
            status=table["status"][:, 0].astype(np.int64),
        )
        world = (case.bench, case.noise)
        for target, name in ((share, "light_share"), (sigma, "relative_sigma")):
            if world not in target or np.isnan(target[world]).all():
                target[world] = table[name]
        rates = [
            _seconds(chunk.path) / count
            for chunk, count, found in zip(mine, size, loaded, strict=True)
            if found is not None
        ]
        seconds[case] = 1000.0 * float(np.median(rates)) if rates else float("nan")
    return Outcome(plan, design, answers, share, sigma, seconds, raised)


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


def _time_path(path: Path) -> Path:
    return path.with_suffix(".seconds.json")


def _seconds(path: Path) -> float:
    try:
        return float(json.loads(_time_path(path).read_text(encoding="utf-8"))["seconds"])
    except (OSError, ValueError, KeyError):  # the time of a part is no result: it may be missing
        return float("nan")


def _home(name: str) -> str:
    """The top-level package of an estimator."""
    from importlib.metadata import entry_points

    from estimators.registry import GROUP

    for point in entry_points(group=GROUP):
        if point.name == name:
            return point.value.partition(":")[0].partition(".")[0]
    return "estimators"
