"""Adding-doubling: reference rows, against the Monte Carlo, time with Jacobian, iadpython.

Keys:

- `rows`, `failed`: rows of the table of reference values whose own uncertainty can tell (three
  times it is below the tolerance), and those further away than 1e-4 absolute or 0.1 %;
  `failed_rows` names them. `too_uncertain` counts the others (published Monte Carlo mostly),
  `too_uncertain_beyond3` those further than three of their own uncertainties and the tolerance.
  Two printed values that `benchmarks references` corrects are compared as corrected;
  `as_printed_failed` counts them against the print.
- `max_relative_difference`, `max_z`: captures against the Monte Carlo in the unbounded limit;
  `differences` has each with the Monte Carlo's standard error, by which the figure is limited;
  `max_relative_difference_beyond_noise` takes three of those standard errors off.
- `jacobian_ms`: 31 wavelengths x 3 thicknesses x 3 captures with the Jacobian by albedo, sigma_t
  and g, warm; `forward_ms` without.
- `speed_ratio_iadpython`: time of iadpython per problem over ours in a batch of 1000, UR1 and
  UT1 (and URU, UTU, which both give): 16 points of iadpython beside the number of our streams
  that is as accurate; `_8` the same with its 8 points. `error` and `error_iadpython` are the
  largest differences of each from ours with 48 streams, over all four and all problems.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.reference_rows import Case, cases_of
from benchmarks.references import CORRECTED, CSV, read_rows
from twin.bench import Background, Backgrounds, Bench, Detector, Panel, Sample
from twin.materials import OpticalProperties
from twin.spectra import FloatArray

ABSOLUTE, RELATIVE = 1e-4, 1e-3
WIDE_MM = 1.0e6
FAR = 1000.0
"""How many times farther and larger the panels are than those of bench.md."""
OURS_FOR_16 = (6, 4, 14)
OURS_FOR_8 = (4, 4, 8)
"""Air streams, trapped streams and orders."""


def best_of(repeats: int, task: Callable[[], object]) -> float:
    """Shortest time [s] of several runs, after one that does not count."""
    task()
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        task()
        times.append(time.perf_counter() - begin)
    return min(times)


def evaluate(cases: list[Case], air: int = 16, trapped: int = 16) -> FloatArray:
    """Our value of every case, shape (cases,)."""
    from twin.adding_doubling import slab_optics

    groups: dict[tuple[tuple[float, ...], bool], list[int]] = {}
    for number, case in enumerate(cases):
        start, out = _directions(case)
        groups.setdefault((tuple(sorted({start, out, 1.0})), case.scene.n == 1.0), []).append(
            number
        )
    cones = sorted({case.score.cosine for case in cases if case.score.kind == "cone"})
    values = np.empty(len(cases))
    for (cosines, _), members in groups.items():
        scenes = [cases[number].scene for number in members]
        optics = slab_optics(
            [cases[number].albedo for number in members],
            [scene.optical_thickness for scene in scenes],
            [scene.g for scene in scenes],
            [scene.n for scene in scenes],
            backing=[scene.rho for scene in scenes],
            cosines=cosines,
            cones_deg=[math.degrees(math.acos(c)) for c in cones] if cosines == (1.0,) else (),
            air=air,
            trapped=trapped,
        )
        for at, number in enumerate(members):
            case = cases[number]
            raw = _score(optics, at, case, cosines, cones)
            values[number] = case.offset + case.slope * raw
    return values


def _directions(case: Case) -> tuple[float, float]:
    """Cosines of incidence and exit; panels stand at 45 degrees, looked at from above."""
    if case.score.kind == "panels":
        return math.sqrt(0.5), 1.0
    start = case.scene.start_cosine
    return (
        1.0 if start is None else start,
        case.score.cosine if case.score.kind == "direction" else 1.0,
    )


def _score(
    optics: Any, at: int, case: Case, cosines: tuple[float, ...], cones: list[float]
) -> float:
    """The figure that a case asks for, from the batch's element `at`."""
    start, out = (cosines.index(c) for c in _directions(case))
    up = case.side == "up"
    if case.score.kind == "cone":
        return float(optics.cone_transmittance[at, cones.index(case.score.cosine)])
    if case.score.kind in ("direction", "panels"):
        factor = optics.reflected_factor if up else optics.transmitted_factor
        return float(factor[at, out, start])
    if case.scene.start_cosine is None:
        return float((optics.URU if up else optics.UTU)[at])
    total = optics.reflectance if up else optics.transmittance
    clear = optics.unscattered_reflectance if up else optics.unscattered_transmittance
    return float(total[at, start] - (clear[at, start] if case.scattered_only else 0.0))


