"""Around every command: what it returns or raises becomes output and an exit code."""

from __future__ import annotations

import functools
import json
import os
import sys
import traceback
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from twin.errors import InputError

# Said before numpy is loaded. Our systems are many and small: on a busy machine the threads of the
# linear algebra wait for each other, and a Donaldson matrix took forty times as long.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

EXIT_OK = 0
EXIT_INTERNAL = 1
EXIT_INPUT = 2
EXIT_INTERRUPTED = 130

Command = Callable[..., dict[str, Any]]
"""A command returns what is printed."""


def guarded(command: Command) -> Callable[..., None]:
    """Turn what a command returns or raises into output and an exit code.

    Raises:
        typer.Exit: the exit code, when it is not 0.
    """

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
            _forget_interrupt()
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


def _forget_interrupt() -> None:
    """Let the exit code be ours.

    CPython remembers an interrupt that passed through text it was running (a dataclass that an
    import was making) and then ends the process by the signal, whatever the exit code, until it
    has run another text.
    """
    eval("None")  # noqa: S307 - a constant


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
