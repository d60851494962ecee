"""The command `benchtwin`. Nothing heavy is imported before a command needs it."""

from __future__ import annotations

from typing import Annotated

import typer

from scenarios.cli import blind, convert, design, diagnosis, explore, library, uncertainty, visits
from scenarios.cli.guard import EXIT_OK, guarded
from scenarios.instruments.command import register as register_instruments
from scenarios.predict.command import register as register_predict

__all__ = ["app", "guarded", "main"]

EPILOG = """\
Examples:

  benchtwin run                             simulate, estimate and report the default scenario

  benchtwin run intralipid --out milk       another built-in scenario, into the folder milk

  benchtwin run my.toml --quick --json      a file of yours, coarsely; the summary as JSON

  benchtwin estimate visit/                 a folder made by hand: bench.toml, samples.csv, ...

  benchtwin estimate visit/ --estimator posterior     draws instead of a table look-up

  benchtwin budget visit/                   what to improve first: thickness, white, counts, ...

  benchtwin diagnose visit/ --rounds 3      what the bench's description lacks, and how much

  benchtwin explore                         move material and bench on a local page

  benchtwin spheres phantom.rxt --g 0.9     readings with integrating spheres

  benchtwin predict benchtwin-default/result.nc --thickness 5     its colour at 5 mm

  benchtwin stress --estimators lut --quick  how right an estimator is, and how sure it may be

  benchtwin devices                         what is connected, and what could be

  benchtwin inspect benchtwin-default/measurement.nc

Exit codes: 0 done; 2 wrong input, with one message that says what was found and what is
expected; 130 interrupted; 1 an error of the program itself.
"""

app = typer.Typer(
    name="benchtwin",
    help="Simulate an affordable optical bench, estimate a translucent material, report.",
    epilog=EPILOG,
    add_completion=False,
    no_args_is_help=True,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
)


def _show_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"benchtwin {version('benchtwin')}")
        raise typer.Exit(EXIT_OK)


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="The version.")
    ] = False,
) -> None:
    """Simulate an affordable optical bench, estimate a translucent material, report."""


visits.register(app)
uncertainty.register(app)
diagnosis.register(app)
blind.register(app)
design.register(app)
explore.register(app)
register_predict(app, guarded)
register_instruments(app, guarded)
convert.register(app)
library.register(app)


def main() -> None:
    """Entry point of the command."""
    app()
