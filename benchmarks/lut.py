"""Look-up of 1000 wavelengths in the appearance map, plain and with a random neighbourhood.

Two thicknesses, a map of 40 x 60 x 10 in closed form (the two-stream world of the tests),
materials over most of the map; beside it the published route in the same run:
one Delaunay triangulation per thickness and scipy's linear interpolation, at one background
reflectance, because a triangulation per wavelength would take an hour.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np


def best_of(repeats: int, task: Callable[[], object]) -> float:
    """Shortest time [s] of several runs, after one that does not count."""
    task()
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        task()
        times.append(time.perf_counter() - begin)
    return min(times)


def run(quick: bool) -> dict[str, object]:
    """Time both estimators, and the accuracy that the time buys.

    Args:
        quick: a tenth of the wavelengths and a coarser map.

    Returns:
        plain_ms, robust_s: the estimator warm, all wavelengths and both thicknesses, 500
        draws in the second; prepare_ms: maps to tables; scipy_build_s, scipy_plain_ms: the
        triangulations and their interpolation; median_error_*: against the truth, exact
        captures without noise; coverage90_*: of the robust estimate at 0.5 % noise.
    """
    from scipy.interpolate import LinearNDInterpolator

    from estimators import LutEstimator, LutSettings, Status
    from tests.estimators.fake_map import fake_map
    from tests.estimators.visits import THICKNESS, bench_model, materials, visit

    count = 100 if quick else 1000
    shape = (20, 30, 6) if quick else (40, 60, 10)
    maps = tuple(fake_map(thickness, shape=shape) for thickness in THICKNESS)
    model, truth = bench_model(count, maps), materials(count)
    exact, noisy = visit(model, truth), visit(model, truth, noise=0.005)
    plain = LutEstimator(model, LutSettings(draws=0))
    robust = LutEstimator(model, LutSettings(draws=500))
    plain_s = best_of(5, lambda: plain.estimate(exact))
    robust_s = best_of(3, lambda: robust.estimate(noisy))
    prepare_s = best_of(2, lambda: LutEstimator(model))

    begin = time.perf_counter()
    tables = []
    for source in maps:
        nodes = np.stack(
            np.meshgrid(source.albedo, source.sigma_t_per_mm, source.g, indexing="ij"), axis=-1
        ).reshape(-1, 3)
        powers = [rho**source.exponent for rho in (0.05, 0.99)]
        cloud = np.stack(
            [
                (source.black_series @ powers[0]).ravel(),
                (source.white_series @ powers[1]).ravel(),
                np.log(source.collimated).ravel(),
            ],
            axis=-1,
        )
        tables.append(LinearNDInterpolator(cloud, nodes))
    build_s = time.perf_counter() - begin
    triples = exact.value.transpose(0, 2, 1).copy()
    triples[..., 2] = np.log(triples[..., 2])
    scipy_s = best_of(
        3, lambda: [table(triple) for table, triple in zip(tables, triples, strict=True)]
    )

    result, wide = plain.estimate(exact), robust.estimate(noisy)
    errors = np.nanmedian(np.abs(result.parameters - truth), axis=0)
    low, high = wide.interval(0.9)
    held = (truth >= low) & (truth <= high)
    known = wide.identifiable & (wide.status < Status.INCONSISTENT)[:, None]
    covered = [float(held[known[:, p], p].mean()) for p in range(3)]
    return {
        "wavelengths": count,
        "nodes": int(np.prod(shape)),
        "plain_ms": 1e3 * plain_s,
        "robust_s": robust_s,
        "prepare_ms": 1e3 * prepare_s,
        "scipy_build_s": build_s,
        "scipy_plain_ms": 1e3 * scipy_s,
        "median_error_albedo": float(errors[0]),
        "median_error_sigma_t_per_mm": float(errors[1]),
        "median_error_g": float(errors[2]),
        "coverage90_albedo": covered[0],
        "coverage90_sigma_t": covered[1],
        "coverage90_g": covered[2],
        "statuses": wide.counts(),
    }
