"""Scatterers: the fat emulsion Intralipid, by two published sets of fits.

Amounts are volume fractions of the *stock* emulsion that the name says (10, 20 or 30 g of fat per
100 ml), as a person pipettes it; the rest is water. Proportionality to the amount is assumed: it
holds for dilutions and overestimates the scattering of concentrated emulsions (Zaccanti et al.
2003, Appl. Opt. 42, 4023).

The absorption of the emulsions is taken as that of water, which makes up most of it (Driver et
al. 1989, Phys. Med. Biol. 34, 1927); the fat's own is left out.
"""

from __future__ import annotations

from twin.materials.absorbers import WATER
from twin.materials.material import Coefficients, Material
from twin.spectra import FloatArray

_DILUTION = (
    "Amounts are volume fractions of the stock emulsion; the absorption is that of water alone."
)


def _michels2008(
    percent: int, scale: float, exponent: float, offset: float, slope: float
) -> Material:
    """Eqs. 9 and 10: sigma_s = scale L**exponent [1/mm], g = offset + slope L, L [nm]."""

    def coefficients(wavelength_nm: FloatArray) -> Coefficients:
        return Coefficients(
            WATER.coefficients(wavelength_nm).sigma_a_per_mm,
            scale * wavelength_nm**exponent,
            offset + slope * wavelength_nm,
        )

    return Material(
        name=f"intralipid_{percent}",
        citation="Michels, Foschum and Kienle 2008, Opt. Express 16, 5907, Tables 3 and 4",
        range_nm=(380.0, 800.0),
        coefficients=coefficients,
        solvent=WATER,
        n="water",
        note=f"Intralipid {percent} %, measured from 350 to 900 nm. {_DILUTION}",
    )


def _van_staveren1991(wavelength_nm: FloatArray) -> Coefficients:
    """sigma_s = 0.016 L**-2.4 [1/mm per ml/l] of the 10 % stock, g = 1.1 - 0.58 L, L [um]."""
    micron = wavelength_nm * 1e-3
    return Coefficients(
        WATER.coefficients(wavelength_nm).sigma_a_per_mm,
        1000 * 0.016 * micron**-2.4,
        1.1 - 0.58 * micron,
    )


SCATTERERS: dict[str, Material] = {
    material.name: material
    for material in (
        _michels2008(10, 4.857e8, -2.644, 1.018, -8.820e-4),
        _michels2008(20, 3.873e8, -2.397, 1.090, -6.812e-4),
        _michels2008(30, 2.645e8, -2.199, 1.066, -4.408e-4),
        Material(
            name="intralipid_10_van_staveren",
            citation="van Staveren et al. 1991, Appl. Opt. 30, 4507",
            range_nm=(380.0, 800.0),
            coefficients=_van_staveren1991,
            solvent=WATER,
            n="water",
            assumed_nm=((380.0, 400.0),),
            note="Intralipid 10 % of another make, fits of Mie theory from 400 to 1100 nm (6 %),"
            " continued to 380 nm:"
            f" 2.5 times the scattering coefficient of intralipid_10 at a higher g. {_DILUTION}",
        ),
    )
}
"""Scatterers by name."""
