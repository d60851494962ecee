"""Leading candidates simulated in full: do the predicted uncertainties hold?

Every visit of a candidate has errors of its own, drawn from the tolerances of its parts; the
Monte Carlo's light goes through the simulated instrument, and least squares that knows the
tolerances estimates the material. Actual errors and stated widths are compared with the prediction.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.console import Console
from scenarios.design.candidate import Candidate
from scenarios.design.draws import drawn, light_ratio, scaled, traced, world_of
from scenarios.design.goal import Goal
from scenarios.design.media import Medium
from scenarios.design.predictor import COLUMN, TranslucentPredictor
from scenarios.design.verified import Verified
from scenarios.scenario import MapSettings, Scenario
from scenarios.sweep import Workers, sweep
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from twin.measurement import Measurement, RelativeIntensities

TASK = "scenarios.design.verify:simulated"
VERSION = "2"


def verify(
    goal: Goal,
    predictor: TranslucentPredictor,
    candidates: Sequence[Candidate],
    folder: Path,
    *,
    workers: Workers | None = None,
    console: Console | None = None,
) -> list[Verified]:
    """Simulate candidates with every material of the goal.

    Args:
        goal: materials, numbers of visits and paths.
        predictor: of the same goal.
        candidates: which.
        folder: keeps what is finished: the same call goes on from there.
        workers: who works; None: this process.
        console: is told how far it is.

    Raises:
        InputError: the folder cannot be written, or the workers cannot be had.
    """
    points = [
        point_of(goal, predictor, each, medium) for each in candidates for medium in goal.media
    ]
    done = sweep(
        TASK, points, folder, version=VERSION, workers=workers, console=console,
        title=f"simulate {len(candidates)} candidates",
    )  # fmt: skip
    results = list(done.results())
    why = {failure.number: failure.message for failure in done.failures}
    count = len(goal.media)
    found = []
    for number, candidate in enumerate(candidates):
        own = results[number * count : (number + 1) * count]
        missing = [why[n] for n in range(number * count, (number + 1) * count) if n in why]
        found.append(_judged(predictor, candidate, own, missing))
    return found


def point_of(
    goal: Goal, predictor: TranslucentPredictor, candidate: Candidate, medium: Medium
) -> dict[str, Any]:
    """All that one simulation depends on, as JSON holds it."""
    setting = predictor.setting(candidate)
    # sorted, as JSON keeps them: modes and scales go by place
    scales = dict(sorted(candidate.tolerances(predictor.parts).items()))
    m = predictor.media.index(medium)
    chosen = [predictor.optics.thickness_mm.index(mm) for mm in candidate.thickness_mm]
    names = (*predictor.common, *predictor.private)
    used = [names.index(name) for name in scales]
    unit = setting.modes.array[m][chosen][..., used]
    return {
        "scenario": candidate.scenario(predictor.parts, goal, medium).model_dump(mode="json"),
        "medium": {"name": medium.name, "values": medium.values},
        "wavelength_nm": setting.wavelength_nm.tolist(),
        "scales": scales,
        "modes": np.round(unit, 12).tolist(),
        "visits": goal.verification.seeds,
        "paths": goal.verification.paths,
        "map_paths": goal.verification.map_paths,
        "seed": goal.seed,
    }


def simulated(point: dict[str, Any]) -> Mapping[str, FloatArray]:
    """The task: errors and widths (V, W, 3) of the visits of one candidate and one material."""
    from estimators import BenchModel, estimator
    from scenarios.maps import appearance_maps
    from scenarios.worlds import world_visits
    from twin.measurement import relative_intensities
    from twin.toml import validate

    scenario = validate(point["scenario"], Scenario)
    values = point["medium"]["values"]
    medium = Medium(point["medium"]["name"], scenario.samples[0].n, values and tuple(values))
    wavelength = np.array(point["wavelength_nm"])
    grid = scenario.wavelength.wavelength_nm
    light = [
        traced(scenario.bench, sample, grid, paths=point["paths"], seed=point["seed"], threads=None)
        for sample in scenario.samples
    ]
    maps = appearance_maps(
        scenario.bench, scenario.samples, wavelength, _map_settings(medium, wavelength, point),
        cache=None, threads=None, console=Console(quiet=True),
    )  # fmt: skip
    model = BenchModel.of(scenario.bench, scenario.samples, wavelength, maps)
    fit = estimator("least-squares", model, starts=2)
    nuisance = _nuisance(np.array(point["modes"]), point["scales"])
    errors, widths, extra = [], [], np.zeros((len(light), len(wavelength), 3))
    for number, draw in enumerate(
        drawn(point["scales"], len(light), point["visits"], point["seed"])
    ):
        world = world_of(scenario.bench, scenario.samples, draw)
        own = [
            scaled(each, light_ratio(world, draw, s, medium, grid)) for s, each in enumerate(light)
        ]
        visit = next(iter(world_visits(scenario, world, own, [point["seed"] + number])))
        seen = _judged_part(relative_intensities(visit), wavelength)
        seen = _reported(seen, 1.0 + draw.shared.get("rho_white_relative", 0.0))
        covariance = seen.covariance + nuisance
        result = fit.estimate(replace(seen, covariance=covariance, common=None))
        truth = _truth(visit, medium, wavelength)
        estimate = np.stack([result.albedo, result.sigma_t_per_mm, result.g], axis=-1)
        errors.append(estimate - truth)
        widths.append(np.sqrt(np.diagonal(result.covariance, axis1=1, axis2=2)))
        if number == 0:
            extra = _extra(visit, seen, fit)
    return {"error": np.array(errors), "width": np.array(widths), "extra": extra}


def _map_settings(medium: Medium, wavelength: FloatArray, point: dict[str, Any]) -> MapSettings:
    sigma_t = medium.at(wavelength)[:, 1]
    return MapSettings(
        albedo_count=14, sigma_t_count=12, g_count=5, paths=point["map_paths"],
        sigma_t_range_per_mm=(float(f"{sigma_t.min() / 2:.2g}"), float(f"{2 * sigma_t.max():.2g}")),
    )  # fmt: skip


def _nuisance(modes: FloatArray, scales: Mapping[str, float]) -> FloatArray:
    """Covariance of the captures by the tolerances, (W, 3S, 3S).

    Args:
        modes: per unit, (S, W, 3, Q).
        scales: by name, Q of them.
    """
    from scenarios.design.modes import is_private

    samples, wavelengths = modes.shape[:2]
    total = np.zeros((wavelengths, 3 * samples, 3 * samples))
    for column, (name, scale) in enumerate(sorted(scales.items())):
        moved = scale * modes[..., column].transpose(1, 0, 2)
        if not is_private(name):
            flat = moved.reshape(wavelengths, -1)
            total += flat[:, :, None] * flat[:, None, :]
            continue
        for s in range(samples):
            part = slice(3 * s, 3 * s + 3)
            total[:, part, part] += moved[:, s, :, None] * moved[:, s, None, :]
    return total


def _judged_part(seen: RelativeIntensities, wavelength: FloatArray) -> RelativeIntensities:
    """The judged wavelengths alone."""
    rows = np.searchsorted(seen.wavelength_nm, wavelength - 1e-6)
    return replace(
        seen, wavelength_nm=wavelength, value=seen.value[..., rows],
        covariance=seen.covariance[rows], valid=seen.valid[..., rows], common=None,
    )  # fmt: skip


def _reported(seen: RelativeIntensities, white: float) -> RelativeIntensities:
    """What a certificate that is off by a factor makes of captures over the white reference."""
    factor = np.array([1.0 / white, 1.0 / white, 1.0])
    return replace(seen, value=seen.value * factor[:, None])


def _truth(visit: Measurement, medium: Medium, wavelength: FloatArray) -> FloatArray:
    from twin.measurement import seen_truth

    found = seen_truth(visit)
    if found is None:
        return medium.at(wavelength)
    rows = np.searchsorted(found.wavelength_nm, wavelength - 1e-6)
    return np.stack([found.albedo[0], found.sigma_t_per_mm[0], found.g[0]], axis=-1)[rows]


def _extra(visit: Measurement, seen: RelativeIntensities, fit: Any) -> FloatArray:
    """Standard errors that a real bench does not have: light, maps, interpolation, (S, W, 3)."""
    captures = visit.captures
    own = np.zeros_like(seen.value)
    if captures is not None and captures.light_se is not None:
        rows = np.searchsorted(captures.wavelength_nm, seen.wavelength_nm - 1e-6)
        own = captures.light_se[..., rows]
    engine = fit.engine()[0].forward.relative_error[..., None] * np.nan_to_num(seen.value)
    return np.asarray(np.hypot(own, engine).transpose(0, 2, 1))


def _judged(
    predictor: TranslucentPredictor,
    candidate: Candidate,
    results: Sequence[Mapping[str, FloatArray] | None],
    missing: Sequence[str],
) -> Verified:
    shape = predictor.setting(candidate).light.value.shape
    good = [r for r in results if r is not None]
    if len(good) < len(results):
        nothing = np.full((1, 1, 1, 3), np.nan)
        return Verified(candidate, nothing[0], nothing, nothing, "; ".join(missing))
    extra = np.zeros((*shape[:3], 3))
    chosen = [predictor.optics.thickness_mm.index(mm) for mm in candidate.thickness_mm]
    for m, result in enumerate(good):
        extra[m, chosen] = result["extra"]
    found, own = predictor.of([candidate], extra), predictor.of([candidate]).error[0]
    judged = Verified(
        candidate, found.standard[0], np.array([r["error"] for r in good]),
        np.array([r["width"] for r in good]), own=own, bands=found.bias[0],
    )  # fmt: skip
    wavelength = predictor.setting(candidate).wavelength_nm
    figures = {
        name: judged.figure(COLUMN[name], predictor.scale(name, wavelength))
        for name in predictor.targets
        if name in COLUMN
    }
    return replace(judged, figures=figures)
