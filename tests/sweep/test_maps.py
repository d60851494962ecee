"""Appearance maps on the sweep: the same bytes whoever computes them, nothing done twice."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from scenarios.console import Console
from scenarios.maps import appearance_maps
from scenarios.scenario import MapSettings
from scenarios.sweep import Engine, Workers
from scenarios.sweep.task import Answer
from scenarios.sweep.workers import Job
from twin.bench import Bench, Sample

BENCH = Bench(covers_above=(), covers_below=())
SAMPLES = (Sample(name="a", thickness_mm=0.4), Sample(name="b", thickness_mm=0.8))
SETTINGS = MapSettings(albedo_count=3, sigma_t_count=3, g_count=2, paths=1024)
QUIET = Console(quiet=True)


def made(cache: Path, workers: Workers | None = None) -> list[bytes]:
    """Bytes of the two maps in the cache, after computing them."""
    maps = appearance_maps(
        BENCH, SAMPLES, np.array([550.0]), SETTINGS, cache=cache, threads=None, console=QUIET,
        workers=workers,
    )  # fmt: skip
    assert [found.thickness_mm for found in maps] == [0.4, 0.8]
    return [path.read_bytes() for path in sorted(cache.glob("*.map"))]


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> list[bytes]:
    return made(tmp_path_factory.mktemp("alone"))


@pytest.mark.parametrize("engine", ["joblib", "dask"])
def test_workers_give_the_same_bytes(tmp_path: Path, engine: str, alone: list[bytes]) -> None:
    assert made(tmp_path, Workers(engine=engine, count=2)) == alone  # type: ignore[arg-type]
    assert [path.name for path in tmp_path.iterdir() if path.suffix != ".map"] == ["sweeps"]
    assert not list((tmp_path / "sweeps").iterdir())  # nothing is left of the work


@dataclass(frozen=True, kw_only=True)
class Watched(Workers):
    """Two processes whose jobs are counted, with a cache of their own if one is given."""

    engine: Engine = "joblib"
    count: int = 2
    folder: str = ""
    counts: list[int] = field(default_factory=list)

    def answers(
        self, task: str, jobs: Sequence[Job], say: Callable[[str], None] = lambda text: None
    ) -> Iterator[Answer]:
        self.counts.append(len(jobs))
        if self.folder:
            jobs = [(n, json.dumps(json.loads(text) | {"folder": self.folder})) for n, text in jobs]
        return super().answers(task, jobs, say)


def test_only_what_is_missing_is_spread(tmp_path: Path, alone: list[bytes]) -> None:
    made(tmp_path)
    victim = min(tmp_path.glob("*.map"))
    victim.write_bytes(b"damaged")
    workers = Watched()
    assert made(tmp_path, workers) == alone
    assert workers.counts == [SETTINGS.g_count]
    made(tmp_path, workers)
    assert workers.counts == [SETTINGS.g_count]


def test_parts_travel_back_from_workers_with_a_cache_of_their_own(
    tmp_path: Path, alone: list[bytes]
) -> None:
    """A worker on another machine keeps its parts there; the results arrive all the same."""
    assert made(tmp_path / "head", Watched(folder=str(tmp_path / "worker"))) == alone
    assert len(list((tmp_path / "worker").glob("*.part"))) == 2 * SETTINGS.g_count
