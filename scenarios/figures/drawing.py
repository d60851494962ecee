"""What the figures have in common: style, files, contours of a plane of the map."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.figures.planes import Plane
from scenarios.report.figure import GREY, INK, VERMILION, figure_style
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PNG_DPI = 110
ALBEDO_LINE, SIGMA_LINE = "#5b6470", VERMILION
DASHES = (0, (4, 2))


@contextmanager
def style() -> Iterator[None]:
    """The report's style for files that stand alone: white ground, letters as outlines."""
    import matplotlib

    with figure_style():
        matplotlib.rcParams.update(
            {
                "svg.fonttype": "path",
                "svg.hashsalt": "benchtwin figures",
                "figure.facecolor": "white",
                "savefig.facecolor": "white",
            }
        )
        yield


def file_bytes(figure: Figure) -> dict[str, bytes]:
    """The figure as SVG and PNG; the same figure gives the same bytes."""
    svg, png = io.BytesIO(), io.BytesIO()
    figure.savefig(svg, format="svg", metadata={"Date": None, "Creator": None})
    figure.savefig(
        png, format="png", dpi=PNG_DPI, metadata={"Software": None}, pil_kwargs={"optimize": True}
    )
    return {"svg": _shorter(svg.getvalue().decode()).encode(), "png": png.getvalue()}


def _shorter(svg: str) -> str:
    """Coordinates of paths to a hundredth of a point."""

    def rounded(number: re.Match[str]) -> str:
        return f"{float(number.group()):.2f}".rstrip("0").rstrip(".")

    def path(match: re.Match[str]) -> str:
        return re.sub(r"-?\d+\.\d{3,}", rounded, match.group())

    # the letters' outlines are drawn to another scale and stay as they are
    head, mark, body = svg.partition('<g id="figure_1">')
    return head + mark + re.sub(r'\bd="[^"]*"', path, body)


def smooth(points: FloatArray, per_interval: int = 4) -> FloatArray:
    """A monotone cubic over the points' index (Fritsch and Carlson 1980), (2, S) to (2, N)."""
    from scipy.interpolate import PchipInterpolator

    count = points.shape[1]
    node = np.arange(count)
    fine = np.linspace(0.0, count - 1.0, per_interval * (count - 1) + 1)
    return np.stack([PchipInterpolator(node, values)(fine) for values in points])


def draw_contours(
    axes: Axes,
    plane: Plane,
    albedos: Sequence[float],
    sigmas: Sequence[float],
    *,
    faint: bool = False,
) -> None:
    """Contours of constant albedo (solid) and of constant sigma_t (dashed)."""
    width = 0.5 if faint else 0.9
    for albedo in albedos:
        x, y = smooth(plane.line(albedo=albedo), 1 if faint else 4)
        axes.plot(x, y, color="#b4bbc4" if faint else ALBEDO_LINE, lw=width, zorder=1)
    for sigma in sigmas:
        x, y = plane.line(sigma=sigma)
        axes.plot(x, y, color="#e6bfa3" if faint else SIGMA_LINE, lw=width, ls=DASHES, zorder=1)
    axes.plot([0, 1], [0, 1], color=GREY, lw=0.7, ls=(0, (1, 2)), zorder=0)


def name_contours(
    axes: Axes,
    plane: Plane,
    albedos: Sequence[float],
    sigmas: Sequence[float],
    *,
    left_below: float = 1.0,
    size: float = 7.5,
) -> None:
    """Write albedos where their contours meet the diagonal, and sigma_t at the other ends.

    Contours of sigma_t up to `left_below` [1/mm] are named at the left edge, the others at the
    top edge.
    """
    for albedo in albedos:
        x, y = plane.line(albedo=albedo)[:, -1]
        axes.annotate(
            f"{albedo:g}", (float(x), float(y)), (4, -4), textcoords="offset points",
            ha="left", va="top", fontsize=size, color=INK,
        )  # fmt: skip
    for sigma in sigmas:
        line = plane.line(sigma=sigma)
        left = sigma <= left_below
        x, y = line[:, 0] if left else line[:, -1]
        axes.annotate(
            f"{sigma:g}", (float(x), float(y)), (-3, 0) if left else (0, 3),
            textcoords="offset points", ha="right" if left else "center",
            va="center" if left else "bottom", fontsize=size, color="#a84300",
        )  # fmt: skip


def covered_bar(figure: Figure, mappable: Any, axes: Sequence[Axes], label: str) -> None:
    """A colour bar of vectors whose seams are covered."""
    bar = figure.colorbar(mappable, ax=list(axes), shrink=0.6, aspect=40, pad=0.03)
    bar.set_label(label)
    if bar.solids is not None:
        bar.solids.set_rasterized(False)
        bar.solids.set_edgecolor("face")


def square_map_axes(axes: Axes, low: float = -0.02, high: float = 1.06) -> None:
    """Equal scales from 0 to 1, ticks at fifths, no grid."""
    axes.set_xlim(low, high)
    axes.set_ylim(low, high)
    axes.set_aspect("equal")
    axes.set_xticks(np.arange(0.0, 1.01, 0.2))
    axes.set_yticks(np.arange(0.0, 1.01, 0.2))
    axes.grid(False)
