"""`inspect`, `list` and `figures` on the command line."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from scenarios.cli.guard import guarded
from scenarios.cli.options import JsonOption, QuickOption, QuietOption, SeedOption, ThreadsOption


def inspect(
    file: Annotated[
        str,
        typer.Argument(metavar="FILE", help="A measurement, map, result, or scenario (or name)."),
    ],
    as_json: JsonOption = False,
) -> dict[str, Any]:
    """Say what a file holds."""
    from scenarios.describe import describe

    return describe(file)


def list_(
    kind: Annotated[
        str | None, typer.Argument(metavar="KIND", help="One kind only, such as materials.")
    ] = None,
    as_json: JsonOption = False,
) -> dict[str, Any]:
    """List the built-in scenarios, estimators, stress plans, and the library of spectra."""
    from scenarios.describe import catalogue

    return catalogue(kind)


def figures(
    out: Annotated[Path, typer.Argument(metavar="FOLDER", help="Where the pictures are written.")],
    names: Annotated[
        list[str] | None, typer.Argument(metavar="NAME", help="Only these, such as figure6.")
    ] = None,
    seed: SeedOption = None,
    quick: QuickOption = False,
    as_json: JsonOption = False,
    threads: ThreadsOption = None,
    quiet: QuietOption = False,
) -> dict[str, Any]:
    """Make figures 2, 4, 5 and 6 of Iser et al. 2022 again, with this bench."""
    from scenarios.console import Console
    from scenarios.figures import make_figures

    with Console(quiet=quiet).step("figures") as progress:
        files = make_figures(out, names or (), quick, seed or 0, threads, progress)
    return {"files": [str(path) for path in files]}


EXAMPLES = (
    ("inspect", inspect, "inspect benchtwin-default/result.nc --json"),
    ("list", list_, "list materials"),
    ("figures", figures, "figures figures --quick"),
)


def register(app: typer.Typer) -> None:
    """Add these commands to the command line."""
    for name, command, example in EXAMPLES:
        app.command(name=name, epilog=f"Example: benchtwin {example}")(guarded(command))
