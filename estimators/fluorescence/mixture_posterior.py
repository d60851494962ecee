"""The seed's model, Gaussians and a MESE diagonal, as a probability density over its parameters.

Parameters of Gaussian m: ln peak, mean excitation, mean emission, ln of both variances, in units of
their prior; then the Lagrange multipliers of the diagonal (any real ones give a reflectance inside
0 to 1). What Gaussians and MESE cannot follow is the Gaussian background of `donaldson`, with small
amplitudes, and is marginalised.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from estimators.fluorescence.background import Reduced
from estimators.fluorescence.cells import Cells
from twin.spectra import FloatArray

MULTIPLIERS = 8
PRIOR = np.array([(-3.5, 1.5), (470.0, 90.0), (550.0, 90.0), (6.8, 0.9), (6.8, 0.9)])
"""Mean and standard deviation of ln peak, excitation [nm], emission [nm], ln variances [nm^2]."""
MULTIPLIER_SCALE = 3.0 / (1.0 + np.arange(MULTIPLIERS))
_STEP = 1e-5


@dataclass(frozen=True, eq=False)
class MixtureDensity:
    """Posterior density of one sample's mixture.

    Attributes:
        reduced: captures, B = 1, with a background of small amplitude.
        gaussians: their number, M.
        amplitude: of the cells that the Gaussians do not follow.
    """

    reduced: Reduced
    gaussians: int
    amplitude: float

    @property
    def size(self) -> int:
        """Number of parameters, P."""
        return 5 * self.gaussians + MULTIPLIERS

    @property
    def _cells(self) -> Cells:
        return self.reduced.captures.cells

    @cached_property
    def basis(self) -> FloatArray:
        """Cosines of the mirrored phase at the diagonal, (D, 8)."""
        grid = self._cells.diagonal_nm
        phase = np.pi * (grid - grid[0]) / (grid[-1] - grid[0]) - np.pi
        order = np.arange(MULTIPLIERS)
        return np.asarray(np.where(order == 0, 1.0, 2.0) * np.cos(phase[:, None] * order))

    @cached_property
    def _whitening(self) -> FloatArray:
        factor = np.linalg.cholesky(self.reduced.covariance(self.amplitude, 0))
        return np.asarray(np.linalg.inv(factor))

    @cached_property
    def _design(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Whitened captures: of the flattened matrix, of the diagonal, and the values."""
        white = self._whitening
        design = self.reduced.design
        return (
            (white @ design.reshape(len(design), -1)).T.copy(),
            (white @ self.reduced.diagonal_design).T.copy(),
            white @ self.reduced.value[0],
        )

    def natural(self, points: FloatArray) -> FloatArray:
        """(peak, excitation, emission, variances) of points (K, P), shape (K, M, 5)."""
        t = points[:, : 5 * self.gaussians].reshape(len(points), self.gaussians, 5)
        p = PRIOR[:, 0] + PRIOR[:, 1] * t
        p[..., [0, 3, 4]] = np.exp(np.clip(p[..., [0, 3, 4]], -30.0, 12.0))
        return np.asarray(p)

    def whitened(self, natural: FloatArray, multipliers: FloatArray) -> FloatArray:
        """A point (P,) of Gaussians (M, 5) and multipliers (8,)."""
        p = np.array(natural)
        p[:, [0, 3, 4]] = np.log(np.maximum(p[:, [0, 3, 4]], 1e-6))
        t = (p - PRIOR[:, 0]) / PRIOR[:, 1]
        return np.concatenate([np.clip(t, -3.0, 3.0).ravel(), multipliers / MULTIPLIER_SCALE])

    def fluorescence(self, points: FloatArray) -> FloatArray:
        """Matrices of the Gaussians, 0 elsewhere, (K, Wo, Wi), of points (K, P)."""
        p = self.natural(points)
        grid = self._cells
        into = np.exp(-0.5 * (grid.excitation_nm - p[..., 1:2]) ** 2 / p[..., 3:4])
        out = np.exp(-0.5 * (grid.emission_nm - p[..., 2:3]) ** 2 / p[..., 4:5]) * p[..., :1]
        return np.asarray((out.transpose(0, 2, 1) @ into) * grid.below_diagonal)

    def reflectance(self, points: FloatArray) -> FloatArray:
        """Diagonals (K, D) of points (K, P)."""
        multipliers = points[:, 5 * self.gaussians :] * MULTIPLIER_SCALE
        return 0.5 + np.arctan(multipliers @ self.basis.T) / np.pi

    def residual(self, points: FloatArray) -> FloatArray:
        """Whitened residuals (K, m) of points (K, P)."""
        cell, diagonal, value = self._design
        matrix = self.fluorescence(points).reshape(len(points), -1)
        mean = self.reduced.prior.reflectance_mean
        return np.asarray(value - matrix @ cell - (self.reflectance(points) - mean) @ diagonal)

    def log_probability(self, points: FloatArray) -> FloatArray:
        """Unnormalised log posterior density (K,) of points (K, P)."""
        left = self.residual(points)
        total = -0.5 * ((left**2).sum(axis=1) + (points**2).sum(axis=1))
        return np.where(np.isfinite(total), total, -np.inf)

    def mode(self, start: FloatArray, steps: int = 60) -> tuple[FloatArray, FloatArray]:
        """Mode (P,) and inverse Hessian (P, P), by Levenberg-Marquardt from a start (P,)."""
        point, damping = start.copy(), 1e-2
        cost = -self.log_probability(point[None])[0]
        system = np.eye(self.size)
        for _ in range(steps):
            left = self.residual(point[None])[0]
            nearby = point + _STEP * np.eye(self.size)
            jacobian = (self.residual(nearby) - left).T / _STEP
            system = jacobian.T @ jacobian + np.eye(self.size)
            gradient = jacobian.T @ left + point
            for _ in range(8):
                damped = system + damping * np.diag(np.diagonal(system))
                step = np.clip(np.linalg.solve(damped, gradient), -1.0, 1.0)
                trial = point - step
                found = -self.log_probability(trial[None])[0]
                if found < cost:
                    break
                damping *= 5.0
            else:
                break
            gain, point, cost, damping = cost - found, trial, found, max(damping / 5.0, 1e-8)
            if gain < 1e-3:
                break
        return point, np.asarray(np.linalg.inv(system))


def relabelled(
    points: FloatArray, reference: FloatArray, scale: FloatArray, gaussians: int
) -> tuple[FloatArray, NDArray[np.intp]]:
    """Draws in which every Gaussian keeps its index, and the permutations that were undone.

    A mixture does not change when two of its Gaussians change places, so a sampler may swap them.
    Every draw gets the order that lies closest to the reference (Stephens 2000, as an assignment).

    Args:
        points: draws, shape (K, P).
        reference: a point, (P,).
        scale: standard deviations of the parameters, (P,): what closeness is measured in.
        gaussians: number of Gaussians, M.

    Returns:
        Draws (K, P), and for each which Gaussian now stands first, second ..., (K, M).
    """
    from scipy.optimize import linear_sum_assignment

    head = 5 * gaussians
    t = points[:, :head].reshape(len(points), gaussians, 5)
    wanted = reference[:head].reshape(gaussians, 5)
    unit = np.maximum(scale[:head].reshape(gaussians, 5), 0.05)
    distance = (((t[:, None] - wanted[:, None]) / unit[:, None]) ** 2).sum(axis=-1)
    order = np.array([linear_sum_assignment(each)[1] for each in distance])
    out = points.copy()
    out[:, :head] = np.take_along_axis(t, order[:, :, None], axis=1).reshape(len(points), head)
    return out, order
