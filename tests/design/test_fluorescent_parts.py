"""Parts of fluorescence set-ups, what is wrong with cheap ones, and the search among them."""

from __future__ import annotations

import json

import numpy as np
import pytest

from scenarios.design.fluorescent import predict_fluorescence
from scenarios.design.fluorescent_errors import (
    _levels_and_gains,
    capture_errors,
    effect_names,
)
from scenarios.design.fluorescent_parts import SEED_LIGHTS, assembled, price_of, priced_lights
from scenarios.design.fluorescent_population import fluorescent_population
from scenarios.design.fluorescent_prior import linearised_population
from scenarios.design.fluorescent_search import (
    SEED_DESIGNS,
    Exhaustive,
    FluorescentDesign,
    best_of_size,
    exhaustive,
    varied_designs,
    without_each,
)
from scenarios.design.fluorescent_verify import TASK, simulated, verification_point
from scenarios.sweep.task import function_of
from twin.errors import InputError
from twin.fluorescence import named_setup, nominal_system

MATERIALS = fluorescent_population(2)
MATRICES = np.array([each.matrix for each in MATERIALS])


def test_prices_are_the_seed_s_to_the_dollar() -> None:
    prices = {name: design.price_usd for name, design in SEED_DESIGNS.items()}
    assert prices == {"L1-S1": 2004.0, "L1-S2": 29.0, "L2-S1": 2165.0, "L2-S2": 190.0}
    assert price_of(["blue", "gel_red", "gel_yellow"], "S2") == 25.0 + 0.5 + 0.5 + 10.0
    assert price_of(["cool_white", "gel_red"], "S2") == 25.0 + 0.5 + 5.0
    assert price_of(["panel_red", "panel_yellow"], "S2") == 25.0 + 129.5 + 10.0
    with pytest.raises(InputError, match="violett") as error:
        price_of(["violett"], "S2")
    assert "violet" in error.value.remedy
    with pytest.raises(InputError, match="S3"):
        price_of(["violet"], "S3")


def test_the_seed_s_sets_come_back_as_they_are() -> None:
    for lights, detector in (("L1", "S1"), ("L2", "S2")):
        made = assembled(SEED_LIGHTS[lights], detector)
        known = named_setup(f"{lights}-{detector}".lower())
        assert made.detector == known.detector
        np.testing.assert_allclose(
            nominal_system(made).illuminants, nominal_system(known).illuminants, atol=1e-12
        )
    assert len(priced_lights()) == 8 + 4 + 1 + 7 + 7


def test_signature_of_a_shift_is_that_of_a_light_that_has_moved() -> None:
    """Against the light's own formula, binned anew; the catalogue moves samples of it."""
    setup = named_setup("l1-s2")
    found = capture_errors(setup, MATRICES, {"illuminant_shift": 0.5})
    assert found.names[1] == "illuminant_shift[blue]"
    blue = setup.lights[1]
    moved = blue.model_copy(update={"peak_nm": blue.peak_nm + 1.0})  # half of the prior's 2 nm
    lights = (setup.lights[0], moved, *setup.lights[2:])
    changed = nominal_system(setup.model_copy(update={"lights": lights}))
    nominal = nominal_system(setup)
    scale = changed.illuminants[0].sum() / nominal.illuminants[0].sum()
    white = changed.white(0.99) / scale
    factor = _levels_and_gains(white, nominal.white(0.99), True)
    expected = changed.captures(MATRICES) / scale / factor - nominal.captures(MATRICES)
    value = found.value[1].reshape(expected.shape)
    size = np.abs(expected).max()
    assert size > 1e-4
    assert np.abs(value - expected).max() < 0.05 * size
    assert np.abs(value + expected).max() > 0.5 * size


def test_levels_and_gains_are_calibrated_away() -> None:
    white = nominal_system(named_setup("l1-s2")).white(0.99)
    level = np.linspace(0.7, 1.4, 8)
    gain = np.linspace(0.9, 1.1, 8)
    found = _levels_and_gains(level[:, None] * gain * white, white, True)
    np.testing.assert_allclose(found, level[:, None] * gain, rtol=1e-4)
    assert np.abs(_levels_and_gains(white * gain, white, False) - gain).max() > 0.02


