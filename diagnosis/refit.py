"""Nonlinear fits: the material at every wavelength and the values of a few effects together.

Gauss-Newton on the profiled problem: the effects' step comes from the reduced residual, the
material's step then from what they leave, wavelength by wavelength (Golub and Pereyra 1973,
"variable projection"). Derivatives are renewed only when the step turned out not to be linear.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from diagnosis.evidence import Hypothesis, Scores, log_evidence, turned_scales
from diagnosis.problem import Candidate, Problem
from diagnosis.reduction import Reduction
from twin.spectra import FloatArray

STEPS = 8
"""Gauss-Newton steps at most."""
HALVINGS = 5
RETREATS = 20
"""Halvings of a step that leads to worlds the twin cannot make, beside the others."""
SHORTER = (1.0, 0.25, 1.0 / 16.0, 1.0 / 64.0)
"""Steps that a slope is taken with, where the twin has no answer at the longer ones."""
SETTLED = 0.05
"""Chi-square that a further step may still gain."""
CURVED = 0.5
"""Chi-square by which a step may miss its linear prediction before derivatives are renewed."""
LOOSE = 10.0
"""Prior of the amplitude in a fit, in prior scales: it only keeps what is unseen finite."""
LONGEST = 1.0
"""Longest step of a material coordinate."""
RESTARTS = 3
"""Steps in which wavelengths that ask for longer ones are put between their neighbours."""
DISAGREE = 0.2
"""Relative difference between linear prediction and refit that is worth saying."""


@dataclass(frozen=True, eq=False)
class Fit:
    """The best material and effect values under one hypothesis.

    Attributes:
        hypothesis: candidates at work.
        material: (W, P).
        values: deviation from nominal by candidate, (k,) each.
        value: coordinates of the fit (`Candidate.physical`) in the order of the columns, (K,).
        covariance: of the coordinates, (K, K).
        predicted: data at the fit, (W, M).
        residual: reduced residual, (n,).
        columns: reduced signatures of the effects at the fit, (n, K).
        raw: their signatures in data space, (K, W, M).
        jacobian: derivatives by the material, (W, M, P).
        reduction: about the fit.
        linear: coordinates that the linear model had predicted, (K,).
        at_bound: which of the K coordinates sit at a bound.
        converged: whether it settled.
    """

    hypothesis: Hypothesis
    material: FloatArray
    values: Mapping[str, FloatArray]
    value: FloatArray
    covariance: FloatArray
    predicted: FloatArray
    residual: FloatArray
    columns: FloatArray
    raw: FloatArray
    jacobian: FloatArray
    reduction: Reduction
    linear: FloatArray
    at_bound: np.ndarray
    converged: bool

    @property
    def chi_square(self) -> float:
        """Of the reduced residual."""
        return float(self.residual @ self.residual)

    @property
    def disagreement(self) -> float:
        """Largest relative difference between refit and linear prediction."""
        if not self.linear.size:
            return 0.0
        size = np.maximum(np.abs(self.value), np.sqrt(np.diag(self.covariance)))
        return float(np.max(np.abs(self.value - self.linear) / np.maximum(size, 1e-300)))


def fit(
    problem: Problem,
    hypothesis: Hypothesis = (),
    start: Fit | None = None,
    signatures: FloatArray | None = None,
) -> Fit:
    """Fit the material and the effects of a hypothesis.

    Args:
        problem: the measurement.
        hypothesis: indices of the candidates at work; () fits the material alone.
        start: a fit of the material alone, whose derivatives are used; None starts from
            `problem.material`.
        signatures: data per unit of each parameter of the hypothesis at the start, (K, W, M);
            None takes the problem's.

    Raises:
        ArithmeticError: the twin has no finite answer where the fit leads, or no finite slopes.
    """
    chosen = [problem.candidates[index] for index in hypothesis]
    own = [column for index in hypothesis for column in problem.columns[index]]
    raw = problem.signatures[own] if signatures is None else signatures
    lower = np.concatenate([np.empty(0), *(c.bounds[0] for c in chosen)])
    upper = np.concatenate([np.empty(0), *(c.bounds[1] for c in chosen)])
    loose = LOOSE * np.concatenate([np.empty(0), *(np.array(c.prior_scale) for c in chosen)])
    value, linear = np.zeros(len(own)), np.zeros(len(own))
    data = np.where(problem.valid, problem.value, 0.0)
    if start is None:
        material, predicted = problem.material, problem.forward(problem.material, {})
        jacobian = problem.jacobian(material, {})
        reduction = Reduction.of(problem, jacobian)
    else:
        material, predicted, reduction = start.material, start.predicted, start.reduction
        jacobian = start.jacobian

    def objective(judge: Reduction, prediction: FloatArray, at: FloatArray) -> float:
        return judge.misfit(data - prediction) + float(np.sum((at / loose) ** 2))

    now, converged = objective(reduction, predicted, value), False
    if not np.isfinite(now):
        raise ArithmeticError("the twin has no finite answer where the fit starts")
    columns = reduction(np.moveaxis(raw, 0, -1))

    def searched(judge: Reduction, change: FloatArray, moved: FloatArray) -> _Trial | None:
        """The longest share of a step of the effects that the objective allows."""
        share, halvings, retreats = 1.0, HALVINGS, RETREATS
        before = objective(judge, predicted, value)
        while halvings and retreats:
            trial_value, trial = value + share * change, material + share * moved
            if judge is not reduction:
                trial = _beside(trial, judge)
            if problem.material_reach:
                trial = np.clip(trial, -np.array(problem.material_reach), problem.material_reach)
            prediction = problem.forward(trial, by_name(chosen, trial_value))
            then = objective(judge, prediction, trial_value)
            if np.isfinite(then) and then <= before + SETTLED:
                return _Trial(share, share * change, trial_value, trial, prediction)
            share *= 0.5
            # A world that cannot be says nothing about the objective: it costs no halving.
            halvings, retreats = halvings - np.isfinite(then), retreats - (not np.isfinite(then))
        return None

    for step in range(STEPS):
        left = data - predicted
        box = (lower - value, upper - value)
        change, moved = _step(reduction, columns, raw, left, value, loose, box)
        if step == 0:
            linear = change
        found = None
        lost = np.max(np.abs(moved), axis=1, initial=0.0) > LONGEST
        if own and step < RESTARTS and lost.any() and not lost.all():
            # Where the material is far from its place, its slopes mislead all that the effects
            # share: the others go first, and it starts again from its neighbours.
            rest = Reduction.of(problem, jacobian, valid=problem.valid & ~lost[:, None])
            others = _step(rest, rest(np.moveaxis(raw, 0, -1)), raw, left, value, loose, box)
            found = searched(rest, others[0], _shortened(others[1]))
        restarted = found is not None
        if found is None:
            found = searched(reduction, change, _shortened(moved))
        if found is None:
            break
        share, prediction = found.share, found.predicted
        then = objective(reduction, prediction, found.value)
        missed = reduction(prediction - predicted - np.tensordot(found.change, raw, 1))
        gained, now = now - then, then
        value, material, predicted = found.value, found.material, prediction
        straight = share == 1.0 and missed @ missed < CURVED and not restarted
        if straight and (gained < SETTLED or step):
            converged = True
            break
        if restarted or missed @ missed >= CURVED or share < 1.0 or gained > 1.0:
            named = by_name(chosen, value)
            jacobian = problem.jacobian(material, named)
            if not np.isfinite(jacobian[problem.valid]).all():
                where = ", ".join(f"{name} = {at}" for name, at in named.items()) or "the fit"
                raise ArithmeticError(f"no finite slopes by the material at {where}")
            reduction = reduction.about(jacobian)
            raw = slopes(problem, chosen, material, value, predicted)
            columns = reduction(np.moveaxis(raw, 0, -1))
    precision = columns.T @ columns + np.diag(loose**-2.0)
    return Fit(
        hypothesis=hypothesis,
        material=material,
        values=by_name(chosen, value),
        value=value,
        covariance=np.asarray(np.linalg.inv(precision)) if own else np.empty((0, 0)),
        predicted=predicted,
        residual=reduction(data - predicted),
        columns=columns,
        raw=raw,
        jacobian=jacobian,
        reduction=reduction,
        linear=linear,
        at_bound=(value <= lower) | (value >= upper),
        converged=converged,
    )


class _Trial(NamedTuple):
    """A step that may be taken: share of it, change of the effects, and where it leads."""

    share: float
    change: FloatArray
    value: FloatArray
    material: FloatArray
    predicted: FloatArray


def _step(
    reduction: Reduction, columns: FloatArray, raw: FloatArray, left: FloatArray,
    value: FloatArray, loose: FloatArray, box: tuple[FloatArray, FloatArray],
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Linear change of the effects (K,) within a box, and of the material (W, P) after them."""
    inner = columns.T @ reduction(left) - value / loose**2
    change = bounded_step(columns.T @ columns + np.diag(loose**-2.0), inner, *box)
    return change, reduction.material_step(left - np.tensordot(change, raw, 1))


