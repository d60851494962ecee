"""Effects as strategies: inside their bounds, shrinking to one and to none, and what they do."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import Phase, find, given, settings

from estimators import Status
from estimators.kubelka_munk import KubelkaMunkEstimator
from scenarios.strategies import (
    Effects,
    Measured,
    Problem,
    effects,
    fast_engine,
    measurements,
    monte_carlo,
    problems,
)
from tests.strategies.worlds import two_fluxes
from twin.bench import Bench, Sample
from twin.effects import World, candidate
from twin.errors import InputError

MATERIAL = [(0.8, 1.5, 0.3), (0.6, 2.0, 0.0)]
NOMINAL = World.nominal(
    Bench(), [Sample(name=f"{mm:g} mm", thickness_mm=mm, n=1.5) for mm in (0.5, 1.0)]
)
SHRINK = settings(
    database=None, deadline=None, derandomize=True, phases=(Phase.generate, Phase.shrink)
)


@given(effects(most=3, scales=2.0))
def test_values_are_within_their_bounds(drawn: Effects) -> None:
    assert len(drawn) <= 3
    for name, values in drawn.items():
        one = candidate(NOMINAL, name)
        found = one.values(values)
        assert found != one.nominal
        for parameter, value in zip(one.parameters, found, strict=True):
            assert abs(value - parameter.nominal) <= 2.0 * parameter.prior_scale + 1e-9


def test_they_shrink_to_none_and_to_one_small_effect() -> None:
    assert find(effects(), lambda drawn: True, settings=SHRINK) == {}
    one = find(effects(), lambda drawn: len(drawn) > 0, settings=SHRINK)
    assert one == {"thickness[0.5 mm]": {"relative": 0.005}}
    lamp = find(effects(["gap", "drift[white]"]), lambda d: "drift[white]" in d, settings=SHRINK)
    assert lamp["drift[white]"] in ({"level": 0.0, "tilt": 0.00125}, {"level": 0.0025, "tilt": 0.0})


def test_unknown_names_are_refused() -> None:
    with pytest.raises(InputError, match=r"thickness\[0\.5 mm\]"):
        effects(["thickness[0.4 mm]"])
    with pytest.raises(InputError, match="Did you mean"):
        effects(["thicknes"])


def captures(world: Any, drawn: Effects, **fields: Any) -> np.ndarray:
    return Problem.of(MATERIAL, effects=drawn, **fields).measured(world).intensities.value


def test_effects_without_size_change_not_a_bit() -> None:
    zero: Effects = {"gap": {"gap_mm": 0.0}, "thickness[1 mm]": {"relative": 0.0}}
    assert captures(two_fluxes, zero).tobytes() == captures(two_fluxes, {}).tobytes()


SEEN_BY_ALL = effects(["thickness[0.5 mm]", "drift[white]", "dark_offset", "roughness"])


@settings(max_examples=15)
@given(measurements(problems(2, effects=SEEN_BY_ALL), world=two_fluxes))
def test_measurements_in_a_world_with_effects_are_whole(measured: Measured) -> None:
    assert np.isfinite(measured.intensities.value).all()
    assert measured.intensities.thickness_mm.tolist() == [0.5, 1.0]
    measured.model.check(measured.intensities)


@pytest.mark.parametrize("world", [two_fluxes, fast_engine], ids=["two_fluxes", "fast_engine"])
def test_a_thickness_that_is_not_told_is_that_thickness(world: Any) -> None:
    untold = captures(world, {"thickness[0.5 mm]": {"relative": 0.2}})
    told = captures(world, {}, thickness_mm=(0.6, 1.0))
    np.testing.assert_allclose(untold, told, rtol=2e-3)
    assert np.abs(untold[0] / captures(world, {})[0] - 1).max() > 0.02


def test_the_description_stays() -> None:
    measured = Problem.of(MATERIAL, effects={"thickness[0.5 mm]": {"relative": 0.2}}).measured(
        two_fluxes
    )
    assert measured.intensities.thickness_mm.tolist() == [0.5, 1.0]
    assert measured.model.samples[0].thickness_mm == 0.5
    found = KubelkaMunkEstimator(measured.model).estimate(measured.intensities)
    assert found.status[0] == Status.INCONSISTENT


def test_what_happens_after_the_light_happens_in_every_world() -> None:
    drift = captures(two_fluxes, {"drift[collimated]": {"level": 0.1}})
    np.testing.assert_allclose(drift[:, 2] / captures(two_fluxes, {})[:, 2], np.exp(0.1), rtol=1e-9)


def test_an_engine_that_does_not_show_an_effect_says_so() -> None:
    with pytest.raises(InputError, match="monte_carlo"):
        captures(fast_engine, {"gap": {"gap_mm": 1.0}})
    with pytest.raises(InputError, match="another phase function"):
        captures(two_fluxes, {"phase_function": {"share": 0.1}})


def test_the_monte_carlo_shows_them_all() -> None:
    drawn: Effects = {"gap": {"gap_mm": 6.0}, "depth_contrast[absorption]": {"contrast": 0.9}}
    with_it, without = (captures(monte_carlo, each) for each in (drawn, {}))
    assert with_it.shape == (2, 3, 2)
    assert np.abs(with_it[:, 1] / without[:, 1] - 1).max() > 0.03


def test_a_problem_shows_its_effects() -> None:
    shown = repr(Problem.of(MATERIAL, effects={"gap": {"gap_mm": 0.5}}))
    assert "effects={'gap': {'gap_mm': 0.5}}" in shown
    assert "effects" not in repr(Problem.of(MATERIAL))
