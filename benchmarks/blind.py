"""The sealed check of the diagnosis: six arms, materials of a family that nothing was tuned on.

The full suite is kept in the user's cache folder, in parts that are sealed and opened one by one,
and goes on where it was; `benchtwin blind score` reads the parts that are finished. `--quick`
makes a suite of its own, of 42 measurements of the family that the method was developed on.
"""

from __future__ import annotations

import shutil
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from scenarios.blind import Suite, make, open_seals, score
from scenarios.blind import run as diagnose_all
from scenarios.blind.suite import (
    MEASUREMENT,
    MEASUREMENTS,
    OPENED,
    maps_of,
)
from scenarios.console import Console
from scenarios.sweep import Workers
from twin.cache import cache_folder

SEED, QUICK_SEED = 20261122, 20261123
FIRST = 50
"""Material of the full run: those before it were looked at while the method was finished."""
PARTS, MATERIALS = 5, 10
"""Suites of the full run, and materials in each: every finished part is worth reading."""
QUICK = Suite(family="ink", seed=QUICK_SEED, materials=7)
"""Of the development family: what is run often must not wear out the one for the published run."""


def parts() -> list[Suite]:
    """The suites of the full run: 300 measurements, 50 in every arm."""
    return [
        Suite(family="resin", seed=SEED, first=FIRST + MATERIALS * number, materials=MATERIALS)
        for number in range(PARTS)
    ]


def run(quick: bool) -> dict[str, Any]:
    """Make, diagnose, open and score; then time one diagnosis, cold and warm."""
    top = cache_folder("blind")
    begin = time.perf_counter()
    if quick:
        shutil.rmtree(top / "quick", ignore_errors=True)
        suites = {top / "quick": QUICK}
    else:
        suites = {top / f"resin-{suite.first:03d}": suite for suite in parts()}
    hands, console = Workers(engine="joblib"), Console()
    for folder, suite in suites.items():
        if not (folder / OPENED).exists():
            make(suite, folder, workers=hands, console=console)
            diagnose_all(folder, workers=hands, console=console)
            open_seals(folder)
    seconds = time.perf_counter() - begin
    figures = score(*suites)
    folder, suite = next(iter(suites.items()))
    cold, warm = timed(suite, folder)
    return {
        **figures,
        "diagnose_cold_s": cold,
        "diagnose_warm_s": warm,
        "suite_s": seconds,
        "family": suite.family,
        "seed": suite.seed,
    }


def timed(suite: Suite, folder: Path) -> tuple[float, float]:
    """Seconds of one diagnosis with no response of the bench kept, and with all of them.

    Appearance maps are there and programs are compiled; the cold time is that of the first
    measurement on a bench that the diagnosis never saw.
    """
    from diagnosis import diagnose
    from diagnosis.translucent import translucent_case
    from twin.measurement import read_netcdf

    first = sorted((folder / MEASUREMENTS).glob(f"[0-9]*/{MEASUREMENT}"))[1]
    measurement = read_netcdf(first)
    maps = maps_of(suite, measurement.bench, measurement.samples)
    seconds = []
    with TemporaryDirectory() as responses:
        for _ in range(2):
            begin = time.perf_counter()
            case = translucent_case(
                measurement, maps=maps, folder=Path(responses), paths=suite.response_paths
            )
            diagnose(case.problem)
            seconds.append(time.perf_counter() - begin)
    return seconds[0], seconds[1]
