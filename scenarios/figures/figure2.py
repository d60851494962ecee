"""Figure 2: the two-dimensional appearance map, and the spectra of eight materials on it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.figures import planes
from scenarios.figures.drawing import (
    covered_bar,
    draw_contours,
    name_contours,
    square_map_axes,
)
from scenarios.figures.planes import Plane, nearest, plane_of, plane_points
from scenarios.figures.points import (
    CONTOUR_ALBEDO,
    CONTOUR_SIGMA,
    RHO_BLACK,
    RHO_WHITE,
    Blocks,
    Point,
)
from scenarios.report.figure import INK, new_figure
from twin.materials import optical_properties
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MATERIALS = (
    ("carmoisine", "carmoisine(1.5 mmol/l)"),
    ("default ink", "demo_ink"),
    ("blood, fat emulsion", "intralipid(10%) + oxyhaemoglobin(0.3 mmol/l)"),
    ("fat emulsion", "intralipid(5%)"),
    ("PolyJet cyan", "polyjet_cyan"),
    ("PolyJet yellow", "polyjet_yellow"),
    ("PolyJet white", "polyjet_white"),
    ("ketchup", "ketchup"),
)
"""Name in the figure and library name of the eight materials."""
SAME_POINT = 0.01
"""Distance in the map that counts as the same point: the smallest neighbourhood that Iser et al.
2022, section 4.3, sample."""


@dataclass(frozen=True)
class Curve:
    """A material on the map.

    Attributes:
        own, equivalent: points with its own g, and with the g of the map and sigma_s(1 - g)
            kept, one per wavelength.
    """

    title: str
    own: tuple[Point, ...]
    equivalent: tuple[Point, ...]


def wavelengths(quick: bool) -> FloatArray:
    """Wavelengths of the spectra [nm], shape (W,)."""
    return np.arange(400.0, 701.0, 100.0 if quick else 10.0)


def curves(quick: bool) -> tuple[Curve, ...]:
    """The points of the eight spectra."""
    found = []
    for title, material in MATERIALS:
        medium = optical_properties(material, wavelengths(quick))
        scattered = medium.albedo * medium.sigma_t_per_mm
        similar = scattered * (1.0 - medium.g) / (1.0 - planes.BASE.g)
        total = medium.sigma_t_per_mm - scattered + similar
        paths = 5 if quick else 9

        def points(
            sigma: FloatArray, g: FloatArray, albedo: FloatArray, paths: int = paths
        ) -> tuple[Point, ...]:
            return tuple(
                Point(float(s), g=float(h), albedo=(float(a),), log2_paths=paths)
                for s, h, a in zip(sigma, g, albedo, strict=True)
            )

        found.append(
            Curve(
                title,
                points(medium.sigma_t_per_mm, medium.g, medium.albedo),
                points(total, np.full_like(total, planes.BASE.g), similar / total),
            )
        )
    return tuple(found)


def points(quick: bool) -> tuple[Point, ...]:
    """Everything that the figure needs."""
    spectra = [point for curve in curves(quick) for point in (*curve.own, *curve.equivalent)]
    return (*plane_points(quick), *spectra)


def draw(results: Mapping[Point, Blocks], quick: bool) -> tuple[Figure, dict[str, Any]]:
    """The figure and its checks."""
    plane = plane_of(plane_points(quick), results)
    figure = new_figure(11.2, 6.5)
    grid = figure.add_gridspec(4, 4, width_ratios=[1.76, 1.76, 1.0, 1.0])
    axes = figure.add_subplot(grid[:, :2])
    draw_contours(axes, plane, CONTOUR_ALBEDO, CONTOUR_SIGMA)
    name_contours(axes, plane, CONTOUR_ALBEDO[1:], CONTOUR_SIGMA, left_below=2.0)
    square_map_axes(axes, -0.06, 1.08)
    axes.set_xlabel("Intensity over the black background $I_b$ [–]")
    axes.set_ylabel("Intensity over the white background $I_w$ [–]")
    axes.set_title("(a)  Appearance map: g = 0.4, 0.5 mm, n = 1.0, backgrounds 1 % and 99 %")
    _legend(axes)
    spectra = curves(quick)
    for index, curve in enumerate(spectra):
        small = figure.add_subplot(grid[index // 2, 2 + index % 2])
        mappable = _small(small, plane, curve, results, wavelengths(quick))
        small.set_title(("(b)  " if index == 0 else "") + curve.title, fontsize=8.5)
        small.tick_params(labelleft=index % 2 == 0, labelbottom=index >= 6)
        if index % 2 == 0:
            small.set_ylabel("$I_w$ [–]")
        if index >= 6:
            small.set_xlabel("$I_b$ [–]")
    label = "Wavelength [nm] (circle 400 nm, square 700 nm)"
    covered_bar(figure, mappable, figure.axes[1:], label)
    return figure, checks(plane) | {"similarity": similarity(spectra, results)}


def _legend(axes: Axes) -> None:
    from matplotlib.lines import Line2D

    from scenarios.figures.drawing import ALBEDO_LINE, DASHES, SIGMA_LINE

    axes.legend(
        [Line2D([], [], color=ALBEDO_LINE), Line2D([], [], color=SIGMA_LINE, ls=DASHES)],
        ["constant albedo (named at the diagonal)", "constant $\\sigma_t$ [1/mm]"],
        loc="lower right",
    )


def positions(points: tuple[Point, ...], results: Mapping[Point, Blocks]) -> FloatArray:
    """I_black and I_white of points with one albedo each, shape (2, W)."""
    value = np.stack([results[point].mean[:, 0] for point in points], axis=1)
    return np.stack([value[0], value[0] + value[1]])


def _small(
    axes: Axes,
    plane: Plane,
    curve: Curve,
    results: Mapping[Point, Blocks],
    wavelength: FloatArray,
) -> Any:
    from matplotlib import colormaps
    from matplotlib.collections import LineCollection
    from matplotlib.colors import ListedColormap

    # from blue to orange with rising lightness: in order for any colour vision
    colours = ListedColormap(colormaps["plasma"](np.linspace(0.0, 0.82, 128)))
    draw_contours(axes, plane, (0.0, 0.5, 0.9, 0.99, 1.0), (0.2, 1.0, 5.0, 20.0), faint=True)
    x, y = positions(curve.own, results)
    fine = np.linspace(0.0, len(x) - 1.0, 2 * len(x))
    node = np.arange(len(x))
    path = np.stack([np.interp(fine, node, x), np.interp(fine, node, y)], axis=1)
    lines = LineCollection(
        list(np.stack([path[:-1], path[1:]], axis=1)), cmap=colours, lw=2.6, capstyle="round"
    )
    lines.set_array(np.interp(fine[:-1] + 0.5 * (fine[1] - fine[0]), node, wavelength))
    lines.set_clim(float(wavelength[0]), float(wavelength[-1]))
    axes.add_collection(lines)
    axes.plot(x[0], y[0], "o", ms=4.5, color=colours(0.0), mec=INK, mew=0.5, zorder=3)
    axes.plot(x[-1], y[-1], "s", ms=4.5, color=colours(1.0), mec=INK, mew=0.5, zorder=3)
    square_map_axes(axes)
    axes.set_xticks([0, 0.5, 1])
    axes.set_yticks([0, 0.5, 1])
    return lines


def checks(plane: Plane) -> dict[str, Any]:
    """What the seed states of figure 2, as numbers."""
    tau = plane.sigma_t_per_mm * planes.BASE.thickness_mm
    edge = plane.white[0] / RHO_WHITE
    thin = tau <= 2.0
    exponent = -np.log(edge[thin]) / tau[thin]
    opaque = nearest(plane.sigma_t_per_mm, 1e9)
    spread = np.hypot(plane.black[:, 0] - RHO_BLACK, plane.white[:, 0] - RHO_WHITE)
    return {
        "uniqueness": planes.uniqueness(plane),
        "coverage": planes.coverage(plane),
        "median_relative_standard_error": planes.median_relative_error(plane),
        "diagonal": {
            "sigma_t_per_mm": float(plane.sigma_t_per_mm[opaque]),
            "largest_white_minus_black": float((plane.white - plane.black)[:-1, opaque].max()),
            "white_minus_black_at_albedo_1": float((plane.white - plane.black)[-1, opaque]),
            "sigma_t_per_mm_beyond_which_doubling_it_moves_less_than_0.01": {
                f"albedo_{albedo:g}": _indistinct(plane, albedo)
                for albedo in (0.5, 0.9, 0.99, 0.999)
            },
            "black_at_the_diagonal": {
                f"albedo_{albedo:g}": float(plane.line(albedo=albedo)[0, -1])
                for albedo in CONTOUR_ALBEDO[1:]
            },
        },
        "corner_of_transparency": {
            "sigma_t_per_mm": float(plane.sigma_t_per_mm[0]),
            "largest_distance_from_bare_backgrounds": float(spread.max()),
        },
        "left_edge": {
            "largest_black": float(plane.black[0].max()),
            "exponent_per_optical_thickness_smallest": float(exponent[1:].min()),
            "exponent_per_optical_thickness_largest": float(exponent[1:].max()),
            "exponent_of_both_passes_at_45_degrees": 1.0 + np.sqrt(2.0),
        },
        "top_edge": planes.along(plane, 1.0),
    }


def _indistinct(plane: Plane, albedo: float) -> float | None:
    """The sigma_t [1/mm] from which on a doubling moves the point by less than `SAME_POINT`."""
    grid = plane.sigma_t_per_mm
    black, white = plane.line(albedo=albedo)
    doubled = [np.interp(np.log(2.0 * grid), np.log(grid), values) for values in (black, white)]
    far = np.hypot(doubled[0] - black, doubled[1] - white) >= SAME_POINT
    known = 2.0 * grid <= grid[-1] * 1.001
    last = np.flatnonzero(far & known)
    if last.size == 0 or last[-1] + 1 >= int(known.sum()):
        return None
    return float(grid[last[-1] + 1])


def similarity(spectra: tuple[Curve, ...], results: Mapping[Point, Blocks]) -> dict[str, float]:
    """Largest distance between a material's own point and its equivalent at the map's g."""
    return {
        curve.title: float(
            np.hypot(*(positions(curve.own, results) - positions(curve.equivalent, results))).max()
        )
        for curve in spectra
    }
