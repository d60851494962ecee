"""Compositions: how a person writes a mixture in one line of TOML.

    intralipid(2.4%) + methylene_blue(40 umol/l)

Names of the library, each with its amount in parentheses, joined by "+". Amounts are a volume
fraction in % (scatterers, inks, media) or a concentration in mol/l, mmol/l, umol/l or nmol/l
(dyes). The rest of the volume is the solvent, water. A name without an amount is the undiluted
material.
"""

from __future__ import annotations

import re
from typing import Literal, NamedTuple

from twin.errors import InputError

_TERM = re.compile(
    r"\s*(?P<name>[A-Za-z][\w.\-]*)\s*(?:\(\s*(?P<number>[^\s()%]*?)\s*(?P<unit>%|[^\s()\d.]*)\s*\)\s*)?"
)
_JOIN = re.compile(r"\+(?![^(]*\))")

_UNITS: dict[str, tuple[Literal["volume", "molar"], float]] = {
    "%": ("volume", 0.01),
    "mol/l": ("molar", 1.0),
    "mmol/l": ("molar", 1e-3),
    "umol/l": ("molar", 1e-6),
    "\u00b5mol/l": ("molar", 1e-6),
    "\u03bcmol/l": ("molar", 1e-6),
    "nmol/l": ("molar", 1e-9),
}

EXAMPLE = '"intralipid(2.4%) + methylene_blue(40 umol/l)"'


class Ingredient(NamedTuple):
    """One term of a composition."""

    name: str
    amount: float | None
    """Volume fraction or concentration [mol/l]; None when the person gave none."""
    measure: Literal["volume", "molar"] | None


def is_composition(text: str) -> bool:
    """Whether a text has more to it than a name."""
    return "+" in text or "(" in text or ")" in text


def parse(text: str) -> tuple[Ingredient, ...]:
    """The ingredients of a composition, in the order in which they are written.

    Raises:
        InputError: a term that is not `name(amount unit)`, an unknown unit, an amount below 0 or
            a volume fraction above 100 %.
    """
    return tuple(_ingredient(term, text) for term in _JOIN.split(text))


def _ingredient(term: str, text: str) -> Ingredient:
    found = _TERM.fullmatch(term)
    if found is None:
        raise InputError(f'"{term.strip()}" in "{text}"', f"name(amount unit), as in {EXAMPLE}")
    name, number, unit = found["name"], found["number"], found["unit"]
    if number is None:
        return Ingredient(name, None, None)
    if unit not in _UNITS:
        raise InputError(
            f'the unit "{unit}" of {name} in "{text}"', "one of %, mol/l, mmol/l, umol/l, nmol/l"
        )
    measure, factor = _UNITS[unit]
    try:
        amount = float(number)
    except ValueError as error:
        raise InputError(f'the amount "{number}" of {name} in "{text}"', "a number") from error
    top = 100.0 if measure == "volume" else 100.0 / factor
    if not 0 <= amount <= top:
        raise InputError(
            f'the amount {number} {unit} of {name} in "{text}"', f"0 to {top:g} {unit}"
        )
    return Ingredient(name, amount * factor, measure)
