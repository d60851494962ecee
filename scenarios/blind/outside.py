"""Four things that happen to benches and that no entry of the catalogue describes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from twin.bench import Medium
from twin.effects import Effect, EffectEngine, EffectParameter, Rates, World
from twin.effects.world import BEAM_REFERENCE, BLACK, COLLIMATED, WHITE
from twin.materials import optical_properties
from twin.spectra import FloatArray, SpectralTable

WITH_SAMPLE = (BLACK, WHITE, COLLIMATED)
FILM_NM = 8000.0
"""Optical path difference within the film [nm]: eight or nine fringes over the visible range."""
BAND_NM, WIDTH_NM = 490.0, 35.0
"""Of the stain's absorption."""


@dataclass(frozen=True)
class _Fringes:
    depth: float

    def __call__(self, rates: Rates) -> Rates:
        wave = np.cos(2.0 * np.pi * FILM_NM / rates.wavelength_nm)
        return rates.scaled(WITH_SAMPLE, 1.0 + self.depth * wave)


@dataclass(frozen=True)
class _Stain:
    sample: int
    density: float

    def __call__(self, rates: Rates) -> Rates:
        band = np.exp(-0.5 * ((rates.wavelength_nm - BAND_NM) / WIDTH_NM) ** 2)
        light = rates.light.copy()
        # light of the panels goes in and out through the stained glass, the beam once
        for capture, passes in ((BLACK, 2.0), (WHITE, 2.0), (COLLIMATED, 1.0)):
            light[self.sample, capture] *= np.exp(-passes * self.density * band)
        return replace(rates, light=light)


@dataclass(frozen=True)
class _Bypass:
    sample: int
    share: float

    def __call__(self, rates: Rates) -> Rates:
        light = rates.light.copy()
        light[self.sample, COLLIMATED] += self.share * light[self.sample, BEAM_REFERENCE]
        return replace(rates, light=light)


def _fringes(world: World, values: Mapping[str, float], instance: str) -> World:
    return world.with_step(_Fringes(values["depth"]))


def _stain(world: World, values: Mapping[str, float], instance: str) -> World:
    return world.with_step(_Stain(world.sample_keys.index(instance), values["density"]))


def _bypass(world: World, values: Mapping[str, float], instance: str) -> World:
    return world.with_step(_Bypass(world.sample_keys.index(instance), values["share"]))


def _mislabelled(world: World, values: Mapping[str, float], instance: str) -> World:
    number = world.sample_keys.index(instance)
    samples = list(world.samples)
    old = samples[number]
    if old.material is not None:
        changed = _stronger(old.material, values["absorption"])
        samples[number] = old.model_copy(update={"material": changed})
    return world.changed(samples=tuple(samples))


def _stronger(material: str | Medium, relative: float) -> Medium:
    """The same medium with more or less absorption."""
    grid = np.arange(360.0, 741.0, 5.0)
    found = optical_properties(material, grid)
    own = absorbing(np.stack([found.albedo, found.sigma_t_per_mm, found.g], axis=-1), relative).T
    tables = [SpectralTable(wavelength_nm=tuple(grid), value=tuple(row)) for row in own]
    return Medium(albedo=tables[0], sigma_t_per_mm=tables[1], g=tables[2])


def absorbing(material: FloatArray, relative: float) -> FloatArray:
    """Albedo, sigma_t and g, (W, 3), of the medium with absorption times 1 + relative."""
    albedo, sigma_t, g = material.T
    scattering = albedo * sigma_t
    total = scattering + (sigma_t - scattering) * (1.0 + relative)
    return np.stack([scattering / total, total, g], axis=-1)


def response_of_mislabelled(
    engine: EffectEngine, instance: str, material: FloatArray, relative: float
) -> FloatArray:
    """Change of the expected intensities, (W, S, 3): one sample is another material."""
    world = engine.world
    number = world.sample_keys.index(instance)
    here = engine.intensities(world, material)
    there = engine.intensities(world, absorbing(material, relative))
    change = np.zeros_like(here)
    change[:, number] = there[:, number] - here[:, number]
    return change


def _each(world: Any) -> tuple[str, ...]:
    return tuple(world.sample_keys)


FRINGES = Effect(
    name="fringes",
    place="detector",
    title="a film before the detector interferes",
    physics="Captures with a sample see 1 + d cos(2 pi L / wavelength), L 8 um.",
    source="Airy 1833, two beams",
    parameters=(EffectParameter("depth", "1", 0.0, 0.03, "positive", limit=0.9),),
    engine="signal",
    change=_fringes,
)
STAIN = Effect(
    name="stain",
    place="sample",
    title="the cover glass of one sample is stained",
    physics="A band at 490 nm, 82 nm wide, absorbs on the way in and out.",
    source="Bouguer 1729",
    parameters=(EffectParameter("density", "1", 0.0, 0.03, "positive", limit=3.0),),
    engine="signal",
    change=_stain,
    instances=_each,
)
BYPASS = Effect(
    name="bypass",
    place="sample",
    title="a pinhole beside one sample lets the beam through",
    physics="The collimated capture of one sample gets a share of the bare beam.",
    source="plain addition",
    parameters=(EffectParameter("share", "1", 0.0, 0.003, "positive", limit=0.5),),
    engine="signal",
    change=_bypass,
    instances=_each,
)
MISLABELLED = Effect(
    name="mislabelled",
    place="sample",
    title="one sample is of another batch",
    physics="Its absorption is another; scattering is the same.",
    source="plain multiplication",
    parameters=(EffectParameter("absorption", "1", 0.0, 0.15, limit=0.9),),
    engine="plane",
    change=_mislabelled,
    instances=_each,
)
OUTSIDE = (FRINGES, STAIN, BYPASS, MISLABELLED)
