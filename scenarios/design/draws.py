"""Worlds that differ from a candidate's description by its tolerances, and their light.

The light of the described bench is the Monte Carlo's; a world with other thicknesses, index,
reflectances, view or panels has that light times the ratio of the fast engine in both. What acts
after the light is done to the signals of the simulated visit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from scenarios.design.media import Medium
from scenarios.design.modes import effect_parameter, is_private
from scenarios.design.optics import intensities, solved
from scenarios.design.parts import INPUTS
from twin.bench import Bench, Sample
from twin.cache import cache_folder, content_key, load_arrays, store_arrays
from twin.effects import FastLight, World
from twin.materials import reflectance
from twin.spectra import FloatArray
from twin.transport import NoiselessCaptures

NAMES = ("black", "white", "collimated")
KEPT = (*NAMES, "black_se", "white_se", "collimated_se", "rho_black", "rho_white")
"""Arrays of traced light that are kept."""


@dataclass(frozen=True, eq=False)
class Errors:
    """What is wrong in one draw, in units of the inputs and effects.

    Attributes:
        shared: by name.
        own: by name, one for each sample.
    """

    shared: Mapping[str, float]
    own: Mapping[str, FloatArray]


def drawn(scales: Mapping[str, float], samples: int, count: int, seed: int) -> list[Errors]:
    """Errors of `count` visits: normal, with exactly the stated second moments.

    Their matrix is made orthogonal: the scatter of a linear answer is then that of infinitely many
    draws, as long as there are more draws than errors (moment matching: Boyle, Broadie and
    Glasserman 1997, J. Econ. Dyn. Control 21, 1267).

    Args:
        scales: tolerances above 0 by name.
        samples: S of them.
        count: of draws.
        seed: the same seed gives the same draws.
    """
    columns = [(n, s) for n in scales for s in (range(samples) if is_private(n) else (-1,))]
    normal = np.random.Generator(np.random.Philox(key=[seed, 0x64657369])).standard_normal(
        (count, len(columns))
    )
    if columns and count >= len(columns):
        q, r = np.linalg.qr(normal)
        normal = q * np.sign(np.diagonal(r)) * np.sqrt(count)
    found = []
    for row in normal:
        shared: dict[str, float] = {}
        own: dict[str, FloatArray] = {}
        for (name, sample), value in zip(columns, row, strict=True):
            if sample < 0:
                shared[name] = float(value * scales[name])
            else:
                own.setdefault(name, np.zeros(samples))[sample] = value * scales[name]
        found.append(Errors(shared, own))
    return found


def world_of(bench: Bench, samples: Sequence[Sample], errors: Errors) -> World:
    """The world with the effects of one draw; an effect of one sign takes the size of its draw."""
    world = World.nominal(bench, samples)
    for name, value in errors.shared.items():
        if name not in INPUTS:
            world = _applied(world, name, value)
    for name, values in errors.own.items():
        if name not in INPUTS:
            for key, value in zip(world.sample_keys, values, strict=True):
                world = _applied(world, f"{name.partition('.')[0]}[{key}]", float(value))
    return world


def _applied(world: World, name: str, value: float) -> World:
    own, parameter = effect_parameter(name)
    size = value if parameter.sign == "any" else abs(value)
    size = -size if parameter.sign == "negative" else size
    return own.apply(world, {parameter.name: parameter.nominal + size})


def light_ratio(
    world: World, errors: Errors, number: int, medium: Medium, wavelength_nm: FloatArray
) -> FloatArray:
    """Light of a drawn world over that of the description by the fast engine, (W, 3)."""
    sample = world.described_samples[number]
    shift = float(errors.own.get("thickness_mm", np.zeros(number + 1))[number])
    shift += sample.thickness_mm * float(
        errors.own.get("thickness_relative", np.zeros(number + 1))[number]
    )
    described = world.described_bench
    if not (world.samples == world.described_samples and len(world.views()) == 1
            and not world.second_lobe[0]):  # fmt: skip
        mixed = [
            _fast(each, number, medium, wavelength_nm)
            for each in (world, World.nominal(described, world.described_samples))
        ]
        extra = _over(*mixed)
        bench = described
    else:
        extra, bench = np.ones((len(wavelength_nm), 3)), world.bench
    angle = described.detector.acceptance_deg * (1 + errors.shared.get("acceptance_relative", 0.0))
    moved = bench.model_copy(
        update={"detector": bench.detector.model_copy(update={"acceptance_deg": max(angle, 0.01)})}
    )
    true = _captures(
        moved, sample, shift, medium, wavelength_nm, errors.shared.get("n", 0.0),
        tuple(errors.shared.get(f"rho_{name}_relative", 0.0) for name in ("black", "white")),
    )  # fmt: skip
    plain = _captures(described, sample, 0.0, medium, wavelength_nm, 0.0, (0.0, 0.0))
    return np.asarray(extra * _over(true, plain))


def _over(true: FloatArray, plain: FloatArray) -> FloatArray:
    known = plain > 1e-12
    return np.asarray(np.where(known, true, 1.0) / np.where(known, plain, 1.0))


def _fast(world: World, number: int, medium: Medium, wavelength_nm: FloatArray) -> FloatArray:
    whole = FastLight(wavelength_nm).captures(world, medium.at(wavelength_nm))
    return np.asarray(whole[:, number])


def _captures(
    bench: Bench, sample: Sample, more_mm: float, medium: Medium, wavelength_nm: FloatArray,
    more_n: float, rho: tuple[float, ...],
) -> FloatArray:  # fmt: skip
    """Light (W, 3) of a sample and backgrounds that are off by so much; `rho` relative."""
    parts, _ = solved(
        bench, medium, sample.thickness_mm, wavelength_nm, more_mm=more_mm, more_n=more_n
    )
    both = (bench.background.black, bench.background.white)
    seen = [
        np.maximum(reflectance(each.reflectance, wavelength_nm) * (1.0 + change), 0.0)
        for each, change in zip(both, rho, strict=True)
    ]
    return intensities(parts, seen)


def traced(
    bench: Bench, sample: Sample, wavelength_nm: FloatArray, *, paths: int, seed: int,
    threads: int | None,
) -> NoiselessCaptures:  # fmt: skip
    """Light of one sample by the Monte Carlo, or from the cache: candidates share it."""
    from twin.transport import captures

    described = bench.model_dump(mode="json", exclude={"instrument"})
    key = content_key(
        {
            "version": 1, "bench": described, "paths": paths, "seed": seed,
            "sample": sample.model_dump(mode="json", exclude={"name"}),
            "wavelength_nm": wavelength_nm.tolist(),
        }
    )  # fmt: skip
    path = Path(cache_folder("design")) / f"{key}.light"
    stored = load_arrays(path, lambda text: None)
    if stored is not None:
        factor = float(stored.pop("factor"))
        return NoiselessCaptures(
            wavelength_nm=wavelength_nm, white_reference_factor=factor, **stored
        )
    own = int(key[:15], 16)
    found = captures(bench, sample, wavelength_nm, paths=paths, seed=own, threads=threads)
    arrays = {name: getattr(found, name) for name in KEPT}
    store_arrays(path, arrays | {"factor": np.array(found.white_reference_factor)})
    return found


def scaled(light: NoiselessCaptures, ratio: FloatArray) -> NoiselessCaptures:
    """Light times a ratio (W, 3), its standard errors too."""
    changed = {
        f"{name}{end}": getattr(light, f"{name}{end}") * ratio[:, row]
        for row, name in enumerate(NAMES)
        for end in ("", "_se")
    }
    return replace(light, **changed)