def reference_rows(quick: bool) -> dict[str, object]:
    """Rows of the table against ours."""
    if not CSV.is_file():
        return {"rows": 0, "skipped": "the table of reference values is not beside the repository"}
    cases, _ = cases_of(read_rows())
    cases = cases[::4] if quick else cases
    ours = evaluate(cases)
    rows = failed = printed = loose = loose_beyond = 0
    named: list[dict[str, object]] = []
    for case, value in zip(cases, ours, strict=True):
        target, uncertainty = CORRECTED.get(case.name, (case.value, case.uncertainty))
        tolerance = max(ABSOLUTE, RELATIVE * abs(target))
        away = abs(value - target)
        printed += int(
            3 * case.uncertainty <= tolerance
            and abs(value - case.value) > max(ABSOLUTE, RELATIVE * abs(case.value))
        )
        if 3 * uncertainty > tolerance and case.name not in CORRECTED:
            loose += 1
            loose_beyond += int(away > max(tolerance, 3 * uncertainty))
            continue
        rows += 1
        if not away <= tolerance:
            failed += 1
            named.append({"row": case.name, "ours": float(value), "reference": target})
    return {
        "rows": rows,
        "failed": failed,
        "failed_rows": named,
        "as_printed_failed": printed,
        "too_uncertain": loose,
        "too_uncertain_beyond3": loose_beyond,
    }


MEDIA = ((0.9, 2.0, 0.4), (0.99, 6.0, 0.8), (0.5, 1.0, 0.8), (0.999, 4.0, 0.0), (0.95, 3.0, 0.9))
"""albedo, sigma_t [1/mm], g of a sample of 1 mm."""


MONTE_CARLO_ERROR = 3.2e-4
"""Relative standard error to which the Monte Carlo is brought."""
PILOT_PATHS, MOST_REPEATS = 2**17, 128


def unbounded_bench(covered: bool) -> Bench:
    """The bench of bench.md without edges, its spot for the beam as wide as the bench.

    Its panels stand far away and are as much larger: at 300 mm their light falls by 0.2 % for each
    mm of depth and with the square of what it spreads sideways, which is the finite bench's part.
    """
    wide = (WIDE_MM, WIDE_MM)
    near = Panel()
    far = Panel(
        width_mm=FAR * near.width_mm,
        length_mm=FAR * near.length_mm,
        distance_mm=FAR * near.distance_mm,
    )
    backgrounds = Backgrounds(
        black=Background(reflectance=0.05, shape="disc", size_mm=wide),
        white=Background(reflectance=0.98, size_mm=wide),
    )
    bench = Bench(
        panels=(far, far.model_copy(update={"azimuth_deg": 180.0})),
        size_mm=None,
        background=backgrounds,
        detector=Detector(spot_beam_mm=WIDE_MM),
    )
    return bench if covered else bench.model_copy(update={"covers_above": (), "covers_below": ()})


