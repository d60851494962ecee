"""Speed of the estimators that use the fast engine: least squares, and the posterior.

Keys:

- `lsq_1000_s`: 1000 wavelengths x 2 thicknesses of a material whose spectrum is smooth, as a
  spectrometer sees it, with 0.5 % noise; warm, all cores, wall clock. `lsq_1000_cpu_s`: the
  processor time of the same run, which says less about who else was busy.
- `lsq_1000_random_s`, `lsq_1000_random_cpu_s`: the same with a material drawn anew for every
  wavelength, so that no neighbour helps.
- `lsq_31_ms`: 31 wavelengths.
- `lsq_cold_s`: the first estimate, engine compiled or read from the compilation cache.
- `posterior_*`, `min_ess`: see `benchmarks.posterior_speed`.
- `lsq_settled`: share of wavelengths that settled; `lsq_median_error_*`: against the truth.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from twin.spectra import FloatArray

if TYPE_CHECKING:
    from estimators.least_squares import LeastSquaresEstimator

NOISE, FLOOR = 0.005, 1e-4


def best_of(repeats: int, task: Callable[[], object]) -> tuple[float, float]:
    """Shortest wall-clock time [s] of several runs, and its processor time [s]."""
    times = []
    for _ in range(repeats):
        wall, cpu = time.perf_counter(), time.process_time()
        task()
        times.append((time.perf_counter() - wall, time.process_time() - cpu))
    return min(times)


def least_squares(count: int) -> LeastSquaresEstimator:
    """An estimator of the default bench with two samples."""
    from estimators import BenchModel
    from estimators.least_squares import LeastSquaresEstimator
    from twin.bench import Bench, Sample

    samples = [Sample(name=f"{h:g} mm", thickness_mm=h, n=1.5) for h in (0.4, 0.8)]
    model = BenchModel.of(Bench(), samples, np.linspace(400.0, 750.0, count))
    return LeastSquaresEstimator(model)


def run(quick: bool) -> dict[str, object]:
    """Time least squares; see the module for the keys.

    Args:
        quick: a tenth of the wavelengths, under the same keys.
    """
    from benchmarks import posterior_speed
    from estimators import Status
    from tests.estimators.least_squares_world import materials, smooth_material, visit

    count = 100 if quick else 1000
    made = least_squares(count)
    truth = smooth_material(count)
    begin = time.perf_counter()
    seen = visit(made, truth, noise=NOISE, floor=FLOOR)
    result = made.estimate(seen)
    cold = time.perf_counter() - begin
    wall, cpu = best_of(5, lambda: made.estimate(seen))
    scattered = visit(made, materials(count), noise=NOISE, floor=FLOOR)
    made.estimate(scattered)
    random_wall, random_cpu = best_of(3, lambda: made.estimate(scattered))
    few = least_squares(31)
    some = visit(few, smooth_material(31), noise=NOISE, floor=FLOOR)
    few.estimate(some)
    few_wall, _ = best_of(5, lambda: few.estimate(some))
    errors: FloatArray = np.median(np.abs(result.parameters - truth), axis=0)
    return {
        "wavelengths": count,
        "lsq_1000_s": wall,
        "lsq_1000_cpu_s": cpu,
        "lsq_1000_random_s": random_wall,
        "lsq_1000_random_cpu_s": random_cpu,
        "lsq_31_ms": 1e3 * few_wall,
        "lsq_cold_s": cold,
        "lsq_settled": float(np.mean(result.status != Status.NOT_CONVERGED)),
        "lsq_median_error_albedo": float(errors[0]),
        "lsq_median_error_sigma_t_per_mm": float(errors[1]),
        "lsq_median_error_g": float(errors[2]),
        "statuses": result.counts(),
        **posterior_speed.run(quick),
    }
