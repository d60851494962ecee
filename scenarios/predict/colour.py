"""Colours of predicted reflectances under any illuminant, and CIEDE2000, with intervals.

CIE 1931 2 degree observer; tristimulus values are sums over 1 nm of the predicted range only, and
the white is that of the perfect diffuser over the same range, as in `scenarios.report.colour`.
Colour differences are CIEDE2000 (CIE 142-2001; Sharma, Wu and Dalal 2005). All shown sRGB values
are adapted from the illuminant's white to that of D65 (CAT02).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from scenarios.predict.appearance import AS_DRAWN, Prediction, quantile
from scenarios.report.colour import NEEDED_NM, STEP_NM, VISIBLE_NM, WIDEST_HOLE_NM, Swatch
from twin.errors import InputError
from twin.spectra import FloatArray

MISSING_SHARE = 0.2
"""Greatest share of wavelengths without a value that a colour bridges linearly."""
TAILS = (0.05, 0.95)
"""Quantiles of all intervals of colours: 90 % central."""


class Weights:
    """Tristimulus weights of an illuminant over one range of wavelengths.

    Args:
        low_nm: first wavelength [nm].
        high_nm: last wavelength [nm].
        illuminant: lamp name of the library, such as D65, A, FL4.

    Raises:
        InputError: an unknown illuminant, or one without light or values there.
    """

    def __init__(self, low_nm: float, high_nm: float, illuminant: str = "D65") -> None:
        import colour

        from twin.materials import lamp

        self.illuminant = illuminant
        self.wavelength_nm = np.arange(np.ceil(low_nm), np.floor(high_nm) + 0.5, STEP_NM)
        shape = colour.SpectralShape(self.wavelength_nm[0], self.wavelength_nm[-1], STEP_NM)
        observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
        bars = np.asarray(observer.copy().align(shape).values, dtype=np.float64)
        weights = bars * lamp(illuminant, self.wavelength_nm)[:, None]
        luminance = weights[:, 1].sum()
        if luminance <= 0:
            raise InputError(f"no visible light in {illuminant}", "light between 380 and 780 nm")
        self._weights = weights / luminance
        self.white: FloatArray = self._weights.sum(axis=0)
        """Tristimulus values of the perfect diffuser, Y = 1, shape (3,)."""

    def xyz(self, wavelength_nm: FloatArray, reflectance: FloatArray) -> FloatArray:
        """Tristimulus values of reflectances (..., W), linear between wavelengths; (..., 3)."""
        fine = self.wavelength_nm
        at = np.clip(np.searchsorted(wavelength_nm, fine, "right") - 1, 0, len(wavelength_nm) - 2)
        share = (fine - wavelength_nm[at]) / (wavelength_nm[at + 1] - wavelength_nm[at])
        weights = np.zeros((len(wavelength_nm), 3))
        np.add.at(weights, at, (1 - share)[:, None] * self._weights)
        np.add.at(weights, at + 1, share[:, None] * self._weights)
        return np.asarray(reflectance @ weights)

    def lab(self, xyz: FloatArray) -> FloatArray:
        """CIE 1976 L*a*b* of tristimulus values (..., 3)."""
        import colour

        return np.asarray(colour.XYZ_to_Lab(xyz, self.white[:2] / self.white.sum()))

    def swatch(self, xyz: FloatArray) -> Swatch:
        """The colour as the report shows it, of tristimulus values (3,)."""
        import colour

        srgb = colour.XYZ_to_sRGB(xyz, illuminant=self.white[:2] / self.white.sum())
        x, y, z = (float(value) for value in xyz)
        lightness, a, b = (float(value) for value in self.lab(xyz))
        red, green, blue = (float(value) for value in srgb)
        return Swatch((x, y, z), (lightness, a, b), (red, green, blue))


@dataclass(frozen=True, eq=False)
class Colour:
    """The colour of a prediction.

    Attributes:
        swatch: of the predicted reflectance.
        lab_draws: L*a*b* of the draws, shape (D, 3), by the way wavelengths go together.
        illuminant: lamp.
        range_nm: wavelengths that were used [nm].
        bridged: wavelengths inside that range that had no value.
        notes: what was done about them.
    """

    swatch: Swatch
    lab_draws: Mapping[str, FloatArray]
    illuminant: str
    range_nm: tuple[float, float]
    bridged: int
    notes: tuple[str, ...] = ()

    @property
    def lab_interval(self) -> FloatArray:
        """90 % interval of L*, a* and b*, shape (2, 3): the widest over the couplings."""
        return widest([quantile(lab, TAILS) for lab in self.lab_draws.values()])

    @property
    def spread_ciede2000(self) -> dict[str, float]:
        """CIEDE2000 from the predicted colour within which 90 % of the draws lie."""
        centre = np.array(self.swatch.lab)
        return {
            how: float(quantile(ciede2000_of(lab, centre), [0.9])[0])
            for how, lab in self.lab_draws.items()
        }


@dataclass(frozen=True)
class Difference:
    """CIEDE2000 between two colours.

    Attributes:
        ciede2000: between the predicted colours themselves.
        interval: 5 and 95 % quantiles over pairs of draws, the widest over the couplings. A
            difference cannot be negative, so noise alone lifts both above 0.
        by_coupling: the interval for every way in which wavelengths may go together.
        illuminant: lamp.
        range_nm: wavelengths that both colours have [nm].
    """

    ciede2000: float
    interval: tuple[float, float]
    by_coupling: dict[str, tuple[float, float]]
    illuminant: str
    range_nm: tuple[float, float]


def ciede2000_of(one: FloatArray, other: FloatArray) -> FloatArray:
    """CIEDE2000 between L*a*b* colours (..., 3)."""
    import colour

    one, other = np.broadcast_arrays(one, other)
    return np.asarray(colour.delta_E(one, other, method="CIE 2000"))


def widest(intervals: list[FloatArray]) -> FloatArray:
    """Envelope of intervals (2, ...): the least lower and the greatest upper ends."""
    both = np.stack(intervals)
    return np.stack([both[:, 0].min(axis=0), both[:, 1].max(axis=0)])


def usable_wavelengths(
    prediction: Prediction, missing_share: float = MISSING_SHARE
) -> tuple[NDArray[np.bool_], tuple[str, ...]]:
    """Visible wavelengths with a value, shape (W,), and what is said about the others.

    Raises:
        InputError: the wavelengths that have a value do not carry a colour: they do not reach
            from 430 to 670 nm, leave a hole of more than 60 nm, or too many are missing.
    """
    wavelength = prediction.wavelength_nm
    visible = (wavelength >= VISIBLE_NM[0]) & (wavelength <= VISIBLE_NM[1])
    known = visible & np.isfinite(prediction.reflectance)
    missing, total = int((visible & ~known).sum()), int(visible.sum())
    usable = wavelength[known]
    found = ""
    if usable.size < 4 or usable[0] > NEEDED_NM[0] or usable[-1] < NEEDED_NM[1]:
        reach = f"from {usable[0]:g} to {usable[-1]:g} nm" if usable.size else "nowhere"
        found = f"a reflectance that is known at {usable.size} wavelengths, {reach}"
    elif missing > missing_share * total:
        found = f"{missing} of {total} visible wavelengths without a value"
    elif float(np.diff(usable).max()) > WIDEST_HOLE_NM:
        found = f"a hole of {np.diff(usable).max():g} nm in the reflectance"
    if found:
        raise InputError(
            f"{found} ({prediction.name})",
            f"a colour's {NEEDED_NM[0]:g} to {NEEDED_NM[1]:g} nm with no hole above"
            f" {WIDEST_HOLE_NM:g} nm and at most {100 * missing_share:g} % missing",
            place="colour",
            remedy="; ".join(prediction.notes),
        )
    if not missing:
        return known, ()
    inner = visible & ~known & (wavelength > usable[0]) & (wavelength < usable[-1])
    return known, (
        f"{prediction.name}: of {total} visible wavelengths {missing} have no value;"
        f" {int(inner.sum())} of them were bridged linearly, and the colour is that of"
        f" {usable[0]:g} to {usable[-1]:g} nm",
    )


def colour_of(
    prediction: Prediction,
    illuminant: str = "D65",
    *,
    range_nm: tuple[float, float] | None = None,
    missing_share: float = MISSING_SHARE,
) -> Colour:
    """Colour of a prediction under an illuminant.

    Args:
        prediction: reflectance with draws.
        illuminant: lamp name of the library.
        range_nm: use no more than this range [nm]; None uses all that is there.
        missing_share: greatest share of wavelengths that may be bridged.

    Raises:
        InputError: an unknown illuminant, or too little of the spectrum is known.
    """
    known, notes = usable_wavelengths(prediction, missing_share)
    wavelength = prediction.wavelength_nm
    ends = (float(wavelength[known][0]), float(wavelength[known][-1]))
    if range_nm is not None:
        ends = (max(ends[0], range_nm[0]), min(ends[1], range_nm[1]))
    weights = Weights(*ends, illuminant)
    here = wavelength[known]
    return Colour(
        weights.swatch(weights.xyz(here, prediction.reflectance[known])),
        {
            how: weights.lab(weights.xyz(here, draws[:, known]))
            for how, draws in prediction.couplings().items()
        },
        illuminant,
        ends,
        int((~known & (wavelength > ends[0]) & (wavelength < ends[1])).sum()),
        notes,
    )


def difference(
    one: Prediction,
    other: Prediction,
    illuminant: str = "D65",
    *,
    missing_share: float = MISSING_SHARE,
) -> Difference:
    """CIEDE2000 between two predictions, from the range that both have.

    Their errors are taken as independent of each other.

    Raises:
        InputError: an unknown illuminant, or too little of a spectrum is known.
    """
    first, second = (colour_of(p, illuminant, missing_share=missing_share) for p in (one, other))
    ends = (
        max(first.range_nm[0], second.range_nm[0]), min(first.range_nm[1], second.range_nm[1]),
    )  # fmt: skip
    first, second = (
        colour_of(p, illuminant, range_nm=ends, missing_share=missing_share) for p in (one, other)
    )
    value = float(ciede2000_of(np.array(first.swatch.lab), np.array(second.swatch.lab)))
    rng = np.random.Generator(np.random.Philox(key=[2000, 0]))
    found: dict[str, tuple[float, float]] = {}
    names = dict.fromkeys((*first.lab_draws, *second.lab_draws))
    unknown = [how for how in names if how != AS_DRAWN]
    for how in unknown or [AS_DRAWN]:
        pair = [
            rng.permutation(c.lab_draws[how if how in c.lab_draws else AS_DRAWN])
            for c in (first, second)
        ]
        count = min(map(len, pair))
        low, high = quantile(ciede2000_of(pair[0][:count], pair[1][:count]), TAILS)
        found[how] = (float(low), float(high))
    low, high = widest([np.array(interval) for interval in found.values()])
    return Difference(value, (float(low), float(high)), found, illuminant, ends)


def without_draws(prediction: Prediction) -> Prediction:
    """The same with its value as the only draw: a reference that is taken as exact."""
    return replace(prediction, draws=prediction.reflectance[None], ordered=True)
