"""The shape of the phase function at the same mean cosine."""

from __future__ import annotations

from collections.abc import Mapping

from twin.effects.effect import Effect, EffectParameter
from twin.effects.world import World

SECOND_G = 0.0
"""Anisotropy of the second lobe: isotropic, as a strong first lobe leaves room for it."""


def _change(world: World, values: Mapping[str, float], instance: str) -> World:
    return world.changed(second_lobe=(world.second_lobe[0] + values["share"], SECOND_G))


EFFECT = Effect(
    name="phase_function",
    place="sample",
    title="the phase function has another shape than Henyey and Greenstein's",
    physics="A share of the scattering is isotropic and the rest more forward, the mean cosine "
    "being the same: thin samples send more straight back and more into the aperture.",
    source="Kattawar 1975, JQSRT 15, 839 (two-term Henyey-Greenstein)",
    parameters=(
        EffectParameter(
            "share", "1", 0.0, 0.03, "positive", "of the scattering that is isotropic", limit=0.9
        ),
    ),
    engine="plane",
    change=_change,
)
