"""Closed forms of plane-parallel, incoherent optics: Snell, Fresnel and scalar adding.

Light between the smooth faces of a stack of clear or absorbing layers is summed as energy,
without interference and unpolarised at every face, which is how both engines treat it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from twin.spectra import FloatArray


class Slab(NamedTuple):
    """Reflectances and transmittances of a stack for light at one angle, shape (...)."""

    reflectance_above: FloatArray
    """Share of light from above that returns upwards."""
    transmittance_down: FloatArray
    reflectance_below: FloatArray
    """Share of light from below that returns downwards."""
    transmittance_up: FloatArray


def snell_cosine(n_from: ArrayLike, n_to: ArrayLike, cosine: ArrayLike) -> FloatArray:
    """Cosine of the refracted direction; 0 at and beyond total internal reflection.

    Args:
        n_from: refractive index of the side that the light comes from, shape (...).
        n_to: refractive index of the other side, shape (...).
        cosine: cosine of the angle of incidence, 0 to 1, shape (...).
    """
    n1, n2, mu = (np.asarray(value, dtype=np.float64) for value in (n_from, n_to, cosine))
    sine_squared = (n1 / n2) ** 2 * (1.0 - mu**2)
    return np.asarray(np.sqrt(np.maximum(1.0 - sine_squared, 0.0)))


def fresnel_unpolarised(n_from: ArrayLike, n_to: ArrayLike, cosine: ArrayLike) -> FloatArray:
    """Fresnel reflectance of a smooth face for unpolarised light, shape (...).

    Source: Born and Wolf, Principles of Optics (1999), section 1.5.2, eq. (20)-(21); the mean
    of both polarisations. 1 beyond the critical angle and at grazing incidence.
    """
    n1, n2, mu = np.broadcast_arrays(
        *(np.asarray(value, dtype=np.float64) for value in (n_from, n_to, cosine))
    )
    refracted = snell_cosine(n1, n2, mu)
    # A matched face does not exist, even at grazing incidence where the ratio is 0 / 0.
    matched = n1 == n2
    with np.errstate(invalid="ignore", divide="ignore"):
        perpendicular = (n1 * mu - n2 * refracted) / (n1 * mu + n2 * refracted)
        parallel = (n2 * mu - n1 * refracted) / (n2 * mu + n1 * refracted)
        value = 0.5 * (perpendicular**2 + parallel**2)
    value = np.where((refracted <= 0.0) | (mu <= 0.0), 1.0, value)
    return np.asarray(np.where(matched, 0.0, value))


def add(upper: Slab, lower: Slab) -> Slab:
    """Two stacks put together, all internal reflections summed.

    Source: Stokes (1862), "On the intensity of the light reflected from or transmitted
    through a pile of plates", Proc. R. Soc. 11, 545-556: the geometric series.
    """
    trapped = 1.0 - upper.reflectance_below * lower.reflectance_above
    return Slab(
        upper.reflectance_above
        + upper.transmittance_down * lower.reflectance_above * upper.transmittance_up / trapped,
        upper.transmittance_down * lower.transmittance_down / trapped,
        lower.reflectance_below
        + lower.transmittance_up * upper.reflectance_below * lower.transmittance_down / trapped,
        lower.transmittance_up * upper.transmittance_up / trapped,
    )


def face(n_above: ArrayLike, n_below: ArrayLike, cosine_above: ArrayLike) -> Slab:
    """One smooth face; the angle is given on its upper side."""
    reflectance = fresnel_unpolarised(n_above, n_below, cosine_above)
    return Slab(reflectance, 1.0 - reflectance, reflectance, 1.0 - reflectance)


def attenuating(transmittance: ArrayLike) -> Slab:
    """A layer without faces that lets a share of the light through."""
    share = np.asarray(transmittance, dtype=np.float64)
    nothing = np.zeros_like(share)
    return Slab(nothing, share, nothing, share)


def stack(
    n: Sequence[ArrayLike],
    optical_depth: Sequence[ArrayLike],
    *,
    n_above: ArrayLike = 1.0,
    n_below: ArrayLike = 1.0,
    cosine: ArrayLike = 1.0,
) -> Slab:
    """A stack of clear or absorbing layers between two half-spaces, faces included.

    Args:
        n: refractive index of every layer, top to bottom, each of shape (...).
        optical_depth: extinction coefficient times thickness of every layer, along the
            normal, each of shape (...).
        n_above: refractive index above the stack.
        n_below: refractive index below the stack.
        cosine: cosine of the angle in the half-space above, 0 to 1.

    Raises:
        ValueError: unequal numbers of indices and optical depths.
    """
    if len(n) != len(optical_depth):
        raise ValueError(
            f"found {len(n)} refractive indices and {len(optical_depth)} optical depths;"
            " expected as many of each"
        )
    indices = [np.asarray(value, dtype=np.float64) for value in (n_above, *n, n_below)]
    mu = np.asarray(cosine, dtype=np.float64)
    whole: Slab | None = None
    for number in range(len(indices) - 1):
        part = face(indices[number], indices[number + 1], mu)
        whole = part if whole is None else add(whole, part)
        mu = snell_cosine(indices[number], indices[number + 1], mu)
        if number < len(n):
            depth = np.asarray(optical_depth[number], dtype=np.float64)
            with np.errstate(divide="ignore", invalid="ignore"):
                share = np.where(mu > 0.0, np.exp(-depth / mu), 0.0)
            whole = add(whole, attenuating(share))
    if whole is None:  # two half-spaces always share one face
        raise ValueError("found no face; expected two half-spaces")
    return whole


class Windows(NamedTuple):
    """What surrounds an attenuating layer: T = q t / (1 - p t^2), t = its transmittance."""

    p: FloatArray
    """Product of the reflectances of both sides, seen from inside the layer."""
    q: FloatArray
    """Product of the transmittances of both sides."""


def windows(
    n: ArrayLike, covers_above: Sequence[ArrayLike] = (), covers_below: Sequence[ArrayLike] = ()
) -> Windows:
    """Clear covers in air around a layer of index n, at normal incidence, shape (...).

    Args:
        n: refractive index of the layer.
        covers_above: refractive indices of the covers above, top to bottom.
        covers_below: refractive indices of the covers below, top to bottom.
    """
    above = stack(covers_above, [0.0] * len(covers_above), n_below=n)
    below = stack(covers_below, [0.0] * len(covers_below), n_above=n)
    return Windows(
        np.asarray(above.reflectance_below * below.reflectance_above),
        np.asarray(above.transmittance_up * below.transmittance_up),
    )


def layer_transmittance(total: ArrayLike, around: Windows) -> FloatArray:
    """Transmittance t of the layer alone from that of the whole stack, shape (...).

    The inverse of T = q t / (1 - p t^2): the positive root of p T t^2 + q t - T = 0. Above 1
    where the stack transmits more than a clear layer could; negative where T is.
    """
    measured = np.asarray(total, dtype=np.float64)
    root = np.sqrt(around.q**2 + 4.0 * around.p * measured**2)
    return np.asarray(2.0 * measured / (around.q + root))


def stack_transmittance(layer: ArrayLike, around: Windows) -> FloatArray:
    """Transmittance of the whole stack from that of the layer alone, shape (...)."""
    t = np.asarray(layer, dtype=np.float64)
    return np.asarray(around.q * t / (1.0 - around.p * t**2))


def sigma_t_from_transmittance(
    total: ArrayLike, thickness_mm: ArrayLike, around: Windows
) -> tuple[FloatArray, FloatArray]:
    """Extinction coefficient from the unscattered transmittance of the whole stack.

    Args:
        total: transmittance at normal incidence, shape (...).
        thickness_mm: thickness of the layer [mm], shape (...).
        around: covers and faces around the layer.

    Returns:
        sigma_t [1/mm], NaN where the transmittance is not positive, and its derivative with
        respect to the transmittance [1/mm], both of shape (...).
    """
    t = layer_transmittance(total, around)
    thickness = np.asarray(thickness_mm, dtype=np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        sigma_t = np.where(t > 0.0, -np.log(t), np.nan) / thickness
        slope = around.q * (1.0 + around.p * t**2) / (1.0 - around.p * t**2) ** 2
        derivative = -1.0 / (t * slope * thickness)
    return np.asarray(sigma_t), np.asarray(np.where(t > 0.0, derivative, np.nan))
