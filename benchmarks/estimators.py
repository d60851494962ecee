"""Errors and coverage of the estimators over the appearance map, against the Monte Carlo twin.

200 materials (albedo 0.1 to 0.999, sigma_t 0.3 to 15 per mm, g 0 to 0.9), 0.4 and 0.8 mm thick, on
the default bench at twice the noise of its instrument and lamps, so that the error of the
simulated light is a small part of it (`light_share_*`: medians, in units of the whole standard
error). The light and the maps are kept in the user's cache: a second run takes only the
estimators' time.

A second part measures what materials really have: 16 smooth spectra of 16 wavelengths (absorption
bands in a host of power-law scattering, `scenarios.stress.spectra`) on the same bench at the same
noise, each in one visit, so that the lamps' drift is common to its wavelengths; and once more with
lamps that do not drift, which tells how much of the error no estimator can know.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

ESTIMATORS = ("lut-seed", "lut", "least-squares", "posterior")
NOISE = 2.0
SPECTRA, WAVELENGTHS = 16, 16
JOINT = "least-squares joint"
OF_SPECTRA = (
    {"name": "lut-seed"},
    {"name": "lut"},
    {"name": "least-squares"},
    {"name": "least-squares", "label": JOINT, "options": {"joint": True}},
)
FISHER = "least-squares"
"""Whose standard errors are the inverse Fisher information of all captures of a wavelength."""
STEADY = {"instrument": {"kind": "spectrometer", "off": ["lamp_drift"]}}
"""The bench with lamps that do not drift."""
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
        bound_*, bound_ratio_to_*: median error of an unbiased estimator at the Cramer-Rao bound of
            one wavelength, and in units of the tables' errors: less nobody can reach;
        coverage90: share of the 90 % intervals that hold the truth wherever the estimator calls
        the parameter identifiable, by estimator, all parameters together; coverage90_*: by
        parameter; overconfident_fraction: points at which any such value is more than 5 stated
        standard errors from the truth; answered, statuses, seconds_per_1000_wavelengths.
        spectra_*: the same of smooth spectra, see `spectra`.
    """
    return points(quick) | spectra(quick)


def points(quick: bool) -> dict[str, Any]:
    """Another material at every wavelength; see `run`."""
    from scenarios.stress.tables import light_facts, scores_of

    outcome = _outcome(
        {
            "title": "Benchmark of the estimators",
            "estimators": [{"name": name} for name in ESTIMATORS],
            "points": 200,
            "points_per_visit": 200,
        },
        quick,
    )
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


def spectra(quick: bool) -> dict[str, Any]:
    """Smooth spectra, one in every visit.

    Returns:
        spectra_median_error_*, spectra_ratio_to_lut_seed_*, spectra_ratio_to_lut_*,
        spectra_coverage90, spectra_overconfident, by estimator, as for single points;
        spectra_steady_*: the same of lamps that do not drift; spectra_light_share_*: the error of
        the simulated light in units of the whole standard error.
    """
    from scenarios.stress.tables import light_facts, scores_of

    outcome = _outcome(
        {
            "title": "Benchmark of the estimators on smooth spectra",
            "estimators": OF_SPECTRA,
            "points": SPECTRA * WAVELENGTHS,
            "points_per_visit": WAVELENGTHS,
            "materials": {"spectra": True},
            "benches": {"bench": {}, "steady": STEADY},
            # Many more media than above: each wavelength has its own.
            "light": {"relative_error": 1e-3, "most_paths": 1 << 18},
        },
        quick,
    )
    figures: dict[str, Any] = {"spectra_points": len(outcome.design)}
    for bench, head in (("bench", "spectra"), ("steady", "spectra_steady")):
        answers = {c.estimator: own for c, own in outcome.answers.items() if c.bench == bench}
        scores = {c.estimator: s for c, s in scores_of(outcome).items() if c.bench == bench}
        errors = _errors(outcome.design.material, answers)
        figures |= {f"{head}_{name}": value for name, value in errors.items()}
        figures[f"{head}_coverage90"] = {title: _coverage(s) for title, s in scores.items()}
        figures[f"{head}_overconfident"] = {t: s.overconfident.value for t, s in scores.items()}
        for name, facts in light_facts(outcome, bench, NOISE).items():
            figures[f"{head}_light_share_{name}"] = facts["median_light_share"]
    return figures | {"spectra_raised": list(outcome.raised)}


def _outcome(plan: dict[str, Any], quick: bool) -> Any:
    """Run a plan at the noise of this benchmark; nothing but the user's cache is kept."""
    from scenarios.console import Console
    from scenarios.stress import StressPlan, run_plan
    from twin.toml import validate

    settled = validate({**plan, "noise": [NOISE]}, StressPlan).settled(quick=quick)
    with tempfile.TemporaryDirectory() as folder:
        return run_plan(settled, Path(folder), console=Console())


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
        if FISHER in working:
            # Of a normal error, half are below 0.6745 standard errors.
            own = working[FISHER].sigma[common, index]
            own = own / truth[common, index] if index == 1 else own
            found[f"bound_{short}"] = float(np.median(0.6745 * own))
        for table in ("lut-seed", "lut"):
            if table in medians:
                if FISHER in working:
                    bound = found[f"bound_{short}"] / medians[table]
                    found[f"bound_ratio_to_{table.replace('-', '_')}_{short}"] = bound
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
