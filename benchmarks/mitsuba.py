"""Mitsuba: the bench in Mitsuba 3 and here: agreement, and efficiency per appearance-map point.

Both programs simulate the bench of bench.md with a bare 40 x 40 mm slab of 1 mm over each
background, at refractive indices 1.0 (index-matched) and 1.5, for six media. What is compared
is the radiance factor pi L / E, with E from the closed form of the reference plane.

Efficiency is 1 / (variance x time per map point), all cores at work in both programs:

- Mitsuba renders one point (one albedo over one background) per render, so its time per point
  is the time of the render (compilation and warm-up not counted);
- ours computes an appearance map (40 albedos x 60 sigma_t x 10 g, black, white and collimated)
  of which the medium is a node; its time per point is that of the whole map over its number of
  points over black and over white. The variance is that of the very node which Mitsuba renders.

Agreement is judged twice: of that node, whose Monte Carlo tells only how the finite bench differs
from the plane-parallel one, and of a plain trace (`z_plain`, `efficiency_ratio_plain`), which
fills 40 albedos over two backgrounds from the paths of one (sigma_t, g) and uses no other engine.

Both programs' own effort is what a user would choose for a map: `volpath` without Russian
roulette, no direct connection from a medium behind a smooth dielectric (it never succeeds).
The scalar variant runs on one core; its time is then divided by the number of cores.
"""

from __future__ import annotations

import math
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.mitsuba_scene import Renderer, SlabCase, load
from twin.appearance import MapGrid, appearance_map
from twin.bench import Bench
from twin.materials import reflectance
from twin.spectra import FloatArray
from twin.transport import Effort, FlatStack, mean_and_error, panels_setup, run_many, trace
from twin.transport.engine import BLACK, WHITE, default_threads

THICKNESS_MM = 1.0
RHO = {"black": 0.02, "white": 0.99}
CHANNEL = {"black": BLACK, "white": WHITE}
MAP_ALBEDOS = 40
# albedo, sigma_t [1/mm], g: thin and clear to dense and nearly conservative
MEDIA = (
    (0.50, 1.0, 0.0),
    (0.80, 0.5, 0.6),
    (0.90, 2.0, 0.4),
    (0.95, 4.0, 0.8),
    (0.99, 3.0, 0.0),
    (0.99, 8.0, 0.9),
)
TARGET = {"ours": 0.0010, "mitsuba": 0.0027}
QUICK_TARGET = {"ours": 0.003, "mitsuba": 0.01}
MAP_PATHS, QUICK_MAP_PATHS = 1 << 15, 1 << 11
MAP_SIGMAS, MAP_GS = 60, 10
RAYS, MOST_RAYS = 2**17, 2**24
SCALAR_RAYS = 2**13
BLOCKS, LOG2_PATHS = 64, 9


@dataclass(frozen=True)
class Ours:
    """Values and standard errors at the point, by background, and what they took."""

    value: dict[str, float]
    standard_error: dict[str, float]
    seconds: float
    paths: int


def albedo_grid(albedo: float) -> FloatArray:
    """`MAP_ALBEDOS` albedos of a map, the wanted one among them at the first place."""
    return np.concatenate([[albedo], np.linspace(0.0, 0.999, MAP_ALBEDOS - 1)])


def trace_point(
    bench: Bench, n: float, medium: tuple[float, float, float], target: float, seed: int
) -> Ours:
    """One row of a map (all albedos, both backgrounds), on all cores, until errors are small."""
    albedo, sigma_t, g = medium
    one = np.ones(1)
    stack = FlatStack(THICKNESS_MM * one, n * one, sigma_t * one, g * one, one, counted=0)
    setup = panels_setup(bench, THICKNESS_MM)
    albedos = albedo_grid(albedo)
    cores = default_threads()

    def job(number: int, log2_paths: int) -> Callable[[], FloatArray]:
        def run() -> FloatArray:
            effort = Effort(blocks=BLOCKS, log2_paths=log2_paths)
            tallies = trace(
                stack, setup, effort, seed=seed, stream=log2_paths, first_block=number * BLOCKS
            )
            grids = [
                tallies.blocks_by_albedo(CHANNEL[name], albedos) @ rho**tallies.bounce
                for name, rho in RHO.items()
            ]
            return np.stack(grids, axis=1)

        return run

    log2_paths = LOG2_PATHS
    while True:
        started = time.perf_counter()
        blocks = np.concatenate(run_many([job(i, log2_paths) for i in range(cores)]))
        mean, error = mean_and_error(blocks)
        seconds = time.perf_counter() - started
        relative = float(np.max(error[:, 0] / mean[:, 0]))
        if relative <= target or log2_paths >= 17:
            break
        log2_paths = min(17, log2_paths + max(1, math.ceil(2 * math.log2(relative / target))))
    return Ours(
        {name: float(mean[i, 0]) for i, name in enumerate(RHO)},
        {name: float(error[i, 0]) for i, name in enumerate(RHO)},
        seconds,
        cores * BLOCKS * 2**log2_paths,
    )


def map_grid(medium: tuple[float, float, float], gs: int) -> MapGrid:
    """A map's grid of which the medium is a node, even in ln sigma_t like the default one."""
    albedo, sigma_t, g = medium
    step = math.log(1000.0) / (MAP_SIGMAS - 1)
    below = round((math.log(sigma_t) - math.log(0.05)) / step)
    sigmas = sigma_t * np.exp(step * (np.arange(MAP_SIGMAS) - below))
    plain = MapGrid.spaced(MAP_ALBEDOS, MAP_SIGMAS, gs)

    def with_node(axis: tuple[float, ...], value: float) -> tuple[float, ...]:
        # the node nearest to the wanted value moves there
        values = np.array(axis)
        values[np.argmin(np.abs(values - value))] = value
        return tuple(values.tolist())

    return MapGrid(
        albedo=with_node(plain.albedo, albedo),
        sigma_t_per_mm=tuple(sigmas.tolist()),
        g=with_node(plain.g, g),
    )


