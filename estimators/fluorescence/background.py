"""Everything of the matrix that is Gaussian a priori: the reflectance and what no product explains.

What is assumed of it is in `background_prior`. All of it is marginalised in closed form (Rasmussen
and Williams 2006, equations 2.25 and 2.26), after the captures are reduced to the directions that
carry signal.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from estimators.fluorescence.background_prior import BackgroundPrior, Kernels, kernels
from estimators.fluorescence.cells import Captures
from twin.spectra import FloatArray

__all__ = ["BackgroundPrior", "Kernels", "Reduced", "kernels", "reduce", "vertex"]


@dataclass(frozen=True, eq=False)
class Reduced:
    """Captures in m directions that carry signal, for B samples.

    Attributes:
        captures: as they came.
        prior: scales; kernels: prior covariances.
        projection: (m, M).
        design: of every cell of the matrix, 0 where there is no fluorescence, (m, Wo, Wi).
        value: captures less those of the mean reflectance, (B, m).
        noise: covariance, (B, m, m).
        reflectance: of the first pass, (B, D); roughness: chosen in it, (B,).
    """

    captures: Captures
    prior: BackgroundPrior
    kernels: Kernels
    projection: FloatArray
    design: FloatArray
    value: FloatArray
    noise: FloatArray
    reflectance: FloatArray
    roughness: FloatArray
    local: FloatArray | None = None
    """Standard deviations of the cells around products of a first fit, (B, C)."""

    @cached_property
    def cell_design(self) -> FloatArray:
        """(m, C)."""
        return self.projection @ self.captures.fluorescence_design

    @cached_property
    def diagonal_design(self) -> FloatArray:
        """(m, D)."""
        return self.projection @ self.captures.diagonal_design

    @cached_property
    def leak_scale(self) -> FloatArray:
        """Reflectance of the near-diagonal cells, which their leak is a share of, (B, N)."""
        return np.asarray(self.reflectance @ self.kernels.neighbour.T)

    @cached_property
    def _gains(self) -> tuple[FloatArray, FloatArray]:
        return self.cell_design @ self.kernels.cell, self.diagonal_design @ self.kernels.diagonal

    @cached_property
    def _local_gain(self) -> FloatArray | None:
        """Covariance between values and cells around their products, (B, m, C)."""
        if self.local is None:
            return None
        scaled = self.cell_design * self.local[:, None, :]
        return np.asarray((scaled @ self.kernels.local) * self.local[:, None, :])

    @cached_property
    def _leak_gain(self) -> FloatArray:
        """Covariance between values and near-diagonal cells, (B, m, N)."""
        near = self.cell_design[:, self.kernels.near]
        scale = self.leak_scale[:, None, :]
        return np.asarray(((near * scale) @ self.kernels.leak) * scale)

    @cached_property
    def _grams(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Covariances of the values by smooth cells, rough cells (both at 1) and reflectances."""
        cell, diagonal = self._gains
        design = self.cell_design
        return cell @ design.T, design @ design.T, diagonal @ self.diagonal_design.T

    @cached_property
    def _prior_covariance(self) -> tuple[FloatArray, FloatArray]:
        smooth, rough, reflected = self._grams
        near = self.cell_design[:, self.kernels.near]
        fixed = self._leak_gain @ near.T + reflected
        fixed = fixed + self.roughness[:, None, None] ** 2 * rough
        if self._local_gain is not None:
            fixed = fixed + self._local_gain @ self.cell_design.T
        return smooth, fixed + self.noise

    def but(self, **changes: FloatArray) -> Reduced:
        """Another reflectance, roughness or local scale; what does not depend on them is kept."""
        other = replace(self, **changes)  # type: ignore[arg-type]
        for name in ("cell_design", "diagonal_design", "_gains", "_grams"):
            if name in self.__dict__:
                other.__dict__[name] = self.__dict__[name]
        return other

    def covariance(self, amplitude: float, sample: int | None = None) -> FloatArray:
        """Covariance of the values with the Gaussian part marginalised.

        Shape (B, m, m), or (m, m) of one sample.
        """
        cell, fixed = self._prior_covariance
        return np.asarray((fixed if sample is None else fixed[sample]) + amplitude**2 * cell)

    def background(self, amplitude: float, weighted: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Cells (B, C) and deviations of the reflectance (B, D) of weighted residuals (B, m)."""
        cell, diagonal = self._gains
        cells = amplitude**2 * (weighted @ cell)
        cells += self.roughness[:, None] ** 2 * (weighted @ self.cell_design)
        cells[:, self.kernels.near] += np.einsum("bm,bmn->bn", weighted, self._leak_gain)
        if self._local_gain is not None:
            cells += np.einsum("bm,bmc->bc", weighted, self._local_gain)
        return cells, weighted @ diagonal

    def unknowns(self, amplitude: float, sample: int) -> FloatArray:
        """Prior covariance of one sample's C cells and D reflectances, (C + D, C + D)."""
        cell, diagonal = self._gains
        count, rough = cell.shape[1], self.roughness[sample] ** 2
        size = count + diagonal.shape[1]
        prior = np.zeros((size, size))
        prior[:count, :count] = amplitude**2 * self.kernels.cell
        if self.local is not None:
            scale = self.local[sample]
            prior[:count, :count] += scale[:, None] * self.kernels.local * scale
        near, leak = self.kernels.near, self.leak_scale[sample]
        prior[np.ix_(near, near)] += leak[:, None] * self.kernels.leak * leak
        prior[np.arange(count), np.arange(count)] += rough
        prior[count:, count:] = self.kernels.diagonal
        return prior

    def gain(self, amplitude: float, sample: int) -> FloatArray:
        """Covariance of one sample's values with its C cells and D reflectances, (m, C + D)."""
        cell, diagonal = self._gains
        rough = self.roughness[sample] ** 2
        gain = np.concatenate([amplitude**2 * cell + rough * self.cell_design, diagonal], axis=1)
        gain[:, self.kernels.near] += self._leak_gain[sample]
        if self._local_gain is not None:
            gain[:, : cell.shape[1]] += self._local_gain[sample]
        return np.asarray(gain)

    def explained_variance(self, amplitude: float) -> tuple[FloatArray, FloatArray]:
        """Prior variance of the cells and how much of it the first sample's captures take, (C,)."""
        gain = amplitude**2 * self._gains[0] + self.roughness[0] ** 2 * self.cell_design
        gain[:, self.kernels.near] += self._leak_gain[0]
        prior = np.full(gain.shape[1], amplitude**2 + self.roughness[0] ** 2)
        prior[self.kernels.near] += np.diagonal(self.kernels.leak) * self.leak_scale[0] ** 2
        taken = np.einsum("mc,mc->c", gain, np.linalg.solve(self.covariance(amplitude, 0), gain))
        return prior, taken


def reduce(captures: Captures, prior: BackgroundPrior, directions: int) -> Reduced:
    """Keep the directions of the captures that carry most signal over noise.

    Args:
        captures: of B samples.
        prior: scales of the Gaussian part.
        directions: most directions to keep.
    """
    known = kernels(captures.cells, prior)
    cell, diagonal = captures.fluorescence_design, captures.diagonal_design
    noise = np.sqrt(np.diagonal(captures.covariance, axis1=1, axis2=2).mean(axis=0))
    projection = np.diag(1.0 / noise)
    if directions < len(noise):
        near = cell[:, known.near]
        signal = prior.signal_amplitude**2 * (cell @ known.cell @ cell.T)
        signal += diagonal @ known.diagonal @ diagonal.T + 0.25 * (near @ known.leak @ near.T)
        _, vector = np.linalg.eigh(signal / noise / noise[:, None])
        projection = np.ascontiguousarray((vector[:, ::-1][:, :directions] / noise[:, None]).T)
    mean = captures.diagonal_design.sum(axis=1) * prior.reflectance_mean
    design = np.tensordot(projection, captures.design * captures.cells.below_diagonal, 1)
    batch = len(captures.value)
    first = Reduced(
        captures, prior, known, projection, np.ascontiguousarray(design),
        (captures.value - mean) @ projection.T, projection @ captures.covariance @ projection.T,
        np.full((batch, diagonal.shape[1]), prior.reflectance_mean),
        np.full(batch, min(prior.roughness)),
    )  # fmt: skip
    first._grams  # noqa: B018  # made once, for all that follows
    grid = np.log(np.array(prior.roughness))
    evidence = np.empty((grid.size, batch))
    reflected = np.empty((grid.size, *first.reflectance.shape))
    for row, roughness in enumerate(prior.roughness):
        trial = first.but(roughness=np.full(batch, roughness))
        covariance = trial.covariance(prior.signal_amplitude)
        weighted: FloatArray = np.asarray(
            np.linalg.solve(covariance, first.value[..., None])[..., 0], dtype=np.float64
        )
        quadratic = np.einsum("bm,bm->b", weighted, first.value)
        evidence[row] = -0.5 * (quadratic + np.linalg.slogdet(covariance)[1])
        reflected[row] = prior.reflectance_mean + weighted @ first._gains[1]
    best = evidence.argmax(axis=0)
    chosen = np.exp([vertex(grid, evidence[:, b], int(best[b])) for b in range(batch)])
    reflectance = np.clip(reflected[best, np.arange(batch)], 0.01, 1.0)
    return first.but(reflectance=reflectance, roughness=np.asarray(chosen))


def vertex(grid: FloatArray, value: FloatArray, best: int) -> float:
    """Where the parabola through the best point of a grid and its neighbours is highest.

    Args:
        grid: increasing, (N,).
        value: at the points of the grid, (N,).
        best: index of the greatest value; at an end of the grid it stays.
    """
    if not 0 < best < grid.size - 1:
        return float(grid[best])
    x, y = grid[best - 1 : best + 2], value[best - 1 : best + 2]
    slope, curvature = np.polyfit(x - x[1], y - y[1], 2)[1::-1]
    if not curvature < 0.0:
        return float(x[1])
    return float(x[1] + np.clip(-0.5 * slope / curvature, x[0] - x[1], x[2] - x[1]))