def traced_captures(
    bench: Bench, sample: Sample, properties: OpticalProperties, target: float
) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Monte Carlo captures and their standard errors, each medium traced as often as it needs.

    A pilot tells how many repetitions of 2^20 paths bring the largest relative error of a medium
    to `target`; a medium that is repeated stands in several places of one call, which draws
    other random numbers at each.
    """
    from twin import transport

    names = ("black", "white", "collimated")

    def trace(index: np.ndarray, paths: int, seed: int) -> tuple[FloatArray, FloatArray]:
        media = OpticalProperties(
            np.linspace(500.0, 600.0, len(index)),
            properties.albedo[index],
            properties.sigma_t_per_mm[index],
            properties.g[index],
            None,
        )
        found = transport.captures(
            bench, sample, media.wavelength_nm, properties=media, paths=paths, seed=seed
        )
        return (
            np.stack([getattr(found, name) for name in names]),
            np.stack([getattr(found, f"{name}_se") for name in names]),
        )

    count = len(properties.albedo)
    value, error = trace(np.arange(count), PILOT_PATHS, 1)
    worst = np.max(error / value, axis=0)
    wanted = np.ceil((worst / target) ** 2 * PILOT_PATHS / 2**20)
    repeats = np.clip(wanted, 1, MOST_REPEATS).astype(int)
    index = np.repeat(np.arange(count), repeats)
    value, error = trace(index, 2**20, 2)
    mean = np.stack([value[:, index == w].mean(axis=1) for w in range(count)], axis=1)
    spread = np.stack(
        [np.sqrt((error[:, index == w] ** 2).sum(axis=1)) / repeats[w] for w in range(count)],
        axis=1,
    )
    return {name: (mean[row], spread[row]) for row, name in enumerate(names)}


def against_monte_carlo(quick: bool) -> dict[str, object]:
    """Captures by both engines, with and without covers, at n 1.5 and 1."""
    from twin import adding_doubling

    count = 2 if quick else len(MEDIA)
    wavelength = np.linspace(500.0, 600.0, count)
    albedo, sigma_t, g = (np.array(column)[:count] for column in zip(*MEDIA, strict=True))
    properties = OpticalProperties(wavelength, albedo, sigma_t, g, None)
    lines: list[dict[str, object]] = []
    scenes = [(True, 1.5)] if quick else [(True, 1.5), (False, 1.5), (False, 1.0)]
    for covered, n in scenes:
        bench = unbounded_bench(covered)
        sample = Sample(name="medium", thickness_mm=1.0, n=n)
        exact = adding_doubling.captures(bench, sample, wavelength, properties=properties)
        traced = traced_captures(bench, sample, properties, 3e-3 if quick else MONTE_CARLO_ERROR)
        for capture in ("black", "white", "collimated"):
            ours = getattr(exact, capture)
            theirs, error = traced[capture]
            for w in range(count):
                lines.append(
                    {
                        "capture": capture,
                        "covered": covered,
                        "n": n,
                        "albedo": float(albedo[w]),
                        "sigma_t_per_mm": float(sigma_t[w]),
                        "g": float(g[w]),
                        "relative_difference": float(ours[w] / theirs[w] - 1.0),
                        "relative_standard_error": float(error[w] / theirs[w]),
                        "z": float((ours[w] - theirs[w]) / math.hypot(error[w], 1e-6 * ours[w])),
                    }
                )

    def column(key: str) -> FloatArray:
        return np.array([float(str(line[key])) for line in lines])

    return {
        "max_relative_difference": float(np.abs(column("relative_difference")).max()),
        "max_relative_difference_beyond_noise": float(
            np.max(np.abs(column("relative_difference")) - 3 * column("relative_standard_error"))
        ),
        "median_relative_difference": float(np.median(np.abs(column("relative_difference")))),
        "max_monte_carlo_relative_se": float(column("relative_standard_error").max()),
        "max_z": float(np.abs(column("z")).max()),
        "rms_z": float(np.sqrt(np.mean(column("z") ** 2))),
        "differences": lines,
    }


def times(quick: bool) -> dict[str, object]:
    """Warm times of the captures of 31 wavelengths and 3 thicknesses."""
    import jax

    from twin.adding_doubling import captures_model

    samples = [Sample(name=f"{t}", thickness_mm=t) for t in (0.4, 0.8, 1.6)]
    model = captures_model(Bench(), samples, np.linspace(400.0, 700.0, 31))
    parameters = jax.tree.map(
        jax.numpy.asarray,
        model.parameters(
            np.linspace(0.6, 0.99, 31), np.linspace(1.0, 8.0, 31), np.linspace(0.2, 0.85, 31)
        ),
    )
    repeats = 20 if quick else 100

    def forward() -> object:
        return model.forward(parameters).block_until_ready()

    def jacobian() -> object:
        return model.forward_and_jacobian(parameters)[1].block_until_ready()

    return {
        "forward_ms": 1e3 * best_of(repeats, forward),
        "jacobian_ms": 1e3 * best_of(repeats, jacobian),
    }


THEIRS = """
import json, sys, time
import iadpython
given = json.load(sys.stdin)
rows, best = [], []
for a, b, g in zip(given["albedo"], given["depth"], given["g"]):
    times = []
    for _ in range(3):
        begin = time.perf_counter()
        sample = iadpython.Sample(a=a, b=b, g=g, n=given["n"], quad_pts=given["points"])
        row = [float(value) for value in sample.rt()[:4]]
        times.append(time.perf_counter() - begin)
    rows.append(row)
    best.append(min(times))
