"""The appearance map behind the point: I over black and white along albedo and sigma_t.

On an unbounded slab only the optical thickness matters, so one grid over albedo and optical
thickness serves every thickness, and the backgrounds enter in closed form. What is computed anew
is the grid of another g or n.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from scenarios.report.map_plot import ALBEDOS, SIGMAS
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from twin.adding_doubling.model import CapturesModel
    from twin.adding_doubling.terms import Parts
    from twin.bench import Bench

CONTOURS = (0.0, *ALBEDOS)
"""Albedos of which a contour is drawn."""
ALBEDO = np.array(sorted({*CONTOURS, 0.65, 0.87, 0.9999}))
TAU = np.geomspace(0.01, 100.0, 29)
"""The grid: albedos, and optical thicknesses."""


@dataclass(frozen=True, eq=False)
class Plane:
    """Contours of one g, n, thickness and pair of backgrounds.

    Attributes:
        albedo: of the first contours, (A,); sigma_t_per_mm: of the second ones [1/mm], (S,).
        of_albedo: I over black and white along each albedo, shape (A, T, 2).
        of_sigma: along each sigma_t, from albedo 0 up, shape (S, B, 2).
    """

    albedo: FloatArray
    sigma_t_per_mm: FloatArray
    of_albedo: FloatArray
    of_sigma: FloatArray


def grid_model(bench: Bench, wavelength_nm: float, n: float) -> CapturesModel:
    """The engine of the grid of `ALBEDO` and `TAU`: any g, one n, one wavelength."""
    from dataclasses import replace

    from twin.adding_doubling import captures_model
    from twin.bench import Sample

    # a medium of 1/mm: the thickness is the optical thickness
    model = captures_model(
        bench,
        [Sample(name="grid", thickness_mm=1.0, n=n)],
        np.full(len(ALBEDO), wavelength_nm),
    )
    geometry = model.constants.geometry._replace(planes=np.zeros((len(TAU), 3)), thickness_mm=TAU)
    return replace(
        model,
        constants=model.constants._replace(geometry=geometry),
        nominal=model.nominal._replace(thickness_mm=TAU),
    )


def parts_grid(model: CapturesModel, g: float) -> Parts:
    """What captures are made of, arrays of shape (A, T)."""
    from twin.adding_doubling.terms import Parts

    found = model.parts(model.parameters(ALBEDO, 1.0, g))
    return Parts(*(np.asarray(each) for each in found))


def height_of(bench: Bench, thickness_mm: float) -> float:
    """Light on the sample's top over that on the white in its reference plane."""
    from twin.bench import Sample, stack_of
    from twin.transport.geometry import reference_factor, reference_plane_mm

    sample = Sample(name="height", thickness_mm=thickness_mm)
    height = sum(layer.thickness_mm for layer in stack_of(bench, sample, None))
    below = reference_factor(bench, reference_plane_mm(bench, height))
    return float(reference_factor(bench, 0.0) / below)


def plane_of(
    parts: Parts, height: float, thickness_mm: float, rho_black: float, rho_white: float
) -> Plane:
    """Contours over given backgrounds.

    Args:
        parts: of `parts_grid`.
        height: of `height_of`.
        thickness_mm: turns optical thicknesses into extinction coefficients.
        rho_black: reflectance of the black background.
        rho_white: reflectance of the white background.
    """
    grid = height * np.asarray(parts.captures(rho_black, rho_white))[..., :2]
    rows = np.searchsorted(ALBEDO, CONTOURS)
    sigma = np.array([s for s in SIGMAS if TAU[0] <= s * thickness_mm <= TAU[-1]])
    return Plane(np.array(CONTOURS), sigma, grid[rows], between(grid, np.log(sigma * thickness_mm)))


def between(grid: FloatArray, wanted: FloatArray) -> FloatArray:
    """The grid (A, T, 2) at logarithms of optical thicknesses (S,), shape (S, A, 2).

    A cubic through the grid's nodes (`scipy.interpolate.CubicSpline`).
    """
    from scipy.interpolate import CubicSpline

    return np.asarray(np.moveaxis(CubicSpline(np.log(TAU), grid, axis=1)(wanted), 1, 0))
