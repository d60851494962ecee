"""Light lost at the sides of the stack: a smaller extent than stated, or off the axis."""

from __future__ import annotations

from collections.abc import Mapping

from twin.effects.effect import Effect, EffectParameter
from twin.effects.world import World


def _smaller(world: World, values: Mapping[str, float], instance: str) -> World:
    size = world.bench.size_mm
    inverse = (0.0, 0.0) if size is None else (1.0 / size[0], 1.0 / size[1])
    return world.with_bench(
        size_mm=tuple(1.0 / (each + values["inverse_extent"]) for each in inverse)
    )


def _off_centre(world: World, values: Mapping[str, float], instance: str) -> World:
    x, y = world.bench.offset_mm
    return world.with_bench(offset_mm=(x + values["offset_mm"], y))


def _bounded(world: World) -> tuple[str, ...]:
    return () if world.bench.size_mm is None else ("",)


EXTENT = Effect(
    name="lateral_loss",
    place="sample",
    title="the sample is smaller than stated and loses light at its sides",
    physics="Light that walks to a side face is lost, more of it the farther it walks: it is "
    "taken for absorption.",
    source="Prahl, van Gemert and Welch 1993, Appl. Opt. 32, 559 (lost light); bench.md, stack",
    parameters=(
        EffectParameter(
            "inverse_extent", "1/mm", 0.0, 0.1, "positive",
            "added to one over the lateral extent: 40 mm become 8 mm at 0.1", even=True, limit=1.0,
        ),
    ),
    engine="monte_carlo",
    change=_smaller,
    plain=True,
)  # fmt: skip
OFF_CENTRE = Effect(
    name="off_centre",
    place="sample",
    title="the sample lies off the axis",
    physics="The nearer side loses more light than the farther one saves: to second order in the "
    "offset, so that the direction does not matter.",
    source="bench.md, stack (lateral size)",
    parameters=(
        EffectParameter(
            "offset_mm", "mm", 0.0, 5.0, "positive", "between the middle and the axis", even=True,
            limit=100.0,
        ),
    ),
    engine="monte_carlo",
    change=_off_centre,
    instances=_bounded,
    plain=True,
)  # fmt: skip
EFFECTS = (EXTENT, OFF_CENTRE)
