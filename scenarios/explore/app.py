"""The application: which move of a person changes what."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from dash import ClientsideFunction, Dash, Input, Output, State
from flask import request

from scenarios.explore.page import page_of
from scenarios.explore.sliders import SLIDERS, Settings
from scenarios.explore.state import answer_of
from twin.errors import InputError

if TYPE_CHECKING:
    from scenarios.explore.diagnosis import Diagnosis
    from scenarios.explore.model import Explorer

STYLE = Path(__file__).parent.parent / "report" / "style.css"
INDEX = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{%title%}</title>
<link rel="icon" href="data:,">
<style>__STYLE__</style>
{%css%}
</head>
<body>
{%app_entry%}
<footer>{%config%}{%scripts%}{%renderer%}</footer>
</body>
</html>
"""
PICTURE = "/picture"
"""Where the page's program asks for pictures."""
MOVED = tuple(slider.name for slider in SLIDERS)


def application(
    explorer: Explorer, diagnosis: Diagnosis | None = None, extra: dict[str, Any] | None = None
) -> Dash:
    """The page with everything that happens on it; nothing of it comes from another machine.

    Args:
        explorer: computes pictures.
        diagnosis: shown in a tab of its own.
        extra: further tabs.
    """
    app = Dash(
        "benchtwin explore",
        assets_folder=str(Path(__file__).parent / "assets"),
        index_string=INDEX.replace("__STYLE__", STYLE.read_text(encoding="utf-8")),
        serve_locally=True,
        title="benchtwin explore",
        update_title="",
        add_log_handler=False,
        suppress_callback_exceptions=False,
        enable_mcp=False,
    )
    app.layout = page_of(explorer, diagnosis, extra or {})
    _moves(app, explorer)
    return app


def _moves(app: Dash, explorer: Explorer) -> None:
    clientside: Any = app.clientside_callback
    sliders = [Input(name, "value") for name in MOVED]
    # a material, a sample or a wavelength puts the sliders where it is; one request follows
    clientside(
        ClientsideFunction("explore", "choose"),
        [Output(name, "value") for name in MOVED] + [Output("moved", "data")],
        [
            Input("material", "value"),
            Input("sample", "value"),
            Input("wavelength", "value"),
            Input("reset", "n_clicks"),
        ],
        [State("bases", "data"), *(State(name, "value") for name in MOVED)],
        prevent_initial_call=True,
    )
    # The page asks for a picture itself: a callback of dash would cost another 50 ms. One request
    # is on its way at most; what moves meanwhile is sent when it is back: the last one wins.
    clientside(
        ClientsideFunction("explore", "ask"),
        Output("asked", "data"),
        [Input("moved", "data"), Input("ticks", "value"), *sliders],
        [
            State("material", "value"),
            State("sample", "value"),
            State("wavelength", "value"),
            State("bases", "data"),
        ],
    )
    clientside(
        ClientsideFunction("explore", "turn"), Output("turned", "data"), Input("tabs", "value")
    )

    def picture() -> Any:
        asked = request.get_json(silent=True)
        number = asked.get("number", 0) if isinstance(asked, dict) else 0
        try:
            if not isinstance(asked, dict):
                raise InputError("no request", "the sliders' positions")
            found = explorer.picture(Settings.of(asked))
            answer = answer_of(explorer, found)
        except InputError as error:
            answer = {"said": str(error)}
        return app.server.json.response({**answer, "number": number})

    app.server.add_url_rule(PICTURE, "picture", picture, methods=["POST"])
