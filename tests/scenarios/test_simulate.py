"""The simulated visit: signals, exposures, the order of shots, and the way back."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import Any, get_args

import numpy as np
import pytest

from scenarios import Scenario, simulate_visit
from scenarios.simulate import _sample_seed
from tests.scenarios.tiny import tiny
from twin.errors import InputError
from twin.instrument import Contribution
from twin.measurement import Measurement, relative_intensities
from twin.transport import captures

# Relative intensities divide the stray light and the curve of the sensor out only without them.
EVERYTHING = get_args(Contribution)


def scenario_of(off: tuple[str, ...] = (), **changes: Any) -> Scenario:
    table = tiny(**changes)
    instrument = table["bench"]["instrument"]
    instrument |= {"start_nm": 450.0, "stop_nm": 650.0, "step_nm": 50.0, "off": list(off)}
    table["wavelength"] = {"start_nm": 400.0, "stop_nm": 700.0, "step_nm": 50.0}
    return Scenario.model_validate(table)


@pytest.fixture(scope="module")
def visit() -> Measurement:
    return simulate_visit(scenario_of())


def test_without_noise_the_relative_intensities_are_those_of_the_light_transport():
    scenario = scenario_of(EVERYTHING)
    found = relative_intensities(simulate_visit(scenario))
    for number, sample in enumerate(scenario.samples):
        exact = captures(
            scenario.bench,
            sample,
            scenario.wavelength.wavelength_nm,
            paths=1024,
            seed=_sample_seed(5, number),
        )
        inside = slice(1, -1)  # the instrument sees 450 to 650 nm of 400 to 700 nm
        for index, name in enumerate(("black", "white", "collimated")):
            np.testing.assert_allclose(
                found.value[number, index], getattr(exact, name)[inside], rtol=1e-9
            )


def test_that_comparison_can_fail(visit: Measurement):
    scenario = scenario_of()
    exact = captures(
        scenario.bench, scenario.samples[0], scenario.wavelength.wavelength_nm, paths=1024,
        seed=_sample_seed(5, 0),
    )  # fmt: skip
    found = relative_intensities(visit).value[0, 0]
    assert np.abs(found / exact.black[1:-1] - 1).max() > 1e-5


def test_noise_is_as_large_as_the_covariance_says():
    """Normalised deviations between visits that differ in the instrument's noise alone."""
    scenario = scenario_of()
    zero = np.zeros(scenario.wavelength.wavelength_nm.size)
    light = [
        replace(captures_of(scenario, number), black_se=zero, white_se=zero, collimated_se=zero)
        for number in range(2)
    ]
    deviations = []
    for seed in range(8):
        found = noisy(scenario, light, seed)
        deviations.append((found.value - exact_of(scenario, light)) / found.sigma)
    squares = np.square(np.array(deviations))
    # Level and tilt of two lamps are common to all wavelengths: far fewer than 8 * 30 are
    # independent; the mean of 8 * 4 squares of normal deviates has a standard deviation of 0.25.
    assert 0.25 < squares.mean() < 2.0


def captures_of(scenario: Scenario, number: int) -> Any:
    return captures(
        scenario.bench, scenario.samples[number], scenario.wavelength.wavelength_nm, paths=1024,
        seed=_sample_seed(5, number),
    )  # fmt: skip


def noisy(scenario: Scenario, light: list[Any], seed: int) -> Any:
    with pytest.MonkeyPatch.context() as patch:
        samples = [sample.name for sample in scenario.samples]
        patch.setattr(
            "twin.transport.captures",
            lambda bench, sample, *_, **__: light[samples.index(sample.name)],
        )
        return relative_intensities(simulate_visit(scenario, seed=seed))


def exact_of(scenario: Scenario, light: list[Any]) -> np.ndarray:
    """What many visits agree on: stray light, nonlinearity and the fixed pattern stay in."""
    quiet = scenario_of(("shot_noise", "read_noise", "quantisation", "lamp_drift", "averages"))
    return noisy(quiet, light, 5).value


def test_every_sample_has_its_darks_and_references_first_and_last(visit: Measurement):
    shots = visit.captures.shots
    by_sample = [
        [shot.capture for shot in shots if shot.sample == name] for name in ("thin", "thick")
    ]
    for order in by_sample:
        assert (
            order[-6:] == ["white_reference"] * 2 + ["black_reference"] * 2 + ["beam_reference"] * 2
        )
        assert Counter(order)["white_reference"] == 4
        assert Counter(order)["collimated"] == 2
        signals = [name for name in order if name in ("black", "white", "collimated")]
        assert signals == ["black"] * 2 + ["white"] * 2 + ["collimated"] * 2
    times = [shot.time_s for shot in shots]
    assert times == sorted(times)
    assert len(set(times)) == len(times)


