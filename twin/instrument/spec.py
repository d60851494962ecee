"""Descriptions of the two kinds of instrument: what a person writes in a bench file.

Every noise contribution and every imperfection has its own parameter and can be switched off by
name (`off`). Sources of the defaults: docs/instrument.md.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, field_validator, model_validator

from twin.spectra import Part, SpectralTable

Contribution = Literal[
    "bandwidth",
    "stray_light",
    "nonuniformity",
    "nonlinearity",
    "shot_noise",
    "dark_current",
    "read_noise",
    "quantisation",
    "saturation",
    "averages",
    "lamp_drift",
]
"""Everything between the light and the counts that can be switched off by name."""


class Sensor(Part):
    """What a spectrometer and a multispectral chip have in common."""

    serial: int = Field(default=1, ge=0, lt=2**63)
    """Serial number; the fixed pattern of the pixels is drawn from it."""
    averages: int = Field(default=10, ge=1, le=100_000)
    """Frames averaged into one shot."""
    read_noise_electrons: float = Field(default=31.0, ge=0)
    """Standard deviation [electrons] of the read-out, per frame."""
    dark_level_counts: float = Field(default=2396.0, ge=0)
    """Offset [counts] without any charge."""
    dark_current_electrons_per_s: float = Field(default=300.0, ge=0)
    """Thermal charge [electrons/s] per pixel."""
    photo_response_nonuniformity: float = Field(default=0.005, ge=0, le=0.3)
    """Relative standard deviation of the pixels' sensitivity: a fixed pattern."""
    stray_light_fraction: float = Field(default=5e-4, ge=0, lt=0.5)
    """Fraction of all the light that falls evenly over all pixels instead of on its own."""
    nonlinearity: float = Field(default=-0.002, gt=-0.5, lt=0.5)
    """Relative deviation of the reading at full well; grows in proportion to the charge."""
    white_rate_electrons_per_s: float = Field(default=4e6, gt=0)
    """Signal [electrons/s] of the brightest pixel under the white reference."""
    beam_rate_electrons_per_s: float = Field(default=1e7, gt=0)
    """Signal [electrons/s] of the brightest pixel under the beam reference."""
    responsivity: float | SpectralTable = 1.0
    """Relative electrons per unit of spectral power at each wavelength."""
    lamp_flicker: float = Field(default=1e-4, ge=0, le=0.2)
    """Relative standard deviation of the lamp's level, independent from shot to shot."""
    lamp_walk: float = Field(default=4.7e-4, ge=0, le=0.2)
    """Relative standard deviation of the random walk of the lamp's level, per shot."""
    lamp_tilt_walk: float = Field(default=1e-4, ge=0, le=0.2)
    """The same for a tilt: +1 of it at the last pixel, -1 at the first, none in the middle."""
    off: tuple[Contribution, ...] = ()
    """Contributions switched off by name."""

    @field_validator("responsivity")
    @classmethod
    def _responds(cls, value: float | SpectralTable) -> float | SpectralTable:
        lowest = value if isinstance(value, float) else min(value.value)
        if lowest <= 0:
            raise ValueError(f"found a responsivity of {lowest:g}; expected values above 0")
        return value

    @field_validator("off")
    @classmethod
    def _once(cls, value: tuple[Contribution, ...]) -> tuple[Contribution, ...]:
        if len(set(value)) != len(value):
            raise ValueError(f"found {', '.join(value)}; expected every contribution once")
        return value

    def has(self, contribution: Contribution) -> bool:
        """Whether a contribution is switched on."""
        return contribution not in self.off

    @property
    def frames(self) -> int:
        """Frames in one shot: `averages`, or 1 when "averages" is off."""
        return self.averages if self.has("averages") else 1


