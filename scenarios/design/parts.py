"""Parts of a bench with prices, performance figures and tolerances, and assemblies of them.

A cheap part is mostly one whose figures are known less well: its tolerances are prior scales of
inputs of the uncertainty budget or of effects of `twin.effects`.
"""

from __future__ import annotations

import datetime
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import Any, Literal, get_args

from pydantic import Field, field_validator, model_validator

from twin.errors import InputError
from twin.spectra import Part
from twin.toml import near_misses, parse_table, read_text, validate

Kind = Literal[
    "illuminant", "panels", "filter", "beam", "white", "black", "detector", "stage", "preparation"
]
KINDS: tuple[str, ...] = get_args(Kind)
Input = Literal[
    "thickness_mm",
    "thickness_relative",
    "n",
    "rho_black_relative",
    "rho_white_relative",
    "acceptance_relative",
]
INPUTS: tuple[str, ...] = get_args(Input)
"""Inputs of the uncertainty budget that a tolerance may be of (`estimators.InputUncertainty`)."""
ESTIMATE = "estimate"
"""What `price_source` says of a price that nobody quoted."""


class Tolerance(Part):
    """How well one figure of a part is known: a standard uncertainty, with its source."""

    input: Input | None = None
    """Input of the uncertainty budget; or an effect:"""
    effect: str = ""
    """Effect of the catalogue, such as "gain_step" or "drift[collimated]"."""
    parameter: str = ""
    """Parameter of the effect; "" takes its first."""
    scale: float = Field(ge=0)
    """Standard uncertainty, in the unit of the input or the effect's parameter."""
    source: str = Field(min_length=1)

    @model_validator(mode="after")
    def _one(self) -> Tolerance:
        if (self.input is None) == (not self.effect):
            raise ValueError("found a tolerance of neither or both; expected an input or an effect")
        return self

    @property
    def name(self) -> str:
        """Such as "thickness_mm", or "drift[panels].level"."""
        return self.input or (f"{self.effect}.{self.parameter}" if self.parameter else self.effect)


class DesignPart(Part):
    """Something to buy or to make."""

    name: str = Field(min_length=1)
    kind: Kind
    title: str = Field(min_length=1)
    price_usd: float | None = Field(default=None, ge=0)
    """Price [USD]; a part without one is refused."""
    priced_on: datetime.date | None = None
    """When that was the price."""
    price_source: str = ""
    """Who said so; "estimate" for an order of magnitude that nobody quoted."""
    per_sample_usd: float = Field(default=0.0, ge=0)
    """Price [USD] of what every sample uses up."""
    source: str = Field(min_length=1)
    """Of the performance figures."""
    bench: dict[str, Any] = Field(default_factory=dict)
    """Keys of the bench that the part sets, as in a bench file."""
    brightness: float = Field(default=1.0, gt=0)
    """Factor on the light of the panels and of the beam."""
    fluorescence: dict[str, Any] = Field(default_factory=dict)
    """Keys of a fluorescence set-up that the part sets."""
    tolerances: tuple[Tolerance, ...] = ()

    @field_validator("tolerances")
    @classmethod
    def _once(cls, value: tuple[Tolerance, ...]) -> tuple[Tolerance, ...]:
        names = [each.name for each in value]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"found two tolerances of {twice[0]}; expected one")
        return value

    @property
    def price(self) -> float:
        """Price [USD].

        Raises:
            InputError: nobody stated one.
        """
        if self.price_usd is None:
            raise InputError(
                f"the part {self.name!r} without a price", "price_usd in US dollars",
                place=f"parts.{self.name}",
                remedy='Write one down, if only an estimate: price_source = "estimate".',
            )  # fmt: skip
        return self.price_usd


class Assembly(Part):
    """Parts that make a set-up, or a piece of one."""

    name: str = Field(min_length=1)
    title: str = Field(min_length=1)
    parts: tuple[str, ...]
    source: str = ""


class _File(Part):
    parts: tuple[DesignPart, ...] = ()
    assemblies: tuple[Assembly, ...] = ()


