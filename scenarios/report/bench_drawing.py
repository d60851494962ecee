"""The bench drawn to scale from its description: the whole of it, and the stack close up."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from scenarios.report.figure import (
    BLUE,
    GREY,
    INK,
    ORANGE,
    VERMILION,
    figure_style,
    new_figure,
    svg_of,
)
from scenarios.report.stack_drawing import draw_stack, ruler
from twin.bench import Bench, Panel, Sample

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_DESCRIPTION = (
    "The bench from the side, to scale: diffuse panels above the sample, the detector's cone"
    " straight up, the background or the beam below; beside it the sample stack close up."
)


def draw_bench(bench: Bench, samples: Sequence[Sample]) -> str:
    """The bench as inline SVG: side view, and the stack with the panels lit and with the beam lit.

    Args:
        bench: description; every length in the picture is read from it.
        samples: the samples; the thinnest is drawn, the other thicknesses are named.

    Returns:
        An `<svg>` element.
    """
    thickness = sorted({sample.thickness_mm for sample in samples}) or [0.0]
    with figure_style():
        figure = new_figure(11.0, 5.4)
        grid = figure.add_gridspec(2, 2, width_ratios=(1.12, 1.0))
        _whole(figure.add_subplot(grid[:, 0]), bench)
        draw_stack(figure.add_subplot(grid[0, 1]), bench, thickness, beam=False)
        draw_stack(figure.add_subplot(grid[1, 1]), bench, thickness, beam=True)
        return svg_of(figure, "bench", _DESCRIPTION)


def panel_corners_mm(panel: Panel) -> np.ndarray:
    """The four corners of a panel, in order around it.

    Returns:
        Corners [mm], shape (4, 3). The panel faces the origin; its width lies in the plane of
        incidence, its length perpendicular to that plane (design: bench, frame and parts).
    """
    polar, azimuth = math.radians(panel.polar_deg), math.radians(panel.azimuth_deg)
    across = np.array(
        [math.cos(polar) * math.cos(azimuth), math.cos(polar) * math.sin(azimuth), -math.sin(polar)]
    )
    along = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
    signs = ((1, 1), (1, -1), (-1, -1), (-1, 1))
    centre = np.array(panel.centre_mm)
    return np.array(
        [
            centre + a * 0.5 * panel.width_mm * across + b * 0.5 * panel.length_mm * along
            for a, b in signs
        ]
    )


def _whole(axes: Axes, bench: Bench) -> None:
    """Side view (x-z plane): panels, their light, the detector's cone, the beam."""
    from matplotlib.patches import Polygon

    reach = max(float(np.abs(panel_corners_mm(panel)).max()) for panel in bench.panels)
    top = 1.2 * reach
    for panel in bench.panels:
        corners = panel_corners_mm(panel)[:, (0, 2)]
        ends = _far_apart(corners)
        lit = np.vstack([*ends, (0.0, 0.0)])
        axes.add_patch(Polygon(lit, color=ORANGE, alpha=0.13, lw=0))
        axes.add_patch(
            Polygon(
                corners, closed=True, facecolor=ORANGE, edgecolor=ORANGE, lw=4, joinstyle="miter"
            )
        )
    first = bench.panels[0]
    _label_panel(axes, first)
    for panel in bench.panels[1:]:
        _name_panel(axes, panel, "panel")
    cone = top * math.tan(math.radians(bench.detector.acceptance_deg))
    axes.add_patch(Polygon([(0, 0), (-cone, top), (cone, top)], color=BLUE, alpha=0.35, lw=0))
    axes.annotate(
        f"to the detector\ncone ±{bench.detector.acceptance_deg:g}°",
        (0, 0.8 * top), (8, 0), textcoords="offset points", va="top", color=BLUE,
    )  # fmt: skip
    width = bench.size_mm[0] if bench.size_mm else 1.3 * reach
    axes.plot([-width / 2, width / 2], [0, 0], color=INK, lw=3, solid_capstyle="butt")
    axes.annotate(
        "sample stack\n" + (f"{width:g} mm wide" if bench.size_mm else "unbounded"),
        (width / 2, 0), (10, 1), textcoords="offset points", va="center",
    )  # fmt: skip
    below = -0.3 * reach
    axes.annotate(
        "", (0, -0.02 * reach), (0, below),
        arrowprops={"arrowstyle": "-|>", "color": VERMILION, "lw": 1.4},
    )  # fmt: skip
    axes.annotate(
        f"beam ⌀ {bench.beam.diameter_mm:g} mm",
        (0, below), (8, 2), textcoords="offset points", va="bottom", color=VERMILION,
    )  # fmt: skip
    axes.set_xlim(-1.08 * reach, 1.08 * reach)
    axes.set_ylim(below * 1.1, top)
    ruler(axes, "x [mm]", "z [mm]")
    axes.set_title("The whole bench, from the side")


