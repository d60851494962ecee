"""Fluorophores as excitation times emission times efficiency, and materials that hold them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from twin.errors import InputError
from twin.fluorescence.donaldson import GRID_NM, DonaldsonMatrix, from_photons
from twin.materials.entry import unknown_name
from twin.spectra import FloatArray, Part

_NORMALISE_NM = np.arange(250.0, 1200.0, 1.0)


class Band(Part):
    """A peak with two half-widths at half maximum, Gaussian on either side, 1 at its top."""

    peak_nm: float = Field(gt=0)
    short_nm: float = Field(gt=0)
    """Half-width [nm] at half maximum towards short wavelengths."""
    long_nm: float = Field(gt=0)
    """Half-width [nm] at half maximum towards long wavelengths."""

    def at(self, wavelength_nm: ArrayLike) -> FloatArray:
        """Values, shape (W,), at wavelengths [nm], shape (W,)."""
        wavelength = np.asarray(wavelength_nm, dtype=np.float64)
        width = np.where(wavelength < self.peak_nm, self.short_nm, self.long_nm)
        return np.asarray(np.exp(-np.log(2.0) * ((wavelength - self.peak_nm) / width) ** 2))


class Fluorophore(Part):
    """A dye: what it absorbs, what it emits, and how many photons come back for each."""

    name: str = Field(min_length=1)
    excitation: Band
    emission: Band
    quantum_yield: float = Field(gt=0, le=1)
    """Emitted photons per absorbed photon, over all wavelengths."""
    source: str = ""

    def photons(
        self,
        absorbed_peak: float = 0.5,
        emission_nm: ArrayLike = GRID_NM,
        excitation_nm: ArrayLike = GRID_NM,
    ) -> FloatArray:
        """Photon matrix: absorbed share times quantum yield times share of the emission band.

        Kasha's rule: the emission spectrum does not depend on the excitation. What the band
        would emit at or below the excitation wavelength is left out (no anti-Stokes light), as is
        what it emits outside the rows.

        Args:
            absorbed_peak: share of the light at the excitation peak that the dye absorbs.
            emission_nm: rows, evenly spaced, shape (Wo,).
            excitation_nm: columns, shape (Wi,).

        Returns:
            Photons per bin and incident photon, shape (Wo, Wi).

        Raises:
            InputError: a share outside 0 to 1.
        """
        if not 0.0 <= absorbed_peak <= 1.0:
            raise InputError(f"{absorbed_peak:g}", "a share from 0 to 1", place="absorbed_peak")
        out = np.asarray(emission_nm, dtype=np.float64)
        into = np.asarray(excitation_nm, dtype=np.float64)
        total = float(self.emission.at(_NORMALISE_NM).sum()) * (_NORMALISE_NM[1] - _NORMALISE_NM[0])
        share = self.emission.at(out) * (out[1] - out[0]) / total
        cells = self.quantum_yield * absorbed_peak * np.outer(share, self.excitation.at(into))
        return np.where(out[:, None] > into[None, :] + 1e-6, cells, 0.0)


def product(
    excitation: ArrayLike,
    emission: ArrayLike,
    efficiency: float,
    emission_nm: ArrayLike = GRID_NM,
    excitation_nm: ArrayLike = GRID_NM,
) -> FloatArray:
    """Energy matrix of one fluorophore with sampled spectra, in photons: for measured spectra.

    Args:
        excitation: relative excitation, shape (Wi,); scaled to a peak of 1.
        emission: relative emission in photons per bin, shape (Wo,); scaled to a sum of 1.
        efficiency: photons emitted in the rows per photon at the peak of the excitation.
        emission_nm: rows, shape (Wo,).
        excitation_nm: columns, shape (Wi,).

    Returns:
        Energy matrix without the reflectance, shape (Wo, Wi), 0 where emission is not longer.

    Raises:
        InputError: a negative value, no number, nothing above 0, an efficiency outside 0 to 1.
    """
    ex, em = np.asarray(excitation, dtype=np.float64), np.asarray(emission, dtype=np.float64)
    out, into = np.asarray(emission_nm, float), np.asarray(excitation_nm, float)
    for name, value, grid in (("excitation", ex, into), ("emission", em, out)):
        if value.shape != grid.shape:
            raise InputError(f"{name} of shape {value.shape}", f"shape {grid.shape}", place=name)
        if not np.all(np.isfinite(value) & (value >= 0.0)) or value.max() <= 0.0:
            raise InputError(
                f"{name} values that are negative, no numbers or all 0",
                "0 or more, and some above", place=name,
            )  # fmt: skip
    if not 0.0 <= efficiency <= 1.0:
        raise InputError(f"{efficiency:g}", "an efficiency from 0 to 1", place="efficiency")
    cells = efficiency * np.outer(em / em.sum(), ex / ex.max())
    return from_photons(np.where(out[:, None] > into + 1e-6, cells, 0.0), out, into)


def dyed(
    base: ArrayLike,
    fluorophores: dict[str, float],
    *,
    emission_nm: ArrayLike = GRID_NM,
    excitation_nm: ArrayLike | None = None,
    name: str = "",
) -> DonaldsonMatrix:
    """A diffuse base that holds fluorophores of the library: a Donaldson matrix.

    Reflectance: base times the share that every dye leaves. Fluorescence: the sum of the dyes,
    each absorbing its share of what falls in (light that several absorb is not shared out, so the
    shares should be small where bands overlap).

    Args:
        base: reflectance of the base at the emission wavelengths, scalar or (Wo,), 0 to 1.
        fluorophores: share absorbed at the excitation peak, by library name.
        emission_nm: rows, (Wo,).
        excitation_nm: columns, (Wi,); None takes the rows.
        name: name of the material.

    Raises:
        InputError: an unknown name, a share or reflectance outside 0 to 1.
    """
    out = np.asarray(emission_nm, dtype=np.float64)
    into = out if excitation_nm is None else np.asarray(excitation_nm, dtype=np.float64)
    reflectance = np.broadcast_to(np.asarray(base, dtype=np.float64), out.shape)
    if not np.all((reflectance >= 0.0) & (reflectance <= 1.0)):
        raise InputError("a base outside 0 to 1", "a reflectance", place="base")
    cells = np.zeros((out.size, into.size))
    for each, share in fluorophores.items():
        dye = fluorophore(each)
        cells += from_photons(dye.photons(share, out, into), out, into)
        reflectance = reflectance * (1.0 - share * dye.excitation.at(out))
    same = np.abs(out[:, None] - into[None, :]) < 1e-6
    return DonaldsonMatrix(
        cells + same * reflectance[:, None],
        out,
        into,
        name=name or " + ".join(fluorophores) or "base",
        source="; ".join(fluorophore(each).source for each in fluorophores),
    )


def _dye(
    name: str,
    ex: tuple[float, float, float],
    em: tuple[float, float, float],
    quantum_yield: float,
    source: str,
) -> Fluorophore:
    excitation = Band(peak_nm=ex[0], short_nm=ex[1], long_nm=ex[2])
    emission = Band(peak_nm=em[0], short_nm=em[1], long_nm=em[2])
    return Fluorophore(
        name=name, excitation=excitation, emission=emission, quantum_yield=quantum_yield,
        source=source,
    )  # fmt: skip


FLUOROPHORES: dict[str, Fluorophore] = {
    dye.name: dye
    for dye in (
        _dye(
            "quinine_sulfate", (347, 30, 20), (451, 37, 53), 0.546,
            "in 0.5 M sulfuric acid: yield Melhuish 1961 (J. Phys. Chem. 65, 229), peaks Du et al."
            " 1998 (PhotochemCAD)",
        ),
        _dye(
            "stilbene_brightener", (375, 35, 22), (437, 15, 30), 0.8,
            "as optical brighteners look in paper: figures of ours, not published ones",
        ),
        _dye(
            "coumarin_6", (456, 38, 26), (500, 18, 42), 0.78,
            "in ethanol: yield Reynolds and Drexhage 1975 (Opt. Commun. 13, 222), peaks Du et al."
            " 1998 (PhotochemCAD)",
        ),
        _dye(
            "fluorescein", (491, 22, 13), (514, 13, 28), 0.925,
            "in 0.1 M sodium hydroxide: yield Magde et al. 2002 (Photochem. Photobiol. 75, 327)",
        ),
        _dye(
            "rhodamine_b", (543, 22, 13), (565, 16, 23), 0.70,
            "in ethanol: yield Kubin and Fletcher 1982 (J. Lumin. 27, 455) 0.71, PhotochemCAD 0.70",
        ),
        _dye(
            "sulforhodamine_101", (576, 17, 14), (591, 14, 22), 0.95,
            "in ethanol: yield Velapoldi and Tonnesen 2004 (J. Fluoresc. 14, 465)",
        ),
    )
}  # fmt: skip
"""Fluorophores by name. Peaks and yields are published; the half-widths are rounded to what the
cited dyes' spectra show and the split Gaussian is ours: vibronic shoulders are left out."""


