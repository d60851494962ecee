"""Errors and coverage of the estimators over the appearance map, against the Monte Carlo twin.

200 materials (albedo 0.1 to 0.999, sigma_t 0.3 to 15 per mm, g 0 to 0.9), 0.4 and 0.8 mm thick, on
the default bench at twice the noise of its instrument and lamps, so that the error of the
simulated light is a small part of it (`light_share_*`: medians, in units of the whole standard
error). The light and the maps are kept in the user's cache: a second run takes only the
estimators' time.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

ESTIMATORS = ("lut-seed", "lut", "least-squares", "posterior")
NOISE = 2.0
SHORT = {"albedo": "albedo", "sigma_t_per_mm": "sigma_t_relative", "g": "g"}


def run(quick: bool) -> dict[str, Any]:
    """Run the stress test of the three estimators.

    Args:
        quick: 64 materials, coarse light and a coarse map; the error of the light is then a large
            part of the noise.

    Returns:
        median_error_*: median absolute errors by estimator, at the points that all of them answer;
        ratio_to_lut_seed_*, ratio_to_lut_*: in units of those of the look-up table as the seed
            describes it, and of ours;
        coverage90: share of the 90 % intervals that hold the truth wherever the estimator calls
        the parameter identifiable, by estimator, all parameters together; coverage90_*: by
        parameter; overconfident_fraction: points at which any such value is more than 5 stated
        standard errors from the truth; answered, statuses, seconds_per_1000_wavelengths.
    """
    from scenarios.console import Console
    from scenarios.stress import StressPlan, run_plan
    from scenarios.stress.tables import light_facts, scores_of
    from twin.toml import validate

    plan = validate(
        {
            "title": "Benchmark of the estimators",
            "estimators": [{"name": name} for name in ESTIMATORS],
            "points": 200,
            "points_per_visit": 200,
            "noise": [NOISE],
        },
        StressPlan,
    ).settled(quick=quick)
    with tempfile.TemporaryDirectory() as folder:
        outcome = run_plan(plan, Path(folder), console=Console())
    scores = {case.estimator: score for case, score in scores_of(outcome).items()}
    answers = {case.estimator: own for case, own in outcome.answers.items()}
    light = light_facts(outcome, "bench", NOISE)
    figures: dict[str, Any] = {
        "points": len(outcome.design),
        "noise_level": NOISE,
        **{
            f"noise_relative_{name}": facts["median_relative_standard_error"]
            for name, facts in light.items()
        },
        **{f"light_share_{name}": facts["median_light_share"] for name, facts in light.items()},
        **_errors(outcome.design.material, answers),
    }
    for index, name in enumerate(SHORT):
        figures[f"coverage90_{SHORT[name]}"] = {
            title: score.parameters[name].coverage[1].value for title, score in scores.items()
        }
        figures[f"claimed_{SHORT[name]}"] = {
            title: int(own.claimed[:, index].sum()) for title, own in answers.items()
        }
    return figures | {
        "coverage90": {title: _coverage(score) for title, score in scores.items()},
        "overconfident_fraction": {
            title: score.overconfident.value for title, score in scores.items()
        },
        "answered": {title: score.answered for title, score in scores.items()},
        "statuses": {title: dict(score.status) for title, score in scores.items()},
        "seconds_per_1000_wavelengths": {
            case.estimator: value for case, value in outcome.seconds.items()
        },
        "raised": list(outcome.raised),
    }


def _errors(truth: Any, answers: dict[str, Any]) -> dict[str, Any]:
    """Median absolute errors at the points that all estimators answer, and their ratios."""
    from scenarios.stress.score import errors_of

    # One that answers nothing (it raised) does not take the points from the others.
    working = {title: own for title, own in answers.items() if own.answered.any()}
    common = np.all([own.answered for own in working.values()], axis=0)
    found: dict[str, Any] = {"common_points": int(common.sum())}
    for index, short in enumerate(SHORT.values()):
        medians = {
            title: float(np.median(np.abs(errors_of(truth, own.value)[common, index])))
            for title, own in working.items()
        }
        found[f"median_error_{short}"] = medians
        for table in ("lut-seed", "lut"):
            if table in medians:
                found[f"ratio_to_{table.replace('-', '_')}_{short}"] = {
                    title: value / medians[table]
                    for title, value in medians.items()
                    if title != table
                }
    return found


def _coverage(score: Any) -> dict[str, float]:
    """The 90 % intervals of all parameters together, with the counted share's 95 % interval."""
    from scenarios.stress.score import Share

    shares = [own.coverage[1] for own in score.parameters.values()]
    whole = Share(sum(s.count for s in shares), sum(s.total for s in shares))
    low, high = whole.interval
    return {"share": whole.value, "low": low, "high": high}