def _far_apart(points: np.ndarray) -> list[np.ndarray]:
    """The two points with the largest angle between them, seen from the origin."""
    angle = np.arctan2(points[:, 0], points[:, 1])
    return [points[int(np.argmin(angle))], points[int(np.argmax(angle))]]


def _label_panel(axes: Axes, panel: Panel) -> None:
    """Distance, angle and size of one panel."""
    x, _y, z = panel.centre_mm
    axes.plot([0, x], [0, z], color=GREY, lw=0.9, ls=(0, (4, 3)))
    axes.annotate(
        f"{panel.distance_mm:g} mm", (0.55 * x, 0.55 * z), (0, -13), textcoords="offset points",
        ha="left", color=INK,
        bbox={"facecolor": "white", "alpha": 0.8, "lw": 0, "pad": 1.0},
    )  # fmt: skip
    radius = 0.28 * panel.distance_mm
    polar = np.linspace(0, math.radians(panel.polar_deg), 40)
    side = math.copysign(1.0, x) if abs(x) > 1e-9 else 1.0
    axes.plot(side * radius * np.sin(polar), radius * np.cos(polar), color=GREY, lw=0.9)
    middle = math.radians(panel.polar_deg) / 2
    axes.annotate(
        f"{panel.polar_deg:g}°",
        (side * 1.08 * radius * math.sin(middle), 1.08 * radius * math.cos(middle)),
        ha="center", color=INK,
    )  # fmt: skip
    _name_panel(axes, panel, f"panel {panel.width_mm:g} × {panel.length_mm:g} mm")


def _name_panel(axes: Axes, panel: Panel, text: str) -> None:
    """A name above the panel's highest edge."""
    corners = panel_corners_mm(panel)
    x, z = corners[corners[:, 2] >= corners[:, 2].max() - 1e-9][:, (0, 2)].mean(axis=0)
    axes.annotate(text, (x, z), (0, 6), textcoords="offset points", ha="center", color=INK)


def lengths(bench: Bench, samples: Sequence[Sample]) -> list[tuple[str, str]]:
    """The drawing's lengths as rows of a table: what, how long."""
    rows: list[tuple[str, str]] = []
    same = itertools.groupby(bench.panels, key=lambda p: (p.width_mm, p.length_mm, p.distance_mm))
    for (width, length, distance), group in same:
        panels = list(group)
        angles = ", ".join(f"{p.polar_deg:g}°/{p.azimuth_deg:g}°" for p in panels)
        rows.append(
            (f"{len(panels)} diffuse panel(s)",
             f"{width:g} × {length:g} mm, {distance:g} mm away, polar/azimuth {angles}")
        )  # fmt: skip
    beam = bench.beam
    rows.append(("Beam", f"⌀ {beam.diameter_mm:g} mm, divergence ±{beam.divergence_deg:g}°"))
    detector = bench.detector
    rows.append(
        ("Measured spot", f"⌀ {detector.spot_panels_mm:g} mm (panels), "
         f"{detector.spot_beam_mm:g} mm (beam), cone ±{detector.acceptance_deg:g}°")
    )  # fmt: skip
    size = "unbounded" if bench.size_mm is None else "{:g} × {:g} mm".format(*bench.size_mm)
    covers = [layer.thickness_mm for layer in (*bench.covers_above, *bench.covers_below)]
    text = ", ".join(f"{value:g}" for value in covers)
    rows.append(("Stack", f"{size}; covers {text} mm" if covers else f"{size}; no covers"))
    for sample in samples:
        rows.append((f"Sample {sample.name}", f"{sample.thickness_mm:g} mm"))
    rows.append(("Air gap to the background", f"{bench.background.gap_mm:g} mm"))
    return rows
