"""The page: what stands where. Its style is that of the reports (`scenarios/report/style.css`)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from dash import dcc, html

from scenarios.explore.diagnosis_tab import diagnosis_part
from scenarios.explore.figures import GRAPH
from scenarios.explore.sliders import SLIDERS
from scenarios.explore.state import answer_of, bases_of
from scenarios.report.content import sample_label

if TYPE_CHECKING:
    from scenarios.explore.diagnosis import Diagnosis
    from scenarios.explore.model import Explorer, Picture

Part = Any
"""Something that dash can show."""


def page_of(explorer: Explorer, diagnosis: Diagnosis | None, extra: dict[str, Part]) -> Part:
    """The whole page with its first picture.

    Args:
        explorer: computes pictures.
        diagnosis: adds a tab.
        extra: more tabs by their titles.
    """
    first = explorer.picture(explorer.first())
    answer = answer_of(explorer, first)
    sheets = {"Explore": _explore(explorer, first, answer)}
    if diagnosis is not None:
        sheets["Diagnosis"] = diagnosis_part(diagnosis, explorer.source.fingerprint)
    sheets |= extra
    tabs = dcc.RadioItems(list(sheets), "Explore", id="tabs", className="tabs", inline=True)
    return html.Div(
        [
            html.Header(
                [
                    html.H1("benchtwin explore"),
                    html.P(explorer.source.title, className="kicker"),
                    html.Nav(tabs, className="" if len(sheets) > 1 else "alone"),
                ]
            ),
            *(_sheet(title, sheet) for title, sheet in sheets.items()),
            dcc.Store(id="bases", data=bases_of(explorer) | {"answer": answer}),
            *(dcc.Store(id=name) for name in ("asked", "moved", "turned")),
        ],
        id="page",
    )


def _sheet(title: str, content: Part) -> Part:
    named: dict[str, Any] = {"data-title": title}
    return html.Div(content, className="sheet", **named)


def _explore(explorer: Explorer, first: Picture, answer: dict[str, Any]) -> Part:
    figures = answer["figures"]
    heading = "Captures and uncertainty by wavelength"
    if explorer.source.measured is not None:
        heading = "Captures, predicted and measured (dots), and uncertainty"
    return html.Div(
        [
            html.Aside(_controls(explorer, first), className="controls"),
            html.Main(
                [
                    html.Div(
                        [
                            html.Section(
                                [html.H2(id="map-title"), _graph("map", figures)],
                                className="map",
                            ),
                            html.Section(id="tiles", className="tiles"),
                        ],
                        className="column",
                    ),
                    html.Div(
                        [
                            html.Section(id="swatches", className="swatches"),
                            html.Section(
                                [
                                    html.H2(heading),
                                    html.Div(id="readings", className="readings"),
                                    _graph("spectra", figures),
                                ],
                                className="spectra",
                            ),
                        ],
                        className="column",
                    ),
                ]
            ),
        ],
        className="bench",
    )


def _graph(name: str, figures: dict[str, Part]) -> Part:
    """A figure that moves over its axes, which stay."""
    return html.Div(
        [
            dcc.Graph(id=layer, figure=figures[layer], config=GRAPH, className="layer")
            for layer in (f"{name}-axes", f"{name}-contours", name)
            if layer in figures
        ],
        className="graph",
    )


def _controls(explorer: Explorer, first: Picture) -> list[Part]:
    source, settings = explorer.source, first.settings
    positions = settings.positions()
    wavelength = source.wavelength_nm
    names = [sample_label(sample) for sample in source.samples]
    choices = [
        _field(
            "Material",
            dcc.Dropdown(
                list(source.spectra), settings.material, id="material", clearable=False,
                searchable=len(source.spectra) > 8,
            ),
            "material",
        ),
        _field(
            "Sample",
            dcc.Dropdown(
                [{"label": name, "value": number} for number, name in enumerate(names)],
                settings.sample, id="sample", clearable=False, searchable=False,
            ),
            "sample",
        ),
    ]  # fmt: skip
    rows = [
        _slider(
            "wavelength", "Wavelength", "The sliders below hold here; the spectrum moves along.",
            0, len(wavelength) - 1, 1, settings.wavelength,
        )
    ]  # fmt: skip
    for slider in SLIDERS:
        rows.append(
            _slider(
                slider.name, slider.label, slider.hint, slider.position(slider.low),
                slider.position(slider.high), slider.step, positions[slider.name],
            )
        )  # fmt: skip
    ticks = dcc.Checklist(
        [
            {"label": f"uncertainty of all {len(names)} samples", "value": "all_samples"},
            {"label": "lamps drift", "value": "drift"},
        ],
        ["all_samples", "drift"],
        id="ticks",
        className="ticks",
    )
    reset = html.Button("Back to the description", id="reset", n_clicks=0)
    notes = [html.P(note) for note in explorer.notes]
    return [
        *choices, *rows, ticks, reset,
        *([html.Details([html.Summary("Notes"), *notes])] if notes else []),
        html.P(id="status", className="status", role="status"),
    ]  # fmt: skip


def _field(label: str, control: Part, name: str) -> Part:
    return html.Div([html.Label(label, htmlFor=name), control], className="field")


def _slider(
    name: str, label: str, hint: str, low: float, high: float, step: float, position: float
) -> Part:
    return html.Div(
        [
            html.Div(
                [html.Label(label, title=hint), html.Output(id=f"{name}-value")],
                className="name",
            ),
            dcc.Slider(
                id=name, min=low, max=high, step=step, value=position, marks=None,
                updatemode="drag", allow_direct_input=False, included=True,
            ),
        ],
        className="slider",
    )  # fmt: skip
