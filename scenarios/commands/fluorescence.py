"""`benchtwin run`, `simulate` and `estimate` on the fluorescence bench."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import TYPE_CHECKING, Any

from scenarios.commands.common import digests, said_of, write_json
from scenarios.console import Console
from scenarios.outputs import prepare_folder
from twin.errors import InputError

if TYPE_CHECKING:
    from estimators.fluorescence import FluorescenceEstimator, FluorescenceResult
    from scenarios.fluorescence import FluorescenceScenario
    from twin.fluorescence import (
        FluorescenceData,
        FluorescenceSetup,
        FluorescenceVisit,
        MixtureModel,
    )

MEASUREMENT, RESULT, CELLS = "measurement.nc", "result.nc", "cells.csv"
MATRIX, MIXTURE = "matrix.csv", "mixture.json"
REPORT, SUMMARY, SETTINGS = "report.html", "summary.json", "scenario.json"
"""Names of the files in an output folder."""

ESTIMATOR = "donaldson"
NOTHING_INSIDE, MUCH_OUTSIDE = 0.999, 0.05
"""Shares of an illuminant's energy outside the bins that are refused, and said."""


def is_fluorescence(name: str) -> bool:
    """Whether a scenario is one of the fluorescence bench, or a misspelt name of one."""
    from scenarios.fluorescence import builtin_names, is_fluorescence_scenario
    from scenarios.scenario import builtin_names as other_names

    if is_fluorescence_scenario(name):
        return True
    path = Path(name)
    plain = len(path.parts) == 1 and not path.suffix and not path.exists()
    if not plain or name in other_names():
        return False
    near = difflib.get_close_matches(name.lower(), [*builtin_names(), *other_names()], n=1)
    return bool(near) and near[0] in builtin_names()


def run_fluorescence(
    name: str,
    *,
    out: Path | None,
    estimator: str | None,
    seed: int | None,
    quick: bool,
    budget: bool,
    resume: bool,
    console: Console,
) -> dict[str, Any]:
    """Simulate a fluorescence visit, estimate, report; returns the summary that is also written.

    Raises:
        InputError: the scenario, the estimator or the output folder cannot be used.
    """
    scenario, short = _ready(name, seed)
    _no_translucent_options(budget, console, quick=quick)
    chosen = _estimator(estimator, None)
    folder = prepare_folder(out or Path(f"benchtwin-{short}"))
    with said_of(name):
        visit = _visit(scenario, folder, resume=resume, console=console)
        data, result = _estimate(visit, chosen, console)
    return _write(folder, visit, data, result, short, console, title=scenario.title)


def simulate_fluorescence(
    name: str,
    *,
    out: Path | None,
    seed: int | None,
    quick: bool,
    resume: bool,
    console: Console,
) -> dict[str, Any]:
    """Simulate a fluorescence visit into `measurement.nc`; returns what was made.

    Raises:
        InputError: the scenario or the output folder cannot be used.
    """
    from scenarios.fluorescence.facts import visit_facts

    scenario, short = _ready(name, seed)
    _no_translucent_options(False, console, quick=quick)
    folder = prepare_folder(out or Path(f"benchtwin-{short}"))
    with said_of(name):
        visit = _visit(scenario, folder, resume=resume, console=console)
    return {
        "command": "simulate",
        "scenario": short,
        "folder": str(folder),
        "files": digests(folder, (MEASUREMENT, SETTINGS)),
        "measurement": visit_facts(visit),
    }


def estimate_fluorescence(
    path: Path,
    *,
    out: Path | None,
    settings: str,
    estimator: str | None,
    seed: int | None,
    quick: bool,
    budget: bool,
    console: Console,
) -> dict[str, Any]:
    """Estimate the Donaldson matrix from a fluorescence visit; returns the summary.

    Raises:
        InputError: the visit, the estimator or the output folder cannot be used.
    """
    from twin.fluorescence import read_visit

    if settings != "default":
        raise InputError(
            f"--scenario {settings} for a fluorescence visit", "no --scenario: the visit says all",
            file=path, remedy="Choose the estimator with --estimator.",
        )  # fmt: skip
    _no_translucent_options(budget, console, quick=quick)
    chosen = _estimator(estimator, seed)
    visit = read_visit(path)
    folder = prepare_folder(out or Path(f"benchtwin-{path.resolve().stem}-estimate"))
    with said_of(path):
        data, result = _estimate(visit, chosen, console)
    return _write(folder, visit, data, result, None, console)


def _ready(name: str, seed: int | None) -> tuple[FluorescenceScenario, str]:
    """The settled scenario and its short name, its sample looked up before anything is written."""
    from scenarios.fluorescence import builtin_names, load_scenario, material_of

    with said_of(name):
        scenario = load_scenario(name).settled(seed=seed)
        material_of(scenario)
        _light_outside(scenario.setup)
    return scenario, name if name in builtin_names() else Path(name).stem


