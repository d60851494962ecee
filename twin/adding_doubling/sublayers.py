"""Layers of unlike media inside a sample, with no face between them.

A layer answers the sum s of down and up at its faces with their difference d (see `layer`): into
it go d = A s_here + B s_there on either side, A and B symmetric. Where two layers meet, s is the
same in both and what leaves one enters the other, so that s there is eliminated. Source: van de
Hulst (1980), chapter 4 (adding of unlike layers), in the variables of `layer`.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from twin.adding_doubling.faces import Inside
from twin.adding_doubling.layer import balances, even_response, modes, odd_response
from twin.adding_doubling.linear import inverse, solve_positive
from twin.adding_doubling.phase import delta_m
from twin.errors import InputError


class Sublayers(NamedTuple):
    """L layers from the top down, arrays (L,) each.

    Attributes:
        share: of the sample's thickness.
        scattering, absorption: factors on the sample's coefficients.
    """

    share: Any
    scattering: Any
    absorption: Any


def sublayers_of(layers: Sequence[tuple[float, float, float]]) -> Sublayers:
    """Layers from rows of share, scattering and absorption.

    Raises:
        InputError: shares that are not above 0 or do not add up to 1, or factors below 0.
    """
    rows = np.asarray(layers, dtype=np.float64)
    if (
        rows.ndim != 2
        or rows.shape[1] != 3
        or not np.all(rows[:, 0] > 0.0)
        or not abs(rows[:, 0].sum() - 1.0) < 1e-9
        or not np.all(rows[:, 1:] >= 0.0)
    ):
        raise InputError(
            f"sublayers {rows.tolist()}",
            "rows of a share above 0, all together 1, and two factors of 0 or more",
            place="sublayers",
        )
    return Sublayers(*rows.T)


class Inner(NamedTuple):
    """The layers of a sample at one wavelength, for optical thickness 1 of the plain sample.

    Attributes:
        squared: squared exponents of their modes, L times (N,).
        inverse: inverses of the modes' shapes, L times (N, N).
        albedo: after delta-M scaling, (L,).
        depth: optical thickness after delta-M scaling, (L,).
        true_depth: optical thickness of all of them before it, scalar.
        true_albedo: share of it that is scattering, scalar.
    """

    squared: tuple[Array, ...]
    inverse: tuple[Array, ...]
    albedo: Array
    depth: Array
    true_depth: Array
    true_albedo: Array


class Sides(NamedTuple):
    """Difference d that goes into a layer for sums s at its faces, (N, N) each.

    Attributes:
        upper: d at the top for s at the top; lower: the same below.
        across: d at the top for s at the bottom; its transpose the other way round.
    """

    upper: Array
    lower: Array
    across: Array


def inner_layers(
    streams: Inside, polynomial: Array, albedo: Array, moments: Array, layers: Sublayers
) -> Inner:
    """Modes and optical thickness of the layers.

    Args:
        streams: N streams.
        polynomial: Legendre polynomials at the streams, (orders, N).
        albedo: of the plain sample, scalar.
        moments: chi_0 to chi_orders of the phase function, (orders + 1,).
        layers: what differs in each.
    """
    scattering = jnp.asarray(layers.scattering) * albedo
    total = scattering + jnp.asarray(layers.absorption) * (1.0 - albedo)
    own = scattering / jnp.where(total > 0.0, total, 1.0)
    squared, shapes, scaled_albedo, shrink = [], [], [], []
    for number in range(own.shape[0]):
        scaled = delta_m(own[number], moments)
        exponents, _, inverted = modes(
            *balances(streams, polynomial, scaled.albedo, scaled.moments)
        )
        squared.append(exponents)
        shapes.append(inverted)
        scaled_albedo.append(scaled.albedo)
        shrink.append(scaled.shrink)
    share = jnp.asarray(layers.share)
    true_depth = jnp.sum(share * total)
    return Inner(
        tuple(squared),
        tuple(shapes),
        jnp.stack(scaled_albedo),
        jnp.stack(shrink) * share * total,
        true_depth,
        jnp.sum(share * scattering) / true_depth,
    )


def _sides(squared: Array, inverted: Array, depth: Array) -> Sides:
    half = 0.5 * depth
    even, odd = even_response(squared, half), odd_response(squared, half)
    same = inverted.T @ (0.5 * (even + odd)[:, None] * inverted)
    across = inverted.T @ (0.5 * (even - odd)[:, None] * inverted)
    return Sides(same, same, across)


def _joined(first: Sides, second: Sides) -> Sides:
    """Two layers that touch as one."""
    between = inverse(first.lower + second.upper)
    down, up = between @ first.across.T, between @ second.across
    return Sides(
        first.upper - first.across @ down,
        second.lower - second.across.T @ up,
        -first.across @ up,
    )


def respond_inside(
    inner: Inner,
    top: Array,
    bottom: Array,
    depths: Array,
    source_top: Array,
    source_bottom: Array,
) -> tuple[Array, Array]:
    """Sum of down and up at both faces of layers between two windows, (N, R) each.

    Args:
        inner: the layers.
        top: reflectance from inside of the window above, (N,).
        bottom: of the one below, (N,).
        depths: optical thicknesses of the layers, (L,), above 0.
        source_top: as of `layer.respond`, (N, R).
        source_bottom: the same from below.
    """
    whole = reduce(
        _joined,
        [
            _sides(squared, inverted, depths[number])
            for number, (squared, inverted) in enumerate(
                zip(inner.squared, inner.inverse, strict=True)
            )
        ],
    )
    upper, lower = (
        own + jnp.diag((1.0 - window) / (1.0 + window))
        for own, window in ((whole.upper, top), (whole.lower, bottom))
    )
    matrix = jnp.block([[upper, whole.across], [whole.across.T, lower]])
    both = solve_positive(matrix, jnp.concatenate([source_top, source_bottom]))
    count = top.shape[0]
    return both[:count], both[count:]
