from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from estimators.draws import (
    Cloud,
    bent_back,
    disagreement,
    gaussian_draws,
    straightened,
    summarise,
    weighted,
)
from estimators.result import QUANTILE_LEVELS
from tests.estimators.visits import generator
from twin.errors import InputError
from twin.spectra import FloatArray

COVARIANCE = np.array([[4.0, 1.2, 0.0], [1.2, 1.0, -0.3], [0.0, -0.3, 0.5]])


def clouds_at(centre: FloatArray, key: int, count: int = 400) -> FloatArray:
    """Draws around random measurements of `centre`, shape (count, 2000, 3)."""
    random = generator(key)
    factor = np.linalg.cholesky(COVARIANCE)
    measured = centre + random.standard_normal((count, 1, 3)) @ factor.T
    return np.asarray(measured + random.standard_normal((count, 2000, 3)) @ factor.T)


def test_gaussian_draws_have_the_stated_covariance() -> None:
    draws = gaussian_draws(np.tile(COVARIANCE, (50, 1, 1)), 400, 1, 0).reshape(-1, 3)
    squares = np.einsum("di,ij,dj->d", draws, np.linalg.inv(COVARIANCE), draws)
    # Chi-square test of the squared distances in twenty equally likely bins.
    edges = chi2.ppf(np.linspace(0, 1, 21), 3)
    counted = np.histogram(squares, edges)[0]
    statistic = ((counted - 1000.0) ** 2 / 1000.0).sum()
    assert statistic < chi2.ppf(0.9999, 19)
    halved = np.histogram(squares * 4, edges)[0]
    assert ((halved - 1000.0) ** 2 / 1000.0).sum() > chi2.ppf(0.9999, 19)


def test_draws_of_a_wavelength_do_not_depend_on_the_block() -> None:
    whole = gaussian_draws(np.tile(COVARIANCE, (9, 1, 1)), 50, 1, 0)
    part = gaussian_draws(np.tile(COVARIANCE, (4, 1, 1)), 50, 1, 5)
    assert np.array_equal(whole[5:], part)
    assert not np.array_equal(whole[0], whole[1])


def test_fully_correlated_captures_can_be_drawn() -> None:
    draws = gaussian_draws(np.ones((1, 3, 3)), 100, 1, 0)
    np.testing.assert_allclose(draws[0, :, 0], draws[0, :, 2], atol=1e-3)


def test_an_impossible_covariance_is_refused() -> None:
    with pytest.raises(InputError, match="eigenvalue"):
        gaussian_draws(np.array([[[1.0, 2.0], [2.0, 1.0]]]), 10, 1, 0)


def test_quantiles_are_those_of_numpy() -> None:
    estimates = generator(2).standard_normal((3, 101, 3))
    kept = generator(3).uniform(0, 1, (3, 101)) < 0.7
    cloud = summarise(estimates, kept)
    for w in range(3):
        expected = np.quantile(estimates[w, kept[w]], QUANTILE_LEVELS, axis=0)
        np.testing.assert_allclose(cloud.quantile[:, w], expected, rtol=1e-12)


def test_a_few_wild_draws_do_not_move_the_covariance() -> None:
    estimates = generator(4).standard_normal((1, 4000, 3)) @ np.linalg.cholesky(COVARIANCE).T
    kept = np.ones((1, 4000), dtype=bool)
    calm = summarise(estimates, kept).covariance
    estimates[0, :40] += 1e6
    wild = summarise(estimates, kept).covariance
    np.testing.assert_allclose(calm[0], COVARIANCE, rtol=0.12, atol=0.1)
    np.testing.assert_allclose(wild[0], COVARIANCE, rtol=0.2, atol=0.15)


def test_too_few_draws_say_nothing() -> None:
    kept = np.zeros((1, 100), dtype=bool)
    kept[0, :10] = True
    assert np.isnan(summarise(np.zeros((1, 100, 3)), kept).quantile).all()


def test_weighting_halves_the_variance_of_two_equal_samples() -> None:
    estimates = np.stack([clouds_at(np.zeros(3), 5), clouds_at(np.zeros(3), 6)])
    kept = np.ones(estimates.shape[:3], dtype=bool)
    clouds = [summarise(one, kept[0]) for one in estimates]
    joint, together = weighted(estimates, kept, clouds)
    assert together.all()
    covariance = summarise(joint, together).covariance.mean(axis=0)
    np.testing.assert_allclose(covariance, COVARIANCE / 2, atol=0.1)


def test_disagreement_speaks_up_once_in_a_thousand_and_when_it_should() -> None:
    estimates = [clouds_at(np.zeros(3), 7), clouds_at(np.zeros(3), 8)]
    moved = [estimates[0], estimates[1] + np.array([0.0, 0.0, 6.0])]
    verdicts = []
    for pair in (estimates, moved):
        kept = np.ones(pair[0].shape[:2], dtype=bool)
        clouds: list[Cloud] = [summarise(one, kept) for one in pair]
        centre = 0.5 * (clouds[0].median + clouds[1].median)
        factor, torn = disagreement(clouds, centre, 3)
        assert (factor[~torn] == 1.0).all()
        verdicts.append(torn.mean())
    assert verdicts[0] < 0.01
    assert verdicts[1] > 0.9


@given(st.floats(0, 1), st.floats(0.001, 100), st.floats(-0.99, 0.99))
def test_straightening_can_be_undone(albedo: float, sigma_t: float, g: float) -> None:
    parameters = np.array([albedo, sigma_t, g])
    np.testing.assert_allclose(bent_back(straightened(parameters)), parameters, atol=1e-9)
