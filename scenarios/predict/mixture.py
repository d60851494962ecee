"""Media with their uncertainty, and what becomes of them when they are mixed.

A mixture is homogenised: what is smaller than the mean free path of the light is seen as one
medium. Absorption and scattering coefficients add by volume fraction, the anisotropy factor is
the mean weighted with the scattering coefficients (independent scattering: Bohren and Huffman
1983, chapter 3; for halftoned inks: Elek et al. 2017, ACM TOG 36(6) 241).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.spectra import FloatArray

FULL = 1e-6
"""How far the sum of volume fractions may be from 1: they are typed as decimal fractions."""
ALBEDO, SIGMA_T, G = range(3)


@dataclass(frozen=True, eq=False)
class UncertainMedium:
    """Optical properties at W wavelengths, and D equally likely draws of them.

    Attributes:
        name: what it is called in outputs.
        wavelength_nm: [nm], increasing, shape (W,).
        value: albedo, sigma_t [1/mm] and g, shape (W, 3); NaN where nothing is known.
        draws: the same, shape (D, W, 3).
        ordered: whether a draw belongs together over wavelengths. If not, nothing is known about
            how the errors of two wavelengths go together.
        notes: what was left out or assumed, in sentences.
    """

    name: str
    wavelength_nm: FloatArray
    value: FloatArray
    draws: FloatArray
    ordered: bool
    notes: tuple[str, ...] = ()

    @property
    def known(self) -> NDArray[np.bool_]:
        """Wavelengths that have a value, shape (W,)."""
        return np.asarray(np.isfinite(self.value).all(axis=-1))


def mix_properties(properties: Sequence[FloatArray], fractions: Sequence[float]) -> FloatArray:
    """Properties of a homogenised mixture.

    Args:
        properties: albedo, sigma_t [1/mm] and g of each part, all of one shape (..., 3).
        fractions: volume fractions, 0 to 1, that add up to 1.

    Returns:
        Albedo, sigma_t [1/mm] and g, shape (..., 3); albedo 0 where there is no extinction and
        g 0 where nothing is scattered. A part of fraction 0 does not count, NaN or not.

    Raises:
        InputError: fractions that do not add up to 1.
    """
    share = checked_fractions(fractions, len(properties))
    parts = [(f, p) for f, p in zip(share, properties, strict=True) if f > 0]
    if len(parts) == 1:
        return np.array(parts[0][1], dtype=np.float64)
    weights = np.array([f for f, _ in parts])
    albedo, sigma_t, g = np.moveaxis(np.stack([p for _, p in parts], axis=-1), -2, 0)
    extinction = (sigma_t * weights).sum(axis=-1)
    scattering = (albedo * sigma_t * weights).sum(axis=-1)
    moment = (albedo * sigma_t * weights * g).sum(axis=-1)
    return np.stack([_ratio(scattering, extinction), extinction, _ratio(moment, scattering)], -1)


def _ratio(numerator: FloatArray, denominator: FloatArray) -> FloatArray:
    """Quotient, and 0 where the denominator is 0; NaN stays NaN."""
    nothing = denominator == 0
    return np.where(nothing, 0.0, numerator / np.where(nothing, 1.0, denominator))


def checked_fractions(fractions: Sequence[float], count: int) -> list[float]:
    """Fractions divided by their sum, once they are `count` fractions that add up to 1.

    Raises:
        InputError: another number of them, one outside 0 to 1, or another sum.
    """
    share = [float(fraction) for fraction in fractions]
    if len(share) != count or not share:
        raise InputError(f"{len(share)} fractions for {count} media", "one for each, at least one")
    for fraction in share:
        if not 0 <= fraction <= 1:
            raise InputError(f"a volume fraction of {fraction:g}", "0 to 1", place="mix")
    total = sum(share)
    if abs(total - 1) > FULL:
        raise InputError(
            f"fractions that add up to {total:.6g}", "volume fractions that add up to 1",
            place="mix",
            remedy="Nothing is assumed about the rest of the volume.",
        )  # fmt: skip
    return [fraction / total for fraction in share]


def mix_media(
    media: Sequence[UncertainMedium], fractions: Sequence[float], *, name: str = ""
) -> UncertainMedium:
    """Mix media, draw by draw; the errors of different media are taken as independent.

    Media on other wavelengths than the first are interpolated linearly in absorption, scattering
    and scattering times g, on those wavelengths of the first that all share.

    Args:
        media: with draws; where their numbers differ the least counts.
        fractions: volume fractions that add up to 1.
        name: of the mixture; "" makes one.

    Returns:
        The mixture; a wavelength is known where all parts (of a fraction above 0) are.

    Raises:
        InputError: fractions that do not add up to 1, or no common wavelengths.
    """
    share = checked_fractions(fractions, len(media))
    parts = [(f, m) for f, m in zip(share, media, strict=True) if f > 0]
    wavelength, notes = _common_wavelengths([medium for _, medium in parts])
    count = min(len(medium.draws) for _, medium in parts)
    own = [f for f, _ in parts]
    value = mix_properties([_on(m.value, m.wavelength_nm, wavelength) for _, m in parts], own)
    drawn = [_on(m.draws[:count], m.wavelength_nm, wavelength) for _, m in parts]
    for _, medium in parts:
        notes += [f"{medium.name}: {note}" for note in medium.notes]
    return UncertainMedium(
        name or " + ".join(f"{100 * f:.4g} % {m.name}" for f, m in parts),
        wavelength,
        value,
        mix_properties(drawn, own),
        all(medium.ordered for _, medium in parts),
        tuple(dict.fromkeys(notes)) if len(parts) > 1 else parts[0][1].notes,
    )


def _common_wavelengths(media: Sequence[UncertainMedium]) -> tuple[FloatArray, list[str]]:
    """Wavelengths of the first medium inside the range of all, and what to say about it."""
    first = media[0].wavelength_nm
    if all(np.array_equal(medium.wavelength_nm, first) for medium in media):
        return first, []
    low = max(float(medium.wavelength_nm[0]) for medium in media)
    high = min(float(medium.wavelength_nm[-1]) for medium in media)
    common = first[(first >= low) & (first <= high)]
    if common.size == 0:
        ranges = ", ".join(
            f"{medium.name} {medium.wavelength_nm[0]:g} to {medium.wavelength_nm[-1]:g} nm"
            for medium in media
        )
        raise InputError(f"no common wavelengths ({ranges})", "estimates that overlap", place="mix")
    return common, [
        f"the media have different wavelengths; the {common.size} of {media[0].name} in their"
        f" common range, {common[0]:g} to {common[-1]:g} nm, are used and the others are"
        " interpolated linearly"
    ]


def _on(properties: FloatArray, given_nm: FloatArray, wanted_nm: FloatArray) -> FloatArray:
    """Properties (..., W, 3) interpolated to wanted wavelengths; beside an unknown one NaN."""
    if np.array_equal(given_nm, wanted_nm):
        return properties
    low = np.clip(np.searchsorted(given_nm, wanted_nm, side="right") - 1, 0, len(given_nm) - 1)
    high = np.minimum(low + (given_nm[low] < wanted_nm), len(given_nm) - 1)
    step = np.where(high > low, given_nm[high] - given_nm[low], 1.0)
    weight = (wanted_nm - given_nm[low]) / step

    def at(quantity: FloatArray) -> FloatArray:
        return (1 - weight) * quantity[..., low] + weight * quantity[..., high]

    extinction = at(properties[..., SIGMA_T])
    scattering = at(properties[..., ALBEDO] * properties[..., SIGMA_T])
    moment = at(properties[..., ALBEDO] * properties[..., SIGMA_T] * properties[..., G])
    return np.stack([_ratio(scattering, extinction), extinction, _ratio(moment, scattering)], -1)
