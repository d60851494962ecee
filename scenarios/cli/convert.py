"""`convert` on the command line."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from scenarios.cli.guard import guarded
from scenarios.cli.options import JsonOption, MeasurementArgument


def convert(
    measurement: MeasurementArgument,
    out: Annotated[
        Path,
        typer.Argument(metavar="OUT", help="NAME.nc for netCDF; else a new folder of CSV tables."),
    ],
    as_json: JsonOption = False,
) -> dict[str, Any]:
    """Write a measurement as netCDF, or as a folder of CSV tables that reads back as the same."""
    from scenarios.commands.convert import convert_measurement

    return convert_measurement(measurement, out)


def register(app: typer.Typer) -> None:
    """Add the command to the command line."""
    app.command(
        name="convert", epilog="Example: benchtwin convert benchtwin-default/measurement.nc tables"
    )(guarded(convert))
