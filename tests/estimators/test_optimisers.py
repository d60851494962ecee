from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimators.objective import Coordinates, Objective
from estimators.optimisers import (
    AdamEstimator,
    AdamSettings,
    End,
    NelderMeadEstimator,
    SearchSettings,
    adam,
    side_by_side,
)
from estimators.result import Status
from scenarios.strategies import Problem, fast_engine
from twin.errors import InputError

NUMBERS = st.floats(-6.0, 6.0)


@given(NUMBERS, NUMBERS, NUMBERS)
def test_coordinates_and_back(albedo: float, sigma_t: float, g: float) -> None:
    coordinates = Coordinates(0.75)
    theta = np.array([[albedo, sigma_t, g]])
    np.testing.assert_allclose(coordinates.of(coordinates.parameters(theta)), theta, atol=1e-6)
    step = 1e-5
    for k in range(3):
        shift = step * np.eye(3)[k]
        rise = coordinates.parameters(theta + shift) - coordinates.parameters(theta - shift)
        slope = coordinates.slope(theta)[0, k]
        assert rise[0, k] / (2.0 * step) == pytest.approx(slope, rel=1e-4)


def test_the_gradient_is_that_of_chi_square() -> None:
    visit = Problem.of([(0.8, 1.5, 0.3), (0.5, 1.0, 0.6)]).measured(fast_engine)
    objective = Objective(visit.model, visit.intensities, 3.0)
    theta = objective.start()
    slope = objective.linear(theta).slope
    for k in range(3):
        shift = 1e-5 * np.eye(3)[k]
        rise = objective.chi_square(theta + shift) - objective.chi_square(theta - shift)
        np.testing.assert_allclose(rise / 2e-5, 2.0 * slope[:, k], rtol=1e-4)


def test_adam_finds_the_bottom_of_a_valley() -> None:
    stiff = np.array([1.0, 1e4])
    rates = 0.05 * (1.0 + np.cos(np.linspace(0.0, np.pi, 600)))
    end = adam(lambda at: stiff * (at - 2.0), np.zeros((3, 2)), rates)
    np.testing.assert_allclose(end, 2.0, atol=1e-6)
    short = adam(lambda at: stiff * (at - 2.0), np.zeros((3, 2)), rates[-30:])
    assert not np.allclose(short, 2.0, atol=1e-2)


def test_searches_run_side_by_side_and_end_apart() -> None:
    calls = []

    def evaluate(points: np.ndarray) -> np.ndarray:
        calls.append(len(points))
        return (points**2).sum(axis=1)

    def halve(look, start):  # type: ignore[no-untyped-def]
        steps = 0
        while look(start) > 1.0:
            start, steps = start / 2.0, steps + 1
        return End(start, True, steps)

    starts = np.array([[1.0, 0.0, 0.0], [8.0, 0.0, 0.0], [64.0, 0.0, 0.0]])
    ends = side_by_side(halve, starts, evaluate)
    assert [end.evaluations for end in ends] == [0, 3, 6]
    assert len(calls) == 7
    assert side_by_side(halve, starts[:0], evaluate) == []


def test_an_error_in_one_search_reaches_the_caller() -> None:
    def fail(look, start):  # type: ignore[no-untyped-def]
        if start[0] > 0:
            raise ValueError("found a mistake")
        return End(start, look(start) >= 0, 1)

    with pytest.raises(ValueError, match="mistake"):
        side_by_side(fail, np.array([[0.0], [1.0]]), lambda points: points[:, 0])


def test_too_few_steps_are_said() -> None:
    visit = Problem.of([(0.8, 1.5, 0.3), (0.5, 1.0, 0.6)]).measured(fast_engine)
    for estimator in (
        NelderMeadEstimator(visit.model, SearchSettings(evaluations=10)),
        AdamEstimator(visit.model, AdamSettings(steps=3)),
    ):
        result = estimator.estimate(visit.intensities)
        assert (result.status == Status.NOT_CONVERGED).all()
        assert np.isnan(result.parameters).all()
        assert not result.identifiable.any()


@pytest.mark.parametrize(
    ("kind", "option", "value"),
    [(SearchSettings, "evaluations", 0), (AdamSettings, "rate", -1.0), (AdamSettings, "steps", 1)],
)
def test_an_option_out_of_range_is_refused(kind: type, option: str, value: float) -> None:
    with pytest.raises(InputError, match=option):
        kind(**{option: value})
