"""A fluorescent translucent medium: a host that absorbs and scatters, and fluorophores in it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from twin.bench import Medium
from twin.errors import InputError
from twin.spectra import FloatArray, Part, SpectralTable

if TYPE_CHECKING:
    from twin.materials import OpticalProperties

Units = Literal["photons", "energy"]


class Fluorophore(Part):
    """A dye that absorbs by one spectrum and emits by another, whatever it absorbed (Kasha)."""

    absorption_per_mm: SpectralTable | float
    """Absorption coefficient [1/mm] at concentration 1; a table is 0 outside its wavelengths."""
    emission: SpectralTable
    """Shape of the emission per nm, at least 0; 0 outside the table, normalised over it."""
    emission_units: Units = "photons"
    """Whether `emission` counts photons or energy per nm."""
    quantum_yield: float = Field(default=1.0, ge=0, le=1)
    """Emitted photons per absorbed photon."""
    concentration: float = Field(default=1.0, ge=0)
    """Factor on the absorption."""


class FluorescentMedium(Part):
    """What a fluorescent sample is made of; the fluorophores' absorption comes on top."""

    host: Medium | str
    """The medium without fluorophores, or its name in the library."""
    fluorophores: tuple[Fluorophore, ...] = Field(min_length=1)


@dataclass(frozen=True)
class FluorescentProperties:
    """A fluorescent medium at W wavelengths, in energy units.

    Attributes:
        wavelength_nm: increasing [nm], (W,).
        step_nm: width of each wavelength's bin [nm], (W,).
        absorption_per_mm: of the host [1/mm], (W,).
        scattering_per_mm: of the host [1/mm], (W,).
        g: anisotropy factor, (W,).
        fluorophore_per_mm: absorption of all fluorophores [1/mm], (W,).
        source: energy emitted at o per nm, per length and fluence at i [1/mm/nm], (W out, W in);
            0 where emission would not be longer than excitation.
    """

    wavelength_nm: FloatArray
    step_nm: FloatArray
    absorption_per_mm: FloatArray
    scattering_per_mm: FloatArray
    g: FloatArray
    fluorophore_per_mm: FloatArray
    source: FloatArray

    @property
    def sigma_t_per_mm(self) -> FloatArray:
        """Extinction coefficient with the fluorophores [1/mm], (W,)."""
        total = self.absorption_per_mm + self.scattering_per_mm + self.fluorophore_per_mm
        return np.asarray(total)

    @property
    def albedo(self) -> FloatArray:
        """Scattering over all extinction, fluorophores included, (W,)."""
        total = self.sigma_t_per_mm
        return np.where(total > 0.0, self.scattering_per_mm / np.where(total > 0, total, 1.0), 0.0)

    @property
    def energy_yield(self) -> FloatArray:
        """Energy emitted over energy that the fluorophores absorb, (W,); below 1."""
        emitted = self.step_nm @ self.source
        taken = self.fluorophore_per_mm
        return np.where(taken > 0.0, emitted / np.where(taken > 0.0, taken, 1.0), 0.0)

    def optical(self) -> OpticalProperties:
        """The medium as the elastic engines see it: fluorophores are absorbers."""
        from twin.materials import OpticalProperties

        return OpticalProperties(
            self.wavelength_nm, self.albedo, self.sigma_t_per_mm, self.g, n=None
        )


def bin_widths(wavelength_nm: ArrayLike) -> FloatArray:
    """Trapezoid weights [nm] of increasing wavelengths, (W,).

    Raises:
        InputError: fewer than two, or wavelengths that do not increase.
    """
    wavelength = np.asarray(wavelength_nm, dtype=np.float64)
    if wavelength.ndim != 1 or len(wavelength) < 2 or not np.all(np.diff(wavelength) > 0):
        raise InputError(
            f"{wavelength.size} wavelengths that do not increase",
            "two or more increasing wavelengths [nm]",
            place="wavelength_nm",
        )
    apart = np.diff(wavelength)
    return np.asarray(0.5 * (np.append(apart, 0.0) + np.append(0.0, apart)))


