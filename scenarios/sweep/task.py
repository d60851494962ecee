"""What is done at one point, in whichever process: the task's function, its failure as a result."""

from __future__ import annotations

import importlib
import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from twin.cache import bytes_of_arrays
from twin.errors import InputError
from twin.spectra import FloatArray


@dataclass(frozen=True, slots=True)
class Timed:
    """Arrays of a task that says itself what part of its time [s] counts."""

    arrays: Mapping[str, FloatArray]
    seconds: float


Task = Callable[[dict[str, Any]], Mapping[str, FloatArray] | Timed]
"""A point, as JSON holds it, in; arrays by name out. The same point must give the same arrays."""


@dataclass(frozen=True, slots=True)
class Answer:
    """What became of one point.

    Attributes:
        number: which point.
        result: its arrays as bytes; empty when it failed.
        seconds: what it took [s].
        message: why it failed; "" when it did not.
    """

    number: int
    result: bytes
    seconds: float
    message: str = ""


def function_of(task: str) -> Task:
    """The function that "module:function" names.

    Raises:
        InputError: no such module or function.
    """
    module, _, name = task.partition(":")
    try:
        found = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise InputError(
            f"the task {task!r} ({error})", "module:function, which can be imported", place="task"
        ) from error
    if not callable(found):
        raise InputError(f"{task!r}, which cannot be called", "a function", place="task")
    made: Task = found
    return made


def answer(task: str, number: int, point: str) -> Answer:
    """Do one point; an exception becomes an answer with a message, so that the rest goes on.

    Args:
        task: "module:function".
        number: which point.
        point: the point as canonical JSON.
    """
    begin = time.perf_counter()
    try:
        found = function_of(task)(json.loads(point))
        if not isinstance(found, Timed):
            found = Timed(found, time.perf_counter() - begin)
        result = bytes_of_arrays(found.arrays)
    except Exception as error:  # noqa: BLE001 - a task is anyone's: its failure is an answer
        text = f"{type(error).__name__}: {error}"
        return Answer(number, b"", time.perf_counter() - begin, text)
    return Answer(number, result, found.seconds)
