"""Figure 4: how refractive index, thickness and anisotropy deform the map."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.figures import planes
from scenarios.figures.drawing import draw_contours, name_contours, square_map_axes
from scenarios.figures.planes import Plane, plane_of, plane_points
from scenarios.figures.points import RHO_WHITE, Blocks, Point
from scenarios.report.figure import new_figure
from twin.transport.tables import fresnel

if TYPE_CHECKING:
    from matplotlib.figure import Figure

N = (1.0, 1.25, 1.5)
THICKNESS_MM = (0.25, 0.5, 1.0)
G = (0.0, 0.4, 0.8)
ALBEDOS = (0.0, 0.5, 0.8, 0.9, 0.95, 0.99, 0.999, 1.0)
SIGMAS = (0.2, 1.0, 5.0, 20.0)


def variants(quick: bool) -> list[tuple[str, str, tuple[Point, ...]]]:
    """Row, title and points of the nine planes."""
    rows = [("n", f"n = {n:.2f}", plane_points(quick, n=n)) for n in N]
    rows += [
        ("thickness", f"$\\ell$ = {t:g} mm", plane_points(quick, thickness_mm=t))
        for t in THICKNESS_MM
    ]
    rows += [("g", f"g = {g:g}", plane_points(quick, g=g)) for g in G]
    return rows


def points(quick: bool) -> tuple[Point, ...]:
    """Everything that the figure needs."""
    drawn = (point for _, _, plane in variants(quick) for point in plane)
    return (*drawn, *wide_points(quick))


def wide_points(quick: bool) -> tuple[Point, ...]:
    """Some points of n 1.5 on a bench so wide that no light is lost at its sides."""
    return tuple(
        replace(point, wider=100.0)
        for point in plane_points(quick, n=N[-1])
        if point.sigma_t_per_mm in (0.01, 0.1, 1.0, 10.0)
    )


def draw(results: Mapping[Point, Blocks], quick: bool) -> tuple[Figure, dict[str, Any]]:
    """The figure and its checks."""
    figure = new_figure(9.6, 9.6)
    panels = figure.subplots(3, 3, sharex=True, sharey=True)
    drawn: dict[str, list[Plane]] = {"n": [], "thickness": [], "g": []}
    for index, (axes, (row, title, wanted)) in enumerate(
        zip(panels.flat, variants(quick), strict=True)
    ):
        plane = plane_of(wanted, results)
        drawn[row].append(plane)
        draw_contours(axes, plane, ALBEDOS, SIGMAS)
        name_contours(axes, plane, ALBEDOS[1:], SIGMAS, left_below=1.0, size=6.8)
        square_map_axes(axes, -0.13, 1.1)
        axes.set_title(title)
        if index >= 6:
            axes.set_xlabel("$I_b$ [–]")
        if index % 3 == 0:
            axes.set_ylabel("$I_w$ [–]")
    figure.suptitle(
        "Solid: constant albedo. Dashed: constant $\\sigma_t$ [1/mm]."
        " Where not said otherwise: n = 1.0, $\\ell$ = 0.5 mm, g = 0.4.",
        fontsize=9.0, x=0.02, ha="left",
    )  # fmt: skip
    return figure, {
        "n": {f"{n:g}": of_index(n, plane) for n, plane in zip(N, drawn["n"], strict=True)},
        "n_1.5_on_a_bench_100_times_wider": {
            "contour_of_albedo_1": planes.along(plane_of(wide_points(quick), results), 1.0)
        },
        "thickness_mm": {
            f"{t:g}": of_thickness(plane)
            for t, plane in zip(THICKNESS_MM, drawn["thickness"], strict=True)
        },
        "thickness_scaling_largest_shift": scaling(drawn["thickness"]),
        "g": {f"{g:g}": of_anisotropy(plane) for g, plane in zip(G, drawn["g"], strict=True)},
    }


def fresnel_alone(n: float) -> float:
    """I_white of a clear slab without light between slab and background.

    The slab is passed at 45 degrees on the way in and along the normal on the way out, its two
    faces with all reflections between them; the light that the slab sends back to the
    background and the background to the slab is left out.
    """
    passed = []
    for sine in (np.sqrt(0.5), 0.0):
        outside, inside = np.sqrt(1.0 - sine**2), np.sqrt(1.0 - (sine / n) ** 2)
        r = float(fresnel(1.0, n, np.array([outside]), np.array([inside]))[0])
        passed.append((1.0 - r) / (1.0 + r))
    return RHO_WHITE * passed[0] * passed[1]


def with_bounces(n: float) -> float:
    """The same with all light between slab and background, on an unbounded bench.

    R + T1 rho T2 / (1 - rho R') with R' the reflectance of the slab under Lambertian light.
    """
    nodes, weights = np.polynomial.legendre.leggauss(200)
    cosine = 0.5 * (nodes + 1.0)
    r = fresnel(1.0, n, cosine, np.sqrt(1.0 - (1.0 - cosine**2) / n**2))
    diffuse = float(np.sum(weights * cosine * 2.0 * r / (1.0 + r)))
    return fresnel_alone(n) / (1.0 - RHO_WHITE * diffuse)


def of_index(n: float, plane: Plane) -> dict[str, Any]:
    """The map's size, its top left corner, the hill, uniqueness."""
    return {
        "area": planes.coverage(plane)["area"],
        "share_above_albedo_0.9": planes.coverage(plane)["share_above_albedo_0.9"],
        "black_of_opaque_albedo_0.9": float(plane.line(albedo=0.9)[0, -1]),
        "corner_by_fresnel_alone": fresnel_alone(n),
        "corner_with_bounces": with_bounces(n),
        "contour_of_albedo_1": planes.along(plane, 1.0),
        "contour_of_albedo_0.99": planes.along(plane, 0.99),
        "uniqueness": planes.uniqueness(plane),
    }


def of_thickness(plane: Plane) -> dict[str, float]:
    """How far a few contours of sigma_t are from the diagonal, at albedo 0.9."""
    black, white = plane.line(albedo=0.9)
    return {"area": planes.coverage(plane)["area"]} | {
        f"white_minus_black_at_sigma_t_{sigma:g}": float(
            np.interp(np.log(sigma), np.log(plane.sigma_t_per_mm), white - black)
        )
        for sigma in SIGMAS
    }


def scaling(drawn: list[Plane]) -> float:
    """Largest move of a point when the thickness is doubled and sigma_t halved, of few events.

    Without the finite panels, backgrounds and gap there would be none.
    """
    thin, thick = drawn[0], drawn[-1]
    ratio = THICKNESS_MM[-1] / THICKNESS_MM[0]
    grid = np.log(thin.sigma_t_per_mm)
    inside = (grid >= grid[0] + np.log(ratio)) & (thin.sigma_t_per_mm * THICKNESS_MM[0] <= 2.0)
    shift = 0.0
    for row in range(len(thin.albedo)):
        moved = [
            np.interp(grid[inside] - np.log(ratio), grid, values[row])
            for values in (thick.black, thick.white)
        ]
        here = np.hypot(moved[0] - thin.black[row, inside], moved[1] - thin.white[row, inside])
        shift = max(shift, float(here.max()))
    return shift


def of_anisotropy(plane: Plane) -> dict[str, Any]:
    """The map's size, and where some contours of albedo meet the diagonal."""
    return {
        "area": planes.coverage(plane)["area"],
        "black_of_opaque_albedo_0.9": float(plane.line(albedo=0.9)[0, -1]),
        "black_at_sigma_t_1_albedo_1": float(
            np.interp(0.0, np.log(plane.sigma_t_per_mm), plane.line(albedo=1.0)[0])
        ),
        "uniqueness": planes.uniqueness(plane),
    }
