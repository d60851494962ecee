"""What simpler methods make of the same data: the lines that a diagnosis must beat.

"chance" draws an answer: no gap or a gap by a coin, then any effect of the catalogue.

"template" compares the residual of the fit without effects, as it is, with every effect's raw
signature and takes the one with the largest cosine; it calls a gap where chi-square with
independent noise is improbable (5 %).

"greedy" adds the effect that lowers chi-square most, the material refitted, with independent noise,
as long as that is significant (chi-square of as many degrees of freedom, 5 %), two at most; what is
then left decides by its chi-square (1 %) whether something else is at work.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.stats import chi2

from diagnosis import Fit, Problem, Reduction
from diagnosis.evidence import turned_scales
from diagnosis.stepping import bounded_step
from twin.spectra import FloatArray

GAP, LEFT = 0.05, 0.01
"""Nominal error probabilities of the two tests."""
QUANTILE = 1.6448536269514722
"""Standard deviations to either end of a 90 % interval."""
MOST = 2


def baselines(problem: Problem, null: Fit) -> dict[str, Any]:
    """Answers of the two methods that look at the data.

    Args:
        problem: the measurement.
        null: its fit without effects.

    Returns:
        By method: `gap`, `effects` (names, the first is the leading one), `unknown`, and for
        "greedy" `values` (name to value and standard error of every parameter).
    """
    variance = np.diagonal(problem.independent, axis1=1, axis2=2)
    alone = variance[:, :, None] * np.eye(variance.shape[1])
    white = replace(problem, independent=alone, common=np.zeros((0, *problem.value.shape)))
    reduction = Reduction.of(white, null.jacobian)
    data = np.where(problem.valid, problem.value, 0.0) - null.predicted
    residual = reduction(data)
    columns = reduction(np.moveaxis(problem.signatures, 0, -1))
    total, freedom = float(residual @ residual), reduction.freedom
    return {
        "template": _template(problem, data, chi2.sf(total, freedom) < GAP),
        "greedy": _greedy(problem, residual, columns, freedom),
    }


def _template(problem: Problem, data: FloatArray, gap: bool) -> dict[str, Any]:
    use = problem.valid.ravel()
    target = data.ravel()[use]
    cosine = []
    for candidate, own in zip(problem.candidates, problem.columns, strict=True):
        raw = problem.signatures[list(own)].reshape(len(own), -1)[:, use].T
        raw = raw * np.array(candidate.prior_scale)
        if len(own) == 1:
            size = float(np.linalg.norm(raw[:, 0])) or 1.0
            along = float(raw[:, 0] @ target) / size
            cosine.append(along * candidate.sign[0] if candidate.sign[0] else abs(along))
        else:
            value = np.linalg.lstsq(raw, target, rcond=None)[0]
            cosine.append(float(np.linalg.norm(raw @ value)))
    order = np.argsort(-np.array(cosine), kind="stable")
    names = [problem.candidates[i].name for i in order[:MOST]]
    return {"gap": bool(gap), "effects": names, "unknown": False}


def _greedy(
    problem: Problem, residual: FloatArray, columns: FloatArray, freedom: int
) -> dict[str, Any]:
    chosen: list[int] = []
    value, error = np.empty(0), np.empty(0)
    now = float(residual @ residual)
    while len(chosen) < MOST:
        trials = []
        for index in range(len(problem.candidates)):
            if index in chosen:
                continue
            found, sd = _fitted(problem, [*chosen, index], residual, columns)
            own = [c for i in (*chosen, index) for c in problem.columns[i]]
            left = residual - columns[:, own] @ found
            trials.append((float(left @ left), index, found, sd))
        if not trials:
            break
        then, index, found, sd = min(trials, key=lambda each: each[0])
        if chi2.sf(now - then, problem.candidates[index].size) > GAP:
            break
        chosen.append(index)
        now, value, error = then, found, sd
    values: dict[str, Any] = {}
    start = 0
    for index in chosen:
        span = slice(start, start + problem.candidates[index].size)
        start = span.stop
        named = problem.candidates[index]
        values[named.name] = [
            named.physical(value[span]).tolist(),
            named.physical_sd(value[span], error[span]).tolist(),
        ]
    left_over = chi2.sf(now, max(freedom - value.size, 1)) < LEFT
    return {
        "gap": bool(chosen) or bool(left_over),
        "effects": [problem.candidates[index].name for index in chosen],
        "unknown": bool(left_over),
        "values": values,
    }


def _fitted(
    problem: Problem, chosen: list[int], residual: FloatArray, columns: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Values of effects within their bounds and their standard errors, (K,) each."""
    own = [column for index in chosen for column in problem.columns[index]]
    scale = np.abs(turned_scales(problem.candidates)[0][own])
    some = columns[:, own] * scale
    precision = some.T @ some + 1e-9 * np.eye(len(own))
    ends = [problem.candidates[index].bounds for index in chosen]
    lower = np.concatenate([each[0] for each in ends]) / scale
    upper = np.concatenate([each[1] for each in ends]) / scale
    value = bounded_step(precision, some.T @ residual, lower, upper)
    error = np.sqrt(np.diag(np.linalg.pinv(precision, hermitian=True)))
    return np.asarray(value * scale), np.asarray(error * scale)
