"""Diagnosing a sealed suite: measurements in, outcomes out, labels unseen."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.blind.suite import (
    MEASUREMENT,
    MEASUREMENTS,
    OPENED,
    OUTCOMES,
    OUTCOMES_FILE,
    SEAL,
    VERSION,
    Suite,
    maps_of,
    read_suite,
)
from scenarios.console import Console
from scenarios.outputs import canonical_json, file_digest
from scenarios.sweep import Workers, sweep
from twin.errors import InputError
from twin.files import write_atomically

if TYPE_CHECKING:
    from diagnosis import Channel, Diagnosis, Problem
    from diagnosis.translucent import TranslucentCase

TASK = "scenarios.blind.run:diagnosed"
LISTED = 12
"""Effects that an outcome lists beyond which only the total of their probabilities is kept."""


def run(
    folder: Path, *, workers: Workers | None = None, console: Console | None = None
) -> dict[str, Any]:
    """Diagnose the measurements of a suite that have no outcome yet.

    Args:
        folder: of the suite.
        workers: who works; None: this process.
        console: is told how far it is.

    Returns:
        Number of outcomes, and of diagnoses that failed, with the reason.

    Raises:
        InputError: no suite, no measurement, or a suite that was opened.
    """
    suite = read_suite(folder)
    if (folder / OPENED).exists():
        raise InputError(
            "a suite whose seals were opened", "one that is still sealed", file=folder,
            remedy="Its outcomes stand: benchtwin blind score FOLDER.",
        )  # fmt: skip
    found = sorted((folder / MEASUREMENTS).glob(f"[0-9]*/{SEAL}"))
    if not found:
        raise InputError(
            "no measurements", "a suite with measurements", file=folder,
            remedy="Make them first: benchtwin blind make FOLDER.",
        )  # fmt: skip
    points = []
    for seal in found:
        path = seal.parent / MEASUREMENT
        without = json.loads(seal.read_text(encoding="utf-8"))["without"]
        points.append(
            {
                "suite": suite.point, "path": str(path.resolve()), "digest": file_digest(path),
                "without": without,
            }
        )  # fmt: skip
    done = sweep(
        TASK, points, folder / OUTCOMES, version=VERSION, workers=workers, console=console,
        title="diagnose sealed measurements",
    )  # fmt: skip
    outcomes = {
        str(int(seal.parent.name)): json.loads(bytes(result["outcome"]).decode())
        for seal, result in zip(found, done.results(), strict=True)
        if result is not None
    }
    for failure in done.failures:
        outcomes[str(int(found[failure.number].parent.name))] = {"failed": failure.message}
    text = canonical_json(outcomes, indent=None) + "\n"
    write_atomically(folder / OUTCOMES / OUTCOMES_FILE, text.encode())
    return {
        "outcomes": len(outcomes) - len(done.failures),
        "failed": [
            {"number": int(found[f.number].parent.name), "reason": f.message} for f in done.failures
        ],
    }


def diagnosed(point: dict[str, Any]) -> Mapping[str, Any]:
    """The task: the outcome of one measurement as JSON bytes."""
    from diagnosis import diagnose
    from diagnosis.translucent import translucent_case
    from twin.effects import catalogue
    from twin.measurement import read_netcdf

    suite = Suite(**point["suite"])
    measurement = read_netcdf(point["path"])
    effects = catalogue().without(point["without"])
    maps = maps_of(suite, measurement.bench, measurement.samples)
    case = translucent_case(measurement, maps=maps, effects=effects, paths=suite.response_paths)
    text = canonical_json(outcome_of(case, diagnose(case.problem)), indent=None)
    return {"outcome": np.frombuffer(text.encode(), dtype=np.uint8)}


def outcome_of(case: TranslucentCase, found: Diagnosis) -> dict[str, Any]:
    """What is kept of a diagnosis: its answer, those of the baselines, and what judges closure."""
    from scenarios.blind.baselines import baselines

    answer = found.as_json()
    effects: list[dict[str, Any]] = answer["effects"]  # type: ignore[assignment]
    kept = ("verdict", "reason", "p", "no_gap_probability", "unknown_probability", "leading",
            "credible_set", "leading_set", "groups", "closure", "prior_dependent")  # fmt: skip
    outcome: dict[str, Any] = {name: answer[name] for name in kept}
    outcome |= {
        "effects": effects[:LISTED],
        "probability": {each["name"]: each["probability"] for each in effects},
        "candidates": [each.name for each in case.problem.candidates],
        "not_identifiable": [each.name for each in found.not_identifiable],
        "left_out": [[each.name, each.reason] for each in case.left_out],
    }
    if found.adequacy is not None:
        rest = found.adequacy
        outcome["rest"] = {"p": rest.p, "chi_square": rest.chi_square, "freedom": rest.freedom}
    if found.null is not None:
        outcome["baselines"] = baselines(case.problem, found.null)
        outcome["rest_without_effects"] = [found.null.chi_square, found.null.reduction.freedom]
    outcome["oracles"], outcome["judged"] = _closures(case, case.problem, found)
    return outcome


def _closures(
    case: TranslucentCase, problem: Problem, found: Diagnosis
) -> tuple[list[dict[str, Any]], dict[str, Any] | None]:
    """Closure had the truth been one of the leaders, and what a true closure is computed from.

    After the opening, when the response of the world is known, `judged` tells how much of it the
    chosen effects leave: `along` takes a response (W, S, 3) to the directions that the closure
    judges, `moved` are the chosen effects there.
    """
    from diagnosis import PriorOdds, closure
    from diagnosis.adequacy import orthonormal
    from diagnosis.closure import directions

    if found.closure is None or found.posterior is None or found.null is None:
        return [], None
    if list(found.names) != [each.name for each in problem.candidates]:
        return [], None
    posterior, odds = found.posterior, PriorOdds()
    oracles = []
    for hypothesis in posterior.fits:
        value = closure(problem, found.null, posterior, odds, force=hypothesis).value
        names = [problem.candidates[i].name for i in hypothesis]
        oracles.append({"effects": names, "value": value})
    chosen = found.closure.chosen[0][0]
    fit = posterior.fits.get(chosen, found.null)
    raw = directions(problem, found.null, posterior)
    basis = orthonormal(fit.reduction(raw))
    if chosen in posterior.fits:
        columns = fit.columns
    else:
        own = [column for i in chosen for column in problem.columns[i]]
        columns = fit.reduction(np.moveaxis(problem.signatures[own], 0, -1))
    samples = list(dict.fromkeys(channel.sample for channel in problem.channels))
    fitted = np.zeros(columns.shape[1])
    explained = np.zeros((len(fit.material), 3 * len(samples)))
    if chosen in posterior.fits:
        # the effects as they are, where the columns are their slopes at the fit
        fitted, plain = fit.value, problem.forward(fit.material, {})
        for number, channel in enumerate(problem.channels):
            explained[:, _place(channel, samples)] = (fit.predicted - plain)[:, number]
    units = np.zeros((*problem.value.shape, 3 * len(samples)))
    for number, channel in enumerate(problem.channels):
        units[:, number, _place(channel, samples)] = 1.0
    wavelengths = problem.value.shape[0]
    along = np.zeros((basis.shape[1], wavelengths, units.shape[2]))
    left = np.zeros((columns.shape[1], wavelengths, units.shape[2]))
    for index in range(wavelengths):
        only = np.zeros_like(units)
        only[index] = units[index]
        reduced = fit.reduction(only)
        along[:, index] = basis.T @ reduced
        left[:, index] = columns.T @ reduced
    judged = {
        "effects": [problem.candidates[i].name for i in chosen],
        "along": _rounded(along),
        "moved": _rounded(basis.T @ columns),
        "inner": _rounded(left),
        "gram": _rounded(columns.T @ columns),
        "value": _rounded(fitted),
        "explained": _rounded(explained),
        "oracle_floor": found.closure.oracle_floor,
    }
    return oracles, judged


def _place(channel: Channel, samples: list[str]) -> int:
    capture = ("black", "white", "collimated").index(channel.capture)
    return 3 * samples.index(channel.sample) + capture


def _rounded(values: np.ndarray) -> list[Any]:
    """Six digits are plenty, and a third of the space."""
    flat = [float(f"{value:.6g}") for value in values.ravel()]
    shaped: list[Any] = np.array(flat).reshape(values.shape).tolist()
    return shaped