def _shortened(moved: FloatArray) -> FloatArray:
    """Steps of the material, (W, P), none longer than `LONGEST`."""
    longest = np.max(np.abs(moved), axis=1, initial=0.0, keepdims=True)
    return np.asarray(moved / np.maximum(1.0, longest / LONGEST))


def _beside(material: FloatArray, rest: Reduction) -> FloatArray:
    """The material (W, P) with wavelengths that are not judged put between their neighbours."""
    index = np.arange(len(material))
    known = rest.valid.any(axis=1)
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


def scores_at(problem: Problem, found: Fit) -> Scores:
    """Scores of a fit's own effects, linearised where it ended; `Scores` of K columns."""
    chosen = tuple(problem.candidates[index] for index in found.hypothesis)
    factor, positive = turned_scales(chosen)
    columns = found.columns * factor
    target = found.residual + found.columns @ found.value
    ends = np.cumsum([0, *(candidate.size for candidate in chosen)])
    owned = tuple(tuple(range(ends[i], ends[i + 1])) for i in range(len(chosen)))
    return Scores(columns.T @ columns, (columns.T @ target)[None], positive, owned)


def log_evidence_at(problem: Problem, found: Fit, null: Fit) -> float:
    """Log B over no effect of a fit (Laplace), linearised where it ended."""
    target = found.residual + found.columns @ found.value
    scores = scores_at(problem, found)
    gain = log_evidence(scores, [tuple(range(len(found.hypothesis)))])[0, 0]
    return float(gain - 0.5 * target @ target + 0.5 * null.chi_square)
