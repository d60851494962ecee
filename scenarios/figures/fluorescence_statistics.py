"""Figures 7 and 8 of chapter 5: errors by set-up, and colour differences over wavelength."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.figures.fluorescence_runs import METHODS, SETUPS, Run, errors
from scenarios.report.figure import BLUE, GREY, INK, ORANGE, VERMILION, new_figure, plain_ticks
from twin.fluorescence import GRID_NM
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# The seed drew its own method orange and the peer blue.
COLOURS = {"gmm-adam": ORANGE, "blasinski": BLUE, "donaldson": VERMILION}
LABELS = {
    "gmm-adam": "gmm-adam (the seed's method)",
    "blasinski": "blasinski (tuned on known materials)",
    "donaldson": "donaldson (ours)",
}
QUANTITIES = ("fluorescence", "reflectance")


def draw_figure7(runs: Sequence[Run]) -> tuple[Figure, dict[str, Any]]:
    """RMSE box plots by set-up and number of fluorophores, and their medians.

    Returns:
        The figure, and `median` [quantity][fluorophores][set-up][method], `outliers` (beyond 1.5
        times the box), `floor` (predicting no fluorescence), and `ratio` of medians.
    """
    figure = new_figure(11.0, 6.6)
    axes = figure.subplots(2, 2, sharex=True)
    setups = [name for name in SETUPS if any(run.setup == name for run in runs)]
    checks: dict[str, Any] = {"median": {}, "outliers": {}, "floor": {}, "ratio": {}}
    for row, quantity in enumerate(QUANTITIES):
        for column, count in enumerate((1, 2)):
            panel = axes[row, column]
            medians: dict[str, dict[str, float]] = {}
            outliers: dict[str, int] = dict.fromkeys(METHODS, 0)
            floors = []
            for place, setup in enumerate(setups):
                run = _find(runs, setup, count)
                medians[setup] = {}
                for number, method in enumerate(METHODS):
                    value = errors(run.matrix[method], run.truth)[row]
                    medians[setup][method] = float(np.median(value))
                    outliers[method] += _box(
                        panel, value, place + 0.27 * (number - 1), 0.23, COLOURS[method]
                    )
                floor = errors(np.zeros_like(run.truth), run.truth)[0]
                floors.append(float(np.median(floor)))
            key = f"{count}_fluorophore{'s' if count > 1 else ''}"
            checks["median"].setdefault(quantity, {})[key] = medians
            checks["outliers"].setdefault(quantity, {})[key] = outliers
            checks["ratio"].setdefault(quantity, {})[key] = {
                other: {s: m["donaldson"] / m[other] for s, m in medians.items()}
                for other in METHODS[:-1]
            }
            checks["ratio"][quantity][key]["gmm-adam over blasinski"] = {
                s: m["gmm-adam"] / m["blasinski"] for s, m in medians.items()
            }
            if row == 0:
                checks["floor"][key] = float(np.mean(floors))
                panel.axhline(np.mean(floors), color=GREY, lw=0.8, ls=(0, (1, 2)))
                panel.text(
                    0.01, np.mean(floors), "predicting no fluorescence", fontsize=7.5, color=GREY,
                    va="bottom", transform=panel.get_yaxis_transform(),
                )  # fmt: skip
                panel.set_title(f"{('one fluorophore', 'two fluorophores')[column]}")
            panel.set_yscale("log")
            panel.set_xticks(range(len(setups)), [name.upper() for name in setups])
            panel.grid(False, axis="x")
            if column == 0:
                panel.set_ylabel(f"RMSE of the {quantity} [–]")
    for row in range(2):
        low = min(axes[row, column].get_ylim()[0] for column in range(2))
        high = max(axes[row, column].get_ylim()[1] for column in range(2))
        for column in range(2):
            axes[row, column].set_ylim(low, high)
            plain_ticks(axes[row, column])
    _legend(figure)
    return figure, checks


def draw_figure8(runs: Sequence[Run]) -> tuple[Figure, dict[str, Any]]:
    """CIEDE2000 under monochromatic light over its wavelength: L1-S1, one fluorophore.

    Returns:
        The figure, and medians over materials by method: of all wavelengths, of 400 to 500 nm, of
        600 to 700 nm, and at how many of the 31 wavelengths each method is the best.
    """
    from estimators.fluorescence.colour import monochromatic_difference

    run = _find(runs, "l1-s1", 1)
    figure = new_figure(11.0, 6.4)
    axes = figure.subplots(len(METHODS), 1, sharex=True, sharey=True)
    middle: dict[str, FloatArray] = {}
    for panel, method in zip(axes, METHODS, strict=True):
        found = monochromatic_difference(run.matrix[method], run.truth, GRID_NM)
        middle[method] = np.median(found, axis=0)
        for place, wavelength in enumerate(GRID_NM):
            value = np.maximum(found[:, place], 1e-3)
            _box(panel, value, float(wavelength), 6.5, COLOURS[method])
        panel.axhline(1.0, color=INK, lw=0.7, ls=(0, (1, 2)))
        panel.set_title(LABELS[method])
        panel.set_yscale("log")
        panel.set_ylabel("CIEDE2000 [–]")
        panel.grid(False, axis="x")
    axes[0].text(703.0, 1.05, "1", ha="right", va="bottom", fontsize=7.5)
    axes[-1].set_xticks(GRID_NM[::5], [f"{w:g}" for w in GRID_NM[::5]])
    axes[-1].set_xlim(393.0, 707.0)
    axes[-1].set_xlabel("Wavelength of the light [nm]")
    plain_ticks(axes[0])
    best = np.argmin([middle[method] for method in METHODS], axis=0)
    checks = {
        "median": {m: float(np.median(v)) for m, v in middle.items()},
        "median_400_500": {m: float(np.median(v[:11])) for m, v in middle.items()},
        "median_600_700": {m: float(np.median(v[20:])) for m, v in middle.items()},
        "best_at": {m: int((best == k).sum()) for k, m in enumerate(METHODS)},
        "gmm_better_than_blasinski_at": int((middle["gmm-adam"] < middle["blasinski"]).sum()),
    }
    return figure, checks


def _find(runs: Sequence[Run], setup: str, count: int) -> Run:
    return next(run for run in runs if (run.setup, run.fluorophores) == (setup, count))


def _box(axes: Axes, value: FloatArray, at: float, width: float, colour: str) -> int:
    """One box plot (quartiles, median, whiskers to 1.5 boxes, plus signs beyond); its outliers."""
    drawn = axes.boxplot(
        value, positions=[at], widths=width, patch_artist=True, manage_ticks=False,
        boxprops={"facecolor": colour, "edgecolor": INK, "linewidth": 0.5, "alpha": 0.85},
        medianprops={"color": INK, "linewidth": 1.1}, whiskerprops={"linewidth": 0.6},
        capprops={"linewidth": 0.6},
        flierprops={"marker": "+", "markersize": 4, "markeredgecolor": INK, "markeredgewidth": 0.6},
    )  # fmt: skip
    return sum(len(line.get_ydata()) for line in drawn["fliers"])


def _legend(figure: Figure) -> None:
    from matplotlib.patches import Patch

    handles = [Patch(facecolor=COLOURS[m], edgecolor=INK, label=LABELS[m]) for m in METHODS]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(METHODS))
