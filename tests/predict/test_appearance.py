"""Reflectance of slabs against closed forms, and intervals against their promise."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenarios.predict import Prediction, Slab, medium_of, predict, reflectance_45_0
from scenarios.predict.appearance import monte_carlo_45_0
from tests.predict.estimates import WAVELENGTH, constant, estimate, exact
from twin.errors import InputError
from twin.spectra import FloatArray

SLANT = np.cos(np.radians(45.0))


def h_function(albedo: float, cosine: FloatArray) -> FloatArray:
    """Chandrasekhar 1950, Radiative Transfer, chapter V, equation 3: isotropic scattering.

    Solved by iterating 1/H = sqrt(1 - w) + w/2 int mu' H(mu') / (mu + mu') dmu'.
    """
    node, weight = np.polynomial.legendre.leggauss(64)
    node, weight = (node + 1) / 2, weight / 2
    h = np.ones_like(node)

    def next_h(at: FloatArray) -> FloatArray:
        kernel = node / (at[:, None] + node)
        return np.asarray(1 / (np.sqrt(1 - albedo) + albedo / 2 * kernel @ (weight * h)))

    for _ in range(2000):
        h = next_h(node)
    return next_h(cosine)


@pytest.mark.parametrize("albedo", [0.2, 0.6, 0.9, 0.99])
def test_an_infinite_matched_slab_is_chandrasekhars(albedo: float) -> None:
    """Radiance factor of a half-space: w/4 H(mu) H(mu0) / (mu + mu0)."""
    view, light = h_function(albedo, np.array([1.0, SLANT]))
    expected = albedo / 4 * view * light / (1 + SLANT)
    found = reflectance_45_0(np.array([[albedo, 1.0, 0.0]]), np.inf, 1.0)
    assert found[0] == pytest.approx(expected, abs=1e-4)


def test_the_reference_would_notice_another_albedo() -> None:
    """The control of the test before: 0.002 in albedo is seen."""
    view, light = h_function(0.9, np.array([1.0, SLANT]))
    found = reflectance_45_0(np.array([[0.902, 1.0, 0.0]]), np.inf, 1.0)
    assert found[0] != pytest.approx(0.9 / 4 * view * light / (1 + SLANT), abs=1e-4)


@pytest.mark.parametrize("albedo", [0.2, 0.9, 0.99])
def test_the_reference_itself_keeps_chandrasekhars_integral(albedo: float) -> None:
    """Its equation V.1 (8): the integral of H over 0 to 1 is 2/w (1 - sqrt(1 - w))."""
    node, weight = np.polynomial.legendre.leggauss(40)
    integral = weight / 2 @ h_function(albedo, (node + 1) / 2)
    assert integral == pytest.approx(2 / albedo * (1 - np.sqrt(1 - albedo)), rel=1e-6)


@settings(max_examples=20)
@given(st.floats(0.01, 5.0), st.floats(0.0, 1.0))
def test_a_clear_filter_follows_beer_there_and_back(depth: float, rho: float) -> None:
    found = reflectance_45_0(np.array([[0.0, depth, 0.0]]), 1.0, 1.0, rho)
    assert found[0] == pytest.approx(rho * np.exp(-depth * (1 / SLANT + 1)), abs=2e-4)


def test_nothing_at_all_shows_the_background() -> None:
    found = reflectance_45_0(np.array([[0.0, 0.0, 0.0]]), np.inf, 1.0, 0.37)
    assert found[0] == pytest.approx(0.37, abs=1e-4)


def test_a_thick_slab_is_an_infinite_one_on_any_background() -> None:
    ink = np.array([[0.7, 8.0, 0.4]])
    infinite = reflectance_45_0(ink, np.inf)
    assert reflectance_45_0(ink, 20.0, rho=0.0) == pytest.approx(infinite, abs=1e-6)
    assert reflectance_45_0(ink, 20.0, rho=1.0) == pytest.approx(infinite, abs=1e-6)
    assert reflectance_45_0(ink, 0.05, rho=1.0) > infinite + 0.1


@settings(max_examples=20)
@given(st.floats(0.3, 3.0), st.floats(0.0, 0.99), st.floats(-0.5, 0.8))
def test_only_sigma_t_times_thickness_counts(scale: float, albedo: float, g: float) -> None:
    one = reflectance_45_0(np.array([[albedo, 3.0, g]]), 0.5, 1.4, 0.5)
    same = reflectance_45_0(np.array([[albedo, 3.0 * scale, g]]), 0.5 / scale, 1.4, 0.5)
    assert same[0] == pytest.approx(one[0], abs=1e-9)


def test_a_large_batch_is_its_parts() -> None:
    rng = np.random.Generator(np.random.Philox(key=3))
    many = np.stack([rng.uniform(0, 0.99, 700), rng.uniform(0.1, 9, 700), rng.uniform(0, 0.8, 700)])
    whole = reflectance_45_0(many.T, 0.5)
    parts = [reflectance_45_0(many.T[i : i + 50], 0.5) for i in (0, 350, 650)]
    np.testing.assert_allclose(np.concatenate(parts), whole[np.r_[0:50, 350:400, 650:700]], 1e-9)


def test_unknown_wavelengths_stay_unknown() -> None:
    properties = constant(0.6, 3.0, 0.2)
    properties[3] = np.nan
    found = predict(exact(properties), Slab(1.0))
    assert np.flatnonzero(np.isnan(found.reflectance)).tolist() == [3]
    assert np.isnan(found.interval()[:, 3]).all()


def test_both_engines_agree() -> None:
    """Two inks on a bright and a dark background, within 4.5 standard errors."""
    properties = np.array([[0.6, 4.0, 0.4], [0.95, 3.0, 0.0]])
    wavelength = np.array([500.0, 600.0])
    for rho in (0.02, 0.9):
        slab = Slab(0.5, 1.5, rho)
        value, error = monte_carlo_45_0(wavelength, properties, slab, paths=1 << 13, seed=4)
        fast = reflectance_45_0(properties, 0.5, 1.5, rho)
        assert (error < 0.02 * value).all()
        assert (np.abs(value - fast) < 4.5 * error).all()
        # the control: the check sees a thickness that is 20 % off
        assert (np.abs(value - reflectance_45_0(properties, 0.6, 1.5, 0.5)) > 4.5 * error).any()


def test_the_monte_carlo_adds_its_noise_to_the_draws() -> None:
    properties = constant(0.7, 3.0, 0.2)[:2]
    medium = exact(properties, WAVELENGTH[:2])
    found = predict(medium, Slab(0.5), engine="monte-carlo", paths=1024)
    assert (found.standard_error > 0).all()
    assert not np.array_equal(found.draws[0], found.reflectance)
    assert (np.abs(found.draws - found.reflectance) < 5 * found.standard_error).all()


TRIALS = 200
COVERAGE_TRUTH = (0.8, 3.0, 0.4)
COVERAGE_ERROR = (0.02, 0.1, 0.05)


def _coverage(stated: float, trials: int = TRIALS) -> float:
    """Share of 90 % intervals that hold the true reflectance; `stated` scales the stated error."""
    rng = np.random.Generator(np.random.Philox(key=77))
    truth = constant(*COVERAGE_TRUTH, trials)
    measured = truth + np.array(COVERAGE_ERROR) * rng.standard_normal(truth.shape)
    first, second, third = (stated * error for error in COVERAGE_ERROR)
    result = estimate(
        measured, (first, second, third), wavelength_nm=np.linspace(400.0, 700.0, trials)
    )
    found = predict(medium_of(result, count=60), Slab(0.6, 1.5, 0.5))
    low, high = found.interval(0.9)
    true = reflectance_45_0(truth[:1], 0.6, 1.5, 0.5)[0]
    return float(((true >= low) & (true <= high)).mean())


def test_intervals_cover_as_often_as_they_say() -> None:
    """200 estimates of one material; 90 % within four binomial standard deviations."""
    assert _coverage(1.0) == pytest.approx(0.9, abs=4 * np.sqrt(0.9 * 0.1 / TRIALS))


def test_the_coverage_test_notices_noise_understated_by_two() -> None:
    assert _coverage(0.5) < 0.9 - 4 * np.sqrt(0.9 * 0.1 / TRIALS)


def _prediction(draws: FloatArray) -> Prediction:
    nothing = np.zeros(draws.shape[1])
    return Prediction("m", Slab(1.0), WAVELENGTH, draws.mean(axis=0), draws, nothing, False)


def test_couplings_keep_every_wavelength_and_bound_weighted_sums() -> None:
    rng = np.random.Generator(np.random.Philox(key=12))
    shared = rng.standard_normal((500, 1))
    draws = 0.5 + 0.02 * shared + 0.02 * rng.standard_normal((500, len(WAVELENGTH)))
    prediction = _prediction(draws)
    couplings = prediction.couplings()
    assert set(couplings) == {"independent", "common"}
    for coupled in couplings.values():
        assert np.array_equal(np.sort(coupled, axis=0), np.sort(draws, axis=0))
    weights = np.array([1, 2, 5, 8, 5, 2, 1.0])
    spread = {how: (coupled @ weights).std() for how, coupled in couplings.items()}
    assert spread["independent"] < (draws @ weights).std() < spread["common"]


@pytest.mark.parametrize(
    ("make", "found"),
    [
        (lambda: Slab(0.0), "thickness of 0 mm"),
        (lambda: Slab(float("nan")), "thickness of nan"),
        (lambda: predict(exact(constant(0.5, 1, 0)), Slab(1), engine="magic"), "engine"),
        (
            lambda: predict(exact(constant(0.5, 1, 0)), Slab(np.inf), engine="monte-carlo"),
            "infinite thickness",
        ),
        (lambda: predict(exact(constant(0.5, 1, 0)), Slab(1, 1.5, "velvet")), "velvet"),
        (lambda: predict(exact(constant(0.5, 1, 0)), Slab(1, 1.5, 1.5)), "reflectance"),
        (lambda: _prediction(np.ones((4, 7))).interval(1.0), "coverage of 1"),
    ],
)
def test_wrong_input_gets_one_message(make: object, found: str) -> None:
    with pytest.raises(InputError, match=found):
        make()  # type: ignore[operator]
