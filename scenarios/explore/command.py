"""What `benchtwin explore` does: read what is explored, serve the page, end when told to."""

from __future__ import annotations

import signal
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

from scenarios.console import Console
from twin.errors import InputError

if TYPE_CHECKING:
    from dash import Dash

MISSING = 'pip install "benchtwin[explore]"'
SHEET = "Set-ups"
"""Title of the tab of a design study."""


def require_dash() -> None:
    """Check that the page's library is there.

    Raises:
        InputError: it is not; the message has the command that installs it.
    """
    try:
        import dash  # noqa: F401
    except ImportError as error:
        raise InputError(
            f"no module {error.name}", "the optional package dash, which draws the page",
            remedy=f"Install it: {MISSING}",
        ) from error  # fmt: skip


def explored(
    given: str | None,
    *,
    result: Path | None = None,
    diagnosis: Path | None = None,
    design: Path | None = None,
    console: Console | None = None,
) -> Dash:
    """The application of a scenario or measurement, ready: everything is compiled.

    Args:
        given: see `scenarios.explore.source.source_of`.
        result: an estimate of the measurement.
        diagnosis: a diagnosis.json, or its folder.
        design: a design.json, or its folder.
        console: is told what happens.

    Raises:
        InputError: something of it cannot be used, or the library is missing.
    """
    require_dash()
    from scenarios.explore.app import application
    from scenarios.explore.design import read_design
    from scenarios.explore.diagnosis import read_diagnosis
    from scenarios.explore.model import Explorer
    from scenarios.explore.setups import setups_moves, setups_part
    from scenarios.explore.source import source_of

    console = console or Console(quiet=True)
    source = source_of(given, result)
    found = None if diagnosis is None else read_diagnosis(diagnosis)
    study = None if design is None else read_design(design)
    with console.step("prepare the fast engine (the first time on a machine takes half a minute)"):
        explorer = Explorer(source)
        explorer.warm()
    app = application(explorer, found, extra={} if study is None else {SHEET: setups_part(study)})
    if study is not None:
        setups_moves(app, study)
    return app


def explore(
    given: str | None,
    *,
    result: Path | None = None,
    diagnosis: Path | None = None,
    design: Path | None = None,
    port: int | None = None,
    browser: bool = True,
    console: Console | None = None,
) -> dict[str, Any]:
    """Serve the page until Ctrl-C.

    Args:
        given: see `scenarios.explore.source.source_of`.
        result: an estimate of the measurement.
        diagnosis: a diagnosis.json, or its folder.
        design: a design.json, or its folder.
        port: of the loopback address; None takes the first free one.
        browser: open the page.
        console: is told where the page is.

    Raises:
        InputError: something of it cannot be used, or the port is in use.
    """
    from scenarios.explore.server import FIRST_PORT, HOST, free_port, serve

    console = console or Console(quiet=True)
    chosen, another = free_port(port)
    app = explored(given, result=result, diagnosis=diagnosis, design=design, console=console)
    server = serve(app, chosen)
    address = f"http://{HOST}:{chosen}/"

    def stop(_signal: int, _frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, stop)
    try:
        if another:
            console.say(f"port {FIRST_PORT} is in use: port {chosen} is taken instead")
        console.say(f"the page is at {address} and ends with Ctrl-C")
        if browser:
            _open(address, console)
        server.serve_forever()  # returns when it is interrupted
    except KeyboardInterrupt:  # before it was running
        pass
    finally:
        signal.signal(signal.SIGTERM, before)
        server.server_close()
    console.say("ended")
    return {"command": "explore", "address": address}


def _open(address: str, console: Console) -> None:
    import webbrowser

    if not webbrowser.open(address):
        console.say("no browser could be opened: open the address yourself")
