"""One fluorescent material in two thicknesses, a set of LEDs, and the translucent bench."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from twin.bench import Bench, Medium, Sample
from twin.instrument import Spectrometer
from twin.spectra import FloatArray, SpectralTable

if TYPE_CHECKING:
    from twin.bispectral import FluorescentMedium, FluorescentProperties

LED_CENTRES_NM = (405.0, 430.0, 455.0, 480.0, 505.0, 530.0)
WHITE_LEDS = ("led_cool_white", "led_warm_white")
GRID_NM = (400.0, 700.0, 20.0)


def gaussian_leds(
    wavelength_nm: FloatArray,
    centre_nm: Sequence[float] = LED_CENTRES_NM,
    width_nm: float = 25.0,
) -> FloatArray:
    """Spectral power per nm of Gaussian LEDs, each 1 at its peak, (L, W).

    Args:
        wavelength_nm: (W,).
        centre_nm: of each LED, (L,).
        width_nm: full width at half maximum.
    """
    away = (np.asarray(wavelength_nm)[None, :] - np.asarray(centre_nm)[:, None]) / width_nm
    return np.asarray(np.exp(-4.0 * np.log(2.0) * away**2))


def _table(wavelength: FloatArray, value: FloatArray) -> SpectralTable:
    return SpectralTable(wavelength_nm=tuple(wavelength), value=tuple(value))


def default_medium(strength: float = 1.0, quantum_yield: float = 0.8) -> FluorescentMedium:
    """A milky resin with a green dye: sigma_s' near 2 / mm, absorption peak 0.15 / mm.

    Args:
        strength: factor on the dye's concentration.
        quantum_yield: of the dye.

    The numbers are made up in the range of translucent resins and of fluorescein-like dyes.
    """
    from twin.bispectral import FluorescentMedium, Fluorophore

    wave = np.arange(380.0, 721.0, 5.0)
    scattering = 5.0 * (wave / 550.0) ** -1.1
    absorption = 0.03 + 0.06 * np.exp(-(((wave - 610.0) / 45.0) ** 2))
    absorbs = 0.15 * np.exp(-0.5 * ((wave - 460.0) / 26.0) ** 2)
    emits = np.exp(-0.5 * ((wave - 535.0) / (np.where(wave < 535.0, 18.0, 32.0))) ** 2)
    total = scattering + absorption
    return FluorescentMedium(
        host=Medium(
            albedo=_table(wave, scattering / total), sigma_t_per_mm=_table(wave, total), g=0.6
        ),
        fluorophores=(
            Fluorophore(
                absorption_per_mm=_table(wave, absorbs),
                emission=_table(wave, emits),
                quantum_yield=quantum_yield,
                concentration=strength,
            ),
        ),
    )


def default_bench() -> Bench:
    """The translucent bench with a spectrometer of 20 nm that knows its own responsivity."""
    start, stop, step = GRID_NM
    instrument = Spectrometer(
        start_nm=start, stop_nm=stop, step_nm=step,
        # Known and calibrated away beforehand: what is left is noise and drift.
        off=("bandwidth", "stray_light", "nonuniformity"),
    )  # fmt: skip
    return Bench(instrument=instrument)


@dataclass(frozen=True, eq=False)
class Case:
    """What is measured, and with what.

    Attributes:
        bench: the bench; its instrument's pixels are the wavelengths of the case.
        samples: of one material.
        medium: the true medium.
        led_centre_nm, led_width_nm: the narrow LEDs; white_leds: lamps of the library.
    """

    bench: Bench = field(default_factory=default_bench)
    samples: tuple[Sample, ...] = (
        Sample(name="thin", thickness_mm=0.4, n=1.45),
        Sample(name="thick", thickness_mm=1.0, n=1.45),
    )
    medium: FluorescentMedium = field(default_factory=default_medium)
    led_centre_nm: tuple[float, ...] = LED_CENTRES_NM
    led_width_nm: float = 25.0
    white_leds: tuple[str, ...] = WHITE_LEDS

    @cached_property
    def wavelength_nm(self) -> FloatArray:
        """The instrument's pixels [nm], (W,)."""
        return np.asarray(self.bench.instrument.wavelength_nm, dtype=np.float64)

    @cached_property
    def properties(self) -> FluorescentProperties:
        """The true medium at the wavelengths."""
        from twin.bispectral import fluorescent_properties

        return fluorescent_properties(self.medium, self.wavelength_nm)

    @cached_property
    def leds(self) -> FloatArray:
        """Spectral power per nm of all LEDs, narrow ones first, (L, W)."""
        from twin.materials import lamp

        narrow = gaussian_leds(self.wavelength_nm, self.led_centre_nm, self.led_width_nm)
        white = [lamp(name, self.wavelength_nm)[None, :] for name in self.white_leds]
        return np.concatenate([narrow, *white])
