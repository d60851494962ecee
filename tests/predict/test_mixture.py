"""Mixtures: identities that follow from adding coefficients by volume."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.predict import UncertainMedium, mix_media, mix_properties
from tests.predict.estimates import WAVELENGTH, constant, exact
from twin.errors import InputError
from twin.materials import material, optical_properties
from twin.spectra import FloatArray

Triple = tuple[float, float, float]
triples = st.tuples(st.floats(0, 1), st.floats(0, 50), st.floats(-0.95, 0.95))
shares = st.floats(0, 1)


def one(triple: Triple) -> FloatArray:
    return np.array([triple])


def coefficients(properties: FloatArray) -> FloatArray:
    """Absorption, scattering and scattering times g, which are what adds."""
    albedo, sigma_t, g = properties[0]
    return np.array([(1 - albedo) * sigma_t, albedo * sigma_t, albedo * sigma_t * g])


@given(triples, shares)
def test_a_material_mixed_with_itself_is_itself(triple: Triple, share: float) -> None:
    mixed = mix_properties([one(triple), one(triple)], [share, 1 - share])
    np.testing.assert_allclose(
        coefficients(mixed), coefficients(one(triple)), rtol=1e-9, atol=1e-12
    )


@given(triples, triples)
def test_all_of_one_and_nothing_of_the_other_is_the_one_to_the_bit(a: Triple, b: Triple) -> None:
    assert np.array_equal(mix_properties([one(a), one(b)], [1, 0]), one(a))
    assert np.array_equal(mix_properties([one(a), np.full((1, 3), np.nan)], [1, 0]), one(a))


@given(triples, triples, shares)
def test_the_order_does_not_matter(a: Triple, b: Triple, share: float) -> None:
    ab = mix_properties([one(a), one(b)], [share, 1 - share])
    ba = mix_properties([one(b), one(a)], [1 - share, share])
    np.testing.assert_allclose(ab, ba, rtol=1e-9, atol=1e-12)


@given(triples, triples, triples, shares, shares)
def test_mixing_in_two_steps_is_mixing_at_once(
    a: Triple, b: Triple, c: Triple, share: float, inner: float
) -> None:
    first = mix_properties([one(a), one(b)], [inner, 1 - inner])
    two = mix_properties([first, one(c)], [share, 1 - share])
    at_once = mix_properties(
        [one(a), one(b), one(c)], [share * inner, share * (1 - inner), 1 - share]
    )
    np.testing.assert_allclose(coefficients(two), coefficients(at_once), rtol=1e-9, atol=1e-9)


@given(triples, triples, shares)
def test_coefficients_add_by_volume(a: Triple, b: Triple, share: float) -> None:
    mixed = mix_properties([one(a), one(b)], [share, 1 - share])
    added = share * coefficients(one(a)) + (1 - share) * coefficients(one(b))
    np.testing.assert_allclose(coefficients(mixed), added, rtol=1e-9, atol=1e-12)


def test_the_rule_is_that_of_the_library() -> None:
    """Intralipid diluted with water, mixed here and by `twin.materials`."""
    wavelength = np.arange(450.0, 651.0, 50.0)
    parts = []
    for name in ("intralipid_20", "water"):
        found = optical_properties(name, wavelength)
        parts.append(np.stack([found.albedo, found.sigma_t_per_mm, found.g], -1))
    mixed = mix_properties(parts, [0.1, 0.9])
    own = material("intralipid_20(10%)").at(wavelength)
    np.testing.assert_allclose(mixed[:, 1], own.sigma_a_per_mm + own.sigma_s_per_mm, rtol=1e-12)
    np.testing.assert_allclose(mixed[:, 2], own.g, rtol=1e-12)


def test_draws_of_different_media_are_independent_and_of_the_same_one_not() -> None:
    rng = np.random.Generator(np.random.Philox(key=5))
    value = constant(0.5, 2.0, 0.0)

    def medium() -> UncertainMedium:
        draws = value + [0, 0.1, 0] * rng.standard_normal((4000, len(value), 3))
        return UncertainMedium("m", WAVELENGTH, value, draws, False)

    first, second = medium(), medium()
    apart = mix_media([first, second], [0.5, 0.5]).draws[..., 1].std()
    same = mix_media([first, first], [0.5, 0.5]).draws[..., 1].std()
    assert apart == pytest.approx(0.1 / np.sqrt(2), rel=0.03)
    assert same == pytest.approx(0.1, rel=0.03)


def test_other_wavelengths_are_interpolated_in_the_coefficients_and_said() -> None:
    fine = np.arange(420.0, 741.0, 20.0)
    other = exact(constant(0.25, 4.0, 0.5, len(fine)), fine)
    mixed = mix_media([exact(constant(0.75, 2.0, 0.1)), other], [0.5, 0.5])
    assert mixed.wavelength_nm.tolist() == [450.0, 500.0, 550.0, 600.0, 650.0, 700.0]
    np.testing.assert_allclose(mixed.value[:, 1], 3.0)
    assert "450 to 700 nm" in mixed.notes[0]


def test_a_wavelength_unknown_in_one_part_is_unknown_in_the_mixture() -> None:
    holed = constant(0.5, 2.0, 0.0)
    holed[2] = np.nan
    mixed = mix_media([exact(holed), exact(constant(0.1, 1.0, 0.0))], [0.5, 0.5])
    assert mixed.known.tolist() == [True, True, False, True, True, True, True]
    # interpolation does not reach over the hole either
    fine = np.arange(400.0, 701.0, 25.0)
    on_fine = mix_media([exact(constant(0.1, 1, 0, len(fine)), fine), exact(holed)], [0.5, 0.5])
    assert np.flatnonzero(~on_fine.known).tolist() == [3, 4, 5]


@pytest.mark.parametrize(
    ("fractions", "found"),
    [
        ([0.5, 0.4], "add up to 0.9"),
        ([1.5, -0.5], "fraction of 1.5"),
        ([0.5], "1 fractions for 2 media"),
        ([float("nan"), 1.0], "fraction of nan"),
    ],
)
def test_wrong_fractions_are_refused(fractions: list[float], found: str) -> None:
    with pytest.raises(InputError, match=found):
        mix_media([exact(constant(0.5, 1, 0))] * 2, fractions)


def test_media_without_common_wavelengths_are_refused() -> None:
    far = exact(constant(0.5, 1, 0), WAVELENGTH + 1000)
    with pytest.raises(InputError, match="no common wavelengths"):
        mix_media([exact(constant(0.5, 1, 0)), far], [0.5, 0.5])
