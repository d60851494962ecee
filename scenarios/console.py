"""What the command says while it works: on standard error, never on standard output."""

from __future__ import annotations

import contextlib
import os
import sys
import time
from collections.abc import Iterator
from typing import Protocol

SECONDS_BETWEEN_LINES = 5.0


class Progress(Protocol):
    """Told how far a piece of work is: `progress(done, total)`, in any unit."""

    def __call__(self, done: float, total: float, /) -> None:
        """Say that `done` of `total` is done."""
        ...


def silent(done: float, total: float, /) -> None:
    """A progress that says nothing."""


class Console:
    """The steps of one command: a bar where a person watches, else a line now and then.

    Args:
        quiet: say nothing at all.
    """

    def __init__(self, *, quiet: bool = False) -> None:
        self._quiet = quiet

    def say(self, text: str) -> None:
        """One line on standard error."""
        if not self._quiet:
            print(text, file=sys.stderr, flush=True)

    @contextlib.contextmanager
    def step(self, text: str) -> Iterator[Progress]:
        """A piece of work; yields the function that is told how far it is."""
        if self._quiet:
            yield silent
            return
        started = time.monotonic()
        with _bar(text) if sys.stderr.isatty() else _lines(text) as progress:
            yield progress
        self.say(f"{text}: done in {time.monotonic() - started:.1f} s")


@contextlib.contextmanager
def _bar(text: str) -> Iterator[Progress]:
    from rich.console import Console as RichConsole
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
    from rich.progress import Progress as RichProgress

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
        TextColumn("elapsed, remaining"),
        TimeRemainingColumn(),
    )
    with RichProgress(*columns, console=RichConsole(stderr=True), transient=True) as bars:
        task = bars.add_task(text, total=None)

        def progress(done: float, total: float, /) -> None:
            bars.update(task, completed=done, total=total)

        yield progress


@contextlib.contextmanager
def _lines(text: str) -> Iterator[Progress]:
    started = said = time.monotonic()

    def progress(done: float, total: float, /) -> None:
        nonlocal said
        now = time.monotonic()
        if 0 < done < total and now - said >= SECONDS_BETWEEN_LINES:
            said = now
            remaining = (now - started) * (total - done) / done
            line = f"{text}: {100 * done / total:.0f} %, about {remaining:.0f} s remaining"
            print(line, file=sys.stderr, flush=True)

    yield progress


@contextlib.contextmanager
def output_to_error() -> Iterator[None]:
    """Send what libraries print, compiled code included, to standard error instead of output."""
    sys.stdout.flush()
    try:
        kept = os.dup(1)
    except OSError:  # standard output is closed: nothing can be printed there anyway
        yield
        return
    os.dup2(2, 1)
    try:
        with contextlib.redirect_stdout(sys.stderr):
            yield
    finally:
        sys.stdout.flush()
        os.dup2(kept, 1)
        os.close(kept)
