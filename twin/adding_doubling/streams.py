"""Directions in which radiance is followed, and how sums over them become integrals.

Streams are placed by their direction in air: Gauss-Radau nodes over the cosine in air, the
normal among them, plus Gauss nodes for the light that total reflection keeps inside. Fresnel
reflectances and everything that follows from them are smooth in the cosine in air, while the
cosine inside has a root singularity at the critical angle; so a dozen streams give six digits.
Everything here is plain numpy and depends on no wavelength.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from twin.errors import InputError
from twin.spectra import FloatArray

PADDING_WEIGHT = 1e-8
"""Weight of a stream that is only looked at: lost in every sum, yet 1e8 above rounding."""


@dataclass(frozen=True, eq=False)
class Streams:
    """Quadrature of one hemisphere; made once per choice, and compiled programs are keyed by it.

    Attributes:
        air_cosine: cosines in air of the streams that leave the medium, shape (A,); one of
            them is 1.
        air_weight: weights over [0, 1], shape (A,), sum 1.
        trapped_cosine: nodes over [0, 1] in units of the critical cosine, shape (T,).
        trapped_weight: their weights, shape (T,), sum 1.
        orders: Legendre orders kept before delta-M truncation, even.
        normal: index of the stream along the normal among the air streams.
    """

    air_cosine: FloatArray
    air_weight: FloatArray
    trapped_cosine: FloatArray
    trapped_weight: FloatArray
    orders: int
    normal: int

    @property
    def air(self) -> int:
        """Number of streams that leave the medium."""
        return len(self.air_cosine)

    @property
    def trapped(self) -> int:
        """Number of streams that total reflection keeps inside."""
        return len(self.trapped_cosine)


def gauss(count: int) -> tuple[FloatArray, FloatArray]:
    """Gauss-Legendre nodes and weights over [0, 1], shape (count,) each."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return (nodes + 1.0) / 2.0, weights / 2.0


def radau(count: int) -> tuple[FloatArray, FloatArray]:
    """Gauss-Radau nodes and weights over [0, 1] with the node 1, shape (count,) each.

    Source: Golub (1973), "Some modified matrix eigenvalue problems", section 7.
    """
    order = np.arange(1, count)
    side = order / np.sqrt(4.0 * order**2 - 1.0)
    jacobi = np.diag(side, 1) + np.diag(side, -1)
    unit = np.zeros(count - 1)
    unit[-1] = side[-1] ** 2
    correction = np.linalg.solve(jacobi[:-1, :-1] - np.eye(count - 1), unit)
    jacobi[-1, -1] = 1.0 + correction[-1]
    nodes, vectors = np.linalg.eigh(jacobi)
    nodes[-1] = 1.0
    return (nodes + 1.0) / 2.0, vectors[0] ** 2