class Spectrometer(Sensor):
    """A grating spectrometer with a line sensor; the defaults resemble an Ocean Optics QE65."""

    kind: Literal["spectrometer"] = "spectrometer"
    start_nm: float = Field(default=400.0, gt=0)
    """Wavelength [nm] of the first pixel."""
    stop_nm: float = Field(default=700.0, gt=0)
    """Wavelength [nm] of the last pixel (not passed by more than a rounding error)."""
    step_nm: float = Field(default=2.0, gt=0)
    """Distance [nm] between pixels."""
    pixels_nm: tuple[float, ...] | None = None
    """Wavelength [nm] of every pixel, increasing; replaces start, stop and step."""
    bandwidth_nm: float = Field(default=2.0, gt=0)
    """Full width [nm] at half maximum of the Gaussian that a monochromatic line becomes."""
    electrons_per_count: float = Field(default=22.0, gt=0)
    """Conversion [electrons/count]."""
    full_well_electrons: float = Field(default=1.5e6, gt=0)
    """Charge [electrons] that a pixel holds."""
    adc_bits: int = Field(default=16, ge=4, le=24)
    """Bits of the converter: full scale is 2**bits - 1 counts."""
    shortest_s: float = Field(default=0.008, gt=0)
    """Shortest integration time [s]."""
    longest_s: float = Field(default=60.0, gt=0)
    """Longest integration time [s]."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.pixels_nm is not None:
            if not self.pixels_nm:
                raise ValueError("found no pixel in pixels_nm; expected one or more")
            _increasing("pixels_nm", self.pixels_nm)
        elif self.stop_nm < self.start_nm:
            raise ValueError(
                f"found stop_nm {self.stop_nm:g} below start_nm {self.start_nm:g};"
                " expected a grid that increases"
            )
        elif (self.stop_nm - self.start_nm) / self.step_nm > 20_000:
            raise ValueError(f"found step_nm {self.step_nm:g}; expected at most 20000 pixels")
        if self.longest_s < self.shortest_s:
            raise ValueError(
                f"found longest_s {self.longest_s:g} below shortest_s {self.shortest_s:g};"
                " expected the longest time to be the longer one"
            )
        _dark_below_full_scale(self.dark_level_counts, self.full_scale_counts)
        return self

    @property
    def wavelength_nm(self) -> tuple[float, ...]:
        """Wavelengths [nm] of the pixels, increasing, P of them."""
        if self.pixels_nm is not None:
            return self.pixels_nm
        count = int(np.floor((self.stop_nm - self.start_nm) / self.step_nm + 1e-9)) + 1
        return tuple(float(self.start_nm + index * self.step_nm) for index in range(count))

    @property
    def fwhm_nm(self) -> tuple[float, ...]:
        """Full width [nm] at half maximum of every pixel's response, P of them."""
        return (self.bandwidth_nm,) * len(self.wavelength_nm)

    @property
    def full_scale_counts(self) -> int:
        """Highest number [counts] the converter can say."""
        return int(2**self.adc_bits - 1)


class Channel(Part):
    """One channel of a multispectral chip."""

    name: str = Field(min_length=1)
    centre_nm: float = Field(gt=0)
    """Centre [nm] of the band."""
    fwhm_nm: float = Field(gt=0)
    """Full width [nm] at half maximum of the Gaussian band."""
    sensitivity: float = Field(default=1.0, gt=0)
    """Signal relative to the other channels under light of constant power per nm."""
    response: SpectralTable | None = None
    """Measured relative response over the whole range of the chip; replaces the Gaussian."""

    @field_validator("response")
    @classmethod
    def _responds(cls, value: SpectralTable | None) -> SpectralTable | None:
        if value is not None and (min(value.value) < 0 or max(value.value) <= 0):
            raise ValueError(
                f"found responses {min(value.value):g} to {max(value.value):g};"
                " expected none below 0 and some above"
            )
        return value


AS7341_CHANNELS = (
    Channel(name="F1", centre_nm=415, fwhm_nm=26, sensitivity=0.30),
    Channel(name="F2", centre_nm=445, fwhm_nm=30, sensitivity=0.44),
    Channel(name="F3", centre_nm=480, fwhm_nm=36, sensitivity=0.61),
    Channel(name="F4", centre_nm=515, fwhm_nm=39, sensitivity=0.82),
    Channel(name="F5", centre_nm=555, fwhm_nm=39, sensitivity=0.93),
    Channel(name="F6", centre_nm=590, fwhm_nm=40, sensitivity=1.00),
    Channel(name="F7", centre_nm=630, fwhm_nm=50, sensitivity=0.72),
    Channel(name="F8", centre_nm=680, fwhm_nm=52, sensitivity=0.91),
)
"""The eight bands of the ams AS7341: centres and widths of ams-OSRAM data sheet DS000504 (v3-00,
2020), sensitivities from the areas (380 to 780 nm) of the maker's filter templates."""

CHIP_GAINS = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0, 512.0)
"""Nominal gains of the AS7341 (register CFG1)."""

CHIP_STEP_S = 2.78e-6
"""Length [s] of one integration step of the AS7341."""


