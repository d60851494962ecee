"""What can be wrong with a fluorescence bench: its illuminants and its channels, as arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from twin.effects.effect import Effect, EffectParameter
from twin.effects.world import Applied
from twin.spectra import FloatArray

MOST_INSTANCES = 12
"""More illuminants or channels than that are taken together: a spectrometer's, for one."""


@dataclass(frozen=True, eq=False)
class FluorescenceWorld:
    """Illuminants and channels of a fluorescence bench: I_jk = s_k Phi l_j (fluorescence.md).

    Attributes:
        wavelength_nm: [nm], increasing, shape (W,).
        illuminants: spectral power, shape (J, W).
        sensitivities: of the channels, shape (K, W).
        applied: the effects that made this world, in order.
    """

    wavelength_nm: FloatArray
    illuminants: FloatArray
    sensitivities: FloatArray
    applied: tuple[Applied, ...] = ()

    def readings(self, donaldson: FloatArray) -> FloatArray:
        """Readings, shape (J, K), of a Donaldson matrix [out, in], shape (W, W)."""
        return np.asarray(self.illuminants @ np.asarray(donaldson).T @ self.sensitivities.T)


def _moved(rows: FloatArray, wavelength: FloatArray, shift_nm: float) -> FloatArray:
    """Rows (N, W) moved towards longer wavelengths; beyond the ends they keep their last value."""
    return np.array([np.interp(wavelength - shift_nm, wavelength, row) for row in rows])


def _chosen(count: int, instance: str) -> list[int]:
    return list(range(count)) if instance == "all" else [int(instance.split()[-1]) - 1]


def _illuminants(world: FluorescenceWorld) -> tuple[str, ...]:
    return _named("illuminant", len(world.illuminants))


def _channels(world: FluorescenceWorld) -> tuple[str, ...]:
    return _named("channel", len(world.sensitivities))


def _named(what: str, count: int) -> tuple[str, ...]:
    if count > MOST_INSTANCES:
        return ("all",)
    return tuple(f"{what} {number + 1}" for number in range(count))


def _shift(
    world: FluorescenceWorld, values: Mapping[str, float], instance: str
) -> FluorescenceWorld:
    rows = world.illuminants.copy()
    for row in _chosen(len(rows), instance):
        rows[row] = _moved(rows[[row]], world.wavelength_nm, values["shift_nm"])[0]
    return replace(world, illuminants=rows)


def _ultraviolet(
    world: FluorescenceWorld, values: Mapping[str, float], instance: str
) -> FluorescenceWorld:
    rows = world.illuminants.copy()
    for row in _chosen(len(rows), instance):
        rows[row, 0] += values["share"] * rows[row].sum()
    return replace(world, illuminants=rows)


def _filter_leak(
    world: FluorescenceWorld, values: Mapping[str, float], instance: str
) -> FluorescenceWorld:
    rows = world.illuminants.copy()
    others = world.illuminants.sum(axis=0)
    for row in _chosen(len(rows), instance):
        rows[row] += values["share"] * rows[row].sum() * others / others.sum()
    return replace(world, illuminants=rows)


def _cross_talk(
    world: FluorescenceWorld, values: Mapping[str, float], instance: str
) -> FluorescenceWorld:
    rows = world.sensitivities
    if len(rows) < 2:
        return world
    beside = 0.5 * (np.concatenate([rows[:1], rows[:-1]]) + np.concatenate([rows[1:], rows[-1:]]))
    return replace(world, sensitivities=(1.0 - values["share"]) * rows + values["share"] * beside)


def _sensitivity(
    world: FluorescenceWorld, values: Mapping[str, float], instance: str
) -> FluorescenceWorld:
    rows = world.sensitivities.copy()
    for row in _chosen(len(rows), instance):
        moved = _moved(rows[[row]], world.wavelength_nm, values["shift_nm"])[0]
        rows[row] = moved * np.exp(values["level"])
    return replace(world, sensitivities=rows)


def _share(scale: float, description: str) -> EffectParameter:
    return EffectParameter("share", "1", 0.0, scale, "positive", description, limit=1.0)


def _shift_of(what: str) -> EffectParameter:
    return EffectParameter(
        "shift_nm", "nm", 0.0, 2.0, description=f"of the {what} to longer wavelengths", limit=30.0
    )


_SOURCE = "Iser, Lachiver and Wilkie 2023 (the bench); first order in the parameter"

EFFECTS = (
    Effect(
        "illuminant_shift", "fluorescence", "an illuminant's spectrum has moved",
        "LEDs move to longer wavelengths as they warm, by 0.03 to 0.1 nm per kelvin.",
        _SOURCE, (_shift_of("spectrum"),), "signal", _shift, _illuminants, "fluorescence",
    ),
    Effect(
        "ultraviolet_leak", "fluorescence", "an illuminant has near-ultraviolet light",
        "Light below the first wavelength excites, but no one measured it: the first wavelength "
        "stands for it.",
        _SOURCE, (_share(0.02, "of the illuminant's light"),), "signal", _ultraviolet,
        _illuminants, "fluorescence",
    ),
    Effect(
        "filter_leak", "fluorescence", "a filter lets other light through",
        "Part of the light of all illuminants together passes the filter of one.",
        _SOURCE, (_share(0.02, "of the illuminant's light"),), "signal", _filter_leak,
        _illuminants, "fluorescence",
    ),
    Effect(
        "cross_talk", "fluorescence", "channels see what belongs to their neighbours",
        "A share of each channel's sensitivity is that of the channels beside it.",
        _SOURCE, (_share(0.03, "that belongs to the neighbours"),), "signal", _cross_talk,
        lambda world: ("",) if len(world.sensitivities) > 1 else (), "fluorescence",
    ),
    Effect(
        "sensitivity_error", "fluorescence", "a channel's sensitivity is not the stated one",
        "Published sensitivities of one chip differ by up to 7 nm in the blue channels.",
        "traps.md, fluorescence: two published AS7341 sensitivities; ams DS000504",
        (
            _shift_of("sensitivity"),
            EffectParameter("level", "1", 0.0, 0.02, description="logarithm", limit=1.0),
        ),
        "signal", _sensitivity, _channels, "fluorescence",
    ),
)  # fmt: skip
"""The effects of a fluorescence visit."""
