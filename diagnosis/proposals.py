"""What to measure next on the translucent bench, for effects that the data do not tell apart."""

from __future__ import annotations

from dataclasses import replace

from diagnosis.attribution import scores_of
from diagnosis.extras import extras_of
from diagnosis.groups import TOLD_APART
from diagnosis.next_capture import NextCapture, next_captures
from diagnosis.ranking import scaled_values
from diagnosis.screening import without_broken
from diagnosis.translucent import TranslucentCase
from diagnosis.verdict import Diagnosis
from twin.measurement import Measurement

FEWEST = 2
"""Effects that can be told apart."""


def with_proposals(case: TranslucentCase, measurement: Measurement, found: Diagnosis) -> Diagnosis:
    """The diagnosis with the captures that would split its look-alikes, best first.

    Args:
        case: what was diagnosed.
        measurement: what the case was made of.
        found: its diagnosis.
    """
    problem, _ = without_broken(case.problem)
    if found.null is None or found.posterior is None or found.verdict == "no_gap":
        return found
    names = [candidate.name for candidate in problem.candidates]
    wanted = tuple(name for name in found.credible_set if name in names)
    if len(wanted) < FEWEST:
        wanted = next(iter(found.groups), ())
    members = [names.index(name) for name in wanted if name in names]
    if len(members) < FEWEST:
        return found
    scores, _ = scores_of(problem, found.null)
    amplitude = scaled_values(problem, found.posterior, scores)
    members = [member for member in members if member in amplitude]
    if len(members) < FEWEST:
        return found
    extras = extras_of(case, measurement, found.null, [names[i] for i in members])
    proposals: tuple[NextCapture, ...] = next_captures(
        problem, found.null, extras, members, amplitude
    )
    if proposals and proposals[0].now >= TOLD_APART:
        # Far enough apart, and yet both probable: what counts is what a minute buys.
        proposals = tuple(sorted(proposals, key=lambda n: -(n.separation - n.now) / n.cost))
    return replace(found, next_measurement=proposals)
