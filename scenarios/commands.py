"""What the commands do: read, work, and write an output folder."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.console import Console
from scenarios.outputs import canonical_json, file_digest, prepare_folder
from scenarios.pipeline import Estimated, appearance_maps, check_estimator, estimate_measurement
from scenarios.scenario import (
    EstimatorChoice,
    Scenario,
    builtin_names,
    load_scenario,
    scenario_name,
)
from scenarios.simulate import check_cover, simulate_visit, software
from scenarios.summary import summary_of
from twin.errors import InputError
from twin.files import write_atomically

if TYPE_CHECKING:
    from twin.measurement import Measurement

MEASUREMENT, RESULT, TABLE = "measurement.nc", "result.nc", "result.csv"
REPORT, SUMMARY, SETTINGS = "report.html", "summary.json", "scenario.json"
"""Names of the files in an output folder."""


def run_scenario(
    name: str,
    *,
    out: Path | None = None,
    seed: int | None = None,
    quick: bool = False,
    threads: int | None = None,
    resume: bool = False,
    cache: Path | None = None,
    console: Console,
) -> dict[str, Any]:
    """Simulate, estimate, report; returns the summary that is also written.

    Raises:
        InputError: the scenario or the output folder cannot be used.
    """
    scenario = _ready(name, seed=seed, quick=quick)
    cache, folder = _cache(cache), _folder(out, name)
    with _said_of(name):
        measurement = _visit(scenario, folder, threads=threads, resume=resume, console=console)
        estimated = estimate_measurement(
            measurement,
            scenario.estimator,
            settings=scenario.map,
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

    scenario = _ready(name, seed=seed, quick=quick)
    folder = _folder(out, name)
    with _said_of(name):
        measurement = _visit(scenario, folder, threads=threads, resume=resume, console=console)
    return {
        "command": "simulate",
        "scenario": scenario_name(name),
        "folder": str(folder),
        "files": _digests(folder, (MEASUREMENT, SETTINGS)),
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
    threads: int | None = None,
    cache: Path | None = None,
    console: Console,
) -> dict[str, Any]:
    """Estimate from a measurement on disk; returns the summary that is also written.

    Raises:
        InputError: the measurement, the settings or the output folder cannot be used.
    """
    from twin.measurement import read_measurement

    scenario = load_scenario(settings).settled(quick=quick)
    choice = scenario.estimator
    if estimator is not None and estimator != choice.name:
        choice = EstimatorChoice(name=estimator)
    if seed is not None:
        choice = choice.model_copy(update={"options": choice.options | {"seed": seed}})
    scenario = scenario.model_copy(update={"estimator": choice})
    check_estimator(choice)
    measurement = read_measurement(path)
    cache = _cache(cache)
    folder = prepare_folder(out or Path(f"benchtwin-{path.resolve().stem}-estimate"))
    with _said_of(path):
        estimated = estimate_measurement(
            measurement,
            choice,
            settings=scenario.map,
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
) -> dict[str, Any]:
    """Compute a scenario's appearance maps into the cache; returns what they are.

    Raises:
        InputError: the scenario cannot be used, or the cache cannot be written.
    """
    from scenarios.describe import map_facts

    scenario = load_scenario(name).settled(quick=quick)
    cache = _cache(cache)
    maps = appearance_maps(
        scenario.bench,
        scenario.samples,
        np.asarray(scenario.bench.instrument.wavelength_nm),
        scenario.map,
        cache=cache,
        threads=threads,
        console=console,
    )
    return {
        "command": "map",
        "scenario": scenario_name(name),
        "maps": [
            {"sample": sample.name, **map_facts(found)}
            for sample, found in zip(scenario.samples, maps, strict=True)
        ],
    }


def stress(
    name: str,
    *,
    out: Path | None = None,
    seed: int | None = None,
    quick: bool = False,
    points: int | None = None,
    estimators: Sequence[str] = (),
    threads: int | None = None,
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
    proved = _cache(cache)
    with _said_of(name):
        outcome = run_plan(
            plan, folder, cache=proved if cache else None, threads=threads, console=console
        )
    with console.step("write the report"):
        return write_outcome(outcome, folder, title)


def _ready(name: str, *, seed: int | None, quick: bool) -> Scenario:
    """The settled scenario, with everything checked that can be before the work starts."""
    loaded = load_scenario(name)
    scenario = loaded.settled(seed=seed, quick=quick)
    with _said_of(name):
        check_cover(scenario)
        check_estimator(scenario.estimator)
    return scenario


@contextlib.contextmanager
def _said_of(source: str | Path) -> Iterator[None]:
    """A wrong input that names no file is said of the scenario or the measurement."""
    try:
        yield
    except InputError as error:
        builtin = source in builtin_names()
        file = f"built-in scenario {source}" if builtin else source
        raise (error if error.file else error.at(file)) from error


def _folder(out: Path | None, name: str) -> Path:
    return prepare_folder(out or Path(f"benchtwin-{scenario_name(name)}"))


def _cache(folder: Path | None) -> Path:
    """The folder of the maps, proved to be writable before minutes of work."""
    from twin.cache import cache_folder

    try:
        return prepare_folder(folder or cache_folder("maps"))
    except InputError as error:
        raise InputError(
            error.found.replace("an output folder", "a cache folder"),
            error.expected,
            file=error.file,
            remedy="Name another folder with --cache, or set BENCHTWIN_CACHE.",
        ) from error


def _visit(
    scenario: Scenario, folder: Path, *, threads: int | None, resume: bool, console: Console
) -> Measurement:
    """Simulate a visit and write it, or take the one that is there when it is the same."""
    from twin.measurement import write_measurement

    path = folder / MEASUREMENT
    if resume and path.exists():
        found = _same_visit(scenario, path, console)
        if found is not None:
            _write_json(folder / SETTINGS, scenario.model_dump(mode="json"))
            return found
    with console.step("simulate the captures") as progress:
        measurement = simulate_visit(scenario, threads=threads, progress=progress)
    write_measurement(measurement, path)
    _write_json(folder / SETTINGS, scenario.model_dump(mode="json"))
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
    with console.step("write the report"):
        write_report(
            measurement,
            estimated.result,
            folder / REPORT,
            maps=estimated.maps,
            settings=_report_settings(scenario, command, simulated=name is not None),
        )
    _write_json(folder / SETTINGS, scenario.model_dump(mode="json"))
    summary = summary_of(measurement, estimated.result, scenario=name or "")
    made = (
        (MEASUREMENT, SETTINGS, RESULT, TABLE, REPORT)
        if name
        else (SETTINGS, RESULT, TABLE, REPORT)
    )
    summary["files"] = _digests(folder, made)
    _write_json(folder / SUMMARY, summary)
    return {"folder": str(folder), **summary}


def _report_settings(scenario: Scenario, command: str, *, simulated: bool) -> dict[str, Any]:
    settings = scenario.model_dump(mode="json")
    settings.pop("bench")  # the report shows the measurement's own
    if not simulated:
        settings = {key: settings[key] for key in ("map", "estimator")}
        settings["title"] = ""
    return {**settings, "command": command}


def _digests(folder: Path, files: tuple[str, ...]) -> dict[str, str]:
    """SHA-256 of each file: how a person sees that two runs are the same."""
    return {name: file_digest(folder / name) for name in files}


def _write_json(path: Path, value: Mapping[str, Any]) -> None:
    write_atomically(path, (canonical_json(value) + "\n").encode())
