"""The engine by rows: any wavelengths of a bench, in blocks of one size, on all cores.

A block has a fixed shape, so that nothing is compiled twice; a block that is not full repeats
its last row. Wavelengths that have settled leave, the rest is packed into fewer blocks.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from estimators.forward import Forward, captures_and_slopes, captures_of
from estimators.least_squares_coordinates import Coordinates
from estimators.least_squares_solver import Problem, Solved, levenberg_marquardt
from estimators.protocol import BenchModel
from estimators.result import PARAMETERS
from twin.adding_doubling import Constants, Form, Parameters, captures_model, make_streams
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from twin.bench import Bench

BLOCK = 32
"""Wavelengths of one block: its arrays fit the cache, and little is wasted on filling up."""
FEW_STREAMS = (6, 4)
"""Air and trapped streams of the quick engine: 1e-3 at a fifth of the time."""
FEW_STREAMS_MATCHED = (10, 0)
"""The same for a sample of the index of air."""
QUICK_STEPS = 5
"""Steps before the settled wavelengths leave their block."""
QUICK_TOLERANCE = (0.03, 0.03)
"""Loose: convergence is quadratic, and the exact engine has the last word."""
TOLERANCE = (1e-3, 1e-3)


class Row(NamedTuple):
    """What the engine needs to know of a wavelength; thicknesses (S,); R rows: a leading axis."""

    n: Any
    rho_black: Any
    rho_white: Any
    thickness_mm: Any
    around: Any


class Shared(NamedTuple):
    """What the engine needs to know of the bench, the same at all wavelengths."""

    geometry: Any
    factors: Any


def _at(natural: Any, row: Row, shared: Shared) -> tuple[Parameters, Constants, Any]:
    """Arguments of `captures_of` at one wavelength, inside a program."""
    parameters = Parameters(
        natural[:1],
        natural[1:2],
        natural[2:],
        row.n[None],
        row.thickness_mm,
        row.rho_black[None],
        row.rho_white[None],
    )
    around = jax.tree.map(lambda leaf: leaf[None], row.around)
    return parameters, Constants(around, shared.geometry), shared.factors


def evaluator(form: Form, coordinates: Coordinates) -> Callable[..., Any]:
    """(coordinates (3,), row, shared) -> captures (3S,) and their derivatives (3S, 3)."""

    def evaluate(place: Any, row: Row, shared: Shared) -> Any:
        own, slope = coordinates.natural(place, jnp)
        value, jacobian = captures_and_slopes(*_at(own, row, shared), form, PARAMETERS)
        return value.reshape(-1), jacobian.reshape(-1, 3) * slope

    return evaluate


BY_ROW = (0, 0, None)


@lru_cache(maxsize=32)
def exact_program(form: Form, coordinates: Coordinates) -> Any:
    """`evaluator` for a block of rows; compiled once for all benches of a form."""
    return jax.jit(jax.vmap(evaluator(form, coordinates), in_axes=BY_ROW))


@lru_cache(maxsize=32)
def value_program(form: Form) -> Any:
    """((albedo, sigma_t, g), row, shared) -> captures (3S,), for a block of rows."""

    def evaluate(natural: Any, row: Row, shared: Shared) -> Any:
        return captures_of(*_at(natural, row, shared), form).reshape(-1)

    return jax.jit(jax.vmap(evaluate, in_axes=BY_ROW))


@lru_cache(maxsize=32)
def solver_program(
    form: Form, coordinates: Coordinates, steps: int, tolerance: tuple[float, float]
) -> Any:
    """Levenberg-Marquardt for a block of rows."""
    return levenberg_marquardt(evaluator(form, coordinates), steps, *tolerance)


@dataclass(frozen=True, eq=False)
class Engine:
    """A bench's engine, exact and quick, by rows.

    Attributes:
        forward: the exact engine.
        quick: the same with few streams.
        coordinates: of the material.
        steps: most steps of the exact solver.
        cores: threads.
    """

    forward: Forward
    quick: Forward
    coordinates: Coordinates
    steps: int
    cores: int

    @classmethod
    def of(cls, model: BenchModel, coordinates: Coordinates, steps: int, cores: int) -> Engine:
        """Build both engines.

        Raises:
            InputError: see `Forward.of`.
        """
        forward = Forward.of(model)
        matched = bool(np.all(np.asarray(forward.nominal.n) == 1.0))
        streams = make_streams(*(FEW_STREAMS_MATCHED if matched else FEW_STREAMS))
        bench = cast("Bench", model.bench)  # Forward.of refuses a model without
        few = captures_model(bench, model.samples, model.wavelength_nm, streams=streams)
        return cls(forward, replace(forward, captures=few), coordinates, steps, cores)

    @cached_property
    def rows(self) -> Row:
        """All wavelengths, exact engine."""
        return _rows_of(self.forward)

    @cached_property
    def quick_rows(self) -> Row:
        """All wavelengths, quick engine."""
        return _rows_of(self.quick)

    @cached_property
    def _exact(self) -> Any:
        return exact_program(self.forward.captures.form, self.coordinates)

    @cached_property
    def _quick_values(self) -> Any:
        return value_program(self.quick.captures.form)

    @cached_property
    def _solver(self) -> Any:
        return solver_program(self.forward.captures.form, self.coordinates, self.steps, TOLERANCE)

    @cached_property
    def _quick_solver(self) -> Any:
        steps = min(self.steps, QUICK_STEPS)
        return solver_program(self.quick.captures.form, self.coordinates, steps, QUICK_TOLERANCE)

    def with_rows(self, change: Callable[[Row], Row]) -> Engine:
        """The same compiled engine at other rows: `change` is applied to exact and quick ones."""
        other = copy.copy(self)
        vars(other).update(rows=change(self.rows), quick_rows=change(self.quick_rows))
        return other

    def evaluate(self, place: FloatArray, index: NDArray[np.intp]) -> tuple[FloatArray, FloatArray]:
        """Captures (R, 3S) and derivatives by the coordinates (R, 3S, 3), exact engine.

        Args:
            place: coordinates, (R, 3).
            index: wavelengths, (R,).
        """
        value, slope = self._blocks(self._exact, self.forward, (place, _take(self.rows, index)))
        return value, slope

    def quick_rows_at(self, index: NDArray[np.intp]) -> Row:
        """Rows of the quick engine at some wavelengths."""
        return Row(*_take(self.quick_rows, index))

    def quick_values(self, natural: FloatArray, rows: Row) -> FloatArray:
        """Captures (R, 3S) of materials (R, 3), quick engine."""
        return np.asarray(self._blocks(self._quick_values, self.quick, (natural, rows)))

    def solve(
        self,
        place: FloatArray,
        index: NDArray[np.intp],
        data: FloatArray,
        whitener: FloatArray,
        *,
        quick: bool,
    ) -> Solved:
        """Levenberg-Marquardt from `place` (R, 3) at the wavelengths `index` (R,).

        Args:
            place: starts, coordinates.
            index: wavelengths.
            data: of all wavelengths, (W, 3S).
            whitener: of all wavelengths, (W, 3S, 3S).
            quick: few streams and loose tolerances.
        """
        rows = _take(self.quick_rows if quick else self.rows, index)
        solver = self._quick_solver if quick else self._solver
        forward = self.quick if quick else self.forward
        problem = Problem(rows, data[index], whitener[index])
        return Solved(*self._blocks(solver, forward, (place, problem)))

    def _blocks(self, program: Any, forward: Forward, arguments: tuple[Any, ...]) -> Any:
        """Run a program over rows block by block; results have the rows on the leading axis."""
        shared = Shared(forward.captures.constants.geometry, forward.factors)
        count = len(arguments[0])
        blocks = [np.arange(first, min(first + BLOCK, count)) for first in range(0, count, BLOCK)]

        def run(block: NDArray[np.intp]) -> Any:
            full = np.concatenate([block, np.full(BLOCK - len(block), block[-1])])
            result = program(*_take(arguments, full), shared)
            return jax.tree.map(lambda leaf: np.asarray(leaf)[: len(block)], result)

        threads = min(self.cores, len(blocks))
        if threads < 2:
            parts = [run(block) for block in blocks]
        else:
            # the first block compiles; only then are there threads
            first = run(blocks[0])
            with ThreadPoolExecutor(threads) as pool:
                parts = [first, *pool.map(run, blocks[1:])]
        return jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)


def _take(tree: Any, index: NDArray[np.intp]) -> Any:
    return jax.tree.map(lambda leaf: leaf[index], tree)


def _rows_of(forward: Forward) -> Row:
    captures = forward.captures
    nominal = captures.nominal
    count = len(np.asarray(nominal.n))
    around = jax.tree.map(np.asarray, captures.constants.around)
    n, black, white = (
        np.broadcast_to(np.asarray(value, dtype=np.float64), (count,))
        for value in (nominal.n, nominal.rho_black, nominal.rho_white)
    )
    return Row(
        n,
        black,
        white,
        np.tile(np.asarray(nominal.thickness_mm, dtype=np.float64), (count, 1)),
        around,
    )
