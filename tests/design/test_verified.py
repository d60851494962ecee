"""What is made of simulated visits: ratios, their errors, and the Monte Carlo's share."""

from __future__ import annotations

import numpy as np
import pytest

from scenarios.design.candidate import Candidate
from scenarios.design.verify import Verified

VISITS, WAVELENGTHS = 64, 12


def _verified(random: np.random.Generator, *, common: bool) -> Verified:
    shape = (1, VISITS, 1 if common else WAVELENGTHS, 3)
    error = np.broadcast_to(random.standard_normal(shape), (1, VISITS, WAVELENGTHS, 3))
    one = np.ones((1, WAVELENGTHS, 3))
    return Verified(Candidate(()), one, error, np.ones_like(error), own=0.5 * one)


@pytest.mark.parametrize("common", [False, True])
def test_error_of_a_ratio_is_the_scatter_of_ratios(common: bool) -> None:
    random = np.random.Generator(np.random.Philox(key=4))
    found = [_verified(random, common=common) for _ in range(200)]
    scatter = np.array([each.ratio for each in found]).std()
    stated = np.mean([each.ratio_error for each in found])
    # Wavelengths by themselves are counted twice, by visits and by wavelengths: at most sqrt(2).
    assert 0.9 * scatter < stated < 1.55 * scatter
    # Control: as if every wavelength told something of its own.
    alone = 1.0 / np.sqrt(2 * VISITS * WAVELENGTHS)
    assert (alone < 0.5 * scatter) == common


def test_actual_error_is_that_of_the_bench_and_not_of_the_paths() -> None:
    each = _verified(np.random.Generator(np.random.Philox(key=5)), common=False)
    np.testing.assert_allclose(each.actual, 0.5 * each.ratio)


def test_bands_join_the_prediction_and_leave_the_stated_width_alone() -> None:
    shape = (1, VISITS, WAVELENGTHS, 3)
    random = np.random.Generator(np.random.Philox(key=6))
    one, bias = np.ones((1, WAVELENGTHS, 3)), -np.sqrt(3.0) * np.ones((1, WAVELENGTHS, 3))
    error = bias[:, None] + random.standard_normal(shape)
    found = Verified(Candidate(()), one, error, np.ones(shape), bands=bias)
    np.testing.assert_allclose(found.expected, 2.0)
    assert np.all(np.abs(found.ratio - 1.0) < 0.1)
    assert found.agrees
    np.testing.assert_allclose(found.bias, np.sqrt(0.75), atol=0.05)
    np.testing.assert_allclose(found.width_ratio, 1.0)
    # Control: a prediction that leaves the bands out does not agree.
    without = Verified(Candidate(()), one, error, np.ones(shape))
    assert np.all(without.ratio > 1.8)
    assert not without.agrees


def test_a_figure_is_that_of_the_worst_material_without_the_share_of_the_paths() -> None:
    error = np.array([1.0, 3.0])[:, None, None, None] * np.ones((2, VISITS, WAVELENGTHS, 3))
    error = error * np.resize([1.0, -1.0], (1, VISITS, 1, 1))
    one = np.ones((2, WAVELENGTHS, 3))
    found = Verified(Candidate(()), one, error, np.ones_like(error), own=0.5 * one)
    value, spread = found.figure(1, np.array([[1.0], [6.0]]) * np.ones((2, WAVELENGTHS)))
    # the second is 3 / 6, the first 1 / 1, and half of that is the bench's
    assert value == pytest.approx(0.5)
    assert spread == pytest.approx(0.0)
