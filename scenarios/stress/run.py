"""Running a stress plan: a sweep over the light of its visits, then one over the answers."""

from __future__ import annotations

import re
from pathlib import Path

from scenarios.console import Console
from scenarios.outputs import prepare_folder
from scenarios.pipeline import check_estimator
from scenarios.stress.design import design_of
from scenarios.stress.effects import check_effects
from scenarios.stress.parts import Outcome, light_points, outcome_of, pieces_of
from scenarios.stress.plan import StressPlan
from scenarios.stress.task import ANSWERS, LIGHT, NoVisit, maps_of
from scenarios.sweep import Sweep, Workers, finished, sweep
from twin.errors import InputError

SWEEP = "sweep"
"""Folder of the ledger inside the output folder."""
VERSION = "1"
"""Of what the sweeps keep; their points name the source of the program."""
_INPUT_ERROR = re.compile(
    r"(?:InputError: )?(?:(?P<place>.*?): )?found (?P<found>.*); expected (?P<expected>.*)",
    re.DOTALL,
)
"""What a ledger keeps of an input error, whose place may be missing."""


def run_plan(
    plan: StressPlan,
    folder: Path,
    *,
    cache: Path | None = None,
    threads: int | None = None,
    workers: Workers | None = None,
    console: Console | None = None,
) -> Outcome:
    """Run a plan; what the folder holds of it already is taken from there.

    Args:
        plan: what to run.
        folder: results are kept in the ledger of its subfolder `sweep`.
        cache: folder of appearance maps and light; None takes the user's.
        threads: threads of the Monte Carlo in this process; the result does not depend on them.
        workers: who works; None: this process. The result does not depend on them either.
        console: is told what happens.

    Raises:
        InputError: an estimator's name or option, an effect or a bench cannot be used, the workers
            cannot be had, or the folder cannot be written.
    """
    console, workers = console or Console(quiet=True), workers or Workers()
    for contender in plan.estimators:
        check_estimator(contender)
    check_effects(plan)
    design = design_of(plan)
    kept = prepare_folder(folder / SWEEP)
    # Workers have a core each.
    alone = workers.engine == "serial"
    aside = {
        "cache": str(cache.absolute()) if cache is not None else "",
        "threads": threads if alone else 1,
    }
    pieces = pieces_of(plan, design)
    points = [piece.point for piece in pieces]
    if not finished(ANSWERS, points, kept, version=VERSION):
        for name in plan.benches:
            maps_of(plan, name, cache, threads, console, workers=workers)
        lit = sweep(
            LIGHT, light_points(plan, design), kept, version=VERSION, workers=workers,
            console=console, aside=aside, title="light of the visits",
        )  # fmt: skip
        _stop_if_failed(lit)
    done = sweep(
        ANSWERS, points, kept, version=VERSION, workers=workers, console=console, aside=aside,
        title=f"stress test of {len(design)} points",
    )  # fmt: skip
    _stop_if_failed(done, NoVisit.__name__)
    texts = [f"{pieces[f.number].case.estimator}: {f.message}" for f in done.failures]
    raised = tuple(dict.fromkeys(texts))
    for text in raised:
        console.say(f"raised by {text}")
    return outcome_of(plan, design, pieces, done.results(), done.seconds(), raised)


def _stop_if_failed(found: Sweep, kind: str = "") -> None:
    """Stop for a visit that could not be simulated: that is no answer of an estimator.

    Args:
        found: points that may have failed.
        kind: of the exceptions that stop, by name; "" for any.

    Raises:
        InputError: wrong input that showed only now.
        RuntimeError: anything else.
    """
    for failure in found.failures:
        if failure.message.startswith(kind):
            text = failure.message.removeprefix(f"{kind}: ")
            known = _INPUT_ERROR.fullmatch(text)
            if known:
                place = ": ".join(part for part in ("a simulated visit", known["place"]) if part)
                raise InputError(known["found"], known["expected"], place=place)
            raise RuntimeError(f"a visit that could not be simulated: {text}")
