"""Smooth faces and clear or absorbing covers, seen by every stream, in JAX."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from twin.adding_doubling.streams import Streams

MATCHED = 1e-9
"""An index closer to 1 than this has no critical angle."""


class Inside(NamedTuple):
    """The streams inside the medium, trapped ones first, shape (N,) each.

    Attributes:
        cosine: cosines in the medium.
        root_weight: square roots of the weights over [0, 1]; 0 where there is no such stream.
        air_cosine: cosines in air; 0 for trapped streams.
    """

    cosine: Array
    root_weight: Array
    air_cosine: Array


class Window(NamedTuple):
    """Everything between the medium and the air on one side, shape (M,) each."""

    inside: Array
    """Share of light from inside that returns."""
    through: Array
    """Share that gets through, the same both ways; 0 for trapped streams."""
    outside: Array
    """Share of light from the air that returns."""


def cosine_inside(n: Array, air_cosine: Array) -> Array:
    """Snell: the cosine in a medium of index n for a cosine in air, both of shape (M,)."""
    return jnp.sqrt(1.0 - (1.0 - air_cosine**2) / n**2)


def inside(streams: Streams, n: Array) -> Inside:
    """The streams in a medium of index n, a scalar of at least 1."""
    air = jnp.asarray(streams.air_cosine)
    mu = cosine_inside(n, air)
    # mu dmu in the medium is mu dmu in air over n squared
    root = jnp.sqrt(jnp.asarray(streams.air_weight) * air / mu) / n
    if not streams.trapped:
        return Inside(mu, root, air)
    exists = n > 1.0 + MATCHED
    critical = jnp.sqrt(jnp.where(exists, 1.0 - 1.0 / jnp.where(exists, n, 2.0) ** 2, 0.25))
    kept = critical * jnp.asarray(streams.trapped_cosine)
    root_kept = jnp.where(exists, jnp.sqrt(critical * jnp.asarray(streams.trapped_weight)), 0.0)
    return Inside(
        jnp.concatenate([kept, mu]),
        jnp.concatenate([root_kept, root]),
        jnp.concatenate([jnp.zeros(streams.trapped), air]),
    )


def _fresnel(n1: Array, n2: Array, mu1: Array, mu2: Array) -> Array:
    """Unpolarised reflectance of a face from both cosines: Born and Wolf 1999, section 1.5.2."""
    s = (n1 * mu1 - n2 * mu2) / (n1 * mu1 + n2 * mu2)
    p = (n1 * mu2 - n2 * mu1) / (n1 * mu2 + n2 * mu1)
    return 0.5 * (s * s + p * p)


def window(
    n: Array, cover_n: Array, cover_depth: Array, cosine: Array, air_cosine: Array
) -> Window:
    """Covers and faces between the medium and the air, all reflections between them summed.

    Args:
        n: index of the medium, scalar.
        cover_n: indices of the covers from the air to the medium, shape (C,).
        cover_depth: their optical depths along the normal, shape (C,); what they take away is
            absorbed.
        cosine: cosines in the medium, shape (M,).
        air_cosine: cosines in air, shape (M,); 0 for trapped streams.

    Source: Stokes (1862), Proc. R. Soc. 11, 545-556.
    """
    leaves = air_cosine > 0.0
    sine_squared = n**2 * (1.0 - cosine**2)
    one = jnp.ones_like(cosine)
    n_before, mu_before, real_before = jnp.ones(()), jnp.where(leaves, air_cosine, 0.5), leaves
    whole = Window(jnp.zeros_like(cosine), one, jnp.zeros_like(cosine))
    covers = cover_n.shape[0]
    for number in range(covers + 1):
        last = number == covers
        n_here = n if last else cover_n[number]
        squared = 1.0 - sine_squared / n_here**2
        real = jnp.ones_like(leaves) if last else squared > 0.0
        mu = cosine if last else jnp.sqrt(jnp.where(real, squared, 1.0))
        r = jnp.where(real & real_before, _fresnel(n_before, n_here, mu_before, mu), 1.0)
        trapped_between = 1.0 - whole.inside * r
        series = 1.0 / jnp.where(trapped_between > 0.0, trapped_between, 1.0)
        whole = Window(
            r + (1.0 - r) ** 2 * whole.inside * series,
            whole.through * (1.0 - r) * series,
            whole.outside + whole.through**2 * r * series,
        )
        if not last:
            fade = jnp.where(real, jnp.exp(-cover_depth[number] / mu), 0.0)
            whole = Window(whole.inside * fade**2, whole.through * fade, whole.outside)
        n_before, mu_before, real_before = n_here, mu, real
    return whole


def specular(top: Window, bottom: Window, cosine: Array, depth: Array) -> tuple[Array, Array]:
    """Unscattered reflectance (seen from above) and transmittance of the whole stack.

    Args:
        top: covers and faces above, shape (M,) each.
        bottom: those below.
        cosine: cosines in the medium, shape (M,).
        depth: optical thickness of the medium, scalar.
    """
    fade = jnp.exp(-depth / cosine)
    series = 1.0 / (1.0 - top.inside * bottom.inside * fade**2)
    reflected = top.outside + top.through**2 * bottom.inside * fade**2 * series
    return reflected, top.through * bottom.through * fade * series
