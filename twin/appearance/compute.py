"""Computing an appearance map by the Monte Carlo, or loading it from the cache."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from twin.appearance.cells import Cell, add_plane, factors_of, trace_cell
from twin.appearance.grid import MapGrid
from twin.appearance.plane import plane_parts, representable
from twin.appearance.smoothing import fine_enough, smoothed, smoothed_error
from twin.appearance.table import AppearanceMap
from twin.bench import Bench, Sample
from twin.cache import cache_folder, content_key, load_arrays, store_arrays
from twin.errors import InputError
from twin.materials import OpticalProperties, reflectance
from twin.spectra import FloatArray
from twin.transport import flat_stacks, run_many
from twin.transport.engine import bounce_bins

MAP_VERSION = 7
NOMINAL_NM = 550.0


def map_key(
    bench: Bench, thickness_mm: float, n: float, grid: MapGrid, paths: int, seed: int
) -> str:
    """Content key of a map: SHA-256 over everything that its values depend on."""
    described = bench.model_dump(mode="json", exclude={"instrument", "panel_spectrum"})
    described["beam"].pop("spectrum", None)
    for name in ("black", "white"):
        # the map holds every reflectance; the nominal one only chooses where errors are stated
        described["background"][name]["reflectance"] = None
    return content_key(
        {
            "version": MAP_VERSION,
            "bench": described,
            "thickness_mm": thickness_mm,
            "n": n,
            "grid": grid.model_dump(mode="json"),
            "paths": paths,
            "seed": seed,
        }
    )


def appearance_map(
    bench: Bench,
    thickness_mm: float,
    n: float,
    *,
    grid: MapGrid | None = None,
    paths: int = 32_768,
    seed: int = 0,
    threads: int | None = None,
    folder: Path | None = None,
    progress: Callable[[int, int], None] | None = None,
    say: Callable[[str], None] | None = None,
) -> AppearanceMap:
    """Compute a map, or load it from the cache.

    What is finished is kept: an interrupted computation resumes with the next value of g.

    Args:
        bench: the bench; its instrument, lamps and reflectances do not matter.
        thickness_mm: of the sample [mm].
        n: refractive index of the sample.
        grid: where to compute; None takes `MapGrid.spaced()`.
        seed: the same seed gives the same bytes.
        threads: None takes all processors.
        paths: per (sigma_t, g) of an optically thin sample; thick ones get down to a sixteenth.
            Rounded to 32 times a power of two.
        folder: cache folder; None takes the user's.
        progress: called with (done, total) cells of (sigma_t, g).
        say: told in one sentence about damaged files that are computed again.

    Raises:
        InputError: thickness or index out of range, or a folder that cannot be written.
    """
    if not thickness_mm > 0:
        raise InputError(f"{thickness_mm:g} mm", "a thickness above 0 mm", place="thickness_mm")
    grid = grid or MapGrid.spaced()
    key = map_key(bench, thickness_mm, n, grid, paths, seed)
    cache = folder or cache_folder("maps")
    path = cache / f"{key}.map"
    say = say or (lambda text: None)
    stored = load_arrays(path, say)
    if stored is not None:
        return _from_arrays(stored, key)
    total = len(grid.sigma_t_per_mm) * len(grid.g)
    slabs = []
    for index in range(len(grid.g)):
        before = index * len(grid.sigma_t_per_mm)

        def report(done: int, _: int, before: int = before) -> None:
            if progress is not None:
                progress(before + done, total)

        slabs.append(
            map_slab(
                bench, thickness_mm, n, index, grid=grid, paths=paths, seed=seed, threads=threads,
                folder=cache, progress=report, say=say,
            )
        )  # fmt: skip
    arrays = {
        name: np.stack([slab[name] for slab in slabs], axis=2)
        for name in ("black", "white", "collimated", "black_se", "white_se", "collimated_se")
    }
    arrays["exponent"] = slabs[0]["exponent"]
    if representable(bench):
        arrays["factors"] = np.stack([slab["factors"] for slab in slabs], axis=3)
    if not representable(bench) and fine_enough(np.array(grid.sigma_t_per_mm)):
        step = float(np.log(grid.sigma_t_per_mm[1] / grid.sigma_t_per_mm[0]))
        _smooth(arrays, _nominal_rho(bench), step)
    arrays["albedo"], arrays["sigma_t"] = np.array(grid.albedo), np.array(grid.sigma_t_per_mm)
    arrays["g"], arrays["sample"] = np.array(grid.g), np.array([thickness_mm, n])
    store_arrays(path, arrays)
    for index in range(len(grid.g)):
        slab_path(cache, key, index).unlink(missing_ok=True)
    return _from_arrays(arrays, key)


def map_slab(
    bench: Bench,
    thickness_mm: float,
    n: float,
    index: int,
    *,
    grid: MapGrid,
    paths: int,
    seed: int = 0,
    threads: int | None = None,
    folder: Path | None = None,
    progress: Callable[[int, int], None] | None = None,
    say: Callable[[str], None] | None = None,
) -> dict[str, FloatArray]:
    """All cells of one anisotropy factor of a map, computed or from the cache.

    A map is made of these; machines that share a cache folder can compute them side by side, since
    files are named by what they hold and replaced whole.

    Args:
        bench: as for `appearance_map`, like all that is not said here.
        thickness_mm: of the sample [mm].
        n: refractive index of the sample.
        index: which of the grid's anisotropy factors.
        grid: of the whole map.
        paths: of the whole map.
        seed: of the whole map.
        threads: None takes all processors.
        folder: cache folder; None takes the user's.
        progress: called with (done, total) extinction coefficients.
        say: told in one sentence about a damaged file, which is computed again.

    Returns:
        arrays over (albedo, sigma_t), some with more axes: what a map keeps.

    Raises:
        InputError: a folder that cannot be written.
    """
    cache = folder or cache_folder("maps")
    part = slab_path(cache, map_key(bench, thickness_mm, n, grid, paths, seed), index)
    slab = load_arrays(part, say or (lambda text: None))
    cells = len(grid.sigma_t_per_mm)
    report = progress or (lambda done, total: None)
    if slab is None:
        sample = Sample(name="map", thickness_mm=thickness_mm, n=n)
        streams = (seed, 2 * index * cells)
        slab = _slab(bench, sample, grid.g[index], grid, paths, streams, threads, report)
        store_arrays(part, slab)
    else:
        report(cells, cells)
    return slab


def slab_path(cache: Path, key: str, index: int) -> Path:
    """The file of one anisotropy factor of the map with this key, until the map is whole."""
    return cache / f"{key}.g{index}.part"


def _nominal_rho(bench: Bench) -> tuple[float, float]:
    """Reflectances of the black and the white background at 550 nm."""
    nominal = np.array([NOMINAL_NM])
    return (
        float(reflectance(bench.background.black.reflectance, nominal)[0]),
        float(reflectance(bench.background.white.reflectance, nominal)[0]),
    )


def _smooth(arrays: dict[str, FloatArray], rho: tuple[float, float], step: float) -> None:
    """Replace black and white by their local regression over ln sigma_t, errors included.

    The collimated capture is left alone: its unscattered part is exact already.
    """
    for name, reflects in (("black", rho[0]), ("white", rho[1])):
        before = arrays[name]
        arrays[name], use = smoothed(before, step)
        powers = reflects ** arrays["exponent"]
        total, total_after = before @ powers, arrays[name] @ powers
        # an error is halved only where all but 1 % of the light was smoothed
        kept = np.where(use, 0.0, np.abs(before)) @ powers <= 0.01 * total
        lit = total > 0.0
        relative = np.where(lit, arrays[f"{name}_se"] / np.where(lit, total, 1.0), 0.0)
        arrays[f"{name}_se"] = smoothed_error(relative, kept, step) * total_after


def _slab(
    bench: Bench,
    sample: Sample,
    g: float,
    grid: MapGrid,
    paths: int,
    random: tuple[int, int],
    threads: int | None,
    progress: Callable[[int, int], None],
) -> dict[str, FloatArray]:
    """All cells of one g, as arrays over (albedo, sigma_t); random: seed and first stream."""
    seed, first_stream = random
    nominal = np.array([NOMINAL_NM])
    rho = _nominal_rho(bench)
    albedo, sigma_t = np.array(grid.albedo), np.array(grid.sigma_t_per_mm)
    paired = representable(bench)

    def cell(index: int) -> Callable[[], Cell]:
        medium = OpticalProperties(nominal, np.zeros(1), sigma_t[[index]], np.array([g]), None)
        stack = flat_stacks(bench, sample, nominal, medium)[0]
        random = (seed, first_stream + 2 * index)
        return lambda: trace_cell(bench, stack, albedo, rho, paths, random, paired)

    cells = run_many([cell(index) for index in range(len(sigma_t))], threads, progress)
    slab = {
        name: np.stack([getattr(c, name) for c in cells], axis=1)
        for name in ("black", "white", "collimated", "unscattered")
    }
    errors = np.stack([c.errors for c in cells], axis=2)
    if paired:
        n = float(np.asarray(sample.n))
        where = (bench, sample.thickness_mm, n, albedo, sigma_t, g)
        plane = plane_parts(*where)
        straight = bench.beam.straight
        add_plane(slab, errors, plane, rho, sigma_t, straight)
        slab["factors"] = factors_of(slab, plane_parts(*where, fast=True))
    slab |= {f"{name}_se": errors[row] for row, name in enumerate(("black", "white", "collimated"))}
    slab["exponent"] = bounce_bins()[1]
    return slab


def _from_arrays(arrays: dict[str, FloatArray], key: str) -> AppearanceMap:
    thickness, n = arrays["sample"]
    return AppearanceMap(
        arrays["albedo"], arrays["sigma_t"], arrays["g"], float(thickness), float(n),
        arrays["exponent"], arrays["black"], arrays["white"], arrays["collimated"],
        arrays["black_se"], arrays["white_se"], arrays["collimated_se"], key,
        arrays.get("factors"),
    )  # fmt: skip
