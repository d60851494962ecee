"""The seed's illuminants L1 and L2, the monochromator, the detectors S1 and S2, and their prices.

Source of the choice and of the prices: Iser, Lachiver, Wilkie 2023, section 4.1 and table 1. Their
spectra (figure 6) are not published as numbers: those below are typical, as stated.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from twin.errors import InputError
from twin.fluorescence.illuminants import Edge, Filtered, Illuminant, Lamp, Led, Monochromatic
from twin.instrument import AS7341_CHANNELS, Channel, MultispectralChip, Spectrometer
from twin.spectra import SpectralTable

LightSet = Literal["L1", "L2", "monochromator"]
DetectorName = Literal["S1", "S2"]

PRICE_USD: dict[str, float] = {
    "L1": 4.0, "L2": 165.0, "monochromator": 18_500.0, "S1": 2_000.0, "S2": 25.0,
}  # fmt: skip
"""Prices [USD] of the parts (table 1 of the seed; the monochromator with its xenon lamp)."""

# InGaN dies: 0.03 to 0.04 nm/K, -0.1 to -0.2 %/K, bluer with current by band filling; AlInGaP dies:
# 0.1 to 0.13 nm/K, -0.6 to -1 %/K (Schubert 2006, "Light-Emitting Diodes", 2nd edition, chapters
# 6 and 13). Peaks and widths: what the data sheets of 5 mm LEDs of these colours say.
_L1: tuple[Illuminant, ...] = (
    Led(name="violet", peak_nm=405, fwhm_nm=16, power=0.7, nanometres_per_kelvin=0.03,
        per_kelvin=-0.001, nanometres_per_decade=-1.0),
    Led(name="blue", peak_nm=465, fwhm_nm=22, power=1.0, nanometres_per_kelvin=0.03,
        per_kelvin=-0.0012, nanometres_per_decade=-2.5),
    Led(name="cyan", peak_nm=505, fwhm_nm=30, power=0.6, nanometres_per_kelvin=0.03,
        per_kelvin=-0.0015, nanometres_per_decade=-6.0),
    Led(name="green", peak_nm=525, fwhm_nm=34, power=0.5, nanometres_per_kelvin=0.035,
        per_kelvin=-0.002, nanometres_per_decade=-8.0),
    Led(name="amber", peak_nm=592, fwhm_nm=16, power=0.5, nanometres_per_kelvin=0.1,
        per_kelvin=-0.01, nanometres_per_decade=1.0),
    Led(name="red", peak_nm=634, fwhm_nm=18, power=0.9, nanometres_per_kelvin=0.12,
        per_kelvin=-0.006, nanometres_per_decade=1.0),
    Lamp(name="warm_white", lamp="led_warm_white", power=0.35, nanometres_per_kelvin=0.03,
         per_kelvin=-0.002),
    Lamp(name="cool_white", lamp="led_cool_white", power=0.5, nanometres_per_kelvin=0.03,
         per_kelvin=-0.002),
)  # fmt: skip

# Deep-coloured lighting gels, as soft-edged bands of our own that follow their usual kinds.
_L2: tuple[Illuminant, ...] = (
    Led(name="near_ultraviolet", peak_nm=398, fwhm_nm=14, power=0.3, nanometres_per_kelvin=0.03,
        per_kelvin=-0.001, nanometres_per_decade=-1.0),
    Filtered(name="deep_blue", bands=(
        Edge(peak=0.6, from_nm=425, to_nm=480, edge_nm=12),
        Edge(peak=0.4, from_nm=722, edge_nm=10),
    )),
    Filtered(name="blue_green", bands=(Edge(peak=0.62, from_nm=445, to_nm=533, edge_nm=12),)),
    Filtered(name="dark_green", bands=(Edge(peak=0.78, from_nm=488, to_nm=556, edge_nm=8),)),
    Filtered(name="yellow", bands=(Edge(peak=0.88, from_nm=503, edge_nm=8),)),
    Filtered(name="orange", bands=(Edge(peak=0.85, from_nm=562, edge_nm=8),)),
    Filtered(name="red", bands=(Edge(peak=0.78, from_nm=612, edge_nm=7),)),
    Filtered(name="magenta", bands=(
        Edge(peak=0.09, to_nm=465, edge_nm=8),
        Edge(peak=0.84, from_nm=611, edge_nm=7),
    )),
)  # fmt: skip


def light_set(name: str, *, near_ultraviolet: bool = False) -> tuple[Illuminant, ...]:
    """The illuminants of a set: "L1" (8), "L2" (8) or "monochromator" (31, or 41 from 300 nm).

    Raises:
        InputError: another name.
    """
    if name == "L1":
        return _L1
    if name == "L2":
        return _L2
    if name == "monochromator":
        # The xenon table of the library begins at 380 nm; a constant lamp stands in below.
        start = 300.0 if near_ultraviolet else 400.0
        return tuple(
            Monochromatic(name=f"{centre:g}nm", centre_nm=float(centre), band_nm=10.0)
            for centre in np.arange(start, 700.5, 10.0)
        )
    raise InputError(f"the illuminants {name!r}", "L1, L2 or monochromator", place="lights")


def spectrometer(start_nm: float = 400.0, stop_nm: float = 700.0, step_nm: float = 10.0) -> (
    Spectrometer
):  # fmt: skip
    """S1: an entry-level spectrometer whose pixels are read together in the bins of the matrix.

    The figures resemble an Ocean Optics USB650 (12 bits, about 1 nm per pixel, 62 500 electrons
    in a pixel, 3 counts of read noise): ten pixels make a channel, so a channel holds ten times
    the charge and its read noise is sqrt(10) times as great. Its own band width (2 nm) is small
    against a bin and left out.
    """
    return Spectrometer(
        start_nm=start_nm, stop_nm=stop_nm, step_nm=step_nm, electrons_per_count=150.0,
        full_well_electrons=600_000.0, adc_bits=12, shortest_s=0.003, longest_s=60.0,
        read_noise_electrons=145.0, dark_level_counts=60.0, dark_current_electrons_per_s=3000.0,
        averages=20, white_rate_electrons_per_s=5e6, off=("bandwidth",),
    )  # fmt: skip


def as7341(
    range_nm: tuple[float, float] = (400.0, 700.0),
    *,
    gain: float = 16.0,
    cross_talk: float = 0.1,
    near_infrared_leak: float = 0.0,
) -> MultispectralChip:
    """S2: the eight narrow channels of an AMS AS7341.

    Args:
        range_nm: wavelengths [nm] of the light that exists in the simulated world.
        gain: nominal gain at the start; the automatic exposure chooses its own.
        cross_talk: share of every channel that is flat over the whole range: light that comes in
            through the neighbours and past the filters.
        near_infrared_leak: response above 700 nm relative to a channel's peak, rising from 700 to
            780 nm; seen only where `range_nm` reaches there.

    Raises:
        InputError: a leak that is negative or 1 and more.
    """
    for place, value in (("cross_talk", cross_talk), ("near_infrared_leak", near_infrared_leak)):
        if not 0.0 <= value < 1.0:
            raise InputError(f"{value:g}", "0 or more, below 1", place=place)
    channels: tuple[Channel, ...] = AS7341_CHANNELS
    if near_infrared_leak > 0.0:
        wavelength = np.arange(min(range_nm[0], 380.0), max(range_nm[1], 780.0) + 0.5, 2.0)
        rise = near_infrared_leak * np.clip((wavelength - 700.0) / 80.0, 0.0, 1.0)
        channels = tuple(
            each.model_copy(
                update={
                    "response": SpectralTable(
                        wavelength_nm=tuple(wavelength),
                        value=tuple(
                            np.exp(
                                -4.0 * np.log(2.0)
                                * ((wavelength - each.centre_nm) / each.fwhm_nm) ** 2
                            )
                            + rise
                        ),
                    )
                }
            )
            for each in AS7341_CHANNELS
        )  # fmt: skip
    return MultispectralChip(
        channels=channels, range_nm=range_nm, gain=gain, leak_fraction=cross_talk, averages=20
    )
