"""The tab of a diagnosis."""

from __future__ import annotations

from typing import Any

from dash import dcc, html

from scenarios.explore.diagnosis import SHOWN, Diagnosis, closure_sentence, effects_figure
from scenarios.explore.figures import GRAPH

LINES = 6
"""Of a list; the others are counted."""
Part = Any
"""Something that dash can show."""


def diagnosis_part(found: Diagnosis, fingerprint: str = "") -> Part:
    """The tab of a diagnosis, beside a measurement of this fingerprint."""
    said = [found.sentence] if found.sentence else []
    if found.closure is not None:
        said.append(closure_sentence(found.closure))
    if fingerprint and found.fingerprint != fingerprint:
        said.append("This is the diagnosis of another measurement than the one on the first tab.")
    more = len(found.effects) - SHOWN
    return html.Div(
            [
                html.Div(
                    [html.Strong(found.verdict), *[html.P(sentence) for sentence in said]],
                    className=f"verdict {found.tone}",
                ),
                html.Div(
                    [
                        html.Section(
                            [
                                html.H2("Which effect"),
                                dcc.Graph(
                                    id="effects", figure=effects_figure(found), config=GRAPH,
                                    className="graph",
                                ),
                                html.P(
                                    "Vermilion: the verdict; blue: what looks alike. "
                                    + (f"{more} less probable effects are not drawn. " if more > 0
                                     else "")
                                    + f"{found.hidden} effects cannot be judged from these data.",
                                    className="soft",
                                ),
                            ],
                            className="effects",
                        ),
                        html.Section(
                            [
                                html.H2("Where the gap shows"),
                                _bullets(found.where, "Nowhere above noise."),
                                html.H2("Where it enters"),
                                _bullets(found.enters, "No single block heals the rest."),
                                html.H2("What to measure next"),
                                _bullets(found.proposals, "Nothing: no look-alikes to split."),
                            ],
                            className="lists",
                        ),
                    ],
                    className="halves",
                ),
                html.Details(
                    [
                        html.Summary("All effects"),
                        html.Table(
                            [
                                html.Thead(
                                    html.Tr([html.Th(t) for t in
                                             ("Probability", "Effect", "In words", "Fitted")])
                                ),
                                html.Tbody(
                                    [
                                        html.Tr(
                                            [
                                                html.Td(f"{100 * e.probability:.1f} %"),
                                                html.Td(html.Code(e.name)), html.Td(e.title),
                                                html.Td(e.fitted),
                                            ]
                                        )
                                        for e in found.effects
                                    ]
                                ),
                            ]
                        ),
                    ]
                ),
            ],
            className="diagnosis",
    )  # fmt: skip


def _bullets(lines: tuple[str, ...], otherwise: str) -> Part:
    """The first lines as a list, and how many more there are."""
    if not lines:
        return html.P(otherwise)
    rest = len(lines) - LINES
    more = [html.Li(f"and {rest} more", className="soft")] if rest > 0 else []
    return html.Ul([*[html.Li(line) for line in lines[:LINES]], *more])
