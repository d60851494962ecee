"""Colour of a sample over black and over white under D65, CIE 1931 2 degree observer.

Tristimulus values are sums over the measured range only: nothing is extrapolated, and the white
point is that of a perfect diffuser seen through the same range (CIE 015:2018, section 7). Colour
differences are CIEDE2000 (CIE 142-2001; Sharma, Wu and Dalal 2005).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenarios.report.content import CAPTURES, Content, sample_label
from twin.spectra import FloatArray

STEP_NM = 1.0
VISIBLE_NM = (380.0, 780.0)
NEEDED_NM = (430.0, 670.0)
"""Least range that a colour may be computed from."""
WIDEST_HOLE_NM = 60.0
"""Masked stretches up to this width are bridged linearly and said; wider ones give no colour."""


@dataclass(frozen=True)
class Swatch:
    """One colour as it is shown."""

    xyz: tuple[float, float, float]
    """Tristimulus values, Y = 1 for the perfect diffuser."""
    lab: tuple[float, float, float]
    """CIE 1976 L*a*b*."""
    srgb: tuple[float, float, float]
    """sRGB, not clipped, 0 to 1 inside the gamut."""

    @property
    def in_gamut(self) -> bool:
        """Whether sRGB can show the colour (half a step of 8 bits is forgiven)."""
        return all(-1 / 510 <= channel <= 1 + 1 / 510 for channel in self.srgb)

    @property
    def hexadecimal(self) -> str:
        """The nearest colour that sRGB can show, as #rrggbb."""
        levels = [round(255 * min(1.0, max(0.0, channel))) for channel in self.srgb]
        return "#{:02x}{:02x}{:02x}".format(*levels)


@dataclass(frozen=True)
class ColourRow:
    """A sample over one background: measured, predicted from the estimate, true."""

    sample: str
    """Name with thickness."""
    background: str
    measured: Swatch
    predicted: Swatch | None
    truth: Swatch | None
    measured_to_predicted: float | None
    """CIEDE2000; None when there is no prediction."""
    measured_to_truth: float | None
    predicted_to_truth: float | None
    range_nm: tuple[float, float]
    """Wavelengths that were used [nm]: where all the curves shown are known."""
    bridged: int
    """Wavelengths inside the range without a value, bridged linearly."""


@dataclass(frozen=True)
class Colours:
    """All swatches, or the reason why there are none."""

    rows: tuple[ColourRow, ...]
    range_nm: tuple[float, float] | None
    """Wavelengths that were used [nm]."""
    missing: tuple[str, ...]
    """What could not be shown, in sentences."""


class Observer:
    """Weights of D65 and the CIE 1931 observer over one range, read once from colour-science."""

    def __init__(self, low_nm: float, high_nm: float) -> None:
        import colour

        self.wavelength_nm = np.arange(np.ceil(low_nm), np.floor(high_nm) + 0.5, STEP_NM)
        shape = colour.SpectralShape(self.wavelength_nm[0], self.wavelength_nm[-1], STEP_NM)
        observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
        bars = np.asarray(observer.copy().align(shape).values, dtype=np.float64)
        light = np.asarray(
            colour.SDS_ILLUMINANTS["D65"].copy().align(shape).values, dtype=np.float64
        )
        weights = bars * light[:, None]
        self._weights = weights / weights[:, 1].sum()
        white = self._weights.sum(axis=0)
        self._white_xy = white[:2] / white.sum()

    def swatch(self, radiance_factor: FloatArray) -> Swatch:
        """Colour of a radiance factor on `wavelength_nm`."""
        import colour

        xyz = radiance_factor @ self._weights
        lab = colour.XYZ_to_Lab(xyz, self._white_xy)
        srgb = colour.XYZ_to_sRGB(xyz, illuminant=self._white_xy)
        x, y, z = (float(value) for value in xyz)
        lightness, a, b = (float(value) for value in lab)
        red, green, blue = (float(value) for value in srgb)
        return Swatch((x, y, z), (lightness, a, b), (red, green, blue))


def ciede2000(one: Swatch | None, other: Swatch | None) -> float | None:
    """CIEDE2000 between two colours (parametric factors 1), or None when one is not there."""
    if one is None or other is None:
        return None
    import colour

    return float(colour.delta_E(np.array(one.lab), np.array(other.lab), method="CIE 2000"))


def colours_of(content: Content) -> Colours:
    """Swatches of every sample over black and over white.

    Args:
        content: intensities measured, predicted and true; the latter two may be absent.

    Returns:
        The rows, the wavelengths they were computed from, and what is missing and why.
    """
    wavelength = content.wavelength_nm
    low, high = max(VISIBLE_NM[0], wavelength[0]), min(VISIBLE_NM[1], wavelength[-1])
    rows: list[ColourRow] = []
    missing: list[str] = []
    used: list[tuple[float, float]] = []
    for index, sample in enumerate(content.samples):
        for capture in ("black", "white"):
            number = CAPTURES.index(capture)
            seen = content.relative.valid[index, number]
            why = _unusable(wavelength, seen, low, high)
            if why:
                missing.append(f"{sample.name} over {capture}: {why}.")
                continue
            curves = [
                None if values is None else values[index, number]
                for values in (content.predicted, content.truth_intensities)
            ]
            common = seen
            for place, curve in enumerate(curves):
                narrower = common if curve is None else common & np.isfinite(curve)
                if _unusable(wavelength, narrower, low, high):
                    curves[place] = None
                else:
                    common = narrower
            inside = wavelength[common & (wavelength >= low) & (wavelength <= high)]
            ends = (float(inside[0]), float(inside[-1]))
            observer = Observer(*ends)
            value = content.relative.value[index, number]
            measured = _colour(observer, wavelength, value, common)
            predicted, truth = (
                None if curve is None else _colour(observer, wavelength, curve, common)
                for curve in curves
            )
            rows.append(
                ColourRow(
                    sample_label(sample), capture, measured, predicted, truth,
                    ciede2000(measured, predicted), ciede2000(measured, truth),
                    ciede2000(predicted, truth), ends,
                    int(np.sum(~common & (wavelength > ends[0]) & (wavelength < ends[1]))),
                )
            )  # fmt: skip
            used.append(ends)
    reach = (min(u[0] for u in used), max(u[1] for u in used)) if used else None
    return Colours(tuple(rows), reach, tuple(missing))


def _unusable(wavelength: FloatArray, seen: NDArray[np.bool_], low: float, high: float) -> str:
    """Why no colour can be computed, or "" when it can."""
    inside = wavelength[seen & (wavelength >= low) & (wavelength <= high)]
    if inside.size < 4:
        return f"{inside.size} usable wavelengths, at least 4 are needed"
    if inside[0] > NEEDED_NM[0] or inside[-1] < NEEDED_NM[1]:
        return (
            f"usable from {inside[0]:g} to {inside[-1]:g} nm, a colour needs"
            f" {NEEDED_NM[0]:g} to {NEEDED_NM[1]:g} nm"
        )
    hole = float(np.diff(inside).max())
    if hole > WIDEST_HOLE_NM:
        return f"a hole of {hole:g} nm in the spectrum"
    return ""


def _colour(
    observer: Observer, wavelength: FloatArray, curve: FloatArray, seen: NDArray[np.bool_]
) -> Swatch:
    return observer.swatch(np.interp(observer.wavelength_nm, wavelength[seen], curve[seen]))
