"""`benchtwin stress`: estimators on many simulated materials."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from scenarios.commands.common import cache_of, said_of
from scenarios.console import Console
from scenarios.outputs import prepare_folder
from scenarios.pipeline import check_estimator
from scenarios.sweep import Workers


def stress_plan(
    name: str,
    *,
    out: Path | None = None,
    seed: int | None = None,
    quick: bool = False,
    points: int | None = None,
    estimators: Sequence[str] = (),
    threads: int | None = None,
    workers: Workers | None = None,
    cache: Path | None = None,
    console: Console,
) -> dict[str, Any]:
    """Run a stress plan, or the rest of it; returns the summary that is also written.

    Raises:
        InputError: the plan, an estimator, or the output folder cannot be used.
    """
    from scenarios.stress import load_plan, run_plan
    from scenarios.stress.tables import write_outcome

    plan = load_plan(name).settled(seed=seed, points=points, estimators=estimators, quick=quick)
    for contender in plan.estimators:
        check_estimator(contender)
    title = Path(name).stem
    folder = prepare_folder(out or Path(f"benchtwin-stress-{title}"))
    proved = cache_of(cache)
    with said_of(name):
        outcome = run_plan(
            plan,
            folder,
            cache=proved if cache else None,
            threads=threads,
            workers=workers,
            console=console,
        )
    with console.step("write the report"):
        return write_outcome(outcome, folder, title)
