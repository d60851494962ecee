"""A sample that fluoresces: light it absorbs in the blue comes back at longer wavelengths."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from twin.effects.effect import Effect, EffectParameter
from twin.effects.world import BLACK, WHITE, Rates, World

STOKES_NM = 80.0
"""Distance from the absorbed to the emitted wavelengths: that of common dyes and brighteners."""
WIDTH_NM = 60.0
"""Full width of both bands at half maximum."""
BANDS_NM = (450.0, 530.0)
"""Centres of the absorbed and of the emitted band."""


@dataclass(frozen=True)
class Emission:
    """Emission into black and white, in proportion to what each of them lacks in the blue.

    The light that the panels bring in the absorbed band and the capture does not show is partly
    re-emitted: `efficiency` is the share of these photons that the detector sees again, as
    a perfect diffuser would send it. Electrons count photons here.
    """

    efficiency: float

    def __call__(self, rates: Rates) -> Rates:
        """The light with the emission."""
        wavelength = rates.wavelength_nm
        taken, sent = (_band(wavelength, centre) for centre in BANDS_NM)
        total = sent.sum()
        if total <= 0.0:
            return rates
        light = rates.light.copy()
        for capture in (BLACK, WHITE):
            missing = np.maximum(rates.diffuser - rates.light[:, capture], 0.0)
            photons = self.efficiency * (missing * taken).sum(axis=-1, keepdims=True)
            light[:, capture] += photons * sent / total
        return replace(rates, light=light)


def _band(wavelength_nm: np.ndarray, centre_nm: float) -> np.ndarray:
    shape = np.exp(-4.0 * np.log(2.0) * ((wavelength_nm - centre_nm) / WIDTH_NM) ** 2)
    return np.asarray(shape)


def _change(world: World, values: Mapping[str, float], instance: str) -> World:
    return world.with_step(Emission(values["efficiency"]))


EFFECT = Effect(
    name="fluorescence",
    place="sample",
    title="the material fluoresces",
    physics="Light absorbed around 450 nm comes back around 530 nm and adds to what is reflected "
    "there, over the white background more than over the black.",
    source="Donaldson 1954, Br. J. Appl. Phys. 5, 210 (bispectral); thin closed form",
    parameters=(
        EffectParameter(
            "efficiency", "1", 0.0, 0.005, "positive",
            "photons seen again of those missing in the absorbed band", limit=1.0,
        ),
    ),
    engine="signal",
    change=_change,
)  # fmt: skip