def _light_outside(setup: FluorescenceSetup) -> list[str]:
    """Sentences about illuminants that have much of their light outside the excitation bins.

    Raises:
        InputError: one that has next to nothing inside: a sensor and a light that do not overlap.
    """
    import numpy as np

    from twin.fluorescence import outside_share

    with np.errstate(all="ignore"):
        shares = outside_share(setup.lights, setup.excitation_nm)
    low, high = setup.excitation_nm[0], setup.excitation_nm[-1]
    said = []
    for light, share in zip(setup.lights, shares, strict=True):
        if not share < NOTHING_INSIDE:
            raise InputError(
                f"the illuminant {light.name!r} with no light from {low:g} to {high:g} nm",
                "illuminants inside the wavelengths of the matrix, where the detector sees them",
                place="setup.lights", remedy="Leave it out, or widen the wavelengths.",
            )  # fmt: skip
        if share > MUCH_OUTSIDE:
            said.append(
                f"{100 * share:.0f} % of the light of {light.name!r} lies outside {low:g} to"
                f" {high:g} nm and is not in the model; a smaller excitation_from_nm takes more in"
            )
    return said


def _no_translucent_options(budget: bool, console: Console, *, quick: bool) -> None:
    if budget:
        raise InputError(
            "--budget for the fluorescence bench", "a translucent measurement", place="--budget",
            remedy="The report shows the interval of every cell and what it comes from.",
        )  # fmt: skip
    if quick:
        console.say("--quick changes nothing here: there is no map and no light path to save")


def _estimator(name: str | None, seed: int | None) -> FluorescenceEstimator:
    """The estimator; a seed goes to those that draw.

    Raises:
        InputError: an unknown name.
    """
    from estimators.fluorescence import fluorescence_estimator

    wanted = name or ESTIMATOR
    draws = wanted in (ESTIMATOR, "donaldson-linear", "fluorescence-posterior")
    return fluorescence_estimator(wanted, **({"seed": seed} if draws and seed is not None else {}))


def _visit(
    scenario: FluorescenceScenario, folder: Path, *, resume: bool, console: Console
) -> FluorescenceVisit:
    """Simulate a visit and write it, or take the one that is there when it is the same."""
    from scenarios.fluorescence import simulate_visit
    from scenarios.simulate import software
    from twin.fluorescence import read_visit, write_visit

    path = folder / MEASUREMENT
    write_json(folder / SETTINGS, scenario.model_dump(mode="json"))
    if resume and path.exists():
        try:
            found = read_visit(path)
        except InputError as error:
            console.say(f"not resumed: {error}")
        else:
            made_by = (found.provenance.scenario, found.provenance.software)
            if made_by == (scenario.text, software()):
                console.say(f"resumed: {path} is used again")
                return found
            console.say(f"not resumed: {path} is of another scenario, seed or version")
    with console.step("simulate the captures"):
        visit = simulate_visit(scenario)
    write_visit(visit, path)
    return visit


def _estimate(
    visit: FluorescenceVisit, estimator: FluorescenceEstimator, console: Console
) -> tuple[FluorescenceData, FluorescenceResult]:
    from twin.fluorescence import corrected

    _light_outside(visit.setup)
    data = corrected(visit)
    with console.step(f"estimate with {estimator.name}") as progress:
        if hasattr(estimator, "report"):
            estimator.report = progress
        result = estimator.estimate(data)
    return data, result


def _write(
    folder: Path,
    visit: FluorescenceVisit,
    data: FluorescenceData,
    result: FluorescenceResult,
    name: str | None,
    console: Console,
    *,
    title: str = "",
) -> dict[str, Any]:
    """Write estimate, exports, report and summary; each file whole or not at all."""
    from estimators.fluorescence import mixture_of
    from estimators.fluorescence.result_file import write_cells_csv, write_result
    from scenarios.fluorescence.facts import capture_facts, result_facts, setup_facts
    from scenarios.report_fluorescence import write_fluorescence_report
    from scenarios.simulate import software
    from twin.fluorescence import write_matrix_csv, write_mixture

    mixture = mixture_of(result)
    notes = [*_light_outside(visit.setup), *(data.truth.notes if data.truth is not None else ())]
    write_result(result, folder / RESULT)
    write_cells_csv(result, folder / CELLS)
    write_matrix_csv(result.donaldson, folder / MATRIX)
    write_mixture(mixture, folder / MIXTURE)
    with console.step("write the report"):
        write_fluorescence_report(
            visit, data, result, folder / REPORT, mixture=mixture, title=title, notes=notes,
            command=f"benchtwin run {SETTINGS}" if name else "",
        )  # fmt: skip
    made = [RESULT, CELLS, MATRIX, MIXTURE, REPORT]
    if name:
        made += [MEASUREMENT, SETTINGS]
    provenance = visit.provenance
    summary = {
        "scenario": name or "",
        "seed": provenance.seed,
        "origin": provenance.origin,
        "software": software(),
        "measurement_fingerprint": visit.fingerprint,
        "setup": setup_facts(visit.setup),
        **capture_facts(data),
        **result_facts(result, data.truth),
        "notes": notes,
        "mixture_rmse": _mixture_error(mixture, result),
        "files": digests(folder, made),
    }
    write_json(folder / SUMMARY, summary)
    return {"folder": str(folder), **summary}


def _mixture_error(mixture: MixtureModel, result: FluorescenceResult) -> float:
    """How far the exported mixture's fluorescence is from the estimate's, RMSE over its cells."""
    import numpy as np

    from twin.fluorescence import from_mixture

    exported = from_mixture(
        mixture, reflectance=0.5, emission_nm=result.emission_nm,
        excitation_nm=result.excitation_nm,
    )  # fmt: skip
    cells = exported.is_fluorescence
    return float(np.sqrt(((exported.matrix - result.matrix)[cells] ** 2).mean()))