def test_every_reading_has_a_dark_at_its_exposure(visit: Measurement):
    shots = visit.captures.shots
    darks = {(s.sample, s.integration_s, s.gain) for s in shots if s.capture == "dark"}
    assert {(s.sample, s.integration_s, s.gain) for s in shots} == darks


def test_references_once_and_another_order():
    protocol = {
        "repeats": 1, "reference_repeats": 1, "references": "first",
        "order": ["collimated", "white", "black"],
    }  # fmt: skip
    shots = simulate_visit(scenario_of(protocol=protocol)).captures.shots
    assert [s.capture for s in shots if s.sample == "thin"][-3:] == ["collimated", "white", "black"]
    assert Counter(s.capture for s in shots)["white_reference"] == 2


def test_the_collimated_capture_is_exposed_longer_but_within_the_limit():
    def times(**protocol: Any) -> dict[str, float]:
        shots = simulate_visit(scenario_of(protocol=protocol)).captures.shots
        return {s.capture: s.integration_s for s in shots if s.sample == "thick"}

    free = times(collimated_longest_s=60.0)
    assert free["collimated"] > 2 * free["beam_reference"]
    short = times(collimated_longest_s=1e-3)
    assert short["collimated"] == short["beam_reference"]


def test_the_exposure_can_be_fixed():
    shots = simulate_visit(scenario_of(protocol={"exposure": 0.05})).captures.shots
    assert {shot.integration_s for shot in shots} == {0.05}


def test_the_white_of_the_thicker_sample_lies_deeper_and_gets_less_light():
    visit = simulate_visit(scenario_of(EVERYTHING))
    scenario = scenario_of()
    mean = {
        name: np.mean(
            [
                counts - visit.bench.instrument.dark_level_counts
                for shot, counts in zip(visit.captures.shots, visit.captures.counts, strict=True)
                if (shot.capture, shot.sample) == ("white_reference", name)
            ],
            axis=0,
        )
        for name in ("thin", "thick")
    }
    factor = [captures_of(scenario, number).white_reference_factor for number in range(2)]
    assert factor[1] < factor[0]
    np.testing.assert_allclose(mean["thick"] / mean["thin"], factor[1] / factor[0], rtol=1e-9)


def test_the_light_transport_states_its_own_error(visit: Measurement):
    scenario = scenario_of()
    exact = [captures_of(scenario, number) for number in range(2)]
    expected = [[e.black_se[1:-1], e.white_se[1:-1], e.collimated_se[1:-1]] for e in exact]
    # The interpolation's error is added, which the transport's noise makes more than nothing.
    assert np.all(visit.captures.light_se >= np.array(expected) * (1 - 1e-12))
    assert np.all(visit.captures.light_se <= np.array(expected) * 1.5)
    found = relative_intensities(visit)
    assert np.all(found.sigma >= np.array(expected) * (1 - 1e-9))


def test_the_truth_is_that_of_the_material(visit: Measurement):
    assert np.all(visit.truth.albedo == 0.8)
    assert np.all(visit.truth.sigma_t_per_mm == 3.0)
    assert visit.truth.wavelength_nm[0] <= 450.0
    assert visit.truth.wavelength_nm[-1] >= 650.0


def test_a_chip_changes_its_gain_and_not_its_time():
    table = tiny(bench={"instrument": {"kind": "chip"}})
    table["wavelength"] = {"start_nm": 380.0, "stop_nm": 780.0, "step_nm": 80.0}
    shots = simulate_visit(Scenario.model_validate(table)).captures.shots
    assert len({shot.integration_s for shot in shots}) == 1
    gains = {shot.capture: shot.gain for shot in shots if shot.sample == "thick"}
    assert gains["collimated"] > gains["beam_reference"]


def test_samples_are_independent_and_every_seed_is_another():
    seeds = {_sample_seed(seed, number) for seed in range(20) for number in range(20)}
    assert len(seeds) == 400


def test_a_grid_that_misses_the_instrument_is_refused():
    with pytest.raises(InputError) as error:
        simulate_visit(
            Scenario.model_validate(
                tiny(wavelength={"start_nm": 500.0, "stop_nm": 600.0, "step_nm": 50.0})
            )
        )
    assert error.value.place == "wavelength"
