"""`explore` on the command line."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from scenarios.cli.guard import guarded
from scenarios.cli.options import JsonOption, QuietOption


def explore(
    what: Annotated[
        str | None,
        typer.Argument(
            metavar="[MEASUREMENT|SCENARIO]",
            help="A measurement.nc, a folder of yours or of a run, or a scenario.",
        ),
    ] = None,
    result: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Its estimate, a result.nc; a run's folder has its own."),
    ] = None,
    diagnosis: Annotated[
        Path | None, typer.Option(metavar="FILE", help="A diagnosis.json, or the folder with it.")
    ] = None,
    design: Annotated[
        Path | None, typer.Option(metavar="FILE", help="A design.json, or the folder with it.")
    ] = None,
    port: Annotated[
        int | None, typer.Option(metavar="N", help="Else the first free one from 8050 on.")
    ] = None,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="Say the address and open nothing.")
    ] = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> dict[str, Any]:
    """Move material and bench on a local page: map, captures, colours, uncertainty at once.

    The page is on the loopback address of this machine and nowhere else; Ctrl-C ends it.
    """
    from scenarios.console import Console
    from scenarios.explore.command import explore as serve

    return serve(
        what,
        result=result,
        diagnosis=diagnosis,
        design=design,
        port=port,
        browser=not no_browser,
        console=Console(quiet=quiet),
    )


def register(app: typer.Typer) -> None:
    """Add the command to the command line."""
    app.command(
        name="explore",
        epilog="Example: benchtwin explore benchtwin-default --diagnosis gap/diagnosis.json",
    )(guarded(explore))
