"""What the report shows of effects: tables and a picture with one column for each entry."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from scenarios.report.figure import INK, figure_style, new_figure, svg_of
from scenarios.stress.cost import NINETY, Cost, costs_of, median, ok_share, stated_offsets
from scenarios.stress.parts import Case, Outcome
from scenarios.stress.plan import NONE, StressPlan
from scenarios.stress.score import PARAMETERS, Score
from twin.spectra import FloatArray

NAMES = {"albedo": "albedo", "sigma_t_per_mm": "σt", "g": "g"}
WIDEST_SIGMA = 5.0
"""Where the colours of the bias end [stated standard errors]."""


def entry_rows(plan: StressPlan) -> list[list[str]]:
    """Every effect of every entry: name, effect, values."""
    return [
        [name, effect, _shown(values)]
        for name, entry in plan.effects.items()
        for effect, values in entry.items()
    ]


def cost_sections(outcome: Outcome, scores: Mapping[Case, Score]) -> list[dict[str, Any]]:
    """One section for each bench and noise level; none without effects."""
    from markupsafe import Markup

    if not outcome.plan.effects:
        return []
    costs = {cost.case: cost for cost in costs_of(outcome, scores)}
    columns = [NONE, *outcome.plan.effects]
    found = []
    for number, (bench, noise) in enumerate(dict.fromkeys((c.bench, c.noise) for c in costs)):
        titles = [each.title for each in outcome.plan.estimators]
        cases = {t: [Case(bench, noise, t, effects) for effects in columns] for t in titles}
        biases = {t: np.array([_biases(outcome, case) for case in cases[t]]) for t in titles}
        coverages = {t: np.array([_coverages(scores[case]) for case in cases[t]]) for t in titles}
        least = sorted(titles, key=lambda t: (_worst(costs, cases[t]), titles.index(t)))
        found.append(
            {
                "id": f"effects{number}",
                "name": f"What effects cost: bench “{bench}”, noise × {noise:g}",
                "columns": columns,
                "picture": Markup(draw_costs(columns, biases, coverages, f"effects{number}")),
                "growth": [[t, "1", *_growth(costs, cases[t])] for t in least],
                "scores": [
                    [t, NAMES[name], *_cells(biases[t][:, index], coverages[t][:, index])]
                    for t in titles
                    for index, name in enumerate(PARAMETERS)
                    if np.isfinite(biases[t][:, index]).any()
                ],
                "said": [
                    [
                        t,
                        *(
                            f"{100 * ok_share(scores[case]).value:.0f} % · "
                            f"{100 * scores[case].overconfident.value:.0f} %"
                            for case in cases[t]
                        ),
                    ]
                    for t in titles
                ],
            }
        )
    return found


def draw_costs(
    columns: list[str],
    biases: Mapping[str, FloatArray],
    coverages: Mapping[str, FloatArray],
    name: str,
) -> str:
    """Heat maps of bias and coverage, estimators by effects, for every parameter.

    Args:
        columns: names of C entries.
        biases: median of estimate minus truth in stated errors by estimator, shape (C, 3).
        coverages: share of the 90 % intervals that hold, likewise.
        name: prefix of the ids in the picture.

    Returns:
        An inline SVG.
    """
    rows = list(biases)
    with figure_style():
        figure = new_figure(10.0, 2.2 + 0.62 * len(rows))
        axes = figure.subplots(2, 3, sharex=True, sharey=True)
        for index, parameter in enumerate(PARAMETERS):
            bias = np.array([biases[row][:, index] for row in rows])
            share = np.array([coverages[row][:, index] for row in rows])
            _cells_of(axes[0, index], bias, "RdBu_r", (-WIDEST_SIGMA, WIDEST_SIGMA), "{:+.1f}")
            _cells_of(axes[1, index], 100 * share, "magma", (0.0, 100.0), "{:.0f}")
            axes[0, index].set_title(f"{NAMES[parameter]}: bias [stated σ]")
            axes[1, index].set_title(f"{NAMES[parameter]}: 90 % intervals that hold [%]")
            axes[1, index].set_xticks(range(len(columns)), columns, rotation=30, ha="right")
        for row in axes:
            row[0].set_yticks(range(len(rows)), rows)
        return svg_of(figure, name, "Bias and coverage of every estimator with every effect")


def _cells_of(
    axis: Any, table: FloatArray, colours: str, ends: tuple[float, float], text: str
) -> None:
    """Coloured cells as paths (the page shows no images), each with its number."""
    import matplotlib

    height, width = table.shape
    x, y = np.arange(width + 1) - 0.5, np.arange(height + 1) - 0.5
    axis.pcolormesh(
        x, y, np.ma.masked_invalid(table), cmap=colours, vmin=ends[0], vmax=ends[1],
        edgecolors="white", linewidth=1.0,
    )  # fmt: skip
    axis.set_ylim(height - 0.5, -0.5)
    axis.grid(visible=False)
    scale = matplotlib.colormaps[colours]
    for row in range(height):
        for column in range(width):
            value = table[row, column]
            if not np.isfinite(value):
                axis.text(column, row, "–", ha="center", va="center", fontsize=8.0, color=INK)
                continue
            place = np.clip((value - ends[0]) / (ends[1] - ends[0]), 0.0, 1.0)
            red, green, blue, _ = scale(place)
            dark = 0.299 * red + 0.587 * green + 0.114 * blue < 0.5
            axis.text(
                column, row, text.format(value).replace("-", "−"), ha="center", va="center",
                fontsize=8.0, color="white" if dark else INK,
            )  # fmt: skip


def _biases(outcome: Outcome, case: Case) -> list[float]:
    """Median of estimate minus truth in stated errors, of the three parameters."""
    answers, truth = outcome.answers[case], outcome.design.material
    return [median(stated_offsets(truth[:, i], answers, i)) for i in range(len(PARAMETERS))]


def _coverages(score: Score) -> list[float]:
    return [score.parameters[name].coverage[NINETY].value for name in PARAMETERS]


def _growth(costs: Mapping[Case, Cost], cases: list[Case]) -> list[str]:
    found = [costs[case].error_growth for case in cases[1:]]
    return [f"{value:.2f}" if math.isfinite(value) else "–" for value in found]


def _worst(costs: Mapping[Case, Cost], cases: list[Case]) -> float:
    """Geometric mean over the entries; without a figure it comes last."""
    found = [costs[case].error_growth for case in cases[1:]]
    if not all(math.isfinite(value) and value > 0 for value in found):
        return math.inf
    return math.exp(math.fsum(math.log(value) for value in found) / len(found))


def _cells(bias: FloatArray, share: FloatArray) -> list[str]:
    return [
        f"{b:+.1f} σ · {100 * s:.0f} %".replace("-", "−") if math.isfinite(b) else "–"
        for b, s in zip(bias, share, strict=True)
    ]


def _shown(values: float | Mapping[str, float]) -> str:
    if isinstance(values, Mapping):
        return ", ".join(f"{name} = {value:g}" for name, value in values.items())
    return f"{values:g}"
