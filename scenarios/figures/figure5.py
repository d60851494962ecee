"""Figure 5: surfaces of constant g in (I_black, I_white, log10 I_collimated)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.figures.planes import BASE, RESOLVED, nearest, plane_points, sign_counts
from scenarios.figures.points import Blocks, Point, jackknife, leave_one_out, sigma_grid
from scenarios.report.figure import new_figure
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

G = (0.0, 0.2, 0.4, 0.6, 0.8)
SIGMA_RANGE = (0.1, 20.0)
"""Extinction coefficients of the surfaces [1/mm]: optical thickness 0.05 to 10."""
ALBEDOS = (0.0, 0.5, 0.9, 0.98, 1.0)
SIGMAS = (1.0, 5.0, 10.0, 20.0)
VIEWS = ((22.0, -62.0), (28.0, 118.0))
"""Elevation and azimuth of the two views [deg]."""


@dataclass(frozen=True)
class Surface:
    """One g: coordinates and Jacobian over (albedo, sigma_t).

    Attributes:
        albedo: (A,); sigma_t_per_mm: (S,) [1/mm].
        at: I_black, I_white and log10 I_collimated, (3, A, S).
        jacobian: d(I_black, I_white, ln I_collimated) / d(albedo, ln sigma_t, g), (A, S);
            jacobian_se: its standard error.
    """

    albedo: FloatArray
    sigma_t_per_mm: FloatArray
    at: FloatArray
    jacobian: FloatArray
    jacobian_se: FloatArray


def surface_points(quick: bool, g: float) -> tuple[tuple[Point, ...], tuple[Point, ...]]:
    """Points of one surface: lit by the panels, and by the beam."""
    inside = sigma_grid(quick, *SIGMA_RANGE)
    panels = tuple(p for p in plane_points(quick, g=g) if p.sigma_t_per_mm in inside)
    return panels, tuple(replace(p, lit="beam", log2_paths=6 if quick else 10) for p in panels)


def points(quick: bool) -> tuple[Point, ...]:
    """Everything that the figure needs."""
    return tuple(p for g in G for lit in surface_points(quick, g) for p in lit)


def surface_of(
    panels: tuple[Point, ...], beam: tuple[Point, ...], results: Mapping[Point, Blocks]
) -> Surface:
    """Put the results of `surface_points` together."""
    sigma = np.array([point.sigma_t_per_mm for point in panels])

    def gathered(points: tuple[Point, ...], name: str) -> FloatArray:
        return np.stack([leave_one_out(getattr(results[p], name)) for p in points], axis=-1)

    rows = []
    transmitted = gathered(beam, "value")
    for name, scale in (("d_albedo", 1.0), ("d_sigma", sigma), ("d_g", 1.0)):
        row = [gathered(panels, name), gathered(beam, name) / transmitted]
        rows.append(np.concatenate(row, axis=1) * scale)
    # blocks first, then parameter by quantity last: (blocks, A, S, 3, 3)
    matrix = np.moveaxis(np.stack(rows, axis=1), (1, 2), (-2, -1))
    jacobian, jacobian_se = jackknife(np.linalg.det(matrix))
    value = gathered(panels, "value").mean(axis=0)
    at = np.stack([value[0], value[0] + value[1], np.log10(transmitted.mean(axis=0)[0])])
    return Surface(np.array(panels[0].albedo), sigma, at, jacobian, jacobian_se)


def draw(results: Mapping[Point, Blocks], quick: bool) -> tuple[Figure, dict[str, Any]]:
    """The figure and its checks."""
    from matplotlib import colormaps
    from matplotlib.lines import Line2D

    surfaces = [surface_of(*surface_points(quick, g), results) for g in G]
    # from dark to light: in order for any colour vision
    colours = colormaps["viridis"](np.linspace(0.0, 0.88, len(G)))
    figure = new_figure(10.2, 5.2)
    for index, (elevation, azimuth) in enumerate(VIEWS):
        axes: Any = figure.add_subplot(1, 2, index + 1, projection="3d")
        for surface, colour in zip(surfaces, colours, strict=True):
            for albedo in ALBEDOS:
                axes.plot(*surface.at[:, nearest(surface.albedo, albedo)], color=colour, lw=1.0)
            for sigma in SIGMAS:
                column = nearest(surface.sigma_t_per_mm, sigma)
                axes.plot(*surface.at[:, :, column], color=colour, lw=0.9, alpha=0.75)
        axes.view_init(elevation, azimuth)
        axes.set_xlim(0, 1)
        axes.set_ylim(0, 1)
        axes.set_zlim(-4.5, 0)
        axes.set_xlabel("$I_b$ [–]")
        axes.set_ylabel("$I_w$ [–]")
        axes.set_zlabel("$\\log_{10} I_c$ [–]")
        axes.set_box_aspect((1, 1, 0.95), zoom=1.0)
        axes.set_title(
            f"({'ab'[index]})  Elevation {elevation:g}°, azimuth {azimuth:g}°".replace("-", "−")
        )
    figure.legend(
        [Line2D([], [], color=colour, lw=2) for colour in colours],
        [f"g = {g:g}" for g in G], loc="outside lower center", ncols=len(G),
    )  # fmt: skip
    return figure, checks(surfaces)


def checks(surfaces: list[Surface]) -> dict[str, Any]:
    """What the seed states of figure 5, as numbers."""
    pairs = list(pairwise(surfaces))
    return {
        "uniqueness": {f"g_{g:g}": uniqueness(s) for g, s in zip(G, surfaces, strict=True)},
        "spacing_at_equal_collimated": {
            f"{low:g}_to_{high:g}": spacing(*pair)
            for (low, high), pair in zip(pairwise(G), pairs, strict=True)
        },
        "largest_distance_of_surfaces_at_albedo_0": float(
            max(np.abs(s.at[:, 0] - surfaces[0].at[:, 0]).max() for s in surfaces)
        ),
    }


def uniqueness(surface: Surface) -> dict[str, Any]:
    """Signs of the Jacobian above albedo 0, where g plays a role, and where they get lost."""
    value, error = surface.jacobian[1:], surface.jacobian_se[1:]
    usual = -np.sign(np.median(value))
    tau = surface.sigma_t_per_mm * BASE.thickness_mm
    # albedos above one half: below, g leaves little trace at any thickness
    upper = nearest(surface.albedo, 0.5) - 1
    lost = np.any(np.abs(value[upper:]) <= RESOLVED * error[upper:], axis=0)
    first = float(tau[np.argmax(lost)]) if lost.any() else None
    return {
        "sign": sign_counts(usual * value, error),
        "smallest_optical_thickness_not_resolved_above_albedo_0.5": first,
    }


def spacing(lower: Surface, upper: Surface) -> dict[str, float]:
    """Distance of two surfaces in (I_black, I_white) at equal I_collimated, at a few albedos.

    Each point of the lower surface (sigma_t 1 /mm) is compared with the nearest point of the
    curve that the upper surface cuts out of the plane of its I_collimated.
    """
    column = nearest(lower.sigma_t_per_mm, 1.0)
    found = {}
    for albedo in (0.5, 0.9, 1.0):
        at = lower.at[:, nearest(lower.albedo, albedo), column]
        cut = np.stack([_at_height(rows, at[2]) for rows in np.moveaxis(upper.at, 1, 0)], axis=1)
        fine = np.linspace(0.0, cut.shape[1] - 1.0, 2000)
        line = [np.interp(fine, np.arange(cut.shape[1]), values) for values in cut]
        found[f"albedo_{albedo:g}"] = float(np.hypot(line[0] - at[0], line[1] - at[1]).min())
    return found


def _at_height(rows: FloatArray, height: float) -> FloatArray:
    """I_black and I_white where a contour of albedo, (3, S), passes a log10 I_collimated."""
    falling = rows[2][::-1]
    return np.array([np.interp(height, falling, values[::-1]) for values in rows[:2]])
