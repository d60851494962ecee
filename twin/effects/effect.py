"""What an entry of the catalogue is."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeVar

import numpy as np

from twin.effects.world import Applied
from twin.errors import InputError

Place = Literal["source", "sample", "background", "detector", "fluorescence"]
"""Where on the light path an effect acts."""
Engine = Literal["plane", "signal", "monte_carlo"]
"""Who sees it: the plane-parallel engine too, nobody (it acts after the light), or the Monte Carlo
alone."""
Sign = Literal["any", "positive", "negative"]
Values = Mapping[str, float] | Sequence[float] | np.ndarray
"""One value for each parameter: by name, or in order."""


@dataclass(frozen=True)
class EffectParameter:
    """One number of an effect.

    Attributes:
        name: unique within the effect.
        unit: such as "mm", "1" for a ratio.
        nominal: value without the effect.
        prior_scale: typical distance from nominal on a bench built with care.
        sign: of value minus nominal.
        description: what it is, in a sentence.
        per: what has a value of its own.
        even: captures depend on the square of value minus nominal: slopes are those of the
            secant to one prior scale, as the derivative is nothing.
        limit: values from nominal minus `limit` to nominal plus `limit` can be asked for.
    """

    name: str
    unit: str
    nominal: float
    prior_scale: float
    sign: Sign = "any"
    description: str = ""
    per: Literal["bench", "sample", "capture"] = "bench"
    even: bool = False
    limit: float = np.inf

    def check(self, value: float, place: str) -> None:
        """Make sure that a value can be.

        Raises:
            InputError: not finite, of the wrong sign, or too far away.
        """
        off = value - self.nominal
        if not np.isfinite(value):
            raise InputError(f"{value}", "a number", place=f"{place}.{self.name}")
        if (self.sign == "positive" and off < 0) or (self.sign == "negative" and off > 0):
            bound = "at least" if self.sign == "positive" else "at most"
            raise InputError(
                f"{value:g} {self.unit}", f"{bound} {self.nominal:g} {self.unit}",
                place=f"{place}.{self.name}",
            )  # fmt: skip
        if abs(off) > self.limit:
            raise InputError(
                f"{value:g} {self.unit}",
                f"a value within {self.limit:g} {self.unit} of {self.nominal:g}",
                place=f"{place}.{self.name}",
            )


Change = Callable[[Any, Mapping[str, float], str], Any]
"""(world, value by parameter, instance) -> changed world; pure. The world is a `World`, or a
`FluorescenceWorld` for effects of fluorescence visits."""
AnyWorld = TypeVar("AnyWorld")


def _once(world: Any) -> tuple[str, ...]:
    """The bench as a whole is the only instance."""
    return ("",)


@dataclass(frozen=True)
class Effect:
    """One entry of the catalogue: a family of candidates that act alike.

    Attributes:
        name: such as "thickness".
        place: where it acts.
        title: in plain words, as a verdict says it.
        physics: what happens, in a sentence or two.
        source: author, year, equation.
        parameters: at least one.
        engine: who sees it.
        change: how it changes a world.
        instances: what it can happen to on its own in a world, such as each sample; ("",) for the
            bench as a whole, () where it cannot happen.
        visit: the kind of measurement it belongs to.
        plain: whether a description says it in fields of its own (bench or samples), so that
            accepting it writes these; else it is kept in `Bench.effects`.
    """

    name: str
    place: Place
    title: str
    physics: str
    source: str
    parameters: tuple[EffectParameter, ...]
    engine: Engine
    change: Change
    instances: Callable[[Any], tuple[str, ...]] = _once
    visit: Literal["translucent", "fluorescence"] = "translucent"
    plain: bool = False

    def candidates(self, world: Any) -> tuple[Candidate, ...]:
        """The effect's candidates in a world."""
        return tuple(Candidate(self, instance) for instance in self.instances(world))


@dataclass(frozen=True)
class Candidate:
    """An effect at one place where it can happen: what a diagnosis scores.

    Attributes:
        effect: the entry of the catalogue.
        instance: such as "0.4 mm", or "".
    """

    effect: Effect
    instance: str = ""

    @property
    def name(self) -> str:
        """Such as "thickness[0.4 mm]"."""
        return f"{self.effect.name}[{self.instance}]" if self.instance else self.effect.name

    @property
    def title(self) -> str:
        """In plain words."""
        return f"{self.effect.title} ({self.instance})" if self.instance else self.effect.title

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        """Of the effect."""
        return self.effect.parameters

    @property
    def engine(self) -> Engine:
        """Who sees it."""
        return self.effect.engine

    @property
    def nominal(self) -> tuple[float, ...]:
        """Values without the effect."""
        return tuple(parameter.nominal for parameter in self.parameters)

    def values(self, values: Values) -> tuple[float, ...]:
        """Values in the order of the parameters; those not named are nominal.

        Raises:
            InputError: too many, an unknown name, or a value that cannot be.
        """
        if isinstance(values, Mapping):
            known = [parameter.name for parameter in self.parameters]
            for name in values:
                if name not in known:
                    raise InputError(f'"{name}"', f"one of {', '.join(known)}", place=self.name)
            found = [float(values.get(p.name, p.nominal)) for p in self.parameters]
        else:
            found = [float(value) for value in values]
            if len(found) != len(self.parameters):
                raise InputError(f"{len(found)} values", f"{len(self.parameters)}", place=self.name)
        for parameter, value in zip(self.parameters, found, strict=True):
            parameter.check(value, self.name)
        return tuple(found)

    def apply(self, world: AnyWorld, values: Values) -> AnyWorld:
        """The world with the effect; the given world stays as it is.

        Nominal values give the same world back, exactly.

        Raises:
            InputError: values that cannot be.
        """
        found = self.values(values)
        if found == self.nominal:
            return world
        by_name = dict(zip((p.name for p in self.parameters), found, strict=True))
        changed = self.effect.change(world, by_name, self.instance)
        before: tuple[Applied, ...] = getattr(world, "applied", ())
        with_record: AnyWorld = replace(changed, applied=(*before, Applied(self.name, found, self)))
        return with_record
