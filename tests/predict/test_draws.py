"""Draws behind an estimate: where they come from, and that they are what they claim."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimators import Status
from scenarios.predict import medium_of
from scenarios.predict.draws import HIGHEST, LOWEST, bounded_draws
from tests.predict.estimates import WAVELENGTH, constant, estimate
from twin.errors import InputError


def generator(key: int = 1) -> np.random.Generator:
    return np.random.Generator(np.random.Philox(key=key))


def test_far_from_the_bounds_the_draws_have_the_stated_covariance() -> None:
    covariance = np.array([[4e-4, 1e-3, 0], [1e-3, 1e-2, -1e-3], [0, -1e-3, 9e-4]])
    drawn, short = bounded_draws(generator(), np.array([[0.5, 3.0, 0.2]]), covariance[None], 40_000)
    assert short == 0
    np.testing.assert_allclose(drawn[:, 0].mean(axis=0), [0.5, 3.0, 0.2], atol=2.5e-3)
    found = np.cov(drawn[:, 0].T)
    scale = np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    np.testing.assert_allclose(found / scale, covariance / scale, atol=0.03)


@given(
    st.tuples(st.floats(0, 1), st.floats(0, 30), st.floats(-0.9, 0.9)),
    st.tuples(st.floats(0, 1e3), st.floats(0, 1e3), st.floats(0, 1e3)),
)
def test_no_draw_leaves_the_physical_bounds(
    mean: tuple[float, float, float], error: tuple[float, float, float]
) -> None:
    drawn, _ = bounded_draws(generator(), np.array([mean]), np.diag(np.square(error))[None], 50)
    assert np.isfinite(drawn).all()
    assert ((drawn >= LOWEST) & (drawn <= HIGHEST)).all()


def test_a_half_normal_at_the_bound_has_its_mean() -> None:
    """Mean of |N(0, s)| is s sqrt(2 / pi)."""
    drawn, _ = bounded_draws(
        generator(), np.array([[1.0, 3.0, 0.0]]), np.diag([1e-4, 1e-4, 1e-4])[None], 40_000
    )
    assert 1 - drawn[:, 0, 0].mean() == pytest.approx(0.01 * np.sqrt(2 / np.pi), rel=0.02)


def test_stated_quantiles_and_correlations_are_kept() -> None:
    """A skewed albedo that a normal distribution would miss, tied to g."""
    level = np.array([0.005, 0.05, 0.25, 0.5, 0.75, 0.95, 0.995])
    albedo = np.array([0.02, 0.05, 0.1, 0.2, 0.45, 0.65, 0.7])
    stated = np.stack([albedo, 3 + 0 * albedo, np.linspace(-0.2, 0.8, 7)], -1)[:, None]
    covariance = np.diag([0.04, 0.0, 0.09])
    covariance[0, 2] = covariance[2, 0] = 0.9 * 0.2 * 0.3
    mean = np.array([[0.2, 3.0, 0.3]])
    drawn, short = bounded_draws(generator(), mean, covariance[None], 20_000, stated, level)
    assert short == 0
    np.testing.assert_allclose(np.quantile(drawn[:, 0, 0], level[1:-1]), albedo[1:-1], atol=0.01)
    assert np.all(drawn[:, 0, 1] == 3.0)
    rank = drawn[:, 0].argsort(axis=0).argsort(axis=0)
    # of a normal copula: Spearman's rho is 6 / pi asin(r / 2)
    expected = 6 / np.pi * np.arcsin(0.9 / 2)
    assert np.corrcoef(rank[:, 0], rank[:, 2])[0, 1] == pytest.approx(expected, abs=0.01)
    plain, _ = bounded_draws(generator(), mean, covariance[None], 20_000)
    assert abs(np.quantile(plain[:, 0, 0], 0.75) - 0.45) > 0.05


def test_wavelengths_without_a_value_are_left_out_and_counted() -> None:
    status = np.full(len(WAVELENGTH), Status.OK)
    status[1], status[4] = Status.OUTSIDE_MAP, Status.MASKED
    properties = constant(0.5, 2.0, 0.1)
    properties[5, 2] = np.nan
    medium = medium_of(estimate(properties, status=status))
    assert np.flatnonzero(~medium.known).tolist() == [1, 4, 5]
    assert np.isnan(medium.draws[:, [1, 4, 5]]).all()
    assert np.isfinite(medium.draws[:, medium.known]).all()
    (note,) = medium.notes
    assert "3 of 7 wavelengths" in note
    assert "1 outside_map" in note
    assert "1 masked" in note


def test_what_the_captures_do_not_determine_is_said() -> None:
    result = estimate(constant(0.5, 2.0, 0.1))
    assert medium_of(result).notes == ()
    result.identifiable[2:4, 2] = False
    (note,) = medium_of(result).notes
    assert note.startswith("at 2 of 7 wavelengths the captures do not determine")


def test_an_estimate_without_any_value_is_refused() -> None:
    nothing = np.full((len(WAVELENGTH), 3), np.nan)
    with pytest.raises(InputError, match="at any of its 7 wavelengths"):
        medium_of(estimate(nothing))


def test_posterior_draws_are_used_as_they_are() -> None:
    rng = generator(8)
    common = rng.standard_normal((300, 1, 1)) * [0.01, 0.05, 0.02]
    posterior = constant(0.5, 2.0, 0.1) + np.broadcast_to(common, (300, len(WAVELENGTH), 3))
    medium = medium_of(estimate(constant(0.5, 2.0, 0.1), draws=posterior), count=100)
    assert medium.ordered
    assert medium.draws.shape == (100, len(WAVELENGTH), 3)
    assert np.array_equal(medium.draws[0], posterior[0])
    assert np.array_equal(medium.draws[-1], posterior[-1])


def test_a_posterior_of_single_wavelengths_is_recognised() -> None:
    noise = generator(9).standard_normal((300, len(WAVELENGTH), 3)) * 0.01
    medium = medium_of(estimate(constant(0.5, 2.0, 0.1), draws=constant(0.5, 2.0, 0.1) + noise))
    assert not medium.ordered
    assert "for each wavelength alone" in medium.notes[0]


def test_same_seed_same_draws_other_seed_others() -> None:
    result = estimate(constant(0.5, 2.0, 0.1))
    one, again, other = (medium_of(result, seed=seed).draws for seed in (1, 1, 2))
    assert np.array_equal(one, again)
    assert not np.array_equal(one, other)
