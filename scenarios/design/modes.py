"""How every imperfection of a part moves the captures, per unit of its tolerance.

Inputs of the uncertainty budget follow from the slopes of the light; effects of the catalogue from
their own change of the world (`twin.effects`): after the light, or by the plane-parallel engine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from scenarios.design.bands import View
from scenarios.design.media import Medium
from scenarios.design.noise import Settings
from scenarios.design.optics import SLOPES, Light, Optics, calls
from scenarios.design.parts import INPUTS
from twin.bench import Bench, Sample
from twin.effects import (
    Candidate,
    EffectParameter,
    FastLight,
    Readout,
    World,
    expected_intensities,
)
from twin.errors import InputError
from twin.materials import reflectance
from twin.spectra import FloatArray

PRIVATE = ("thickness_mm", "thickness_relative")
"""Inputs of which every sample has its own."""
ANGLE_STEP = 0.05
"""Relative half-step of the difference by the acceptance angle."""
SMALL_STEP = 0.1
"""Share of an effect's prior scale over which its slope is taken (`twin.effects.EffectEngine`)."""
UNSEEN = "monte_carlo"


@dataclass(frozen=True, eq=False)
class Modes:
    """Changes of the captures by unit tolerances.

    Attributes:
        common: names of the Q that all samples share.
        private: names of the P that every sample has of its own.
        array: shape (M, K, W, 3, Q + P); the common ones first.
    """

    common: tuple[str, ...]
    private: tuple[str, ...]
    array: FloatArray


def is_private(name: str) -> bool:
    """Whether every sample has its own error of a tolerance."""
    if name in PRIVATE:
        return True
    if name in INPUTS:
        return False
    return effect_parameter(name)[1].per == "sample" and "[" not in name


