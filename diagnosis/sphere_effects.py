"""The catalogue for integrating spheres: what may differ between a set-up and its description.

Every entry moves one number of a `SphereChange`; `diagnosis.sphere_twin` says what it does.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from diagnosis.problem import Candidate, EffectValues
from twin.errors import InputError


@dataclass(frozen=True)
class SphereChange:
    """How a set-up differs from its description; zeros: not at all.

    Attributes:
        slides: share of the way from the described slides to their opposite (none, where there
            are some; glass of 1.5 and 1 mm, where there are none).
        slide_index: added to the slides' refractive index.
        index: added to the sample's refractive index.
        thickness: relative change of the sample's thickness.
        wall: added to the reflectance of the walls.
        port: relative change of the area of the sample ports.
        correction: share of the way from the described method to the other one: substitution,
            whose readings hold the sphere's answer to the sample, or comparison.
        standard: relative error of the reflectance of the reflectance standard.
        lost: relative change of the light that misses the ports; -1: nothing is lost.
        specular: share of the unscattered reflected light that is not collected in M_R.
        ballistic: share of the unscattered transmitted light not collected in M_T.
        acceptance: share of the scattered transmitted light that is collected in M_U.
        diluent: absorption [1/mm] that all dilutions have in common.
        offset: added to readings, by their name.
        concentration: relative error of a dilution's concentration, by the sample's name.
    """

    slides: float = 0.0
    slide_index: float = 0.0
    index: float = 0.0
    thickness: float = 0.0
    wall: float = 0.0
    port: float = 0.0
    correction: float = 0.0
    standard: float = 0.0
    lost: float = 0.0
    specular: float = 0.0
    ballistic: float = 0.0
    acceptance: float = 0.0
    diluent: float = 0.0
    offset: Mapping[str, float] = field(default_factory=dict)
    concentration: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class SphereEffect:
    """One entry of the catalogue.

    Attributes:
        name: in the catalogue.
        field: of `SphereChange` that it moves.
        parameter: name of its number; unit: its unit.
        prior_scale: magnitude that would not surprise; limit: the largest that can be asked.
        sign: 1, -1 or 0.
        each: what it has an instance for: "" (one only), "reading" or "sample".
        source: the physics, and where it is from.
    """

    name: str
    field: str
    parameter: str
    unit: str
    prior_scale: float
    limit: float
    sign: int
    source: str
    each: str = ""


_PRAHL = "Prahl (2011), manual of inverse adding-doubling"
_PICKERING = "Pickering et al. (1993), Applied Optics 32, 399"

CATALOGUE = (
    SphereEffect("slides", "slides", "share", "1", 0.5, 1.0, 1,
                 f"Fresnel reflections at two glass surfaces more or less; {_PRAHL}, sec. 3"),
    SphereEffect("slide_index", "slide_index", "index", "1", 0.05, 0.25, 0,
                 f"Fresnel reflections at the slides; {_PRAHL}, sec. 3"),
    SphereEffect("sample_index", "index", "index", "1", 0.03, 0.15, 0,
                 f"Fresnel and total reflection inside the sample; {_PRAHL}, sec. 3"),
    SphereEffect("thickness", "thickness", "relative change", "1", 0.03, 0.2, 0,
                 "optical depth is sigma_t times thickness; light spreads in proportion to it"),
    SphereEffect("wall_reflectance", "wall", "reflectance", "1", 0.01, 0.05, 0,
                 f"gain of a sphere; {_PICKERING}, eq. (5)"),
    SphereEffect("sample_port", "port", "relative area", "1", 0.1, 0.8, 0,
                 f"share of the wall that the sample takes; {_PICKERING}, eq. (5)"),
    SphereEffect("sphere_correction", "correction", "share", "1", 0.5, 1.0, 1,
                 f"single-beam substitution error or a dual beam without; {_PICKERING}, sec. 2"),
    SphereEffect("standard", "standard", "relative change", "1", 0.01, 0.1, 0,
                 "M_R is read in units of the reflectance standard"),
    SphereEffect("lost_light", "lost", "relative change", "1", 0.3, 1.0, 0,
                 f"light that leaves beside the ports; {_PRAHL}, sec. 6"),
    SphereEffect("specular_light", "specular", "share", "1", 0.3, 1.0, 1,
                 f"specular reflection leaves through the entrance port; {_PRAHL}, sec. 5"),
    SphereEffect("ballistic_light", "ballistic", "share", "1", 0.3, 1.0, 1,
                 f"unscattered light leaves through the exit port; {_PRAHL}, sec. 5"),
    SphereEffect("acceptance", "acceptance", "share", "1", 0.003, 0.05, 1,
                 "forward-scattered light in the aperture of the collimated detector"),
    SphereEffect("diluent_absorption", "diluent", "absorption", "1/mm", 0.01, 0.5, 1,
                 "what the dilutions have in common does not go with the concentration"),
    SphereEffect("dark_offset", "offset", "reading", "1", 0.002, 0.02, 0,
                 "a dark signal that was not, or twice, subtracted", "reading"),
    SphereEffect("concentration", "concentration", "relative change", "1", 0.03, 0.3, 0,
                 "a dilution that was made too strong or too weak", "sample"),
)  # fmt: skip
"""Ours, in the order in which light meets them."""


def candidates(
    effects: Sequence[SphereEffect], readings: Sequence[str], samples: Sequence[str]
) -> tuple[Candidate, ...]:
    """The candidates of a catalogue, one per instance."""
    found = []
    for effect in effects:
        instances = {"": ("",), "reading": readings, "sample": samples}[effect.each]
        for instance in instances:
            found.append(
                Candidate(
                    effect=effect.name,
                    instance=instance,
                    parameters=(effect.parameter,),
                    units=(effect.unit,),
                    prior_scale=(effect.prior_scale,),
                    sign=(effect.sign,),
                    limit=(effect.limit,),
                )
            )
    return tuple(found)


def change_of(values: EffectValues, effects: Sequence[SphereEffect] = CATALOGUE) -> SphereChange:
    """The set-up that effects make, by `Candidate.name`.

    Raises:
        InputError: a name that no effect has.
    """
    by_name = {effect.name: effect for effect in effects}
    change = SphereChange()
    for name, numbers in values.items():
        bare, _, rest = name.partition("[")
        if bare not in by_name:
            raise InputError(f"effect {name!r}", f"one of {', '.join(by_name)}", place="effects")
        effect, value = by_name[bare], float(np.asarray(numbers).ravel()[0])
        held = getattr(change, effect.field)
        moved: Any = {**held, rest.rstrip("]"): value} if effect.each else held + value
        change = replace(change, **{effect.field: moved})
    return change


def without(names: Iterable[str]) -> tuple[SphereEffect, ...]:
    """The catalogue without some effects.

    Raises:
        InputError: a name that no effect has.
    """
    own = [effect.name for effect in CATALOGUE]
    unwanted = list(names)
    for name in unwanted:
        if name not in own:
            raise InputError(f"effect {name!r}", f"one of {', '.join(own)}", place="without")
    return tuple(effect for effect in CATALOGUE if effect.name not in unwanted)
