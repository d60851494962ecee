"""Mitsuba: the bench in Mitsuba 3 and here: agreement, and efficiency per appearance-map point.

Both programs simulate the bench of bench.md with a bare 40 x 40 mm slab of 1 mm over each
background, at refractive indices 1.0 (index-matched) and 1.5, for six media. What is compared
is the radiance factor pi L / E, with E from the closed form of the reference plane.

Efficiency is 1 / (variance x time per map point), all cores at work in both programs:

- Mitsuba renders one point (one albedo over one background) per render, so its time per point
  is the time of the render (compilation and warm-up not counted);
- ours traces one (n, sigma_t, g) and fills `MAP_ALBEDOS` albedos over two backgrounds from the
  same paths, so its time per point is the time of tracing *and* of evaluating all of them over
  2 x `MAP_ALBEDOS`. The variance is that of the very point which Mitsuba renders.

Both programs' own effort is what a user would choose for a map: `volpath` without Russian
roulette, no direct connection from a medium behind a smooth dielectric (it never succeeds).
The scalar variant runs on one core; its time is then divided by the number of cores.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.mitsuba_scene import Renderer, SlabCase, load
from twin.bench import Bench
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
TARGET = {"ours": 0.0008, "mitsuba": 0.0027}
QUICK_TARGET = {"ours": 0.003, "mitsuba": 0.01}
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


def run(quick: bool) -> dict[str, object]:
    """Agreement and efficiency of every case; see the module's docstring."""
    mi, variant = load()
    scalar = not variant.startswith("llvm")
    bench = Bench(covers_above=(), covers_below=())
    media = MEDIA[2:6:3] if quick else MEDIA
    target = QUICK_TARGET if quick else TARGET
    cases: list[dict[str, float | str]] = []
    started = time.perf_counter()
    for n in (1.0, 1.5):
        for number, medium in enumerate(media):
            ours = trace_point(bench, n, medium, target["ours"], seed=11)
            for background, rho in RHO.items():
                case = SlabCase(n, *medium, THICKNESS_MM, background, rho)
                theirs = Renderer(mi, bench, case).until(
                    target["mitsuba"],
                    SCALAR_RAYS if scalar else RAYS,
                    MOST_RAYS,
                    seed=1000 * (number + 1) + int(10 * n),
                )
                seconds = theirs.seconds / (default_threads() if scalar else 1)
                value, error = ours.value[background], ours.standard_error[background]
                combined = math.hypot(error, theirs.standard_error)
                per_point = ours.seconds / (2 * MAP_ALBEDOS)
                cases.append(
                    {
                        "n": n,
                        "albedo": medium[0],
                        "sigma_t": medium[1],
                        "g": medium[2],
                        "background": background,
                        "ours": value,
                        "mitsuba": theirs.value,
                        "z": (value - theirs.value) / combined,
                        "relative_standard_error": combined / theirs.value,
                        "seconds_ours": ours.seconds,
                        "seconds_mitsuba": seconds,
                        "rays_mitsuba": float(theirs.rays),
                        "efficiency_ratio": (theirs.standard_error**2 * seconds)
                        / (error**2 * per_point),
                    }
                )
                print(" ".join(f"{k} {v}" for k, v in cases[-1].items()), file=sys.stderr)
    column = {
        key: np.array([float(case[key]) for case in cases])
        for key in ("z", "relative_standard_error", "efficiency_ratio", "n")
    }
    ratio = column["efficiency_ratio"]
    return {
        "variant": variant,
        "efficiency_ratio_median": float(np.median(ratio)),
        "efficiency_ratio_min": float(ratio.min()),
        "efficiency_ratio_median_n1": float(np.median(ratio[column["n"] == 1.0])),
        "efficiency_ratio_median_n1_5": float(np.median(ratio[column["n"] == 1.5])),
        "max_z": float(np.max(np.abs(column["z"]))),
        "rms_z": float(np.sqrt(np.mean(column["z"] ** 2))),
        "max_relative_standard_error": float(column["relative_standard_error"].max()),
        "map_albedos": MAP_ALBEDOS,
        "seconds": time.perf_counter() - started,
        "cases": cases,
    }
