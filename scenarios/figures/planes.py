"""A plane of the appearance map (one g, n and thickness): values, Jacobian, areas."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenarios.figures.points import (
    CONTOUR_ALBEDO,
    Blocks,
    Point,
    jackknife,
    leave_one_out,
    sigma_grid,
)
from twin.spectra import FloatArray

BASE = Point(sigma_t_per_mm=1.0)
"""Figure 2's plane: g 0.4, n 1.0, 0.5 mm."""
RESOLVED = 4.5
"""Standard errors beyond which a sign counts as known (7e-6 by chance, two-sided)."""


@dataclass(frozen=True)
class Plane:
    """One plane of the map.

    Attributes:
        albedo: (A,); sigma_t_per_mm: (S,) [1/mm].
        black, white: relative intensities, (A, S); black_se, white_se: standard errors.
        jacobian: d(I_black, I_white) / d(albedo, ln sigma_t), (A, S); jacobian_se: its
            standard error (jackknife over the blocks).
    """

    albedo: FloatArray
    sigma_t_per_mm: FloatArray
    black: FloatArray
    white: FloatArray
    black_se: FloatArray
    white_se: FloatArray
    jacobian: FloatArray
    jacobian_se: FloatArray

    def line(self, *, albedo: float | None = None, sigma: float | None = None) -> FloatArray:
        """I_black and I_white along a contour of the grid, shape (2, S) or (2, A)."""
        if albedo is not None:
            row = nearest(self.albedo, albedo)
            return np.stack([self.black[row], self.white[row]])
        column = nearest(self.sigma_t_per_mm, 0.0 if sigma is None else sigma)
        return np.stack([self.black[:, column], self.white[:, column]])


def nearest(grid: FloatArray, value: float) -> int:
    """Index of the grid's node at a value."""
    return int(np.argmin(np.abs(grid - value)))


def plane_points(
    quick: bool, *, g: float = BASE.g, n: float = BASE.n, thickness_mm: float = BASE.thickness_mm
) -> tuple[Point, ...]:
    """The points of one plane; figure 2's plane gets more paths than the others."""
    base = (g, n, thickness_mm) == (BASE.g, BASE.n, BASE.thickness_mm)

    def paths(sigma: float) -> int:
        if quick:
            return 6
        # behind many scattering events the spread between paths is largest
        tau = sigma * thickness_mm
        return 12 + (2 * int(tau >= 2.0) if base else int(tau >= 10.0))

    return tuple(
        Point(sigma, g=g, n=n, thickness_mm=thickness_mm, log2_paths=paths(sigma))
        for sigma in sigma_grid(quick)
    )


def plane_of(points: Sequence[Point], results: Mapping[Point, Blocks]) -> Plane:
    """Put the results of `plane_points` together."""
    blocks = [results[point] for point in points]
    sigma = np.array([point.sigma_t_per_mm for point in points])
    value, d_albedo, d_sigma = (
        np.stack([leave_one_out(getattr(b, name)) for b in blocks], axis=-1)
        for name in ("value", "d_albedo", "d_sigma")
    )
    black, black_se = jackknife(value[:, 0])
    white, white_se = jackknife(value[:, 0] + value[:, 1])
    # the Jacobian of (I_black, I_white - I_black) is the same, and exact where both are close
    jacobian, jacobian_se = jackknife(
        sigma * (d_albedo[:, 0] * d_sigma[:, 1] - d_sigma[:, 0] * d_albedo[:, 1])
    )
    return Plane(
        np.array(points[0].albedo), sigma, black, white, black_se, white_se, jacobian, jacobian_se
    )


def cell_areas(plane: Plane) -> FloatArray:
    """Signed area of every cell of the mesh in (I_black, I_white), shape (A-1, S-1).

    Positive where the cell is turned over; cells of a one-to-one map are all negative.
    """
    x, y = plane.black, plane.white
    ax, ay = x[1:, 1:] - x[:-1, :-1], y[1:, 1:] - y[:-1, :-1]
    bx, by = x[:-1, 1:] - x[1:, :-1], y[:-1, 1:] - y[1:, :-1]
    return np.asarray(0.5 * (bx * ay - ax * by) * -1.0)


def sign_counts(value: FloatArray, error: FloatArray) -> dict[str, int]:
    """How many nodes have a Jacobian that is surely of the usual sign, surely not, or neither."""
    usual = value < -RESOLVED * error
    against = value > RESOLVED * error
    return {
        "nodes": int(value.size),
        "usual_sign": int(usual.sum()),
        "other_sign": int(against.sum()),
        "not_resolved": int(value.size - usual.sum() - against.sum()),
    }


def uniqueness(plane: Plane) -> dict[str, Any]:
    """Whether the contours of albedo and sigma_t meet once: signs of Jacobian and cells."""
    areas = cell_areas(plane)
    unresolved = np.abs(plane.jacobian) <= RESOLVED * plane.jacobian_se
    near = unresolved[1:, 1:] | unresolved[:-1, 1:] | unresolved[1:, :-1] | unresolved[:-1, :-1]
    total = np.abs(areas).sum()
    where: NDArray[np.bool_] = unresolved
    low = float(plane.sigma_t_per_mm[np.any(where, axis=0)].min()) if where.any() else None
    return {
        "jacobian_sign": sign_counts(plane.jacobian, plane.jacobian_se),
        "share_of_area_with_turned_cells": float(areas[areas > 0].sum() / total),
        "share_of_area_near_unresolved_nodes": float(np.abs(areas[near]).sum() / total),
        "smallest_sigma_t_per_mm_not_resolved": low,
    }


def coverage(plane: Plane) -> dict[str, float]:
    """Area of the map and the share of it above some albedos."""
    areas = np.abs(cell_areas(plane))
    total = float(areas.sum())
    return {"area": total} | {
        f"share_above_albedo_{limit:g}": float(areas[nearest(plane.albedo, limit) :].sum() / total)
        for limit in CONTOUR_ALBEDO[1:-1]
    }


def median_relative_error(plane: Plane) -> float:
    """Median of the relative standard errors of I_white for albedos above 0."""
    seen = plane.white[1:] > 0
    return float(np.median(plane.white_se[1:][seen] / plane.white[1:][seen]))


def along(plane: Plane, albedo: float) -> dict[str, dict[str, float]]:
    """I_white along a contour of albedo, with its standard error, at a few sigma_t [1/mm]."""
    row = nearest(plane.albedo, albedo)
    columns = {value: nearest(plane.sigma_t_per_mm, value) for value in (0.01, 0.1, 1.0, 10.0)}
    return {
        f"sigma_t_{value:g}": {
            "white": float(plane.white[row, column]),
            "standard_error": float(plane.white_se[row, column]),
        }
        for value, column in columns.items()
    }
