from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimators import BenchModel
from estimators.kubelka_munk import KubelkaMunkEstimator
from scenarios.strategies import (
    ALL,
    Measured,
    Problem,
    PropertyFailed,
    benches,
    check_estimator,
    fast_engine,
    find_faults,
    instruments,
    materials,
    measurements,
    monte_carlo,
    problems,
    property_tests,
    scaled_bench,
)
from tests.strategies.broken import ALL_BROKEN, Broken, HalvesItsIntervals
from tests.strategies.worlds import two_fluxes
from twin.bench import COVER_GLASS, Bench, Layer, Medium
from twin.errors import InputError
from twin.instrument.spec import Sensor

NAMES = {one.name: one for one in ALL}


@pytest.mark.parametrize("broken", ALL_BROKEN, ids=lambda one: one.__name__)
def test_every_planted_mistake_is_found(broken: type[Broken]) -> None:
    asked = [NAMES[name] for name in broken.found_by]
    faults = find_faults(broken, asked, world=two_fluxes, examples=5, wavelengths=300)
    assert [fault.property for fault in faults] == list(broken.found_by)


def test_every_property_finds_a_mistake() -> None:
    assert {name for broken in ALL_BROKEN for name in broken.found_by} == set(NAMES)


TestKubelkaMunkInItsOwnWorld = property_tests(
    KubelkaMunkEstimator, world=two_fluxes, examples=5, wavelengths=300
)


def test_a_found_problem_is_small_and_readable() -> None:
    asked = [NAMES["no_confident_wrong_answer"]]
    broken = next(one for one in ALL_BROKEN if one.__name__ == "PerCentimetre")
    fault = find_faults(broken, asked, world=two_fluxes)[0]
    assert "albedo=[0.5, 0.5], sigma_t_per_mm=[1., 1.], g=[0., 0.]" in fault.problem
    assert "sigma_t_per_mm is said to be" in fault.found


def test_all_faults_are_named_at_once() -> None:
    asked = [NAMES["intervals_cover"], NAMES["repeatable"]]
    with pytest.raises(PropertyFailed, match=r"intervals_cover.*hold the truth"):
        check_estimator(HalvesItsIntervals, asked, world=two_fluxes, examples=2)


def test_an_unknown_property_is_refused() -> None:
    with pytest.raises(InputError, match="repeatable"):
        property_tests(KubelkaMunkEstimator, without=["repeatible"])


def test_left_out_properties_are_not_tests() -> None:
    every = property_tests(KubelkaMunkEstimator)
    fewer = property_tests(KubelkaMunkEstimator, without=["repeatable"])
    assert set(vars(every)) - set(vars(fewer)) == {"test_repeatable"}


def test_an_estimator_that_says_nothing_does_not_pass() -> None:
    class Silent(Broken):
        def before(self, given):  # type: ignore[no-untyped-def]
            from dataclasses import replace

            return replace(given, valid=np.zeros_like(given.valid))

    try:
        faults = find_faults(Silent, [NAMES["intervals_cover"]], world=two_fluxes)
    finally:
        del Silent
    assert "no parameter is identifiable" in faults[0].found


def test_without_hypothesis_one_message_says_what_to_do() -> None:
    source = "import sys; sys.modules['hypothesis'] = None; import scenarios.strategies"
    done = subprocess.run([sys.executable, "-c", source], capture_output=True, text=True)
    assert done.returncode == 1
    assert 'pip install "benchtwin[test]"' in done.stderr.splitlines()[-1]


@given(materials())
def test_materials_are_possible(material: np.ndarray) -> None:
    albedo, sigma_t, g = material.T
    assert ((albedo >= 0.3) & (albedo <= 0.98)).all()
    assert ((sigma_t >= 0.25) & (sigma_t <= 4.0)).all()
    assert (np.abs(g) < 1.0).all()


@given(benches(), st.sampled_from([0.5, 3.0]))
def test_scaling_a_bench_and_back_gives_the_bench(bench: Bench, factor: float) -> None:
    scaled = scaled_bench(bench, factor)
    assert scaled.background.gap_mm == factor * bench.background.gap_mm
    assert scaled.panels[0].distance_mm == factor * bench.panels[0].distance_mm
    assert scaled.detector.acceptance_deg == bench.detector.acceptance_deg
    assert scaled.instrument == bench.instrument
    again = scaled_bench(scaled, 1.0 / factor)
    assert again.detector.spot_beam_mm == pytest.approx(bench.detector.spot_beam_mm)


def test_scaling_divides_the_extinction_of_covers() -> None:
    tinted = Layer(thickness_mm=0.2, n=1.5, medium=Medium(albedo=0.0, sigma_t_per_mm=0.3))
    scaled = scaled_bench(Bench(covers_above=(tinted, COVER_GLASS)), 2.0)
    medium = scaled.covers_above[0].medium
    assert medium is not None
    assert (medium.sigma_t_per_mm, scaled.covers_above[0].thickness_mm) == (0.15, 0.4)


@given(instruments())
def test_instruments_are_valid(instrument: Sensor) -> None:
    assert type(instrument).model_validate(instrument.model_dump()) == instrument


@given(problems(), st.integers(2, 9))
def test_averages_lessen_the_noise_and_keep_its_deviates(problem: Problem, times: int) -> None:
    from dataclasses import replace

    more = replace(
        problem, noise=replace(problem.noise, averages=times**2 * problem.noise.averages)
    )
    exact = two_fluxes(problem.measured(two_fluxes).model, problem.material)
    few, many = problem.measured(two_fluxes), more.measured(two_fluxes)
    np.testing.assert_allclose(
        few.intensities.value - exact, times * (many.intensities.value - exact), atol=1e-12
    )
    np.testing.assert_allclose(few.intensities.sigma, times * many.intensities.sigma)


@given(measurements(problems(2), world=two_fluxes))
def test_measurements_are_shown_and_whole(measured: Measured) -> None:
    assert measured.intensities.value.shape == (2, 3, 2)
    assert "sigma_t [1/mm]" in repr(measured)
    measured.model.check(measured.intensities)


def test_both_engines_make_measurements() -> None:
    problem = Problem.of([(0.8, 1.0, 0.3)])
    fast, slow = (problem.measured(world).intensities for world in (fast_engine, monte_carlo))
    assert fast.value.shape == slow.value.shape == (2, 3, 1)
    assert not np.array_equal(fast.value, slow.value)
    # The finite bench loses some light at its sides; without a correction, up to a tenth.
    np.testing.assert_allclose(fast.value, slow.value, rtol=0.15)


def test_the_monte_carlo_needs_a_bench() -> None:
    model = BenchModel(
        sample_names=(),
        wavelength_nm=np.array([500.0]),
        n=np.empty((0, 1)),
        rho_black=np.zeros(1),
        rho_white=np.ones(1),
    )
    with pytest.raises(InputError, match="bench"):
        monte_carlo(model, np.array([[0.5, 1.0, 0.0]]))
