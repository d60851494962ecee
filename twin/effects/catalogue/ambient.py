"""Light of the room, or of panels not quite covered, in the collimated capture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from twin.effects.effect import Effect, EffectParameter
from twin.effects.world import BLACK, COLLIMATED, Rates, World


@dataclass(frozen=True)
class Ambient:
    """A share of the panels' light that still shines while the beam is measured."""

    share: float

    def __call__(self, rates: Rates) -> Rates:
        """The collimated capture with what the sample reflects of that light."""
        light = rates.light.copy()
        light[:, COLLIMATED] += self.share * light[:, BLACK]
        return replace(rates, light=light)


def _change(world: World, values: Mapping[str, float], instance: str) -> World:
    return world.with_step(Ambient(values["share"]))


EFFECT = Effect(
    name="ambient_light",
    place="source",
    title="light of the room or the panels left in the collimated capture",
    physics=(
        "Light from above that shines while the beam is measured is reflected by the sample into "
        "the detector. Its dark was taken without it, and the beam reference has no sample to "
        "reflect it: S_collimated gains share x S_black."
    ),
    source="bench.md, captures (collimated: panels covered); first order in the share",
    parameters=(
        EffectParameter(
            "share", "1", 0.0, 0.002, "positive", "of the panels' light that is left", limit=1.0
        ),
    ),
    engine="signal",
    change=_change,
)
