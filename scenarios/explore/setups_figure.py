"""Cost against accuracy of a design study's set-ups, as plain values for plotly."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from scenarios.explore.design import Beside, Design, SetUp
from scenarios.explore.figures import Figure, layout_of
from scenarios.report.figure import BLUE, GREEN, INK, PURPLE, VERMILION

ALL = "all targets"
WORDS = {
    "albedo": "Albedo", "sigma_t_relative": "σt, relative", "g": "g", "de2000": "CIEDE2000",
    "fluorescence_rmse": "Fluorescence RMSE", "fluorescence_de2000": "Fluorescence CIEDE2000",
}  # fmt: skip
OTHERS = "#b6bec8"


def front_figure(design: Design, own: SetUp, name: str) -> Figure:
    """Price against a figure: set-ups, front, target, the answer, the chosen one.

    Args:
        design: the study.
        own: the chosen set-up.
        name: a target, or `ALL` for the largest figure over its target.
    """

    def of(each: Any) -> float:
        return float(each.score if name == ALL else each.figures[name])

    target = 1.0 if name == ALL else design.targets[name]
    front, answer = design.front, design.setup(design.answer)
    others = [each for each in design.setups if not each.on_front]
    line: list[float] = []
    for each in front:
        line.append(min([of(each), *line[-1:]]))
    traces = [
        _dots(others, of, "one change at a time", {"size": 8, "color": OTHERS}),
        {
            "type": "scatter", "mode": "lines", "x": [each.price_usd for each in front], "y": line,
            "line": {"color": BLUE, "width": 1.6, "shape": "hv"}, "hoverinfo": "skip",
        },
        _dots(front, of, "Pareto front", {"size": 8, "color": BLUE}),
        {
            "type": "scatter", "mode": "markers+text",
            "x": [each.price_usd for each in design.compared],
            "y": [of(each) for each in design.compared],
            "text": [each.name for each in design.compared], "textposition": "top right",
            "textfont": {"size": 11, "color": PURPLE},
            "marker": {"size": 10, "symbol": "diamond", "color": PURPLE},
            "hovertemplate": "%{text}: %{x:~g} USD, %{y:.3g}<extra></extra>", "cliponaxis": False,
        },
        _dots([answer], of, "the answer",
              {"size": 16, "symbol": "star", "color": GREEN, "line": {"width": 1, "color": INK}}),
        {
            **_dots([own], of, "chosen", {"size": 20, "color": "rgba(0,0,0,0)",
                                          "line": {"width": 2.5, "color": VERMILION}}),
            "hoverinfo": "skip", "hovertemplate": None,
        },
    ]  # fmt: skip
    seen: list[SetUp | Beside] = [*design.setups, *design.compared]
    layout = layout_of("Price [USD]", _title(name))
    layout["margin"] = {"l": 62, "r": 14, "t": 8, "b": 42}
    layout["xaxis"] |= _logarithmic([each.price_usd for each in seen])
    layout["yaxis"] |= _logarithmic([target, *(of(each) for each in seen)])
    layout["shapes"] = [
        {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": target, "y1": target,
         "line": {"color": INK, "width": 1.3, "dash": "dash"}}
    ]  # fmt: skip
    # plotly places annotations, unlike shapes, by the logarithm of a logarithmic axis
    height = math.log10(target) if layout["yaxis"].get("type") == "log" else target
    layout["annotations"] = [
        {"xref": "paper", "x": 1, "y": height, "text": "target met below",
         "showarrow": False, "xanchor": "right", "yanchor": "top", "font": {"size": 11}}
    ]  # fmt: skip
    return {"data": traces, "layout": layout}


def _title(name: str) -> str:
    if name == ALL:
        return "Largest figure over its target [–]"
    return f"Standard uncertainty: {WORDS.get(name, name)}"


def _dots(setups: Iterable[SetUp], of: Any, name: str, marker: Figure) -> Figure:
    setups = list(setups)
    return {
        "type": "scatter", "mode": "markers", "name": name, "marker": marker,
        "x": [each.price_usd for each in setups], "y": [of(each) for each in setups],
        "customdata": [each.id for each in setups],
        "hovertemplate": f"{name}: %{{x:~g}} USD, %{{y:.3g}}<extra></extra>",
    }  # fmt: skip


def _logarithmic(values: list[float]) -> Figure:
    """A logarithmic axis around values above 0, with round ticks; else a linear one."""
    if min(values) <= 0.0:
        return {"rangemode": "tozero"}
    low, high = math.log10(min(values)), math.log10(max(values))
    room = max(0.07 * (high - low), 0.04)
    low, high = low - room, high + room
    digits = (1, 2, 5) if high - low > 1.3 else (1, 1.5, 2, 3, 4, 5, 7)
    decades = range(math.floor(low), math.ceil(high) + 1)
    ticks = [
        digit * 10.0**decade
        for decade in decades
        for digit in digits
        if low <= math.log10(digit * 10.0**decade) <= high
    ]
    return {
        "type": "log", "range": [low, high], "tickvals": ticks,
        "ticktext": [f"{tick:.6g}" for tick in ticks],
    }  # fmt: skip
