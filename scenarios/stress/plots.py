"""Pictures of a stress test: errors, coverage, and where over the appearance map it goes wrong."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from scenarios.report.figure import (
    GREY,
    INK,
    MARKERS,
    PALE,
    SERIES,
    figure_style,
    new_figure,
    svg_of,
)
from scenarios.stress.score import COVERAGES, PARAMETERS, Answers, Score, errors_of, held_by
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LABELS = ("albedo, absolute", "extinction σt, relative", "g, absolute")
SHORT = ("albedo", "σt", "g")
COVERAGE_NAMES = tuple(f"{100 * level:g} %" for level in COVERAGES)


def draw_errors(truth: FloatArray, answers: Mapping[str, Answers], name: str) -> str:
    """Absolute errors of every estimator: median, half and nine tenths of the points.

    Args:
        truth: shape (N, 3).
        answers: by estimator.
        name: prefix of the ids in the picture.

    Returns:
        An inline SVG.
    """
    with figure_style():
        figure = new_figure(10.0, 1.1 + 0.42 * len(answers))
        axes = figure.subplots(1, 3, sharey=True)
        for index, axis in enumerate(np.atleast_1d(axes)):
            for row, (_title, own) in enumerate(answers.items()):
                error = np.abs(errors_of(truth, own.value)[:, index][own.claimed[:, index]])
                error = error[np.isfinite(error) & (error > 0)]
                if error.size == 0:
                    axis.annotate(
                        "not estimated", (0.02, row), xycoords=("axes fraction", "data"),
                        color=GREY, va="center", fontsize=8.0,
                    )  # fmt: skip
                    continue
                q = np.quantile(error, [0.05, 0.25, 0.5, 0.75, 0.95])
                colour = SERIES[row % len(SERIES)]
                axis.plot(q[[0, 4]], [row, row], color=colour, lw=1.4, alpha=0.55)
                axis.plot(q[[1, 3]], [row, row], color=colour, lw=7.0, solid_capstyle="butt")
                axis.plot([q[2]], [row], marker="|", ms=13, mew=2.2, color=INK)
            axis.set_xscale("log")
            _decades(axis.xaxis)
            axis.set_title(LABELS[index])
            axis.set_xlabel("absolute error")
            axis.set_ylim(len(answers) - 0.5, -0.5)
            axis.margins(x=0.08)
            axis.grid(axis="y", visible=False)
        first = np.atleast_1d(axes)[0]
        first.set_yticks(range(len(answers)), list(answers))
        return svg_of(figure, name, "Absolute errors of every estimator")


def draw_coverage(scores: Mapping[str, Score], name: str) -> str:
    """Share of the intervals that hold the truth against what they promise; an inline SVG."""
    with figure_style():
        figure = new_figure(10.0, 3.0)
        axes = figure.subplots(1, 3, sharey=True)
        wide = 0.62 / max(1, len(scores))
        for index, (parameter, axis) in enumerate(zip(PARAMETERS, axes, strict=True)):
            for place, level in enumerate(COVERAGES):
                axis.plot([place - 0.42, place + 0.42], [100 * level] * 2, color=INK, lw=1.2)
            for number, score in enumerate(scores.values()):
                colour, marker = SERIES[number % len(SERIES)], MARKERS[number % len(MARKERS)]
                for place, share in enumerate(score.parameters[parameter].coverage):
                    if not share.total:
                        continue
                    x = place + (number - (len(scores) - 1) / 2) * wide
                    low, high = share.interval
                    axis.plot([x, x], [100 * low, 100 * high], color=colour, lw=1.6)
                    axis.plot([x], [100 * share.value], marker=marker, ms=5.5, color=colour)
            axis.set_title(SHORT[index])
            axis.set_xticks(range(len(COVERAGES)), COVERAGE_NAMES)
            axis.set_xlabel("promised")
            axis.set_ylim(0, 102)
            axis.grid(axis="x", visible=False)
        axes[0].set_ylabel("intervals that hold the truth [%]")
        handles = [
            axes[0].plot([], [], color=SERIES[i % len(SERIES)], marker=MARKERS[i % len(MARKERS)])[0]
            for i in range(len(scores))
        ]
        figure.legend(handles, list(scores), loc="outside lower center", ncols=min(6, len(scores)))
        return svg_of(figure, name, "Coverage of the intervals, promised and found")


def draw_heat(
    truth: FloatArray, thickness_mm: float, answers: Answers, ceilings: tuple[float, ...], name: str
) -> str:
    """Where over the appearance map one estimator errs, misses and fails.

    Args:
        truth: shape (N, 3).
        thickness_mm: the thickness [mm] of the optical thickness.
        answers: of the estimator.
        ceilings: greatest value of each colour scale of the errors, so that estimators compare.
        name: prefix of the ids in the picture.

    Returns:
        An inline SVG.
    """
    depth, cell = optical_cells(truth, thickness_mm)
    shape = (len(depth[1]) - 1, len(depth[0]) - 1)
    with figure_style():
        figure = new_figure(10.0, 3.3)
        axes = figure.subplots(1, 5, sharey=True)
        error = np.abs(errors_of(truth, answers.value))
        for index in range(3):
            kept = answers.claimed[:, index]
            table = by_cell(np.where(kept, error[:, index], np.nan), cell, shape)
            _heat(axes[index], depth, table, ceilings[index], f"|error| {SHORT[index]}", log=True)
        claimed = answers.claimed
        missed = claimed & ~held_by(truth, answers, COVERAGES.index(0.9))
        share = np.where(
            claimed.any(axis=1), missed.sum(axis=1) / np.maximum(claimed.sum(axis=1), 1), np.nan
        )
        table = by_cell(share, cell, shape, mean=True)
        _heat(axes[3], depth, 100 * table, 50.0, "outside 90 % [%]", log=False)
        lost = by_cell((~answers.claimed.all(axis=1)).astype(float), cell, shape, mean=True)
        _heat(axes[4], depth, 100 * lost, 100.0, "not determined [%]", log=False)
        axes[0].set_ylabel("1 − albedo")
        axes[2].set_xlabel(f"optical thickness σt · {thickness_mm:g} mm")
        return svg_of(figure, name, "Errors, misses and failures over the appearance map")


def optical_cells(
    truth: FloatArray, thickness_mm: float
) -> tuple[tuple[FloatArray, FloatArray], NDArray[np.int64]]:
    """Cells over optical thickness and absorbed share that hold about six points each.

    Args:
        truth: (albedo, sigma_t [1/mm], g), shape (N, 3).
        thickness_mm: makes sigma_t an optical thickness [mm].

    Returns:
        Edges of both axes, and row and column of every point, shape (2, N).
    """
    x, y = np.log10(truth[:, 1] * thickness_mm), np.log10(1.0 - truth[:, 0])
    count = int(np.clip(np.sqrt(len(truth) / 6.0), 3, 14))
    edges = [np.linspace(v.min() - 1e-9, v.max() + 1e-9, count + 1) for v in (x, y)]
    places = [
        np.clip(np.searchsorted(e, v, side="right") - 1, 0, count - 1)
        for e, v in zip(edges, (x, y), strict=True)
    ]
    return (10.0 ** edges[0], 10.0 ** edges[1]), np.stack([places[1], places[0]])


def by_cell(
    values: FloatArray, cell: NDArray[np.int64], shape: tuple[int, int], *, mean: bool = False
) -> FloatArray:
    """Median (or mean) of values (N,) in every cell, shape `shape`; NaN where there is none."""
    table = np.full(shape, np.nan)
    for row in range(shape[0]):
        for column in range(shape[1]):
            mine = values[(cell[0] == row) & (cell[1] == column)]
            mine = mine[np.isfinite(mine)]
            if mine.size:
                table[row, column] = mine.mean() if mean else np.median(mine)
    return table


def _heat(
    axis: Axes,
    edges: tuple[FloatArray, FloatArray],
    table: FloatArray,
    ceiling: float,
    title: str,
    *,
    log: bool,
) -> None:
    from matplotlib.colors import LogNorm, Normalize

    norm: Any = LogNorm(ceiling / 1000, ceiling) if log else Normalize(0, ceiling)
    axis.set_facecolor(PALE)
    mesh = axis.pcolormesh(
        *edges, np.ma.masked_invalid(table), norm=norm, cmap="viridis" if log else "magma_r"
    )
    axis.set_xscale("log")
    axis.set_yscale("log")
    _decades(axis.xaxis, thirds=True)
    _decades(axis.yaxis)
    axis.grid(visible=False)
    axis.set_title(title, fontsize=9.0)
    bar = axis.figure.colorbar(mesh, ax=axis, orientation="horizontal", aspect=14, pad=0.05)
    # As paths: the page shows no images.
    if bar.solids is not None:
        bar.solids.set_rasterized(False)
        bar.solids.set_edgecolor("face")
    if log:
        _decades(bar.ax.xaxis)


def _decades(axis: Any, *, thirds: bool = False) -> None:
    """Label full decades only (or 1 and 3 of each): labels between them run into each other."""
    from matplotlib.ticker import (
        FuncFormatter,
        LogFormatterMathtext,
        LogLocator,
        NullFormatter,
    )

    axis.set_major_locator(LogLocator(subs=(1.0, 3.0) if thirds else (1.0,), numticks=5))
    plain = FuncFormatter(lambda value, _: f"{value:g}")
    axis.set_major_formatter(plain if thirds else LogFormatterMathtext())
    axis.set_minor_formatter(NullFormatter())
