"""Donaldson matrices as pictures: estimate, truth, difference, interval; excitation across."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from scenarios.report.figure import GREY, INK, figure_style, new_figure, svg_of
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from estimators.fluorescence import FluorescenceResult

CMAP, DIFFERENCE_CMAP, DIAGONAL = "viridis", "RdBu_r", "#c6ccd3"
LEVELS = 64
"""Steps of the colour scales."""
FINER = 5.0
"""Differences and widths get their own scale when they are this many times smaller."""
_DESCRIPTION = (
    "Fluorescence cells of the Donaldson matrix over excitation and emission wavelength: the"
    " estimate, the truth where it is known, their difference, and the width of the intervals."
)


def draw_matrices(result: FluorescenceResult, truth: FloatArray | None) -> str:
    """Estimate, truth, difference and interval width of the fluorescence, as inline SVG.

    Without a truth: estimate and interval width. The diagonal, a hundred times brighter, has a
    figure of its own and is grey here.

    Args:
        result: the estimate.
        truth: the true matrix on the estimate's wavelengths, (Wo, Wi), or None.
    """
    emission, excitation, below = result.emission_nm, result.excitation_nm, result.is_fluorescence
    width = result.interval[1] - result.interval[0]
    known = bool(np.isfinite(width).all())
    top = max(float(result.matrix[below].max()), 1e-6)
    if truth is not None:
        top = max(top, float(truth[below].max()))
    unit = f"Φ [energy per {float(emission[1] - emission[0]):g} nm bin, –]"
    panels: list[tuple[str, FloatArray, str, float, float, str]] = [
        ("Estimate", result.matrix, CMAP, 0.0, top, unit)
    ]
    if truth is not None:
        gap = result.matrix - truth
        panels.append(("Truth", truth, CMAP, 0.0, top, unit))
        reach = _reach(float(np.abs(gap[below]).max()), top)
        panels.append(
            ("Estimate minus truth", gap, DIFFERENCE_CMAP, -reach, reach, _label("ΔΦ", reach, top))
        )
    if known:
        reach = _reach(float(width[below].max()), top)
        panels.append(
            ("Width of the 90 % interval", width, CMAP, 0.0, reach, _label("width", reach, top))
        )
    columns = 2 if len(panels) > 1 else 1
    rows = -(-len(panels) // columns)
    with figure_style():
        figure = new_figure(11.0 if columns == 2 else 6.4, 4.75 * rows)
        axes = figure.subplots(rows, columns, squeeze=False)
        for spare in axes.flat[len(panels) :]:
            spare.set_visible(False)
        for panel, (title, value, cmap, low, high, label) in zip(axes.flat, panels, strict=False):
            mesh = picture(panel, value, emission, excitation, cmap, low, high)
            scale_bar(figure, mesh, panel, label, shrink=0.86, pad=0.02)
            lines = "#ffffff" if cmap == CMAP else GREY
            hatch(panel, result.undetermined & below, emission, excitation, lines)
            panel.set_title(title)
        return svg_of(figure, "matrix", _DESCRIPTION)


def _reach(largest: float, top: float) -> float:
    """End of the colour scale: that of the matrix, or a round part of it for small things."""
    for part in (50.0, 20.0, 10.0, FINER):
        if largest * part <= top:
            return top / part
    return top


def _label(name: str, reach: float, top: float) -> str:
    times = round(top / reach)
    scale = "the scale of the matrix" if times == 1 else f"scale {times} times finer"
    return f"{name} [–], {scale}"


def picture(
    axes: Axes,
    value: FloatArray,
    emission_nm: FloatArray,
    excitation_nm: FloatArray,
    cmap: str,
    low: float,
    high: float,
) -> Any:
    """Fluorescence cells as squares, the diagonal grey; returns the mesh for a colour bar."""
    import matplotlib
    from matplotlib.collections import PolyCollection

    below = emission_nm[:, None] > excitation_nm[None, :] + 1e-6
    on = np.abs(emission_nm[:, None] - excitation_nm[None, :]) < 1e-6
    # Only the cells that there are: a mesh would write every other one as an empty path too.
    cells = PolyCollection(
        list(_squares(below, emission_nm, excitation_nm)), array=value[below],
        cmap=matplotlib.colormaps[cmap].resampled(LEVELS), edgecolors="face", linewidths=0.6,
    )  # fmt: skip
    cells.set_clim(low, high)
    axes.add_collection(cells)
    squares = list(_squares(on, emission_nm, excitation_nm))
    axes.add_collection(PolyCollection(squares, facecolors=DIAGONAL, edgecolors="none"))
    half = float(emission_nm[1] - emission_nm[0]) / 2.0
    axes.set_xlim(float(excitation_nm[0]) - half, float(excitation_nm[-1]) + half)
    axes.set_ylim(float(emission_nm[0]) - half, float(emission_nm[-1]) + half)
    axes.set_aspect("equal")
    axes.grid(False)
    axes.set_xlabel("Excitation wavelength [nm]")
    axes.set_ylabel("Emission wavelength [nm]")
    return cells


def hatch(
    axes: Axes,
    flagged: NDArray[np.bool_],
    emission_nm: FloatArray,
    excitation_nm: FloatArray,
    colour: str,
) -> None:
    """Hatch flagged cells and say what that means."""
    if not flagged.any():
        return
    from matplotlib.patches import Rectangle

    step = float(emission_nm[1] - emission_nm[0])
    for column, excitation in enumerate(excitation_nm):
        rows = np.flatnonzero(flagged[:, column])
        for run in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1):
            if not run.size:
                continue
            axes.add_patch(
                Rectangle(
                    (float(excitation) - step / 2, float(emission_nm[run[0]]) - step / 2), step,
                    step * run.size, fill=False, hatch="////", edgecolor=colour, linewidth=0.0,
                )
            )  # fmt: skip
    axes.text(
        0.98, 0.03, "hatched: undetermined", transform=axes.transAxes, ha="right", va="bottom",
        fontsize=8.5, color=INK,
    )  # fmt: skip


def scale_bar(figure: Figure, mesh: Any, axes: Any, label: str, **options: Any) -> None:
    """A colour bar made of vectors, so that the page needs no pictures."""
    bar = figure.colorbar(mesh, ax=axes, **options)
    bar.set_label(label)
    bar.outline.set_visible(False)
    if bar.solids is not None:
        bar.solids.set_rasterized(False)
        bar.solids.set_edgecolor("face")


def _squares(
    which: NDArray[np.bool_], emission_nm: FloatArray, excitation_nm: FloatArray
) -> FloatArray:
    """Corners of cells [nm], shape (N, 4, 2)."""
    half = float(emission_nm[1] - emission_nm[0]) / 2.0
    row, column = np.nonzero(which)
    centre = np.stack([excitation_nm[column], emission_nm[row]], axis=1)
    corner = half * np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    return np.asarray(centre[:, None, :] + corner)
