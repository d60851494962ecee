"""The tab of set-ups: cost against accuracy, and what the chosen one is made of."""

from __future__ import annotations

import shlex
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from dash import Input, Output, ctx, dcc, html

from scenarios.explore.design import Design, SetUp, millimetres
from scenarios.explore.figures import GRAPH
from scenarios.explore.setups_figure import ALL, WORDS, front_figure

if TYPE_CHECKING:
    from dash import Dash

Part = Any
"""Something that dash can show."""
STEPS, INPUTS = 3, 3
"""Steps of what more money buys, and inputs that limit, of which the page speaks."""


def setups_part(design: Design) -> Part:
    """The tab, showing the answer."""
    own = design.setup(design.answer)
    chosen = dcc.Dropdown(
        [{"label": _label(design, each), "value": each.id} for each in design.setups],
        own.id, id="setup", clearable=False, searchable=False,
    )  # fmt: skip
    shown = dcc.RadioItems(
        [{"label": WORDS.get(name, name.capitalize()), "value": name}
         for name in (ALL, *design.targets)],
        ALL, id="setup-figure", className="choices", inline=True,
    )  # fmt: skip
    return html.Div(
        [
            html.Section(
                [
                    html.H2("Cost and accuracy"),
                    html.P(_looked(design), className="soft"),
                    shown,
                    html.Div(
                        dcc.Graph(
                            id="setup-plot", figure=front_figure(design, own, ALL), config=GRAPH,
                            className="layer",
                        ),
                        className="graph",
                    ),
                ],
                className="front",
            ),
            html.Section(
                [
                    html.Div(
                        [html.Label("Set-up: choose one here, or a dot", htmlFor="setup"), chosen],
                        className="field",
                    ),
                    html.Div(card(design, own), id="setup-card"),
                ],
                className="card",
            ),
        ],
        className="setups",
    )  # fmt: skip


def setups_moves(app: Dash, design: Design) -> None:
    """What happens on the tab: a set-up is chosen in the list or on the picture."""

    def chosen(clicked: Any, id_: str, name: str) -> tuple[Any, Any, str]:
        if ctx.triggered_id == "setup-plot" and clicked:
            id_ = clicked["points"][0].get("customdata") or id_
        own = design.setup(id_)
        return front_figure(design, own, name), card(design, own), own.id

    app.callback(
        Output("setup-plot", "figure"), Output("setup-card", "children"), Output("setup", "value"),
        Input("setup-plot", "clickData"), Input("setup", "value"), Input("setup-figure", "value"),
        prevent_initial_call=True,
    )(chosen)  # fmt: skip


def _label(design: Design, own: SetUp) -> str:
    said = "meets the targets" if own.score <= 1.0 else f"misses by {own.score:.2f} times"
    if own.id == design.answer:
        said += ", the cheapest" if design.reached else ", the most accurate"
    return f"{own.price_usd:g} USD, {said} ({own.id})"


def _looked(design: Design) -> str:
    how = ", all there are within the budget" if design.complete else ", not all there are"
    return (
        f"{design.title}. Each dot is a set-up with its protocol. Of the {design.looked} that were"
        f" looked at{how}, the file keeps these {len(design.setups)}: the front and the greedy"
        " path. The line is the best so far along the front of all targets together."
    )


def card(design: Design, own: SetUp) -> list[Part]:
    """What the chosen set-up is: its figures, what limits it, what more buys, parts, protocol."""
    return [
        html.H2("Predicted, beside the targets"),
        _table(*_figures(design, own), numbers=range(1, 4 if own.effects else 3)),
        *_notes(design, own),
        html.H2("What the next dollar buys"),
        _next(design, own),
        html.H2(["Parts", html.Span(f"{own.price_usd:g} USD in all", className="aside")]),
        *_parts(own),
        html.H2("Protocol"),
        html.P(_protocol(own)),
        *(
            [
                html.P(
                    ["Simulate it: ", html.Code(f"benchtwin run {shlex.quote(str(own.file))}")],
                    className="soft",
                )
            ]
            if own.file
            else []
        ),
    ]


def _figures(design: Design, own: SetUp) -> tuple[list[str], list[list[Part]]]:
    head = ["Figure", "Target", "Predicted"]
    if own.effects:
        head.append("With usual effects")
    if own.limits:
        head.append("Limited by")
    rows: list[list[Part]] = []
    for name, target in design.targets.items():
        row: list[Part] = [WORDS.get(name, name), f"{target:g}", _judged(own.figures[name], target)]
        if own.effects:
            row.append(_judged(own.effects[name], target) if name in own.effects else "–")
        if own.limits:
            shares = list(own.limits.get(name, {}).items())[:INPUTS]
            row.append(", ".join(f"{key} {100 * share:.0f}\u00a0%" for key, share in shares))
        rows.append(row)
    return head, rows


def _judged(value: float, target: float) -> Part:
    return html.Span(f"{value:.3g}", className="met" if value <= target else "missed")


def _notes(design: Design, own: SetUp) -> list[Part]:
    said = []
    if own.simulated:
        ratios = ", ".join(f"{name} {ratio:.2f}" for name, ratio in own.simulated.items())
        said.append(f"Simulated in full, actual over predicted errors: {ratios}.")
    if not own.limits and own.id != design.answer:
        said.append("The file says what limits the answer alone.")
    return [html.P(" ".join(said), className="soft")] if said else []


def _next(design: Design, own: SetUp) -> Part:
    better = design.better(own)
    if not better:
        return html.P("Nothing that was looked at is more accurate.")
    rows: list[list[Part]] = [
        [
            f"{each.price_usd - own.price_usd:+g} USD",
            f"{own.score / each.score:.2f} times better",
            ", ".join(own.changes(each)),
        ]
        for each in better[:STEPS]
    ]
    return _table(["Price", "All targets", "Change"], rows)


def _parts(own: SetUp) -> list[Part]:
    if any(part.price_usd is None for part in own.parts):
        names = ", ".join(part.name for part in own.parts)
        return [html.P(f"{names}. They are not of our list: their prices are not in the file.")]
    total = sum(part.price_usd or 0.0 for part in own.parts)
    rows: list[list[Part]] = [
        [html.Span(part.title, title=part.source), f"{part.price_usd:g}",
         "estimate" if part.source.startswith("estimate") else "quoted"]
        for part in own.parts
    ]  # fmt: skip
    if own.price_usd - total > 1e-9:
        rows.append(["What the samples use up", f"{own.price_usd - total:g}", ""])
    return [_table(["Part", "USD", "Price is"], rows, numbers=(1,))]


def _protocol(own: SetUp) -> str:
    p = own.protocol
    said = [f"{p['repeats']:g} shots of {p['averages']:g} frames of every capture"]
    if own.thickness_mm:
        said.insert(0, f"samples of {millimetres(own.thickness_mm)}")
        said.append(f"view of {p['acceptance_deg']:g}°, panels at {p['polar_deg']:g}°")
    if p["leds"]:
        said.append(f"{p['leds']:g} lights")
    text = "; ".join(said) + "."
    return text[0].upper() + text[1:]


def _table(head: list[str], rows: list[list[Part]], numbers: Iterable[int] = ()) -> Part:
    right = set(numbers)

    def kind(column: int) -> str:
        return "number" if column in right else ""

    return html.Table(
        [
            html.Thead(html.Tr([html.Th(t, className=kind(k)) for k, t in enumerate(head)])),
            html.Tbody(
                [html.Tr([html.Td(t, className=kind(k)) for k, t in enumerate(r)]) for r in rows]
            ),
        ],
        className="dense",
    )
