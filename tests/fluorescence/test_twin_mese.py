"""Bounded MESE: worked cases, a closed form, invariances, gradients, and the silent failures."""

from __future__ import annotations

import json
from pathlib import Path

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from twin.errors import InputError
from twin.fluorescence import mese

spectra = arrays(np.float64, 31, elements=st.floats(0.01, 0.99))
SLOPES = jax.jit(jax.jacfwd(lambda x: mese.reconstruct(x).value))
few = settings(max_examples=20, deadline=None, derandomize=True)


def test_three_worked_cases_to_1e_6(shared_data: Path):
    reference = shared_data / "fluorescence" / "mese_reference.json"
    if not reference.is_file():
        pytest.skip("the worked cases (fluorescence/mese_reference.json) are absent")
    worked = json.loads(reference.read_text())["cases"]
    assert len(worked) == 3
    for case in worked.values():
        c = np.asarray(mese.moments(np.array(case["diag"]), 9, eps=0.0))
        np.testing.assert_allclose(c, case["c"], atol=1e-9)
        gamma = np.asarray(mese.exponential_moments(c))
        np.testing.assert_allclose(gamma.real, case["g_re"], atol=1e-9)
        np.testing.assert_allclose(gamma.imag, case["g_im"], atol=1e-9)
        np.testing.assert_allclose(mese.multipliers(c).value, case["lam_re"], atol=1e-6)
        found = mese.reconstruct(c)
        assert bool(found.valid)
        np.testing.assert_allclose(found.value, case["recon"], atol=1e-6)


def test_moments_of_a_half_bright_spectrum_in_closed_form():
    # g = (1 + cos phi) / 2: c_0 = 1/2, c_1 = 1/4, all others 0, up to the linear samples.
    wavelength = np.linspace(400.0, 700.0, 3001)
    value = 0.5 * (1.0 + np.cos(mese.phase(wavelength)))
    c = np.asarray(mese.moments(value, 5, wavelength_nm=wavelength, eps=0.0))
    np.testing.assert_allclose(c, [0.5, 0.25, 0.0, 0.0, 0.0], atol=2e-7)


def test_one_moment_and_two_moments_in_closed_form():
    # One moment: the constant. Two: gamma_1 = 2 pi i gamma_0 c_1, solved by hand for c_0 = 1/2:
    # T = [[a, -i b], [i b, a]], a = 1 / (4 pi^2), b = c_1 / (4 pi).
    assert np.asarray(mese.reconstruct(np.array([0.3])).value) == pytest.approx(0.3)
    c_1 = 0.1
    a, b = 1.0 / (4.0 * np.pi**2), c_1 / (4.0 * np.pi)
    q = np.array([a, -1j * b]) / (a**2 - b**2)
    r_0, r_1 = abs(q[0]) ** 2 + abs(q[1]) ** 2, np.conj(q[1]) * q[0]
    gamma = np.array([1.0 / (4.0 * np.pi), 2j * np.pi * c_1 / (4.0 * np.pi)])
    below = 1j * np.pi * q[0]
    by_hand = [(gamma[0] * r_0 + gamma[1] * r_1) / below, gamma[0] * r_1 / below]
    found = mese.multipliers(np.array([0.5, c_1]))
    np.testing.assert_allclose(found.value, np.real(by_hand), atol=1e-12)
    assert found.value[1] > 0.0  # bright where phi = 0: the long end


@few
@given(spectra)
def test_any_spectrum_comes_back_inside_0_and_1(spectrum):
    found = mese.reconstruct(mese.moments(spectrum))
    assert bool(found.valid)
    assert np.all((np.asarray(found.value) > 0.0) & (np.asarray(found.value) < 1.0))


@few
@given(spectra)
def test_the_complement_has_the_complementary_estimate(spectrum):
    direct = mese.reconstruct(mese.moments(spectrum)).value
    other = mese.reconstruct(mese.moments(1.0 - spectrum)).value
    np.testing.assert_allclose(np.asarray(direct) + np.asarray(other), 1.0, atol=1e-8)


