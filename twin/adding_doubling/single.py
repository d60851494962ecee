"""Light that is scattered exactly once between two reflecting windows, in closed form."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array


class Ray(NamedTuple):
    """Directions with what the windows do to them; arrays that broadcast together.

    Attributes:
        cosine: in the medium; through: share that passes the window on the side where the light
        enters or leaves; near: reflectance from inside of that window; far: of the other one.
    """

    cosine: Array
    through: Array
    near: Array
    far: Array


def _attenuated(rate: Array, depth: Array) -> Array:
    """Integral of exp(-rate t) over 0 to depth."""
    z = rate * depth
    small = z < 1e-4
    value = -jnp.expm1(-jnp.where(small, 1.0, z)) / jnp.where(small, 1.0, z)
    return depth * jnp.where(small, 1.0 - z / 2.0 + z**2 / 6.0, value)


def _forward(one: Array, other: Array, depth: Array) -> Array:
    """Integral of exp(-t / one - (depth - t) / other) over 0 to depth."""
    slow = jnp.maximum(one, other)
    return jnp.exp(-depth / slow) * _attenuated(jnp.abs(1.0 / one - 1.0 / other), depth)


def reflected_once(
    light: Ray, view: Ray, n: Array, albedo: Array, depth: Array, back: Array, ahead: Array
) -> Array:
    """Radiance factor of light scattered once that leaves on the side where it came in.

    Args:
        light: incident directions.
        view: directions of exit on the same side.
        n: refractive index of the medium.
        albedo: its single-scattering albedo.
        depth: its optical thickness.
        back: phase function for a turn from downwards to upwards, mean over azimuth.
        ahead: the same without a turn.
    """
    fade_l, fade_v = jnp.exp(-depth / light.cosine), jnp.exp(-depth / view.cosine)
    turned = _attenuated(1.0 / light.cosine + 1.0 / view.cosine, depth)
    straight = _forward(light.cosine, view.cosine, depth)
    sum_back = turned * (1.0 + light.far * view.far * fade_l * fade_v)
    sum_ahead = straight * (light.far * fade_l + view.far * fade_v)
    return _strength(light, view, n, albedo, fade_l, fade_v) * (back * sum_back + ahead * sum_ahead)


def reflected_once_inside(
    light: Ray, view: Ray, n: Array, albedo: Array, depth: Array, back: Array, ahead: Array
) -> Array:
    """`reflected_once` of L layers of unlike media; their albedo and depth, (L,), top down."""
    whole = jnp.sum(depth)
    fade_l, fade_v = jnp.exp(-whole / light.cosine), jnp.exp(-whole / view.cosine)
    rate = 1.0 / light.cosine + 1.0 / view.cosine
    total, above = jnp.zeros(()), jnp.zeros(())
    for number in range(depth.shape[0]):
        own = depth[number]
        below = whole - above - own
        turned = _attenuated(rate, own)
        turned_above = turned * jnp.exp(-rate * above)
        # both ways by the far window: down to it and up again
        turned_below = turned * jnp.exp(-rate * (whole + below)) * light.far * view.far
        straight = _forward(light.cosine, view.cosine, own)
        down_then_up = jnp.exp(-above / light.cosine - below / view.cosine) * view.far * fade_v
        up_by_far = jnp.exp(-below / light.cosine - above / view.cosine) * light.far * fade_l
        total = total + albedo[number] * (
            back * (turned_above + turned_below) + ahead * straight * (down_then_up + up_by_far)
        )
        above = above + own
    return _strength(light, view, n, jnp.ones(()), fade_l, fade_v) * total


def transmitted_once(
    light: Ray, view: Ray, n: Array, albedo: Array, depth: Array, back: Array, ahead: Array
) -> Array:
    """The same for light that leaves on the other side; `near` of the view is that side's."""
    fade_l, fade_v = jnp.exp(-depth / light.cosine), jnp.exp(-depth / view.cosine)
    turned = _attenuated(1.0 / light.cosine + 1.0 / view.cosine, depth)
    straight = _forward(light.cosine, view.cosine, depth)
    sum_back = turned * (light.far * fade_l + view.far * fade_v)
    sum_ahead = straight * (1.0 + light.far * view.far * fade_l * fade_v)
    return _strength(light, view, n, albedo, fade_l, fade_v) * (back * sum_back + ahead * sum_ahead)


def _strength(
    light: Ray, view: Ray, n: Array, albedo: Array, fade_l: Array, fade_v: Array
) -> Array:
    """Albedo over 4 mu mu0 n^2, times both passages with all reflections between the windows."""
    entered = light.through / (1.0 - light.near * light.far * fade_l**2)
    left = view.through / (1.0 - view.near * view.far * fade_v**2)
    return albedo * entered * left / (4.0 * n**2 * light.cosine * view.cosine)