def test_errors_of_lights_are_harmless_where_lights_are_measured() -> None:
    lights = {"illuminant_shift": 1.0, "filter_leak": 1.0, "ultraviolet_leak": 1.0}
    assert capture_errors(named_setup("l1-s1"), MATRICES, lights).names == ()
    assert len(capture_errors(named_setup("l1-s2"), MATRICES, lights).names) == 24
    assert capture_errors(named_setup("l1-s2"), MATRICES, {"cross_talk": 0.0}).names == ()
    population = linearised_population(MATERIALS)
    setups = [named_setup("l1-s1"), named_setup("l1-s2")]
    plain = predict_fluorescence(setups, population)
    warm = predict_fluorescence(setups, population, errors={"illuminant_shift": 1.0})
    np.testing.assert_array_equal(warm.lower[0], plain.lower[0])
    assert warm.rmse_lower[1] > 1.2 * plain.rmse_lower[1]


def test_bad_errors() -> None:
    setup = named_setup("l1-s2")
    with pytest.raises(InputError) as error:
        capture_errors(setup, MATRICES, {"illuminant_shft": 1.0})
    assert "illuminant_shift" in error.value.remedy
    assert set(effect_names()) >= {"cross_talk", "sensitivity_error"}
    with pytest.raises(InputError, match="-1"):
        capture_errors(setup, MATRICES, {"cross_talk": -1.0})
    near = named_setup("l1-s2", excitation_from_nm=380.0)
    with pytest.raises(InputError, match="same wavelengths"):
        capture_errors(near, MATRICES, {"cross_talk": 1.0})


def test_verification_is_a_task_of_a_sweep() -> None:
    setup = assembled(("violet", "green", "warm_white"), "S2")
    point = json.loads(json.dumps(verification_point(setup, materials=2, seed=4)))
    task = function_of(TASK)
    assert task is simulated
    first, again = task(point), task(point)
    assert set(first) == {"lower", "diagonal", "colour"}
    for name, value in first.items():
        assert value.shape == (2,)
        assert np.all(value > 0.0)
        assert value.tobytes() == again[name].tobytes()
    other = task({**point, "seed": 5})
    assert other["lower"].tobytes() != first["lower"].tobytes()
    del point["seed"]
    with pytest.raises(InputError, match="no seed"):
        task(point)


def test_designs_are_varied_by_chance_alone() -> None:
    few, more = varied_designs(5), varied_designs(20)
    assert few == more[:5]
    assert len(set(more)) == 20
    assert {each.detector for each in more} == {"S1", "S2"}
    assert varied_designs(5, seed=2) != few
    with pytest.raises(InputError):
        varied_designs(0)


def test_cheaper_means_cheaper_and_as_good_in_everything() -> None:
    names = (("a", "b"), ("a",), ("b",), ("c",))
    found = Exhaustive(
        tuple(FluorescentDesign(each, "S2") for each in names),
        np.array([30.0, 29.0, 29.0, 28.0]), np.array([1.0, 0.9, 0.95, 1.05]),
        np.array([1.0, 1.0, 0.9, 0.9]), np.array([1.0, 1.1, 1.0, 0.9]),
    )  # fmt: skip
    assert found.as_good_as(0) == [2]
    assert found.as_good_as(0, slack=0.06) == [3, 2]
    assert found.as_good_as(0, slack=0.11) == [3, 1, 2]
    assert found.as_good_as(3, slack=10.0) == []
    assert found.front() == [3, 1]
    assert best_of_size(found, "S2") == {1: 1, 2: 0}
    assert without_each(found, found.designs[0]) == {"a": 0.95, "b": 0.9}
    with pytest.raises(InputError):
        found.number_of(FluorescentDesign(("d",), "S2"))


def test_every_choice_of_lights_is_tried() -> None:
    population = linearised_population(MATERIALS)
    found = exhaustive(("violet", "green", "warm_white"), population, detectors=("S2",))
    assert len({each.lights for each in found.designs}) == 7
    best = best_of_size(found, "S2")
    assert found.rmse_lower[best[3]] < found.rmse_lower[best[1]]
    assert set(found.price_usd) == {25.5, 26.0, 26.5}
    assert all(ratio > 0.9 for ratio in without_each(found, found.designs[best[3]]).values())
