"""`design` on the command line."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from scenarios.cli.guard import guarded
from scenarios.cli.options import JsonOption, OutOption, QuietOption
from scenarios.sweep.options import EngineOption, SchedulerOption, WorkersOption, workers_of


def design(
    goal: Annotated[
        str, typer.Argument(metavar="GOAL", help="A built-in goal, or the path of a GOAL.toml.")
    ],
    out: OutOption = None,
    simulate: Annotated[
        bool, typer.Option(help="Simulate leading candidates in full, to check the predictions.")
    ] = True,
    quick: Annotated[
        bool, typer.Option("--quick", help="Fewer and coarser simulations: a first look.")
    ] = False,
    engine: EngineOption = None,
    workers: WorkersOption = 0,
    scheduler: SchedulerOption = "",
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> dict[str, Any]:
    """Find the cheapest set-up that is accurate enough, before a part is bought.

    Writes a report, a JSON file and a scenario file of every leading candidate. A run that was
    stopped goes on where it was when it is started again with the same folder.
    """
    from scenarios.commands.design import design_file
    from scenarios.console import Console

    return design_file(
        goal,
        out=out,
        quick=quick,
        simulate=simulate,
        workers=workers_of(engine, workers, scheduler),
        as_json=as_json,
        console=Console(quiet=quiet),
    )


def register(app: typer.Typer) -> None:
    """Add the command to the command line."""
    app.command(name="design", epilog="Example: benchtwin design resin --quick --out study")(
        guarded(design)
    )
