"""What one worker does of a stress test: the light of a visit, and one estimator's answer to it.

A point holds all that its result depends on; beside it stand the folder of the cache and the number
of threads, on which no result depends.
"""

from __future__ import annotations

import json
import time
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.console import Console
from scenarios.outputs import canonical_json
from scenarios.stress.design import derived_seed
from scenarios.stress.effects import world_of
from scenarios.stress.light import FIELDS
from scenarios.stress.parts import arrays_of
from scenarios.stress.plan import StressPlan
from scenarios.stress.simulate import Taken, samples_of, take, visit_bench, visit_wavelengths
from scenarios.stress.world_light import sample_light
from scenarios.sweep import Timed
from twin.cache import cache_folder
from twin.spectra import FloatArray
from twin.toml import validate

if TYPE_CHECKING:
    from estimators import BenchModel
    from estimators.map_grid import Map
    from scenarios.sweep import Workers
    from twin.effects import World
    from twin.transport import NoiselessCaptures

LIGHT, ANSWERS = "scenarios.stress.task:light", "scenarios.stress.task:answer"
NOISE_SEED, LIGHT_SEED = 1, 2
BENCH, EFFECTS = "bench", "effects"
"""What the only bench and the only entry of a point are called."""
OF_ONE = ("estimator", "options", "code")
"""What the points of one visit at one noise level differ in."""
MAP_NEEDS = ("bench", "n", "thickness_mm", "map", "cache", "threads")
"""What of a point its maps are made from."""


class NoVisit(RuntimeError):
    """The visit could not be simulated: no estimator is to blame."""


def light(point: dict[str, Any]) -> dict[str, FloatArray]:
    """The light of one sample in one visit, into the cache: shape (6, W), in the order `FIELDS`."""
    plan = _plan(point)
    found = _light(plan, point, _world(plan, point, 1.0), int(point["sample"]))
    return {"light": np.stack([getattr(found, name) for name in FIELDS])}


def answer(point: dict[str, Any]) -> Timed:
    """What one estimator says of one visit, and the time that it took.

    Raises:
        NoVisit: the visit could not be simulated.
    """
    from estimators import estimator

    shared = {name: value for name, value in point.items() if name not in OF_ONE}
    try:
        taken, model = _taken(canonical_json(shared, indent=None))
    except Exception as error:
        raise NoVisit(str(error)) from error
    begin = time.perf_counter()
    result = estimator(point["estimator"], model, **point["options"]).estimate(taken.intensities)
    seconds = time.perf_counter() - begin
    return Timed(arrays_of(result, taken), seconds)


@lru_cache(maxsize=2)
def _taken(text: str) -> tuple[Taken, BenchModel]:
    """The noisy visit, shared by the estimators that are tried on it."""
    from estimators import BenchModel

    point = json.loads(text)
    plan, level = _plan(point), float(point["noise"])
    world = _world(plan, point, level)
    found = [_light(plan, point, world, number) for number in range(len(plan.thickness_mm))]
    seed = derived_seed(plan.seed, NOISE_SEED, point["visit"], round(1e6 * level))
    bench = world.described_bench
    taken = take(plan, bench, _material(point), found, seed=seed, world=world)
    maps = _maps(canonical_json({k: point[k] for k in MAP_NEEDS}, indent=None))
    return taken, BenchModel.of(taken.bench, taken.samples, visit_wavelengths(bench), maps)


@lru_cache(maxsize=4)
def _maps(text: str) -> tuple[Map, ...]:
    """The maps of a point, shared by the visits to its bench."""
    point = json.loads(text)
    return maps_of(_plan(point), BENCH, _folder(point), point["threads"], Console(quiet=True))


def maps_of(
    plan: StressPlan,
    name: str,
    cache: Path | None,
    threads: int | None,
    console: Console,
    *,
    workers: Workers | None = None,
) -> tuple[Map, ...]:
    """The appearance maps of a bench of the plan, computed or from the cache.

    Args:
        plan: has the bench and the settings of the maps.
        name: of the bench.
        cache: folder of the maps; None takes the user's.
        threads: of the Monte Carlo in this process.
        console: is told what happens.
        workers: as of `scenarios.maps.appearance_maps`.

    Raises:
        InputError: a folder that cannot be written, or workers that cannot be had.
    """
    from scenarios.maps import appearance_maps

    bench = plan.benches[name]
    wavelength = np.asarray(bench.instrument.wavelength_nm, dtype=np.float64)
    return appearance_maps(
        bench, samples_of(plan), wavelength, plan.map, cache=cache, threads=threads,
        console=console, workers=workers,
    )  # fmt: skip


def _plan(point: dict[str, Any]) -> StressPlan:
    """The part of a plan that a point holds."""
    named = ("seed", "n", "thickness_mm", "protocol", "light", "map")
    data = {name: point[name] for name in named if name in point}
    data |= {"title": "a part of a stress test", "benches": {BENCH: point["bench"]}}
    if "spectra" in point:
        data["materials"] = {"spectra": point["spectra"]}
    if "effects" in point:
        data["effects"] = {EFFECTS: dict(point["effects"])}
    return validate(data, StressPlan)


def _world(plan: StressPlan, point: dict[str, Any], level: float) -> World:
    bench = visit_bench(plan.benches[BENCH], len(point["material"]), level)
    return world_of(plan, bench, EFFECTS)


def _light(plan: StressPlan, point: dict[str, Any], world: World, number: int) -> NoiselessCaptures:
    return sample_light(
        world,
        number,
        visit_wavelengths(world.described_bench),
        _material(point),
        plan.light,
        seed=derived_seed(plan.seed, LIGHT_SEED, point["visit"], number),
        folder=_folder(point) or cache_folder("stress"),
        threads=point["threads"],
    )


def _material(point: dict[str, Any]) -> FloatArray:
    return np.asarray(point["material"], dtype=np.float64)


def _folder(point: dict[str, Any]) -> Path | None:
    return Path(point["cache"]) if point["cache"] else None
