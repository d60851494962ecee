"""A sweep: every point once, each result kept as soon as it is there."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scenarios.console import Console
from scenarios.outputs import canonical_json
from scenarios.sweep.ledger import Failure, Ledger
from scenarios.sweep.task import function_of
from scenarios.sweep.workers import Workers
from twin.cache import content_key
from twin.errors import InputError
from twin.spectra import FloatArray

LEDGER = "ledger.sqlite"


@dataclass(frozen=True, eq=False)
class Sweep:
    """A sweep that has been run.

    Attributes:
        ledger: where its results are; it is read when a result is asked for.
        keys: of the points, in their order.
        points: as canonical JSON.
        failures: points without a result.
        digest: SHA-256 over all results in their order.
    """

    ledger: Path
    keys: tuple[str, ...]
    points: tuple[str, ...]
    failures: tuple[Failure, ...]
    digest: str

    def results(self) -> Iterator[dict[str, FloatArray] | None]:
        """Arrays of every point in order, each of its own shape; None where a point failed."""
        with Ledger(self.ledger) as ledger:
            for key in self.keys:
                yield ledger.result(key)

    def seconds(self) -> list[float]:
        """Time [s] that every point took, in order; NaN where it was not tried."""
        with Ledger(self.ledger) as ledger:
            known = ledger.seconds(self.keys)
        return [known.get(key, math.nan) for key in self.keys]


def sweep(
    task: str,
    points: Sequence[Mapping[str, Any]],
    folder: Path,
    *,
    version: str,
    workers: Workers | None = None,
    console: Console | None = None,
    title: str = "sweep",
    aside: Mapping[str, Any] | None = None,
) -> Sweep:
    """Call a task at every point that has no result yet.

    Args:
        task: "module:function": a point in, arrays by name out; it must depend on the point alone.
        points: what JSON can hold; a point that appears twice is done once.
        folder: holds the ledger; run again with the same folder, a sweep goes on where it was.
        version: changes whenever the task's results change; results of another are not used.
        workers: who works; None: this process.
        console: is told how far it is.
        title: what the work is called.
        aside: what every point is given on top and no result may depend on, such as the folder of
            a cache.

    Raises:
        InputError: the task cannot be imported, the ledger cannot be written or is in use, or the
            workers cannot be had. What is finished is kept.
    """
    function_of(task)
    workers, console = workers or Workers(), console or Console(quiet=True)
    texts, keys = _keyed(task, points, version)
    if not texts:
        raise InputError("no point", "one point or more", place=title)
    number_of = {key: number for number, key in reversed(list(enumerate(keys)))}
    with Ledger(folder / LEDGER) as ledger:
        done = ledger.done(keys)
        missing = [(number_of[key], texts[number_of[key]]) for key in number_of if key not in done]
        missing.sort()
        if done and missing:
            console.say(f"{title}: {len(done)} of {len(number_of)} points are there already")
        if missing:
            with console.step(title) as progress:
                jobs = [(n, _with(points[n], text, aside)) for n, text in missing]
                answers = workers.answers(task, jobs, console.say)
                for count, answer in enumerate(answers, 1):
                    ledger.write(keys[answer.number], texts[answer.number], answer)
                    progress(count, len(missing))
        have = ledger.done(keys)
        failures = tuple(
            Failure(number, text, ledger.message(key))
            for number, (key, text) in enumerate(zip(keys, texts, strict=True))
            if key not in have
        )
        return Sweep(folder / LEDGER, keys, texts, failures, ledger.digest(keys))


def finished(task: str, points: Sequence[Mapping[str, Any]], folder: Path, *, version: str) -> bool:
    """Whether a sweep would have nothing left to do; arguments as of `sweep`.

    Raises:
        InputError: the ledger cannot be read or is in use.
    """
    _, keys = _keyed(task, points, version)
    with Ledger(folder / LEDGER) as ledger:
        return len(ledger.done(keys)) == len(set(keys))


def _keyed(
    task: str, points: Sequence[Mapping[str, Any]], version: str
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Points as canonical JSON, and their keys."""
    texts = tuple(canonical_json(dict(point), indent=None) for point in points)
    given = ({"task": task, "version": version, "point": text} for text in texts)
    return texts, tuple(content_key(each) for each in given)


def _with(point: Mapping[str, Any], text: str, aside: Mapping[str, Any] | None) -> str:
    return canonical_json({**point, **aside}, indent=None) if aside else text
