"""Chi-square tests of every sampling routine, each with a control that must fail."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy import stats

HENYEY_GREENSTEIN, CONE, DISC, TURN = range(4)
COUNT = 200_000
REJECT, CONTROL = 1e-4, 1e-9


@pytest.fixture(scope="module")
def wp() -> Any:
    import warp

    warp.config.log_level = warp.LOG_WARNING
    warp.init()
    return warp


def draws(wp: Any, routine: int, parameter: float, seed: int = 1) -> np.ndarray:
    """`COUNT` draws of one routine, shape (COUNT, 3)."""
    from twin.transport.sampling_kernels import sample_kernel

    out = wp.zeros(COUNT, dtype=wp.vec3, device="cpu")
    wp.launch(sample_kernel, COUNT, inputs=[routine, parameter, wp.uint64(seed), out], device="cpu")
    return out.numpy()


def uniform_p(*coordinates: np.ndarray, bins: int = 24) -> float:
    """p of the hypothesis that points are uniform in the unit interval, square or cube."""
    cells = [np.clip((c * bins).astype(int), 0, bins - 1) for c in coordinates]
    index = np.ravel_multi_index(cells, (bins,) * len(cells))
    return float(stats.chisquare(np.bincount(index, minlength=bins ** len(cells))).pvalue)


def henyey_greenstein_cdf(g: float, cosine: np.ndarray) -> np.ndarray:
    """Integral of Henyey and Greenstein 1941, eq. 2, from -1."""
    if g == 0.0:
        return 0.5 * (1.0 + cosine)
    root = 1.0 / np.sqrt(1.0 + g * g - 2.0 * g * cosine)
    return (1.0 - g * g) / (2.0 * g) * (root - 1.0 / (1.0 + g))


@pytest.mark.parametrize("g", [-0.7, 0.0, 5e-4, 0.3, 0.9, 0.98])
def test_scattering_angles_follow_henyey_greenstein(wp: Any, g: float) -> None:
    cosine, azimuth, _ = draws(wp, HENYEY_GREENSTEIN, g).astype(float).T
    assert np.all(np.abs(cosine) <= 1.0)
    assert uniform_p(henyey_greenstein_cdf(g, cosine), azimuth, bins=16) > REJECT
    wrong = g - math.copysign(0.02, g)
    assert uniform_p(henyey_greenstein_cdf(wrong, cosine), azimuth, bins=16) < CONTROL


@pytest.mark.parametrize("sine", [1.0, 0.5, math.sin(math.radians(1.0))])
def test_cones_are_uniform_in_projected_solid_angle(wp: Any, sine: float) -> None:
    x, y, z = draws(wp, CONE, sine).astype(float).T
    np.testing.assert_allclose(x * x + y * y + z * z, 1.0, atol=1e-5)
    azimuth = np.arctan2(y, x) / (2 * math.pi) % 1.0
    share = (x * x + y * y) / sine**2
    assert uniform_p(share, azimuth, bins=16) > REJECT
    assert uniform_p(np.sqrt(share), azimuth, bins=16) < CONTROL


def test_discs_are_uniform(wp: Any) -> None:
    x, y, _ = draws(wp, DISC, 2.5).astype(float).T
    azimuth = np.arctan2(y, x) / (2 * math.pi) % 1.0
    share = (x * x + y * y) / 2.5**2
    assert uniform_p(share, azimuth, bins=16) > REJECT
    assert uniform_p(share**0.97, azimuth, bins=16) < CONTROL


@pytest.mark.parametrize("axis_z", [-2.0, -0.1, 0.4, 50.0])
def test_turned_directions_have_the_wanted_angle(wp: Any, axis_z: float) -> None:
    cosine, dot, _ = draws(wp, TURN, axis_z).T
    np.testing.assert_allclose(dot, cosine, atol=2e-6)


def test_uniform_numbers_are_uniform_and_independent(wp: Any) -> None:
    from tests.transport.point_kernels import uniform2_kernel, uniform8_kernel

    pairs = wp.zeros(COUNT, dtype=wp.vec2, device="cpu")
    wp.launch(uniform2_kernel, COUNT, inputs=[wp.uint64(5), pairs], device="cpu")
    u, v = pairs.numpy().astype(float).T
    assert uniform_p(u, v) > REJECT
    # successive pairs of one stream, and neighbouring streams
    assert uniform_p(u[:-1], v[1:]) > REJECT
    assert uniform_p(u[:-8], u[8:]) > REJECT
    # the lowest of the 24 bits are as good as the highest
    assert uniform_p(u * 4096 % 1.0, v * 4096 % 1.0) > REJECT
    assert uniform_p(u, 0.98 * v) < CONTROL

    from twin.transport.sampling_kernels import vec8

    eights = wp.zeros(COUNT, dtype=vec8, device="cpu")
    wp.launch(uniform8_kernel, COUNT, inputs=[wp.uint64(6), eights], device="cpu")
    values = eights.numpy().astype(float)
    worst = min(uniform_p(values[:, i], values[:, j], bins=16) for i in range(8) for j in range(i))
    assert worst > REJECT / 28


def kronecker_points(wp: Any, shift: np.ndarray, count: int) -> np.ndarray:
    """Points of the shifted sequence, shape (count, 8)."""
    from tests.transport.point_kernels import kronecker_kernel
    from twin.transport.sampling_kernels import vec8

    out = wp.zeros(count, dtype=vec8, device="cpu")
    wp.launch(kronecker_kernel, count, inputs=[vec8(*map(float, shift)), out], device="cpu")
    return out.numpy().astype(float)


def test_kronecker_points_are_exact_multiples(wp: Any) -> None:
    """Against integers of any length; the first step is the golden ratio's fraction."""
    from twin.transport import sampling_kernels as kernels

    steps = [int(getattr(kernels, f"STEP_{i}")) % 2**32 for i in range(8)]
    assert abs(steps[0] / 2.0**32 - (math.sqrt(5.0) - 1.0) / 2.0) < 1e-9
    assert all(step % 2 for step in steps)  # odd: every residue once in 2**32 points
    points = kronecker_points(wp, np.zeros(8), 5000)
    exact = [[(i * step % 2**32 >> 8) / 2.0**24 for step in steps] for i in range(5000)]
    np.testing.assert_allclose(points, exact, atol=1e-7)


