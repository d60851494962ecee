"""Fits that must settle: effects without a slope at nominal, a wavelength far from its place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import diagnosis.refit as refit
from diagnosis import Candidate, Problem, fit
from twin.errors import InputError

EVEN = Candidate("gap", "", ("mm",), ("mm",), (0.5,), (1,), even=(True,))


def squared(linear_toy, seed: int, value: float, even: bool) -> tuple[Problem, int]:
    """A measurement on which "stray light" acts by the square of its value; its number."""
    names = [c.name for c in linear_toy.candidates]
    number = names.index("stray light")
    own = linear_toy.candidates[number]
    scale = own.prior_scale[0]

    def forward(material, effects):
        named = dict(effects)
        if own.name in named:
            named[own.name] = np.asarray(named[own.name]) ** 2 / scale
        return linear_toy.forward(material, named)

    problem = linear_toy.problem(seed, {own.name: [value**2 / scale]})
    candidates = list(problem.candidates)
    candidates[number] = replace(own, even=(even,), limit=(10.0 * scale,))
    return replace(problem, forward=forward, candidates=tuple(candidates)), number


def test_coordinates_of_an_even_parameter() -> None:
    q = np.array([0.02, 0.5, 2.0])
    v = np.array([EVEN.physical(each)[0] for each in q])
    assert np.allclose(v, np.sqrt(q * 0.5))
    assert v[1] == pytest.approx(0.5), "one prior scale is one in both"
    assert EVEN.physical(np.array([-0.5]))[0] == pytest.approx(-0.5)
    assert EVEN.bounds[1][0] == pytest.approx(5.0**2 / 0.5), "ten prior scales, squared"
    odd = replace(EVEN, even=())
    assert np.array_equal(odd.physical(q[:1]), q[:1])
    assert odd.bounds[1][0] == pytest.approx(5.0)
    with pytest.raises(InputError, match="whether a parameter is even"):
        replace(EVEN, even=(True, False))


def test_errors_of_an_even_parameter_are_those_of_its_slope() -> None:
    q, sd = np.array([2.0]), np.array([0.05])
    ahead = (EVEN.physical(q + 1e-6) - EVEN.physical(q - 1e-6)) / 2e-6
    assert EVEN.physical_sd(q, sd) == pytest.approx(ahead * sd, rel=1e-6)
    at_nominal = EVEN.physical_sd(np.zeros(1), sd)
    # as far as one standard error reaches, and by half: the slope there
    assert at_nominal == pytest.approx(0.5 * EVEN.physical(sd))


@pytest.mark.parametrize("even", [(), (True,)])
def test_an_error_of_the_responses_is_one_of_the_values(even: tuple[bool, ...]) -> None:
    candidate = replace(EVEN, even=even)
    q, sd = np.array([2.0]), np.array([0.05])
    both = candidate.physical_sd(q, candidate.with_response_error(q, sd, 0.1))
    alone = candidate.physical_sd(q, sd)
    assert both == pytest.approx(np.hypot(alone, 0.1 * candidate.physical(q)))


@pytest.mark.parametrize("sigmas", [4.0, 20.0])
def test_an_even_effect_is_fitted_in_one_step(linear_toy, sigmas: float) -> None:
    q = float(linear_toy.visible("stray light", sigmas)[0])
    scale = 0.005
    value = float(np.sqrt(q * scale))
    z = []
    for seed in range(6):
        problem, number = squared(linear_toy, seed, value, even=True)
        found = fit(problem, (number,), fit(problem))
        assert found.converged
        assert found.disagreement < 0.02
        own = problem.candidates[number]
        away = found.values[own.name]
        z.append((away - value) / own.physical_sd(found.value, np.sqrt(np.diag(found.covariance))))
    assert np.abs(np.mean(z)) < 1.3


def test_without_the_coordinate_the_first_step_is_far_off(linear_toy) -> None:
    value = float(np.sqrt(linear_toy.visible("stray light", 40.0)[0] * 0.005))
    for even, enough in ((True, True), (False, False)):
        problem, number = squared(linear_toy, 0, value, even=even)
        assert (fit(problem, (number,), fit(problem)).disagreement < 0.02) is enough


@pytest.mark.parametrize("seed", [2, 3])
def test_a_lost_wavelength_does_not_hold_the_others_back(toy, monkeypatch, seed: int) -> None:
    problem = toy.problem(seed, {"acceptance": [0.5]})
    number = [c.name for c in problem.candidates].index("acceptance")
    lost = problem.material.copy()
    lost[0] = (-1.5, lost[0, 1] - 1.0, 2.5)
    strayed = replace(problem, material=lost)
    null = fit(strayed)
    wanted = fit(problem, (number,), fit(problem))
    found = fit(strayed, (number,), null)
    assert found.chi_square < wanted.chi_square + 1.0
    assert found.value == pytest.approx(wanted.value, rel=0.02)
    monkeypatch.setattr(refit, "RESTARTS", 0)
    assert fit(strayed, (number,), null).chi_square > 10.0 * found.chi_square


def test_a_fit_stays_within_reach(toy) -> None:
    problem = toy.problem(1, {"dark offset": [-0.01]})
    near = tuple(float(each) for each in 0.95 * np.abs(problem.material).max(axis=0))
    start = 0.9 * problem.material
    found = fit(replace(problem, material=start, material_reach=near))
    assert np.all(np.abs(found.material) <= np.array(near))
    assert np.any(np.abs(fit(replace(problem, material=start)).material) > np.array(near)), (
        "it would go farther"
    )