@few
@given(spectra)
def test_the_mirrored_spectrum_has_the_mirrored_estimate(spectrum):
    direct = mese.reconstruct(mese.moments(spectrum)).value
    other = mese.reconstruct(mese.moments(spectrum[::-1])).value
    np.testing.assert_allclose(np.asarray(direct)[::-1], other, atol=1e-8)


@few
@given(arrays(np.float64, 6, elements=st.floats(-1.0, 1.0)))
def test_any_multipliers_are_the_estimate_of_their_own_moments(multiplier):
    # What lets a fit move the multipliers freely: the map to valid moments is one to one.
    wavelength = np.linspace(400.0, 700.0, 1501)
    curve = mese.signal(multiplier, wavelength)
    c = mese.moments(curve, 6, wavelength_nm=wavelength, eps=0.0)
    back = mese.multipliers(c)
    assert bool(back.valid)
    assert np.max(np.abs(mese.signal(back.value, wavelength) - curve)) < 2e-4


def test_batches_jit_and_vmap_agree_with_single_spectra():
    generator = np.random.Generator(np.random.Philox(key=4))
    batch = generator.uniform(0.05, 0.95, (5, 31))
    c = mese.moments(batch)
    assert c.shape == (5, 8)
    assert c.dtype == np.float64
    together = mese.reconstruct(c).value
    compiled = jax.jit(jax.vmap(lambda each: mese.reconstruct(each).value))(c)
    np.testing.assert_allclose(together, compiled, atol=1e-12)
    np.testing.assert_allclose(together[3], mese.reconstruct(c[3]).value, atol=1e-12)


def test_gradients_equal_finite_differences():
    c = mese.moments(np.linspace(0.1, 0.8, 31) ** 2)
    slopes = np.asarray(SLOPES(c))
    backward = jax.jit(jax.grad(lambda x: mese.reconstruct(x).value[7]))(c)
    np.testing.assert_allclose(slopes[7], backward, atol=1e-8)
    for index in range(8):
        step = np.zeros(8)
        step[index] = 1e-6
        up, down = mese.reconstruct(c + step).value, mese.reconstruct(c - step).value
        numeric = np.asarray(up - down) / 2e-6
        np.testing.assert_allclose(slopes[:, index], numeric, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("level", [-0.01, 0.0, 1.0, 1.01])
def test_constants_at_and_beyond_the_ends_are_called_invalid_or_clamped(level):
    # Without the guard, -0.01 comes back as 0.99, and 1 divides by zero.
    raw = mese.reconstruct(mese.moments(np.full(31, level), eps=0.0))
    assert not bool(raw.valid)
    assert np.all(np.isnan(raw.value))
    guarded = mese.reconstruct(mese.moments(np.full(31, level)))
    assert bool(guarded.valid)
    expected = mese.EPS if level < 0.5 else 1.0 - mese.EPS
    np.testing.assert_allclose(guarded.value, expected, atol=1e-9)
    assert mese.clamped(np.full(31, level)) == 31


def test_moments_of_no_spectrum_are_invalid_by_their_reflection_coefficients():
    found = mese.multipliers(np.array([0.5, 0.33]))  # |c_1| <= 1 / pi for any spectrum
    assert not bool(found.valid)
    assert np.max(np.abs(found.reflection)) >= 1.0
    assert bool(mese.multipliers(np.array([0.5, 0.31])).valid)
    assert not bool(mese.reconstruct(np.array([np.nan, 0.1])).valid)


def test_an_invalid_row_leaves_the_gradient_of_the_others_alone():
    rows = np.array([[0.5, 0.1], [0.5, 0.4]])
    slopes = jax.jit(jax.grad(lambda x: mese.reconstruct(x).value[0].sum()))(rows)
    assert np.all(np.isfinite(slopes))
    assert np.abs(slopes[0]).sum() > 0.0


def test_wrong_wavelengths_counts_and_shapes_are_refused():
    with pytest.raises(InputError, match="both included"):
        mese.moment_matrix(8, np.linspace(410.0, 700.0, 30))
    with pytest.raises(InputError, match="1 to 32"):
        mese.moment_matrix(0)
    with pytest.raises(InputError, match="31 samples"):
        mese.moments(np.zeros(30))
    with pytest.raises(InputError, match="400 to 700"):
        mese.reconstruct(np.array([0.5]), [399.0])