def test_kronecker_points_fill_every_projection_evenly(wp: Any) -> None:
    """Far more even than random points, in every coordinate and in nearly every pair."""
    count, bins = 4096, 16
    shift = np.random.Generator(np.random.Philox(key=3)).random(8)
    points = kronecker_points(wp, shift, count)
    plain = np.random.Generator(np.random.Philox(key=4)).random((count, 8))
    assert np.all((points >= 0.0) & (points < 1.0))

    def gap(values: np.ndarray) -> float:
        return max(float(stats.kstest(values[:, i], "uniform").statistic) for i in range(8))

    def cells(values: np.ndarray) -> np.ndarray:
        """Unevenness of every pair's 16 x 16 cells; about 1 for random points."""
        grids = [
            np.histogram2d(values[:, i], values[:, j], bins, [[0, 1], [0, 1]])[0]
            for i in range(8)
            for j in range(i)
        ]
        return np.array([np.sum((grid - count / bins**2) ** 2) / count for grid in grids])

    assert gap(points) < 0.25 * gap(plain)
    # a pair of steps may have a short integer relation; most must not
    assert np.quantile(cells(points), 0.75) < 0.6 * np.median(cells(plain))
    assert np.quantile(cells(plain), 0.25) > 0.6 * np.median(cells(plain))


def test_a_random_shift_makes_every_point_uniform(wp: Any) -> None:
    generator = np.random.Generator(np.random.Philox(key=7))
    points = np.array([kronecker_points(wp, generator.random(8), 6)[5] for _ in range(2000)])
    worst = min(float(stats.kstest(points[:, i], "uniform").pvalue) for i in range(8))
    assert worst > REJECT / 8
    assert float(stats.kstest(points[:, 0] ** 1.2, "uniform").pvalue) < CONTROL
