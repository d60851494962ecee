"""Turned and bent boxes that hold one wavelength's posterior."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.posterior_coordinates import coarse
from twin.spectra import FloatArray

POWERS = np.array([(2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3)])
"""Of the two other axes, in the polynomial by which the first one is bent."""
FIRST_HALF_WIDTH = 5.0
"""Of the first box, in Laplace standard deviations."""
MARGIN, TOUCHED_MARGIN = 0.5, 1.0
"""Shares of the pilot's range by which a box is wider, and where the pilot touched its end."""
EDGE, TOUCHED = 0.02, 0.005
"""A box is touched where more than the second share of draws lie in its outer first share."""
LEVEL = 6.0
"""Standard deviations of the other axes at which the bend levels off."""
FEW_TO_BEND = 200
STRAIGHT = np.zeros(len(POWERS))


@dataclass(frozen=True, eq=False)
class Box:
    """Coordinates y = centre + axes @ (t_1 + bend(t_2, t_3), t_2, t_3), t between low and high.

    A posterior that the captures bind in one direction alone is a thin curved sheet; in t it is
    a flat one. The bend is a shear: densities in t and y are proportional.

    Attributes:
        centre: shape (3,).
        axes: shape (3, 3).
        low, high: shape (3,).
        bend: coefficients of `POWERS`, shape (7,).
    """

    centre: FloatArray
    axes: FloatArray
    low: FloatArray
    high: FloatArray
    bend: FloatArray

    @classmethod
    def laplace(cls, centre: FloatArray, covariance: FloatArray, half_width: float) -> Box:
        """Of so many standard deviations around a mode (3,) with covariance (3, 3)."""
        half = np.full(3, half_width)
        axes = coarse(np.asarray(np.linalg.cholesky(covariance), dtype=np.float64), 20)
        return cls(coarse(centre, 20), axes, -half, half, STRAIGHT)

    @classmethod
    def around(cls, y: FloatArray, touched: NDArray[np.bool_]) -> Box:
        """Around draws (K, 3), wider along axes of which a side (2, 3) was touched before."""
        best = min((_Sheet.of(y, axis) for axis in range(3)), key=lambda sheet: sheet.thickness)
        flat = cls(best.centre, best.axes, np.zeros(3), np.zeros(3), best.bend)
        t = flat.t(y)
        low, high = t.min(axis=0), t.max(axis=0)
        margin = np.where(touched.any(axis=0), TOUCHED_MARGIN, MARGIN) * (high - low)
        return cls(best.centre, best.axes, coarse(low - margin), coarse(high + margin), best.bend)

    def y(self, t: FloatArray) -> FloatArray:
        """Coordinates of the posterior, both (..., 3)."""
        bent = np.array(t)
        bent[..., 0] += bending(t) @ self.bend
        return np.asarray(self.centre + bent @ self.axes.T)

    def t(self, y: FloatArray) -> FloatArray:
        """Coordinates of the box, both (K, 3)."""
        t = np.array(np.linalg.solve(self.axes, (y - self.centre).T).T, dtype=np.float64)
        t[:, 0] -= bending(t) @ self.bend
        return np.asarray(t)

    def inside(self, t: FloatArray) -> NDArray[np.bool_]:
        """Whether points (..., 3) lie in the box, shape (...)."""
        return np.asarray(((t >= self.low) & (t <= self.high)).all(axis=-1))

    def touched_sides(self, t: FloatArray) -> NDArray[np.bool_]:
        """Whether draws (K, 3) crowd at the ends, shape (2, 3): low, high."""
        edge = EDGE * (self.high - self.low)
        near = np.stack([t < self.low + edge, t > self.high - edge])
        return np.asarray(near.mean(axis=1) > TOUCHED)


def bending(t: FloatArray) -> FloatArray:
    """The polynomials `POWERS` of points (..., 3), shape (..., 7)."""
    # far from the draws a cubic would leave for other materials: it levels off there
    a, b = np.moveaxis(LEVEL * np.tanh(t[..., 1:, None] / LEVEL), -2, 0)
    return np.concatenate([a * a, a * b, b * b, a**3, a * a * b, a * b * b, b**3], axis=-1)


@dataclass(frozen=True, eq=False)
class _Sheet:
    """One coordinate as a polynomial of the other two, and what that leaves."""

    centre: FloatArray
    axes: FloatArray
    bend: FloatArray
    thickness: float

    @classmethod
    def of(cls, y: FloatArray, axis: int) -> _Sheet:
        """Fitted to draws (K, 3)."""
        others = [k for k in range(3) if k != axis]
        spread = np.cov(y[:, others].T)
        ridge = np.diag(np.diagonal(spread) * 1e-9)
        factor = coarse(np.asarray(np.linalg.cholesky(spread + ridge), dtype=np.float64), 20)
        centre = coarse(y.mean(axis=0), 20)
        t = np.zeros_like(y)
        t[:, 1:] = np.linalg.solve(factor, (y[:, others] - centre[others]).T).T
        table = np.column_stack([np.ones(len(y)), t[:, 1:], bending(t)])
        if len(y) < FEW_TO_BEND:
            table = table[:, :3]
        height = y[:, axis] - centre[axis]
        # normal equations: of ten columns of order 1, and hundreds of times quicker than the SVD
        normal = table.T @ table
        normal += np.diag(np.diagonal(normal) * 1e-10)
        fit = np.linalg.solve(normal, table.T @ height)
        rest = float((height - table @ fit).std())
        width = float(coarse(np.array(max(rest, 1e-12 * float(height.std()) + 1e-300))))
        axes = np.zeros((3, 3))
        axes[axis, 0] = width
        axes[np.ix_(others, [1, 2])] = factor
        axes[axis, 1:] = coarse(fit[1:3], 30)
        centre[axis] = coarse(np.array(centre[axis] + fit[0]), 30)
        bend = STRAIGHT if len(fit) == 3 else coarse(fit[3:] / width, 30)
        return cls(centre, axes, bend, rest / (float(height.std()) + 1e-300))