def photon_density(
    wavelength_nm: FloatArray, emission: FloatArray, units: Units = "photons"
) -> FloatArray:
    """An emission spectrum in photons per nm, normalised to 1 over its wavelengths, (W,).

    Raises:
        InputError: a value below 0 or not finite, or no emission at all.
    """
    shape = np.asarray(emission, dtype=np.float64)
    if shape.shape != wavelength_nm.shape or not np.isfinite(shape).all() or np.any(shape < 0):
        raise InputError(
            f"an emission spectrum of shape {shape.shape} with values from {np.min(shape):g}",
            f"{len(wavelength_nm)} finite values of at least 0",
            place="emission",
        )
    if units == "energy":
        shape = shape * wavelength_nm
    total = float(bin_widths(wavelength_nm) @ shape)
    if total <= 0.0:
        raise InputError("an emission spectrum of nothing", "values above 0", place="emission")
    return np.asarray(shape / total)


def emission_table(wavelength_nm: FloatArray, photons_per_nm: FloatArray) -> FloatArray:
    """Energy emitted at o per nm over energy absorbed at i for a quantum yield of 1, (W, W).

    A photon at o carries i / o of the energy of the one at i; where emission would not be
    longer than excitation there is none.

    Args:
        wavelength_nm: (W,).
        photons_per_nm: emission of `photon_density`, (W,).
    """
    wave = np.asarray(wavelength_nm, dtype=np.float64)
    stokes = wave[None, :] / wave[:, None]
    return np.asarray(np.where(wave[:, None] > wave, photons_per_nm[:, None] * stokes, 0.0))


def _padded(table: SpectralTable | float, wavelength: FloatArray, place: str) -> FloatArray:
    if not isinstance(table, SpectralTable):
        values = np.full(len(wavelength), float(table))
    else:
        values = np.interp(wavelength, table.wavelength_nm, table.value, left=0.0, right=0.0)
    if np.any(values < 0.0):
        raise InputError(f"a value of {values.min():g}", "values of at least 0", place=place)
    return np.asarray(values)


def fluorescent_properties(
    medium: FluorescentMedium, wavelength_nm: ArrayLike
) -> FluorescentProperties:
    """A fluorescent medium at increasing wavelengths [nm], shape (W,).

    Emission outside the wavelengths is lost to sight but stays emitted: it is normalised over
    its own table.

    Raises:
        InputError: a spectrum below 0 or without light, an unknown host, a phase function of
            two lobes, wavelengths that do not increase.
    """
    from twin.materials import optical_properties

    wave = np.asarray(wavelength_nm, dtype=np.float64)
    step = bin_widths(wave)
    host = optical_properties(medium.host, wave)
    if host.second_share > 0.0:
        raise InputError(
            f"a host with a second lobe of share {host.second_share:g}",
            "a phase function of one lobe: fluorescent light is followed with that alone",
            place="host",
        )
    scattering = host.albedo * host.sigma_t_per_mm
    taken, source = np.zeros(len(wave)), np.zeros((len(wave), len(wave)))
    for number, dye in enumerate(medium.fluorophores):
        place = f"fluorophores[{number}]"
        absorbed = dye.concentration * _padded(dye.absorption_per_mm, wave, f"{place}.absorption")
        own_wave = np.asarray(dye.emission.wavelength_nm, dtype=np.float64)
        density = photon_density(own_wave, np.asarray(dye.emission.value), dye.emission_units)
        photons = np.interp(wave, own_wave, density, left=0.0, right=0.0)
        taken += absorbed
        source += dye.quantum_yield * emission_table(wave, photons) * absorbed[None, :]
    return FluorescentProperties(
        wave, step, host.sigma_t_per_mm - scattering, scattering, host.g, taken, source
    )
