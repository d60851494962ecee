"""Running a stress plan: visit by visit, every finished part kept, so that a killed run resumes."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from scenarios.console import Console, Progress
from scenarios.maps import appearance_maps
from scenarios.outputs import prepare_folder
from scenarios.pipeline import check_estimator
from scenarios.stress.design import Design, derived_seed, design_of
from scenarios.stress.light import light_of
from scenarios.stress.parts import (
    Chunk,
    Outcome,
    arrays_of,
    chunks_of,
    outcome_of,
    store_part,
)
from scenarios.stress.plan import StressPlan
from scenarios.stress.simulate import Taken, samples_of, take, visit_bench, visit_wavelengths
from twin.cache import cache_folder, load_arrays

if TYPE_CHECKING:
    from estimators import BenchModel
    from estimators.map_grid import Map

CHUNKS = "chunks"
"""Folder of the finished parts inside the output folder."""
NOISE_SEED, LIGHT_SEED = 1, 2
LIGHT_PART = 0.8
"""Share of a visit's work that is light, for the progress bar."""


def run_plan(
    plan: StressPlan,
    folder: Path,
    *,
    cache: Path | None = None,
    threads: int | None = None,
    console: Console | None = None,
    stored: Callable[[Path], None] = lambda path: None,
) -> Outcome:
    """Run a plan; what the folder holds of it already is taken from there.

    Args:
        plan: what to run.
        folder: finished parts are kept in its subfolder `chunks`, under content keys.
        cache: folder of appearance maps and light; None takes the user's.
        threads: threads of the Monte Carlo; the result does not depend on them.
        console: is told what happens.
        stored: called with every part's path once it is stored.

    Raises:
        InputError: an estimator's name or option, or a bench, cannot be used, or the folder cannot
            be written.
    """
    console = console or Console(quiet=True)
    for contender in plan.estimators:
        check_estimator(contender)
    design = design_of(plan)
    parts = prepare_folder(folder / CHUNKS)
    chunks = list(chunks_of(plan, design, parts))
    missing = [c for c in chunks if load_arrays(c.path, console.say) is None]
    if missing and len(missing) < len(chunks):
        console.say(f"{len(chunks) - len(missing)} of {len(chunks)} parts are there already")
    raised: list[str] = []
    maps = {
        name: _maps(plan, name, cache, threads, console)
        for name in dict.fromkeys(chunk.case.bench for chunk in missing)
    }
    if missing:
        with console.step(f"stress test of {len(design)} points") as progress:
            worker = _Worker(plan, design, maps, cache, threads, console, raised, stored)
            worker.run(missing, progress)
    return outcome_of(plan, design, chunks, tuple(raised))


@dataclass(frozen=True)
class _Worker:
    """Does missing chunks, visit by visit."""

    plan: StressPlan
    design: Design
    maps: Mapping[str, tuple[Map, ...]]
    cache: Path | None
    threads: int | None
    console: Console
    raised: list[str]
    stored: Callable[[Path], None]

    def run(self, missing: list[Chunk], progress: Progress) -> None:
        """All of them, in order."""
        visits: dict[tuple[str, int], list[Chunk]] = {}
        for chunk in missing:
            visits.setdefault((chunk.case.bench, chunk.visit), []).append(chunk)
        for number, ((bench, visit), chunks) in enumerate(visits.items()):

            def part(share: float, before: int = number) -> None:
                progress(before + share, len(visits))

            self._visit(bench, visit, chunks, part)

    def _visit(
        self, bench_name: str, visit: int, chunks: list[Chunk], part: Callable[[float], None]
    ) -> None:
        from estimators import BenchModel

        plan, bench = self.plan, self.plan.benches[bench_name]
        material = self.design.material[self.design.visit == visit]
        wavelength = visit_wavelengths(visit_bench(bench, len(material)))
        samples = samples_of(plan)
        light = []
        for number, sample in enumerate(samples):

            def report(done: float, total: float, before: int = number) -> None:
                part(LIGHT_PART * (before + done / total) / len(samples))

            light.append(
                light_of(
                    bench,
                    sample,
                    wavelength,
                    material,
                    plan.light,
                    seed=derived_seed(plan.seed, LIGHT_SEED, visit, number),
                    folder=self.cache or cache_folder("stress"),
                    threads=self.threads,
                    progress=report,
                    say=self.console.say,
                )
            )
        done = 0
        for level in plan.noise:
            mine = [chunk for chunk in chunks if chunk.case.noise == level]
            if not mine:
                continue
            seed = derived_seed(plan.seed, NOISE_SEED, visit, round(1e6 * level))
            taken = take(plan, visit_bench(bench, len(material), level), material, light, seed=seed)
            maps = self.maps[bench_name]
            model = BenchModel.of(taken.bench, taken.samples, wavelength, maps)
            for chunk in mine:
                self._estimate(chunk, model, taken)
                done += 1
                part(LIGHT_PART + (1 - LIGHT_PART) * done / len(chunks))

    def _estimate(self, chunk: Chunk, model: BenchModel, taken: Taken) -> None:
        from estimators import estimator

        begin = time.perf_counter()
        try:
            made = estimator(chunk.contender.name, model, **chunk.contender.options)
            result = made.estimate(taken.intensities)
            seconds = time.perf_counter() - begin
            arrays = arrays_of(result, model.wavelength_nm.size)
        except Exception as error:  # noqa: BLE001 - any estimator is tried: its failure is a result
            text = f"{chunk.case.estimator}: {type(error).__name__}: {error}"
            if text not in self.raised:
                self.raised.append(text)
                self.console.say(f"raised by {text}")
            return
        store_part(chunk.path, arrays, taken, seconds)
        self.stored(chunk.path)


def _maps(
    plan: StressPlan,
    name: str,
    cache: Path | None,
    threads: int | None,
    console: Console,
) -> tuple[Map, ...]:
    bench, samples = plan.benches[name], samples_of(plan)
    wavelength = np.asarray(bench.instrument.wavelength_nm, dtype=np.float64)
    return appearance_maps(
        bench, samples, wavelength, plan.map, cache=cache, threads=threads, console=console
    )
