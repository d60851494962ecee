"""The appearance map: what the bench reads for every (albedo, sigma_t, g) of a thin sample.

Iser et al. 2022, section 3: the map relates (I_black, I_white, I_collimated) to (albedo,
sigma_t, g) for one thickness, refractive index and bench. One set of paths per (sigma_t, g)
serves all albedos, and the map keeps the powers of the backgrounds' reflectance apart, so one
map serves every wavelength whatever the backgrounds' spectra.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from pydantic import field_validator

from twin.bench import Bench, Sample
from twin.cache import cache_folder, content_key, load_arrays, store_arrays
from twin.errors import InputError
from twin.materials import OpticalProperties, reflectance
from twin.spectra import FloatArray, Part
from twin.transport import Effort, flat_stacks, run_many, trace
from twin.transport.engine import BLACK, WHITE, bounce_bins, mean_and_error
from twin.transport.geometry import beam_reference_share, beam_setup, panels_setup
from twin.transport.tables import FlatStack

MAP_VERSION = 1
NOMINAL_NM = 550.0
BLOCKS = 32


class MapGrid(Part):
    """Where the map is computed; every axis increases."""

    albedo: tuple[float, ...]
    """Single-scattering albedos, 0 to 1."""
    sigma_t_per_mm: tuple[float, ...]
    """Extinction coefficients [1/mm], above 0."""
    g: tuple[float, ...]
    """Anisotropy factors, inside -1 to 1."""

    @field_validator("albedo", "sigma_t_per_mm", "g")
    @classmethod
    def _increasing(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if len(value) < 2 or np.any(np.diff(value) <= 0):
            raise ValueError("found values that do not increase; expected two or more that do")
        return value

    @field_validator("albedo")
    @classmethod
    def _albedo(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if value[0] < 0.0 or value[-1] > 1.0:
            raise ValueError(f"found albedos {value[0]:g} to {value[-1]:g}; expected 0 to 1")
        return value

    @field_validator("sigma_t_per_mm")
    @classmethod
    def _sigma(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if value[0] <= 0.0:
            raise ValueError(f"found sigma_t {value[0]:g} per mm; expected values above 0")
        return value

    @field_validator("g")
    @classmethod
    def _g(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if value[0] <= -1.0 or value[-1] >= 1.0:
            raise ValueError(f"found g {value[0]:g} to {value[-1]:g}; expected inside -1 to 1")
        return value

    @classmethod
    def spaced(
        cls,
        albedos: int = 40,
        sigmas: int = 60,
        gs: int = 10,
        *,
        sigma_range: tuple[float, float] = (0.05, 50.0),
        g_range: tuple[float, float] = (0.0, 0.9),
        albedo_top: float = 0.9999,
    ) -> MapGrid:
        """Albedos from 0, even in log(1 - albedo); extinction even in log; g even.

        Finer towards albedo 1, as in Iser et al. 2022, section 4.3.
        """
        albedo = 1.0 - np.geomspace(1.0, 1.0 - albedo_top, albedos)
        sigma = np.geomspace(*sigma_range, sigmas)
        return cls(
            albedo=tuple(albedo.tolist()),
            sigma_t_per_mm=tuple(sigma.tolist()),
            g=tuple(np.linspace(*g_range, gs).tolist()),
        )


@dataclass(frozen=True)
class AppearanceMap:
    """A computed map.

    Attributes:
        albedo (A,), sigma_t_per_mm (S,) [1/mm], g (G,): the grid.
        thickness_mm: of the sample [mm]; n: its refractive index.
        exponent: powers of the background's reflectance, (B,).
        black_series, white_series: coefficients of rho**exponent, (A, S, G, B).
        collimated: (A, S, G).
        black_se, white_se, collimated_se: standard errors at the bench's own backgrounds at
            550 nm, (A, S, G).
        key: content key of everything that the map depends on.
    """

    albedo: FloatArray
    sigma_t_per_mm: FloatArray
    g: FloatArray
    thickness_mm: float
    n: float
    exponent: FloatArray
    black_series: FloatArray
    white_series: FloatArray
    collimated: FloatArray
    black_se: FloatArray
    white_se: FloatArray
    collimated_se: FloatArray
    key: str = ""

    @cached_property
    def shape(self) -> tuple[int, int, int]:
        """(A, S, G)."""
        return len(self.albedo), len(self.sigma_t_per_mm), len(self.g)

    def intensities(self, rho_black: float, rho_white: float) -> FloatArray:
        """I_black, I_white, I_collimated at the grid, (A, S, G, 3), for two reflectances."""
        return np.stack(
            [
                self.black_series @ float(rho_black) ** self.exponent,
                self.white_series @ float(rho_white) ** self.exponent,
                self.collimated,
            ],
            axis=-1,
        )


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
        paths: per (sigma_t, g), rounded to 32 times a power of two.
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

            slab = _slab(bench, sample, g, grid, paths, seed, threads, report)
            store_arrays(part, slab)
        elif progress is not None:
            progress((index + 1) * len(grid.sigma_t_per_mm), total)
        slabs.append(slab)
    arrays = {
        name: np.stack([slab[name] for slab in slabs], axis=2)
        for name in ("black", "white", "collimated", "black_se", "white_se", "collimated_se")
    }
    arrays["exponent"] = slabs[0]["exponent"]
    arrays["albedo"], arrays["sigma_t"] = np.array(grid.albedo), np.array(grid.sigma_t_per_mm)
    arrays["g"], arrays["sample"] = np.array(grid.g), np.array([thickness_mm, n])
    store_arrays(path, arrays)
    for index in range(len(grid.g)):
        (cache / f"{key}.g{index}.part").unlink(missing_ok=True)
    return _from_arrays(arrays, key)


def _slab(
    bench: Bench,
    sample: Sample,
    g: float,
    grid: MapGrid,
    paths: int,
    seed: int,
    threads: int | None,
    progress: Callable[[int, int], None],
) -> dict[str, FloatArray]:
    """All cells of one g, as arrays over (albedo, sigma_t)."""
    nominal = np.array([NOMINAL_NM])
    rho = (
        float(reflectance(bench.background.black.reflectance, nominal)[0]),
        float(reflectance(bench.background.white.reflectance, nominal)[0]),
    )
    albedo = np.array(grid.albedo)

    def cell(sigma_t: float) -> Callable[[], _Cell]:
        medium = OpticalProperties(nominal, np.zeros(1), np.array([sigma_t]), np.array([g]), None)
        stack = flat_stacks(bench, sample, nominal, medium)[0]
        return lambda: _cell(bench, stack, albedo, rho, paths, seed)

    cells = run_many([cell(s) for s in grid.sigma_t_per_mm], threads, progress)

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


def _cell(
    bench: Bench,
    stack: FlatStack,
    albedo: FloatArray,
    rho: tuple[float, float],
    paths: int,
    seed: int,
) -> _Cell:
    """One (sigma_t, g): panels and beam, all albedos, both backgrounds."""
    log2_paths = max(4, round(np.log2(max(1, paths) / BLOCKS)))
    panels = trace(
        stack, panels_setup(bench, stack.height), Effort(BLOCKS, log2_paths), seed=seed, stream=1
    )
    beam = trace(
        stack, beam_setup(bench), Effort(BLOCKS, max(4, log2_paths - 4)), seed=seed, stream=2
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
