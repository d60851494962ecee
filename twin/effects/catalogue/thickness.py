"""The thickness of one sample, and how it changes across the spot."""

from __future__ import annotations

from collections.abc import Mapping

from twin.effects.effect import Effect, EffectParameter
from twin.effects.world import World


def _thickness(world: World, values: Mapping[str, float], instance: str) -> World:
    number = world.sample_keys.index(instance)
    samples = list(world.samples)
    old = samples[number]
    samples[number] = old.model_copy(
        update={"thickness_mm": old.thickness_mm * (1.0 + values["relative"])}
    )
    return world.changed(samples=tuple(samples))


def _wedge(world: World, values: Mapping[str, float], instance: str) -> World:
    number = world.sample_keys.index(instance)
    slopes = list(world.wedge or (0.0,) * len(world.samples))
    slopes[number] = values["slope"]
    return world.changed(wedge=tuple(slopes))


def _each(world: World) -> tuple[str, ...]:
    return world.sample_keys


THICKNESS = Effect(
    name="thickness",
    place="sample",
    title="a sample is thicker or thinner than stated",
    physics="Optical thickness is sigma_t times thickness. One sample's error shows against the "
    "others; an error common to all is a scale of sigma_t and invisible.",
    source="Bouguer 1729, Beer 1852; Kubelka and Munk 1931",
    parameters=(
        EffectParameter(
            "relative", "1", 0.0, 0.02, description="error over the stated thickness",
            per="sample", limit=0.9,
        ),
    ),
    engine="plane",
    change=_thickness,
    instances=_each,
    plain=True,
)  # fmt: skip
WEDGE = Effect(
    name="wedge",
    place="sample",
    title="a sample is wedge-shaped within the spot",
    physics="Captures average over the thicknesses in the spot; the mean of exp(-sigma_t t) is "
    "more than that of the mean thickness. Panels and beam have spots of their own; the "
    "direction of the slope does not matter.",
    source="Gauss rule of a disc's chord distribution (Chebyshev, second kind), twin.effects.World",
    parameters=(
        EffectParameter(
            "slope", "mm/mm", 0.0, 0.05, "positive", "change of thickness across the spot",
            per="sample", even=True, limit=1.0,
        ),
    ),
    engine="plane",
    change=_wedge,
    instances=_each,
)  # fmt: skip
EFFECTS = (THICKNESS, WEDGE)
