"""The material that an estimate finds which takes broad channels as single wavelengths.

It is the one whose light is most like that of the bands, by the weights of the estimate, and may
be far from the average material: it is fitted, not taken to first order. Fits of many candidates
share one table of the fast engine: logarithms of the parts of the captures as Chebyshev series in
(logit albedo, ln sigma_t, artanh g) around the average material.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np
from numpy.polynomial import chebyshev

from scenarios.design.bands import View
from scenarios.design.optics import (
    ENGINE_ERROR,
    MATERIAL,
    Light,
    Optics,
    intensities,
    optical_key,
    solved,
)
from twin.bench import Bench
from twin.materials import reflectance
from twin.spectra import FloatArray

BELOW, ABOVE = np.array([1.2, 1.6, 1.2]), np.array([0.6, 0.5, 0.5])
"""How far a table reaches from the average material in its coordinates; light leaks in where a
material is dark, so that most of it is below."""
NODES = (4, 6, 6)
"""Nodes of the table by coordinate: captures are then known to 1e-3."""
LEAST = 1e-300
STEPS, LONGEST, SETTLED = 25, 0.7, 1e-3
"""Steps of the fit, the longest and the last in coordinates."""


@dataclass(frozen=True, eq=False)
class Table:
    """Light of one material's neighbourhood at K thicknesses and W channels.

    Attributes:
        mean: the average material, (W, 3).
        low, high: ends in coordinates, (W, 3).
        series: coefficients of the logarithms of the parts of the captures, (K, W, 5, *NODES).
        rho: reflectances of black and white, (2, W).
    """

    mean: FloatArray
    low: FloatArray
    high: FloatArray
    series: FloatArray
    rho: FloatArray

    def light(self, place: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Captures (K, W, 3) and their slopes by coordinates (K, W, 3, 3) at coordinates (W, 3)."""
        unit = 2.0 * (place - self.low) / (self.high - self.low) - 1.0
        powers = [chebyshev.chebvander(unit[:, i], n - 1) for i, n in enumerate(NODES)]
        turned = [power @ _SLOPE[n] for power, n in zip(powers, NODES, strict=True)]
        by_g = [np.einsum("kwpabc,wc->kwpab", self.series, x) for x in (powers[2], turned[2])]
        by_s = [np.einsum("kwpab,wb->kwpa", by_g[0], x) for x in (powers[1], turned[1])]
        by_s.append(np.einsum("kwpab,wb->kwpa", by_g[1], powers[1]))
        log, slope_s, slope_g = (np.einsum("kwpa,wa->kwp", x, powers[0]) for x in by_s)
        slope_a = np.einsum("kwpa,wa->kwp", by_s[0], turned[0])
        parts = np.exp(log)
        slopes = np.stack([slope_a, slope_s, slope_g], axis=-1) * parts[..., None]
        slopes *= (2.0 / (self.high - self.low))[:, None]
        value = intensities(parts, list(self.rho))
        _, once, returned = (parts[..., i] for i in range(3))
        found = np.empty((*value.shape, 3))
        for capture, own in enumerate(self.rho):
            kept = 1.0 / (1.0 - own * returned)
            found[..., capture, :] = (
                slopes[..., 0, :]
                + (own * kept)[..., None] * slopes[..., 1, :]
                + (own**2 * once * kept**2)[..., None] * slopes[..., 2, :]
            )
        found[..., 2, :] = slopes[..., 3, :] + slopes[..., 4, :]
        return value, found


def _slope_matrix(count: int) -> FloatArray:
    """Turns Chebyshev polynomials T_0 ... into their derivatives: T' = T @ matrix."""
    matrix = np.zeros((count, count))
    for i in range(1, count):
        own = chebyshev.chebder(np.eye(count)[i])
        matrix[: len(own), i] = own
    return matrix


_SLOPE = {count: _slope_matrix(count) for count in NODES}


