"""The commands `devices`, `capture`, `calibrate` and `monitor`: `register(app, guarded)`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

BenchArgument = Annotated[
    Path, typer.Argument(metavar="BENCH.toml", help="The file that names the devices.")
]
ThreadsOption = Annotated[
    int | None, typer.Option(min=1, max=1024, help="Of the twin's Monte Carlo.")
]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print one JSON object; progress goes to standard error.")
]
QuietOption = Annotated[bool, typer.Option("--quiet", "-q", help="Say nothing while working.")]


def devices(
    bench: Annotated[
        Path | None,
        typer.Argument(metavar="BENCH.toml", help="Open the devices of this file and say which."),
    ] = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> dict[str, Any]:
    """Say what is connected, what could be, and what is missing and how to install it."""
    from scenarios.console import Console
    from scenarios.instruments.work import devices_answer

    return devices_answer(bench, Console(quiet=quiet))


def capture(
    bench: BenchArgument,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FOLDER", help="Where the measurement goes.")
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with the visit that was interrupted.")
    ] = False,
    fault: Annotated[
        str,
        typer.Option(
            metavar="NAME:OPERATION:STAGE",
            help="Let something go wrong, such as unplugging:usb650.frame:white, on virtual devices"
            " and stand-ins.",
        ),
    ] = "",
    as_json: JsonOption = False,
    threads: ThreadsOption = None,
    quiet: QuietOption = False,
) -> dict[str, Any]:
    """Capture a whole visit: virtual, on the wire, or with real devices, by one line of the file.

    Every shot is kept as soon as it is taken: after an interruption or a failure the same command
    with --resume goes on.
    """
    from scenarios.console import Console
    from scenarios.instruments.work import capture_answer

    return capture_answer(
        bench, out=out, resume=resume, fault=fault, threads=threads, console=Console(quiet=quiet)
    )


def calibrate(
    bench: BenchArgument,
    lamp: Annotated[
        str,
        typer.Option(
            metavar="LAMP", help="Check wavelengths by mercury-argon, neon or fluorescent."
        ),
    ] = "",
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FOLDER", help="Where calibration.json goes.")
    ] = None,
    as_json: JsonOption = False,
    threads: ThreadsOption = None,
    quiet: QuietOption = False,
) -> dict[str, Any]:
    """Measure dark, white and linearity of the sensor, and check its wavelengths by a lamp."""
    from scenarios.console import Console
    from scenarios.instruments.work import calibrate_answer

    return calibrate_answer(
        bench, lamp=lamp, out=out, threads=threads, console=Console(quiet=quiet)
    )


def monitor(
    bench: BenchArgument,
    light: Annotated[str, typer.Option(metavar="LAMP", help="panels, beam, or none.")] = "panels",
    background: Annotated[str, typer.Option(metavar="NAME", help="white, black or out.")] = "white",
    integration_s: Annotated[
        float | None, typer.Option("--integration", metavar="S", help="Of a spectrometer.")
    ] = None,
    frames: Annotated[
        int | None, typer.Option(min=1, help="Stop after so many; else at Ctrl-C.")
    ] = None,
    width: Annotated[int, typer.Option(min=8, max=400, help="Characters of the line.")] = 72,
    as_json: JsonOption = False,
    threads: ThreadsOption = None,
    quiet: QuietOption = False,
) -> dict[str, Any]:
    """Show the live spectrum in the terminal."""
    from scenarios.console import Console
    from scenarios.instruments.monitor import monitor_answer

    return monitor_answer(
        bench, light=light, background=background, integration_s=integration_s, frames=frames,
        width=width, threads=threads, console=Console(quiet=quiet),
    )  # fmt: skip


Command = Callable[..., dict[str, Any]]

EPILOGS: tuple[tuple[str, Command, str], ...] = (
    ("devices", devices, "Example: benchtwin devices"),
    (
        "capture",
        capture,
        "Example: benchtwin capture bench.toml --out visit, then benchtwin estimate"
        " visit/measurement.nc",
    ),
    ("calibrate", calibrate, "Example: benchtwin calibrate bench.toml --lamp mercury-argon"),
    ("monitor", monitor, "Example: benchtwin monitor bench.toml --light panels"),
)
"""Name, command, and what its help ends with."""


def register(app: typer.Typer, guarded: Callable[[Command], Callable[..., None]]) -> None:
    """Add the four commands to the command line.

    Args:
        app: the typer application.
        guarded: what turns a command's answer or error into output and an exit code.
    """
    for name, command, epilog in EPILOGS:
        app.command(name=name, epilog=epilog)(guarded(command))
