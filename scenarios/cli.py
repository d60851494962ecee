"""The command `benchtwin`. Nothing heavy is imported before a command needs it."""

from __future__ import annotations

import functools
import json
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from twin.errors import InputError

EXIT_OK = 0
EXIT_INTERNAL = 1
EXIT_INPUT = 2
EXIT_INTERRUPTED = 130

EPILOG = """\
Examples:

  benchtwin run                             simulate, estimate and report the default scenario

  benchtwin run intralipid --out milk       another built-in scenario, into the folder milk

  benchtwin run my.toml --quick --json      a file of yours, coarsely; the summary as JSON

  benchtwin estimate visit/                 a folder made by hand: bench.toml, samples.csv, ...

  benchtwin inspect benchtwin-default/measurement.nc

  benchtwin stress --estimators lut --quick  how right an estimator is, and how sure it may be

Exit codes: 0 done; 2 wrong input, with one message that says what was found and what is
expected; 130 interrupted; 1 an error of the program itself.
"""

app = typer.Typer(
    name="benchtwin",
    help="Simulate an affordable optical bench, estimate a translucent material, report.",
    epilog=EPILOG,
    add_completion=False,
    no_args_is_help=True,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
)

ScenarioArgument = Annotated[
    str, typer.Argument(metavar="SCENARIO", help="A built-in scenario, or the path of a file.")
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


def _guarded(command: Callable[..., dict[str, Any]]) -> Callable[..., None]:
    """Turn what a command returns or raises into output and an exit code."""

    @functools.wraps(command)
    def run(*args: Any, **kwargs: Any) -> None:
        from scenarios.console import output_to_error
        from twin.errors import InputError

        as_json = bool(kwargs.get("as_json"))
        try:
            with output_to_error():
                answer = command(*args, **kwargs)
        except InputError as error:
            print(f"benchtwin: {error}", file=sys.stderr)
            if as_json:
                print(json.dumps({"error": _error_fields(error)}, ensure_ascii=False))
            raise typer.Exit(EXIT_INPUT) from None
        except KeyboardInterrupt:
            again = "the same command" + (" with --resume" if "resume" in kwargs else "")
            print(
                f"benchtwin: interrupted. What was finished is kept; {again} goes on from there.",
                file=sys.stderr,
            )
            raise typer.Exit(EXIT_INTERRUPTED) from None
        except Exception:  # noqa: BLE001 - the last line of defence: say it is our mistake
            traceback.print_exc()
            print(
                "benchtwin: this is an error of the program, not of your input; please report"
                " it with the lines above.",
                file=sys.stderr,
            )
            raise typer.Exit(EXIT_INTERNAL) from None
        _answer(answer, as_json=as_json)

    return run


def _error_fields(error: InputError) -> dict[str, str]:
    keys = ("file", "place", "found", "expected", "remedy")
    return {key: getattr(error, key) for key in keys}


def _answer(answer: dict[str, Any], *, as_json: bool) -> None:
    from scenarios.outputs import canonical_json

    if as_json:
        print(canonical_json(answer))
    else:
        from scenarios.wording import sentences

        for line in sentences(answer):
            typer.echo(line)


@app.command(epilog="Example: benchtwin run polyjet-cyan --out cyan --seed 7")
@_guarded
def run(
    scenario: ScenarioArgument = "default",
    out: OutOption = None,
    seed: SeedOption = None,
    quick: QuickOption = False,
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
        seed=seed,
        quick=quick,
        threads=threads,
        resume=resume,
        cache=cache,
        console=Console(quiet=quiet),
    )


@app.command(epilog="Example: benchtwin simulate chip --out visit --seed 3")
@_guarded
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


@app.command(epilog="Example: benchtwin estimate visit/ --scenario chip --out result")
@_guarded
def estimate(
    measurement: Annotated[
        Path, typer.Argument(metavar="MEASUREMENT", help="A measurement.nc, or a folder of yours.")
    ],
    out: OutOption = None,
    scenario: Annotated[
        str, typer.Option(metavar="SCENARIO", help="Its map and estimator settings are used.")
    ] = "default",
    estimator: Annotated[
        str | None, typer.Option(metavar="NAME", help="Another estimator; see benchtwin list.")
    ] = None,
    seed: SeedOption = None,
    quick: QuickOption = False,
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
        threads=threads,
        cache=cache,
        console=Console(quiet=quiet),
    )


@app.command(name="map", epilog="Example: benchtwin map intralipid --cache maps")
@_guarded
def map_(
    scenario: ScenarioArgument = "default",
    quick: QuickOption = False,
    as_json: JsonOption = False,
    threads: ThreadsOption = None,
    cache: CacheOption = None,
    quiet: QuietOption = False,
) -> dict[str, Any]:
    """Compute the appearance maps of a scenario, so that estimates need not wait for them."""
    from scenarios.commands import compute_maps
    from scenarios.console import Console

    return compute_maps(
        scenario, quick=quick, threads=threads, cache=cache, console=Console(quiet=quiet)
    )


@app.command(epilog="Example: benchtwin inspect benchtwin-default/result.nc --json")
@_guarded
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


@app.command(epilog="Example: benchtwin figures figures --quick")
@_guarded
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


@app.command(epilog="Example: benchtwin stress --estimators lut,beer --points 64 --quick")
@_guarded
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
    cache: CacheOption = None,
    quiet: QuietOption = False,
) -> dict[str, Any]:
    """Try estimators on many simulated materials: errors, coverage, failures, a ranking.

    A run that was stopped goes on where it was when it is started again with the same folder.
    """
    from scenarios.commands import stress as run_stress
    from scenarios.console import Console

    return run_stress(
        plan,
        out=out,
        seed=seed,
        quick=quick,
        points=points,
        estimators=[name.strip() for name in (estimators or "").split(",") if name.strip()],
        threads=threads,
        cache=cache,
        console=Console(quiet=quiet),
    )


@app.command(name="list", epilog="Example: benchtwin list materials")
@_guarded
def list_(
    kind: Annotated[
        str | None, typer.Argument(metavar="KIND", help="One kind only, such as materials.")
    ] = None,
    as_json: JsonOption = False,
) -> dict[str, Any]:
    """List the built-in scenarios, the library of spectra, and the estimators."""
    from scenarios.describe import catalogue

    return catalogue(kind)


def _show_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"benchtwin {version('benchtwin')}")
        raise typer.Exit(EXIT_OK)


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="The version.")
    ] = False,
) -> None:
    """Simulate an affordable optical bench, estimate a translucent material, report."""


def main() -> None:
    """Entry point of the command."""
    app()


if __name__ == "__main__":
    main()
