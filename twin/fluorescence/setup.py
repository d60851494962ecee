"""A fluorescence bench as a person describes it: lights, detector, white, and what is captured."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from twin.errors import InputError
from twin.fluorescence.illuminants import Illuminant, binned_light
from twin.fluorescence.sets import PRICE_USD, as7341, light_set, spectrometer
from twin.fluorescence.system import FluorescenceSystem
from twin.instrument import Instrument, MultispectralChip, electron_rates
from twin.spectra import FloatArray, Part, Spectral

STEP_NM = 10.0
LAST_NM = 700.0
MOST_ILLUMINANTS = 64


class FluorescenceSetup(Part):
    """Lights, detector and white of one fluorescence bench (45/0, diffuse sample)."""

    name: str = Field(default="l1-s1", min_length=1)
    lights: tuple[Illuminant, ...]
    """Illuminants in the order in which they are lit; or "L1", "L2", "monochromator"."""
    detector: Instrument
    """The instrument; or "S1" (spectrometer), "S2" (AS7341)."""
    white: Spectral = 0.99
    """Certified reflectance of the white standard."""
    white_material: str | None = None
    """What the white really is in a simulation, when it is not what it should be: an example
    material of the library, such as "brightened_paper"."""
    emission_from_nm: float = Field(default=400.0, ge=250.0, le=600.0)
    """First emission wavelength [nm] of the matrix; the last is 700."""
    excitation_from_nm: float = Field(default=400.0, ge=250.0, le=600.0)
    """First excitation wavelength [nm]: below 400 it switches near-ultraviolet excitation on."""
    emission_to_nm: float = Field(default=LAST_NM, ge=600.0, le=1100.0)
    """Last wavelength [nm] of emission and excitation."""
    price_usd: float = Field(ge=0)
    """Price [USD] of lights and detector; of the seed's parts when both have its names."""

    @model_validator(mode="before")
    @classmethod
    def _names(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        data = dict(data)
        lights, detector = data.get("lights", "L1"), data.get("detector", "S1")
        if isinstance(lights, str):
            near = float(data.get("excitation_from_nm", 400.0)) < 400.0
            try:
                data["lights"] = light_set(lights, near_ultraviolet=near)
            except InputError as error:
                raise ValueError(f"found {error.found}; expected {error.expected}") from error
        if isinstance(detector, str):
            low = float(data.get("emission_from_nm", 400.0))
            high = float(data.get("emission_to_nm", LAST_NM))
            if detector == "S1":
                data["detector"] = spectrometer(low, high, STEP_NM)
            elif detector == "S2":
                data["detector"] = as7341((low, high))
            else:
                raise ValueError(f"found the detector {detector!r}; expected S1, S2 or a table")
        elif isinstance(detector, dict):
            data["detector"] = {"kind": "spectrometer", **detector}
        if "price_usd" not in data:
            if not (isinstance(lights, str) and isinstance(detector, str)):
                raise ValueError("found no price_usd; expected the price [USD] of own parts")
            data["price_usd"] = PRICE_USD[lights] + PRICE_USD[detector]
        return data

    @field_validator("lights")
    @classmethod
    def _lights(cls, value: tuple[Illuminant, ...]) -> tuple[Illuminant, ...]:
        if not 1 <= len(value) <= MOST_ILLUMINANTS:
            raise ValueError(f"found {len(value)} illuminants; expected 1 to {MOST_ILLUMINANTS}")
        names = [each.name for each in value]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"found the illuminant {twice[0]!r} twice; expected each name once")
        return value

    @model_validator(mode="after")
    def _grid(self) -> FluorescenceSetup:
        for name in ("emission_from_nm", "excitation_from_nm", "emission_to_nm"):
            if getattr(self, name) % STEP_NM:
                raise ValueError(
                    f"found {name} {getattr(self, name):g}; expected a multiple of {STEP_NM:g} nm"
                )
        if self.excitation_from_nm > self.emission_from_nm:
            raise ValueError(
                f"found excitation from {self.excitation_from_nm:g} nm, emission from"
                f" {self.emission_from_nm:g} nm; expected excitation to begin no later"
            )
        return self

    @property
    def emission_nm(self) -> FloatArray:
        """Emission wavelengths [nm] of the matrix, shape (Wo,)."""
        return np.arange(self.emission_from_nm, self.emission_to_nm + 0.5, STEP_NM)

    @property
    def excitation_nm(self) -> FloatArray:
        """Excitation wavelengths [nm] of the matrix, shape (Wi,)."""
        return np.arange(self.excitation_from_nm, self.emission_to_nm + 0.5, STEP_NM)

    @property
    def channel_names(self) -> tuple[str, ...]:
        """Names of the detector's channels: those of the chip, or wavelengths."""
        if isinstance(self.detector, MultispectralChip):
            return tuple(each.name for each in self.detector.channels)
        return tuple(f"{wavelength:g}" for wavelength in self.detector.wavelength_nm)

    @property
    def illuminant_names(self) -> tuple[str, ...]:
        """Names of the illuminants."""
        return tuple(each.name for each in self.lights)

    @property
    def passes(self) -> FloatArray:
        """Pass in which each channel is read, shape (K,).

        The AS7341 has six converters for its channels: F1 to F4 are read first, then F5 to F8.
        """
        count = len(self.detector.wavelength_nm)
        if not isinstance(self.detector, MultispectralChip):
            return np.zeros(count)
        return np.asarray((np.arange(count) >= min(4, (count + 1) // 2)).astype(np.float64))


class FluorescenceProtocol(Part):
    """What is captured, how often and how long."""

    repeats: int = Field(default=3, ge=1, le=1000)
    """Shots of the sample under every illuminant."""
    white_repeats: int = Field(default=3, ge=1, le=1000)
    """Shots of the white under every illuminant, each time; also darks at every setting."""
    references: Literal["first", "first_and_last"] = "first_and_last"
    """The white before the sample, or before and after it (then lamp drift averages out)."""
    exposure: float | Literal["auto"] = "auto"
    """Integration time [s] of every shot; "auto": under each illuminant the brighter of white and
    sample fills `fill` of the range, at one setting for both."""
    fill: float = Field(default=0.8, gt=0, lt=1)
    switch_s: float = Field(default=0.5, ge=0)
    """Time [s] from one illuminant to the next."""
    swap_s: float = Field(default=30.0, ge=0)
    """Time [s] to swap white and sample."""
    drive: float = Field(default=1.0, gt=0)
    """Current of all LEDs relative to the nominal one, all through the visit."""
    warmer_k: float = Field(default=0.0, ge=-50.0, le=100.0)
    """How much warmer [K] the lights are than when their spectra were measured."""
    warming_k: float = Field(default=0.0, ge=-50.0, le=100.0)
    """How much they warm [K] between the white and the sample."""


def detector_response(instrument: Instrument, emission_nm: FloatArray) -> FloatArray:
    """Signal of every channel per energy in a bin, its greatest value 1, shape (K, Wo).

    Raises:
        InputError: the bins do not cover what the instrument sees (`electron_rates` says which).
    """
    size = emission_nm.size
    rates = electron_rates(
        instrument, emission_nm, np.eye(size), reference=np.ones(size),
        peak_rate_electrons_per_s=1.0,
    )  # fmt: skip
    return np.asarray(rates.T / rates.max())


def nominal_system(
    setup: FluorescenceSetup, *, drive: float = 1.0, warmer_k: float = 0.0
) -> FluorescenceSystem:
    """The system of a set-up as its description says it: illuminants with a common peak of 1.

    Raises:
        InputError: an illuminant without light in the bins, a detector that they do not cover.
    """
    light = binned_light(setup.lights, setup.excitation_nm, drive=drive, warmer_k=warmer_k)
    peak = float(light.max())
    if peak <= 0.0:
        raise InputError("illuminants without any light in the bins", "light", place="lights")
    return FluorescenceSystem(
        light / peak,
        detector_response(setup.detector, setup.emission_nm),
        setup.emission_nm,
        setup.excitation_nm,
        setup.illuminant_names,
        setup.channel_names,
    )


def named_setup(name: str, **changes: Any) -> FluorescenceSetup:
    """One of the seed's set-ups: "l1-s1", "l1-s2", "l2-s1", "l2-s2" or "reference".

    Args:
        name: the set-up.
        changes: fields of `FluorescenceSetup` that differ.

    Raises:
        InputError: another name, or a change that does not fit.
    """
    from twin.toml import validate

    if name not in SETUPS:
        raise InputError(f"the set-up {name!r}", f"one of {', '.join(SETUPS)}", place="setup")
    lights, detector = SETUPS[name]
    return validate({"name": name, "lights": lights, "detector": detector, **changes},
                    FluorescenceSetup)  # fmt: skip


SETUPS = {
    "l1-s1": ("L1", "S1"),
    "l1-s2": ("L1", "S2"),
    "l2-s1": ("L2", "S1"),
    "l2-s2": ("L2", "S2"),
    "reference": ("monochromator", "S1"),
}
"""Lights and detector of the seed's set-ups (Iser, Lachiver, Wilkie 2023, table 1)."""
