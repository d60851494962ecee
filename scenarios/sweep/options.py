"""Options of every command that sweeps: who works."""

from __future__ import annotations

from typing import Annotated

import typer

EngineOption = Annotated[
    str | None,
    typer.Option(
        "--engine", help='"serial", "joblib" (processes) or "dask"; the result is the same.'
    ),
]
WorkersOption = Annotated[
    int, typer.Option("--workers", min=0, max=4096, help="Processes; 0 takes one for each core.")
]
SchedulerOption = Annotated[
    str, typer.Option("--scheduler", metavar="ADDRESS", help="A running Dask scheduler.")
]
