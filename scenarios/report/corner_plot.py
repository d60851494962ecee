"""Draws of the posterior at one wavelength, two parameters at a time, by the library `corner`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from estimators.result import EstimateResult
from scenarios.report.figure import BLUE, INK, VERMILION, figure_style, svg_of
from twin.errors import InputError
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LABELS = ("albedo", "extinction [1/mm]", "anisotropy g")
LEVELS = (0.393, 0.865)
"""Probability inside the contours: one and two standard deviations of a plane normal."""
LEAST_DRAWS = 50


def corner_figure(
    result: EstimateResult, wavelength_index: int, truth: Sequence[float] | None = None
) -> Figure:
    """Corner plot of (albedo, sigma_t [1/mm], g) at one wavelength.

    Args:
        result: an estimate with draws.
        wavelength_index: which wavelength, 0 to W - 1.
        truth: the true (albedo, sigma_t, g), drawn as lines.

    Raises:
        InputError: no draws, no such wavelength, or one without an estimate.
    """
    count = result.wavelength_nm.size
    if not 0 <= wavelength_index < count:
        raise InputError(
            f"wavelength {wavelength_index}", f"0 to {count - 1}", place="wavelength_index"
        )
    if result.draws is None:
        raise InputError("an estimate without draws", "a posterior", place="result.draws")
    draws = result.draws[:, wavelength_index]
    if len(draws) < LEAST_DRAWS or not np.isfinite(draws).all():
        raise InputError(
            f"no usable draws at {result.wavelength_nm[wavelength_index]:g} nm",
            f"{LEAST_DRAWS} finite draws or more",
            place="result.draws",
        )
    import corner  # type: ignore[import-untyped,unused-ignore]
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    with figure_style():
        # without a layout of its own: corner sets the places of its axes itself
        figure = Figure(figsize=(5.2, 5.2))
        FigureCanvasSVG(figure)
        corner.corner(
            draws,
            fig=figure,
            labels=list(LABELS),
            quantiles=[0.05, 0.5, 0.95],
            levels=LEVELS,
            range=_ranges(draws, truth),
            truths=None if truth is None else list(truth),
            truth_color=VERMILION,
            color=BLUE,
            bins=20,
            smooth=1.0,
            fill_contours=True,
            plot_density=False,
            # corner makes pictures of its points and shades, which the report's page refuses
            plot_datapoints=False,
            max_n_ticks=3,
            use_math_text=False,
            labelpad=0.08,
        )
        for axes in figure.axes:
            axes.grid(False)
        where = f"{result.wavelength_nm[wavelength_index]:g} nm"
        figure.text(0.97, 0.93, where, ha="right", va="top", color=INK, weight="bold")
        lines = "dashed: 5 %, 50 %, 95 %"
        figure.text(0.97, 0.89, lines, ha="right", va="top", color=INK, size=8.5)
        if truth is not None:
            figure.text(0.97, 0.855, "red: truth", ha="right", va="top", color=VERMILION, size=8.5)
    return figure


def _ranges(draws: FloatArray, truth: Sequence[float] | None) -> list[tuple[float, float]]:
    """Axes that hold all draws (D, 3) and the truth, with room around them."""
    points = draws if truth is None else np.vstack([draws, [truth]])
    points = points[np.isfinite(points).all(axis=1)]
    low, high = points.min(axis=0), points.max(axis=0)
    room = 0.03 * (high - low) + 1e-12
    return list(zip((low - room).tolist(), (high + room).tolist(), strict=True))


def draw_corner(
    result: EstimateResult, wavelength_index: int, truth: Sequence[float] | None = None
) -> str:
    """The corner plot as an inline `<svg>` element; arguments as in `corner_figure`."""
    with figure_style():
        figure = corner_figure(result, wavelength_index, truth)
        where = f"{result.wavelength_nm[wavelength_index]:g} nm"
        return svg_of(
            figure,
            f"corner-{wavelength_index}",
            f"Posterior of albedo, extinction coefficient and anisotropy factor at {where}",
        )
