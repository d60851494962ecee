"""Lamps: relative spectral power from the tables that colour-science carries.

Between the samples of a table (5 nm for the CIE illuminants) the spectra are linear.
colour-science takes a second to import, so it is imported when a lamp is asked for.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from twin.errors import InputError
from twin.materials.entry import Entry, unknown_name
from twin.spectra import FloatArray, SpectralTable

NORMALISATION_NM = (380.0, 780.0)
"""A lamp's peak inside these wavelengths [nm] is 1."""

_OWN = {
    "led_cool_white": ("LED-B5", "CIE 015:2018, illuminant LED-B5 (blue LED and phosphor, 6598 K)"),
    "led_warm_white": ("LED-B2", "CIE 015:2018, illuminant LED-B2 (blue LED and phosphor, 2998 K)"),
    "xenon": ("Kinoton 75P", "Kinoton 75P, a xenon cinema projector, as in colour-science"),
}
"""Our names: the table of colour-science and its citation."""

CIE_NAMES = (
    *("A", "B", "C", "D50", "D55", "D65", "D75", "E", "ID50", "ID65"),
    *(f"FL{number}" for number in range(1, 13)),
    *(f"FL3.{number}" for number in range(1, 16)),
    *(f"HP{number}" for number in range(1, 6)),
    *(f"LED-B{number}" for number in range(1, 6)),
    *("LED-BH1", "LED-RGB1", "LED-V1", "LED-V2"),
)
"""CIE illuminants by their names in colour-science (further names of its illuminants work too)."""

NAMES = (*_OWN, *CIE_NAMES)
"""Every lamp that the library lists."""


def normalised(name: str, wavelength_nm: FloatArray, power: FloatArray) -> FloatArray:
    """Relative power, shape (W,), with its peak between 380 and 780 nm made 1.

    A table that has no sample there is divided by its own peak.

    Raises:
        InputError: a power below 0, or none above 0.
    """
    low, high = NORMALISATION_NM
    if power.min() < 0:
        where = wavelength_nm[int(np.argmin(power))]
        raise InputError(f"spectral power {power.min():g} at {where:g} nm in {name}", "0 or more")
    inside = (wavelength_nm >= low) & (wavelength_nm <= high)
    peak = float(power[inside].max()) if inside.any() else float(power.max())
    if peak <= 0:
        raise InputError(f"no light at all in {name}", "a spectral power above 0")
    return power / peak


@cache
def lamp_entry(name: str) -> Entry:
    """The lamp of a name: relative spectral power per nm, peak 1 over 380 to 780 nm.

    Raises:
        InputError: neither the library nor colour-science's illuminants know the name.
    """
    import colour  # type: ignore[import-untyped, unused-ignore]

    table_name, citation = _OWN.get(name, (name, f"CIE illuminant {name}, as in colour-science"))
    tables = colour.SDS_LIGHT_SOURCES if name == "xenon" else colour.SDS_ILLUMINANTS
    if table_name not in list(tables):
        raise unknown_name("the lamp", name, tuple(dict.fromkeys((*NAMES, *tables))))
    distribution = tables[table_name]
    wavelength = np.asarray(distribution.wavelengths, dtype=np.float64)
    power = normalised(name, wavelength, np.asarray(distribution.values, dtype=np.float64))
    samples = SpectralTable(wavelength_nm=tuple(wavelength), value=tuple(power))
    return Entry(name, citation, (float(wavelength[0]), float(wavelength[-1])), samples.at)


def lamp_table(samples: SpectralTable) -> SpectralTable:
    """A person's lamp table with its peak between 380 and 780 nm made 1.

    Raises:
        InputError: a power below 0, or none above 0.
    """
    power = normalised(
        "the lamp table", np.asarray(samples.wavelength_nm), np.asarray(samples.value)
    )
    return SpectralTable(wavelength_nm=samples.wavelength_nm, value=tuple(power))
