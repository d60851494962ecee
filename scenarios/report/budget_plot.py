"""The uncertainty budget as a stacked plot: whose fault is the uncertainty, by wavelength."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from scenarios.report.figure import (
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PALE,
    PURPLE,
    SKY,
    VERMILION,
    figure_style,
    new_figure,
    svg_of,
    wavelength_axis,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from estimators.budget import UncertaintyBudget
    from twin.spectra import FloatArray

TITLES = {"albedo": "Albedo", "sigma_t_per_mm": "Extinction σt [1/mm]", "g": "Anisotropy g"}
COLOURS = (BLUE, VERMILION, GREEN, INK, ORANGE, PURPLE, SKY, GREY)
SMALL = 0.01
"""Share below which an input is not drawn by itself."""
FEWEST = 12
"""With fewer wavelengths, bars are drawn in place of areas."""


def draw_budget(budget: UncertaintyBudget) -> str:
    """Standard uncertainty of every parameter (above) and the shares of its variance (below).

    Inputs that nowhere reach `SMALL` are put together. Gaps: the parameter is not identifiable
    there.
    """
    shown = np.flatnonzero(np.nan_to_num(budget.share).max(axis=(0, 1)) >= SMALL)
    with figure_style():
        figure = new_figure(11.0, 5.4)
        axes = figure.subplots(
            2, len(budget.parameters), sharex=True, squeeze=False, height_ratios=(1.0, 1.9)
        )
        for column, name in enumerate(budget.parameters):
            top, bottom = axes[0, column], axes[1, column]
            top.set_title(TITLES[name])
            _uncertainty(top, budget, column)
            _shares(bottom, budget, column, shown)
            wavelength_axis(bottom, budget.wavelength_nm)
            if budget.wavelength_nm.size < FEWEST:
                room = 0.5 * _spacing(budget.wavelength_nm)
                bottom.set_xlim(budget.wavelength_nm[0] - room, budget.wavelength_nm[-1] + room)
        axes[0, 0].set_ylabel("Standard uncertainty")
        axes[1, 0].set_ylabel("Share of variance [%]")
        if budget.monte_carlo is not None:
            axes[0, 0].legend(loc="best")
        handles, labels = axes[1, 0].get_legend_handles_labels()
        figure.legend(
            handles, labels, loc="outside lower center", ncols=min(4, len(labels)), frameon=False
        )
        return svg_of(
            figure, "budget", "Share of every input in the variance of albedo, sigma_t and g."
        )


def _spacing(wavelength_nm: FloatArray) -> float:
    """Least distance [nm] between two wavelengths, which bars must fit in."""
    return float(np.diff(wavelength_nm).min()) if wavelength_nm.size > 1 else 10.0


def _uncertainty(axes: Axes, budget: UncertaintyBudget, column: int) -> None:
    wavelength = budget.wavelength_nm
    marker = "o" if wavelength.size < FEWEST else ""
    total = budget.standard_uncertainty[column]
    axes.plot(wavelength, total, color=INK, marker=marker, ms=4, label="linear")
    if budget.monte_carlo is not None:
        axes.plot(
            wavelength, budget.monte_carlo[column], color=VERMILION, ls=(0, (4, 2)), lw=1.1,
            marker=marker, ms=3, label=f"{budget.draws} draws",
        )  # fmt: skip
    drawn = [total] if budget.monte_carlo is None else [total, budget.monte_carlo[column]]
    highest = max((float(np.nanmax(v)) for v in drawn if np.isfinite(v).any()), default=1.0)
    axes.set_ylim(0.0, 1.12 * highest)


def _shares(axes: Axes, budget: UncertaintyBudget, column: int, shown: NDArray[np.intp]) -> None:
    wavelength = budget.wavelength_nm
    share = 100.0 * np.nan_to_num(budget.share[column])
    known = np.isfinite(budget.share[column]).all(axis=1)
    hidden = np.setdiff1d(np.arange(len(budget.inputs)), shown)
    layers = [(budget.inputs[i], COLOURS[i], share[:, i]) for i in shown]
    if share[:, hidden].any():
        names = f"others, each below {100 * SMALL:g} %"
        layers.append((names, PALE, share[:, hidden].sum(axis=1)))
    bottom = np.zeros(wavelength.size)
    for name, colour, part in layers:
        style: dict[str, Any] = {"color": colour, "label": name, "alpha": 0.85, "linewidth": 0.0}
        if wavelength.size < FEWEST:
            width = 0.8 * _spacing(wavelength)
            axes.bar(wavelength, part, width, bottom, **style)
        else:
            axes.fill_between(wavelength, bottom, bottom + part, where=known, **style)
        bottom = bottom + part
    axes.set_ylim(0.0, 100.0)
    axes.grid(False)
