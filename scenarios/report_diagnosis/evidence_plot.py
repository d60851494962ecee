"""Which effect: evidence of every candidate, and which of them can be told apart."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from diagnosis import TOLD_APART, Diagnosis, Posterior, PriorOdds, Problem
from diagnosis.attribution import log_priors
from scenarios.report.figure import (
    BLUE,
    GREEN,
    GREY,
    INK,
    VERMILION,
    figure_style,
    literal,
    new_figure,
    plain_ticks,
    svg_of,
)
from scenarios.report_diagnosis.residual_plot import as_vectors
from scenarios.report_diagnosis.words import group_of, percent
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LEAST = -2.0
"""Decades of evidence against an effect at which bars end."""
WIDE = 20.0
"""Decades beyond which the axis is logarithmic."""
MOST_IN_MAP = 30


def draw_evidence(problem: Problem, found: Diagnosis) -> str | None:
    """Decades of evidence for every effect alone, those that cannot be judged greyed."""
    if found.posterior is None or not found.posterior.tested:
        return None
    decades = _decades(problem, found.posterior)
    probability = {effect.name: effect.probability for effect in found.effects}
    order = sorted(decades, key=lambda name: decades[name])
    hidden = [each.name for each in found.not_identifiable]
    names = [*reversed(hidden), *order]
    leading = set(found.leading)
    group = set(group_of(found)) | {n for g in found.groups for n in g}
    with figure_style():
        figure = new_figure(11.0, 1.2 + 0.2 * len(names))
        axis = figure.subplots()
        top = max([1.0, *decades.values()])
        for place, name in enumerate(names):
            if name not in decades:
                axis.barh(place, top - LEAST, 0.72, LEAST, color="#eef0f3")
                axis.annotate(
                    "cannot be judged with these data", (0.0, place), (4.0, 0.0),
                    textcoords="offset points", va="center", color=GREY, fontsize=7.5,
                )  # fmt: skip
                continue
            value = max(decades[name], LEAST)
            colour = VERMILION if name in leading else BLUE if name in group else "#9db4c8"
            axis.barh(place, value, 0.72, color=colour)
            if probability.get(name, 0.0) >= 0.01:
                axis.annotate(
                    percent(probability[name]), (max(value, 0.0), place), (4.0, 0.0),
                    textcoords="offset points", va="center", fontsize=8.0,
                    fontweight="bold" if name in leading else "normal",
                )  # fmt: skip
        axis.axvline(0.0, color=INK, lw=0.8)
        axis.set_yticks(range(len(names)))
        axis.set_yticklabels([literal(name) for name in names])
        for label, name in zip(axis.get_yticklabels(), names, strict=True):
            label.set_color(GREY if name not in decades else INK)
        axis.tick_params(axis="y", length=0)
        axis.set_ylim(-0.7, len(names) - 0.3)
        if top > WIDE:
            axis.set_xscale("symlog", linthresh=1.0)
            plain_ticks(axis, "x")
            axis.set_xticks([LEAST, -1.0, 0.0, *(10.0**k for k in range(int(np.log10(top)) + 1))])
        axis.set_xlim(LEAST, 1.7 * top if top > WIDE else top + 0.12 * (top - LEAST))
        axis.set_xlabel("Evidence for the effect alone, against none [decades of the Bayes factor]")
        axis.grid(axis="y", visible=False)
        return svg_of(figure, "evidence", "Evidence of every effect of the catalogue.")


def _decades(problem: Problem, posterior: Posterior) -> dict[str, float]:
    prior = log_priors(problem, posterior.tested, PriorOdds())
    gain = (posterior.log_weight - prior) / np.log(10.0)
    return {
        problem.candidates[h[0]].name: float(gain[i])
        for i, h in enumerate(posterior.tested)
        if len(h) == 1 and np.isfinite(gain[i])
    }


def draw_separations(found: Diagnosis) -> str | None:
    """How far apart effects are at three prior scales, look-alikes beside each other."""
    between = found.separations
    if between is None or not found.effects:
        return None
    shown = [effect.name for effect in found.effects][:MOST_IN_MAP]
    index = [found.names.index(name) for name in shown]
    if len(index) < 2:
        return None
    distance = between.separation[np.ix_(index, index)]
    alike = np.minimum(distance, distance.T)
    np.fill_diagonal(alike, 0.0)
    order = _neighbours(alike)
    names = [shown[i] for i in order]
    seen = alike[np.ix_(order, order)]
    with figure_style():
        size = 2.2 + 0.24 * len(names)
        figure = new_figure(min(max(size + 1.2, 8.6), 11.0), min(size, 9.6))
        axis = figure.subplots()
        places = np.arange(len(names) + 1) - 0.5
        image = axis.pcolormesh(
            places, places, seen, cmap="viridis", vmin=0.0, vmax=3.0 * TOLD_APART, lw=0.0
        )
        axis.set_aspect("equal")
        axis.invert_yaxis()
        _frame_pairs(axis, seen)
        _frame_groups(axis, names, found)
        axis.set_xticks(range(len(names)))
        axis.set_yticks(range(len(names)))
        axis.set_xticklabels([literal(n) for n in names], rotation=90, fontsize=7.5)
        axis.set_yticklabels([literal(n) for n in names], fontsize=7.5)
        axis.tick_params(length=0)
        axis.grid(False)
        for spine in axis.spines.values():
            spine.set_visible(False)
        bar = figure.colorbar(image, ax=axis, shrink=0.6, pad=0.02, extend="max")
        bar.set_label("Separation at 3 prior scales [sd]")
        as_vectors(bar)
        bar.ax.axhline(TOLD_APART, color=VERMILION, lw=1.5)
        return svg_of(figure, "separations", "Separation of every pair of effects.")


def _neighbours(distance: FloatArray) -> list[int]:
    """An order in which look-alikes are neighbours (average linkage)."""
    from scipy.cluster.hierarchy import leaves_list, linkage
    from scipy.spatial.distance import squareform

    capped = np.minimum(distance, 1e3)
    return [int(i) for i in leaves_list(linkage(squareform(capped, checks=False), "average"))]


def _frame_pairs(axis: Axes, seen: FloatArray) -> None:
    """A circle on pairs that are not told apart."""
    rows, columns = np.nonzero(np.triu(seen < TOLD_APART, 1))
    for first, second in ((rows, columns), (columns, rows)):
        axis.plot(
            second, first, ls="", marker="o", ms=3.4, mfc="none", mec="#ffffff", mew=1.0
        )  # fmt: skip


def _frame_groups(axis: Axes, names: list[str], found: Diagnosis) -> None:
    """Marks the rows of the group that the verdict is about."""
    leading = set(found.leading)
    group = {n for g in found.groups for n in g} | set(group_of(found))
    for place, name in enumerate(names):
        if name in leading or name in group:
            colour = VERMILION if name in leading else GREEN
            axis.plot([-0.5, len(names) - 0.5], [place - 0.5] * 2, color=colour, lw=1.2)
            axis.plot([-0.5, len(names) - 0.5], [place + 0.5] * 2, color=colour, lw=1.2)
