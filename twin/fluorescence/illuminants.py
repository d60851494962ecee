"""Lights of the fluorescence bench: LEDs, filters on a white panel, a monochromator.

A spectrum here is relative power per nm; all illuminants of one set share one scale, so that an
LED of half the power is half as bright. Energy per bin of the Donaldson matrix comes from
`binned_light`.
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from twin.errors import InputError
from twin.spectra import FloatArray, Part, Spectral, SpectralTable

# (g + 2 g^5) / 3 is 1/2 at g = 0.80847: the width of Ohno's shape in units of its parameter.
_HALF_WIDTH = float(np.sqrt(-np.log(0.8084734)))
_SHOWN_NM = 1.0


class _Light(Part):
    name: str = Field(min_length=1)
    power: float = Field(default=1.0, gt=0)
    """Peak power per nm relative to the other illuminants of the set."""
    nanometres_per_kelvin: float = 0.0
    """Shift [nm/K] of the whole spectrum with the temperature."""
    per_kelvin: float = Field(default=0.0, gt=-0.1, lt=0.1)
    """Relative change of the power [1/K] with the temperature."""
    nanometres_per_decade: float = 0.0
    """Shift [nm] when the drive current grows ten times."""

    def _shape(self, wavelength: FloatArray) -> FloatArray:
        raise InputError(type(self).__name__, "an illuminant with a spectrum", place="kind")

    def spectrum(
        self, wavelength_nm: ArrayLike, *, drive: float = 1.0, warmer_k: float = 0.0
    ) -> FloatArray:
        """Relative power per nm, shape (W,), at wavelengths [nm], shape (W,).

        Args:
            wavelength_nm: wavelengths [nm].
            drive: current relative to the nominal one: power goes with it.
            warmer_k: temperature above the nominal one [K].

        Raises:
            InputError: a drive of 0 or below, or a temperature at which no power is left.
        """
        if not drive > 0.0:
            raise InputError(f"a drive of {drive:g}", "above 0", place="drive")
        level = self.power * drive * (1.0 + self.per_kelvin * warmer_k)
        if level <= 0.0:
            raise InputError(f"{warmer_k:g} K warmer", "a temperature with light", place=self.name)
        shift = self.nanometres_per_kelvin * warmer_k + self.nanometres_per_decade * np.log10(drive)
        return level * self._shape(np.asarray(wavelength_nm, dtype=np.float64) - shift)


class Led(_Light):
    """A narrow LED with the shape of Ohno 2005 (Opt. Eng. 44, 111302, equation 1)."""

    kind: Literal["led"] = "led"
    peak_nm: float = Field(gt=0)
    fwhm_nm: float = Field(gt=0)

    def _shape(self, wavelength: FloatArray) -> FloatArray:
        scaled = 2.0 * _HALF_WIDTH * (wavelength - self.peak_nm) / self.fwhm_nm
        g = np.exp(-(scaled**2))
        return np.asarray((g + 2.0 * g**5) / 3.0)


class Lamp(_Light):
    """A lamp with a spectrum of the library (`twin.materials.lamp`) or a table."""

    kind: Literal["lamp"] = "lamp"
    lamp: Spectral = "led_cool_white"

    def _shape(self, wavelength: FloatArray) -> FloatArray:
        return _lamp(self.lamp, wavelength)


class Edge(Part):
    """One band that a colour filter lets through, between two soft edges."""

    peak: float = Field(gt=0, le=1)
    """Transmittance inside."""
    from_nm: float = 0.0
    """Half of the transmittance is reached here; 0 for no edge."""
    to_nm: float = 1e4
    edge_nm: float = Field(default=8.0, gt=0)
    """Width of the edges: the transmittance falls e times every so many nm far outside."""


class Filtered(_Light):
    """A white panel behind a colour filter."""

    kind: Literal["filtered"] = "filtered"
    lamp: Spectral = "led_cool_white"
    bands: tuple[Edge, ...] = ()
    transmittance: SpectralTable | None = None
    """A measured transmittance; replaces the bands."""

    def _shape(self, wavelength: FloatArray) -> FloatArray:
        return _lamp(self.lamp, wavelength) * self.filter_at(wavelength)

    def filter_at(self, wavelength_nm: ArrayLike) -> FloatArray:
        """Transmittance of the filter, shape (W,); beyond a table's ends there is none."""
        wavelength = np.asarray(wavelength_nm, dtype=np.float64)
        if self.transmittance is not None:
            return _table(self.transmittance, wavelength)
        total = np.zeros_like(wavelength)
        for band in self.bands:
            rise = _soft((wavelength - band.from_nm) / band.edge_nm)
            fall = _soft((band.to_nm - wavelength) / band.edge_nm)
            total += band.peak * rise * fall
        return total


