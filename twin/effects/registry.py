"""Effects by name: ours, and those that other packages announce.

Another package announces an effect in its pyproject.toml:

    [project.entry-points."benchtwin.effects"]
    tarnish = "mine.tarnish:EFFECT"

where `EFFECT` is a `twin.effects.Effect`. One that cannot be loaded is named and left out.
"""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.metadata import EntryPoint, entry_points

from twin.effects import catalogue as ours
from twin.effects.effect import Candidate, Effect
from twin.effects.world import World
from twin.errors import InputError

GROUP = "benchtwin.effects"


@dataclass(frozen=True)
class LeftOut:
    """An entry of the catalogue that cannot be used, and why."""

    name: str
    reason: str


@dataclass(frozen=True)
class Catalogue:
    """Effects that can be used, and those that were left out.

    Attributes:
        effects: in the order of the light path.
        left_out: announced effects that could not be used, with the reason.
    """

    effects: tuple[Effect, ...]
    left_out: tuple[LeftOut, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects."""
        return tuple(effect.name for effect in self.effects)

    def candidates(
        self, world: World, visit: str = "translucent"
    ) -> tuple[tuple[Candidate, ...], tuple[LeftOut, ...]]:
        """Every effect at every place where it can happen in a world, and what was left out."""
        found: list[Candidate] = []
        failed = list(self.left_out)
        for effect in self.effects:
            if effect.visit != visit:
                continue
            try:
                found += effect.candidates(world)
            except Exception as error:  # noqa: BLE001 - a user's entry may raise anything
                failed.append(LeftOut(effect.name, f"{type(error).__name__}: {error}"))
        return tuple(found), tuple(failed)

    def without(self, names: Sequence[str]) -> Catalogue:
        """The catalogue without some effects, as the blind check's second arm wants it.

        Raises:
            InputError: an unknown name.
        """
        for name in names:
            self.effect(name)
        return replace(self, effects=tuple(e for e in self.effects if e.name not in names))

    def with_effects(self, effects: Sequence[Effect]) -> Catalogue:
        """The catalogue with further effects; those of the same name are replaced."""
        new = {effect.name for effect in effects}
        return replace(self, effects=(*(e for e in self.effects if e.name not in new), *effects))

    def effect(self, name: str) -> Effect:
        """An effect by name.

        Raises:
            InputError: there is none of that name.
        """
        for effect in self.effects:
            if effect.name == name:
                return effect
        close = difflib.get_close_matches(name, self.names)
        raise InputError(
            f'"{name}"', f"one of {', '.join(self.names)}", place="effect",
            remedy=f'Did you mean "{close[0]}"?' if close else "",
        )  # fmt: skip


def catalogue() -> Catalogue:
    """Our effects in the order of the light path, then those that other packages announce."""
    effects = list(ours.EFFECTS)
    left_out = []
    for point in sorted(entry_points(group=GROUP), key=lambda each: each.name):
        if point.name in {effect.name for effect in effects}:
            left_out.append(LeftOut(point.name, "an effect of that name is there already"))
            continue
        found = _loaded(point)
        if isinstance(found, Effect):
            effects.append(found)
        else:
            left_out.append(LeftOut(point.name, found))
    return Catalogue(tuple(effects), tuple(left_out))


def candidate(world: World, name: str) -> Candidate:
    """A candidate by name, such as "thickness[0.4 mm]" or "gap".

    Raises:
        InputError: an unknown effect, or an instance that this world does not have.
    """
    family, bracket, rest = name.partition("[")
    effect = catalogue().effect(family)
    instance = rest.removesuffix("]") if bracket else ""
    known = effect.instances(world)
    if instance not in known:
        raise InputError(
            f'"{name}"',
            f"one of {', '.join(Candidate(effect, each).name for each in known) or 'nothing here'}",
            place="effect",
        )
    return Candidate(effect, instance)


def _loaded(point: EntryPoint) -> Effect | str:
    """The announced effect, or why it cannot be used."""
    try:
        found = point.load()
    except Exception as error:  # noqa: BLE001 - a user's module may raise anything
        return f"{point.value} cannot be loaded ({type(error).__name__}: {error})"
    if not isinstance(found, Effect):
        return f"{point.value} is a {type(found).__name__}; expected a twin.effects.Effect"
    if found.name != point.name:
        return f'{point.value} calls itself "{found.name}"; expected the announced "{point.name}"'
    if not found.parameters:
        return f"{point.value} has no parameter; expected one or more"
    return found
