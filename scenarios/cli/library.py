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
    chapter: Annotated[
        int | None, typer.Option(metavar="N", help="4: translucent materials; 5: fluorescent ones.")
    ] = None,
    materials: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Chapter 5: .BFC files in place of generated ones."),
    ] = None,
    seed: SeedOption = None,
    quick: QuickOption = False,
    as_json: JsonOption = False,
    threads: ThreadsOption = None,
    quiet: QuietOption = False,
) -> dict[str, Any]:
    """Make figures of Iser et al. 2022 (2, 4, 5, 6) or 2023 (7 to 10: --chapter 5) again."""
    from scenarios.commands.figures import figures_of
    from scenarios.console import Console

    return figures_of(
        out, names or [], chapter=chapter, materials=materials, quick=quick, seed=seed or 0,
        threads=threads, console=Console(quiet=quiet),
    )  # fmt: skip


EXAMPLES = (
    ("inspect", inspect, "inspect benchtwin-default/result.nc --json"),
    ("list", list_, "list materials"),
    ("figures", figures, "figures figures --chapter 5 --quick"),
)


def register(app: typer.Typer) -> None:
    """Add these commands to the command line."""
    for name, command, example in EXAMPLES:
        app.command(name=name, epilog=f"Example: benchtwin {example}")(guarded(command))
