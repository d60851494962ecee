"""The sampler, the coordinates and the box against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimators.posterior_box import Box
from estimators.posterior_coordinates import Coordinates, coarse, random_state, wavelength_stream
from estimators.posterior_sampler import Student, autocorrelation_time, sample
from estimators.posterior_settings import PosteriorSettings
from tests.estimators.posterior_problems import random_of
from twin.errors import InputError

DESIGN = np.array([[1.0, 0.2, 0.0], [0.3, 2.0, -0.5], [0.0, 0.7, 1.5], [1.0, 1.0, 1.0]])
MEASURED = np.array([0.5, -1.0, 0.3, 0.8])


def _linear_gaussian():
    """Posterior of x under data = DESIGN x + unit noise and a unit normal prior."""
    covariance = np.linalg.inv(DESIGN.T @ DESIGN + np.eye(3))
    return covariance @ DESIGN.T @ MEASURED, covariance


def _log_probability(x):
    residual = x @ DESIGN.T - MEASURED
    return -0.5 * (residual**2).sum(axis=1) - 0.5 * (x**2).sum(axis=1)


@pytest.mark.parametrize("independent", [False, True])
def test_linear_gaussian_toy_gives_the_closed_form(independent):
    mean, covariance = _linear_gaussian()
    proposal = Student.normal(mean + 0.3, 1.5 * covariance) if independent else None
    chain = sample(
        _log_probability,
        random_of(5, 1).standard_normal((32, 3)),
        random_state(random_of(5, 2)),
        proposal=proposal,
        effective_samples=6000,
    )
    assert chain.converged
    size = chain.effective_sample_size
    assert size >= 6000
    flat = chain.values.reshape(-1, 3)
    sigma = np.sqrt(np.diagonal(covariance))
    z = (flat.mean(axis=0) - mean) / (sigma / np.sqrt(size))
    assert np.abs(z).max() < 4.5
    ratio = flat.var(axis=0) / sigma**2
    assert np.abs(ratio - 1.0).max() < 4.5 * np.sqrt(2.0 / size)
    # the check can fail: it tells a posterior that is a tenth too narrow
    assert np.abs(ratio - 0.9**2).max() > 4.5 * np.sqrt(2.0 / size)


def test_autocorrelation_time_of_an_autoregression_and_of_emcee():
    import emcee

    rho, steps, walkers = 0.8, 6000, 16
    random = random_of(6, 1)
    noise = random.standard_normal((steps, walkers, 1)) * np.sqrt(1 - rho**2)
    values = np.empty_like(noise)
    values[0] = random.standard_normal((walkers, 1))
    for k in range(1, steps):
        values[k] = rho * values[k - 1] + noise[k]
    found = autocorrelation_time(values)
    assert found == pytest.approx((1 + rho) / (1 - rho), rel=0.1)
    assert found == pytest.approx(float(emcee.autocorr.integrated_time(values)[0]), rel=0.03)


def test_a_short_chain_is_not_converged():
    chain = sample(
        _log_probability,
        random_of(5, 1).standard_normal((32, 3)),
        random_state(random_of(5, 2)),
        effective_samples=6000,
        steps=60,
    )
    assert not chain.converged


@given(
    albedo=st.floats(0.001, 0.999),
    sigma_t=st.floats(0.02, 90.0),
    g=st.floats(-0.19, 0.98),
)
@settings(deadline=None, derandomize=True, max_examples=40)
def test_coordinates_come_back_and_know_their_slopes(albedo, sigma_t, g):
    coordinates = Coordinates.of(PosteriorSettings())
    material = np.array([albedo, sigma_t, g])
    y = coordinates.of_material(material)
    assert np.allclose(coordinates.material(y), material, rtol=1e-9)
    step = 1e-5 * np.eye(3)
    numeric = (coordinates.material(y + step) - coordinates.material(y - step)) / 2e-5
    assert np.allclose(coordinates.slopes(y), numeric.T, rtol=1e-5, atol=1e-7)
    gradient = (coordinates.log_prior(y + step) - coordinates.log_prior(y - step)) / 2e-5
    assert np.allclose(coordinates.prior_gradient(y), gradient, atol=1e-6)


def test_the_prior_in_the_coordinates_is_uniform_in_the_parameters():
    """Draws from the prior alone: albedo, ln sigma_t and g uniform (Kolmogorov and Smirnov)."""
    from scipy.stats import kstest

    coordinates = Coordinates.of(PosteriorSettings())
    chain = sample(
        coordinates.log_prior,
        random_of(7, 1).standard_normal((32, 3)),
        random_state(random_of(7, 2)),
        proposal=Student.normal(np.zeros(3), 4.0 * np.eye(3)),
        effective_samples=8000,
    )
    every = int(np.ceil(2 * chain.autocorrelation_time))
    share = coordinates.share(chain.values[::every].reshape(-1, 3))
    for column in range(3):
        assert kstest(share[:, column], "uniform").pvalue > 1e-3
    assert kstest(share[:, 0] ** 1.2, "uniform").pvalue < 1e-3


def test_a_bent_box_holds_a_curved_sheet():
    random = random_of(8, 1)
    t = random.standard_normal((2000, 3)) * np.array([0.01, 1.0, 1.0])
    y = t.copy()
    y[:, 0] += 0.3 * t[:, 1] ** 2 - 0.1 * t[:, 1] * t[:, 2]
    box = Box.around(y, np.zeros((2, 3), dtype=bool))
    inside = box.t(y)
    assert np.allclose(box.y(inside), y)
    assert box.inside(inside).all()
    assert box.axes[0, 0] < 0.1 * y[:, 0].std()
    straight = Box.around(y[:150], np.zeros((2, 3), dtype=bool))
    assert abs(np.linalg.det(box.axes)) < 0.1 * abs(np.linalg.det(straight.axes))


def test_streams_belong_to_the_wavelength_and_the_purpose():
    first = wavelength_stream(3, 550.0, 1).random(4)
    assert np.array_equal(first, wavelength_stream(3, 550.0, 1).random(4))
    for other in (
        wavelength_stream(4, 550.0, 1),
        wavelength_stream(3, 551.0, 1),
        wavelength_stream(3, 550.0, 2),
    ):
        assert not np.array_equal(first, other.random(4))


def test_coarse_numbers_forget_their_last_bits():
    values = random_of(9, 1).standard_normal(1000)
    assert np.array_equal(coarse(values), coarse(values * (1 + 2**-50)))
    assert np.allclose(coarse(values), values, rtol=2.0**-12)


@pytest.mark.parametrize(
    "option",
    [
        {"sigma_t_low_per_mm": 0.0},
        {"g_low": 0.5, "g_high": 0.4},
        {"thickness_relative": -0.1},
        {"walkers": 21},
        {"steps": 5},
        {"seed": -1},
        {"joint": True, "sample_nuisances": True, "n_sigma": 0.01},
    ],
)
def test_options_out_of_range_are_refused(option):
    with pytest.raises(InputError):
        PosteriorSettings(**option)
