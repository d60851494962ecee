"""Design points: which materials a stress test tries, visit by visit."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from scenarios.stress.plan import Materials, StressPlan
from twin.spectra import FloatArray

MEDIA, ALBEDOS, ORDER, SPECTRA = 1, 2, 3, 4
"""Streams of random numbers: one purpose each."""


@dataclass(frozen=True, eq=False)
class Design:
    """Materials of a stress test.

    Attributes:
        material: (albedo, sigma_t [1/mm], g) of every point, shape (N, 3).
        visit: number of the visit that carries the point, shape (N,), from 0, increasing.
    """

    material: FloatArray
    visit: NDArray[np.int64]

    def __len__(self) -> int:
        """Number of points N."""
        return len(self.material)

    @property
    def visits(self) -> int:
        """Number of visits."""
        return int(self.visit[-1]) + 1


def design_of(plan: StressPlan) -> Design:
    """The points of a plan, a pure function of it.

    A random design takes (sigma_t, g) from a Sobol sequence, shifted at random (Cranley and
    Patterson 1976), and gives every such medium `albedos_per_medium` albedos, one in each of as
    many equal strata. Media are split evenly over visits; inside a visit points are shuffled, so
    that no parameter goes with the wavelength. A design of spectra has one in every visit, from
    short wavelengths to long ones; the Sobol sequence starts them.

    Raises:
        InputError: ranges in which no spectrum stays.
    """
    if plan.materials.spectra:
        return _spectra(plan)
    share, counts = _grid(plan.materials) if plan.materials.grid else _random(plan)
    material = spread(plan.materials, share)
    visits = max(1, -(-len(material) // plan.points_per_visit))
    media_of_visit = np.array_split(np.arange(len(counts)), min(visits, len(counts)))
    first = np.concatenate([[0], np.cumsum(counts)])
    pieces, numbers = [], []
    for number, media in enumerate(_without_singles(media_of_visit, counts)):
        points = np.arange(first[media[0]], first[media[-1] + 1])
        pieces.append(_stream(plan.seed, ORDER, number).permutation(points))
        numbers.append(np.full(len(points), number))
    return Design(material[np.concatenate(pieces)], np.concatenate(numbers))


def spread(materials: Materials, share: FloatArray) -> FloatArray:
    """Shares of the ranges, 0 to 1, as (albedo, sigma_t [1/mm], g), shape (N, 3) both."""
    low = coordinates(np.array([[r[0] for r in _ranges(materials)]]))
    high = coordinates(np.array([[r[1] for r in _ranges(materials)]]))
    first, second, third = (low + np.asarray(share) * (high - low)).T
    return np.stack([-np.expm1(-first), np.exp(second), -np.expm1(-third)], axis=-1)


def coordinates(material: FloatArray) -> FloatArray:
    """-ln(1 - albedo), ln sigma_t and -ln(1 - g): the scales of the design, shape (N, 3).

    The bench sees equal steps of them about equally well: 1 - albedo is the absorbed share, and
    media with the same sigma_t (1 - g) look alike.
    """
    albedo, sigma_t, g = np.asarray(material).T
    return np.stack([-np.log1p(-albedo), np.log(sigma_t), -np.log1p(-g)], axis=-1)


def _ranges(materials: Materials) -> tuple[tuple[float, float], ...]:
    return materials.albedo, materials.sigma_t_per_mm, materials.g


def _random(plan: StressPlan) -> tuple[FloatArray, NDArray[np.int64]]:
    """Shares (N, 3) and the number of points of each medium."""
    each = min(plan.albedos_per_medium, plan.points)
    media = -(-plan.points // each)
    pairs = _sobol(plan, media)
    jitter = _stream(plan.seed, ALBEDOS, 0).random((media, each))
    albedo = (np.arange(each) + jitter) / each
    share = np.concatenate([albedo[..., None], np.repeat(pairs[:, None], each, axis=1)], axis=-1)
    counts = np.full(media, each)
    counts[-1] -= media * each - plan.points
    kept = np.concatenate([share[m, _spaced(each, int(n))] for m, n in enumerate(counts)])
    return kept, counts


def _spectra(plan: StressPlan) -> Design:
    """One smooth spectrum for every visit; they share the range of the first bench."""
    from scenarios.stress.spectra import spectrum_inside

    pixels = next(iter(plan.benches.values())).instrument.wavelength_nm
    low, high = np.array(_ranges(plan.materials)).T
    visits = -(-plan.points // plan.points_per_visit)
    sizes = np.full(visits, plan.points_per_visit)
    sizes[-1] -= visits * plan.points_per_visit - plan.points
    if sizes[-1] < 2:  # a visit needs two wavelengths
        sizes = np.append(sizes[:-2], sizes[-2:].sum())
    spectra = []
    for number, (size, start) in enumerate(zip(sizes, _sobol(plan, len(sizes)), strict=True)):
        wavelength = np.linspace(float(pixels[0]), float(pixels[-1]), size)
        stream = _stream(plan.seed, SPECTRA, number)
        spectra.append(spectrum_inside(stream, wavelength, start, low, high))
    return Design(np.concatenate(spectra), np.repeat(np.arange(len(sizes)), sizes))


def _sobol(plan: StressPlan, count: int) -> FloatArray:
    """Shares of sigma_t and g, shape (count, 2).

    Sobol points come in powers of two; the first of them are as even as a part can be. Shifted
    here: the library's own scrambling draws from generators that it makes itself.
    """
    from scipy.stats import qmc

    sobol = qmc.Sobol(2, scramble=False).random(1 << max(0, (count - 1).bit_length()))
    return np.asarray((sobol[:count] + _stream(plan.seed, MEDIA, 0).random(2)) % 1.0)


def _spaced(count: int, wanted: int) -> NDArray[np.int64]:
    """`wanted` of `count` indices, evenly."""
    return np.asarray(np.floor((np.arange(wanted) + 0.5) * count / wanted).astype(np.int64))


def _grid(materials: Materials) -> tuple[FloatArray, NDArray[np.int64]]:
    """Shares (N, 3) of a grid, albedo fastest, and the number of points of each medium."""
    albedos, sigmas, gs = materials.grid or (1, 1, 1)
    axes = [np.linspace(0, 1, n) if n > 1 else np.array([0.5]) for n in (albedos, sigmas, gs)]
    share = [(a, s, g) for s, g, a in product(axes[1], axes[2], axes[0])]
    return np.array(share), np.full(sigmas * gs, albedos)


def _without_singles(
    groups: list[NDArray[np.int64]], counts: NDArray[np.int64]
) -> list[NDArray[np.int64]]:
    """The same groups of media, one of a single point joined to the one before it.

    A visit needs two wavelengths.
    """
    joined: list[NDArray[np.int64]] = []
    for group in groups:
        if joined and (counts[group].sum() < 2 or counts[joined[-1]].sum() < 2):
            joined[-1] = np.concatenate([joined[-1], group])
        else:
            joined.append(group)
    return joined


def _stream(seed: int, purpose: int, number: int) -> np.random.Generator:
    key = np.array([seed, 0x737472], dtype=np.uint64)
    return np.random.Generator(np.random.Philox(key=key, counter=[0, 0, number, purpose]))


def derived_seed(seed: int, *numbers: int) -> int:
    """A seed for one part of the work, below 2**63, from the plan's and the part's numbers.

    At most three numbers.
    """
    counter = [*numbers, 0, 0, 0][:3]
    key = np.array([seed, 0x64657269], dtype=np.uint64)
    return int(
        np.random.Generator(np.random.Philox(key=key, counter=[0, *counter])).integers(1 << 63)
    )
