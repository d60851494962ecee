"""`benchtwin run`, `simulate`, `estimate` and `map`: visits to the bench and what they tell."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.commands import fluorescence
from scenarios.commands.common import (
    cache_of,
    digests,
    said_of,
    settings_for_file,
    with_estimator,
    write_json,
)
from scenarios.console import Console
from scenarios.maps import appearance_maps
from scenarios.outputs import prepare_folder
from scenarios.pipeline import (
    Estimated,
    check_budget,
    check_estimator,
    estimate_measurement,
)
from scenarios.scenario import Scenario, load_scenario, scenario_name
from scenarios.simulate import check_cover, simulate_visit, software
from scenarios.summary import summary_of
from twin.errors import InputError

if TYPE_CHECKING:
    from scenarios.sweep import Workers
    from twin.measurement import Measurement

MEASUREMENT, RESULT, TABLE = "measurement.nc", "result.nc", "result.csv"
REPORT, SUMMARY, SETTINGS, BUDGET = "report.html", "summary.json", "scenario.json", "budget.csv"
"""Names of the files in an output folder."""


def run_scenario(
    name: str,
    *,
    out: Path | None = None,
    estimator: str | None = None,
    seed: int | None = None,
    quick: bool = False,
    budget: bool = False,
    threads: int | None = None,
    resume: bool = False,
    cache: Path | None = None,
    console: Console,
) -> dict[str, Any]:
    """Simulate, estimate, report; returns the summary that is also written.

    Raises:
        InputError: the scenario or the output folder cannot be used.
    """
    if fluorescence.is_fluorescence(name):
        return fluorescence.run_fluorescence(
            name, out=out, estimator=estimator, seed=seed, quick=quick, budget=budget,
            resume=resume, console=console,
        )  # fmt: skip
    scenario = _ready(name, estimator, seed=seed, quick=quick)
    if budget:
        check_budget(scenario.estimator)
    cache, folder = cache_of(cache), _folder(out, name)
    with said_of(name):
        measurement = _visit(scenario, folder, threads=threads, resume=resume, console=console)
        estimated = estimate_measurement(
            measurement,
            scenario.estimator,
            settings=scenario.map,
            budget=budget,
            cache=cache,
            threads=threads,
            console=console,
        )
    return _write(folder, measurement, estimated, scenario, scenario_name(name), console)


def simulate_scenario(
    name: str,
    *,
    out: Path | None = None,
    seed: int | None = None,
    quick: bool = False,
    threads: int | None = None,
    resume: bool = False,
    console: Console,
) -> dict[str, Any]:
    """Simulate a visit into `measurement.nc`; returns what was made.

    Raises:
        InputError: the scenario or the output folder cannot be used.
    """
    from scenarios.describe import measurement_facts

    if fluorescence.is_fluorescence(name):
        return fluorescence.simulate_fluorescence(
            name, out=out, seed=seed, quick=quick, resume=resume, console=console
        )
    scenario = _ready(name, None, seed=seed, quick=quick)
    folder = _folder(out, name)
    with said_of(name):
        measurement = _visit(scenario, folder, threads=threads, resume=resume, console=console)
    return {
        "command": "simulate",
        "scenario": scenario_name(name),
        "folder": str(folder),
        "files": digests(folder, (MEASUREMENT, SETTINGS)),
        "measurement": measurement_facts(measurement),
    }


def estimate_file(
    path: Path,
    *,
    out: Path | None = None,
    settings: str = "default",
    estimator: str | None = None,
    seed: int | None = None,
    quick: bool = False,
    budget: bool = False,
    threads: int | None = None,
    cache: Path | None = None,
    console: Console,
) -> dict[str, Any]:
    """Estimate from a measurement on disk; returns the summary that is also written.

    Raises:
        InputError: the measurement, the settings or the output folder cannot be used.
    """
    from twin.fluorescence import is_fluorescence_visit
    from twin.measurement import read_measurement

    if path.suffix.lower() == ".rxt":
        raise InputError(
            "readings with integrating spheres",
            "a measurement.nc, or a folder made by hand",
            file=path,
            remedy=f"Use `benchtwin spheres {path}`.",
        )
    if is_fluorescence_visit(path):
        return fluorescence.estimate_fluorescence(
            path, out=out, settings=settings, estimator=estimator, seed=seed, quick=quick,
            budget=budget, console=console,
        )  # fmt: skip
    scenario = settings_for_file(settings, estimator, seed, quick=quick)
    if budget:
        check_budget(scenario.estimator)
    measurement = read_measurement(path)
    cache = cache_of(cache)
    folder = prepare_folder(out or Path(f"benchtwin-{path.resolve().stem}-estimate"))
    with said_of(path):
        estimated = estimate_measurement(
            measurement,
            scenario.estimator,
            settings=scenario.map,
            budget=budget,
            cache=cache,
            threads=threads,
            console=console,
        )
    return _write(folder, measurement, estimated, scenario, None, console)


def compute_maps(
    name: str,
    *,
    quick: bool = False,
    threads: int | None = None,
    cache: Path | None = None,
    console: Console,
    workers: Workers | None = None,
) -> dict[str, Any]:
    """Compute a scenario's appearance maps into the cache; returns what they are.

    Raises:
        InputError: the scenario cannot be used, or the cache cannot be written.
    """
    from scenarios.describe import map_facts

    scenario = load_scenario(name).settled(quick=quick)
    cache = cache_of(cache)
    maps = appearance_maps(
        scenario.bench,
        scenario.samples,
        np.asarray(scenario.bench.instrument.wavelength_nm),
        scenario.map,
        cache=cache,
        threads=threads,
        console=console,
        workers=workers,
    )
    return {
        "command": "map",
        "scenario": scenario_name(name),
        "maps": [
            {"sample": sample.name, **map_facts(found)}
            for sample, found in zip(scenario.samples, maps, strict=True)
        ],
    }


def _ready(name: str, estimator: str | None, *, seed: int | None, quick: bool) -> Scenario:
    """The settled scenario, with everything checked that can be before the work starts."""
    scenario = with_estimator(load_scenario(name).settled(seed=seed, quick=quick), estimator)
    with said_of(name):
        check_cover(scenario)
        check_estimator(scenario.estimator)
    return scenario


def _folder(out: Path | None, name: str) -> Path:
    return prepare_folder(out or Path(f"benchtwin-{scenario_name(name)}"))


def _visit(
    scenario: Scenario, folder: Path, *, threads: int | None, resume: bool, console: Console
) -> Measurement:
    """Simulate a visit and write it, or take the one that is there when it is the same."""
    from twin.measurement import write_measurement

    path = folder / MEASUREMENT
    if resume and path.exists():
        found = _same_visit(scenario, path, console)
        if found is not None:
            write_json(folder / SETTINGS, scenario.model_dump(mode="json"))
            return found
    with console.step("simulate the captures") as progress:
        measurement = simulate_visit(scenario, threads=threads, progress=progress)
    write_measurement(measurement, path)
    write_json(folder / SETTINGS, scenario.model_dump(mode="json"))
    return measurement


def _same_visit(scenario: Scenario, path: Path, console: Console) -> Measurement | None:
    from twin.measurement import read_measurement

    try:
        found = read_measurement(path)
    except InputError as error:
        console.say(f"not resumed: {error}")
        return None
    made_by = (found.provenance.scenario, found.provenance.software)
    if made_by != (scenario.text, software()):
        console.say(f"not resumed: {path} was simulated from another scenario, seed or version")
        return None
    console.say(f"resumed: {path} is used again")
    return found


def _write(
    folder: Path,
    measurement: Measurement,
    estimated: Estimated,
    scenario: Scenario,
    name: str | None,
    console: Console,
) -> dict[str, Any]:
    """Write result, table, report and summary; each file whole or not at all."""
    from estimators import write_csv, write_netcdf
    from scenarios.report import write_report

    write_netcdf(estimated.result, folder / RESULT)
    write_csv(estimated.result, folder / TABLE)
    command = f"benchtwin run {SETTINGS}" if name else ""
    if command and estimated.budget is not None:
        command += " --budget"
    with console.step("write the report"):
        write_report(
            measurement,
            estimated.result,
            folder / REPORT,
            maps=estimated.maps,
            budget=estimated.budget,
            settings=_report_settings(scenario, command, simulated=name is not None),
        )
    write_json(folder / SETTINGS, scenario.model_dump(mode="json"))
    summary = summary_of(measurement, estimated.result, scenario=name or "")
    made = [SETTINGS, RESULT, TABLE, REPORT]
    if name:
        made.append(MEASUREMENT)
    if estimated.budget is not None:
        estimated.budget.write_csv(folder / BUDGET)
        summary["budget"] = estimated.budget.to_table()
        made.append(BUDGET)
    summary["files"] = digests(folder, made)
    write_json(folder / SUMMARY, summary)
    return {"folder": str(folder), **summary}


def _report_settings(scenario: Scenario, command: str, *, simulated: bool) -> dict[str, Any]:
    settings = scenario.model_dump(mode="json")
    settings.pop("bench")  # the report shows the measurement's own
    if not simulated:
        settings = {key: settings[key] for key in ("map", "estimator")}
        settings["title"] = ""
    return {**settings, "command": command}
