"""How far the gap shrinks: unbiased on the right effect, honest on a wrong one."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis import PriorOdds, closure, diagnose, fit, separations
from diagnosis.adequacy import orthonormal
from diagnosis.attribution import linear, scores_of
from diagnosis.closure import directions, fieller
from diagnosis.evidence import Scores
from diagnosis.groups import REACH, TOLD_APART


def forced(linear_toy, seed, name, sigmas, hypothesis):
    problem = linear_toy.problem(seed, {name: linear_toy.visible(name, sigmas)})
    null = fit(problem)
    scores, _ = scores_of(problem, null)
    allowed = list(range(len(problem.candidates)))
    posterior = linear(problem, scores, allowed, -10.0, PriorOdds())
    return closure(problem, null, posterior, PriorOdds(), force=hypothesis, seed=seed)


def test_closure_of_the_right_effect_is_covered_by_its_interval(linear_toy):
    inside, values, count = 0, [], 30
    for seed in range(count):
        found = forced(linear_toy, 2000 + seed, "thickness[s2]", 10.0, (2,))
        target = 1.0 - found.oracle_floor / 100.0
        inside += found.interval[0] <= target <= found.interval[1]
        values.append(found.value)
    assert abs(np.mean(values) - 1.0) < 0.1
    # binomial: four standard errors below 90 %
    assert inside / count > 0.9 - 4 * np.sqrt(0.09 / count)


def stated_and_true(linear_toy, seed, effects):
    """A closure by what the splits choose, and what it is about: the same without noise."""
    problem = linear_toy.problem(seed, effects)
    null = fit(problem)
    scores, _ = scores_of(problem, null)
    posterior = linear(problem, scores, list(range(len(problem.candidates))), -10.0, PriorOdds())
    found = closure(problem, null, posterior, PriorOdds(), seed=seed)
    own = [column for index in found.chosen[0][0] for column in problem.columns[index]]
    columns = null.reduction(np.moveaxis(problem.signatures[own], 0, -1))
    basis = orthonormal(null.reduction(directions(problem, null, posterior)))
    response = linear_toy.forward(linear_toy.base.material, effects) - linear_toy.level
    target = null.reduction(response)
    left = target - columns @ np.linalg.lstsq(columns, target, rcond=None)[0]
    total = float(np.sum((basis.T @ target) ** 2))
    rest = float(np.sum((basis.T @ left) ** 2)) + found.oracle_floor
    return found, 1.0 - rest / total


def test_intervals_cover_the_closure_without_noise_whatever_is_chosen(linear_toy):
    names, levels = [c.name for c in linear_toy.candidates], (6.0, 10.0, 15.0, 25.0)
    inside, narrow, count = 0, 0, 40
    for trial in range(count):
        chosen = {names[trial % len(names)]} | ({"index"} if trial % 3 == 0 else set())
        effects = {n: linear_toy.visible(n, levels[trial % 4]) for n in sorted(chosen)}
        found, true = stated_and_true(linear_toy, 3000 + trial, effects)
        low, high = found.interval
        inside += low <= true <= high
        # control: an interval of a quarter of the width
        narrow += abs(true - 0.5 * (low + high)) <= 0.125 * (high - low)
    # binomial: three standard errors about 90 %
    assert abs(inside / count - 0.9) < 3 * np.sqrt(0.09 / count)
    assert narrow / count < 0.9 - 5 * np.sqrt(0.09 / count)


def test_closure_of_an_effect_that_explains_nothing_is_nothing(linear_toy):
    found = forced(linear_toy, 2100, "dark offset", 15.0, (3,))
    assert found.value < 0.5
    assert found.before == pytest.approx(225.0, abs=5 * np.sqrt(4 * 225 + 40))


def test_repeats_agree_on_a_clear_effect(linear_toy):
    name = "stray light"
    found = diagnose(linear_toy.problem(2200, {name: linear_toy.visible(name, 25.0)}))
    assert found.closure is not None
    assert found.closure.value > 0.85
    assert found.closure.by_repeats is not None
    before, after = found.closure.by_repeats
    assert after < 0.5 * before


def test_fieller_widens_where_there_is_little_to_close():
    strong, weak = (
        fieller(np.array([size, 0.0, 0.0]), np.zeros(3), after_excess=0.0, fitted=1)[1]
        for size in (30.0, 3.0)
    )
    assert strong[1] - strong[0] < 0.1
    assert weak[1] - weak[0] > 1.0


def test_separation_is_the_distance_to_the_nearest_point_of_the_other():
    columns = np.array([[2.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 5.0]])
    gram = columns.T @ columns
    scores = Scores(gram, np.zeros((1, 3)), np.array([False, False, True]), ((0,), (1,), (2,)))
    found = separations(scores)
    assert found.strength == pytest.approx(REACH * np.array([2.0, np.sqrt(2.0), 5.0]))
    assert found.separation[0, 1] == pytest.approx(REACH * 2.0 * np.sqrt(0.5))
    assert found.sine[0, 1] == pytest.approx(np.sqrt(0.5))
    assert found.separation[0, 2] == pytest.approx(REACH * 2.0)
    near = separations(scores, {0: np.array([1.0])})
    assert near.group(0, [0, 1, 2]) == (0, 1, 2)
    assert near.separation[0, 1] < TOLD_APART


def test_a_signed_effect_reaches_one_side_only():
    gram = np.array([[1.0, 0.9], [0.9, 1.0]])
    for sign, near in ((1.0, True), (-1.0, False)):
        scores = Scores(gram, np.zeros((1, 2)), np.array([False, True]), ((0,), (1,)))
        found = separations(scores, {0: np.array([5.0 * sign])})
        assert (found.separation[0, 1] < TOLD_APART) == near
