"""The command `benchtwin predict`: `register(app, guarded)` adds it to the command line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from scenarios.console import Console

EPILOG = """\
Examples:

  benchtwin predict cyan/result.nc --thickness 5 --background white

  benchtwin predict --mix cyan/result.nc:0.3 white/result.nc:0.7 --illuminant FL4

  benchtwin predict one/result.nc --compare other/result.nc --thickness inf

  benchtwin predict cyan/result.nc --export mitsuba --out medium

  benchtwin predict --checker --quick --out checker
"""


def predict(
    estimates: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="ESTIMATE", help="result.nc of an estimate; with --mix several, FILE:FRACTION."
        ),
    ] = None,
    mix: Annotated[bool, typer.Option("--mix", help="Mix the estimates by volume.")] = False,
    compare: Annotated[
        Path | None, typer.Option(metavar="FILE", help="CIEDE2000 to this other estimate.")
    ] = None,
    thickness: Annotated[float, typer.Option(metavar="MM", help="Of the slab; inf is one.")] = 5.0,
    n: Annotated[str, typer.Option(help="Refractive index: a number or a library name.")] = "1.5",
    background: Annotated[
        str, typer.Option(help="black, white, a reflectance, or a name in the library.")
    ] = "black",
    illuminant: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="D65, A, FL4 ... or none; may be repeated."),
    ] = None,
    engine: Annotated[
        str, typer.Option(metavar="ENGINE", help="adding-doubling or monte-carlo.")
    ] = "adding-doubling",
    draws: Annotated[int, typer.Option(help="Draws behind the intervals.")] = 200,
    missing: Annotated[
        float, typer.Option(help="Share of wavelengths without a value that a colour bears.")
    ] = 0.2,
    export: Annotated[
        str | None, typer.Option(metavar="RENDERER", help="mitsuba or pbrt: write the medium.")
    ] = None,
    unit: Annotated[float, typer.Option(metavar="MM", help="A scene's unit, for --export.")] = 1.0,
    checker: Annotated[
        bool, typer.Option("--checker", help="The colour checker of five inks, start to end.")
    ] = False,
    estimator: Annotated[
        str, typer.Option(metavar="NAME", help="Of the inks, with --checker.")
    ] = "lut",
    quick: Annotated[bool, typer.Option("--quick", help="A coarse checker, in seconds.")] = False,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FOLDER", help="Where the results go.")
    ] = None,
    seed: Annotated[int, typer.Option(help="The same seed, the same bytes.")] = 1,
    paths: Annotated[int, typer.Option(help="Light paths of the engine monte-carlo.")] = 8192,
    threads: Annotated[int | None, typer.Option(help="Of the Monte Carlo.")] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Use what an interrupted --checker left.")
    ] = False,
    cache: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Where appearance maps are kept.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Say nothing meanwhile.")] = False,
) -> dict[str, Any]:
    """Predict reflectance and colour of slabs and mixtures from estimates, with intervals."""
    from scenarios.console import Console
    from scenarios.predict.work import predict_checker, predict_files
    from twin.errors import InputError

    console: Console = Console(quiet=quiet)
    lamps = illuminant or ["D65"]
    if checker:
        if estimates or mix or compare or export:
            raise InputError(
                "--checker with estimates, --mix, --compare or --export",
                "--checker alone: it measures its own inks",
            )
        return predict_checker(
            thickness_mm=thickness, n=n, background=background, illuminant=lamps,
            estimator=estimator, draws=draws, quick=quick, out=out, seed=seed, threads=threads,
            resume=resume, cache=cache, console=console,
        )  # fmt: skip
    return predict_files(
        estimates or [], mix=mix, compare=compare, thickness_mm=thickness, n=n,
        background=background, illuminants=lamps, engine=engine, draws=draws,
        missing_share=missing, export=export, unit_mm=unit, out=out, seed=seed, paths=paths,
        threads=threads, console=console,
    )  # fmt: skip


def register(
    app: typer.Typer, guarded: Callable[[Callable[..., dict[str, Any]]], Callable[..., None]]
) -> None:
    """Add `predict` to the command line.

    Args:
        app: the typer application.
        guarded: what turns a command's answer or error into output and an exit code.
    """
    app.command(name="predict", epilog=EPILOG)(guarded(predict))
