"""One homogeneous layer: its modes, and what two windows around it make of them.

With s = (down + up) and d = (down - up), weighted by the square root of (cosine times weight),
the azimuthal mean of the transfer equation is

    d' = -E s,    s' = -O d,    E, O = 1/mu - albedo * sum over even, odd orders,

both symmetric. O = X X^T and X^T E X = diag(k^2) give the modes X. A layer of thickness 2 h
answers with d = k tanh(k h) s to even and d = k coth(k h) s to odd illumination: the limit of
infinitely many doublings, in closed form. Sources: Stamnes, Tsay, Wiscombe and Jayaweera (1988),
Appl. Opt. 27, 2502, for the reduction to half size; Nakajima and Tanaka (1986), J. Quant.
Spectrosc. Radiat. Transfer 35, 13, for the symmetric form; van de Hulst (1980), chapter 4, for
adding.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax

from twin.adding_doubling.faces import Inside
from twin.adding_doubling.linear import cholesky, eigh_one_by_one, inverse, solve_positive

THINNEST = 1e-10
"""Added by callers to every optical thickness: in nothing at all trapped light has no answer."""
SERIES_BELOW = 1e-2


class Modes(NamedTuple):
    """Eigenmodes of a medium: squared exponents, shape (N,), and shapes X, shape (N, N)."""

    squared: Array
    shape: Array


def polynomials(streams: Inside, orders: int) -> Array:
    """Legendre polynomials at the streams, orthogonal in the discrete sum; shape (orders, N).

    Orders above 1 are made orthogonal to the first of their parity, so that energy and mean
    cosine are conserved to rounding with any number of streams.
    """
    mu, weight = streams.cosine, streams.root_weight**2

    # a loop and not a list: written out, the recurrence takes the compiler many seconds
    def step(carry: tuple[Array, Array], order: Array) -> tuple[Any, Array]:
        before, here = carry
        after = ((2.0 * order + 1.0) * mu * here - order * before) / (order + 1.0)
        return (here, after), after

    order = jnp.arange(1.0, orders - 1.0)
    higher: Array
    _, higher = lax.scan(step, (jnp.ones_like(mu), mu), order)
    first = [
        jnp.ones_like(mu) / jnp.sqrt(jnp.sum(weight)),
        mu / jnp.sqrt(3.0 * jnp.sum(weight * mu**2)),
    ]
    even, odd = higher[0::2], higher[1::2]
    even = even - (even @ (weight * first[0]))[:, None] * first[0]
    odd = odd - 3.0 * (odd @ (weight * first[1]))[:, None] * first[1]
    pairs = jnp.stack([even, odd], axis=1).reshape(orders - 2, mu.shape[0])
    return jnp.concatenate([jnp.stack(first), pairs])


@jax.custom_jvp
def modes(even: Array, odd: Array) -> tuple[Array, Array, Array]:
    """Squared exponents k^2 (N,), shapes X (N, N) and X^-1, from symmetric E and O (N, N)."""
    root = cholesky(odd)
    squared, vectors = eigh_one_by_one(root.T @ even @ root)
    shape = root @ vectors
    return squared, shape, shape.T @ inverse(odd)


@modes.defjvp
def _modes_jvp(primals: tuple[Array, Array], tangents: tuple[Any, Any]) -> tuple[Any, Any]:
    """First-order perturbation, without the derivatives of Cholesky factor and vectors.

    In the basis of the modes dE and dO are X^T dE X and X^-1 dO X^-T; X moves by X W with
    W + W^T = dO, and off the diagonal W_ij (k_i^2 - k_j^2) = -dE_ij - k_j^2 dO_ij.
    """
    squared, shape, inverse = modes(*primals)
    d_even = shape.T @ tangents[0] @ shape
    d_odd = inverse @ tangents[1] @ inverse.T
    apart = squared[:, None] - squared[None, :]
    same = apart == 0.0
    mixing = -(d_even + squared[None, :] * d_odd) / jnp.where(same, 1.0, apart)
    mixing = jnp.where(same, 0.5 * d_odd, mixing)
    d_squared = jnp.diagonal(d_even) + squared * jnp.diagonal(d_odd)
    return (squared, shape, inverse), (d_squared, shape @ mixing, -mixing @ inverse)


def balances(
    streams: Inside, polynomial: Array, albedo: Array, moments: Array
) -> tuple[Array, Array]:
    """E and O of a medium, (N, N) each.

    Args:
        streams: N streams.
        polynomial: Legendre polynomials at the streams, (orders, N).
        albedo: scalar.
        moments: chi_l of the phase function, (orders,).
    """
    orders = polynomial.shape[0]
    scaled = polynomial * (streams.root_weight / jnp.sqrt(streams.cosine))
    strength = (2.0 * jnp.arange(orders) + 1.0) * moments * albedo
    loss = jnp.diag(1.0 / streams.cosine)
    even = loss - (scaled[0::2].T * strength[0::2]) @ scaled[0::2]
    odd = loss - (scaled[1::2].T * strength[1::2]) @ scaled[1::2]
    return even, odd


def layer_modes(streams: Inside, polynomial: Array, albedo: Array, moments: Array) -> Modes:
    """Modes of a medium: arguments of `balances`."""
    squared, shape, _ = modes(*balances(streams, polynomial, albedo, moments))
    return Modes(squared, shape)


def even_response(squared: Array, half: Array) -> Array:
    """K tanh(k h), analytic in k^2."""
    y = squared * half**2
    small = y < SERIES_BELOW
    root = jnp.sqrt(jnp.where(small, 1.0, y))
    series = y * (1 + y * (-1 / 3 + y * (2 / 15 + y * (-17 / 315 + y * 62 / 2835))))
    return jnp.where(small, series, root * jnp.tanh(root)) / half


def odd_response(squared: Array, half: Array) -> Array:
    """K coth(k h), analytic in k^2."""
    y = squared * half**2
    small = y < SERIES_BELOW
    root = jnp.sqrt(jnp.where(small, 1.0, y))
    series = 1 + y * (1 / 3 + y * (-1 / 45 + y * (2 / 945 - y / 4725)))
    return jnp.where(small, series, root / jnp.tanh(root)) / half


def admittance(layer: Modes, reflectance: Array) -> Array:
    """What a window with this reflectance from inside (N,) is in the basis of the modes."""
    open_share = (1.0 - reflectance) / (1.0 + reflectance)
    return (layer.shape.T * open_share) @ layer.shape


def respond(
    layer: Modes,
    top: Array,
    bottom: Array | None,
    depth: Array,
    source_top: Array,
    source_bottom: Array,
) -> tuple[Array, Array]:
    """Sum of down and up at both faces of a layer between two windows.

    Args:
        layer: modes of the medium.
        top: admittance of the window above, (N, N).
        bottom: of the one below, or None for the same as above, which halves the size of the
            equations.
        depth: optical thickness, scalar, above 0.
        source_top: 2 t q / (1 + r) of R illuminations from above, (N, R);
        source_bottom: the same from below.

    Returns:
        s at the top and at the bottom, (N, R) each.
    """
    half = 0.5 * depth
    even, odd = even_response(layer.squared, half), odd_response(layer.squared, half)
    force_even = layer.shape.T @ (0.5 * (source_top + source_bottom))
    force_odd = layer.shape.T @ (0.5 * (source_top - source_bottom))
    if bottom is None:
        e = solve_positive(top + jnp.diag(even), force_even)
        o = solve_positive(top + jnp.diag(odd), force_odd)
    else:
        mean, step = 0.5 * (top + bottom), 0.5 * (top - bottom)
        matrix = jnp.block([[mean + jnp.diag(even), step], [step, mean + jnp.diag(odd)]])
        both = solve_positive(matrix, jnp.concatenate([force_even, force_odd]))
        count = layer.squared.shape[0]
        e, o = both[:count], both[count:]
    return layer.shape @ (e + o), layer.shape @ (e - o)
