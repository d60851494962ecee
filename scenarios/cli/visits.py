"""`run`, `simulate`, `estimate` and `map` on the command line."""

from __future__ import annotations

from typing import Any

import typer

from scenarios.cli.guard import guarded
from scenarios.cli.options import (
    BudgetOption,
    CacheOption,
    EstimatorOption,
    JsonOption,
    MeasurementArgument,
    OutOption,
    QuickOption,
    QuietOption,
    ResumeOption,
    ScenarioArgument,
    SeedOption,
    SettingsOption,
    ThreadsOption,
)
from scenarios.sweep.options import EngineOption, SchedulerOption, WorkersOption, workers_of


def run(
    scenario: ScenarioArgument = "default",
    out: OutOption = None,
    estimator: EstimatorOption = None,
    seed: SeedOption = None,
    quick: QuickOption = False,
    budget: BudgetOption = False,
    as_json: JsonOption = False,
    threads: ThreadsOption = None,
    resume: ResumeOption = False,
    cache: CacheOption = None,
    quiet: QuietOption = False,
) -> dict[str, Any]:
    """Simulate a visit to the bench, estimate the material, write a report."""
    from scenarios.commands import run_scenario
    from scenarios.console import Console

    return run_scenario(
        scenario,
        out=out,
        estimator=estimator,
        seed=seed,
        quick=quick,
        budget=budget,
        threads=threads,
        resume=resume,
        cache=cache,
        console=Console(quiet=quiet),
    )


def simulate(
    scenario: ScenarioArgument = "default",
    out: OutOption = None,
    seed: SeedOption = None,
    quick: QuickOption = False,
    as_json: JsonOption = False,
    threads: ThreadsOption = None,
    resume: ResumeOption = False,
    quiet: QuietOption = False,
) -> dict[str, Any]:
    """Simulate a visit: the noisy counts of every capture, as measurement.nc."""
    from scenarios.commands import simulate_scenario
    from scenarios.console import Console

    return simulate_scenario(
        scenario,
        out=out,
        seed=seed,
        quick=quick,
        threads=threads,
        resume=resume,
        console=Console(quiet=quiet),
    )


def estimate(
    measurement: MeasurementArgument,
    out: OutOption = None,
    scenario: SettingsOption = "default",
    estimator: EstimatorOption = None,
    seed: SeedOption = None,
    quick: QuickOption = False,
    budget: BudgetOption = False,
    as_json: JsonOption = False,
    threads: ThreadsOption = None,
    cache: CacheOption = None,
    quiet: QuietOption = False,
) -> dict[str, Any]:
    """Estimate the optical properties from a measurement, simulated or made by hand."""
    from scenarios.commands import estimate_file
    from scenarios.console import Console

    return estimate_file(
        measurement,
        out=out,
        settings=scenario,
        estimator=estimator,
        seed=seed,
        quick=quick,
        budget=budget,
        threads=threads,
        cache=cache,
        console=Console(quiet=quiet),
    )


def map_(
    scenario: ScenarioArgument = "default",
    quick: QuickOption = False,
    engine: EngineOption = None,
    workers: WorkersOption = 0,
    scheduler: SchedulerOption = "",
    as_json: JsonOption = False,
    threads: ThreadsOption = None,
    cache: CacheOption = None,
    quiet: QuietOption = False,
) -> dict[str, Any]:
    """Compute the appearance maps of a scenario, so that estimates need not wait for them.

    Without workers, this process computes them on all cores. With a Dask scheduler, the parts of
    the maps are spread over its machines, which may share a cache folder.
    """
    from scenarios.commands import compute_maps
    from scenarios.console import Console

    return compute_maps(
        scenario, quick=quick, threads=threads, cache=cache, console=Console(quiet=quiet),
        workers=workers_of(engine, workers, scheduler),
    )  # fmt: skip


EXAMPLES = (
    ("run", run, "run polyjet-cyan --out cyan --estimator least-squares --budget"),
    ("simulate", simulate, "simulate chip --out visit --seed 3"),
    ("estimate", estimate, "estimate visit/ --estimator posterior --out result"),
    ("map", map_, "map intralipid --cache maps --workers 2"),
)


def register(app: typer.Typer) -> None:
    """Add these commands to the command line."""
    for name, command, example in EXAMPLES:
        app.command(name=name, epilog=f"Example: benchtwin {example}")(guarded(command))
