"""Captures near one wavelength's posterior as a polynomial: microseconds in place of milliseconds.

Tensor-product Chebyshev interpolation over a turned box in the coordinates of the posterior
(Trefethen 2013, "Approximation Theory and Approximation Practice", ch. 2-4), as fine along each
axis as the error at points that it was not made from asks for; small terms are dropped.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.posterior_box import Box
from estimators.posterior_coordinates import Coordinates
from estimators.posterior_engine import Engine
from estimators.posterior_settings import PosteriorSettings
from twin.spectra import FloatArray

NODES = (5, 7, 9, 12, 16)
"""Nodes along an axis, coarse to fine."""
MOST_NODES = 1600
"""Of a whole grid."""
SHARE_DROPPED = 0.02
"""Terms below this share of the tolerance are left out."""
WORTH_NARROWING = 200
"""Evaluations per wavelength that pay for an engine of fewer wavelengths."""


@dataclass(frozen=True, eq=False)
class Emulator:
    """A polynomial of O outputs over a box.

    Attributes:
        box: where it holds.
        degree: degrees of T terms, shape (T, 3); term: their coefficients, shape (T, O).
        error: largest error of the whitened captures at points not used, in standard deviations.
        nodes: evaluations it took.
    """

    box: Box
    degree: NDArray[np.intp]
    term: FloatArray
    error: float
    nodes: int

    def __call__(self, t: FloatArray) -> FloatArray:
        """Outputs at points (K, 3) of the box, shape (K, O)."""
        return np.asarray(self.basis(t) @ self.term)

    def basis(self, t: FloatArray) -> FloatArray:
        """Polynomials of all terms at points (K, 3), shape (K, T)."""
        box = self.box
        unit = np.clip((2.0 * t - box.low - box.high) / (box.high - box.low), -1.0, 1.0)
        order = np.arange(int(self.degree.max()) + 1 if self.degree.size else 1)
        cheb = np.cos(np.arccos(unit)[:, :, None] * order)
        a, b, c = self.degree.T
        return np.asarray(cheb[:, 0, a] * cheb[:, 1, b] * cheb[:, 2, c])

    def projected(self, matrix: FloatArray) -> Emulator:
        """Outputs multiplied by a matrix (P, O)."""
        return Emulator(self.box, self.degree, self.term @ matrix.T, self.error, self.nodes)


class Source:
    """What is emulated: captures of (K, W, 3) coordinates, whitened and perhaps more outputs."""

    def __init__(self, engine: Engine, coordinates: Coordinates, white: FloatArray) -> None:
        self.engine = engine
        self.coordinates = coordinates
        self.white = white

    def outputs(self, x: FloatArray) -> FloatArray:
        """Whitened captures, (K, W, O)."""
        captures = self.engine.at(self.coordinates.material(x))
        return np.asarray(np.einsum("wij,kwj->kwi", self.white, captures))

    def narrowed(self, wavelengths: NDArray[np.intp]) -> Source:
        """The same for some of the wavelengths."""
        return Source(self.engine.narrowed(wavelengths), self.coordinates, self.white[wavelengths])


class WithNuisances(Source):
    """Whitened captures, and their whitened changes by N nuisances: M (1 + N) outputs."""

    def __init__(
        self,
        engine: Engine,
        coordinates: Coordinates,
        white: FloatArray,
        settings: PosteriorSettings,
    ) -> None:
        super().__init__(engine, coordinates, white)
        self.settings = settings

    def outputs(self, x: FloatArray) -> FloatArray:
        """Shape (K, W, M (1 + N))."""
        slopes = self.engine.nuisance_slopes(self.coordinates.material(x), self.settings)
        slopes = np.einsum("wij,kwjn->kwin", self.white, slopes)
        return np.concatenate([super().outputs(x), slopes.reshape(*slopes.shape[:2], -1)], axis=-1)

    def narrowed(self, wavelengths: NDArray[np.intp]) -> WithNuisances:
        """The same for some of the wavelengths."""
        engine = self.engine.narrowed(wavelengths)
        return WithNuisances(engine, self.coordinates, self.white[wavelengths], self.settings)


def emulators(
    source: Source, boxes: list[Box], checks: FloatArray, tolerance: float
) -> list[Emulator]:
    """One emulator per wavelength.

    Args:
        source: what to emulate at W wavelengths.
        boxes: W boxes.
        checks: points t of each box at which the error is measured, (Q, W, 3).
        tolerance: error [standard deviations] that is good enough; what does not reach it with
            `MOST_NODES` keeps the error it has, and says so.
    """
    count = len(boxes)
    truth = source.outputs(_together(boxes, checks))
    level = np.zeros((count, 3), dtype=np.intp)
    found: list[Emulator | None] = [None] * count
    active = np.arange(count)
    while active.size:
        sizes = [tuple(NODES[k] for k in level[w]) for w in active]
        values = _evaluated(source, boxes, active, sizes)
        left = []
        for k, w in enumerate(active):
            coefficients = _coefficients(values[k], sizes[k])
            emulator = _kept(boxes[w], coefficients, tolerance)
            error = float(np.abs(emulator(checks[:, w]) - truth[:, w]).max())
            done = Emulator(emulator.box, emulator.degree, emulator.term, error, values[k].shape[0])
            before = found[w]
            if before is None or error <= before.error:
                found[w] = done
            if error > tolerance and _refine(level[w], coefficients):
                left.append(w)
        active = np.array(left, dtype=np.intp)
    return [emulator for emulator in found if emulator is not None]


def _together(boxes: list[Box], t: FloatArray) -> FloatArray:
    return np.stack([box.y(t[:, w]) for w, box in enumerate(boxes)], axis=1)


def _evaluated(
    source: Source, boxes: list[Box], active: NDArray[np.intp], sizes: list[tuple[int, ...]]
) -> list[FloatArray]:
    """Outputs at every active wavelength's nodes, each (nodes, O)."""
    grids = []
    for w, size in zip(active, sizes, strict=True):
        box = boxes[w]
        axes = [
            0.5 * (low + high) + 0.5 * (high - low) * _nodes(n)
            for low, high, n in zip(box.low, box.high, size, strict=True)
        ]
        t = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        grids.append(box.y(t))
    most = max(len(grid) for grid in grids)
    few = 2 * active.size <= len(boxes)
    if few and most >= WORTH_NARROWING and source.engine.repeats * 2 <= 32:
        source, columns = source.narrowed(active), np.arange(active.size)
        width = active.size
    else:
        columns, width = active, len(boxes)
    x = np.empty((most, width, 3))
    x[:] = grids[0][0]
    for column, grid in zip(columns, grids, strict=True):
        x[: len(grid), column] = grid
        x[len(grid) :, column] = grid[0]
    values = source.outputs(x)
    return [values[: len(grid), c] for c, grid in zip(columns, grids, strict=True)]


