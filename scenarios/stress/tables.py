"""A finished stress test as files: every point as a row, the scores, the summary."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any

import numpy as np

from scenarios.outputs import canonical_json, file_digest
from scenarios.simulate import software
from scenarios.stress.cost import costs_of
from scenarios.stress.parts import Case, Outcome, Setting
from scenarios.stress.plan import NONE
from scenarios.stress.ranking import ranking
from scenarios.stress.score import COVERAGES, PARAMETERS, Score, score_of, status_name
from twin.files import write_atomically

POINTS, SCORES, PLAN = "points.csv", "scores.json", "plan.json"
REPORT, SUMMARY, TIMING = "report.html", "summary.json", "timing.json"
"""Names of the files in an output folder; only the last differs from run to run."""
CAPTURES = ("black", "white", "collimated")


def scores_of(outcome: Outcome) -> dict[Case, Score]:
    """The score of every estimator on every bench at every noise level."""
    truth = outcome.design.material
    return {case: score_of(truth, answers) for case, answers in outcome.answers.items()}


def worlds_of(outcome: Outcome) -> list[Setting]:
    """Benches, noise levels and effects, those of one bench and level together."""
    settings = list(dict.fromkeys(case.setting for case in outcome.answers))
    order = list(dict.fromkeys((each.bench, each.noise) for each in settings))
    return sorted(settings, key=lambda each: order.index((each.bench, each.noise)))


def light_facts(outcome: Outcome, bench: str, noise: float, effects: str = NONE) -> dict[str, Any]:
    """By capture: the noise, and how much of it is the error of the simulated light.

    Medians over points and samples; the share also at its 90 % quantile.
    """
    setting = Setting(bench, noise, effects)
    share, sigma = outcome.light_share[setting], outcome.relative_sigma[setting]
    return {
        capture: {
            "median_relative_standard_error": _quantile(sigma[..., index], 0.5),
            "median_light_share": _quantile(share[..., index], 0.5),
            "p90_light_share": _quantile(share[..., index], 0.9),
        }
        for index, capture in enumerate(CAPTURES)
    }


def write_outcome(outcome: Outcome, folder: Path, name: str) -> dict[str, Any]:
    """Write every file; returns the summary with times, which no file but `timing.json` holds.

    Raises:
        InputError: the folder cannot be written.
    """
    from scenarios.stress.report import render

    scores = scores_of(outcome)
    plan = outcome.plan.model_dump(mode="json")
    worlds = [_world(outcome, scores, setting) for setting in worlds_of(outcome)]
    costs = [cost.plain() for cost in costs_of(outcome, scores)]
    told = {"effects": costs} if costs else {}
    _write(folder / POINTS, points_csv(outcome))
    _write(folder / SCORES, canonical_json({"worlds": worlds, **told}) + "\n")
    _write(folder / PLAN, canonical_json(plan) + "\n")
    _write(folder / REPORT, render(outcome, scores, name))
    summary = {
        "command": "stress",
        "plan": name,
        "seed": outcome.plan.seed,
        "software": software(),
        "points": len(outcome.design),
        "worlds": [
            {key: value for key, value in world.items() if key != "estimators"} for world in worlds
        ],
        **told,
        "raised": list(outcome.raised),
        "files": {file: file_digest(folder / file) for file in (POINTS, SCORES, PLAN, REPORT)},
    }
    _write(folder / SUMMARY, canonical_json(summary) + "\n")
    seconds = [
        {**_named(outcome, case.setting), "estimator": case.estimator, "seconds": value}
        for case, value in outcome.seconds.items()
    ]
    _write(folder / TIMING, canonical_json({"seconds_per_1000_wavelengths": seconds}) + "\n")
    return {"folder": str(folder), **summary, "seconds_per_1000_wavelengths": seconds}


def points_csv(outcome: Outcome) -> str:
    """One row for every point and case: truth, estimate, stated error, intervals, status."""
    effects = bool(outcome.plan.effects)
    header = ["bench", "noise", *["effects"] * effects, "estimator", "point", "visit", "status"]
    for parameter in PARAMETERS:
        header += [f"{parameter}_true", parameter, f"{parameter}_se", f"{parameter}_identifiable"]
        for coverage in COVERAGES:
            header += [f"{parameter}_{side}{100 * coverage:g}" for side in ("low", "high")]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    truth, visit = outcome.design.material, outcome.design.visit
    for case, answers in outcome.answers.items():
        for point in range(len(answers)):
            row: list[object] = [case.bench, f"{case.noise:g}", *[case.effects] * effects]
            row += [case.estimator, point, visit[point]]
            row.append(status_name(int(answers.status[point])))
            for index in range(len(PARAMETERS)):
                row += [_number(truth[point, index]), _number(answers.value[point, index])]
                row += [_number(answers.sigma[point, index])]
                row += [int(answers.identifiable[point, index])]
                row += [_number(end) for end in answers.interval[:, :, point, index].ravel()]
            writer.writerow(row)
    return text.getvalue()


def _world(outcome: Outcome, scores: dict[Case, Score], setting: Setting) -> dict[str, Any]:
    mine = {c.estimator: score for c, score in scores.items() if c.setting == setting}
    return {
        **_named(outcome, setting),
        "ranking": ranking(mine),
        "estimators": {title: score.plain() for title, score in mine.items()},
        "light": light_facts(outcome, *setting),
    }


def _named(outcome: Outcome, setting: Setting) -> dict[str, Any]:
    """Bench, noise level and, where the plan has any, effects."""
    effects = {"effects": setting.effects} if outcome.plan.effects else {}
    return {"bench": setting.bench, "noise": setting.noise, **effects}


def _number(value: float) -> str:
    return f"{value:.9g}" if np.isfinite(value) else ""


def _quantile(values: Any, level: float) -> float:
    finite = values[np.isfinite(values)]
    return float(np.quantile(finite, level)) if finite.size else float("nan")


def _write(path: Path, text: str) -> None:
    write_atomically(path, text.encode())
