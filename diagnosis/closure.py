"""How far the gap shrinks, on data that did not choose the effect.

The reduced residual r, standard normal about the gap, is split into two independent parts,
r + s z for choosing and fitting, r - z / s for judging, with fresh noise z (Gaussian data fission:
Rasines and Young 2023). With s^2 = 1/2 the first part knows what two of three repeats know. Every
split chooses the effects and fits their values by its first part alone; the second gives

    G = 1 - (excess after) / (excess before),  excess = chi-square - its expectation,

averaged over splits. Splits of repeats judge the same with far more noise (`closure_repeats`),
because what repeats share, the systematic part of the covariance, is learnt from the others.

The chi-square is taken in the directions in which gaps live (the level of every block, and the
responses of the leading effects once the material has followed): noise in all other directions
would drown it. The interval is Fieller's (1954), because G is a ratio of two noisy numbers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from diagnosis.adequacy import orthonormal
from diagnosis.attribution import Posterior, PriorOdds, log_priors
from diagnosis.calibration import generator_of
from diagnosis.evidence import Hypothesis, Scores, log_evidence, turned_scales
from diagnosis.problem import Problem
from diagnosis.refit import Fit
from diagnosis.stepping import bounded_step
from diagnosis.unknown import polynomials, smooth_columns
from twin.spectra import FloatArray

QUANTILE = 1.6448536269514722
"""Of a two-sided 90 % interval."""
SPLITS = 8
"""Splits, each used with both signs of its noise."""
SPLIT = float(np.sqrt(0.5))
"""s: the training part has noise of variance 1 + s^2, the judging part of 1 + 1 / s^2."""
SHAPES = 1
"""Polynomials over wavelength that a block's own deviation is made of."""
RIVALS = 4
"""Leading effects whose directions are judged, and leading fits that a split chooses from."""
WIDEST = (-1.0, 2.0)
"""Ends of an interval that the data do not bound."""


@dataclass(frozen=True)
class Closure:
    """How far the gap shrinks.

    Attributes:
        value: G; 1 is closed, 0 no better, below 0 worse.
        interval: of 90 %.
        before: excess of the judging chi-square without an effect.
        after: with the effects that every split chose.
        noise_floor: chi-square that noise alone has in the same directions.
        oracle_floor: excess that is left on average even to one who knows the effect, because
            its value is fitted to noisy data.
        chosen: what the splits chose, by how often.
        by_repeats: excess before and after on held-out repeats, or None with a single one.
    """

    value: float
    interval: tuple[float, float]
    before: float
    after: float
    noise_floor: float
    oracle_floor: float
    chosen: tuple[tuple[Hypothesis, int], ...]
    by_repeats: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class Linear:
    """A hypothesis about its own fit, in reduced space.

    Attributes:
        target: residual of the data with the effects' own part left in, (n,).
        columns: (n, K).
        basis: orthonormal directions that are judged, (n, d).
        about: the fit.
    """

    target: FloatArray
    columns: FloatArray
    basis: FloatArray
    about: Fit


def closure(
    problem: Problem,
    null: Fit,
    posterior: Posterior,
    odds: PriorOdds,
    *,
    force: Hypothesis | None = None,
    seed: int = 0,
) -> Closure:
    """Closure by what every split chooses, or by one given set of effects (an oracle's, say)."""
    tested = posterior.tested if force is None else [force]
    prior = log_priors(problem, tested, odds)
    raw = directions(problem, null, posterior, force)
    basis = orthonormal(null.reduction(raw))
    models = {
        h: Linear(
            found.residual + found.columns @ found.value,
            found.columns,
            orthonormal(found.reduction(raw)),
            found,
        )
        for h, found in leading_fits(posterior).items()
        if h in tested
    }
    columns = null.reduction(np.moveaxis(problem.signatures, 0, -1))
    factor, positive = turned_scales(problem.candidates)
    unit = np.sqrt(1.0 + SPLIT**2)
    scaled = columns * factor / unit
    gram = scaled.T @ scaled
    generator = generator_of(seed, 4)
    left: list[FloatArray] = []
    excess, floors = [], []
    chosen: dict[Hypothesis, int] = {}
    for _ in range(SPLITS):
        noise = generator.standard_normal(null.reduction.valid.shape) * null.reduction.valid
        for sign in (SPLIT, -SPLIT):
            # in units of the training part's own noise
            train = (null.residual + sign * null.reduction.project(noise)) / unit
            scores = Scores(gram, (scaled.T @ train)[None], positive, problem.columns)
            split = {
                h: (m.columns / unit, (m.target + sign * m.about.reduction.project(noise)) / unit)
                for h, m in models.items()
            }
            best = choose(problem, scores, train, split, tested, prior)
            chosen[best] = chosen.get(best, 0) + 1
            if best in models:
                model = models[best]
            else:
                own = [column for i in best for column in problem.columns[i]]
                model = Linear(null.residual, columns[:, own], basis, null)
                split[best] = (model.columns / unit, train)
            value, covariance = values(problem, best, *split[best])
            judged = model.basis.T @ (model.target - model.columns @ value)
            # |judged - z / s|^2 with its pure noise replaced by the expectation
            fresh = model.basis.T @ model.about.reduction.project(noise) / sign
            size = model.basis.shape[1]
            excess.append(float(judged @ judged) - size - 2.0 * float(fresh @ judged))
            moved = model.basis.T @ model.columns
            floors.append(float(np.trace(moved @ covariance @ moved.T)))
            left.append(basis.T @ (model.basis @ judged))
    before = basis.T @ null.residual
    value_of, interval = fieller(
        before,
        np.mean(left, axis=0),
        after_excess=float(np.mean(excess)),
        fitted=sum(problem.candidates[i].size for i in max(chosen, key=lambda h: chosen[h])),
    )
    return Closure(
        value=value_of,
        interval=interval,
        before=float(before @ before) - before.size,
        after=float(np.mean(excess)),
        noise_floor=float(before.size),
        oracle_floor=float(np.mean(floors)),
        chosen=tuple(sorted(chosen.items(), key=lambda item: -item[1])),
    )