@lru_cache(maxsize=64)
def make_streams(
    air: int = 12,
    trapped: int = 8,
    *,
    orders: int | None = None,
    looked_at: tuple[float, ...] = (),
) -> Streams:
    """Streams of one hemisphere.

    Args:
        air: streams that leave the medium, at least 4.
        trapped: streams inside the critical angle; 0 for media matched to air.
        orders: Legendre orders kept, even; by default as many as streams.
        looked_at: further cosines in air, above 0 to 1, at which radiance is asked for; they
            carry no weight.

    Raises:
        InputError: too few streams, odd orders, or a cosine outside (0, 1].
    """
    kept = orders if orders is not None else 2 * ((air + trapped + 1) // 2)
    if air < 4 or trapped < 0 or kept < 2 or kept % 2:
        raise InputError(
            f"{air} air streams, {trapped} trapped streams and {kept} orders",
            "at least 4, at least 0, and an even number above 0",
            place="streams",
        )
    if any(not 0.0 < cosine <= 1.0 for cosine in looked_at):
        raise InputError(f"cosines {looked_at}", "cosines above 0, to 1", place="looked_at")
    cosine, weight = radau(air)
    for extra in sorted(set(looked_at)):
        if np.min(np.abs(cosine - extra)) > 1e-9:
            cosine, weight = np.append(cosine, extra), np.append(weight, PADDING_WEIGHT)
    inside = gauss(trapped) if trapped else (np.empty(0), np.empty(0))
    normal = int(np.argmax(cosine))
    return Streams(cosine, weight, *inside, orders=kept, normal=normal)


def interpolation(nodes: FloatArray, at: FloatArray) -> FloatArray:
    """Lagrange interpolation weights, shape (at, nodes).

    Source: Berrut and Trefethen (2004), "Barycentric Lagrange interpolation", eq. (4.2).
    """
    apart = nodes[:, None] - nodes[None, :]
    np.fill_diagonal(apart, 1.0)
    barycentric = 1.0 / np.prod(apart, axis=1)
    distance = np.asarray(at, dtype=np.float64)[:, None] - nodes[None, :]
    exact = np.abs(distance) < 1e-13
    weights = barycentric / np.where(exact, 1.0, distance)
    weights /= weights.sum(axis=1, keepdims=True)
    hit = exact.any(axis=1)
    weights[hit] = exact[hit]
    return np.asarray(weights)


def condensed(cosine: FloatArray, weight: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Gauss rule of `count` nodes for a measure given by many points, normalised to 1.

    Exact for polynomials up to degree 2 count - 1. Source: Golub and Welsch (1969),
    "Calculation of Gauss quadrature rules", with the Lanczos process in full orthogonalisation.
    """
    share = weight / weight.sum()
    basis = [np.sqrt(share)]
    diagonal, side = [], []
    for _ in range(count):
        vector = cosine * basis[-1]
        diagonal.append(float(basis[-1] @ vector))
        for known in basis:
            vector = vector - (known @ vector) * known
        length = float(np.linalg.norm(vector))
        if length < 1e-12:
            break
        side.append(length)
        basis.append(vector / length)
    size = len(diagonal)
    jacobi = np.diag(diagonal) + np.diag(side[: size - 1], 1) + np.diag(side[: size - 1], -1)
    nodes, vectors = np.linalg.eigh(jacobi)
    return nodes, vectors[0] ** 2


def cone_average(streams: Streams, cosine: float) -> FloatArray:
    """Weights over air streams of the mean over a cone around the normal, shape (A,).

    Directions are weighted with the projected solid angle, as a detector collects them.
    """
    nodes, weights = gauss(max(8, streams.air))
    mu = cosine + (1.0 - cosine) * nodes
    share = weights * mu
    return np.asarray((share / share.sum()) @ interpolation(streams.air_cosine, mu))


def legendre_cone(cosine: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Integrals of (2 l + 1) / 2 P_l over the cone, and their slope, shape (..., count) each.

    Args:
        cosine: cosine of the cone's half-angle, shape (...).
        count: orders 0 to count - 1.

    Returns:
        c_l = (P_{l-1} - P_{l+1}) / 2 with P_{-1} = 1, and d c_l / d cosine = -(2 l + 1) / 2 P_l.
    """
    x = np.asarray(cosine, dtype=np.float64)
    values = [np.ones_like(x), x]
    for order in range(1, count):
        values.append(((2 * order + 1) * x * values[-1] - order * values[-2]) / (order + 1))
    polynomial = np.stack(values, axis=-1)
    below = np.concatenate([np.ones_like(x)[..., None], polynomial[..., : count - 1]], axis=-1)
    order_of = np.arange(count)
    return (
        (below - polynomial[..., 1 : count + 1]) / 2.0,
        -(2 * order_of + 1) / 2.0 * polynomial[..., :count],
    )


FORWARD_G, PEAKED_G = 0.65, 0.8
"""Anisotropies above which more streams are taken."""


def streams_for(g: float, matched: bool) -> Streams:
    """Quadrature that is right to about 1e-4 of a capture for one anisotropy factor.

    Args:
        g: greatest |g|.
        matched: the sample has the index of air, so that no stream is trapped.
    """
    size = abs(g)
    if size <= FORWARD_G:
        return make_streams(18, 0) if matched else make_streams(12, 8)
    if size <= PEAKED_G:
        return make_streams(30, 0) if matched else make_streams(20, 16)
    return make_streams(40, 0) if matched else make_streams(24, 20)
