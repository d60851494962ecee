"""Options of every command that sweeps: who works."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from scenarios.sweep.workers import Workers

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


def workers_of(engine: str | None, count: int, scheduler: str) -> Workers:
    """Who works, from the three options: a scheduler means Dask, a number means processes.

    Raises:
        InputError: the options contradict each other.
    """
    name: Any = engine or ("dask" if scheduler else "joblib" if count > 1 else "serial")
    return Workers(engine=name, count=count, scheduler=scheduler)