json.dump({"rows": rows, "seconds": sum(best) / len(best)}, sys.stdout)
"""


def by_iadpython(given: dict[str, object]) -> tuple[FloatArray, float]:
    """UR1, UT1, URU, UTU of every problem, and the time [s] of each.

    In a process of its own with one thread for linear algebra, which is what suits it best:
    beside JAX's threads it is several times slower.
    """
    done = subprocess.run(
        [sys.executable, "-c", THEIRS],
        input=json.dumps(given),
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    result = json.loads(done.stdout)
    return np.array(result["rows"]), float(result["seconds"])


def beside_iadpython(quick: bool) -> dict[str, object]:
    """Time per problem of UR1, UT1, URU and UTU, and what it buys."""
    import iadpython

    from twin.adding_doubling import slab_optics

    count, few, n = (200 if quick else 1000), (20 if quick else 60), 1.4
    rng = np.random.Generator(np.random.Philox(key=20261122))
    spans = ((0.5, 0.999), (0.5, 8.0), (0.0, 0.9))
    albedo, depth, g = (rng.uniform(low, high, count) for low, high in spans)

    def four(optics: Any) -> FloatArray:
        return np.stack([optics.UR1, optics.UT1, optics.URU, optics.UTU], axis=-1)

    fine = four(slab_optics(albedo[:few], depth[:few], g[:few], n, air=24, trapped=24))
    figures: dict[str, object] = {"iadpython": iadpython.__version__}
    for points, streams, suffix in ((16, OURS_FOR_16, ""), (8, OURS_FOR_8, "_8")):
        rows, their_time = by_iadpython(
            {
                "albedo": albedo[:few].tolist(),
                "depth": depth[:few].tolist(),
                "g": g[:few].tolist(),
                "n": n,
                "points": points,
            }
        )

        def ours(streams: tuple[int, int, int] = streams) -> FloatArray:
            air, trapped, orders = streams
            return four(slab_optics(albedo, depth, g, n, air=air, trapped=trapped, orders=orders))

        our_time = best_of(20, ours) / count
        figures[f"speed_ratio_iadpython{suffix}"] = their_time / our_time
        figures[f"microseconds{suffix}"] = 1e6 * our_time
        figures[f"microseconds_iadpython{suffix}"] = 1e6 * their_time
        figures[f"error{suffix}"] = float(np.abs(ours()[:few] - fine).max())
        figures[f"error_iadpython{suffix}"] = float(np.abs(rows - fine).max())
    return figures


def run(quick: bool) -> dict[str, object]:
    """Measure; see the module's docstring for the keys."""
    return {
        **reference_rows(quick),
        **times(quick),
        **beside_iadpython(quick),
        **against_monte_carlo(quick),
    }
