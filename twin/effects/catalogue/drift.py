"""The lamp between a reference and the sample: another level, another slope over wavelength."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin.effects.effect import Effect, EffectParameter
from twin.effects.world import BLACK, COLLIMATED, WHITE, Rates, World

CAPTURES = {
    "black": (BLACK,),
    "white": (WHITE,),
    "panels": (BLACK, WHITE),
    "collimated": (COLLIMATED,),
}
"""Which captures drift together; "panels": the lamp moved once, after the white reference."""


@dataclass(frozen=True)
class Drift:
    """Captures that see exp(level + tilt t) of the lamp, t from -1 to +1 over the wavelengths."""

    captures: tuple[int, ...]
    level: float
    tilt: float

    def __call__(self, rates: Rates) -> Rates:
        """The light after the drift."""
        low, high = rates.wavelength_nm[[0, -1]]
        shape = 2.0 * (rates.wavelength_nm - low) / max(high - low, 1e-9) - 1.0
        return rates.scaled(self.captures, np.exp(self.level + self.tilt * shape))


def _change(world: World, values: Mapping[str, float], instance: str) -> World:
    return world.with_step(Drift(CAPTURES[instance], values["level"], values["tilt"]))


EFFECT = Effect(
    name="drift",
    place="source",
    title="the lamp drifted between the reference and the capture",
    physics=(
        "A lamp warms up: its level, and for LEDs the ratio of blue to phosphor, differ between "
        "the reference and the capture. The ratio is off by exp(level + tilt t), t from -1 at the "
        "first wavelength to +1 at the last."
    ),
    source="Iser et al. 2022, section 4.1 (ratio to the reference); twin.instrument.lamp_drift",
    parameters=(
        EffectParameter(
            "level", "1", 0.0, 0.01, description="logarithm of the level", per="capture", limit=1.0
        ),
        EffectParameter(
            "tilt",
            "1",
            0.0,
            0.005,
            description="logarithm at the last wavelength against the middle",
            per="capture",
            limit=1.0,
        ),
    ),
    engine="signal",
    change=_change,
    instances=lambda world: tuple(CAPTURES),
)
