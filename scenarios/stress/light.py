"""Light of many materials at once: the Monte Carlo twin, one set of paths for many albedos.

What `twin.transport.captures` computes, with the same engine and set-ups; but points that differ
in albedo alone share their light paths (the weights of a path are a power series in albedo), and
every stack gets as many paths as its standard error asks for.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from scenarios.stress.design import derived_seed
from scenarios.stress.plan import Light
from twin.bench import Bench, Sample
from twin.cache import content_key, load_arrays, store_arrays
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from twin.transport import FlatStack, NoiselessCaptures, Tallies

LIGHT_VERSION = 1
BLOCKS, LOG2_PILOT, LOG2_PASS = 32, 9, 12
"""Blocks of one launch, and logarithms of the paths in a block: pilot, and one pass."""
PILOT, PANELS, BEAM = 0, 1, 2
"""Streams of random numbers of one stack. The beam gets fewer paths than the panels: its
unscattered light is exact."""
FIELDS = ("black", "white", "collimated", "black_se", "white_se", "collimated_se")


@dataclass(frozen=True, eq=False)
class _Group:
    """Points with one stack: they differ in albedo (and in the backgrounds) alone."""

    stack: FlatStack
    index: NDArray[np.int64]


def light_of(
    bench: Bench,
    sample: Sample,
    wavelength_nm: FloatArray,
    material: FloatArray,
    light: Light,
    *,
    seed: int,
    second_lobe: tuple[float, float] = (0.0, 0.0),
    folder: Path | None = None,
    threads: int | None = None,
) -> NoiselessCaptures:
    """Noiseless captures of W materials, one at each wavelength, computed or from the cache.

    Args:
        bench: the bench.
        sample: thickness and refractive index.
        wavelength_nm: where covers and backgrounds are looked up [nm], shape (W,).
        material: (albedo, sigma_t [1/mm], g) at each wavelength, shape (W, 3).
        light: standard error to reach, and the most paths.
        seed: the same seed gives the same bytes, whatever the number of threads.
        second_lobe: share and anisotropy factor of the phase function's second lobe.
        folder: of the cache; None computes without one.
        threads: None takes all processors.

    Raises:
        InputError: a spectrum of the bench does not cover a wavelength.
    """
    groups = _groups(bench, sample, wavelength_nm, material, second_lobe)
    key = light_key(bench, sample, wavelength_nm, material, light, seed, second_lobe)

    def traced(rho: Sequence[FloatArray]) -> dict[str, FloatArray]:
        return _traced(bench, groups, material[:, 0], rho, light, seed, threads)

    return kept_light(bench, groups[0].stack.height, wavelength_nm, traced, key, folder)


def kept_light(
    bench: Bench,
    height_mm: float,
    wavelength_nm: FloatArray,
    traced: Callable[[Sequence[FloatArray]], Mapping[str, FloatArray]],
    key: str,
    folder: Path | None,
) -> NoiselessCaptures:
    """Noiseless captures from the cache, or traced and put there.

    Args:
        bench: has the backgrounds and the reference plane.
        height_mm: of the stack [mm].
        wavelength_nm: [nm], shape (W,).
        traced: `FIELDS`, shape (W,) each, from the reflectances of black and white, (W,) each.
        key: content key of the light.
        folder: of the cache; None traces without one.

    Raises:
        InputError: a spectrum of the bench does not cover a wavelength, or the folder cannot be
            written.
    """
    from twin.materials import reflectance
    from twin.transport import NoiselessCaptures, reference_factor
    from twin.transport.geometry import reference_plane_mm

    rho = [
        reflectance(background.reflectance, wavelength_nm)
        for background in (bench.background.black, bench.background.white)
    ]
    path = folder / f"{key}.light" if folder is not None else None
    found = load_arrays(path, lambda text: None) if path is not None else None
    if found is None:
        found = dict(traced(rho))
        if path is not None:
            store_arrays(path, found)
    return NoiselessCaptures(
        wavelength_nm=wavelength_nm,
        rho_black=rho[0],
        rho_white=rho[1],
        white_reference_factor=reference_factor(bench, reference_plane_mm(bench, height_mm)),
        **{name: found[name] for name in FIELDS},
    )


def light_key(
    bench: Bench,
    sample: Sample,
    wavelength_nm: FloatArray,
    material: FloatArray,
    light: Light,
    seed: int,
    second_lobe: tuple[float, float] = (0.0, 0.0),
) -> str:
    """Content key of the light: everything that it depends on, the engine by its version."""
    from twin.appearance.compute import MAP_VERSION

    described = bench.model_dump(mode="json", exclude={"instrument", "panel_spectrum"})
    described["beam"].pop("spectrum", None)
    return content_key(
        {
            "version": LIGHT_VERSION,
            "engine": MAP_VERSION,
            "bench": described,
            "thickness_mm": sample.thickness_mm,
            "n": sample.model_dump(mode="json")["n"],
            "wavelength_nm": wavelength_nm.tolist(),
            "material": material.tolist(),
            "light": light.model_dump(mode="json"),
            "seed": seed,
            **({"second_lobe": second_lobe} if second_lobe[0] else {}),
        }
    )


def _groups(
    bench: Bench,
    sample: Sample,
    wavelength_nm: FloatArray,
    material: FloatArray,
    second_lobe: tuple[float, float],
) -> list[_Group]:
    from twin.materials import OpticalProperties
    from twin.transport import flat_stacks

    albedo, sigma_t, g = material.T
    medium = OpticalProperties(wavelength_nm, albedo, sigma_t, g, None, *second_lobe)
    stacks = flat_stacks(bench, sample, wavelength_nm, medium)
    alike: dict[bytes, list[int]] = {}
    for index, stack in enumerate(stacks):
        key = np.concatenate([stack.n, stack.sigma_t, stack.g, stack.albedo]).tobytes()
        alike.setdefault(key, []).append(index)
    return [_Group(stacks[index[0]], np.array(index)) for index in alike.values()]


def _traced(
    bench: Bench,
    groups: Sequence[_Group],
    albedo: FloatArray,
    rho: Sequence[FloatArray],
    light: Light,
    seed: int,
    threads: int | None,
) -> dict[str, FloatArray]:
    """Arrays of `FIELDS`, shape (W,) each."""
    from twin.transport import run_many

    def job(number: int, group: _Group) -> Callable[[], FloatArray]:
        own = derived_seed(seed, number)
        mine = group.index
        return lambda: _group_light(
            bench, group.stack, albedo[mine], rho[0][mine], rho[1][mine], light, own
        )

    found = run_many([job(i, group) for i, group in enumerate(groups)], threads)
    table = np.empty((len(FIELDS), len(albedo)))
    for group, values in zip(groups, found, strict=True):
        table[:, group.index] = values
    return dict(zip(FIELDS, table, strict=True))


def _group_light(
    bench: Bench,
    stack: FlatStack,
    albedo: FloatArray,
    rho_black: FloatArray,
    rho_white: FloatArray,
    light: Light,
    seed: int,
) -> FloatArray:
    """`FIELDS` of points that share a stack, shape (6, A)."""
    from twin.transport import beam_setup, panels_setup
    from twin.transport.engine import BLACK, WHITE
    from twin.transport.geometry import beam_reference_share

    top = float(albedo.max())
    panels, beam = panels_setup(bench, stack.height), beam_setup(bench)

    def readings(tallies: Tallies) -> tuple[FloatArray, FloatArray]:
        pairs = [
            tallies.estimate(channel, albedo[i : i + 1], float(rho[i]))
            for channel, rho in ((BLACK, rho_black), (WHITE, rho_white))
            for i in range(albedo.size)
        ]
        values, errors = np.array(pairs)[..., 0].T.reshape(2, 2, -1)
        return values, errors

    size = max(4, min(LOG2_PASS, int(math.log2(light.most_paths / BLOCKS))))
    small = min(LOG2_PILOT, size)
    wanted = times_wanted(*readings(_passes(stack, panels, top, small, 1, seed, PILOT)), light)
    most = light.most_paths // (BLOCKS << size)
    passes = max(1, min(math.ceil(wanted * 2.0 ** (small - size)), most))
    values, errors = readings(_passes(stack, panels, top, size, passes, seed, PANELS))
    through = _passes(stack, beam, top, max(4, size - 2), max(1, passes // 4), seed, BEAM)
    share = beam_reference_share(bench, stack.height)
    collimated, collimated_se = through.estimate(BLACK, albedo)
    return np.stack([*values, collimated / share, *errors, collimated_se / share])


def times_wanted(value: FloatArray, error: FloatArray, light: Light) -> float:
    """How many times the pilot's paths make the worse of black and white exact enough, (2, A)."""
    relative = np.where(value > 0, error / np.where(value > 0, value, 1.0), 0.0)
    worst = float(np.sqrt((relative**2).mean(axis=1)).max())
    return (worst / light.relative_error) ** 2


def _passes(
    stack: FlatStack, setup: Any, top: float, log2_paths: int, passes: int, seed: int, stream: int
) -> Tallies:
    """Several launches of `BLOCKS` blocks as one result: small ones need little memory."""
    from twin.transport import Tallies, trace
    from twin.transport.bench_captures import effort_for

    effort = replace(effort_for(top, BLOCKS << log2_paths), blocks=BLOCKS, log2_paths=log2_paths)
    value = [
        trace(
            stack,
            setup,
            effort,
            seed=seed,
            stream=stream,
            first_block=BLOCKS * number,
            device="cpu",
        ).value
        for number in range(passes)
    ]
    return Tallies(np.concatenate(value), None, None)