class MultispectralChip(Sensor):
    """A chip with a few broad channels; the defaults resemble an ams AS7341."""

    kind: Literal["chip"] = "chip"
    channels: tuple[Channel, ...] = Field(default=AS7341_CHANNELS, min_length=1)
    """Channels in the order of their centres."""
    range_nm: tuple[float, float] = (380.0, 780.0)
    """Wavelengths [nm] outside which no light is expected: the bands end there."""
    leak_fraction: float = Field(default=0.1, ge=0, lt=1)
    """Share of a channel's response that is flat over the whole range (cross-talk of filters,
    leaks); goes with "stray_light" when that is off."""
    gain: float = 16.0
    """Nominal gain, one of 0.5, 1, 2, 4 ... 512."""
    atime: int = Field(default=99, ge=0, le=255)
    """Register ATIME."""
    astep: int = Field(default=999, ge=0, le=65534)
    """Register ASTEP."""
    electrons_per_count_gain1: float = Field(default=1600.0, gt=0)
    """Conversion [electrons/count] at gain 1."""
    read_noise_electrons: float = Field(default=100.0, ge=0)
    dark_level_counts: float = Field(default=3.0, ge=0)
    photo_response_nonuniformity: float = Field(default=0.02, ge=0, le=0.3)
    stray_light_fraction: float = Field(default=0.0, ge=0, lt=0.5)
    white_rate_electrons_per_s: float = Field(default=1.5e7, gt=0)
    beam_rate_electrons_per_s: float = Field(default=3e7, gt=0)

    @field_validator("gain")
    @classmethod
    def _gain(cls, value: float) -> float:
        if value not in CHIP_GAINS:
            raise ValueError(f"found {value:g}; expected one of 0.5, 1, 2, 4, 8, ... 512")
        return value

    @model_validator(mode="after")
    def _check(self) -> Self:
        _increasing("channels", self.wavelength_nm)
        low, high = self.range_nm
        if not 0 < low < high:
            raise ValueError(f"found range_nm {low:g} to {high:g}; expected it to increase from >0")
        short = [
            c.name
            for c in self.channels
            if c.response is not None
            and (c.response.wavelength_nm[0] > low or c.response.wavelength_nm[-1] < high)
        ]
        if short:
            raise ValueError(
                f"found a response of {', '.join(short)} that does not cover range_nm;"
                f" expected values from {low:g} to {high:g} nm"
            )
        outside = [c.name for c in self.channels if not low <= c.centre_nm <= high]
        if outside:
            raise ValueError(
                f"found the centre of {', '.join(outside)} outside range_nm {low:g} to {high:g};"
                " expected every centre inside"
            )
        _dark_below_full_scale(self.dark_level_counts, self.full_scale_counts)
        return self

    @property
    def wavelength_nm(self) -> tuple[float, ...]:
        """Centres [nm] of the channels, increasing, P of them."""
        return tuple(channel.centre_nm for channel in self.channels)

    @property
    def fwhm_nm(self) -> tuple[float, ...]:
        """Full width [nm] at half maximum of every channel, P of them."""
        return tuple(channel.fwhm_nm for channel in self.channels)

    @property
    def steps(self) -> int:
        """Integration steps (ATIME + 1)(ASTEP + 1)."""
        return (self.atime + 1) * (self.astep + 1)

    @property
    def integration_s(self) -> float:
        """Integration time [s]."""
        return self.steps * CHIP_STEP_S

    @property
    def shortest_s(self) -> float:
        """Integration time [s]: the registers fix it."""
        return self.integration_s

    @property
    def longest_s(self) -> float:
        """Integration time [s]: the registers fix it."""
        return self.integration_s

    @property
    def electrons_per_count(self) -> float:
        """Conversion [electrons/count] at the gain that is set."""
        return self.electrons_per_count_gain1 / self.gain

    @property
    def full_scale_counts(self) -> int:
        """Highest number [counts]: min(65535, (ATIME + 1)(ASTEP + 1))."""
        return min(65535, self.steps)

    @property
    def full_well_electrons(self) -> float:
        """Charge [electrons] at full scale: the converter balances it, nothing overflows."""
        return self.full_scale_counts * self.electrons_per_count


Instrument = Annotated[Spectrometer | MultispectralChip, Field(discriminator="kind")]
"""Either kind of instrument; a file says which with `kind`."""


def _increasing(what: str, wavelength_nm: tuple[float, ...]) -> None:
    for before, after in pairwise(wavelength_nm):
        if after <= before:
            raise ValueError(
                f"found {after:g} nm after {before:g} nm in {what}; expected them to increase"
            )
    if wavelength_nm[0] <= 0:
        raise ValueError(f"found {wavelength_nm[0]:g} nm in {what}; expected wavelengths above 0")


def _dark_below_full_scale(dark_level_counts: float, full_scale_counts: int) -> None:
    if dark_level_counts >= full_scale_counts:
        raise ValueError(
            f"found dark_level_counts {dark_level_counts:g}; expected it below the full scale of"
            f" {full_scale_counts} counts"
        )
