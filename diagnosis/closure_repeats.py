"""Closure on held-out repeats: the same question, asked of real repetitions.

In reduced space what a held-out repeat says beyond the rest is orthogonal to all that the rest
says, so that choice and judgement are independent, whatever the covariance shares between repeats.
"""

from __future__ import annotations

import numpy as np

from diagnosis.adequacy import orthonormal
from diagnosis.attribution import Posterior, PriorOdds, log_priors
from diagnosis.closure import choose, directions, leading_fits, values
from diagnosis.evidence import Scores, turned_scales
from diagnosis.problem import Problem
from diagnosis.reduction import Reduction
from diagnosis.refit import Fit


def held_out_repeats(
    problem: Problem, null: Fit, posterior: Posterior, odds: PriorOdds
) -> tuple[float, float] | None:
    """Excess chi-square of repeats, before and after effects chosen and fitted by the others.

    None where there is a single repeat.
    """
    if len(problem.repeats) < 2:
        return None
    tested, fits = posterior.tested, leading_fits(posterior)
    prior = log_priors(problem, tested, odds)
    raw = directions(problem, null, posterior)
    data = np.where(problem.valid, problem.value, 0.0)
    factor, positive = turned_scales(problem.candidates)
    before = after = 0.0
    for repeat in problem.repeats:
        held = np.array([channel.repeat == repeat for channel in problem.channels])
        train = Reduction.of(problem, null.jacobian, valid=problem.valid & ~held[None, :])
        columns = train(np.moveaxis(problem.signatures, 0, -1))
        residual = train(data - null.predicted)
        scaled = columns * factor
        scores = Scores(scaled.T @ scaled, (scaled.T @ residual)[None], positive, problem.columns)
        models = {}
        for hypothesis, found in fits.items():
            part = train.about(found.jacobian)
            left = data - found.predicted + np.tensordot(found.value, found.raw, 1)
            models[hypothesis] = (part(np.moveaxis(found.raw, 0, -1)), part(left))
        chosen = choose(problem, scores, residual, models, tested, prior)
        # A gap shows in the held-out data as what the rest's material does not follow.
        followed = np.stack(
            [
                np.einsum("wmp,wp->wm", null.jacobian, train.material_step(raw[:, :, k]))
                for k in range(raw.shape[2])
            ],
            axis=2,
        )
        ways = (raw - followed) * held[None, :, None]
        basis = orthonormal(null.reduction(ways))
        seen = basis.T @ null.residual
        before += float(seen @ seen) - basis.shape[1]
        own = [column for i in chosen for column in problem.columns[i]]
        if chosen in fits:
            found = fits[chosen]
            value, _ = values(problem, chosen, *models[chosen])
            basis = orthonormal(found.reduction(ways))
            left = found.residual + found.columns @ (found.value - value)
        else:
            value, _ = values(problem, chosen, columns[:, own], residual)
            change = np.tensordot(value, problem.signatures[own], 1)
            left = null.residual - null.reduction(change)
        seen = basis.T @ left
        after += float(seen @ seen) - basis.shape[1]
    return before, after
