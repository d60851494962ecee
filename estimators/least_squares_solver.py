"""Levenberg-Marquardt of optimistix for every wavelength, batched, without LAPACK.

The small linear systems are solved by a Cholesky factor that is written out, because batched
LAPACK calls inside a jitted program can wait for ever (docs/decisions/0003).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx  # type: ignore[import-untyped,unused-ignore]
import optimistix as optx
from jax import Array
from jax.flatten_util import ravel_pytree

import twin.adding_doubling  # noqa: F401  (turns 64-bit numbers on)


class NormalEquations(lx.AbstractLinearSolver[Any]):  # type: ignore[misc,unused-ignore]
    """Least-squares solution of a tall operator by the Cholesky factor of its normal matrix.

    The normal matrix squares the condition number; columns are scaled to unit length first, and
    Levenberg-Marquardt's damping keeps it positive definite. A column of zeros gets the
    solution 0. Source: Golub & Van Loan (2013), Matrix Computations, 5.3.2.
    """

    def init(self, operator: lx.AbstractLinearOperator, options: dict[str, Any]) -> Any:
        """The operator as a matrix, (M, N), and its structure on the way in."""
        del options
        return operator.as_matrix(), eqx.internal.Static(operator.in_structure())

    def compute(self, state: Any, vector: Any, options: dict[str, Any]) -> Any:
        """Solution in the operator's own structure."""
        del options
        matrix, structure = state
        flat, _ = ravel_pytree(vector)
        solution = normal_solution(matrix, flat)
        zeros = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), structure.value)
        return ravel_pytree(zeros)[1](solution), lx.RESULTS.successful, {}

    def transpose(self, state: Any, options: dict[str, Any]) -> Any:
        """Never asked for: the fit is not differentiated.

        Raises:
            ValueError: always.
        """
        raise ValueError("found a transposed least-squares system; expected none")

    def conj(self, state: Any, options: dict[str, Any]) -> Any:
        """Real matrices are their own conjugates."""
        return state, options

    def assume_full_rank(self) -> bool:
        """Damped systems have full rank."""
        return True


def normal_solution(matrix: Array, vector: Array) -> Array:
    """The x that minimises |matrix x - vector|, matrix (M, N), N small: unrolled Cholesky."""
    size = matrix.shape[1]
    length = jnp.sqrt(jnp.sum(matrix**2, axis=0))
    scale = jnp.where(length > 0.0, 1.0 / jnp.where(length > 0.0, length, 1.0), 0.0)
    column = matrix * scale
    normal = [[jnp.sum(column[:, i] * column[:, j]) for j in range(size)] for i in range(size)]
    right = [jnp.sum(column[:, i] * vector) for i in range(size)]
    lower: list[list[Array]] = []
    for i in range(size):
        row: list[Array] = []
        for j in range(i):
            rest = normal[i][j] - sum(row[k] * lower[j][k] for k in range(j))
            row.append(rest / lower[j][j])
        rest = normal[i][i] - sum(entry**2 for entry in row)
        # a column that others span, to rounding, or that is zero, takes no step of its own
        row.append(jnp.sqrt(jnp.where(rest > 1e-14, rest, 1e14)))
        lower.append(row)
    for i in range(size):
        right[i] = (right[i] - sum(lower[i][k] * right[k] for k in range(i))) / lower[i][i]
    for i in reversed(range(size)):
        right[i] = (right[i] - sum(lower[k][i] * right[k] for k in range(i + 1, size))) / lower[i][
            i
        ]
    return jnp.stack(right) * scale


class Problem(NamedTuple):
    """One wavelength: S samples, M = 3S captures; a batch adds a leading axis.

    Attributes:
        row: what the engine needs to know of the wavelength.
        data: relative intensities, (M,); 0 where masked.
        whitener: turns differences of captures into independent ones of unit variance, (M, M);
            zero rows and columns where masked.
    """

    row: Any
    data: Any
    whitener: Any


class Solved(NamedTuple):
    """Where Levenberg-Marquardt stopped; a batch adds a leading axis.

    Attributes:
        place: coordinates, (3,).
        chi_square: sum of squares there.
        steps: evaluations of the engine.
        settled: whether the last steps were below the tolerance.
    """

    place: Any
    chi_square: Any
    steps: Any
    settled: Any


Evaluate = Callable[[Array, Any, Any], tuple[Array, Array]]
"""(coordinates (3,), row, shared) -> captures (M,), derivatives by the coordinates (M, 3)."""


def levenberg_marquardt(
    evaluate: Evaluate, steps: int, rtol: float, atol: float
) -> Callable[[Array, Problem, Any], Solved]:
    """A jitted solver of a batch: starts (B, 3), problems with a leading axis B, what all share.

    Args:
        evaluate: the engine at one wavelength.
        steps: most steps.
        rtol: tolerance on coordinates and whitened residuals, relative (Cauchy).
        atol: the same, absolute.
    """

    @jax.custom_vjp
    def residual(place: Array, given: tuple[Problem, Any]) -> Array:
        return forwards(place, given)[0]

    def forwards(place: Array, given: tuple[Problem, Any]) -> tuple[Array, Array]:
        problem, shared = given
        value, slope = evaluate(place, problem.row, shared)
        whitener = problem.whitener
        return whitener @ (value - problem.data), whitener @ slope

    def backwards(slope: Array, force: Array) -> tuple[Array, None]:
        return force @ slope, None

    # Three directions forwards are cheaper than 3S backwards: optimistix asks for the transposed
    # derivative, so that it keeps a small matrix, and gets the one found forwards.
    residual.defvjp(forwards, backwards)
    solver: optx.LevenbergMarquardt[Array, Array, None] = optx.LevenbergMarquardt(
        rtol, atol, linear_solver=NormalEquations()
    )

    def one(place: Array, problem: Problem, shared: Any) -> Solved:
        given = (problem, shared)
        solution: Any = optx.least_squares(
            residual, solver, place, given, options={"jac": "bwd"}, max_steps=steps, throw=False
        )
        rest = solution.state.f_info.residual
        return Solved(
            solution.value,
            jnp.sum(rest**2),
            solution.stats["num_steps"],
            solution.result == optx.RESULTS.successful,
        )

    return jax.jit(jax.vmap(one, in_axes=(0, 0, None)))
