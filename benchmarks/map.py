"""The appearance map: time and standard errors of 40 albedos x 60 sigma_t x 10 g.

One thickness (0.5 mm), n 1.5, a bare slab on the default bench, black, white and collimated.
`median_relative_error` is the median over all points and all three captures; the medians of
each capture are beside it. The seed (Iser et al. 2022, section 5.1) needed "less than a day".
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np


def run(quick: bool) -> dict[str, Any]:
    """Compute one map without a cache and report seconds and errors.

    Args:
        quick: a smaller grid with fewer paths.
    """
    from twin.appearance import MapGrid, appearance_map
    from twin.bench import Bench
    from twin.materials import reflectance
    from twin.transport import compile_kernels

    grid = MapGrid.spaced(20, 12, 4) if quick else MapGrid.spaced(40, 60, 10)
    paths = 4096 if quick else 32_768
    bench = Bench(covers_above=(), covers_below=())
    compile_kernels()
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        found = appearance_map(bench, 0.5, 1.5, grid=grid, paths=paths, folder=Path(folder))
        seconds = time.perf_counter() - start
    nominal = np.array([550.0])
    intensities = found.intensities(
        float(reflectance(bench.background.black.reflectance, nominal)[0]),
        float(reflectance(bench.background.white.reflectance, nominal)[0]),
    )
    errors = np.stack([found.black_se, found.white_se, found.collimated_se], axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        relative = np.where(intensities > 0, errors / intensities, 0.0)
    by_capture = np.median(relative, axis=(0, 1, 2))
    return {
        "points": int(np.prod(found.shape)),
        "paths_per_cell": paths,
        "seconds": seconds,
        "median_relative_error": float(np.median(relative)),
        "median_relative_error_black": float(by_capture[0]),
        "median_relative_error_white": float(by_capture[1]),
        "median_relative_error_collimated": float(by_capture[2]),
        "p90_relative_error": float(np.quantile(relative, 0.9)),
    }