def leading_fits(posterior: Posterior) -> dict[Hypothesis, Fit]:
    """The most probable refits."""
    place = {h: i for i, h in enumerate(posterior.tested)}
    ranked = sorted(posterior.fits, key=lambda h: -posterior.log_weight[place[h]])
    return {h: posterior.fits[h] for h in ranked[:RIVALS]}


def directions(
    problem: Problem, null: Fit, posterior: Posterior, force: Hypothesis | None = None
) -> FloatArray:
    """Ways in which a gap may show, in data space, (W, M, D)."""
    likely = np.argsort(-posterior.inclusion(len(problem.candidates)), kind="stable")
    leading = dict.fromkeys([*(force or posterior.best), *likely[:RIVALS].tolist()])
    own = [column for i in leading for column in problem.columns[i]]
    shapes = polynomials(problem.wavelength_nm, SHAPES)
    smooth = smooth_columns(problem, null.predicted, shapes)
    return np.concatenate([smooth, np.moveaxis(problem.signatures[own], 0, -1)], axis=2)


def fieller(
    before: FloatArray, after: FloatArray, *, after_excess: float, fitted: int
) -> tuple[float, tuple[float, float]]:
    """G and its interval from residuals before and after the effects, (d,) each, in unit noise.

    Var |m + z|^2 = 2 d + 4 m'm; the unknown m'm is the observed one less its noise. `fitted`
    values take their directions out of the noise that is left after.
    """
    size = float(before.size)
    rest = max(size - fitted, 1.0)
    b, a = float(before @ before) - size, after_excess
    bb = max(b, 0.0)
    aa = max(float(after @ after) - rest, 0.0)
    ab = float(np.clip(float(before @ after) - rest, -np.sqrt(aa * bb), np.sqrt(aa * bb)))
    var_b, var_a, cov = 2 * size + 4 * bb, 2 * rest + 4 * aa, 2 * rest + 4 * ab
    if b <= 0:
        return float("nan"), WIDEST
    t = QUANTILE**2
    # (a - g b)^2 <= t (var_a - 2 g cov + g^2 var_b) for the ratio g = 1 - G
    two, one, zero = b**2 - t * var_b, -2 * (a * b - t * cov), a**2 - t * var_a
    root = one**2 - 4 * two * zero
    if two <= 0 or root < 0:
        return 1.0 - a / b, WIDEST
    ends = sorted(1.0 - (-one + sign * np.sqrt(root)) / (2 * two) for sign in (-1.0, 1.0))
    return 1.0 - a / b, (float(max(ends[0], WIDEST[0])), float(min(ends[1], WIDEST[1])))


def choose(
    problem: Problem,
    scores: Scores,
    residual: FloatArray,
    models: dict[Hypothesis, tuple[FloatArray, FloatArray]],
    tested: list[Hypothesis],
    prior: FloatArray,
) -> Hypothesis:
    """The best hypothesis of training data; refitted ones in their own linear form."""
    weight = prior + log_evidence(scores, tested)[0]
    for index, hypothesis in enumerate(tested):
        if hypothesis in models:
            columns, target = models[hypothesis]
            chosen = tuple(problem.candidates[i] for i in hypothesis)
            factor, positive = turned_scales(chosen)
            scaled = columns * factor
            ends = np.cumsum([0, *(c.size for c in chosen)])
            owned = tuple(tuple(range(ends[i], ends[i + 1])) for i in range(len(chosen)))
            own = Scores(scaled.T @ scaled, (scaled.T @ target)[None], positive, owned)
            gain = log_evidence(own, [tuple(range(len(chosen)))])[0, 0]
            weight[index] = prior[index] + gain - 0.5 * target @ target + 0.5 * residual @ residual
    return tested[int(np.argmax(weight))]


def values(
    problem: Problem, hypothesis: Hypothesis, columns: FloatArray, target: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Values fitted to training residuals within their bounds, and their covariance."""
    chosen = [problem.candidates[i] for i in hypothesis]
    scale = np.concatenate([np.array(c.prior_scale) for c in chosen])
    precision = columns.T @ columns + np.diag((10.0 * scale) ** -2.0)
    lower = np.concatenate([c.bounds[0] for c in chosen])
    upper = np.concatenate([c.bounds[1] for c in chosen])
    value = bounded_step(precision, columns.T @ target, lower, upper)
    return value, np.asarray(np.linalg.inv(precision))