class Monochromatic(_Light):
    """What a monochromator takes out of a lamp: a triangle around its setting."""

    kind: Literal["monochromatic"] = "monochromatic"
    centre_nm: float = Field(gt=0)
    band_nm: float = Field(default=10.0, gt=0)
    """Full width [nm] at half maximum: equal slits give a triangle twice as wide at its foot."""
    lamp: Spectral = 1.0
    """Lamp behind it; a number is a lamp of constant power."""

    def _shape(self, wavelength: FloatArray) -> FloatArray:
        slit = np.maximum(1.0 - np.abs(wavelength - self.centre_nm) / self.band_nm, 0.0)
        lit = slit > 0.0
        value = np.zeros_like(wavelength)
        if lit.any():
            value[lit] = slit[lit] * _lamp(self.lamp, wavelength[lit])
        return value


class Sampled(_Light):
    """A measured spectrum: relative power per nm; outside its table there is no light."""

    kind: Literal["table"] = "table"
    table: SpectralTable

    def _shape(self, wavelength: FloatArray) -> FloatArray:
        value = _table(self.table, wavelength)
        if value.size and value.min() < 0.0:
            raise InputError(f"power {value.min():g}", "0 or more", place=self.name)
        return value


Illuminant = Annotated[Led | Lamp | Filtered | Monochromatic | Sampled, Field(discriminator="kind")]
"""Any light; a file says which with `kind`."""


def binned_light(
    illuminants: tuple[Illuminant, ...],
    excitation_nm: ArrayLike,
    *,
    drive: float = 1.0,
    warmer_k: float = 0.0,
) -> FloatArray:
    """Energy per bin of every illuminant, in nm times relative power, shape (J, Wi).

    The integral over each bin, half a step to either side. Light outside all bins is left out:
    `outside_share` says how much that is.

    Raises:
        InputError: as `spectrum`.
    """
    grid = np.asarray(excitation_nm, dtype=np.float64)
    step = grid[1] - grid[0]
    # Midpoints: 20 in a bin of 10 nm, so that a triangle of the slits is met exactly enough.
    parts = 20
    inside = (np.arange(parts) + 0.5) / parts - 0.5
    fine = (grid[:, None] + step * inside).reshape(-1)
    rows = [
        each.spectrum(fine, drive=drive, warmer_k=warmer_k).reshape(-1, parts).mean(axis=1) * step
        for each in illuminants
    ]
    return np.array(rows)


def outside_share(illuminants: tuple[Illuminant, ...], excitation_nm: ArrayLike) -> FloatArray:
    """Share of every illuminant's energy (300 to 900 nm) that falls outside the bins, (J,)."""
    grid = np.asarray(excitation_nm, dtype=np.float64)
    wide = np.arange(300.0, 901.0, _SHOWN_NM)
    inside = binned_light(illuminants, grid).sum(axis=1)
    total = np.array([each.spectrum(wide).sum() * _SHOWN_NM for each in illuminants])
    return np.asarray(np.clip(1.0 - inside / total, 0.0, 1.0))


def _lamp(value: Spectral, wavelength: FloatArray) -> FloatArray:
    """A lamp's power; outside the range of its table there is none (a stated treatment)."""
    from twin.materials import entry, lamp
    from twin.materials.entry import Entry

    if isinstance(value, str):
        found = entry("lamp", value)
        low, high = found.range_nm if isinstance(found, Entry) else (0.0, np.inf)
    elif isinstance(value, SpectralTable):
        low, high = value.wavelength_nm[0], value.wavelength_nm[-1]
    else:
        low, high = 0.0, np.inf
    inside = (wavelength >= low) & (wavelength <= high)
    power = np.zeros_like(wavelength)
    if inside.any():
        power[inside] = lamp(value, wavelength[inside])
    return power


def _table(table: SpectralTable, wavelength: FloatArray) -> FloatArray:
    inside = (wavelength >= table.wavelength_nm[0]) & (wavelength <= table.wavelength_nm[-1])
    value = np.zeros_like(wavelength)
    value[inside] = table.at(wavelength[inside])
    return value


def _soft(x: FloatArray) -> FloatArray:
    return np.asarray(0.5 * (1.0 + np.tanh(0.5 * x)))
