"""`benchtwin budget`: which input is to blame for the uncertainty."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from scenarios.commands.common import cache_of, digests, said_of, settings_for_file, write_json
from scenarios.console import Console
from scenarios.outputs import prepare_folder
from scenarios.pipeline import BUDGETED, budget_of
from twin.files import write_atomically

TABLE, PAGE, SUMMARY = "budget.csv", "budget.html", "summary.json"
"""Names of the files in an output folder."""


def budget_file(
    path: Path,
    uncertainties: dict[str, float],
    *,
    out: Path | None = None,
    settings: str = "default",
    draws: int = 0,
    seed: int = 0,
    quick: bool = False,
    threads: int | None = None,
    cache: Path | None = None,
    console: Console,
) -> dict[str, Any]:
    """Budget of the least-squares estimate from a measurement on disk.

    Args:
        path: of the measurement.
        uncertainties: fields of `estimators.InputUncertainty` that differ from its defaults.
        out: folder of the results.
        settings: scenario whose map and least-squares options are used.
        draws: of the check by Monte Carlo; 0: no check.
        seed: of these draws.
        quick: a coarse map.
        threads: of the maps' Monte Carlo.
        cache: folder of the maps.
        console: is told what happens.

    Returns:
        The summary that is also written.

    Raises:
        InputError: the measurement, a number or the output folder cannot be used.
    """
    from estimators import InputUncertainty
    from scenarios.report.budget_page import budget_page
    from twin.measurement import read_measurement

    stated = InputUncertainty(**uncertainties)
    scenario = settings_for_file(settings, BUDGETED, None, quick=quick)
    measurement = read_measurement(path)
    cache = cache_of(cache)
    folder = prepare_folder(out or Path(f"benchtwin-{path.resolve().stem}-budget"))
    with said_of(path):
        budget = budget_of(
            measurement,
            scenario.estimator,
            stated,
            settings=scenario.map,
            draws=draws,
            seed=seed,
            cache=cache,
            threads=threads,
            console=console,
        )
    budget.write_csv(folder / TABLE)
    page = budget_page(budget, measurement)
    write_atomically(folder / PAGE, page.encode())
    summary = {
        "command": "budget",
        "measurement_fingerprint": measurement.fingerprint,
        "wavelengths": int(budget.wavelength_nm.size),
        "stated": vars(stated),
        "monte_carlo_draws": budget.draws,
        "improve_first": budget.first,
        "budget": budget.to_table(),
        "files": digests(folder, (TABLE, PAGE)),
    }
    write_json(folder / SUMMARY, summary)
    return {"folder": str(folder), **summary}