def _nodes(size: int) -> FloatArray:
    return np.asarray(np.cos((np.arange(size) + 0.5) * np.pi / size))


def _coefficients(values: FloatArray, size: tuple[int, ...]) -> FloatArray:
    """Chebyshev coefficients (n1, n2, n3, O) of values at the nodes (nodes, O)."""
    grid = values.reshape(*size, -1)
    for axis, n in enumerate(size):
        order = np.arange(n)
        matrix = np.cos(np.outer(order, (order + 0.5) * np.pi / n)) * 2.0 / n
        matrix[0] *= 0.5
        grid = np.moveaxis(np.tensordot(matrix, grid, axes=(1, axis)), 0, axis)
    return np.asarray(grid)


def _kept(box: Box, coefficients: FloatArray, tolerance: float) -> Emulator:
    largest = np.abs(coefficients).max(axis=-1)
    keep = largest > SHARE_DROPPED * tolerance
    keep[0, 0, 0] = True
    return Emulator(box, np.argwhere(keep), coefficients[keep], np.inf, 0)


def _refine(level: NDArray[np.intp], coefficients: FloatArray) -> bool:
    """Raise the axes along which the coefficients fall off most slowly; False: no room."""
    largest = np.abs(coefficients).max(axis=-1)
    tails = np.array([np.moveaxis(largest, axis, 0)[-2:].max() for axis in range(3)])
    wanted = np.argsort(-tails, kind="stable")
    raised = False
    for rank, axis in enumerate(wanted):
        if rank and tails[axis] < 0.3 * tails[wanted[0]]:
            break
        if level[axis] + 1 >= len(NODES):
            continue
        level[axis] += 1
        if np.prod([NODES[k] for k in level]) > MOST_NODES:
            level[axis] -= 1
            continue
        raised = True
    return raised
