"""Which effects these data can see at all, and which of them they can tell apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from diagnosis.evidence import Scores
from twin.spectra import FloatArray

CONFUSED = 0.05
"""Probability of taking one effect for the other below which they are told apart."""
TOLD_APART = float(-2.0 * ndtri(CONFUSED))
"""Separation d with that probability: the nearer of two points at distance d in unit noise is the
wrong one with probability Phi(-d / 2)."""
REACH = 3.0
"""Prior scales up to which an effect is expected."""


@dataclass(frozen=True, eq=False)
class Separations:
    """Distances between effects in standard deviations of the reduced data.

    Attributes:
        strength: distance of every candidate from no effect, (C,).
        separation: distance of candidate i from the nearest point of candidate j, (C, C).
    """

    strength: FloatArray
    separation: FloatArray

    @property
    def sine(self) -> FloatArray:
        """Sine of the angle between candidates, 1 where one cannot be seen, (C, C)."""
        seen = self.strength > 0
        ratio = self.separation / np.where(seen, self.strength, 1.0)[:, None]
        return np.where(seen[:, None], np.minimum(ratio, 1.0), 1.0)

    def group(self, member: int, among: list[int]) -> tuple[int, ...]:
        """Candidates that one of strength `strength[member]` may be taken for, itself first."""
        near = [j for j in among if j != member and self.separation[member, j] < TOLD_APART]
        return (member, *sorted(near, key=lambda j: self.separation[member, j]))


def separations(scores: Scores, amplitude: dict[int, FloatArray] | None = None) -> Separations:
    """Separations at given amplitudes, in prior scales; without one at `REACH` prior scales.

    d_ij = |M_i a_i| sin(theta_ij), theta the principal angle between M_i a_i and the span of
    M_j; a signed scalar j reaches only its half-line.
    """
    given = amplitude or {}
    count = len(scores.columns)
    alone = np.array([i for i, own in enumerate(scores.columns) if len(own) == 1], dtype=int)
    several = [i for i, own in enumerate(scores.columns) if len(own) > 1]
    column = np.array([scores.columns[i][0] for i in alone], dtype=int)
    size = np.maximum(np.diag(scores.gram)[column], 1e-300)
    one_sided = scores.positive[column]
    strength, separation = np.zeros(count), np.zeros((count, count))
    for i, own in enumerate(scores.columns):
        block = scores.gram[np.ix_(own, own)]
        vectors = _vectors(given.get(i), block, scores.positive[list(own)])
        rests = []
        for vector in vectors:
            rest = np.zeros(count)
            total = float(vector @ block @ vector)
            strength[i] = max(strength[i], np.sqrt(max(total, 0.0)))
            cross = scores.gram[column][:, list(own)] @ vector
            alike = np.where(one_sided & (cross <= 0), 0.0, cross**2 / size)
            rest[alone] = np.sqrt(np.maximum(total - alike, 0.0))
            rest[several] = [_distance(scores, own, vector, scores.columns[j]) for j in several]
            rests.append(rest)
        # The largest separation over signs would hide a look-alike; the smallest never does.
        separation[i] = np.min(rests, axis=0)
        separation[i, i] = 0.0
    return Separations(strength, separation)


def _vectors(given: FloatArray | None, block: FloatArray, positive: np.ndarray) -> list[FloatArray]:
    if given is not None:
        return [np.asarray(given)]
    if block.shape[0] == 1:
        return [np.array([REACH])] if positive[0] else [np.array([REACH]), np.array([-REACH])]
    _, vector = np.linalg.eigh(block)
    return [REACH * vector[:, -1]]


def _distance(
    scores: Scores, own: tuple[int, ...], vector: FloatArray, other: tuple[int, ...]
) -> float:
    """Distance of a point from the span of several columns."""
    block = scores.gram[np.ix_(own, own)]
    cross = scores.gram[np.ix_(other, own)] @ vector
    total = float(vector @ block @ vector)
    inner = scores.gram[np.ix_(other, other)]
    explained = cross @ np.linalg.pinv(inner, rcond=1e-10, hermitian=True) @ cross
    return float(np.sqrt(max(total - float(explained), 0.0)))


def nearest(
    scores: Scores, target: FloatArray, columns: FloatArray, tested: list[tuple[int, ...]]
) -> tuple[tuple[int, ...], float]:
    """The hypothesis whose span comes nearest to a reduced signal, and its distance.

    What is left of an effect outside the catalogue beside its best look-alike, pairs included:
    below `TOLD_APART` nobody can tell. Signs are not looked at.

    Args:
        scores: of the catalogue.
        target: reduced signal, shape (n,).
        columns: reduced signatures in the scores' units, shape (n, E).
        tested: hypotheses, one at least.
    """
    inner, total = columns.T @ target, float(target @ target)
    left = []
    for hypothesis in tested:
        own = scores.of(hypothesis)
        block = scores.gram[np.ix_(own, own)]
        part = inner[own]
        explained = float(part @ np.linalg.pinv(block, rcond=1e-10, hermitian=True) @ part)
        left.append(np.sqrt(max(total - explained, 0.0)))
    best = int(np.argmin(left))
    return tested[best], float(left[best])
