"""Pictures of a design study: cost against accuracy, what limits, predicted against actual."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from scenarios.design.verified import AGREES
from scenarios.design.wording import FIGURES, input_title
from scenarios.report.figure import (
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PURPLE,
    SERIES,
    VERMILION,
    figure_style,
    literal,
    new_figure,
    plain_ticks,
    svg_of,
)

if TYPE_CHECKING:
    from scenarios.design.study import Study

LEAST_SHARE = 0.02
MOST_DOTS = 3000
"""Dots beyond which the picture shows every n-th candidate."""


def draw_front(study: Study) -> str:
    """Score against price: every candidate, the front, the greedy path, what is compared."""
    found = study.found
    with figure_style():
        figure = new_figure(9.6, 4.6)
        axis = figure.subplots()
        every = max(1, len(found.score) // MOST_DOTS)
        axis.scatter(
            found.price_usd[::every], found.score[::every], s=7, color="#aab3be", linewidths=0,
            label="candidates", rasterized=False,
        )  # fmt: skip
        front = list(found.front)
        axis.step(
            found.price_usd[front], found.score[front], where="post", color=BLUE, marker="o", ms=4,
            label="Pareto front",
        )  # fmt: skip
        path = list(found.path)
        if len(path) > 1:
            axis.plot(
                found.price_usd[path], found.score[path], color=ORANGE, ls=(0, (4, 2)), marker=".",
                label="greedy path",
            )  # fmt: skip
        for number, (name, own, figures) in enumerate(study.compared):
            title = study.parts.assembly(name).title
            score = float((np.array(figures) / study.goal.targets.values).max())
            axis.plot(
                own.price(study.parts), score, marker="D", ms=8, ls="", mec=INK,
                color=(PURPLE, GREEN, VERMILION)[number % 3], label=literal(title),
            )  # fmt: skip
        answer = study.answer
        axis.plot(
            found.price_usd[answer], found.score[answer], marker="*", ms=15, ls="", mec=INK,
            color=VERMILION, label="answer",
        )  # fmt: skip
        actual = [each for each in study.verified if each.figures]
        if actual:
            axis.plot(
                [each.candidate.price(study.parts) for each in actual],
                [max(value / getattr(study.goal.targets, name)
                     for name, (value, _) in each.figures.items()) for each in actual],
                marker="X", ms=9, ls="", mec="white", color=INK, label="simulated",
            )  # fmt: skip
        axis.axhline(1.0, color=INK, lw=0.9)
        axis.annotate(
            "targets met below", (0.005, 1.0), xycoords=("axes fraction", "data"), ha="left",
            va="top", xytext=(0, -3), textcoords="offset points", fontsize=8.5,
        )  # fmt: skip
        axis.set_xscale("log")
        axis.set_yscale("log")
        plain_ticks(axis, "x")
        plain_ticks(axis, "y")
        axis.set_xlabel("Price [USD]")
        axis.set_ylabel("Largest uncertainty over its target [1]")
        axis.margins(0.04, 0.08)
        few = len(axis.get_legend_handles_labels()[0]) <= 6
        figure.legend(loc="outside upper left", ncols=6 if few else 4)
        return svg_of(figure, "front", "Cost against accuracy of all candidates.")


def draw_limits(study: Study) -> str:
    """Shares of the inputs in the variance behind every figure of the answer."""
    limits = study.limits
    inputs = list(
        dict.fromkeys(
            name for own in limits.values() for name, share in own.items() if share > LEAST_SHARE
        )
    )
    with figure_style():
        figure = new_figure(9.6, 0.9 + 0.5 * len(limits) + 0.1 * len(inputs))
        axis = figure.subplots()
        for row, own in enumerate(limits.values()):
            left = 0.0
            for number, name in enumerate(inputs):
                share = own.get(name, 0.0)
                axis.barh(
                    row, 100 * share, 0.6, 100 * left, color=SERIES[number % len(SERIES)],
                    hatch="" if number < len(SERIES) else "///", edgecolor="white",
                    label=literal(input_title(name)) if row == 0 else None,
                )  # fmt: skip
                left += share
            axis.barh(row, 100 * max(1 - left, 0.0), 0.6, 100 * left, color="#d9dee5")
        axis.set_yticks(range(len(limits)), [FIGURES[name] for name in limits])
        axis.invert_yaxis()
        axis.set_xlim(0, 100)
        axis.grid(axis="y", visible=False)
        axis.set_xlabel("Share of the variance [%]; grey: all others")
        figure.legend(loc="outside lower center", ncols=2)
        return svg_of(figure, "limits", "What limits the answer.")


def draw_verification(study: Study) -> str | None:
    """Actual over predicted errors of the simulated candidates."""
    good = [each for each in study.verified if not each.failure]
    if not good:
        return None
    labels = [
        f"{each.candidate.price(study.parts):g} USD\n{each.candidate.id(study.parts)}"
        for each in good
    ]
    with figure_style():
        figure = new_figure(9.6, 1.3 + 0.42 * len(good))
        axis = figure.subplots()
        axis.axvspan(
            *AGREES, color="#e5f2ea", zorder=0, label="agreement, {:g} to {:g}".format(*AGREES)
        )
        axis.axvline(1.0, color=INK, lw=0.8)
        for number, name in enumerate(("albedo", "σt", "g")):
            offset = 0.2 * (number - 1)
            places = np.arange(len(good)) + offset
            axis.plot(
                [each.ratio[number] for each in good], places, ls="", marker="o", ms=6,
                color=SERIES[number], label=f"{name}: actual error",
            )  # fmt: skip
            axis.plot(
                [each.width_ratio[number] for each in good], places, ls="", marker="|", ms=11,
                mew=2, color=SERIES[number], label=f"{name}: stated width",
            )  # fmt: skip
        axis.set_yticks(range(len(good)), labels)
        axis.set_ylim(len(good) - 0.5, -0.5)
        axis.margins(x=0.05)
        axis.grid(axis="y", visible=False)
        axis.set_xlabel("Ratio to the predicted one [1]")
        axis.tick_params(axis="y", color=GREY)
        figure.legend(loc="outside upper center", ncols=4)
        return svg_of(figure, "verified", "Predicted against simulated uncertainty.")
