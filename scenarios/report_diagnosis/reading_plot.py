"""Where the gap is in readings without a spectrum: one dot for every dilution and reading."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from diagnosis import Diagnosis, Problem
from diagnosis.where import Block, shows
from scenarios.report.figure import (
    BLUE,
    GREY,
    INK,
    VERMILION,
    figure_style,
    literal,
    new_figure,
    svg_of,
)
from scenarios.report_diagnosis.residual_plot import OUTLINED, holds, runs
from scenarios.report_diagnosis.words import SIGNIFICANT

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_LABELS = 30


def draw_readings(problem: Problem, found: Diagnosis) -> str | None:
    """Residuals of one wavelength by sample, before and after; significant blocks outlined."""
    if found.null is None:
        return None
    captures = list(dict.fromkeys(c.capture for c in problem.channels))
    samples = list(dict.fromkeys(c.sample for c in problem.channels))
    after = () if found.best is None else shows(problem, found.best)
    fits = [(found.null, VERMILION, "o", "before", found.where, -0.12)]
    if found.best is not None:
        name = "with " + " and ".join(found.leading)
        fits.append((found.best, BLUE, "s", name, after, 0.12))
    with figure_style():
        figure = new_figure(11.0, 1.2 + 1.6 * len(captures))
        axes = figure.subplots(len(captures), 1, sharex=True, squeeze=False)[:, 0]
        for row, capture in enumerate(captures):
            axis = axes[row]
            own = [i for i, c in enumerate(problem.channels) if c.capture == capture]
            place = np.array([samples.index(problem.channels[i].sample) for i in own])
            axis.axhspan(-2.0, 2.0, color="#eef0f3", zorder=0)
            axis.axhline(0.0, color=INK, lw=0.8)
            reach = 3.0
            for fit, colour, marker, label, _, aside in fits:
                seen = fit.residual.reshape(problem.value.shape)[0, own]
                seen = np.where(problem.valid[0, own], seen, np.nan)
                axis.vlines(place + aside, 0.0, seen, color=colour, lw=1.0, alpha=0.5)
                axis.plot(
                    place + aside, seen, ls="", marker=marker, ms=4.5, color=colour,
                    label=literal(label),
                )  # fmt: skip
                reach = max(reach, 1.25 * float(np.nanmax(np.abs(seen), initial=0.0)))
            axis.set_ylim(-reach, reach)
            axis.set_ylabel(f"{literal(capture)}\nresidual [sd]")
            axis.grid(axis="x", visible=False)
            for _, colour, _, _, blocks, _ in fits:
                _outline(axis, problem, samples, capture, blocks, colour, 0.94 * reach)
        axes[-1].set_xticks(range(len(samples)))
        turned = {"rotation": 90} if len(samples) > 8 else {}
        step = -(-len(samples) // MOST_LABELS)
        labels = [literal(n) if i % step == 0 else "" for i, n in enumerate(samples)]
        axes[-1].set_xticklabels(labels, **turned)
        axes[-1].set_xlim(-0.6, len(samples) - 0.4)
        handles, names = axes[0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside upper right", ncols=2, labelcolor=GREY)
        return svg_of(figure, "residual-maps", "Residuals of every reading before and after.")


def _outline(
    axis: Axes, problem: Problem, samples: list[str], capture: str, blocks: tuple[Block, ...],
    colour: str, half: float,
) -> None:  # fmt: skip
    """Frames around the significant blocks of one reading, the most significant solid."""
    from matplotlib.patches import Rectangle

    loud = [block for block in blocks if block.p < SIGNIFICANT][:OUTLINED]
    for number, block in enumerate(loud):
        own = sorted(
            {samples.index(c.sample) for c in problem.channels
             if c.capture == capture and holds(block, c)}
        )  # fmt: skip
        for start, stop in runs(own):
            axis.add_patch(
                Rectangle(
                    (start - 0.42, -half), stop - start - 0.16, 2.0 * half, fill=False,
                    edgecolor=colour, linewidth=1.8 if number == 0 else 0.9,
                    linestyle="-" if number == 0 else (0, (3, 2)),
                )
            )  # fmt: skip
