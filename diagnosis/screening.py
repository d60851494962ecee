"""What can be said before anything is fitted: whether a gap can show, and which effects could."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from diagnosis.calibration import generator_of, loudest
from diagnosis.evidence import Scores
from diagnosis.groups import REACH, separations
from diagnosis.problem import Problem


@dataclass(frozen=True)
class NotIdentifiable:
    """A candidate that these data cannot judge.

    Attributes:
        name: of the candidate.
        reason: why, in words.
        strength: standard deviations it would have at 3 prior scales; NaN where unknown.
    """

    name: str
    reason: str
    strength: float


def without_broken(problem: Problem) -> tuple[Problem, tuple[NotIdentifiable, ...]]:
    """The problem without candidates whose signatures are no numbers, and which those were."""
    broken, kept = [], []
    columns: list[int] = []
    for candidate, own in zip(problem.candidates, problem.columns, strict=True):
        values = problem.signatures[list(own)][:, problem.valid]
        if np.isfinite(values).all():
            kept.append(candidate)
            columns += own
        else:
            reason = "its response holds values that are no numbers; it was left out"
            broken.append(NotIdentifiable(candidate.name, reason, float("nan")))
    if not broken:
        return problem, ()
    return (
        replace(problem, candidates=tuple(kept), signatures=problem.signatures[columns]),
        tuple(broken),
    )


def cannot_show(problem: Problem) -> str:
    """Why no gap can show in these data whatever they are, or ""."""
    unknowns = problem.material.shape[1]
    thickness = problem.thickness_mm

    def kind(capture: str, sample: str) -> tuple[str, object]:
        return capture, round(thickness[sample], 9) if sample in thickness else sample

    blocks = problem.blocks
    kinds = {kind(*block) for block in blocks}
    captures = {capture for capture, _ in blocks}
    if len(kinds) <= unknowns:
        samples = {sample for _, sample in blocks}
        if thickness and len(samples) > 1:
            return (
                f"all {len(samples)} samples are equally thick: {len(kinds)} distinct data for"
                f" {unknowns} unknowns of the material at every wavelength, which fit anything."
                " Measure a second and a third thickness"
            )
        return (
            f"{len(kinds)} distinct data ({', '.join(sorted(captures))} of one thickness) for"
            f" {unknowns} unknowns of the material at every wavelength fit anything: no gap can"
            " show. Measure at least two more thicknesses of the same material"
        )
    return ""


def identifiable(
    problem: Problem, scores: Scores, seed: int = 0, draws: int = 2000
) -> tuple[list[int], tuple[NotIdentifiable, ...], float]:
    """Candidates that can be seen, the others with the reason, and the threshold [sd]."""
    value, vector = np.linalg.eigh(scores.gram)
    root = vector * np.sqrt(np.maximum(value, 0.0))
    drawn = generator_of(seed, 5).standard_normal((draws, value.size)) @ root.T
    threshold = loudest(scores, drawn) if value.size else np.inf
    strength = separations(scores).strength
    allowed, hidden = [], []
    for index, candidate in enumerate(problem.candidates):
        if strength[index] >= threshold:
            allowed.append(index)
            continue
        reason = (
            f"even at {REACH:g} prior scales it moves these data by {strength[index]:.2g} standard"
            f" deviations beside what the material can take up; {threshold:.2g} are needed"
        )
        hidden.append(NotIdentifiable(candidate.name, reason, float(strength[index])))
    return allowed, tuple(hidden), float(threshold)
