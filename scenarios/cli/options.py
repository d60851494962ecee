"""Arguments and options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

ScenarioArgument = Annotated[
    str, typer.Argument(metavar="SCENARIO", help="A built-in scenario, or the path of a file.")
]
MeasurementArgument = Annotated[
    Path, typer.Argument(metavar="MEASUREMENT", help="A measurement.nc, or a folder of yours.")
]
SettingsOption = Annotated[
    str,
    typer.Option("--scenario", metavar="SCENARIO", help="Its map and estimator settings are used."),
]
EstimatorOption = Annotated[
    str | None,
    typer.Option(
        "--estimator",
        metavar="NAME",
        help="Another estimator, with its defaults; see benchtwin list estimators.",
    ),
]
BudgetOption = Annotated[
    bool,
    typer.Option("--budget", help="Also the uncertainty budget (least-squares only)."),
]
OutOption = Annotated[
    Path | None, typer.Option("--out", metavar="FOLDER", help="Where the results go.")
]
SeedOption = Annotated[
    int | None, typer.Option(help="Seed of every random number; the same seed, the same bytes.")
]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print one JSON object; progress goes to standard error.")
]
QuickOption = Annotated[
    bool, typer.Option("--quick", help="Fewer light paths and a coarse map: a first look.")
]
ThreadsOption = Annotated[
    int | None, typer.Option(min=1, max=1024, help="Threads; the result does not depend on it.")
]
CacheOption = Annotated[
    Path | None, typer.Option("--cache", metavar="FOLDER", help="Where appearance maps are kept.")
]
ResumeOption = Annotated[
    bool, typer.Option("--resume", help="Use the measurement that an interrupted run left.")
]
QuietOption = Annotated[bool, typer.Option("--quiet", "-q", help="Say nothing while working.")]