def checked(names: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Common and private names of tolerances.

    Raises:
        InputError: an effect that the fast engine does not see.
    """
    for name in names:
        if name in INPUTS:
            continue
        effect, _ = effect_parameter(name)
        if effect.engine == UNSEEN:
            raise InputError(
                f"a tolerance of {name}, which the Monte Carlo alone sees",
                "an effect that the plane-parallel engine sees, or one after the light",
                place="tolerances",
            )
    private = tuple(name for name in names if is_private(name))
    return tuple(name for name in names if name not in private), private


def modes(
    names: Sequence[str], optics: Optics, bench: Bench, settings: Settings, light: Light, view: View
) -> Modes:  # fmt: skip
    """Changes of the captures by tolerances on one bench.

    Args:
        names: of inputs and effects ("effect[instance].parameter").
        optics: materials (M) and thicknesses (K).
        bench: nominal.
        settings: of its references.
        light: of the bench, as its detector sees it.
        view: of the detector.

    Raises:
        InputError: an unknown effect, one that this bench cannot have, or one that the fast engine
            does not see.
    """
    common, private = checked(names)
    columns = [
        _input(name, optics, bench, light, view)
        if name in INPUTS
        else _effect(name, optics, bench, settings, light, view)
        for name in (*common, *private)
    ]
    shape = (*light.value.shape, 0)
    array = np.stack(columns, axis=-1) if columns else np.zeros(shape)
    return Modes(common, private, array)


def _input(name: str, optics: Optics, bench: Bench, light: Light, view: View) -> FloatArray:
    slope = dict(zip(SLOPES, np.moveaxis(light.slope, -1, 0), strict=True))
    if name in ("thickness_mm", "n"):
        return np.asarray(slope[name])
    if name == "thickness_relative":
        return np.asarray(slope["thickness_mm"] * np.array(optics.thickness_mm)[:, None, None])
    if name == "acceptance_relative":
        ends = []
        for factor in (1.0 - ANGLE_STEP, 1.0 + ANGLE_STEP):
            angle = bench.detector.acceptance_deg * factor
            detector = bench.detector.model_copy(update={"acceptance_deg": angle})
            moved = bench.model_copy(update={"detector": detector})
            ends.append(view.light(optics, moved).value)
        return (ends[1] - ends[0]) / (2.0 * ANGLE_STEP)
    which = name.removesuffix("_relative")
    background = bench.background.black if which == "rho_black" else bench.background.white
    found = slope[which] * reflectance(background.reflectance, view.wavelength_nm)[:, None]
    if which == "rho_white":
        # the white is the reference too: captures read by the panels scale with it
        found = found - light.value * np.array([1.0, 1.0, 0.0])
    return np.asarray(found)


@lru_cache(maxsize=1024)
def effect_parameter(name: str) -> tuple[Candidate, EffectParameter]:
    """The effect and its parameter that a tolerance is of, such as "drift[panels].level".

    Raises:
        InputError: an effect that the catalogue does not know.
    """
    from twin.effects import catalogue

    head, _, wanted = name.partition("].") if "]." in name else name.partition(".")
    text = f"{head}]" if "]." in name else head
    effect = catalogue().effect(text.partition("[")[0])
    chosen = [p for p in effect.parameters if p.name == wanted] or list(effect.parameters[:1])
    instance = text.partition("[")[2].removesuffix("]")
    return Candidate(effect, instance), chosen[0]


def _effect(
    name: str, optics: Optics, bench: Bench, settings: Settings, light: Light, view: View
) -> FloatArray:
    own, parameter = effect_parameter(name)
    size = parameter.prior_scale * (1.0 if parameter.even else SMALL_STEP)
    step = -size if parameter.sign == "negative" else size
    ends = [step]
    # what acts on the signals is linear over so small a step: one side is enough
    if own.engine != "signal" and not parameter.even and parameter.sign == "any":
        ends.append(-step)
    change = _after_light if own.engine == "signal" else _by_engine
    found = [
        change(own, parameter, parameter.nominal + end, optics, bench, settings, light, view) / end
        for end in ends
    ]
    return np.asarray(np.mean(found, axis=0))


def _after_light(
    own: Candidate, parameter: EffectParameter, value: float, optics: Optics, bench: Bench,
    settings: Settings, light: Light, view: View,
) -> FloatArray:  # fmt: skip
    """Change by an effect that acts on the signals: all samples of all materials at once."""
    shape = light.value.shape
    count = shape[0] * shape[1]
    flat = light.value.reshape(count, *shape[2:]).transpose(1, 0, 2)
    samples = [Sample(name=f"{number}", thickness_mm=1.0 + number) for number in range(count)]
    world = World.nominal(bench, samples)
    readout = _readout(settings, light, view.wavelength_nm)
    instance = own.instance or own.effect.instances(world)[0]
    changed = Candidate(own.effect, instance).apply(world, {parameter.name: value})
    moved = expected_intensities(changed, flat, view.wavelength_nm, readout)
    still = expected_intensities(world, flat, view.wavelength_nm, readout)
    return np.asarray((moved - still).transpose(1, 0, 2).reshape(shape))


def _readout(settings: Settings, light: Light, wavelength_nm: FloatArray) -> Readout:
    shape = light.value.shape
    count = shape[0] * shape[1]
    seconds, gain = np.empty((2, count, 6))
    for array, pair in ((seconds, settings.seconds), (gain, settings.gain)):
        array[:] = pair[0]
        array[:, [2, 5]] = pair[1]
    long, stronger = settings.collimated(light.value[..., 2])
    seconds[:, 5], gain[:, 5] = long.reshape(-1), stronger.reshape(-1)
    white, beam = (np.tile(each, (count, 1)) for each in (settings.white, settings.beam))
    return Readout(wavelength_nm, white, beam, seconds, gain)


def _by_engine(
    own: Candidate, parameter: EffectParameter, value: float, optics: Optics, bench: Bench,
    settings: Settings, light: Light, view: View,
) -> FloatArray:  # fmt: skip
    """Change by an effect that the plane-parallel engine sees."""
    together = [
        Sample(name=f"{mm:g} mm", thickness_mm=mm, n=optics.media[0].n)
        for mm in optics.thickness_mm
    ]
    if own.effect.instances(World.nominal(bench, together)) == ("",):
        first = own.apply(World.nominal(bench, together), {parameter.name: value})
        if _of_bench_alone(first):
            # one bench for all samples: solved once, and kept for other detectors and lamps
            return np.asarray(view.light(optics, first.bench).value - light.value)
    worlds = [
        [_changed(own, parameter, value, bench, medium, mm) for mm in optics.thickness_mm]
        for medium in optics.media
    ]
    found = np.empty_like(light.value)
    for m, row in enumerate(worlds):
        for k, world in enumerate(row):
            moved = view.value(_light(world, optics.media[m], view.solved_nm))
            found[m, k] = moved - light.value[m, k]
    return found


def _changed(
    own: Candidate, parameter: EffectParameter, value: float, bench: Bench, medium: Medium,
    thickness_mm: float,
) -> World:  # fmt: skip
    sample = Sample(name="one", thickness_mm=thickness_mm, n=medium.n)
    world = World.nominal(bench, [sample])
    instance = own.instance or own.effect.instances(world)[0]
    return Candidate(own.effect, instance).apply(world, {parameter.name: value})


def _of_bench_alone(world: World) -> bool:
    same = world.samples == world.described_samples and not world.second_lobe[0]
    return same and len(world.views()) == 1


def _light(world: World, medium: Medium, wavelength_nm: FloatArray) -> FloatArray:
    """Light of a world with one sample, (W, 3)."""
    return np.concatenate(
        [
            FastLight(own).captures(world, medium.at(own))[:count, 0]
            for own, count in calls(wavelength_nm)
        ]
    )
