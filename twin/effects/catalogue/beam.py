"""The beam: how far it opens, and how far it leans."""

from __future__ import annotations

from collections.abc import Mapping

from twin.effects.effect import Effect, EffectParameter
from twin.effects.world import World


def _beam(world: World, **fields: float) -> World:
    return world.with_bench(beam={**world.bench.beam.model_dump(), **fields})


def _divergence(world: World, values: Mapping[str, float], instance: str) -> World:
    return _beam(world, divergence_deg=world.bench.beam.divergence_deg + values["divergence_deg"])


def _tilt(world: World, values: Mapping[str, float], instance: str) -> World:
    return _beam(world, tilt_deg=world.bench.beam.tilt_deg + values["tilt_deg"])


_PHYSICS = (
    "Oblique light goes a longer way through the sample, and what leaves the acceptance is lost; "
    "with a sample, less of it is lost by scattering back into the cone."
)

DIVERGENCE = Effect(
    name="beam_divergence",
    place="source",
    title="the beam is not parallel",
    physics=_PHYSICS,
    source="bench.md, beam",
    parameters=(
        EffectParameter(
            "divergence_deg",
            "deg",
            0.0,
            2.0,
            "positive",
            "added to the half-angle",
            even=True,
            limit=20.0,
        ),
    ),
    engine="plane",
    change=_divergence,
    plain=True,
)
TILT = Effect(
    name="beam_tilt",
    place="source",
    title="the beam is not upright",
    physics=_PHYSICS,
    source="bench.md, beam; twin.bench.Beam.tilt_deg",
    parameters=(
        EffectParameter(
            "tilt_deg", "deg", 0.0, 0.5, "positive", "from the axis", even=True, limit=20.0
        ),
    ),
    engine="plane",
    change=_tilt,
    plain=True,
)
EFFECTS = (DIVERGENCE, TILT)