def fluorophore(name: str) -> Fluorophore:
    """A fluorophore of the library.

    Raises:
        InputError: an unknown name; the message lists those that look like it.
    """
    if name not in FLUOROPHORES:
        raise unknown_name("the fluorophore", name, tuple(FLUOROPHORES))
    return FLUOROPHORES[name]


MATERIALS: dict[str, tuple[float, dict[str, float]]] = {
    "brightened_paper": (0.85, {"stilbene_brightener": 0.6}),
    "yellow_highlighter": (0.85, {"coumarin_6": 0.7}),
    "green_marker": (0.80, {"fluorescein": 0.7}),
    "pink_paper": (0.85, {"rhodamine_b": 0.6}),
    "red_ink": (0.80, {"sulforhodamine_101": 0.6}),
    "yellow_and_pink": (0.85, {"coumarin_6": 0.5, "rhodamine_b": 0.4}),
    "green_and_red": (0.80, {"fluorescein": 0.4, "sulforhodamine_101": 0.5}),
    "white": (0.99, {}),
}
"""Example materials: reflectance of the base and the dyes in it. Ours, not measured."""


def example(
    name: str, emission_nm: ArrayLike = GRID_NM, excitation_nm: ArrayLike | None = None
) -> DonaldsonMatrix:
    """The Donaldson matrix of an example material.

    Raises:
        InputError: an unknown name; the message lists those that look like it.
    """
    if name not in MATERIALS:
        raise unknown_name("the fluorescent material", name, tuple(MATERIALS))
    base, dyes = MATERIALS[name]
    return dyed(base, dyes, emission_nm=emission_nm, excitation_nm=excitation_nm, name=name)
