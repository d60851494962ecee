"""Glasses that nobody wrote down, or that were written down and are not there."""

from __future__ import annotations

from collections.abc import Mapping

from twin.bench import Layer
from twin.effects.effect import Effect, EffectParameter
from twin.effects.world import Alternative, World

SLIDE = Layer(thickness_mm=1.0, n=1.5)
"""A microscope slide or a cuvette's wall."""
FILM = Layer(thickness_mm=0.001, n=1.0)
"""Air between two glasses that lie on each other."""


def _added(world: World, values: Mapping[str, float], instance: str) -> World:
    above, below = world.bench.covers_above, world.bench.covers_below
    thin = (FILM,) if above or below else ()
    return _shared(world, values["presence"], (SLIDE, *thin, *above), (*below, *thin, SLIDE))


def _missing(world: World, values: Mapping[str, float], instance: str) -> World:
    return _shared(world, values["absence"], (), ())


def _shared(
    world: World, share: float, above: tuple[Layer, ...], below: tuple[Layer, ...]
) -> World:
    other = Alternative(share, above, below)
    return world.changed(alternatives=(*world.alternatives, other))


def _where_covered(world: World) -> tuple[str, ...]:
    return ("",) if world.bench.covers_above or world.bench.covers_below else ()


_PHYSICS = (
    "A glass between sample and air changes what the faces reflect, outwards and inwards; with "
    "air between it and the next glass, two more faces are there. The share is 1 where it "
    "covers all, and less where it covers part of the spot."
)
_SOURCE = "Stokes 1862 (piles of plates); Prahl 1995, inverse adding-doubling manual, section 4"

ADDED = Effect(
    name="extra_covers",
    place="sample",
    title="the samples lie between glasses or cuvette walls that are not described",
    physics=_PHYSICS,
    source=_SOURCE,
    parameters=(
        EffectParameter(
            "presence", "1", 0.0, 1.0, "positive",
            "share of the spot under a 1 mm slide of index 1.5 on both sides", limit=1.0,
        ),
    ),
    engine="plane",
    change=_added,
)  # fmt: skip
MISSING = Effect(
    name="missing_covers",
    place="sample",
    title="the described cover glasses are not there",
    physics=_PHYSICS,
    source=_SOURCE,
    parameters=(
        EffectParameter(
            "absence", "1", 0.0, 1.0, "positive", "share of the spot without its covers",
            limit=1.0,
        ),
    ),
    engine="plane",
    change=_missing,
    instances=_where_covered,
)  # fmt: skip
EFFECTS = (ADDED, MISSING)
