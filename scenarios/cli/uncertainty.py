"""`budget`, `stress` and `spheres` on the command line."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from scenarios.cli.guard import guarded
from scenarios.cli.options import (
    CacheOption,
    JsonOption,
    MeasurementArgument,
    OutOption,
    QuickOption,
    QuietOption,
    SeedOption,
    SettingsOption,
    ThreadsOption,
)
from scenarios.sweep.options import EngineOption, SchedulerOption, WorkersOption, workers_of


def budget(
    measurement: MeasurementArgument,
    out: OutOption = None,
    scenario: SettingsOption = "default",
    thickness: Annotated[
        float | None, typer.Option(metavar="MM", help="Standard uncertainty of each thickness.")
    ] = None,
    n: Annotated[float | None, typer.Option(help="Of the refractive index.")] = None,
    rho_black: Annotated[
        float | None, typer.Option(metavar="SHARE", help="Of the black reflectance, relative.")
    ] = None,
    rho_white: Annotated[
        float | None, typer.Option(metavar="SHARE", help="Of the white standard, relative.")
    ] = None,
    acceptance: Annotated[
        float | None, typer.Option(metavar="SHARE", help="Of the acceptance angle, relative.")
    ] = None,
    draws: Annotated[
        int, typer.Option(metavar="N", help="Check by N draws of all inputs (from 20); 0: none.")
    ] = 0,
    seed: Annotated[int, typer.Option(help="Seed of these draws.")] = 0,
    quick: QuickOption = False,
    as_json: JsonOption = False,
    threads: ThreadsOption = None,
    cache: CacheOption = None,
    quiet: QuietOption = False,
) -> dict[str, Any]:
    """Say which input is to blame for the uncertainty of a least-squares estimate.

    Counts, thickness, index, reflectances, aperture and the engine itself: the share of each in
    the variance of albedo, sigma_t and g at every wavelength (GUM).
    """
    from scenarios.commands import budget_file
    from scenarios.console import Console

    stated = {
        "thickness_mm": thickness,
        "n": n,
        "rho_black_relative": rho_black,
        "rho_white_relative": rho_white,
        "acceptance_relative": acceptance,
    }
    return budget_file(
        measurement,
        {name: value for name, value in stated.items() if value is not None},
        out=out,
        settings=scenario,
        draws=draws,
        seed=seed,
        quick=quick,
        threads=threads,
        cache=cache,
        console=Console(quiet=quiet),
    )


def stress(
    plan: Annotated[
        str, typer.Argument(metavar="PLAN", help="A built-in plan, or the path of a file.")
    ] = "default",
    out: OutOption = None,
    seed: SeedOption = None,
    points: Annotated[
        int | None, typer.Option(metavar="N", help="Number of materials of a random design.")
    ] = None,
    estimators: Annotated[
        str | None, typer.Option(metavar="A,B", help="Only these estimators; see benchtwin list.")
    ] = None,
    quick: QuickOption = False,
    as_json: JsonOption = False,
    threads: ThreadsOption = None,
    engine: EngineOption = None,
    workers: WorkersOption = 0,
    scheduler: SchedulerOption = "",
    cache: CacheOption = None,
    quiet: QuietOption = False,
) -> dict[str, Any]:
    """Try estimators on many simulated materials: errors, coverage, failures, a ranking.

    A run that was stopped goes on where it was when it is started again with the same folder.
    """
    from scenarios.commands import stress_plan
    from scenarios.console import Console

    return stress_plan(
        plan,
        out=out,
        seed=seed,
        quick=quick,
        points=points,
        estimators=[name.strip() for name in (estimators or "").split(",") if name.strip()],
        threads=threads,
        workers=workers_of(engine, workers, scheduler),
        cache=cache,
        console=Console(quiet=quiet),
    )


def spheres(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="An .rxt file.")],
    out: OutOption = None,
    g: Annotated[
        float | None, typer.Option(help="Anisotropy factor where it is not found; else the file's.")
    ] = None,
    hold_g: Annotated[
        bool, typer.Option("--hold-g", help="Hold g even where M_U would let it be found.")
    ] = False,
    method: Annotated[
        str, typer.Option(metavar="METHOD", help="substitution, or comparison (two beams).")
    ] = "substitution",
    incidence: Annotated[
        float | None, typer.Option(metavar="DEG", help="Angle of the beam; else the file's, or 0.")
    ] = None,
    lost_light: Annotated[
        bool,
        typer.Option("--lost-light/--no-lost-light", help="Take light that misses ports off."),
    ] = True,
    seed: Annotated[int, typer.Option(help="Seed of the Monte Carlo of lost light.")] = 0,
    reference: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Result of iad to draw beside this one.")
    ] = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> dict[str, Any]:
    """Estimate from readings with integrating spheres (inverse adding-doubling's .rxt files)."""
    from scenarios.commands import spheres_file
    from scenarios.console import Console

    settings = {
        "g": g, "hold_g": hold_g, "method": method, "incidence_deg": incidence,
        "lost_light": lost_light, "seed": seed,
    }  # fmt: skip
    return spheres_file(file, settings, out=out, reference=reference, console=Console(quiet=quiet))


EXAMPLES = (
    ("budget", budget, "budget visit/measurement.nc --thickness 0.005 --draws 200"),
    ("stress", stress, "stress --estimators lut,beer --points 64 --quick"),
    ("spheres", spheres, "spheres phantom.rxt --g 0.9 --method comparison"),
)


def register(app: typer.Typer) -> None:
    """Add these commands to the command line."""
    for name, command, example in EXAMPLES:
        app.command(name=name, epilog=f"Example: benchtwin {example}")(guarded(command))
