"""Which further capture would tell apart what these data cannot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.evidence import Scores, turned_scales
from diagnosis.groups import TOLD_APART, separations
from diagnosis.problem import Extra, Problem
from diagnosis.reduction import Reduction
from diagnosis.refit import Fit
from twin.spectra import FloatArray


@dataclass(frozen=True)
class NextCapture:
    """A proposal.

    Attributes:
        name: what to do.
        cost: as it was given.
        separation: smallest separation within the group once it is done.
        now: the same today.
        enough: whether that tells them apart.
    """

    name: str
    cost: float
    separation: float
    now: float
    enough: bool


def next_captures(
    problem: Problem,
    null: Fit,
    extras: Sequence[Extra],
    group: Sequence[int],
    amplitude: dict[int, FloatArray],
) -> tuple[NextCapture, ...]:
    """Proposals, best first: those that suffice by cost, then the others by gain per cost.

    Args:
        problem: the measurement.
        null: its fit without effects.
        extras: what could be measured.
        group: candidates that cannot be told apart, two at least.
        amplitude: their fitted values in prior scales, turned as in `Scores`, shape (k,) each.
    """
    now = _closest(problem, null.jacobian, group, amplitude)
    found = []
    for extra in extras:
        joint, jacobian = _with(problem, null, extra)
        then = _closest(joint, jacobian, group, amplitude)
        found.append(NextCapture(extra.name, extra.cost, then, now, then >= TOLD_APART))
    return tuple(
        sorted(
            found,
            key=lambda n: (not n.enough, n.cost if n.enough else -(n.separation - now) / n.cost),
        )
    )


def _with(problem: Problem, null: Fit, extra: Extra) -> tuple[Problem, FloatArray]:
    wavelengths, old = problem.value.shape
    new = len(extra.channels)
    independent = np.zeros((wavelengths, old + new, old + new))
    independent[:, :old, :old] = problem.independent
    independent[:, old:, old:] = extra.independent
    more = len(extra.common) - len(problem.common)
    common = np.concatenate([problem.common, np.zeros((more, wavelengths, old))])
    joint = replace(
        problem,
        channels=(*problem.channels, *extra.channels),
        value=np.concatenate([problem.value, np.zeros((wavelengths, new))], axis=1),
        valid=np.concatenate([problem.valid, np.ones((wavelengths, new), dtype=bool)], axis=1),
        independent=independent,
        common=np.concatenate([common, extra.common], axis=2),
        signatures=np.concatenate([problem.signatures, extra.signatures], axis=2),
    )
    return joint, np.concatenate([null.jacobian, extra.jacobian], axis=1)


def _closest(
    problem: Problem,
    jacobian: FloatArray,
    group: Sequence[int],
    amplitude: dict[int, FloatArray],
) -> float:
    factor, positive = turned_scales(problem.candidates)
    reduction = Reduction.of(problem, jacobian)
    columns = reduction(np.moveaxis(problem.signatures, 0, -1)) * factor
    scores = Scores(columns.T @ columns, np.zeros((1, factor.size)), positive, problem.columns)
    between = separations(scores, amplitude).separation
    return float(min(between[i, j] for i in group for j in group if i != j))
