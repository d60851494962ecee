"""Small dense linear algebra that cannot lock up: batched, without LAPACK's batched calls.

jaxlib (0.10.2) splits every batched LAPACK call over XLA's thread pool and waits inside that
pool for the parts; two such calls at once, in one program or in two, hold all threads of a
small machine and wait for ever. So matrices are inverted and factored here by plain array
operations, and eigenvectors are asked for one matrix at a time, which LAPACK answers in place.
See docs/decisions/0003-no-batched-lapack.md.
"""

from __future__ import annotations

from typing import cast

import jax
import jax.numpy as jnp
from jax import Array, lax


@jax.custom_batching.sequential_vmap  # type: ignore[untyped-decorator]
def eigh_one_by_one(matrix: Array) -> tuple[Array, Array]:
    """Eigenvalues (N,) and vectors (N, N) of a symmetric matrix; never batched."""
    values, vectors = jnp.linalg.eigh(matrix, symmetrize_input=False)
    return values, vectors


def cholesky(matrix: Array) -> Array:
    """Lower factor of a positive definite matrix, (N, N), column by column."""
    size = matrix.shape[-1]
    index = jnp.arange(size)

    def step(k: Array, state: tuple[Array, Array]) -> tuple[Array, Array]:
        rest, factor = state
        column = jnp.where(index >= k, rest[:, k], 0.0)
        column = column / jnp.sqrt(rest[k, k])
        return rest - jnp.outer(column, column), factor.at[:, k].set(column)

    return cast(Array, lax.fori_loop(0, size, step, (matrix, jnp.zeros_like(matrix)))[1])


def inverse(matrix: Array) -> Array:
    """Inverse of a positive definite matrix, (N, N), by the symmetric sweep.

    Source: Goodnight (1979), "A tutorial on the SWEEP operator", Am. Stat. 33, 149.
    """
    size = matrix.shape[-1]
    identity = jnp.eye(size, dtype=matrix.dtype)
    # with a unit diagonal every pivot is at most 1, and nothing cancels in the sweep
    scale = 1.0 / jnp.sqrt(jnp.diagonal(matrix))
    scaled = matrix * scale[:, None] * scale[None, :]

    def step(k: Array, swept: Array) -> Array:
        unit = identity[k]
        pivot = swept[k, k]
        moved = swept[k] - unit
        return swept - jnp.outer(moved, moved / pivot) - 2.0 * jnp.outer(unit, unit)

    swept = lax.fori_loop(0, size, step, scaled)
    return cast(Array, -swept * scale[:, None] * scale[None, :])


def solve_positive(matrix: Array, right: Array) -> Array:
    """Solution of a positive definite system, (N, R); its derivatives use the same inverse."""
    own = inverse(lax.stop_gradient(matrix))

    def solve(apply: object, force: Array) -> Array:
        first = own @ force
        return first + own @ (force - lax.stop_gradient(matrix) @ first)

    return cast(
        Array,
        lax.custom_linear_solve(lambda x: matrix @ x, right, solve=solve, symmetric=True),
    )
