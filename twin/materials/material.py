"""A medium as a frozen description, and what happens when several are mixed.

Absorption and scattering coefficients add by volume (independent scattering), the anisotropy
factor is the mean weighted with the scattering coefficients: Bohren and Huffman 1983, chapter 3.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from twin.errors import InputError
from twin.materials.entry import require_range, wavelengths
from twin.spectra import FloatArray, Spectral

FULL = 1e-9
"""Volume fractions are compared with this tolerance: they are typed as decimal fractions."""


class Coefficients(NamedTuple):
    """Coefficients at W wavelengths, each of shape (W,)."""

    sigma_a_per_mm: FloatArray
    """Absorption coefficient [1/mm], per mol/l for a dye."""
    sigma_s_per_mm: FloatArray
    """Scattering coefficient [1/mm], per mol/l for a dye."""
    g: FloatArray
    """Anisotropy factor."""


LARGEST_FIRST_G = 0.995
LARGEST_SECOND_G = 0.95


@dataclass(frozen=True)
class OpticalProperties:
    """What the light transport needs of a medium, each array of shape (W,).

    Attributes:
        wavelength_nm: wavelengths [nm].
        albedo: single-scattering albedo; 0 where nothing is scattered or absorbed.
        sigma_t_per_mm: extinction coefficient [1/mm].
        g: anisotropy factor; 0 where nothing is scattered.
        n: refractive index of the material itself, or None when its source gives none.
        second_share, second_g: second lobe of the phase function, see `twin.bench.Medium`;
            the same at all wavelengths.
    """

    wavelength_nm: FloatArray
    albedo: FloatArray
    sigma_t_per_mm: FloatArray
    g: FloatArray
    n: FloatArray | None
    second_share: float = 0.0
    second_g: float = -0.5

    @property
    def first_g(self) -> FloatArray:
        """Anisotropy factor of the first lobe, shape (W,): g itself without a second one."""
        if self.second_share == 0.0:
            return self.g
        return (self.g - self.second_share * self.second_g) / (1.0 - self.second_share)

    def require_lobes(self) -> None:
        """Check the second lobe.

        Raises:
            InputError: a share outside 0 to 1, or a mean cosine that asks for a first lobe
                beyond +-0.995.
        """
        if not 0.0 <= self.second_share < 1.0 or not abs(self.second_g) <= LARGEST_SECOND_G:
            raise InputError(
                f"a second lobe of share {self.second_share:g} and g {self.second_g:g}",
                f"a share from 0 to below 1 and a g of -{LARGEST_SECOND_G} to {LARGEST_SECOND_G}",
                place="second_share",
            )
        if self.second_share > 0.0:
            first = self.first_g
            worst = int(np.argmax(np.abs(first)))
            if not abs(first[worst]) <= LARGEST_FIRST_G:
                raise InputError(
                    f"a second lobe of share {self.second_share:g} and g {self.second_g:g}, which"
                    f" asks for a first lobe of g {first[worst]:.4g} to keep the mean cosine at"
                    f" {self.g[worst]:g}",
                    f"a first lobe of g between -{LARGEST_FIRST_G} and {LARGEST_FIRST_G}",
                    place="second_share",
                    remedy="Take a smaller share",
                )

    @property
    def sigma_s_per_mm(self) -> FloatArray:
        """Scattering coefficient [1/mm], shape (W,)."""
        return self.albedo * self.sigma_t_per_mm

    @property
    def sigma_a_per_mm(self) -> FloatArray:
        """Absorption coefficient [1/mm], shape (W,)."""
        return (1 - self.albedo) * self.sigma_t_per_mm


@dataclass(frozen=True)
class Material:
    """A medium with its source.

    Attributes:
        name: name in the library, or the composition.
        citation: author, year, and where in the publication.
        range_nm: first and last wavelength [nm] that can be asked for.
        coefficients: coefficients at wavelengths [nm], shape (W,), inside the range: of the
            undiluted material, or of 1 mol/l of a dye.
        measure: whether an amount of it is a volume fraction or a molar concentration.
        solvent: what fills the rest of the volume when less than all of it is this material;
            None when it cannot be diluted.
        n: refractive index (number or library name), or None when the source gives none.
        interpolated: True when the source has three colour channels and not a spectrum.
        assumed_nm: parts of `range_nm` in which the values are a stated assumption.
        note: what a user has to know.
    """

    name: str
    citation: str
    range_nm: tuple[float, float]
    coefficients: Callable[[FloatArray], Coefficients]
    measure: Literal["volume", "molar"] = "volume"
    solvent: Material | None = None
    n: Spectral | None = None
    interpolated: bool = False
    assumed_nm: tuple[tuple[float, float], ...] = ()
    note: str = ""

    def at(self, wavelength_nm: ArrayLike) -> Coefficients:
        """Coefficients at wavelengths [nm], shape (W,).

        Raises:
            InputError: a wavelength lies outside `range_nm`: nothing is extrapolated.
        """
        wavelength = wavelengths(wavelength_nm)
        require_range(self.name, self.range_nm, wavelength)
        return self.coefficients(wavelength)


class Share(NamedTuple):
    """An amount of a material in a mixture."""

    material: Material
    amount: float
    """Volume fraction, or concentration [mol/l] of a dye."""


def mixture(name: str, shares: Sequence[Share]) -> Material:
    """The mixture of materials; the rest of the volume is their solvent.

    A dissolved dye takes no volume.

    Raises:
        InputError: volume fractions above 100 %, or below it without a solvent; materials that do
            not share a solvent or a wavelength.
    """
    parts, solvent = _filled(name, shares)
    low = max(part.material.range_nm[0] for part in parts)
    high = min(part.material.range_nm[1] for part in parts)
    if low >= high:
        raise InputError(f'no common wavelengths in "{name}"', "sources that overlap")

    def coefficients(wavelength_nm: FloatArray) -> Coefficients:
        sigma_a = np.zeros_like(wavelength_nm)
        sigma_s = np.zeros_like(wavelength_nm)
        moment = np.zeros_like(wavelength_nm)
        for material, amount in parts:
            own = material.coefficients(wavelength_nm)
            sigma_a = sigma_a + amount * own.sigma_a_per_mm
            sigma_s = sigma_s + amount * own.sigma_s_per_mm
            moment = moment + amount * own.sigma_s_per_mm * own.g
        return Coefficients(sigma_a, sigma_s, ratio(moment, sigma_s))

    indices = {
        repr(part.material.n): part.material.n
        for part in parts
        if part.material.measure == "volume"
    }
    return Material(
        name=name,
        citation="; ".join(dict.fromkeys(part.material.citation for part in parts)),
        range_nm=(low, high),
        coefficients=coefficients,
        solvent=solvent,
        n=next(iter(indices.values())) if len(indices) == 1 else None,
        interpolated=any(part.material.interpolated for part in parts),
        assumed_nm=tuple(
            dict.fromkeys(span for part in parts for span in part.material.assumed_nm)
        ),
        note=" ".join(dict.fromkeys(part.material.note for part in parts if part.material.note)),
    )


def _filled(name: str, shares: Sequence[Share]) -> tuple[list[Share], Material | None]:
    """The shares, with the solvent that fills the rest of the volume, and that solvent."""
    volume = sum(share.amount for share in shares if share.material.measure == "volume")
    if volume > 1 + FULL:
        raise InputError(f'{100 * volume:.6g} % of the volume in "{name}"', "100 % at most")
    solvents = {id(s.material.solvent): s.material.solvent for s in shares if s.material.solvent}
    if len(solvents) > 1:
        raise InputError(f'several solvents in "{name}"', "materials with the same solvent")
    solvent = next(iter(solvents.values()), None)
    if solvent is not None:
        for share in shares:
            if share.material.solvent is not solvent and share.material is not solvent:
                raise InputError(
                    f'{share.material.name} beside what is mixed in {solvent.name} in "{name}"',
                    f"materials that mix with {solvent.name}",
                )
    if volume >= 1 - FULL:
        return list(shares), solvent
    if solvent is None:
        raise InputError(
            f'{100 * volume:.6g} % of the volume in "{name}"',
            "fractions that add up to 100 %: nothing dilutes these materials",
        )
    return [*shares, Share(solvent, 1 - volume)], solvent


def ratio(numerator: FloatArray, denominator: FloatArray) -> FloatArray:
    """Quotient, shape (W,), and 0 where the denominator is 0."""
    result = np.zeros_like(numerator)
    np.divide(numerator, denominator, out=result, where=denominator > 0)
    return result
