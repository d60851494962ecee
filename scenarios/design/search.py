"""Search of the space of candidates: all of them, greedily, or by a Bayesian optimiser.

A candidate's score is the largest of its figures over their targets: 1 or less is good enough.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenarios.console import Console
from scenarios.design.candidate import Candidate, Space
from scenarios.design.goal import Goal
from scenarios.design.parts import Parts
from scenarios.design.predictor import Predictor
from twin.errors import InputError
from twin.spectra import FloatArray

EXHAUSTIVE_LIMIT = 40_000
"""Candidates up to which all are looked at."""
QUICK_LIMIT = 3_000
BATCH = 500
GREEDY_STEPS = 60


@dataclass(frozen=True, eq=False)
class Found:
    """Candidates that were looked at, N of them, T targets.

    Attributes:
        candidates: each once.
        figures: (N, T).
        price_usd: [USD], (N,).
        score: largest figure over its target, (N,).
        method: how they were chosen.
        complete: whether they are all there are within the budget.
        path: numbers of the candidates of the greedy path, cheapest first.
    """

    candidates: tuple[Candidate, ...]
    figures: FloatArray
    price_usd: FloatArray
    score: FloatArray
    method: str
    complete: bool
    path: tuple[int, ...] = ()

    @property
    def front(self) -> tuple[int, ...]:
        """Numbers of the candidates that none beats in price and score, cheapest first."""
        order = np.lexsort((np.arange(len(self.score)), self.score, self.price_usd))
        kept: list[int] = []
        best = np.inf
        for number in order:
            if self.score[number] < best:
                best = float(self.score[number])
                kept.append(int(number))
        return tuple(kept)

    @property
    def cheapest(self) -> int | None:
        """The cheapest that meets all targets; None: there is none."""
        return next((number for number in self.front if self.score[number] <= 1.0), None)

    @property
    def best(self) -> int:
        """The most accurate; of equals the cheapest."""
        return self.front[-1]


def search(goal: Goal, parts: Parts, predictor: Predictor, console: Console | None = None) -> Found:
    """Look for the candidates that a goal asks for.

    Args:
        goal: what, and by which search.
        parts: all parts.
        predictor: of the figures.
        console: is told how far it is.

    Raises:
        InputError: a budget below the cheapest candidate, or no part of a kind.
    """
    console = console or Console(quiet=True)
    space = Space.of(goal, parts)
    method = goal.search
    if method == "auto":
        limit = QUICK_LIMIT if goal.quick else EXHAUSTIVE_LIMIT
        method = "exhaustive" if space.size <= limit else "bayes"
    least = cheapest_of(space, parts)
    if least.price(parts) > goal.budget_usd:
        raise InputError(
            f"a budget of {goal.budget_usd:g} USD",
            f"{least.price(parts):g} USD or more, the price of the cheapest set-up",
            place="budget_usd",
            remedy=f"It is: {least.text}.",
        )
    seen = _Seen(goal, parts, predictor, console)
    if method == "exhaustive":
        affordable = [c for c in space if c.price(parts) <= goal.budget_usd]
        with console.step(f"predict {len(affordable)} candidates") as progress:
            for start in range(0, len(affordable), BATCH):
                seen.look(affordable[start : start + BATCH])
                progress(min(start + BATCH, len(affordable)), len(affordable))
        path = _greedy(space, seen, least)
        return seen.found("exhaustive", True, path)
    path = _greedy(space, seen, least)
    if method == "bayes":
        _bayes(space, seen, goal)
    return seen.found(method, False, path)


class _Seen:
    """Candidates that were looked at."""

    def __init__(self, goal: Goal, parts: Parts, predictor: Predictor, console: Console) -> None:
        self.goal, self.parts, self.predictor, self.console = goal, parts, predictor, console
        self.number: dict[Candidate, int] = {}
        self.figures: list[FloatArray] = []
        self.price: list[float] = []

    def look(self, candidates: Sequence[Candidate]) -> NDArray[np.intp]:
        """Numbers of candidates; those not seen yet are predicted, in one batch."""
        new = [c for c in dict.fromkeys(candidates) if c not in self.number]
        if new:
            for candidate, row in zip(new, self.predictor.predict(new), strict=True):
                self.number[candidate] = len(self.figures)
                self.figures.append(row)
                self.price.append(candidate.price(self.parts))
        return np.array([self.number[candidate] for candidate in candidates])

    def score(self, numbers: NDArray[np.intp]) -> FloatArray:
        """Largest figure over its target."""
        rows = np.array([self.figures[number] for number in numbers])
        return np.asarray((rows / self.goal.targets.values).max(axis=1))

    def found(self, method: str, complete: bool, path: Sequence[int]) -> Found:
        every = np.arange(len(self.figures))
        return Found(
            tuple(self.number), np.array(self.figures), np.array(self.price), self.score(every),
            method, complete, tuple(path),
        )  # fmt: skip


def cheapest_of(space: Space, parts: Parts) -> Candidate:
    """The cheapest candidate; of equals the first."""
    place = []
    for name, choices in space.axes:
        if name.startswith("part "):
            own = [parts.part(choice) for choice in choices]
            fewest = min(
                (len(c) for n, axis in space.axes if n == "thickness_mm" for c in axis), default=0
            )
            cost = [part.price + fewest * part.per_sample_usd for part in own]
            place.append(int(np.argmin(cost)))
        elif name == "thickness_mm":
            place.append(int(np.argmin([len(choice) for choice in choices])))
        else:
            place.append(0)
    return space.at(place)


def _greedy(space: Space, seen: _Seen, start: Candidate) -> list[int]:
    """From the cheapest on, the change of one decision that buys most per dollar, step by step.

    Changes that cost nothing and help are taken first, the best of them; the gain is that of the
    logarithm of the score.
    """
    here = start
    path = [int(seen.look([here])[0])]
    for _ in range(GREEDY_STEPS):
        around = [
            c for c in _neighbours(space, here) if c.price(seen.parts) <= seen.goal.budget_usd
        ]
        if not around:
            break
        numbers = seen.look(around)
        gain = np.log(seen.score(np.array(path[-1:]))[0] / seen.score(numbers))
        extra = np.array([seen.price[n] for n in numbers]) - seen.price[path[-1]]
        helps = gain > 1e-9
        if not helps.any():
            break
        free = helps & (extra <= 0)
        worth = np.where(free, gain, -np.inf) if free.any() else np.where(
            helps, gain / np.maximum(extra, 1e-9), -np.inf
        )  # fmt: skip
        best = int(np.argmax(worth))
        here = around[best]
        path.append(int(numbers[best]))
    return path


def _neighbours(space: Space, here: Candidate) -> list[Candidate]:
    """Candidates that differ in one decision."""
    place = []
    for name, choices in space.axes:
        if name.startswith("part "):
            place.append(next(i for i, choice in enumerate(choices) if choice in here.parts))
        else:
            place.append(choices.index(getattr(here, name)))
    around = []
    for axis, count in enumerate(space.shape):
        for other in range(count):
            if other != place[axis]:
                around.append(space.at([*place[:axis], other, *place[axis + 1 :]]))
    return around


def _bayes(space: Space, seen: _Seen, goal: Goal) -> None:
    """Tree-structured Parzen estimator for price and score together (optuna), in batches.

    Sources: Bergstra et al. 2011, NeurIPS 24; Ozaki et al. 2022, JAIR 73, 1209 (several goals).
    """
    from scenarios.design.optimiser import Optimiser

    optimiser = Optimiser(space.shape, seed=goal.seed)
    with seen.console.step(f"search {goal.trials} of {space.size} candidates") as progress:
        done = 0
        while done < goal.trials:
            batch = min(optimiser.batch, goal.trials - done)
            places = [optimiser.ask() for _ in range(batch)]
            candidates = [space.at(place) for place in places]
            numbers = seen.look(candidates)
            price = np.array([seen.price[number] for number in numbers])
            optimiser.tell(np.log(price), np.log(seen.score(numbers)), price <= goal.budget_usd)
            done += len(places)
            progress(done, goal.trials)
