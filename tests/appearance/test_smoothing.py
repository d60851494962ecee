"""Local regression and interpolation of map axes: exact cases, errors, and what is left alone."""

from __future__ import annotations

import numpy as np
import pytest

from twin.appearance.smoothing import (
    WINDOW,
    fine_enough,
    interpolated,
    refined_axis,
    smoothed,
    smoothed_error,
    smoothing_matrix,
)

SIGMA = np.geomspace(0.05, 50.0, 60)
STEP = float(np.log(SIGMA[1] / SIGMA[0]))


def test_the_weights_reproduce_parabolas_and_beers_law_and_nothing_more() -> None:
    x = STEP * np.arange(30.0)
    weights = smoothing_matrix(30, STEP)
    for curve in (np.ones(30), x, x**2, np.exp(x)):
        np.testing.assert_allclose(weights @ curve, curve, rtol=1e-9, atol=1e-9)
    wave = np.sin(8.0 * x)
    assert np.max(np.abs(weights @ wave - wave)) > 0.1  # the control: a fast wave is bent


def test_too_few_points_are_left_as_they_are() -> None:
    values = np.arange(1.0, WINDOW)[None, :]
    assert np.array_equal(smoothing_matrix(WINDOW - 1, STEP), np.eye(WINDOW - 1))
    assert np.array_equal(smoothed(values, STEP)[0], values)


@pytest.mark.parametrize(
    ("axis", "expected"),
    [
        (SIGMA, True),
        (np.geomspace(0.05, 50.0, 20), False),  # too coarse
        (np.linspace(0.05, 50.0, 200), False),  # not even in the logarithm
        (np.geomspace(1.0, 1.5, 5), False),  # too few
    ],
)
def test_only_fine_and_even_axes_are_smoothed(axis: np.ndarray, expected: bool) -> None:
    assert fine_enough(axis) is expected


def test_noise_shrinks_as_stated_and_shape_stays() -> None:
    """Unscattered light falls over 12 orders of magnitude; the noise is halved all the same."""
    truth = np.exp(-1.1 * SIGMA)[None, :] * np.ones((4000, 1))
    noise = 0.02
    random = np.random.Generator(np.random.Philox(key=5))
    after, use = smoothed(truth * (1.0 + noise * random.standard_normal(truth.shape)), STEP)
    relative = after / truth - 1.0
    inner = slice(WINDOW, 60 - WINDOW)
    stated = smoothed_error(np.full(truth.shape, noise), use, STEP)
    assert use[:, inner].mean() > 0.99
    spread = relative[:, inner].std(axis=0)
    np.testing.assert_allclose(spread, stated[0, inner], rtol=0.1)
    assert np.all(spread < 0.55 * noise)
    bias = np.abs(relative[:, inner].mean(axis=0))
    assert np.all(bias < 4.5 * stated[0, inner] / np.sqrt(4000) + 0.02 * noise)


def test_curves_that_are_only_noise_are_left_alone() -> None:
    random = np.random.Generator(np.random.Philox(key=6))
    values = np.exp(random.standard_normal((3, 60)))
    after, use = smoothed(values, STEP)
    assert use.mean() < 0.2
    assert np.array_equal(after[~use], values[~use])


def test_interpolation_keeps_nodes_and_follows_exponentials() -> None:
    nodes = np.log(SIGMA)
    fine = refined_axis(nodes, 3)
    assert np.array_equal(fine[::3], nodes)
    values = np.exp(-0.4 * SIGMA)[None, :, None] * np.ones((2, 1, 2))
    found = interpolated(nodes, fine, values, 1)
    assert np.array_equal(found.shape, (2, len(fine), 2))
    np.testing.assert_allclose(found[:, ::3], values, rtol=1e-12)
    np.testing.assert_allclose(found[0, :, 0], np.exp(-0.4 * np.exp(fine)), rtol=5e-3)
    linear = np.interp(fine, nodes, values[0, :, 0])
    exact = np.exp(-0.4 * np.exp(fine))
    assert np.max(np.abs(linear / exact - 1)) > 5e-3  # the control: linear is worse
