"""The backgrounds: how much they reflect, and how far they lie below the stack."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from twin.effects.effect import Effect, EffectParameter
from twin.effects.spectral import curved, shifted
from twin.effects.world import World
from twin.spectra import FloatArray

RED_NM, RED_WIDTH_NM = 640.0, 20.0
"""Where dyes of black materials let go: half of the rise, and its width."""
BLUE_NM, BLUE_WIDTH_NM = 430.0, 60.0
"""Where aged PTFE and plastics turn yellow."""


def _with(world: World, which: str, **fields: Any) -> World:
    background = world.bench.background
    own = {**getattr(background, which).model_dump(), **fields}
    return world.with_bench(background={**background.model_dump(), which: own})


def _level(world: World, values: Mapping[str, float], instance: str) -> World:
    old = world.bench.background.black.reflectance
    return _with(world, "black", reflectance=shifted(old, "reflectance", values["reflectance"]))


def _red(world: World, values: Mapping[str, float], instance: str) -> World:
    def rise(wavelength: FloatArray, old: FloatArray) -> FloatArray:
        step = 1.0 / (1.0 + np.exp(-(wavelength - RED_NM) / RED_WIDTH_NM))
        return np.asarray(old + values["reflectance"] * step)

    old = world.bench.background.black.reflectance
    return _with(world, "black", reflectance=curved(old, "reflectance", rise))


def _ageing(world: World, values: Mapping[str, float], instance: str) -> World:
    def yellow(wavelength: FloatArray, old: FloatArray) -> FloatArray:
        blue = np.exp(-np.maximum(wavelength - BLUE_NM, 0.0) / BLUE_WIDTH_NM)
        return np.asarray(old * (1.0 - values["level"] - values["blue"] * blue))

    old = world.bench.background.white.reflectance
    return _with(world, "white", reflectance=curved(old, "reflectance", yellow))


def _gap(world: World, values: Mapping[str, float], instance: str) -> World:
    background = world.bench.background
    gap = background.gap_mm + values["gap_mm"]
    return world.with_bench(background={**background.model_dump(), "gap_mm": gap})


def _gloss(world: World, values: Mapping[str, float], instance: str) -> World:
    own = getattr(world.bench.background, instance)
    return _with(world, instance, gloss=own.gloss + values["share"])


LEVEL = Effect(
    name="black_level",
    place="background",
    title="the black background reflects more or less than stated",
    physics="What crosses the sample comes back from the black: I_black gains about T1 T2 rho.",
    source="Kubelka 1954, J. Opt. Soc. Am. 44, 330 (abstract): R + T1 rho T2 / (1 - rho R')",
    parameters=(
        EffectParameter(
            "reflectance", "1", 0.0, 0.005, description="added to the reflectance", limit=0.9
        ),
    ),
    engine="plane",
    change=_level,
    plain=True,
)
RED = Effect(
    name="black_red",
    place="background",
    title="the black background reflects more in the red",
    physics="Dyed papers and cloths are black in the visible alone; their reflectance rises like "
    "a step, here around 640 nm with a width of 20 nm.",
    source="Marshall et al. 2014, SPIE 9147, 91474F (black materials); Kubelka 1954",
    parameters=(
        EffectParameter(
            "reflectance", "1", 0.0, 0.02, "positive", "reached far in the red", limit=0.9
        ),
    ),
    engine="plane",
    change=_red,
    plain=True,
)
AGEING = Effect(
    name="white_ageing",
    place="background",
    title="the white background has aged: it reflects less than its certificate says",
    physics="White reference and the capture over white both see it: I_black rises by rho_w "
    "(stated) over rho_w (true), I_white by less. Yellowing falls off from 430 nm with 60 nm.",
    source="Georgiev and Butler 2007, Appl. Opt. 46, 7892 (ageing of PTFE); Kubelka 1954",
    parameters=(
        EffectParameter("level", "1", 0.0, 0.01, "positive", "lost at every wavelength", limit=0.5),
        EffectParameter("blue", "1", 0.0, 0.01, "positive", "lost in the blue on top", limit=0.4),
    ),
    engine="plane",
    change=_ageing,
    plain=True,
)
GAP = Effect(
    name="gap",
    place="background",
    title="the gap between stack and background is another",
    physics="Light that crosses a wider gap spreads, and part of it misses the background or the "
    "stack on its way back; the plane of the white reference moves with it.",
    source="bench.md, background",
    parameters=(
        EffectParameter("gap_mm", "mm", 0.0, 0.5, "positive", "added to the gap", limit=50.0),
    ),
    engine="monte_carlo",
    change=_gap,
    plain=True,
)
GLOSS = Effect(
    name="gloss",
    place="background",
    title="the backgrounds are glossy",
    physics="A share of what a background reflects goes on like from a mirror, away from the "
    "detector that looks along the normal: less of it is seen through clear samples, and the "
    "bare white, the reference, shows less than its certificate says.",
    source="twin.bench.Background.gloss; CIE 15:2018 (specular component)",
    parameters=(
        EffectParameter(
            "share", "1", 0.0, 0.05, "positive", "of the reflectance, mirror-like", limit=1.0
        ),
    ),
    engine="monte_carlo",
    change=_gloss,
    instances=lambda world: ("black", "white"),
    plain=True,
)
EFFECTS = (LEVEL, RED, AGEING, GLOSS, GAP)
