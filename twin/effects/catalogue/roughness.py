"""Rough faces of the sample: part of the beam leaves them in other directions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin.effects.effect import Effect, EffectParameter
from twin.effects.world import COLLIMATED, Rates, World
from twin.materials import refractive_index
from twin.spectra import FloatArray, Spectral


@dataclass(frozen=True)
class Roughness:
    """The beam crosses two rough faces between the sample's index and that around it."""

    height_um: float
    inside: tuple[Spectral, ...]
    around: tuple[Spectral, Spectral]

    def __call__(self, rates: Rates) -> Rates:
        """The collimated capture without what the faces scatter out of the acceptance."""
        wavelength = rates.wavelength_nm
        beyond = [refractive_index(each, wavelength) for each in self.around]
        kept = []
        for each in self.inside:
            n = refractive_index(each, wavelength)
            kept.append(np.prod([_specular(self.height_um, n - m, wavelength) for m in beyond], 0))
        return rates.scaled((COLLIMATED,), np.array(kept))


def _specular(height_um: float, step: FloatArray, wavelength_nm: FloatArray) -> FloatArray:
    """Share that stays in the beam on crossing a rough face with a step of the index."""
    phase = 2.0 * np.pi * height_um * 1000.0 * step / wavelength_nm
    return np.asarray(np.exp(-(phase**2)))


def _change(world: World, values: Mapping[str, float], instance: str) -> World:
    above, below = world.bench.covers_above, world.bench.covers_below
    around = (above[-1].n if above else 1.0, below[0].n if below else 1.0)
    inside = tuple(sample.n for sample in world.samples)
    return world.with_step(Roughness(values["height_um"], inside, around))


EFFECT = Effect(
    name="roughness",
    place="sample",
    title="the faces of the samples are rough",
    physics="Crossing a rough face, exp(-(2 pi h (n1 - n2) / lambda)^2) of the beam stays in it; "
    "the rest leaves as haze, outside the acceptance. Black and white, lit and seen over wide "
    "angles, stay as they are to first order.",
    source="Carniglia 1979, Opt. Eng. 18, 104 (scalar theory of rough faces, transmission)",
    parameters=(
        EffectParameter(
            "height_um", "um", 0.0, 0.03, "positive", "root mean square height of both faces",
            even=True, limit=10.0,
        ),
    ),
    engine="signal",
    change=_change,
)  # fmt: skip
