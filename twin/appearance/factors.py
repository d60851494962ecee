"""By what factors the finite bench differs from the plane-parallel one, ready for JAX.

A map knows both at every node. The ratios of their parts are smooth and mostly near 1; cubic
convolution (Keys 1981) between the nodes carries them to any material, with continuous slopes,
so that an engine which costs milliseconds answers for the finite bench.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from twin.spectra import FloatArray

if TYPE_CHECKING:
    from collections.abc import Sequence

    from twin.adding_doubling.terms import Parts
    from twin.appearance.table import AppearanceMap

DIRECT, ONCE_BLACK, ONCE_WHITE, OVER_WHITE, SCATTERED = range(5)
TAIL_RHO = 0.985
"""Reflectance at which all bounces together are matched."""
FARTHEST = 3.0
"""Greatest |ln| of a factor: beyond, there is no light to correct."""


def log_factors(
    plane: FloatArray, direct: FloatArray, once: tuple[FloatArray, FloatArray],
    over_white: FloatArray, scattered: FloatArray,
) -> FloatArray:  # fmt: skip
    """Logarithms of the factors, shape (5, ...).

    Args:
        plane: direct, once, returned and scattered of the unbounded bench, shape (4, ...).
        direct: of the finite bench, (...).
        once: first bounce at a perfect background of the black's and of the white's outline.
        over_white: all bounces at the white's outline for the reflectance `TAIL_RHO`, over it.
        scattered: scattered into the detector's cone.
    """
    flat, first, returned, into = plane
    unbounded = (flat, first, first, first / (1.0 - TAIL_RHO * returned), into)
    finite = (direct, *once, over_white, scattered)
    rows = []
    for own, other in zip(finite, unbounded, strict=True):
        known = (own > 0.0) & (other > 1e-12)
        ratio = np.where(known, own, 1.0) / np.where(known, other, 1.0)
        rows.append(np.clip(np.log(ratio), -FARTHEST, FARTHEST))
    # where nothing scatters the ratios are those of the least albedo that does
    for row in (DIRECT, SCATTERED):
        rows[row][0] = rows[row][1] if np.all(flat[0] <= 1e-12) else rows[row][0]
    return np.stack(rows)


class FiniteFactors(NamedTuple):
    """Factors of one sample on its map's grid.

    Attributes:
        table: logarithms, (5, A, S, G).
        dark, ln_sigma_t, spread: the axes -ln(1 - albedo), ln sigma_t and -ln(1 - g).
    """

    table: Any
    dark: Any
    ln_sigma_t: Any
    spread: Any

    @classmethod
    def of(cls, found: AppearanceMap) -> FiniteFactors:
        """The factors of a map that has them.

        Raises:
            ValueError: the map was made without the plane-parallel engine.
        """
        if found.factors is None:
            raise ValueError("found a map without factors; expected one of a clear-covered bench")
        return cls(
            found.factors,
            -np.log1p(-np.minimum(found.albedo, 1.0 - 1e-12)),
            np.log(found.sigma_t_per_mm),
            -np.log1p(-found.g),
        )

    def at(self, albedo: Any, sigma_t_per_mm: Any, g: Any) -> Any:
        """Factors at W materials, shape (5, W); beyond the grid those of its border."""
        import jax.numpy as jnp

        where = []
        axes = (
            (-jnp.log1p(-jnp.minimum(albedo, 1.0 - 1e-12)), self.dark),
            (jnp.log(sigma_t_per_mm), self.ln_sigma_t),
            (-jnp.log1p(-g), self.spread),
        )
        for value, axis in axes:
            place = jnp.interp(value, jnp.asarray(axis), jnp.arange(len(axis), dtype=float))
            where.append(_cubic(place, len(axis)))
        (i, u), (j, v), (k, w) = where
        table = jnp.asarray(self.table)
        nodes = table[:, i[:, None, None], j[None, :, None], k[None, None, :]]
        return jnp.exp(jnp.einsum("fijkw,iw,jw,kw->fw", nodes, u, v, w))


def _cubic(place: Any, count: int) -> tuple[Any, Any]:
    """Four neighbouring nodes (4, W) of places (W,) on an axis, and their weights (4, W)."""
    import jax.numpy as jnp

    base = jnp.clip(jnp.floor(place), 0, max(0, count - 2))
    t = place - base
    near = base.astype(int)[None] + jnp.arange(-1, 3)[:, None]
    weights = jnp.stack(
        [
            t * (-0.5 + t * (1.0 - 0.5 * t)),
            1.0 + t * t * (-2.5 + 1.5 * t),
            t * (0.5 + t * (2.0 - 1.5 * t)),
            t * t * (-0.5 + 0.5 * t),
        ]
    )
    return jnp.clip(near, 0, count - 1), weights


def finite_captures(parts: Parts, factors: Sequence[FiniteFactors], parameters: Any) -> Any:
    """Black, white and collimated of the finite bench, shape (W, S, 3).

    Args:
        parts: of the unbounded bench, (W, S) each.
        factors: of S samples.
        parameters: albedo, sigma_t, g and reflectances, (W,) each.
    """
    import jax.numpy as jnp

    material = (parameters.albedo, parameters.sigma_t_per_mm, parameters.g)
    f = jnp.stack([own.at(*material) for own in factors], axis=-1)  # (5, W, S)
    # the share that returns from one bounce to the next: matched to all bounces together
    kept = (1.0 - TAIL_RHO * parts.returned) * f[ONCE_WHITE] / f[OVER_WHITE]
    returned = (1.0 - kept) / TAIL_RHO
    direct = parts.direct * f[DIRECT]
    captures = []
    for rho, row in ((parameters.rho_black, ONCE_BLACK), (parameters.rho_white, ONCE_WHITE)):
        rho = jnp.asarray(rho)[:, None]
        captures.append(direct + rho * parts.once * f[row] / (1.0 - rho * returned))
    captures.append(parts.unscattered + parts.scattered * f[SCATTERED])
    return jnp.stack(captures, axis=-1)
