"""Kubelka and Munk's two fluxes, both ways, with the faces around the layer.

Sources: Kubelka & Munk (1931), "Ein Beitrag zur Optik der Farbanstriche", Z. tech. Phys. 12,
593-601; Kubelka (1948), J. Opt. Soc. Am. 38, 448-457; Saunderson (1942), J. Opt. Soc. Am. 32,
727-736; van Gemert & Star (1987), Lasers Life Sci. 1, 287-298.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from estimators.protocol import BenchModel
from twin.optics import stack
from twin.spectra import FloatArray


class Fluxes(NamedTuple):
    """Coefficients of Kubelka and Munk times the thickness, shape (...)."""

    absorbed: FloatArray
    """K X."""
    scattered: FloatArray
    """S X."""


class Faces(NamedTuple):
    """What both faces do with light, covers included, shape (...)."""

    enter: FloatArray
    """Share of the panels' light that enters: 1 - k1."""
    leave: FloatArray
    """Radiance factor at the detector of diffuse light that reaches the upper face."""
    above_inside: FloatArray
    """Reflectance of the upper face for diffuse light from inside: k2."""
    below_outside: FloatArray
    below_inside: FloatArray


def layer_reflectance(fluxes: Fluxes, background: ArrayLike) -> FloatArray:
    """Reflectance of a layer without faces over a background, shape (...).

    Kubelka (1948), eq. (21), written with exponentials: R = (1 - Rg (a - b coth bSX)) /
    (a - Rg + b coth bSX), a = (K + S) / S, b = sqrt(a^2 - 1), times S on both sides, so that it
    holds without scattering too.
    """
    k, s = fluxes
    rate = np.sqrt(k * (k + 2.0 * s))
    fade = np.exp(-2.0 * rate)
    thin = rate < 1e-9
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = np.where(thin, 1.0, rate * (1.0 + fade) / np.where(thin, 1.0, 1.0 - fade))
    ground = np.asarray(background, dtype=np.float64)
    return np.asarray((s - ground * (k + s - slope)) / (k + s - ground * s + slope))


def layer_fluxes(reflectance: FloatArray, background: FloatArray) -> Fluxes:
    """K X and S X of a layer without faces from its reflectances over two backgrounds.

    With c = b coth(bSX), Kubelka's (1948) reflectance is linear in a and c, so two backgrounds
    give both: a (R + Rg) + c (R - Rg) = 1 + R Rg. Infinite where no light of the backgrounds
    comes back. Below zero where noise says so: nothing is clipped.

    Args:
        reflectance: over both backgrounds, shape (2, ...).
        background: reflectances of the backgrounds, shape (2, ...).
    """
    (r1, r2), (g1, g2) = reflectance, background
    for_a = (1.0 + r1 * g1) * (r2 - g2) - (1.0 + r2 * g2) * (r1 - g1)
    for_c = (r1 + g1) * (1.0 + r2 * g2) - (r2 + g2) * (1.0 + r1 * g1)
    determinant = 2.0 * (g1 * r2 - r1 * g2)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio, inverse = for_c / for_a, determinant / for_a  # c / a and 1 / a = S / (K + S)
        square = 1.0 - inverse**2
        root = np.sqrt(np.abs(square))
        argument = root / ratio
        # K below zero turns the hyperbolic functions into circular ones.
        angle = np.where(square >= 0.0, np.arctanh(argument), np.arctan(argument))
        together = np.where(root > 1e-7, angle / np.where(root > 0, root, 1.0), 1.0 / ratio)
        together = np.where((square >= 0.0) & (argument >= 1.0), np.inf, together)
        return Fluxes(together * (1.0 - inverse), together * inverse)


def faces_of(model: BenchModel, sample: int) -> Faces:
    """Faces and clear covers of a sample, shape (W,) each.

    Light enters from the panels' polar angle and leaves along the normal, through 1 / n^2. The
    diffuse reflectance from outside is the mean over the half-space; that from inside follows
    from reciprocity, 1 - k2 = (1 - outside) / n^2 (Judd 1942, J. Res. NBS 29, 329-332).
    """
    node, weight = np.polynomial.legendre.leggauss(32)
    cosine, weight = 0.5 * (node + 1.0), 0.5 * weight
    n = model.n[sample]
    polar = 45.0 if model.bench is None else model.bench.panels[0].polar_deg

    def reflectance(covers: Sequence[FloatArray], mu: ArrayLike) -> FloatArray:
        indices = [np.asarray(c)[:, None] for c in covers]
        return stack(indices, [0.0] * len(covers), n_below=n[:, None], cosine=mu).reflectance_above

    def diffuse(covers: Sequence[FloatArray]) -> FloatArray:
        return np.asarray((2.0 * weight * cosine * reflectance(covers, cosine)).sum(axis=1))

    below = tuple(reversed(model.covers_below))
    outside = diffuse(below)
    return Faces(
        1.0 - reflectance(model.covers_above, [np.cos(np.radians(polar))])[:, 0],
        (1.0 - reflectance(model.covers_above, [1.0])[:, 0]) / n**2,
        1.0 - (1.0 - diffuse(model.covers_above)) / n**2,
        outside,
        1.0 - (1.0 - outside) / n**2,
    )


def coefficients(parameters: FloatArray) -> Fluxes:
    """K and S [1/mm] of materials (W, 3) by van Gemert and Star (1987)."""
    albedo, sigma_t, g = parameters.T
    sigma_a = (1.0 - albedo) * sigma_t
    return Fluxes(2.0 * sigma_a, 0.75 * albedo * sigma_t * (1.0 - g) - 0.25 * sigma_a)
