"""Steps of a fit: of the effects within their bounds, of the material after them."""

from __future__ import annotations

import numpy as np

from diagnosis.problem import Candidate, Problem
from diagnosis.reduction import Reduction
from twin.measurement.model import BoolArray
from twin.spectra import FloatArray

SHORTER = (1.0, 0.25, 1.0 / 16.0, 1.0 / 64.0)
"""Steps that a slope is taken with, where the twin has no answer at the longer ones."""
LONGEST = 1.0
"""Longest step of a material coordinate."""


def linear_step(
    reduction: Reduction, columns: FloatArray, raw: FloatArray, left: FloatArray,
    value: FloatArray, loose: FloatArray, box: tuple[FloatArray, FloatArray],
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Linear change of the effects (K,) within a box, and of the material (W, P) after them."""
    inner = columns.T @ reduction(left) - value / loose**2
    change = bounded_step(columns.T @ columns + np.diag(loose**-2.0), inner, *box)
    return change, reduction.material_step(left - np.tensordot(change, raw, 1))


def shortened(moved: FloatArray) -> FloatArray:
    """Steps of the material, (W, P), none longer than `LONGEST`."""
    longest = np.max(np.abs(moved), axis=1, initial=0.0, keepdims=True)
    return np.asarray(moved / np.maximum(1.0, longest / LONGEST))


def beside(material: FloatArray, rest: Reduction) -> FloatArray:
    """The material (W, P) with wavelengths that are not judged put between their neighbours."""
    index = np.arange(len(material))
    known: BoolArray = np.any(rest.valid, axis=1)
    columns = [np.interp(index, index[known], column[known]) for column in material.T]
    return np.where(known[:, None], material, np.stack(columns, axis=1))


def by_name(chosen: list[Candidate], value: FloatArray) -> dict[str, FloatArray]:
    """Deviations from nominal by name, of the coordinates of several candidates (K,)."""
    ends = np.cumsum([0, *(candidate.size for candidate in chosen)])
    return {
        candidate.name: candidate.physical(value[ends[i] : ends[i + 1]])
        for i, candidate in enumerate(chosen)
    }


def slopes(
    problem: Problem,
    chosen: list[Candidate],
    material: FloatArray,
    value: FloatArray,
    predicted: FloatArray,
) -> FloatArray:
    """Data per unit of every effect's coordinate, by one-sided differences, (K, W, M).

    The step leads away from nominal. Where the twin has no answer, or a bound is in the way, it
    leads back, then it is shortened.

    Raises:
        ArithmeticError: there is no step with a finite answer.
    """
    result = []
    scale = np.concatenate([np.empty(0), *(np.array(c.prior_scale) for c in chosen)])
    sign = np.concatenate([np.empty(0), *(np.array(c.sign) for c in chosen)])
    lower = np.concatenate([np.empty(0), *(c.bounds[0] for c in chosen)])
    upper = np.concatenate([np.empty(0), *(c.bounds[1] for c in chosen)])
    names = [f"{p} of {c.name}" for c in chosen for p in c.parameters]
    for column in range(value.size):
        away = np.sign(value[column]) or sign[column] or 1.0
        longest = away * max(0.1 * scale[column], 0.05 * abs(value[column]))
        for step in (turn * shorter * longest for shorter in SHORTER for turn in (1.0, -1.0)):
            moved = value.copy()
            moved[column] += step
            if not lower[column] <= moved[column] <= upper[column]:
                continue
            change = (problem.forward(material, by_name(chosen, moved)) - predicted) / step
            if np.isfinite(change[problem.valid]).all():
                result.append(change)
                break
        else:
            raise ArithmeticError(
                f"the twin has no finite answer beside {names[column]} = {value[column]:.3g} from"
                f" nominal, {SHORTER[-1] * abs(longest):.2g} to {abs(longest):.2g} away"
            )
    return np.array(result).reshape(value.size, *predicted.shape)


def bounded_step(
    precision: FloatArray, inner: FloatArray, lower: FloatArray, upper: FloatArray
) -> FloatArray:
    """Minimum of 1/2 x' A x - b' x within a box, by coordinate descent from the free minimum."""
    if not inner.size:
        return inner
    step = np.clip(np.linalg.solve(precision, inner), lower, upper)
    for _ in range(100):
        before = step.copy()
        for i in range(step.size):
            rest = inner[i] - precision[i] @ step + precision[i, i] * step[i]
            step[i] = np.clip(rest / precision[i, i], lower[i], upper[i])
        if np.allclose(step, before, rtol=1e-6, atol=0.0):
            break
    return np.asarray(step)
