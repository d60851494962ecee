"""Absorbers: water, and dyes as molar extinction tables, typed in at the nodes that matter.

A dye's absorption coefficient is ln(10) epsilon c, the extinction coefficient epsilon being
decadic [L / (mol cm)]. Beer's law (proportionality to c) is assumed: dyes aggregate at high
concentrations, each note says what the table was measured at.
"""

from __future__ import annotations

import math

import numpy as np

from twin.materials.entry import table
from twin.materials.material import Coefficients, Material
from twin.spectra import FloatArray

_PER_MM = math.log(10) / 10
"""Decadic extinction coefficient [L / (mol cm)] to absorption coefficient [1/mm] per mol/l."""

_PHOTOCHEMCAD = "Taniguchi and Lindsey 2018, Photochem. Photobiol. 94, 290 (PhotochemCAD 3)"


def absorbing(sigma_a_per_mm: FloatArray) -> Coefficients:
    """Coefficients of something that absorbs only, each of shape (W,)."""
    nothing = np.zeros_like(sigma_a_per_mm)
    return Coefficients(sigma_a_per_mm, nothing, nothing)


_WATER_PER_M = table("""
380 0.01137 390 0.00851 400 0.00663 410 0.00473 417.5 0.00442 425 0.00478 430 0.00495 440 0.00635
450 0.00922 460 0.00979 470 0.0106 480 0.0127 490 0.0150 500 0.0204 510 0.0325 520 0.0409
530 0.0434 540 0.0474 550 0.0565 560 0.0619 570 0.0695 580 0.0896 590 0.1351 600 0.2224
605 0.2577 610 0.2644 620 0.2755 630 0.2916 640 0.3108 650 0.340 660 0.410 670 0.439 680 0.465
690 0.516 700 0.624 710 0.827 720 1.231 730 1.799 740 2.38 750 2.47 760 2.55 770 2.51 780 2.36
790 2.16 800 2.07
""")
"""Absorption coefficient of pure water [1/m]."""

WATER = Material(
    name="water",
    citation="Pope and Fry 1997, Appl. Opt. 36, 8710 (380 to 720 nm);"
    " Smith and Baker 1981, Appl. Opt. 20, 177 (730 to 800 nm)",
    range_nm=(380.0, 800.0),
    coefficients=lambda wavelength_nm: absorbing(1e-3 * _WATER_PER_M.at(wavelength_nm)),
    n="water",
    note="Absorption only; the scattering of pure water is below 1e-5 /mm.",
)
"""Pure water, the solvent of everything aqueous."""


def dye(name: str, citation: str, text: str, *, ends_nm: float = 0.0, note: str = "") -> Material:
    """A dye in water from its decadic molar extinction coefficients [L / (mol cm)].

    Args:
        name: name in the library.
        citation: source of the table.
        text: the table, "wavelength epsilon ...".
        ends_nm: wavelength [nm] up to which a table that ends in the noise is continued with 0;
            the part beyond the table is declared as assumed.
        note: what a user has to know.
    """
    epsilon = table(text)
    last = epsilon.wavelength_nm[-1]

    def coefficients(wavelength_nm: FloatArray) -> Coefficients:
        inside = np.minimum(wavelength_nm, last)
        value = np.where(wavelength_nm <= last, epsilon.at(inside), 0.0)
        return absorbing(_PER_MM * value)

    return Material(
        name=name,
        citation=citation,
        range_nm=(epsilon.wavelength_nm[0], max(last, ends_nm)),
        coefficients=coefficients,
        measure="molar",
        solvent=WATER,
        n="water",
        assumed_nm=((last, ends_nm),) if ends_nm > last else (),
        note=note,
    )


ABSORBERS: dict[str, Material] = {
    material.name: material
    for material in (
        WATER,
        dye(
            "methylene_blue",
            "Prahl 1998, Oregon Medical Laser Center, methylene blue in water",
            """
            380 1099 390 1257 400 1143 410 693 420 598 430 711 440 900 450 1169 460 1500 470 1825
            480 2324 490 2773 500 2847 510 2919 520 2965 530 3461 540 4468 550 6189 560 8724
            570 11981 580 16093 590 21983 600 30580 606 35201 612 38121 620 39384 630 41725
            640 49754 646 57263 650 62654 654 68935 658 70273 660 71547 662 73004 664 74028
            666 74014 668 73044 670 71089 672 67725 674 63368 676 57423 678 50928 680 44792
            684 31941 688 22710 692 14973 696 9865 700 6511 710 2406 720 1028 730 702 740 432
            750 394 760 154 770 253 780 311
            """,
            note="Methylene blue, measured at 10 umol/l; above that it forms dimers and the band"
            " at 610 nm grows at the expense of the one at 664 nm.",
        ),
        dye(
            "carmoisine",
            f"{_PHOTOCHEMCAD}, entry J11, Acid Red 14 in buffered saline",
            """
            380 5057 390 5111 400 5537 410 6208 420 7252 430 8544 440 10022 450 11946 460 14286
            470 16844 480 19342 490 21504 500 23127 506 23719 512 24000 520 23477 530 21671
            540 19193 550 16398 560 12926 570 8883 580 5171 590 2585 600 1194 610 509.7 620 221.1
            630 108.4 640 82.0 650 59.9 660 50.9 670 42.6 680 33.4 690 29.6 700 31.3
            """,
            ends_nm=800.0,
            note="Carmoisine, the food colour E 122. Its table ends at 700 nm at 0.1 % of the peak;"
            " beyond, no absorption is assumed.",
        ),
        dye(
            "methyl_orange",
            f"{_PHOTOCHEMCAD}, entry J03, Methyl Orange in buffered saline",
            """
            380 9072 390 11838 400 14578 410 17024 420 19224 430 21207 440 23013 450 24658
            456 25414 460 25732 466 25900 470 25668 480 24159 490 21318 500 17333 510 12920
            520 8745 530 5348 540 2944 550 1470 560 672.9 570 286.5 580 126.2 590 68.5 600 47.9
            610 40.9 620 40.9 630 44.0 640 43.8 650 51.6
            """,
            ends_nm=800.0,
            note="Methyl orange at pH 7. Its table ends at 650 nm at 0.2 % of the peak; beyond, no"
            " absorption is assumed.",
        ),
        dye(
            "oxyhaemoglobin",
            "Prahl 1998, Oregon Medical Laser Center, compiled from Gratzer and Kollias",
            """
            380 109564 384 125420 388 148100 392 189740 396 231612 400 266232 404 308716
            406 354208 408 422320 410 466840 412 500200 414 524280 416 521880 418 515520
            420 480360 422 431880 424 376236 426 326032 428 283112 430 246072 432 214120
            434 165332 436 132820 440 102580 444 81444 450 62816 460 44480 470 33209.2
            480 26629.2 490 23684.4 500 20932.8 506 19946 510 20035.2 514 20429.2 518 22509.6
            522 26450.4 526 32496.4 530 39956.8 534 46924 538 51712 540 53236 542 53292 546 49868
            550 43016 554 36815.2 558 33456 560 32613.2 564 33915.6 568 40172 572 49172 574 53308
            576 55540 578 54728 580 50104 584 34639.6 588 19763.2 592 10468.4 596 5683.6 600 3200
            606 1789.2 610 1506 620 942 630 610 640 442 650 368 660 319.6 670 294 680 277.6 690 276
            700 290 710 314 720 348 730 390 740 446 750 518 760 586 770 650 780 710
            """,
            note="Oxygenated haemoglobin in solution (not in cells), per mole of 64500 g.",
        ),
    )
}
"""Water and dyes by name."""