@dataclass(frozen=True)
class Parts:
    """All parts that a study may use, by name, and the assemblies.

    Attributes:
        by_name: parts in the order of their files.
        assemblies: by name.
    """

    by_name: Mapping[str, DesignPart]
    assemblies: Mapping[str, Assembly]

    def part(self, name: str, place: str = "parts") -> DesignPart:
        """One part.

        Raises:
            InputError: no part of that name; names what was probably meant.
        """
        if name not in self.by_name:
            raise InputError(
                f"the part {name!r}", f"one of {', '.join(self.by_name)}", place=place,
                remedy=near_misses(name, list(self.by_name)),
            )  # fmt: skip
        return self.by_name[name]

    def of_kind(self, kind: str) -> tuple[DesignPart, ...]:
        """Parts of one kind."""
        return tuple(part for part in self.by_name.values() if part.kind == kind)

    def assembly(self, name: str) -> Assembly:
        """One assembly.

        Raises:
            InputError: none of that name.
        """
        if name not in self.assemblies:
            raise InputError(
                f"the assembly {name!r}", f"one of {', '.join(self.assemblies)}",
                place="assemblies", remedy=near_misses(name, list(self.assemblies)),
            )  # fmt: skip
        return self.assemblies[name]

    def price(self, names: Iterable[str]) -> float:
        """Total price [USD] of some parts.

        Raises:
            InputError: an unknown part, or one without a price.
        """
        return sum(self.part(name).price for name in names)

    def allowed(self, names: Iterable[str]) -> Parts:
        """The same with these parts alone; none: all.

        Raises:
            InputError: an unknown part.
        """
        wanted = {self.part(name, "allowed").name for name in names}
        if not wanted:
            return self
        kept = {name: part for name, part in self.by_name.items() if name in wanted}
        return Parts(kept, self.assemblies)


def load_parts(extra: Path | None = None) -> Parts:
    """The built-in parts and assemblies, and those of a person's own TOML file.

    A part of a person's file takes the place of a built-in one of the same name.

    Args:
        extra: TOML with `[[parts]]` and `[[assemblies]]` as in `scenarios/design/builtin`.

    Raises:
        InputError: a file that cannot be read or does not fit, a part without a price, an assembly
            of unknown parts, or a tolerance of an effect that the catalogue does not know.
    """
    parts, assemblies = dict(_builtin().by_name), dict(_builtin().assemblies)
    if extra is not None:
        own = _read(read_text(extra), extra)
        parts |= {each.name: each for each in own.parts}
        assemblies |= {each.name: each for each in own.assemblies}
        _check(Parts(parts, assemblies), [each.name for each in own.parts], extra)
    return Parts(parts, assemblies)


@lru_cache(maxsize=1)
def _builtin() -> Parts:
    parts: dict[str, DesignPart] = {}
    assemblies: dict[str, Assembly] = {}
    for name in ("parts.toml", "assemblies.toml"):
        text = resources.files("scenarios.design").joinpath("builtin", name).read_text("utf-8")
        found = _read(text, f"built-in {name}")
        parts |= {each.name: each for each in found.parts}
        assemblies |= {each.name: each for each in found.assemblies}
    whole = Parts(parts, assemblies)
    _check(whole, list(parts), "built-in parts.toml")
    return whole


def _read(text: str, file: object) -> _File:
    found = validate(parse_table(text, file=file), _File, file=file)
    for what, group in (("part", found.parts), ("assembly", found.assemblies)):
        names = [each.name for each in group]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise InputError(f"the {what} {twice[0]!r} twice", "each name once", file=file)
    return found


def _check(parts: Parts, names: list[str], file: object) -> None:
    from twin.effects import catalogue

    known = catalogue()
    try:
        for name in names:
            part = parts.part(name)
            _ = part.price
            for tolerance in part.tolerances:
                if not tolerance.effect:
                    continue
                effect = known.effect(tolerance.effect.partition("[")[0])
                own = [parameter.name for parameter in effect.parameters]
                if tolerance.parameter and tolerance.parameter not in own:
                    raise InputError(
                        f"the parameter {tolerance.parameter!r} of {effect.name}",
                        f"one of {', '.join(own)}", place=f"parts.{name}.tolerances",
                    )  # fmt: skip
        for assembly in parts.assemblies.values():
            for each in assembly.parts:
                parts.part(each, f"assemblies.{assembly.name}")
    except InputError as error:
        raise (error if error.file else error.at(file)) from error
