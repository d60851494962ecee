"""One diagnosis, from a problem to its verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import logsumexp

from diagnosis.adequacy import Adequacy, adequacy
from diagnosis.attribution import (
    Posterior,
    PriorOdds,
    cover,
    leading_set,
    linear,
    log_priors,
    refine,
    scores_of,
)
from diagnosis.calibration import detect
from diagnosis.closure import closure
from diagnosis.closure_repeats import held_out_repeats
from diagnosis.evidence import Scores, hypotheses, turned_scales
from diagnosis.groups import Separations, separations
from diagnosis.next_capture import next_captures
from diagnosis.problem import Extra, Problem
from diagnosis.ranking import ranked, scaled_values, shift_of
from diagnosis.reduction import Reduction
from diagnosis.refit import Fit, fit
from diagnosis.screening import NotIdentifiable, cannot_show, identifiable, without_broken
from diagnosis.unknown import Unknown
from diagnosis.verdict import Diagnosis, Verdict
from diagnosis.where import enters, shows
from twin.spectra import FloatArray

ALPHA = 0.02
"""Family-wise false-alarm rate: a hundred benches without a gap then rarely show more than 5."""
ELSEWHERE = 0.2
"""Share of the false alarms that goes to gaps of a kind that no effect of the catalogue makes."""
SURELY = 0.8
"""Probability of a second effect from which on it belongs into the verdict, known or not."""
MOST = 6
"""Effects in a credible set beyond which nothing has been attributed."""
UNKNOWN = "none of these"


def diagnose(
    problem: Problem,
    *,
    extras: Sequence[Extra] = (),
    odds: PriorOdds | None = None,
    alpha: float = ALPHA,
    seed: int = 0,
) -> Diagnosis:
    """Whether there is a gap, where, by which effect, how far it shrinks, what to measure next.

    Args:
        problem: the measurement, its signatures taken at the no-effect fit (`fit(problem)`).
        extras: captures that could be made next.
        odds: prior probabilities of none, singles, pairs and the unknown.
        alpha: probability of a false alarm.
        seed: of the simulations; the same seed gives the same numbers.

    Raises:
        twin.errors.InputError: a covariance that is not positive definite.
    """
    prior = odds or PriorOdds()
    problem, broken = without_broken(problem)
    if reason := cannot_show(problem):
        unseen = tuple(
            NotIdentifiable(c.name, "no gap can show in these data", float("nan"))
            for c in problem.candidates
        )
        return Diagnosis(verdict="cannot_tell", reason=reason, not_identifiable=broken + unseen)
    null = fit(problem)
    scores, columns = scores_of(problem, null)
    allowed, hidden, _ = identifiable(problem, scores, seed)
    unknown = Unknown.of(problem, null.reduction, null.predicted)
    single = hypotheses(allowed, pairs=False)
    found = detect(
        scores, columns, null.residual, unknown, allowed,
        log_priors(problem, single, prior), float(np.log(prior.unknown)), seed=seed,
    )  # fmt: skip
    log_unknown = float(unknown.log_evidence((null.residual @ unknown.direction)[None])[0])
    posterior = linear(problem, scores, allowed, log_unknown, prior)
    # The catalogue's odds look where it points to; a share of the false alarms goes elsewhere.
    noise = adequacy(problem, null, seed=seed)
    p = min(1.0, found.p / (1.0 - ELSEWHERE), noise.p / ELSEWHERE)
    common = Diagnosis(
        verdict="no_gap",
        reason="",
        p=p,
        adequacy=noise,
        not_identifiable=broken + hidden,
        separations=separations(scores),
        names=tuple(candidate.name for candidate in problem.candidates),
        null=null,
        posterior=posterior,
        where=shows(problem, null, seed=seed),
    )
    if p > alpha:
        return _no_gap(problem, common, scores, posterior, found.adjusted, allowed)
    dependent = _prior_dependence(problem, null, posterior, allowed, prior)
    if allowed:
        posterior = refine(problem, null, posterior, prior)
        best = posterior.fits.get(posterior.best, null)
        refused = tuple(
            NotIdentifiable(
                " with ".join(problem.candidates[i].name for i in h),
                f"{'its fit' if len(h) == 1 else 'their common fit'} failed: {words}",
                float("nan"),
            )
            for h, words in posterior.failed.items()
        )
        common = replace(common, not_identifiable=common.not_identifiable + refused)
    else:
        best = null
    rest = adequacy(problem, best, seed=seed)
    posterior = _with_rest(posterior, rest, prior)
    verdict, reason, cover, leading_set = _decide(problem, posterior, rest)
    amplitude = scaled_values(problem, posterior, scores)
    between = separations(scores, amplitude)
    groups = _groups(problem, posterior, between, allowed, cover, verdict)
    numbers = [problem_index(problem, name) for name in cover if name != UNKNOWN]
    measured = replace(
        common,
        verdict=verdict,
        reason=reason,
        posterior=posterior,
        no_gap_probability=posterior.probability()[2],
        unknown_probability=posterior.probability(gap=True)[1],
        effects=ranked(problem, posterior, scores, found.adjusted, allowed, gap=True),
        leading=tuple(problem.candidates[i].name for i in best.hypothesis),
        credible_set=cover,
        leading_set=leading_set,
        groups=groups,
        enters=enters(problem, null),
        parameter_shift=shift_of(problem, null, best),
        adequacy=rest,
        prior_dependent=dependent,
        best=best,
    )
    if allowed:
        found_closure = closure(problem, null, posterior, prior, seed=seed)
        repeats = held_out_repeats(problem, null, posterior, prior)
        measured = replace(measured, closure=replace(found_closure, by_repeats=repeats))
    if extras and len(numbers) > 1:
        proposals = next_captures(problem, null, extras, numbers, amplitude)
        measured = replace(measured, next_measurement=proposals)
    return measured


def problem_index(problem: Problem, name: str) -> int:
    """Index of a candidate by name."""
    return [candidate.name for candidate in problem.candidates].index(name)


def _no_gap(
    problem: Problem,
    common: Diagnosis,
    scores: Scores,
    posterior: Posterior,
    adjusted: FloatArray,
    allowed: list[int],
) -> Diagnosis:
    _, other, none = posterior.probability()
    if not allowed:
        return replace(
            common,
            verdict="cannot_tell",
            reason="no effect of the catalogue could be seen in these data, and no gap is",
        )
    return replace(
        common,
        reason=f"data like these occur without any effect in {common.p:.0%} of cases",
        effects=ranked(problem, posterior, scores, adjusted, allowed, gap=False),
        no_gap_probability=none,
        unknown_probability=other,
    )


def _with_rest(posterior: Posterior, rest: Adequacy, odds: PriorOdds) -> Posterior:
    """Evidence against the whole catalogue from what its best explanation leaves.

    A p-value is worth at most -1 / (e p ln p) to the alternative (Sellke, Bayarri and Berger
    2001).
    """
    if rest.enough or not posterior.tested:
        return posterior
    bound = -1.0 - np.log(rest.p) - np.log(-np.log(rest.p))
    catalogue = float(logsumexp(posterior.log_weight))
    weight = catalogue + np.log(odds.unknown) + bound
    return replace(posterior, unknown=float(np.logaddexp(posterior.unknown, weight)))


def _decide(
    problem: Problem, posterior: Posterior, rest: Adequacy
) -> tuple[Verdict, str, tuple[str, ...], tuple[str, ...]]:
    names = [candidate.name for candidate in problem.candidates]
    share, other, _ = posterior.probability(gap=True)
    none = posterior.probability()[2]
    if not posterior.tested:
        return "none_of_these", "no effect of the catalogue can be seen", (UNKNOWN,), ()
    chosen = cover(posterior.tested, share, other)
    leading = leading_set(posterior, share)
    cover_names = tuple(UNKNOWN if i < 0 else names[i] for i in chosen)
    leading_names = tuple(names[i] for i in leading)
    if none > 0.5:
        words = f"a gap so faint that no effect at all still has a probability of {none:.0%}"
        return "cannot_tell", words, cover_names, leading_names
    if other > 0.5:
        reason = (
            "what the best of the catalogue leaves is no noise"
            f" (p = {rest.p:.2g})" if not rest.enough else
            "a smooth discrepancy of any channel explains the data better than the catalogue"
        )  # fmt: skip
        return "none_of_these", reason, cover_names, leading_names
    pairs = np.array([len(hypothesis) == 2 for hypothesis in posterior.tested])
    paired = float(share[pairs].sum() / share.sum())
    if len(chosen) == 1 and 0.5 < paired < SURELY and len(leading) > 2:
        words = f"one effect; a second is at work with {paired:.0%}, but which is not known"
        return "effect", words, cover_names, leading_names
    if paired > 0.5:
        if len(leading) == 2:
            return "pair", "two effects together", cover_names, leading_names
        if len(leading) <= MOST:
            return "group", "two effects of several", cover_names, leading_names
        return "cannot_tell", "a gap, but too many pairs explain it", cover_names, leading_names
    if len(chosen) == 1:
        return "effect", "one effect", cover_names, leading_names
    if len(chosen) <= MOST:
        words = f"one of {len(chosen)} that these data do not tell apart"
        return "group", words, cover_names, leading_names
    words = f"a gap, but it is too faint to be attributed: {len(chosen)} effects explain it"
    return "cannot_tell", words, cover_names, leading_names


def _groups(
    problem: Problem,
    posterior: Posterior,
    between: Separations,
    allowed: list[int],
    cover_names: tuple[str, ...],
    verdict: Verdict,
) -> tuple[tuple[str, ...], ...]:
    if not posterior.tested:
        return ()
    found = [between.group(member, allowed) for member in posterior.best]
    names = [tuple(problem.candidates[i].name for i in group) for group in found]
    if verdict == "group":
        names.append(tuple(name for name in cover_names if name != UNKNOWN))
    return tuple(dict.fromkeys(group for group in names if len(group) > 1))


def _prior_dependence(
    problem: Problem, null: Fit, free: Posterior, allowed: list[int], odds: PriorOdds
) -> str:
    """How the linear verdict changes when the material's spectra are taken to be smooth, or ""."""
    if problem.material_prior is None or not allowed:
        return ""
    reduction = Reduction.of(problem, null.jacobian, prior=problem.material_prior)
    middle = null.material.mean(axis=0)
    data = np.where(problem.valid, problem.value, 0.0)
    away = np.einsum("wmp,wp->wm", null.jacobian, null.material - middle)
    residual = reduction(data - null.predicted + away)
    factor, positive = turned_scales(problem.candidates)
    columns = reduction(np.moveaxis(problem.signatures, 0, -1)) * factor
    scores = Scores(columns.T @ columns, (columns.T @ residual)[None], positive, problem.columns)
    smooth = linear(problem, scores, allowed, free.unknown - np.log(odds.unknown), odds)
    if smooth.best == free.best:
        return ""
    words = " and ".join(problem.candidates[i].name for i in smooth.best)
    return f"with spectra that are smooth over {problem.material_prior.length_nm:g} nm: {words}"
