"""Points and planes: closed forms at albedo 0, first-order scattering, Jacobians, statistics."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenarios.figures import planes
from scenarios.figures.drawing import smooth
from scenarios.figures.figure4 import fresnel_alone
from scenarios.figures.figure6 import crossing
from scenarios.figures.planes import Plane, cell_areas, plane_of, uniqueness
from scenarios.figures.points import (
    BENCH,
    RHO_BLACK,
    RHO_WHITE,
    Point,
    jackknife,
    leave_one_out,
    sigma_grid,
    simulate,
)
from twin.transport.geometry import panel_shape

SIGMA = (0.5, 2.0)


@pytest.fixture(scope="module")
def panels():
    points = tuple(Point(s, log2_paths=8) for s in SIGMA)
    return points, simulate(points)


def left_edge(tau: float, plane_mm: float) -> float:
    """I over a background of reflectance 1 through a clear absorber, n 1: Beer over both passes."""
    nodes, weights = np.polynomial.legendre.leggauss(32)
    total = faded = 0.0
    for shape in map(panel_shape, BENCH.panels):
        a, b = np.meshgrid(nodes * shape.half[0], nodes * shape.half[1], indexing="ij")
        u, v = np.array(shape.u), np.array(shape.v)
        to = np.array(shape.centre) + a[..., None] * u + b[..., None] * v - [0.0, 0.0, plane_mm]
        distance = np.linalg.norm(to, axis=-1)
        cosine = to[..., 2] / distance
        lit = np.outer(weights, weights) * cosine * -(to @ np.array(shape.normal)) / distance**3
        total += lit.sum()
        faded += (lit * np.exp(-tau / cosine)).sum()
    return math.exp(-tau) * faded / total


@pytest.mark.parametrize("index", range(len(SIGMA)))
def test_left_edge_is_beer_over_both_passes(panels, index: int):
    points, results = panels
    point = points[index]
    tau = point.sigma_t_per_mm * point.thickness_mm
    value = results[point].value[:, :, 0]
    error = value.std(axis=0, ddof=1) / math.sqrt(len(value))
    black, difference = value.mean(axis=0)
    expected = left_edge(tau, -point.thickness_mm - BENCH.background.gap_mm)
    # 1e-4: interpolation in the engine's single-precision tables
    assert abs(black - RHO_BLACK * expected) < 4.5 * error[0] + 1e-4 * RHO_BLACK
    assert abs(difference - (RHO_WHITE - RHO_BLACK) * expected) < 4.5 * error[1] + 1e-4
    # the control: one pass along the normal alone, as the seed writes, is far off
    one_pass = RHO_BLACK * math.exp(-tau)
    assert abs(black - one_pass) > 10.0 * (4.5 * error[0] + 1e-4 * RHO_BLACK)


@pytest.mark.parametrize("acceptance_deg", [1.0, 5.0])
def test_thin_in_scattering_is_of_first_order(acceptance_deg: float):
    g, tau = 0.8, 0.0036
    point = Point(
        tau / 1.8, g=g, thickness_mm=1.8, lit="beam", acceptance_deg=acceptance_deg,
        albedo=(0.0, 1.0), log2_paths=8,
    )  # fmt: skip
    value = simulate([point])[point].value[:, 0]
    unscattered, all_of_it = value.mean(axis=0)
    assert unscattered == pytest.approx(math.exp(-tau), rel=1e-6)
    excess, error = jackknife(leave_one_out(value[:, 1] / value[:, 0] - 1.0))
    # share of the Henyey-Greenstein phase function inside the cone (its integral in closed form)
    cosine = math.cos(math.radians(acceptance_deg))
    within = (1 - g * g) / (2 * g) * (1 / (1 - g) - 1 / math.sqrt(1 + g * g - 2 * g * cosine))
    # second order adds about tau to the relative excess; the aperture cuts nothing at 5 degrees
    assert abs(excess - tau * within) < 4.5 * error + 2.0 * tau * tau * within
    assert all_of_it > unscattered


def test_derivatives_agree_with_differences_and_jacobian_keeps_its_sign(panels):
    points, results = panels
    plane = plane_of(points, results)
    assert np.all(plane.jacobian[1:-1] < -planes.RESOLVED * plane.jacobian_se[1:-1])
    step = 1.02
    moved = Point(SIGMA[1] * step, log2_paths=8)
    blocks, further = results[points[1]], simulate([moved])[moved]
    difference = (further.mean[1] - blocks.mean[1]) / (SIGMA[1] * (step - 1.0))
    slope = blocks.d_sigma.mean(axis=0)[1]
    spread = blocks.value[:, 1].std(axis=0, ddof=1) / math.sqrt(32)
    tolerance = 4.5 * math.sqrt(2.0) * spread / (SIGMA[1] * (step - 1.0)) + 0.05 * np.abs(slope)
    assert np.all(np.abs(difference - slope) < tolerance)
    albedo = plane.albedo
    secant = np.diff(blocks.mean[0]) / np.diff(albedo)
    ends = blocks.d_albedo.mean(axis=0)[0]
    # a power series with positive coefficients is convex
    assert np.all(secant >= ends[:-1] * (1 - 1e-9))
    assert np.all(secant <= ends[1:] * (1 + 1e-9))


def fake_plane(fold: bool) -> Plane:
    """A map that is one-to-one, or one that is folded over at albedo 0.5."""
    albedo, sigma = np.linspace(0.0, 1.0, 21), np.geomspace(0.1, 10.0, 15)
    a, s = np.meshgrid(albedo, np.linspace(0.0, 1.0, 15), indexing="ij")
    up = np.abs(a - 0.5) if fold else a
    jacobian = np.where(fold & (a > 0.5), 1.0, -1.0)
    return Plane(
        albedo, sigma, s, up, 0 * a, 0 * a, -jacobian if fold else jacobian, np.full_like(a, 0.1)
    )


def test_uniqueness_sees_a_fold():
    whole, folded = uniqueness(fake_plane(False)), uniqueness(fake_plane(True))
    assert whole["jacobian_sign"]["usual_sign"] == 21 * 15
    assert whole["share_of_area_with_turned_cells"] == 0.0
    assert folded["jacobian_sign"]["other_sign"] > 0
    assert folded["share_of_area_with_turned_cells"] == pytest.approx(0.5)


def test_cells_add_up_to_the_area():
    assert np.abs(cell_areas(fake_plane(False))).sum() == pytest.approx(1.0)


@given(st.lists(st.floats(-10.0, 10.0), min_size=3, max_size=40))
@settings(deadline=None, derandomize=True, max_examples=50)
def test_jackknife_of_a_mean_is_its_standard_error(values: list[float]):
    blocks = np.array(values)
    mean, error = jackknife(leave_one_out(blocks))
    assert mean == pytest.approx(blocks.mean(), abs=1e-9)
    assert error == pytest.approx(blocks.std(ddof=1) / math.sqrt(len(values)), abs=1e-9)


@given(st.floats(0.5, 6.0), st.floats(1e-3, 1e3))
@settings(deadline=None, derandomize=True, max_examples=50)
def test_crossing_of_a_power_law(power: float, level: float):
    x = np.linspace(0.1, 8.0, 30)
    exact = level ** (1.0 / power)
    found = crossing(x, x**power, level)
    if exact > x[-1]:
        assert found is None
    elif exact >= x[0]:
        assert found == pytest.approx(exact, rel=1e-6)
    else:
        assert found is not None
        assert 0.0 < found <= x[0]


def test_smooth_curves_pass_through_their_points():
    x, y = np.array([0.0, 0.3, 0.4, 1.0]), np.array([1.0, 0.9, 0.5, 0.4])
    fine = smooth(np.stack([x, y]), per_interval=4)
    np.testing.assert_allclose(fine[:, ::4], [x, y])
    assert np.all(np.diff(fine[1]) <= 0)


def test_grid_holds_the_contours():
    for quick in (False, True):
        grid = sigma_grid(quick)
        assert {0.1, 1.0, 2.0, 5.0, 10.0, 100.0} <= set(grid)
        assert list(grid) == sorted(grid)


def test_fresnel_alone_at_matched_index_and_glass():
    assert fresnel_alone(1.0) == pytest.approx(RHO_WHITE)
    # R(0) 0.04, R(45) 0.0502 at n 1.5 (Hecht 2017, section 4.6); a plate passes (1-R)/(1+R)
    assert fresnel_alone(1.5) == pytest.approx(0.99 * (0.96 / 1.04) * (0.9498 / 1.0502), abs=2e-4)
