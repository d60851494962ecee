"""Everything of the matrix that is Gaussian a priori: the reflectance and what no product explains.

    diagonal r(lambda)      ~ GP(0.4, 0.4^2 matern52(50 nm))
    fluorescence cells      ~ GP(0, a^2 matern52(emission) matern52(excitation)) + roughness
                              + p * GP(0, local^2 matern52),   p products of a first fit
    cells next to diagonal: + r * GP(0, leak^2 (1 + 0.1 matern52)),   r from a first pass

The second line of the cells is what makes turbid samples more than sums of products: light that
is absorbed again on its way out (Allen 1964) weighs a product smoothly over both wavelengths.
The last line is the bandwidth of the instrument that a matrix is defined by: two monochromators of
triangular bandpass as wide as the step show a quarter of the reflectance in the neighbouring cells
(the near-diagonal values of ASTM E2153); a narrower bandpass or a correction leaves less. All is
marginalised in closed form (Rasmussen and Williams 2006, equations 2.25 and 2.26), after the
captures are reduced to the directions that carry signal.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from estimators.fluorescence.cells import Captures, Cells
from twin.spectra import FloatArray


@dataclass(frozen=True, kw_only=True)
class BackgroundPrior:
    """Scales of the Gaussian part."""

    reflectance_mean: float = 0.4
    reflectance_amplitude: float = 0.4
    reflectance_length_nm: float = 50.0
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
        """Draws of everything a priori."""
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
    diagonal = prior.reflectance_amplitude**2 * matern52(on, prior.reflectance_length_nm)
    diagonal += prior.reflectance_roughness**2 * np.eye(len(on))
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
    evidence, reflected = (
        np.empty((grid.size, batch)),
        np.empty((grid.size, *first.reflectance.shape)),
    )
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
    chosen = np.exp([_vertex(grid, evidence[:, b], int(best[b])) for b in range(batch)])
    reflectance = np.clip(reflected[best, np.arange(batch)], 0.01, 1.0)
    return first.but(reflectance=reflectance, roughness=np.asarray(chosen))


def _vertex(grid: FloatArray, value: FloatArray, best: int) -> float:
    """Where the parabola through the best point of a grid and its neighbours is highest."""
    if not 0 < best < grid.size - 1:
        return float(grid[best])
    x, y = grid[best - 1 : best + 2], value[best - 1 : best + 2]
    slope, curvature = np.polyfit(x - x[1], y - y[1], 2)[1::-1]
    if not curvature < 0.0:
        return float(x[1])
    return float(x[1] + np.clip(-0.5 * slope / curvature, x[0] - x[1], x[2] - x[1]))
