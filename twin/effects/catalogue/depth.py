"""A sample that is not the same all through: two layers inside it."""

from __future__ import annotations

from collections.abc import Mapping

from twin.effects.effect import Effect, EffectParameter
from twin.effects.world import Sublayer, World

_PHYSICS = (
    "The upper half has (1 + contrast) and the lower half (1 - contrast) of the coefficient: "
    "sediment, skin, a cure from one side. What is seen from above weighs the upper half more."
)


def _change(world: World, values: Mapping[str, float], instance: str) -> World:
    layers = world.sublayers or (Sublayer(0.5), Sublayer(0.5))
    factors = (1.0 + values["contrast"], 1.0 - values["contrast"])
    return world.changed(
        sublayers=tuple(
            Sublayer(
                layer.share,
                layer.scattering * (factor if instance == "scattering" else 1.0),
                layer.absorption * (factor if instance == "absorption" else 1.0),
            )
            for layer, factor in zip(layers, factors, strict=True)
        )
    )


EFFECT = Effect(
    name="depth_contrast",
    place="sample",
    title="the material is not the same all through its depth",
    physics=_PHYSICS,
    source="van de Hulst 1980, chapter 4 (adding of unlike layers)",
    parameters=(
        EffectParameter(
            "contrast", "1", 0.0, 0.3, description="of the upper half against the mean", limit=0.95
        ),
    ),
    engine="plane",
    change=_change,
    instances=lambda world: ("scattering", "absorption"),
)
