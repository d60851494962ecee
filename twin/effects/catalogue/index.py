"""The refractive index of the samples."""

from __future__ import annotations

from collections.abc import Mapping

from twin.effects.effect import Effect, EffectParameter
from twin.effects.spectral import shifted
from twin.effects.world import World


def _change(world: World, values: Mapping[str, float], instance: str) -> World:
    samples = tuple(
        sample.model_copy(update={"n": shifted(sample.n, "refractive_index", values["n"])})
        for sample in world.samples
    )
    return world.changed(samples=samples)


EFFECT = Effect(
    name="refractive_index",
    place="sample",
    title="the refractive index of the material is another",
    physics="More light is reflected at the faces, and more is kept inside by total reflection.",
    source="Born and Wolf 1999, section 1.5.2 (Fresnel)",
    parameters=(
        EffectParameter("n", "1", 0.0, 0.02, description="added to the stated index", limit=1.0),
    ),
    engine="plane",
    change=_change,
    plain=True,
)
