"""Phase functions by their Legendre moments, and the delta-M scaling."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import Array, lax


class Scaled(NamedTuple):
    """A medium whose forward peak is counted as not scattered.

    Attributes:
        albedo: of the scaled medium; shrink: scaled over true optical thickness.
        moments: of the scaled phase function, shape (orders,).
        peak: share of scattering in the forward peak.
    """

    albedo: Array
    shrink: Array
    moments: Array
    peak: Array


def henyey_greenstein_moments(g: Array, count: int) -> Array:
    """Moments g**l for l = 0 to count - 1, shape (count,): Henyey and Greenstein 1941."""
    moments: Array
    _, moments = lax.scan(lambda power, _: (power * g, power), jnp.ones_like(g), length=count)
    return moments


def high_moments(g: Array, first: int, count: int) -> Array:
    """Moments |g|**l for l = first to first + count - 1, shape (count,), without a recurrence.

    They matter for strongly forward media only; below |g| = 1e-3 they are taken as constant.
    """
    order = jnp.arange(first, first + count)
    return jnp.exp(order * jnp.log(jnp.maximum(jnp.abs(g), 1e-3)))


def henyey_greenstein(g: Array, cosine: Array) -> Array:
    """Phase function normalised to a mean of 1 over the sphere, shape of the cosine."""
    return (1.0 - g**2) / (1.0 + g**2 - 2.0 * g * cosine) ** 1.5


MOST_FORWARD = 0.995
"""Largest |anisotropy factor| of the first of two lobes."""


class TwoTerm(NamedTuple):
    """A second Henyey-Greenstein lobe beside the first: see `twin.bench.Medium`."""

    share: Any
    g: Any

    def first(self, g: Array) -> Array:
        """Anisotropy factor of the first lobe when the mean cosine is g.

        A mean cosine that the shares do not allow is taken as the most forward one that they do.
        """
        found: Array = (g - self.share * self.g) / (1.0 - self.share)
        return jnp.clip(found, -MOST_FORWARD, MOST_FORWARD)

    def moments(self, g: Array, count: int) -> Array:
        """Moments for l = 0 to count - 1, shape (count,)."""
        return self.mixed(
            henyey_greenstein_moments(self.first(g), count),
            henyey_greenstein_moments(jnp.asarray(self.g), count),
        )

    def high_moments(self, g: Array, first: int, count: int) -> Array:
        """Moments for l = first to first + count - 1, as `high_moments`."""
        sign = 1.0 - 2.0 * (jnp.arange(first, first + count) % 2)
        own = high_moments(jnp.asarray(self.g), first, count)
        return self.mixed(
            high_moments(self.first(g), first, count), jnp.where(self.g < 0.0, sign, 1.0) * own
        )

    def phase(self, g: Array, cosine: Array) -> Array:
        """Phase function normalised to a mean of 1 over the sphere, shape of the cosine."""
        return self.mixed(
            henyey_greenstein(self.first(g), cosine), henyey_greenstein(self.g, cosine)
        )

    def mixed(self, first: Array, second: Array) -> Array:
        """Both lobes by their shares."""
        found: Array = (1.0 - self.share) * first + self.share * second
        return found


def from_moments(moments: Array, cosine: Array) -> Array:
    """Phase function from its Legendre moments, shape of the cosine.

    Args:
        moments: chi_l, shape (M,), chi_0 = 1.
        cosine: cosines of the scattering angle, shape (...).
    """

    def step(carry: tuple[Array, Array, Array], item: tuple[Array, Array]) -> tuple[Any, None]:
        before, here, total = carry
        order, moment = item
        total = total + (2.0 * order + 1.0) * moment * here
        after = ((2.0 * order + 1.0) * cosine * here - order * before) / (order + 1.0)
        return (here, after, total), None

    order = jnp.arange(moments.shape[0], dtype=moments.dtype)
    start = (jnp.zeros_like(cosine), jnp.ones_like(cosine), jnp.zeros_like(cosine))
    (_, _, total), _ = lax.scan(step, start, (order, moments))
    return total


def delta_m(albedo: Array, moments: Array) -> Scaled:
    """Delta-M scaling: Wiscombe (1977), "The delta-M method", eq. (5)-(12).

    Args:
        albedo: single-scattering albedo, scalar.
        moments: chi_0 to chi_orders, shape (orders + 1,); the last is the forward peak.
    """
    peak = moments[-1]
    shrink = 1.0 - albedo * peak
    return Scaled(
        albedo * (1.0 - peak) / shrink, shrink, (moments[:-1] - peak) / (1.0 - peak), peak
    )
