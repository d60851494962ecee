"""What is assumed of the matrix before any capture: reflectance, and cells that are no product.

    diagonal r(lambda)      ~ GP(0.4, 0.3^2 matern52(140 nm) + 0.16^2 matern52(66 nm))
    fluorescence cells      ~ GP(0, a^2 matern52(emission) matern52(excitation)) + roughness
                              + p * GP(0, local^2 matern52),   p products of a first fit
    cells next to diagonal: + r * GP(0, leak^2 (1 + 0.1 matern52)),   r from a first pass

The second line of the cells is what makes turbid samples more than sums of products: light that
is absorbed again on its way out (Allen 1964) weighs a product smoothly over both wavelengths.
The last line is the bandwidth of the instrument that a matrix is defined by: two monochromators of
triangular bandpass as wide as the step show a quarter of the reflectance in the neighbouring cells
(the near-diagonal values of ASTM E2153); a narrower bandpass or a correction leaves less.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.fluorescence.cells import Cells
from twin.spectra import FloatArray


@dataclass(frozen=True, kw_only=True)
class BackgroundPrior:
    """Scales of the Gaussian part."""

    reflectance_mean: float = 0.4
    reflectance: tuple[tuple[float, float], ...] = ((0.3, 140.0), (0.16, 66.0), (0.02, 30.0))
    """Standard deviations and lengths [nm] of the processes whose sum the reflectance is, before
    fluorophores take from it. Lengths of greatest likelihood for 635 Munsell chips, whose standard
    deviations are 0.165 and 0.158; the first is wider here, because papers are whiter."""
    length_nm: float = 90.0
    """Of the fluorescence cells, along emission and excitation."""
    roughness: tuple[float, ...] = (3e-4, 7e-4, 1.5e-3, 3e-3)
    """Standard deviations of single cells around all that is smooth, because a real matrix is a
    measured one; the evidence of the captures chooses between them."""
    local: float = 0.2
    """Standard deviation of a product's cells, relative to them."""
    local_length_nm: float = 40.0
    reflectance_roughness: float = 2e-3
    """Standard deviation of single reflectances around all that is smooth."""
    leak: tuple[float, ...] = (0.04, 0.004)
    """Standard deviation of the share of the reflectance in cells one, two ... steps away."""
    leak_variation: float = 0.3
    """Standard deviation over wavelength, relative to `leak`."""
    leak_length_nm: float = 150.0
    signal_amplitude: float = 0.02
    """Amplitude of the cells that the directions of signal are chosen by."""


def matern52(distance: FloatArray, length: float) -> FloatArray:
    """Matern kernel of smoothness 5/2 (Rasmussen and Williams 2006, equation 4.17)."""
    r = np.sqrt(5.0) * np.abs(distance) / length
    return np.asarray((1.0 + r + r**2 / 3.0) * np.exp(-r))


@dataclass(frozen=True, eq=False)
class PriorDraws:
    """S draws of what is Gaussian a priori.

    Attributes:
        cell: smooth cells at amplitude 1, (S, C); rough: the rough ones at 1, (S, C).
        local: relative to products, at 1, (S, C).
        leak: shares of the reflectance, (S, N); diagonal: deviations of the reflectance, (S, D).
    """

    cell: FloatArray
    rough: FloatArray
    local: FloatArray
    leak: FloatArray
    diagonal: FloatArray


@dataclass(frozen=True, eq=False)
class Kernels:
    """Prior covariances on one grid.

    Attributes:
        cell: of the C cells at amplitude 1; diagonal: of the D reflectances.
        local: of the C cells relative to their products, at 1.
        leak: of the share of the reflectance in N near-diagonal cells, (N, N).
        near: which of the C cells these are, (N,).
        neighbour: which diagonals each lies between, weights (N, D).
    """

    cell: FloatArray
    diagonal: FloatArray
    local: FloatArray
    leak: FloatArray
    near: NDArray[np.intp]
    neighbour: FloatArray

    @cached_property
    def _roots(self) -> tuple[FloatArray, ...]:
        found = []
        for kernel in (self.cell, self.local, self.leak, self.diagonal):
            value, vector = np.linalg.eigh(kernel)
            found.append(vector * np.sqrt(np.maximum(value, 0.0)))
        return tuple(found)

    def draws(self, count: int, seed: int) -> PriorDraws:
        """Draws of everything a priori; the last ones are kept for the next sample."""
        if self._last.get("key") != (count, seed):
            self._last.update(key=(count, seed), draws=self._drawn(count, seed))
        kept: PriorDraws = self._last["draws"]
        return kept

    @cached_property
    def _last(self) -> dict[str, Any]:
        return {}

    def _drawn(self, count: int, seed: int) -> PriorDraws:
        random = np.random.Generator(np.random.Philox(key=seed))
        cell, local, leak, diagonal = (
            random.standard_normal((count, len(root))) @ root.T for root in self._roots
        )
        return PriorDraws(cell, random.standard_normal(cell.shape), local, leak, diagonal)


@lru_cache(maxsize=8)
def _kernels(
    emission: tuple[float, ...], excitation: tuple[float, ...], prior: BackgroundPrior
) -> Kernels:
    cells = Cells(np.array(emission), np.array(excitation))
    out = cells.emission[:, None] - cells.emission
    into = cells.excitation[:, None] - cells.excitation
    cell = matern52(out, prior.length_nm) * matern52(into, prior.length_nm)
    local = matern52(out, prior.local_length_nm) * matern52(into, prior.local_length_nm)
    on = cells.diagonal_nm[:, None] - cells.diagonal_nm
    diagonal = prior.reflectance_roughness**2 * np.eye(len(on))
    for deviation, length in prior.reflectance:
        diagonal += deviation**2 * matern52(on, length)
    steps = np.rint((cells.emission - cells.excitation) / (emission[1] - emission[0])).astype(int)
    near = np.flatnonzero(steps <= len(prior.leak))
    size = np.array((0.0, *prior.leak))[steps[near]]
    same = steps[near][:, None] == steps[near]
    smooth = matern52(out[np.ix_(near, near)], prior.leak_length_nm)
    leak = same * np.outer(size, size) * (1.0 + prior.leak_variation**2 * smooth)
    neighbour = np.stack(
        [
            np.abs(each[near][:, None] - cells.diagonal_nm)
            == np.abs(each[near][:, None] - cells.diagonal_nm).min(axis=1, keepdims=True)
            for each in (cells.emission, cells.excitation)
        ]
    ).astype(np.float64)
    return Kernels(cell, diagonal, local, leak, near, neighbour.mean(axis=0))


def kernels(cells: Cells, prior: BackgroundPrior) -> Kernels:
    """Prior covariances on the grid of a matrix (kept for the next sample)."""
    return _kernels(tuple(cells.emission_nm.tolist()), tuple(cells.excitation_nm.tolist()), prior)
