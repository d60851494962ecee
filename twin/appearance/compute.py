"""Computing an appearance map by the Monte Carlo, or loading it from the cache."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twin.appearance.grid import MapGrid
from twin.appearance.smoothing import fine_enough, smoothed, smoothed_error
from twin.appearance.table import AppearanceMap
from twin.bench import Bench, Sample
from twin.cache import cache_folder, content_key, load_arrays, store_arrays
from twin.errors import InputError
from twin.materials import OpticalProperties, reflectance
from twin.spectra import FloatArray
from twin.transport import Effort, flat_stacks, run_many, trace
from twin.transport.engine import BLACK, WHITE, bounce_bins, mean_and_error
from twin.transport.geometry import beam_reference_share, beam_setup, panels_setup
from twin.transport.tables import FlatStack

MAP_VERSION = 5
NOMINAL_NM = 550.0
BLOCKS = 32


@dataclass(frozen=True)
class _Cell:
    """Result of one (sigma_t, g): arrays over albedo (A,) and bounce bins (B,)."""

    black: FloatArray
    white: FloatArray
    collimated: FloatArray
    errors: FloatArray


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
    sample = Sample(name="map", thickness_mm=thickness_mm, n=n)
    total = len(grid.sigma_t_per_mm) * len(grid.g)
    slabs = []
    for index, g in enumerate(grid.g):
        part = cache / f"{key}.g{index}.part"
        slab = load_arrays(part, say)
        if slab is None:
            before = index * len(grid.sigma_t_per_mm)

            def report(done: int, _: int, before: int = before) -> None:
                if progress is not None:
                    progress(before + done, total)

            slab = _slab(bench, sample, g, grid, paths, (seed, 2 * before), threads, report)
            store_arrays(part, slab)
        elif progress is not None:
            progress((index + 1) * len(grid.sigma_t_per_mm), total)
        slabs.append(slab)
    arrays = {
        name: np.stack([slab[name] for slab in slabs], axis=2)
        for name in ("black", "white", "collimated", "black_se", "white_se", "collimated_se")
    }
    arrays["exponent"] = slabs[0]["exponent"]
    if fine_enough(np.array(grid.sigma_t_per_mm)):
        step = float(np.log(grid.sigma_t_per_mm[1] / grid.sigma_t_per_mm[0]))
        _smooth(arrays, _nominal_rho(bench), step)
    arrays["albedo"], arrays["sigma_t"] = np.array(grid.albedo), np.array(grid.sigma_t_per_mm)
    arrays["g"], arrays["sample"] = np.array(grid.g), np.array([thickness_mm, n])
    store_arrays(path, arrays)
    for index in range(len(grid.g)):
        (cache / f"{key}.g{index}.part").unlink(missing_ok=True)
    return _from_arrays(arrays, key)


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
    albedo = np.array(grid.albedo)

    def cell(index: int, sigma_t: float) -> Callable[[], _Cell]:
        medium = OpticalProperties(nominal, np.zeros(1), np.array([sigma_t]), np.array([g]), None)
        stack = flat_stacks(bench, sample, nominal, medium)[0]
        return lambda: _cell(bench, stack, albedo, rho, paths, (seed, first_stream + 2 * index))

    cells = run_many([cell(i, s) for i, s in enumerate(grid.sigma_t_per_mm)], threads, progress)

    errors = np.stack([c.errors for c in cells], axis=2)
    return {
        "black": np.stack([c.black for c in cells], axis=1),
        "white": np.stack([c.white for c in cells], axis=1),
        "collimated": np.stack([c.collimated for c in cells], axis=1),
        "black_se": errors[0],
        "white_se": errors[1],
        "collimated_se": errors[2],
        "exponent": bounce_bins()[1],
    }


def thinning(stack: FlatStack) -> float:
    """Share of the paths that a cell gets.

    A path through an optically thick sample costs up to twenty times as much as one through a
    thin sample, while its relative variance is smaller; both get a similar error this way.
    """
    thick = float(np.sum(stack.sigma_t * stack.thickness))
    return float(np.clip(1.5 / max(thick, 1e-9), 0.0625, 1.0))


def _cell(
    bench: Bench,
    stack: FlatStack,
    albedo: FloatArray,
    rho: tuple[float, float],
    paths: int,
    random: tuple[int, int],
) -> _Cell:
    """One (sigma_t, g): panels and beam, all albedos, both backgrounds."""
    seed, stream = random
    log2_paths = max(4, round(np.log2(max(1, paths) * thinning(stack) / BLOCKS)))
    panels = trace(
        stack,
        panels_setup(bench, stack.height),
        Effort(BLOCKS, log2_paths),
        seed=seed,
        stream=stream,
    )
    beam = trace(
        stack,
        beam_setup(bench),
        Effort(BLOCKS, max(4, log2_paths - 4)),
        seed=seed,
        stream=stream + 1,
    )
    black = panels.blocks_by_albedo(BLACK, albedo)
    white = panels.blocks_by_albedo(WHITE, albedo)
    share = beam_reference_share(bench, stack.height)
    collimated, collimated_se = beam.estimate(BLACK, albedo)
    errors = np.stack(
        [
            mean_and_error(black @ rho[0] ** panels.bounce)[1],
            mean_and_error(white @ rho[1] ** panels.bounce)[1],
            collimated_se / share,
        ]
    )
    return _Cell(black.mean(axis=0), white.mean(axis=0), collimated / share, errors)


def _from_arrays(arrays: dict[str, FloatArray], key: str) -> AppearanceMap:
    thickness, n = arrays["sample"]
    return AppearanceMap(
        arrays["albedo"], arrays["sigma_t"], arrays["g"], float(thickness), float(n),
        arrays["exponent"], arrays["black"], arrays["white"], arrays["collimated"],
        arrays["black_se"], arrays["white_se"], arrays["collimated_se"], key,
    )  # fmt: skip
