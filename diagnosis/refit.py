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
from diagnosis.problem import Problem
from diagnosis.reduction import Reduction
from diagnosis.stepping import LONGEST, beside, by_name, linear_step, shortened, slopes
from twin.spectra import FloatArray

STEPS = 8
"""Gauss-Newton steps at most."""
HALVINGS = 5
RETREATS = 20
"""Halvings of a step that leads to worlds the twin cannot make, beside the others."""
SETTLED = 0.05
"""Chi-square that a further step may still gain."""
CURVED = 0.5
"""Chi-square by which a step may miss its linear prediction before derivatives are renewed."""
LOOSE = 10.0
"""Prior of the amplitude in a fit, in prior scales: it only keeps what is unseen finite."""
RESTARTS = 3
"""Steps in which wavelengths that ask for longer ones are put between their neighbours."""
FOLLOWING = 2
"""Steps of the material alone, where it does not follow a long step of the effects at once."""
LONG = 0.25
"""Share of a step that is long."""
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

    def followed(
        trial: FloatArray, prediction: FloatArray, values: Mapping[str, FloatArray]
    ) -> tuple[FloatArray, FloatArray]:
        """The material at effects that are held, by steps of its own, and its prediction."""
        for _ in range(FOLLOWING):
            jacobian = problem.jacobian(trial, values)
            if not np.isfinite(jacobian[problem.valid]).all():
                break
            trial = trial + shortened(reduction.about(jacobian).material_step(data - prediction))
            if problem.material_reach:
                trial = np.clip(trial, -np.array(problem.material_reach), problem.material_reach)
            prediction = problem.forward(trial, values)
        return trial, prediction

    def searched(judge: Reduction, change: FloatArray, moved: FloatArray) -> _Trial | None:
        """The longest share of a step of the effects that the objective allows."""
        share, halvings, retreats = 1.0, HALVINGS, RETREATS
        before = objective(judge, predicted, value)
        while halvings and retreats:
            trial_value, trial = value + share * change, material + share * moved
            if judge is not reduction:
                trial = beside(trial, judge)
            if problem.material_reach:
                trial = np.clip(trial, -np.array(problem.material_reach), problem.material_reach)
            prediction = problem.forward(trial, by_name(chosen, trial_value))
            then = objective(judge, prediction, trial_value)
            curved = own and share >= LONG and judge is reduction
            if curved and not then <= before + SETTLED:
                trial, prediction = followed(trial, prediction, by_name(chosen, trial_value))
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
        change, moved = linear_step(reduction, columns, raw, left, value, loose, box)
        if step == 0:
            linear = change
        found = None
        lost = np.max(np.abs(moved), axis=1, initial=0.0) > LONGEST
        if own and step < RESTARTS and lost.any() and not lost.all():
            # Where the material is far from its place, its slopes mislead all that the effects
            # share: the others go first, and it starts again from its neighbours.
            rest = Reduction.of(problem, jacobian, valid=problem.valid & ~lost[:, None])
            others = linear_step(rest, rest(np.moveaxis(raw, 0, -1)), raw, left, value, loose, box)
            found = searched(rest, others[0], shortened(others[1]))
        restarted = found is not None
        if found is None:
            found = searched(reduction, change, shortened(moved))
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