def coordinates(material: FloatArray) -> FloatArray:
    """(logit albedo, ln sigma_t, artanh g) of materials (..., 3)."""
    albedo = np.clip(material[..., 0], 1e-5, 1.0 - 1e-5)
    g = np.clip(material[..., 2], -0.99, 0.99)
    return np.stack(
        [np.log(albedo / (1.0 - albedo)), np.log(material[..., 1]), np.arctanh(g)], axis=-1
    )


def material_at(place: FloatArray) -> FloatArray:
    """Albedo, sigma_t [1/mm] and g at coordinates (..., 3)."""
    albedo = 1.0 / (1.0 + np.exp(-place[..., 0]))
    return np.stack([albedo, np.exp(place[..., 1]), np.tanh(place[..., 2])], axis=-1)


@dataclass(eq=False)
class Tables:
    """Tables of a study's materials; kept.

    Attributes:
        optics: the materials and thicknesses.
    """

    optics: Optics
    _series: dict[tuple[str, int], FloatArray] = field(default_factory=dict, repr=False)

    def of(self, number: int, bench: Bench, view: View) -> Table:
        """The table of a material by its number, on a bench as its detector sees it.

        Raises:
            InputError: a spectrum that does not cover what the detector sees.
        """
        wavelength = view.wavelength_nm
        mean = view.mean(self.optics.media[number])
        key = (optical_key(bench, wavelength) + str(mean.tobytes()), number)
        if key not in self._series:
            self._series[key] = self._made(number, bench, wavelength, mean)
        background = bench.background
        rho = [reflectance(b.reflectance, wavelength) for b in (background.black, background.white)]
        centre = coordinates(mean)
        return Table(mean, centre - BELOW, centre + ABOVE, self._series[key], np.array(rho))

    def estimated(
        self, bench: Bench, view: View, light: Light, noise: FloatArray, moved: FloatArray,
        common: int, chosen: Sequence[int],
    ) -> tuple[Light, FloatArray]:  # fmt: skip
        """Light with its slopes at the materials that an estimate finds, and how far off they are.

        Args:
            bench: of the light.
            view: of its detector.
            light: as it is seen.
            noise: covariance of the captures, (M, K, W, 3, 3).
            moved: their change by one standard deviation of every tolerance, (M, K, W, 3, Q + P).
            common: Q, the first ones, which all samples share.
            chosen: which S of the thicknesses the estimate has.

        Returns:
            The light, and the shift of albedo, sigma_t [1/mm] and g, (M, W, 3).
        """
        slope, shift = light.slope.copy(), np.zeros_like(light.value[:, 0])
        for m, medium in enumerate(self.optics.media):
            if medium.values is not None:
                continue  # the same at all wavelengths: bands average nothing
            seen = light.value[m, chosen]
            weight = weights(seen, noise[m, chosen], moved[m][chosen], common)
            shift[m], slope[m, ..., :MATERIAL] = apparent(
                self.of(m, bench, view), chosen, seen, weight
            )
        return Light(light.value, slope), shift

    def _made(
        self, number: int, bench: Bench, wavelength_nm: FloatArray, mean: FloatArray
    ) -> FloatArray:
        """The series (K, W, 5, *NODES): from values at the nodes, axis by axis."""
        centre = coordinates(mean)
        low, high = centre - BELOW, centre + ABOVE
        nodes = [chebyshev.chebpts1(count) for count in NODES]
        grid = np.array(list(product(*nodes)))
        place = low[:, None] + (high - low)[:, None] * (grid + 1.0) / 2.0
        rows = material_at(place).reshape(-1, 3)
        medium, many = self.optics.media[number], np.repeat(wavelength_nm, len(grid))
        found = np.array(
            [solved(bench, medium, mm, many, values=rows)[0] for mm in self.optics.thickness_mm]
        )
        log = np.log(np.maximum(found, LEAST)).reshape(len(found), len(mean), *NODES, -1)
        back = [np.linalg.inv(chebyshev.chebvander(own, len(own) - 1)) for own in nodes]
        return np.asarray(np.einsum("kwabcp,ia,jb,lc->kwpijl", log, *back, optimize=True))


