"""Panels, reference plane and beam against closed forms and direct sampling."""

from __future__ import annotations

import math

import numpy as np
import pytest

from twin.bench import Beam, Bench, Detector, Panel
from twin.transport.geometry import (
    beam_reference_share,
    irradiance_factor,
    panel_shape,
    panels_setup,
    reference_factor,
    reference_plane_mm,
)


@pytest.mark.parametrize("polar", [0.0, 30.0, 45.0, 70.0])
def test_a_small_distant_panel_is_cosine_over_distance_squared(polar: float) -> None:
    panel = Panel(width_mm=1.0, length_mm=2.0, distance_mm=1000.0, polar_deg=polar)
    factor = reference_factor(Bench(panels=(panel,)), 0.0)
    expected = math.cos(math.radians(polar)) * 2.0 / 1000.0**2
    assert factor == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("plane", [0.0, -1.8])
def test_the_reference_factor_matches_direct_sampling(plane: float) -> None:
    """Uniform points on panels, spot and cone; the footprint moves with the cone."""
    bench = Bench(detector=Detector(acceptance_deg=20.0, spot_panels_mm=30.0))
    generator = np.random.Generator(np.random.Philox(key=1))
    count = 400_000

    def disc(radius: float) -> np.ndarray:
        r = radius * np.sqrt(generator.random(count))
        angle = 2 * math.pi * generator.random(count)
        return np.stack([r * np.cos(angle), r * np.sin(angle)], axis=1)

    tilt = disc(math.sin(math.radians(20.0)))
    slope = tilt / np.sqrt(1.0 - (tilt**2).sum(axis=1))[:, None]
    point = np.concatenate([disc(15.0) + slope * plane, np.full((count, 1), plane)], axis=1)
    total = np.zeros(count)
    for shape in map(panel_shape, bench.panels):
        a, b = (2.0 * generator.random((2, count)) - 1.0) * np.array(shape.half)[:, None]
        to = np.array(shape.centre) + a[:, None] * shape.u + b[:, None] * np.array(shape.v) - point
        distance = np.linalg.norm(to, axis=1)
        facing = -(to @ np.array(shape.normal)) / distance
        total += 4 * shape.half[0] * shape.half[1] * to[:, 2] / distance * facing / distance**2
    error = total.std() / math.sqrt(count)
    factor = reference_factor(bench, plane)
    assert abs(factor - total.mean()) < 4.5 * error
    assert abs(1.02 * factor - total.mean()) > 4.5 * error
    assert error < 1e-3 * factor


def test_the_reference_plane_is_the_background_of_each_sample() -> None:
    bench = Bench()
    plane = reference_plane_mm(bench, 1.3)
    assert plane == pytest.approx(-1.8)
    assert reference_plane_mm(bench.model_copy(update={"reference_plane_mm": -2.0}), 1.3) == -2.0
    # a small panel at 45 degrees: E ~ height / distance^3, so d ln E / dz = 3 cos / r - 1 / h
    small = Bench(panels=(Panel(width_mm=1.0, length_mm=1.0),))
    gain = reference_factor(small, 0.0) / reference_factor(small, -1.0) - 1.0
    cosine = math.sqrt(0.5)
    assert gain == pytest.approx(3.0 * cosine / 300.0 - 1.0 / (300.0 * cosine), rel=0.05)
    assert reference_factor(bench, 0.0) > reference_factor(bench, -1.0)


def test_quarter_turns_leave_the_lit_amount_alone() -> None:
    """The set-up may add turned panels; scale times their irradiance stays pi in the plane."""
    bench = Bench()
    height = 1.3
    setup = panels_setup(bench, height)
    plane = reference_plane_mm(bench, height)
    factor = irradiance_factor(setup.panels, 0.0, 0.0, plane)
    assert setup.panel_scale * factor == pytest.approx(math.pi, rel=1e-5)


def test_the_default_beam_is_collected_whole() -> None:
    assert beam_reference_share(Bench(), 1.3) == 1.0


@pytest.mark.parametrize("diameter", [5.0, 8.0])
def test_a_beam_wider_than_the_spot_is_cut(diameter: float) -> None:
    bench = Bench(beam=Beam(diameter_mm=diameter))
    assert beam_reference_share(bench, 1.3) == pytest.approx((4.0 / diameter) ** 2, rel=0.01)


@pytest.mark.parametrize(("diameter", "divergence", "height"), [(1.0, 3.0, 1.3), (3.5, 0.9, 60.0)])
def test_a_divergent_beam_is_cut_by_cone_and_spot(
    diameter: float, divergence: float, height: float
) -> None:
    bench = Bench(beam=Beam(diameter_mm=diameter, divergence_deg=divergence))
    generator = np.random.Generator(np.random.Philox(key=2))
    count = 400_000
    r = diameter / 2 * np.sqrt(generator.random(count))
    sine = math.sin(math.radians(divergence)) * np.sqrt(generator.random(count))
    angle = 2 * math.pi * generator.random(count)
    shift = height * sine / np.sqrt(1.0 - sine**2)
    reach = np.hypot(r + shift * np.cos(angle), shift * np.sin(angle))
    inside = (reach <= 2.0) & (sine <= math.sin(math.radians(1.0)))
    share = beam_reference_share(bench, height)
    error = math.sqrt(share * (1.0 - share) / count)
    # the share's own grid has 200 steps in each coordinate
    assert abs(share - inside.mean()) < 4.5 * error + 0.003
    assert 0.05 < share < 0.995
