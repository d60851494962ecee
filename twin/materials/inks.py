"""Materials known in three colour channels only: PolyJet inks and measured liquids and solids.

Red, green and blue are placed at the dominant wavelengths of the sRGB primaries (611, 549 and
464 nm); between them the absorption and scattering coefficients are linear and outside them
constant. That makes a smooth stand-in for a spectrum, not a measured one: every entry here is
marked `interpolated`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from twin.materials.absorbers import WATER
from twin.materials.material import Coefficients, Material
from twin.spectra import FloatArray

NODES_NM = (464.0, 549.0, 611.0)
"""Wavelengths [nm] given to blue, green and red."""

POLYJET_G = 0.4
"""Anisotropy factor of the PolyJet inks: the assumption of Iser et al. 2022, section 5.2."""

MEASURED_G = 0.7
"""Anisotropy factor of the measured media: our assumption, their sources tabulate sigma_s'."""

RGB = tuple[float, float, float]

_RANGE_NM = (380.0, 800.0)


def of_channels(
    sigma_a_per_mm: RGB, sigma_s_per_mm: RGB, g: float
) -> Callable[[FloatArray], Coefficients]:
    """Coefficients from those of red, green and blue [1/mm] and one g."""

    def coefficients(wavelength_nm: FloatArray) -> Coefficients:
        return Coefficients(
            np.interp(wavelength_nm, NODES_NM, sigma_a_per_mm[::-1]),
            np.interp(wavelength_nm, NODES_NM, sigma_s_per_mm[::-1]),
            np.full_like(wavelength_nm, g),
        )

    return coefficients


def _polyjet(colour: str, albedo: RGB, sigma_t_per_mm: RGB) -> Material:
    pairs = tuple(zip(albedo, sigma_t_per_mm, strict=True))
    red, green, blue = pairs
    return Material(
        name=f"polyjet_{colour}",
        citation="Elek et al. 2017, ACM TOG 36(6) 241 (Stratasys inks, RGB albedo and sigma_t)",
        range_nm=_RANGE_NM,
        coefficients=of_channels(
            ((1 - red[0]) * red[1], (1 - green[0]) * green[1], (1 - blue[0]) * blue[1]),
            (red[0] * red[1], green[0] * green[1], blue[0] * blue[1]),
            POLYJET_G,
        ),
        n=1.5,
        interpolated=True,
        note=f"Three channels, interpolated; g {POLYJET_G:g} is an assumption; n about 1.5 as in"
        " Iser et al. 2022, section 4. The unit 1/mm is our reading of a quotation of the source.",
    )


def _measured(
    name: str, source: str, sigma_s_prime: RGB, sigma_a: RGB, *, aqueous: bool = True
) -> Material:
    red, green, blue = (value / (1 - MEASURED_G) for value in sigma_s_prime)
    return Material(
        name=name,
        citation=source,
        range_nm=_RANGE_NM,
        coefficients=of_channels(sigma_a, (red, green, blue), MEASURED_G),
        solvent=WATER if aqueous else None,
        interpolated=True,
        note=f"Three channels, interpolated; the source gives sigma_s', sigma_s assumes"
        f" g {MEASURED_G:g}; no refractive index given.",
    )


_JENSEN = "Jensen et al. 2001, SIGGRAPH 2001, 511, Figure 5 (RGB sigma_s' and sigma_a)"
_NARASIMHAN = "Narasimhan et al. 2006, ACM TOG 25(3) 1003, Table 1 (RGB; sigma_s' as in pbrt-v3)"

INKS: dict[str, Material] = {
    material.name: material
    for material in (
        _polyjet("cyan", (0.05, 0.7, 0.98), (9.0, 4.5, 7.5)),
        _polyjet("magenta", (0.98, 0.1, 0.9), (2.5, 3.0, 10.0)),
        _polyjet("yellow", (0.997, 0.995, 0.15), (2.25, 3.75, 19.0)),
        _polyjet("black", (0.35, 0.35, 0.35), (5.0, 5.5, 6.5)),
        _polyjet("white", (0.9991, 0.9997, 0.999), (6.0, 9.0, 24.0)),
    )
}
"""The five PolyJet inks by name."""

MEASURED_MEDIA: dict[str, Material] = {
    material.name: material
    for material in (
        _measured("apple", _JENSEN, (2.29, 2.39, 1.97), (0.003, 0.0034, 0.046), aqueous=False),
        _measured("cream", _JENSEN, (7.38, 5.47, 3.15), (0.0002, 0.0028, 0.0163)),
        _measured("ketchup", _JENSEN, (0.18, 0.07, 0.03), (0.061, 0.97, 1.45)),
        _measured("marble", _JENSEN, (2.19, 2.62, 3.0), (0.0021, 0.0041, 0.0071), aqueous=False),
        _measured("potato", _JENSEN, (0.68, 0.7, 0.55), (0.0024, 0.009, 0.12), aqueous=False),
        _measured("skim_milk", _JENSEN, (0.7, 1.22, 1.9), (0.0014, 0.0025, 0.0142)),
        _measured("skin", _JENSEN, (0.74, 0.88, 1.01), (0.032, 0.17, 0.48), aqueous=False),
        _measured("whole_milk", _JENSEN, (2.55, 3.21, 3.77), (0.0011, 0.0024, 0.014)),
        _measured(
            "chocolate_milk",
            _NARASIMHAN,
            (1.4585, 2.1289, 2.9527),
            (0.010063, 0.043125, 0.14375),
        ),
        _measured("espresso", _NARASIMHAN, (0.72378, 0.84557, 1.0247), (4.7984, 6.5751, 8.8493)),
        _measured(
            "soy_milk",
            _NARASIMHAN,
            (0.59223, 0.73866, 1.4693),
            (0.0019167, 0.0095833, 0.065167),
        ),
        _measured(
            "white_grapefruit_juice",
            _NARASIMHAN,
            (0.22826, 0.23998, 0.32748),
            (0.0138, 0.018831, 0.056781),
        ),
    )
}
"""Media measured by others, by name (of the 47 that pbrt-v3 tabulates)."""
