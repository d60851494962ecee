"""The appearance maps of some samples: from the cache, computed here, or spread over workers."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.console import Console
from scenarios.scenario import MapSettings
from scenarios.sweep import Workers, sweep
from twin.bench import Bench, Sample
from twin.cache import cache_folder, content_key, load_arrays, store_arrays
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from twin.appearance import AppearanceMap, MapGrid

TASK = "scenarios.maps:slab"


def appearance_maps(
    bench: Bench,
    samples: tuple[Sample, ...],
    wavelength_nm: FloatArray,
    settings: MapSettings,
    *,
    cache: Path | None,
    threads: int | None,
    console: Console,
    workers: Workers | None = None,
) -> tuple[AppearanceMap, ...]:
    """One map per sample, computed or from the cache; the same bytes whoever computes it.

    Args:
        bench: around the samples.
        samples: S of them.
        wavelength_nm: wavelengths [nm], shape (W,), over which the refractive index is averaged.
        settings: grid and quality.
        cache: folder of the maps; None takes the user's.
        threads: threads of the Monte Carlo in this process.
        console: is told what happens.
        workers: compute the parts of missing maps side by side; None or serial: this process.

    Raises:
        InputError: a folder that cannot be written, or workers that cannot be had.
    """
    from twin.appearance import appearance_map
    from twin.materials import refractive_index

    grid = _grid(settings)
    sizes = [
        (sample.thickness_mm, float(np.mean(refractive_index(sample.n, wavelength_nm))))
        for sample in samples
    ]
    distinct = list(dict.fromkeys(sizes))
    if workers is not None and workers.engine != "serial":
        spread(bench, distinct, grid, settings.paths, cache=cache, workers=workers, console=console)
    maps: dict[tuple[float, float], AppearanceMap] = {}
    for size in distinct:
        with console.step(f"appearance map of {size[0]:g} mm") as progress:
            maps[size] = appearance_map(
                bench,
                *size,
                grid=grid,
                paths=settings.paths,
                threads=threads,
                folder=cache,
                progress=progress,
                say=console.say,
            )
    return tuple(maps[size].refined() for size in sizes)


def spread(
    bench: Bench,
    sizes: list[tuple[float, float]],
    grid: MapGrid,
    paths: int,
    *,
    cache: Path | None,
    workers: Workers,
    console: Console,
) -> None:
    """Let workers compute what the cache lacks of some maps; a killed run goes on where it was.

    Every worker keeps what it made in the cache that it sees, under content keys, so that machines
    with one cache folder share it; where they do not share one, the parts travel back.

    Args:
        bench: around the samples.
        sizes: (thickness [mm], refractive index) of every map.
        grid: of the maps.
        paths: of the maps.
        cache: folder of the maps; None takes the user's, on every machine its own.
        workers: who works.
        console: is told what happens.

    Raises:
        InputError: the workers cannot be had, or a folder cannot be written.
    """
    from twin.appearance import MAP_VERSION, map_key, slab_path

    folder = cache or cache_folder("maps")
    wanted: list[tuple[Path, dict[str, Any]]] = []
    for size in sizes:
        key = map_key(bench, *size, grid, paths, 0)
        if load_arrays(folder / f"{key}.map", console.say) is not None:
            continue
        for index in range(len(grid.g)):
            path = slab_path(folder, key, index)
            if load_arrays(path, console.say) is None:
                wanted.append((path, _point(bench, size, grid, paths, index, cache)))
    if not wanted:
        return
    points = [point for _, point in wanted]
    ledger = folder / "sweeps" / content_key({"points": points})
    version = str(MAP_VERSION)
    done = sweep(
        TASK, points, ledger, version=version, workers=workers, console=console,
        title=f"appearance maps of {', '.join(f'{size[0]:g}' for size in sizes)} mm",
    )  # fmt: skip
    for (path, _), found in zip(wanted, done.results(), strict=True):
        if found is not None and not path.exists():
            store_arrays(path, found)
    for failure in done.failures:
        console.say(f"a part of a map failed ({failure.message}); it is computed here")
    shutil.rmtree(ledger, ignore_errors=True)


def slab(point: dict[str, Any]) -> dict[str, FloatArray]:
    """One anisotropy factor of one map, on one thread: the task of the sweep."""
    from twin.appearance import MapGrid, map_slab

    return map_slab(
        Bench.model_validate(point["bench"]),
        point["thickness_mm"],
        point["n"],
        point["index"],
        grid=MapGrid.model_validate(point["grid"]),
        paths=point["paths"],
        threads=1,
        folder=Path(point["folder"]) if point["folder"] else None,
    )


def _grid(settings: MapSettings) -> MapGrid:
    from twin.appearance import MapGrid

    return MapGrid.spaced(
        settings.albedo_count,
        settings.sigma_t_count,
        settings.g_count,
        sigma_range=settings.sigma_t_range_per_mm,
        g_range=settings.g_range,
        albedo_top=settings.albedo_top,
    )


def _point(
    bench: Bench,
    size: tuple[float, float],
    grid: MapGrid,
    paths: int,
    index: int,
    cache: Path | None,
) -> dict[str, Any]:
    return {
        "bench": bench.model_dump(mode="json"),
        "thickness_mm": size[0],
        "n": size[1],
        "grid": grid.model_dump(mode="json"),
        "paths": paths,
        "index": index,
        "folder": str(cache.absolute()) if cache is not None else "",
    }
