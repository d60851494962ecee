"""Candidates in the order of their probability, with their values."""

from __future__ import annotations

import numpy as np

from diagnosis.attribution import Posterior
from diagnosis.closure import QUANTILE
from diagnosis.evidence import Hypothesis, Scores, turned_scales
from diagnosis.problem import Problem
from diagnosis.refit import LOOSE, Fit
from diagnosis.stepping import bounded_step
from diagnosis.verdict import ParameterShift, ParameterValue, RankedEffect
from twin.spectra import FloatArray


def ranked(
    problem: Problem,
    posterior: Posterior,
    scores: Scores,
    adjusted: FloatArray,
    allowed: list[int],
    *,
    gap: bool,
) -> tuple[RankedEffect, ...]:
    """Every candidate that can be seen, the most probable first."""
    inclusion = posterior.inclusion(len(problem.candidates), gap=gap)
    result = []
    for index in sorted(allowed, key=lambda i: -inclusion[i]):
        candidate = problem.candidates[index]
        value, sd, found = values_of(problem, posterior, scores, index)
        sd = candidate.with_response_error(value, sd, problem.response_error)
        lower, upper = candidate.bounds
        ends = (value - QUANTILE * sd, value + QUANTILE * sd)
        low, high = (candidate.physical(np.clip(end, lower, upper)) for end in ends)
        away, away_sd = candidate.physical(value), candidate.physical_sd(value, sd)
        parameters = tuple(
            ParameterValue(
                name, candidate.units[k], float(away[k]), float(away_sd[k]),
                (float(low[k]), float(high[k])),
            )
            for k, name in enumerate(candidate.parameters)
        )  # fmt: skip
        own = list(problem.columns[index])
        factor = turned_scales(problem.candidates)[0][own]
        scaled = value / factor
        energy = scaled @ scores.gram[np.ix_(own, own)] @ scaled
        strength = float(np.sqrt(max(float(energy), 0.0)))
        result.append(
            RankedEffect(
                name=candidate.name,
                probability=float(inclusion[index]),
                parameters=parameters,
                refitted=found is not None,
                disagreement=found.disagreement if found is not None else 0.0,
                adjusted_p=float(adjusted[index]),
                strength=strength,
            )
        )
    return tuple(result)


def values_of(
    problem: Problem, posterior: Posterior, scores: Scores, index: int
) -> tuple[FloatArray, FloatArray, Fit | None]:
    """Coordinates and their standard errors of a candidate under the best hypothesis with it.

    A refit is taken where there is one: the best refit that holds the candidate, unless a
    hypothesis without refit is far more probable.
    """
    place = {h: i for i, h in enumerate(posterior.tested)}
    own = [h for h in posterior.tested if index in h]
    best = max(own, key=lambda h: posterior.log_weight[place[h]])
    fitted = [h for h in posterior.fits if index in h]
    if fitted:
        refit = max(fitted, key=lambda h: posterior.log_weight[place[h]])
        if posterior.log_weight[place[refit]] > posterior.log_weight[place[best]] - 3.0:
            best = refit
    if best in posterior.fits:
        found = posterior.fits[best]
        start = sum(problem.candidates[i].size for i in best if i < index)
        span = slice(start, start + problem.candidates[index].size)
        return found.value[span], np.sqrt(np.diag(found.covariance))[span], found
    value, sd = linear_values(problem, scores, best)
    start = sum(problem.candidates[i].size for i in best if i < index)
    span = slice(start, start + problem.candidates[index].size)
    return value[span], sd[span], None


def linear_values(
    problem: Problem, scores: Scores, hypothesis: Hypothesis
) -> tuple[FloatArray, FloatArray]:
    """Values of the linear model within bounds, and standard errors, (K,) each."""
    own = scores.of(hypothesis)
    factor = turned_scales(problem.candidates)[0][own]
    precision = scores.gram[np.ix_(own, own)] + np.eye(len(own)) / LOOSE**2
    bounds = [problem.candidates[i].bounds for i in hypothesis]
    ends = np.stack([np.concatenate(side) for side in zip(*bounds, strict=True)]) / factor
    lower, upper = ends.min(axis=0), ends.max(axis=0)
    value = bounded_step(precision, scores.inner[0, own], lower, upper)
    return value * factor, np.sqrt(np.diag(np.linalg.inv(precision))) * np.abs(factor)


def scaled_values(problem: Problem, posterior: Posterior, scores: Scores) -> dict[int, FloatArray]:
    """Values of all candidates that were tested, in the units of `Scores`."""
    factor = turned_scales(problem.candidates)[0]
    result = {}
    for index in {i for hypothesis in posterior.tested for i in hypothesis}:
        value = values_of(problem, posterior, scores, index)[0]
        result[index] = value / factor[list(problem.columns[index])]
    return result


def shift_of(problem: Problem, null: Fit, best: Fit) -> ParameterShift:
    """What taking the effects into account does to the material."""
    shift = best.material - null.material
    sd = null.reduction.material_sd()
    names = problem.material_names or tuple(f"m{k}" for k in range(shift.shape[1]))
    rms = np.sqrt(np.mean((shift / sd) ** 2, axis=0))
    return ParameterShift(names, shift, sd, tuple(float(x) for x in rms))
