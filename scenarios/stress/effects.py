"""What is true and not told: the effects of a plan, and the worlds that they make of its benches.

An entry of a plan is a set of candidates of `twin.effects` with their values. The bench of a visit
is the description; the entry changes the world, and the estimator is told the description.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from scenarios.stress.plan import NONE, EffectValues, StressPlan
from scenarios.stress.simulate import samples_of, visit_bench
from twin.bench import Bench
from twin.errors import InputError
from twin.toml import near_misses

if TYPE_CHECKING:
    from twin.effects import Candidate, World
    from twin.effects.world import SignalStep

PROBED = 6
"""Pixels at which a signal step is asked whether it mixes wavelengths."""


def cases_of(plan: StressPlan) -> tuple[str, ...]:
    """Names of what is true: "none", then the plan's entries in their order."""
    return (NONE, *plan.effects)


def world_of(plan: StressPlan, bench: Bench, name: str) -> World:
    """The world of one entry on a bench.

    Args:
        plan: has the entry.
        bench: as described: from `visit_bench`.
        name: of the entry, or "none".

    Raises:
        InputError: an unknown effect or parameter, or a value that cannot be.
    """
    from twin.effects import World

    world = World.nominal(bench, samples_of(plan))
    for each, values in plan.effects.get(name, {}).items():
        candidate = _candidate(world, each)
        world = candidate.apply(world, _values(candidate, values))
    return world


def check_effects(plan: StressPlan, file: object = "") -> None:
    """Make sure that every entry can happen on every bench in a visit of the stress test.

    Args:
        plan: with its entries.
        file: what messages call it.

    Raises:
        InputError: says the entry and why: unknown, out of bounds, or not to be held by a visit.
    """
    for name in plan.effects:
        for title, bench in plan.benches.items():
            try:
                _check(plan, bench, name)
            except InputError as error:
                where = "" if len(plan.benches) == 1 else f" (on the bench {title!r})"
                raise InputError(
                    error.found + where,
                    error.expected,
                    file=file,
                    place=".".join(part for part in ("effects", name, error.place) if part),
                    remedy=error.remedy,
                ) from error


def _check(plan: StressPlan, bench: Bench, name: str) -> None:
    from twin.materials import OpticalProperties
    from twin.transport.bench_captures import collected_share
    from twin.transport.geometry import height_of_stack

    visited = visit_bench(bench, plan.points_per_visit)
    plain = world_of(plan, visited, NONE)
    world = world_of(plan, visited, name)
    if world.shift_nm or world.shift_after_reference_nm:
        raise InputError(
            "an effect that shifts wavelengths",
            "one that a stress visit can hold: light is known at the labelled wavelengths alone",
        )
    instrument, described = world.bench.instrument, plain.bench.instrument
    if instrument.wavelength_nm != described.wavelength_nm or instrument.has("bandwidth"):
        raise InputError(
            "an effect on where or how widely pixels look",
            "one that a stress visit can hold: every pixel sees its own wavelength alone",
        )
    if not plan.materials.spectra:
        stray = instrument.stray_light_fraction != described.stray_light_fraction
        if stray or any(_mixes(step, world) for step in world.steps):
            raise InputError(
                "an effect that mixes wavelengths",
                "one that a visit can hold that carries another material at every wavelength",
                remedy="Set materials.spectra = true: there every visit measures one spectrum.",
            )
    for view in world.views():
        for sample in view.samples:
            collected_share(view.bench, height_of_stack(view.bench, sample))
    share, second_g = world.second_lobe
    ends = np.array(plan.materials.g)
    OpticalProperties(ends, ends, ends, ends, None, share, second_g).require_lobes()


def _candidate(world: World, name: str) -> Candidate:
    """A candidate by name, with what was probably meant.

    Raises:
        InputError: no such effect, or nothing that it can happen to.
    """
    from twin.effects import Candidate, catalogue

    family, bracket, rest = name.partition("[")
    effects = {e.name: e for e in catalogue().effects if e.visit == "translucent"}
    if family not in effects:
        if family in catalogue().names:
            expected = "one of a visit with the panels and the beam"
            raise InputError(f'"{name}", an effect of fluorescence visits', expected)
        raise InputError(
            f'the unknown effect "{name}"',
            f"one of {', '.join(effects)}",
            remedy=near_misses(family, tuple(effects)),
        )
    effect = effects[family]
    known = [Candidate(effect, instance).name for instance in effect.instances(world)]
    if not known:
        raise InputError(
            f'"{name}", which nothing in a stress visit to this bench can have',
            "an effect on something that is there (pixels see their own wavelength alone)",
        )
    if name not in known:
        raise InputError(f'"{name}"', f"one of {', '.join(known)}", remedy=near_misses(name, known))
    return Candidate(effect, rest.removesuffix("]") if bracket else "")


def _values(candidate: Candidate, values: EffectValues) -> Mapping[str, float]:
    """Values by parameter; a number is that of the only one.

    Raises:
        InputError: a number for several parameters, or an unknown parameter.
    """
    known = [parameter.name for parameter in candidate.parameters]
    if not isinstance(values, Mapping):
        if len(known) > 1:
            table = ", ".join(f"{name} = ..." for name in known)
            raise InputError(
                f"{values:g} for {len(known)} values", f"{{ {table} }}", place=candidate.name
            )
        return {known[0]: values}
    for name in values:
        if name not in known:
            raise InputError(
                f"the unknown value `{name}`",
                f"one of {', '.join(known)}",
                place=candidate.name,
                remedy=near_misses(name, known),
            )
    return values


def _mixes(step: SignalStep, world: World) -> bool:
    """Whether what one pixel reads depends on the light of others."""
    from twin.effects import LIT, Rates

    pixels = np.asarray(world.bench.instrument.wavelength_nm, dtype=np.float64)
    grid = np.linspace(pixels[0], pixels[-1], PROBED)
    count = len(world.samples)
    rates = Rates(
        grid,
        np.full((count, len(LIT), PROBED), 0.5),
        np.ones((count, len(LIT))),
        np.ones(PROBED),
        np.ones((2, PROBED)),
    )
    own = step(rates).light
    for pixel in range(PROBED):
        light = rates.light.copy()
        light[:, 3:, pixel] *= 0.5  # of the captures with a sample
        changed = np.abs(step(replace(rates, light=light)).light - own)
        if np.delete(changed, pixel, axis=-1).max() > 1e-12:
            return True
    return False
