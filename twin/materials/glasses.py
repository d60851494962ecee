"""Refractive indices: glasses, polymers and liquids, from published dispersion formulas.

A spectrometer whose first pixel is at 400 nm wants the light a few nanometres below. Formulas
whose publication ends at 400 or 700 nm, far from any resonance, are therefore continued to 380
or 780 nm, and say so in `assumed_nm`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from twin.materials.entry import Entry
from twin.spectra import FloatArray


def sellmeier(*terms: tuple[float, float]) -> Callable[[FloatArray], FloatArray]:
    """The formula n**2 = 1 + sum b L**2 / (L**2 - c), L [um], for terms (b, c [um**2])."""

    def index(wavelength_nm: FloatArray) -> FloatArray:
        square = (wavelength_nm * 1e-3) ** 2
        strength = np.ones_like(square)
        for b, c in terms:
            strength = strength + b * square / (square - c)
        return np.sqrt(strength)

    return index


def _beadie2015(wavelength_nm: FloatArray) -> FloatArray:
    """PMMA: n**2 as a Laurent series in the wavelength [um]."""
    square = (wavelength_nm * 1e-3) ** 2
    n_squared = (
        2.1778
        + 6.1209e-3 * square
        - 1.5004e-3 * square**2
        + 2.3678e-2 / square
        - 4.2137e-3 / square**2
        + 7.3417e-4 / square**3
        - 4.5042e-5 / square**4
    )
    return np.sqrt(n_squared)


def _ciddor1996(wavelength_nm: FloatArray) -> FloatArray:
    """Standard air (15 C, 101.325 kPa, dry, 450 ppm CO2)."""
    wavenumber_squared = (wavelength_nm * 1e-3) ** -2
    return (
        1
        + 0.05792105 / (238.0185 - wavenumber_squared)
        + 0.00167917 / (57.362 - wavenumber_squared)
    )


def cauchy_of_abbe(n_e: float, abbe_e: float) -> Callable[[FloatArray], FloatArray]:
    """The two-term Cauchy formula with a given n_e and Abbe number V_e.

    V_e = (n_e - 1) / (n_F' - n_C') with the lines F' 479.99, e 546.07 and C' 643.85 nm.
    """
    e, f, c = 546.07, 479.99, 643.85
    slope = (n_e - 1) / abbe_e / (f**-2 - c**-2)

    def index(wavelength_nm: FloatArray) -> FloatArray:
        return n_e + slope * (wavelength_nm**-2 - e**-2)

    return index


REFRACTIVE_INDICES: dict[str, Entry] = {
    entry.name: entry
    for entry in (
        Entry(
            "air",
            "Ciddor 1996, Appl. Opt. 35, 1566 (standard air)",
            (230.0, 1690.0),
            _ciddor1996,
        ),
        Entry(
            "fused_silica",
            "Malitson 1965, J. Opt. Soc. Am. 55, 1205 (20 C)",
            (210.0, 3710.0),
            sellmeier(
                (0.6961663, 0.0684043**2), (0.4079426, 0.1162414**2), (0.8974794, 9.896161**2)
            ),
        ),
        Entry(
            "glass_bk7",
            "SCHOTT optical glass catalogue 2017, N-BK7 (Sellmeier coefficients)",
            (300.0, 2500.0),
            sellmeier(
                (1.03961212, 0.00600069867), (0.231792344, 0.0200179144), (1.01046945, 103.560653)
            ),
        ),
        Entry(
            "glass_d263",
            "SCHOTT glass catalogue 2017, D 263 T eco (Sellmeier coefficients)",
            (334.0, 2325.0),
            sellmeier((1.2379576, 0.0086308094), (0.046646889, 0.046907451), (2.4670055, 264.1463)),
            note="Borosilicate cover glass.",
        ),
        Entry(
            "immersion_oil",
            "ISO 8036-1:1998 (n_e 1.5180, V_e 44)",
            (380.0, 780.0),
            cauchy_of_abbe(1.5180, 44.0),
            approximation=True,
            assumed_nm=((380.0, 400.0), (760.0, 780.0)),
            note="The standard fixes n_e and V_e (44 +- 3) for 400 to 760 nm; the two-term Cauchy"
            " formula through both is ours.",
        ),
        Entry(
            "pdms_rtv615",
            "Schneider et al. 2009, Sens. Actuators A 151, 95 (RTV 615)",
            (350.0, 780.0),
            sellmeier((1.0057, 0.013217)),
            assumed_nm=((700.0, 780.0),),
            note="Published for 350 to 700 nm; the formula is continued to 780 nm.",
        ),
        Entry(
            "pmma",
            "Beadie et al. 2015, Appl. Opt. 54, F139 (20.1 C)",
            (380.0, 1620.0),
            _beadie2015,
            assumed_nm=((380.0, 400.0),),
            note="Measured from 0.4 um (the refractiveindex.info record of the formula starts at"
            " 0.42 um); the formula is continued to 380 nm.",
        ),
        Entry(
            "water",
            "Daimon and Masumura 2007, Appl. Opt. 46, 3811 (20.0 C)",
            (182.0, 1129.0),
            sellmeier(
                (5.684027565e-1, 5.101829712e-3),
                (1.726177391e-1, 1.821153936e-2),
                (2.086189578e-2, 2.620722293e-2),
                (1.130748688e-1, 1.069792721e1),
            ),
        ),
    )
}
"""Refractive indices by name."""
