"""`diagnose` on the command line."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from scenarios.cli.guard import guarded
from scenarios.cli.options import (
    CacheOption,
    JsonOption,
    MeasurementArgument,
    OutOption,
    QuickOption,
    QuietOption,
    ThreadsOption,
)


def diagnose(
    measurement: MeasurementArgument,
    bench: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="A bench.toml in place of the measurement's own bench."),
    ] = None,
    out: OutOption = None,
    report: Annotated[
        Path | None, typer.Option(metavar="FILE", help="The report; else FOLDER/diagnosis.html.")
    ] = None,
    rounds: Annotated[
        int,
        typer.Option(
            metavar="N", help="Accept what leads and diagnose again, until nothing is left."
        ),
    ] = 1,
    without: Annotated[
        list[str] | None,
        typer.Option(metavar="EFFECT", help="Leave an effect out of the catalogue; repeatable."),
    ] = None,
    dilutions: Annotated[
        bool, typer.Option(help="The rows of an .rxt file are dilutions of one stock.")
    ] = False,
    quick: QuickOption = False,
    as_json: JsonOption = False,
    threads: ThreadsOption = None,
    cache: CacheOption = None,
    quiet: QuietOption = False,
) -> dict[str, Any]:
    """Say where the sim-to-real gap lies, which effect causes it, how far it shrinks.

    Writes a report, a JSON file and a bench.toml with what was found, into which the leading
    effects are accepted with value and uncertainty. Integrating spheres (.rxt) and fluorescence
    visits get the report and the JSON file.
    """
    from scenarios.commands.diagnosis import diagnose_file
    from scenarios.console import Console

    return diagnose_file(
        measurement,
        bench=bench,
        out=out,
        report=report,
        rounds=rounds,
        without=without or (),
        dilutions=dilutions,
        quick=quick,
        threads=threads,
        cache=cache,
        as_json=as_json,
        console=Console(quiet=quiet),
    )


def register(app: typer.Typer) -> None:
    """Add the command to the command line."""
    app.command(
        name="diagnose",
        epilog="Example: benchtwin diagnose visit/measurement.nc --rounds 3 --out gap",
    )(guarded(diagnose))