def weights(value: FloatArray, noise: FloatArray, moved: FloatArray, common: int) -> FloatArray:
    """What whitens the captures of an estimate that knows noise and tolerances, (W, 3S, 3S).

    Args:
        value: captures, (S, W, 3).
        noise: their covariance, (S, W, 3, 3).
        moved: their change by one standard deviation of every tolerance, (S, W, 3, Q + P).
        common: Q, the first ones, which all samples share.
    """
    samples, wavelengths = value.shape[:2]
    size = 3 * samples
    shared = moved[..., :common].transpose(1, 0, 2, 3).reshape(wavelengths, size, common)
    total = shared @ shared.transpose(0, 2, 1)
    for s in range(samples):
        part, own = slice(3 * s, 3 * s + 3), moved[s, ..., common:]
        total[:, part, part] += noise[s] + own @ own.transpose(0, 2, 1)
    flat = value.transpose(1, 0, 2).reshape(wavelengths, size)
    total[:, np.arange(size), np.arange(size)] += (ENGINE_ERROR * flat) ** 2 + 1e-18
    scale = np.sqrt(np.diagonal(total, axis1=1, axis2=2))
    lower = np.linalg.cholesky(total / (scale[:, :, None] * scale[:, None, :]))
    return np.asarray(np.linalg.inv(lower) / scale[:, None, :])


def apparent(
    table: Table, chosen: Sequence[int], seen: FloatArray, weight: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """How far the apparent material is from the average one, and slopes of the light there.

    By Levenberg and Marquardt, which ends at the border of the table.

    Args:
        table: of the material.
        chosen: which S of its thicknesses are there.
        seen: captures over the bands, (S, W, 3).
        weight: whitens them, (W, 3S, 3S).

    Returns:
        The shift of albedo, sigma_t [1/mm] and g (W, 3), and the slopes of the captures of all
        thicknesses by them, (K, W, 3, 3).
    """
    count = len(table.mean)
    flat = seen.transpose(1, 0, 2).reshape(count, -1)

    def at(place: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Slopes and what is left, whitened, and its square."""
        value, slope = table.light(place)
        left = flat - value[chosen].transpose(1, 0, 2).reshape(count, -1)
        turned = slope[chosen].transpose(1, 0, 2, 3).reshape(count, flat.shape[1], 3)
        left = np.einsum("wij,wj->wi", weight, left)
        return weight @ turned, left, (left**2).sum(axis=-1)

    place = coordinates(table.mean)
    damping = np.full(count, 1e-3)
    here = at(place)
    three = np.arange(3)
    for _ in range(STEPS):
        slope, left, square = here
        normal = slope.transpose(0, 2, 1) @ slope
        normal[:, three, three] *= 1.0 + damping[:, None]
        normal[:, three, three] += 1e-9
        step = np.linalg.solve(normal, np.einsum("wip,wi->wp", slope, left)[..., None])[..., 0]
        longest = np.abs(step).max(axis=-1, keepdims=True)
        step *= np.minimum(1.0, LONGEST / np.maximum(longest, 1e-30))
        moved = np.clip(place + step, table.low, table.high)
        there = at(moved)
        better = there[2] <= square
        damping = np.where(better, damping * 0.2, np.minimum(damping * 10.0, 1e6))
        done = np.abs(moved - place).max(axis=-1) < SETTLED
        place = np.where(better[:, None], moved, place)
        here = (
            np.where(better[:, None, None], there[0], slope),
            np.where(better[:, None], there[1], left),
            np.where(better, there[2], square),
        )
        if done.all():
            break
    found = material_at(place)
    turn = np.stack(
        [found[:, 0] * (1.0 - found[:, 0]), found[:, 1], 1.0 - found[:, 2] ** 2], axis=-1
    )
    return found - table.mean, table.light(place)[1] / turn[:, None]
