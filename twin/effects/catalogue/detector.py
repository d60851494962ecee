"""The detector: its acceptance, its counts, its curve, its stray light."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin.effects.effect import Effect, EffectParameter
from twin.effects.world import (
    BEAM_REFERENCE,
    BLACK,
    COLLIMATED,
    LIT,
    WHITE,
    WHITE_REFERENCE,
    Rates,
    World,
)


def _acceptance(world: World, values: Mapping[str, float], instance: str) -> World:
    detector = world.bench.detector
    wider = detector.acceptance_deg + values["acceptance_deg"]
    return world.with_bench(detector={**detector.model_dump(), "acceptance_deg": wider})


def _offset(world: World, values: Mapping[str, float], instance: str) -> World:
    return world.changed(offset_counts=world.offset_counts + values["counts"])


def _stray(world: World, values: Mapping[str, float], instance: str) -> World:
    instrument = world.bench.instrument
    share = instrument.stray_light_fraction + values["fraction"]
    return _instrument(world, stray_light_fraction=share)


def _curve(world: World, values: Mapping[str, float], instance: str) -> World:
    instrument = world.bench.instrument
    return _instrument(world, nonlinearity=instrument.nonlinearity + values["at_full_well"])


def _instrument(world: World, **fields: float) -> World:
    instrument = world.bench.instrument
    return world.with_bench(instrument={**instrument.model_dump(), **fields})


@dataclass(frozen=True)
class GainStep:
    """Captures at another exposure than their reference: their light times exp(step)."""

    step: float

    def __call__(self, rates: Rates) -> Rates:
        """The light as it is then read."""
        factor = np.ones((len(rates.light), len(LIT)))
        for capture, reference in (
            (BLACK, WHITE_REFERENCE), (WHITE, WHITE_REFERENCE), (COLLIMATED, BEAM_REFERENCE),
        ):  # fmt: skip
            other = ~np.isclose(rates.exposure[:, capture], rates.exposure[:, reference], rtol=1e-6)
            factor[other, capture] = np.exp(self.step)
        scaled = rates
        for capture in (BLACK, WHITE, COLLIMATED):
            scaled = scaled.scaled((capture,), factor[:, capture, None])
        return scaled


def _gain(world: World, values: Mapping[str, float], instance: str) -> World:
    return world.with_step(GainStep(values["step"]))


APERTURE = Effect(
    name="aperture",
    place="detector",
    title="the detector accepts a wider cone than stated",
    physics="Light scattered by small angles joins the unscattered beam in the collimated "
    "capture: more of it the larger g and the optical thickness.",
    source="van de Hulst 1957, section 6.1 (forward scattering into an aperture)",
    parameters=(
        EffectParameter(
            "acceptance_deg", "deg", 0.0, 1.0, "positive", "added to the half-angle", limit=30.0
        ),
    ),
    engine="plane",
    change=_acceptance,
    plain=True,
)
OFFSET = Effect(
    name="dark_offset",
    place="detector",
    title="the dark reading is lower or higher than the dark level under light",
    physics="Counts that lit readings have and darks have not are taken for light: "
    "(S + d) / (W + d), most where there is little of it.",
    source="Janesick 2007, Photon Transfer, section 3 (offset)",
    parameters=(
        EffectParameter(
            "counts", "counts", 0.0, 20.0, description="in lit readings alone", limit=1e4
        ),
    ),
    engine="signal",
    change=_offset,
)
STRAY = Effect(
    name="stray_light",
    place="detector",
    title="the instrument has more stray light than described",
    physics="A share of all the light falls evenly over all pixels: where a lamp or a sample is "
    "dark, that is what is read.",
    source="Zong et al. 2006, Appl. Opt. 45, 1111 (stray light of array spectrometers)",
    parameters=(
        EffectParameter(
            "fraction", "1", 0.0, 0.002, "positive", "added to the stray-light fraction", limit=0.3
        ),
    ),
    engine="signal",
    change=_stray,
    plain=True,
)
CURVE = Effect(
    name="nonlinearity",
    place="detector",
    title="the detector's curve bends otherwise than described",
    physics="Counts are e (1 + c e / full well): bright references and dark samples are read with "
    "unlike gain.",
    source="Janesick 2007, Photon Transfer, section 7; twin.instrument.counts_of_electrons",
    parameters=(
        EffectParameter(
            "at_full_well",
            "1",
            0.0,
            0.005,
            description="added to the relative deviation at full well",
            limit=0.3,
        ),
    ),
    engine="signal",
    change=_curve,
    plain=True,
)
GAIN = Effect(
    name="gain_step",
    place="detector",
    title="readings at another exposure or gain than their reference are off",
    physics="Gain steps are not exact powers of two, and a shutter or a clock is off by a fixed "
    "time: captures whose exposure differs from their reference's are off by exp(step).",
    source="ams AS7341 data sheet DS000504 (gain error); traps.md, instruments",
    parameters=(
        EffectParameter(
            "step", "1", 0.0, 0.01, description="logarithm of the step", per="capture", limit=1.0
        ),
    ),
    engine="signal",
    change=_gain,
)
EFFECTS = (APERTURE, OFFSET, STRAY, CURVE, GAIN)