def map_point(
    bench: Bench, n: float, medium: tuple[float, float, float], paths: int, gs: int
) -> Ours:
    """The medium's node of a map; seconds are per point of the map over one background."""
    grid = map_grid(medium, gs)
    with tempfile.TemporaryDirectory() as folder:
        started = time.perf_counter()
        found = appearance_map(
            bench, THICKNESS_MM, n, grid=grid, paths=paths, seed=23, folder=Path(folder)
        )
        seconds = time.perf_counter() - started
    node = tuple(
        int(np.argmin(np.abs(np.array(axis) - value)))
        for axis, value in zip((grid.albedo, grid.sigma_t_per_mm, grid.g), medium, strict=True)
    )
    series = {"black": found.black_series[node], "white": found.white_series[node]}
    errors = {"black": found.black_se[node], "white": found.white_se[node]}
    value = {name: float(series[name] @ rho**found.exponent) for name, rho in RHO.items()}
    # the map states errors at its bench's own reflectances, where they are the same share
    own = found.intensities(*_bench_rho(bench))[node]
    error = {
        name: float(errors[name] / own[row] * value[name])
        for row, name in enumerate(("black", "white"))
    }
    return Ours(value, error, seconds / (2 * int(np.prod(found.shape))), paths)


def _bench_rho(bench: Bench) -> tuple[float, float]:
    nominal = np.array([550.0])
    return (
        float(reflectance(bench.background.black.reflectance, nominal)[0]),
        float(reflectance(bench.background.white.reflectance, nominal)[0]),
    )


def run(quick: bool) -> dict[str, object]:
    """Agreement and efficiency of every case; see the module's docstring."""
    mi, variant = load()
    scalar = not variant.startswith("llvm")
    bench = Bench(covers_above=(), covers_below=())
    media = MEDIA[2:6:3] if quick else MEDIA
    target = QUICK_TARGET if quick else TARGET
    gs, paths = (3, QUICK_MAP_PATHS) if quick else (MAP_GS, MAP_PATHS)
    cases: list[dict[str, float | str]] = []
    started = time.perf_counter()
    for n in (1.0, 1.5):
        map_point(bench, n, media[0], 64, gs)  # compiles; neither counted nor timed
        for number, medium in enumerate(media):
            plain = trace_point(bench, n, medium, target["ours"], seed=11)
            node = map_point(bench, n, medium, paths, gs)
            for background, rho in RHO.items():
                case = SlabCase(n, *medium, THICKNESS_MM, background, rho)
                theirs = Renderer(mi, bench, case).until(
                    target["mitsuba"],
                    SCALAR_RAYS if scalar else RAYS,
                    MOST_RAYS,
                    seed=1000 * (number + 1) + int(10 * n),
                )
                seconds = theirs.seconds / (default_threads() if scalar else 1)
                value, error = node.value[background], node.standard_error[background]
                other, other_error = plain.value[background], plain.standard_error[background]
                combined = math.hypot(error, theirs.standard_error)
                combined_plain = math.hypot(other_error, theirs.standard_error)
                theirs_cost = theirs.standard_error**2 * seconds
                plain_seconds = plain.seconds / (2 * MAP_ALBEDOS)
                cases.append(
                    {
                        "n": n,
                        "albedo": medium[0],
                        "sigma_t": medium[1],
                        "g": medium[2],
                        "background": background,
                        "map": value,
                        "plain": other,
                        "mitsuba": theirs.value,
                        "z": (value - theirs.value) / combined,
                        "z_plain": (other - theirs.value) / combined_plain,
                        "relative_standard_error": max(combined, combined_plain) / theirs.value,
                        "microseconds_map": 1e6 * node.seconds,
                        "seconds_mitsuba": seconds,
                        "rays_mitsuba": float(theirs.rays),
                        "efficiency_ratio": theirs_cost / (error**2 * node.seconds),
                        "efficiency_ratio_plain": theirs_cost / (other_error**2 * plain_seconds),
                    }
                )
                print(" ".join(f"{k} {v}" for k, v in cases[-1].items()), file=sys.stderr)
    column = {
        key: np.array([float(case[key]) for case in cases])
        for key in (
            "z",
            "z_plain",
            "relative_standard_error",
            "efficiency_ratio",
            "efficiency_ratio_plain",
            "n",
        )
    }
    ratio, plain_ratio = column["efficiency_ratio"], column["efficiency_ratio_plain"]
    every_z = np.concatenate([column["z"], column["z_plain"]])
    return {
        "variant": variant,
        "efficiency_ratio_median": float(np.median(ratio)),
        "efficiency_ratio_min": float(ratio.min()),
        "efficiency_ratio_median_n1": float(np.median(ratio[column["n"] == 1.0])),
        "efficiency_ratio_median_n1_5": float(np.median(ratio[column["n"] == 1.5])),
        "efficiency_ratio_plain_median": float(np.median(plain_ratio)),
        "efficiency_ratio_plain_min": float(plain_ratio.min()),
        "max_z": float(np.max(np.abs(every_z))),
        "rms_z": float(np.sqrt(np.mean(every_z**2))),
        "max_relative_standard_error": float(column["relative_standard_error"].max()),
        "map_albedos": MAP_ALBEDOS,
        "seconds": time.perf_counter() - started,
        "cases": cases,
    }
