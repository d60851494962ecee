"""The panels: their angle, their distance, the plane of the white reference, their evenness."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin.bench import stack_of
from twin.effects.effect import Effect, EffectParameter
from twin.effects.world import BLACK_REFERENCE, WHITE_REFERENCE, Rates, World
from twin.transport.geometry import reference_factor, reference_plane_mm


def _moved(world: World, **change: float) -> World:
    panels = tuple(
        {**panel.model_dump(), **{name: getattr(panel, name) + by for name, by in change.items()}}
        for panel in world.bench.panels
    )
    return world.with_bench(panels=panels)


def _angle(world: World, values: Mapping[str, float], instance: str) -> World:
    return _moved(world, polar_deg=values["polar_deg"])


def _distance(world: World, values: Mapping[str, float], instance: str) -> World:
    return _moved(world, distance_mm=values["distance_mm"])


@dataclass(frozen=True)
class ReferencePlane:
    """References that get other light than in the plane where they should lie, by sample."""

    factor: tuple[float, ...]

    def __call__(self, rates: Rates) -> Rates:
        """The references as they are lit."""
        return rates.scaled((WHITE_REFERENCE, BLACK_REFERENCE), np.array(self.factor)[:, None])


def _plane(world: World, values: Mapping[str, float], instance: str) -> World:
    factor = []
    for sample in world.samples:
        height = sum(layer.thickness_mm for layer in stack_of(world.bench, sample, None))
        plane = reference_plane_mm(world.bench, height)
        moved = reference_factor(world.bench, plane + values["height_mm"])
        factor.append(moved / reference_factor(world.bench, plane))
    return world.with_step(ReferencePlane(tuple(factor)))


def _uneven(world: World, values: Mapping[str, float], instance: str) -> World:
    return _moved(world, gradient=values["gradient"])


_SOURCE = "bench.md, captures; irradiance of a Lambertian rectangle, twin.transport.geometry"

ANGLE = Effect(
    name="panel_angle",
    place="source",
    title="the panels stand at another angle",
    physics="Light falls in flatter or steeper, so that the surface and the sample send another "
    "share of it to the detector.",
    source=_SOURCE,
    parameters=(
        EffectParameter(
            "polar_deg", "deg", 0.0, 2.0, description="change of the polar angle", limit=30.0
        ),
    ),
    engine="plane",
    change=_angle,
    plain=True,
)
DISTANCE = Effect(
    name="panel_distance",
    place="source",
    title="the panels stand nearer or farther",
    physics="The irradiance at the sample's top against that in the plane of the white changes "
    "with the distance: about 0.5 % per mm of height at 300 mm.",
    source=_SOURCE,
    parameters=(
        EffectParameter(
            "distance_mm", "mm", 0.0, 15.0, description="change of the distance", limit=150.0
        ),
    ),
    engine="plane",
    change=_distance,
    plain=True,
)
PLANE = Effect(
    name="reference_plane",
    place="source",
    title="the white of the reference lay higher or lower than the background of the sample",
    physics="The reference is lit by the panels where it lies: 0.5 to 0.7 % more per mm nearer.",
    source=_SOURCE,
    parameters=(
        EffectParameter(
            "height_mm", "mm", 0.0, 1.0, description="of the white above its plane", limit=50.0
        ),
    ),
    engine="signal",
    change=_plane,
)
UNEVEN = Effect(
    name="panel_gradient",
    place="source",
    title="the panels are brighter at one edge",
    physics="The radiance changes linearly from the upper to the lower edge of each panel: the "
    "mean direction of the light moves.",
    source=_SOURCE + "; twin.bench.Panel.gradient",
    parameters=(
        EffectParameter(
            "gradient",
            "1",
            0.0,
            0.2,
            description="relative change from the centre to the edge",
            limit=1.0,
        ),
    ),
    engine="monte_carlo",
    change=_uneven,
    plain=True,
)
EFFECTS = (ANGLE, DISTANCE, PLANE, UNEVEN)
