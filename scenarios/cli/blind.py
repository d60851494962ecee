"""`blind make|run|open|score` on the command line."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from scenarios.cli.guard import guarded
from scenarios.cli.options import JsonOption, QuietOption
from scenarios.sweep.options import EngineOption, SchedulerOption, WorkersOption, workers_of

FolderArgument = Annotated[Path, typer.Argument(metavar="FOLDER", help="Of the suite.")]


def make(
    folder: FolderArgument,
    family: Annotated[str, typer.Option(help="Of materials: ink or resin.")] = "ink",
    seed: Annotated[int, typer.Option(min=0, help="Of everything that is drawn.")] = 1,
    materials: Annotated[
        int, typer.Option(metavar="N", min=1, help="Each is measured once in each of six arms.")
    ] = 7,
    first: Annotated[int, typer.Option(min=0, help="Number of the first material.")] = 0,
    engine: EngineOption = None,
    workers: WorkersOption = 0,
    scheduler: SchedulerOption = "",
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> dict[str, Any]:
    """Simulate measurements of the Monte Carlo bench and seal what is wrong with each.

    A run that was stopped goes on where it was when it is started again with the same folder.
    """
    from scenarios.blind import Suite
    from scenarios.blind import make as made
    from scenarios.console import Console

    suite = Suite(family=family, seed=seed, materials=materials, first=first)
    hands = workers_of(engine, workers, scheduler)
    return made(suite, folder, workers=hands, console=Console(quiet=quiet))


def run(
    folder: FolderArgument,
    engine: EngineOption = None,
    workers: WorkersOption = 0,
    scheduler: SchedulerOption = "",
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> dict[str, Any]:
    """Diagnose the measurements of a suite that have no outcome yet; nothing sealed is read."""
    from scenarios.blind import run as diagnosed
    from scenarios.console import Console

    hands = workers_of(engine, workers, scheduler)
    return diagnosed(folder, workers=hands, console=Console(quiet=quiet))


def open_(folder: FolderArgument, as_json: JsonOption = False) -> dict[str, Any]:
    """Open all seals, once: the suite can be neither added to nor diagnosed again after that."""
    from scenarios.blind import open_seals

    opened = open_seals(folder)
    return {
        "opened": len(opened["labels"]), "broken": opened["broken"],
        "outcomes": opened["outcomes"],
    }  # fmt: skip


def score(
    folders: Annotated[
        list[Path], typer.Argument(metavar="FOLDER...", help="Suites that were opened.")
    ],
    table: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the table, as Markdown.")
    ] = None,
    as_json: JsonOption = False,
) -> dict[str, Any]:
    """Count right and wrong answers, beside those of three simpler methods."""
    from scenarios.blind import score as scored
    from scenarios.blind import table as written
    from twin.files import write_atomically

    figures = scored(*folders)
    if table is not None:
        write_atomically(table, written(figures).encode())
    return figures


EXAMPLES = (
    ("make", make, "blind make sealed/ --materials 20 --workers 2"),
    ("run", run, "blind run sealed/ --workers 2"),
    ("open", open_, "blind open sealed/"),
    ("score", score, "blind score sealed/ --table table.md"),
)


def register(app: typer.Typer) -> None:
    """Add these commands to the command line."""
    blind = typer.Typer(
        help="The sealed check: is the diagnosis right where its answer was hidden?",
        no_args_is_help=True,
    )
    for name, command, example in EXAMPLES:
        blind.command(name=name, epilog=f"Example: benchtwin {example}")(guarded(command))
    app.add_typer(blind, name="blind")
