"""Scores against closed forms: normal errors of known bias and width, counted failures."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from estimators import Status
from scenarios.stress.ranking import ranking
from scenarios.stress.score import PARAMETERS, RAISED, Share, errors_of, score_of
from tests.stress.tiny import normal_answers, some_truth

COUNT = 2000
SIGMA = np.array([0.01, 0.02, 0.03])


def test_bias_and_spread_are_those_of_the_errors():
    truth = np.tile([0.5, 2.0, 0.3], (COUNT, 1))
    score = score_of(truth, normal_answers(truth, SIGMA, bias=0.5))
    for index, name in enumerate(PARAMETERS):
        found, scale = score.parameters[name], truth[0, 1] if index == 1 else 1.0
        expected = SIGMA[index] / scale
        assert abs(found.bias - 0.5 * expected) < 4 * found.bias_error
        assert found.bias_error == pytest.approx(1.2533 * expected / math.sqrt(COUNT), rel=0.1)
        assert found.spread == pytest.approx(expected, rel=0.07)
        assert found.z_spread == pytest.approx(1.0, rel=0.07)


def test_honest_intervals_are_called_right_and_narrow_or_wide_ones_are_not():
    truth = some_truth(COUNT)
    verdicts = {
        stated: {
            score.verdict
            for score in score_of(
                truth, normal_answers(truth, SIGMA, stated=stated)
            ).parameters.values()
        }
        for stated in (1.0, 0.5, 2.0)
    }
    assert verdicts == {1.0: {"right"}, 0.5: {"too narrow"}, 2.0: {"too wide"}}


def test_coverage_is_that_of_the_normal_distribution():
    truth = some_truth(COUNT)
    # Noise understated by two: erf(deviate / 2 / sqrt 2) of the points are held.
    for stated, expected in ((1.0, (0.5, 0.9, 0.95)), (0.5, (0.2641, 0.5892, 0.6729))):
        for score in score_of(
            truth, normal_answers(truth, SIGMA, stated=stated)
        ).parameters.values():
            for share, value in zip(score.coverage, expected, strict=True):
                assert abs(share.value - value) < 4 * math.sqrt(value * (1 - value) / COUNT)


def test_overconfidence_counts_points_once_and_only_what_is_claimed():
    truth = some_truth(10)
    answers = normal_answers(truth, SIGMA * 1e-3)
    assert score_of(truth, answers).overconfident == Share(0, 10)
    value = answers.value.copy()
    value[2] += 1.0  # all three parameters of one point
    value[5, 0] += 0.1
    wrong = replace(answers, value=value)
    score = score_of(truth, wrong)
    assert score.overconfident == Share(2, 10)
    assert score.parameters["albedo"].overconfident == Share(2, 10)
    assert score.parameters["g"].overconfident == Share(1, 10)
    identifiable = np.ones((10, 3), dtype=bool)
    identifiable[2] = False
    modest = score_of(truth, replace(wrong, identifiable=identifiable))
    assert modest.overconfident == Share(1, 10)
    assert modest.parameters["albedo"].claimed == 9


def test_failures_are_counted_by_name_and_weigh_as_infinite_errors():
    truth = some_truth(9)
    status = np.array([Status.OK] * 5 + [Status.MASKED] * 2 + [Status.NOT_CONVERGED, RAISED])
    score = score_of(truth, replace(normal_answers(truth, SIGMA), status=status))
    assert score.status == {"ok": 5, "masked": 2, "raised": 1, "not_converged": 1}
    assert score.answered == score.parameters["albedo"].claimed == 5
    own = np.sort(np.abs(errors_of(truth, normal_answers(truth, SIGMA).value))[:5, 0])
    assert score.parameters["albedo"].median_error == pytest.approx(own[2])
    assert score.parameters["albedo"].median_error_all == pytest.approx(own[4])
    lost = np.where(np.arange(9) < 5, Status.MASKED, Status.OK)
    worse = score_of(truth, replace(normal_answers(truth, SIGMA), status=lost))
    assert worse.parameters["albedo"].median_error_all == math.inf


def test_a_value_without_an_interval_is_counted_and_not_called_covered():
    truth = some_truth(20)
    answers = normal_answers(truth, SIGMA)
    interval = answers.interval.copy()
    interval[:, :, :5] = np.nan
    score = score_of(truth, replace(answers, interval=interval)).parameters["g"]
    assert (score.without_interval, score.coverage[1].total) == (5, 15)


@pytest.mark.parametrize(
    ("count", "total", "low", "high"),
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611)],
)
def test_wilson_interval_of_newcombe_1998(count: int, total: int, low: float, high: float):
    """Table I of R. G. Newcombe, Statistics in Medicine 17 (1998) 857."""
    assert Share(count, total).interval == pytest.approx((low, high), abs=5e-5)


def test_ranking_is_the_geometric_mean_of_error_ratios():
    truth = np.tile([0.5, 2.0, 0.3], (501, 1))
    good = normal_answers(truth, SIGMA)
    scores = {
        "double": score_of(truth, replace(good, value=truth + 2 * (good.value - truth))),
        "good": score_of(truth, good),
        "silent on g": score_of(
            truth, replace(good, value=good.value * np.array([1.0, 1.0, np.nan]))
        ),
    }
    rows = ranking(scores)
    assert [row["estimator"] for row in rows] == ["good", "double", "silent on g"]
    assert rows[0]["error_ratio"] == 1.0
    assert rows[1]["error_ratio"] == pytest.approx(2.0)
    assert rows[2]["error_ratio"] == math.inf
