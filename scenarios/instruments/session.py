"""What the commands of instruments share: opened devices, a person, errors in their words."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from scenarios.console import Console
from scenarios.instruments.bench_file import BenchFile
from scenarios.instruments.opening import OpenedBench, open_bench
from twin.errors import InputError


def ask_person(text: str) -> None:
    """Show a sentence and wait for Enter.

    Raises:
        InputError: nobody is there to press it.
    """
    print(f"{text} Then press Enter.", file=sys.stderr, flush=True)
    if not sys.stdin.readline():
        raise InputError(
            "nobody at the keyboard", "a person who does what is asked",
            remedy="Run the command in a terminal, or use a device that moves by itself.",
        )  # fmt: skip


def opened_bench(
    file: BenchFile,
    bench: Path,
    console: Console,
    threads: int | None = None,
    faults: Any = None,
) -> contextlib.AbstractContextManager[OpenedBench]:
    """The devices of a bench file, opened until the `with` ends."""
    return open_bench(
        file, folder=bench.parent, console=console, ask=ask_person, threads=threads, faults=faults
    )


@contextlib.contextmanager
def not_resumed() -> Iterator[None]:
    """Errors of devices in a command that keeps nothing: it is called again, not resumed."""
    from hw_adapters.errors import DeviceError

    try:
        yield
    except DeviceError as error:
        error.remedy = error.remedy.replace("go on with --resume", "try again")
        raise
