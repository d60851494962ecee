"""The light of one visit of a stress test, as described or with effects, by the Monte Carlo."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.stress.light import FIELDS, kept_light, light_key, light_of, times_wanted
from scenarios.stress.plan import Light
from twin.cache import content_key
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from twin.bench import Layer
    from twin.effects import View, World
    from twin.transport import NoiselessCaptures

PILOT_PATHS = 1 << 12
"""Paths that tell how many more are needed where every point has paths of its own."""


def sample_light(
    world: World,
    number: int,
    wavelength_nm: FloatArray,
    material: FloatArray,
    light: Light,
    *,
    seed: int,
    folder: Path | None = None,
    threads: int | None = None,
) -> NoiselessCaptures:
    """Noiseless captures of one sample of a world, W materials, one at each wavelength.

    The same seed serves all worlds, so that they differ by their effects and hardly by the error
    of the light. Points share paths (`light_of`), also where captures are averaged over benches or
    thicknesses; only where the inside of the samples falls into layers has each its own.

    Args:
        world: what is true.
        number: of the sample.
        wavelength_nm: [nm], shape (W,).
        material: (albedo, sigma_t [1/mm], g) at each wavelength, shape (W, 3).
        light: standard error to reach, and the most paths.
        seed: of the paths.
        folder: of the cache; None computes without one.
        threads: None takes all processors.

    Raises:
        InputError: a spectrum of the bench does not cover a wavelength.
    """
    if world.sublayers:
        return _layered(world, number, wavelength_nm, material, light, seed, folder, threads)
    views = world.views()
    parts = [
        light_of(
            view.bench,
            view.samples[number],
            wavelength_nm,
            material,
            light,
            seed=seed,
            second_lobe=world.second_lobe,
            folder=folder,
            threads=threads,
        )
        for view in views
    ]
    return parts[0] if len(views) == 1 else _averaged(parts, views)


def _averaged(parts: Sequence[NoiselessCaptures], views: Sequence[View]) -> NoiselessCaptures:
    """Weighted mean; errors of one seed are alike and add up."""
    weight = np.array([view.weight for view in views])
    fields = {}
    for column, name in enumerate(FIELDS[:3]):
        for field in (name, f"{name}_se"):
            rows = np.stack([getattr(part, field) for part in parts])
            fields[field] = weight[:, column] @ rows
    return replace(parts[0], **fields)


def _layered(
    world: World,
    number: int,
    wavelength_nm: FloatArray,
    material: FloatArray,
    light: Light,
    seed: int,
    folder: Path | None,
    threads: int | None,
) -> NoiselessCaptures:
    """One sample whose inside falls into layers: paths for every wavelength on its own."""
    from twin.effects import world_captures
    from twin.materials import OpticalProperties
    from twin.transport.geometry import height_of_stack

    bench, sample = world.bench, world.samples[number]
    own = world.changed(samples=(sample,), wedge=world.wedge[number : number + 1])
    other = {
        "wedge": own.wedge,
        "sublayers": [asdict(layer) for layer in own.sublayers],
        "second_lobe": own.second_lobe,
        "alternatives": [
            [each.share, _plain(each.covers_above), _plain(each.covers_below)]
            for each in own.alternatives
        ],
    }
    key = light_key(bench, sample, wavelength_nm, material, light, seed, own.second_lobe)
    medium = OpticalProperties(wavelength_nm, material[:, 0], material[:, 1], material[:, 2], None)

    def by(paths: int) -> dict[str, FloatArray]:
        (one,) = world_captures(
            own, wavelength_nm, properties=medium, paths=paths, seeds=[seed], threads=threads
        )
        return {name: getattr(one, name) for name in FIELDS}

    def traced(_: object) -> dict[str, FloatArray]:
        pilot = by(PILOT_PATHS)
        value = np.stack([pilot["black"], pilot["white"]])
        error = np.stack([pilot["black_se"], pilot["white_se"]])
        wanted = times_wanted(value, error, light)
        doublings = max(0, math.ceil(math.log2(max(wanted, 1.0))))
        return by(min(PILOT_PATHS << doublings, light.most_paths))

    height = height_of_stack(bench, sample)
    name = content_key({"light": key, **other})
    return kept_light(bench, height, wavelength_nm, traced, name, folder)


def _plain(layers: Sequence[Layer]) -> list[Any]:
    return [layer.model_dump(mode="json") for layer in layers]
