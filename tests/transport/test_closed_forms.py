"""Limits in which the answer is known: no scattering, no light through, energy, scale."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.transport.scenes import (
    BARE,
    CHEAP,
    ENDLESS,
    covered,
    far_panels,
    slab,
    z_score,
)
from twin import optics
from twin.bench import Bench
from twin.transport import (
    Effort,
    FlatStack,
    PanelShape,
    Setup,
    beam_setup,
    panels_setup,
    stack_transfer,
    trace,
)
from twin.transport.engine import BLACK, COLLISION, SIDE, WHITE
from twin.transport.geometry import panel_shape, reference_factor

DOWN = 1
NO_ALBEDO = np.zeros(1)


@pytest.mark.parametrize("cosine", [1.0, 0.7, 0.3])
@pytest.mark.parametrize("stack", [slab(0.8, n=1.5), covered(1.3)], ids=["bare", "covered"])
def test_specular_transfer_is_the_incoherent_sum(stack: FlatStack, cosine: float) -> None:
    known = optics.stack(stack.n, stack.sigma_t * stack.thickness, cosine=cosine)
    t, r = stack_transfer(stack, np.array([cosine]))
    np.testing.assert_allclose(t, known.transmittance_down, rtol=1e-12)
    np.testing.assert_allclose(r, known.reflectance_above, rtol=1e-12)
    # the kernel's single precision and its table's linear interpolation
    tallies = trace(
        stack, Setup(polar=math.acos(cosine), up="hemisphere", down="hemisphere"), CHEAP
    )
    traced = [tallies.estimate(channel, NO_ALBEDO)[0][0] for channel in (BLACK, DOWN)]
    np.testing.assert_allclose(
        traced, [known.reflectance_above, known.transmittance_down], rtol=2e-5
    )


@pytest.mark.parametrize("stack", [slab(0.8, n=1.5), covered(2.1)], ids=["bare", "covered"])
def test_collimated_without_scattering_is_the_incoherent_sum(stack: FlatStack) -> None:
    known = optics.stack(stack.n, stack.sigma_t * stack.thickness)
    value, error = trace(stack, beam_setup(Bench()), CHEAP).estimate(BLACK, NO_ALBEDO)
    np.testing.assert_allclose(value, known.transmittance_up, rtol=1e-5)
    assert error[0] < 1e-6


@pytest.mark.parametrize("rho", [0.02, 0.99])
def test_a_clear_absorber_shows_the_background_through_beer_and_fresnel(rho: float) -> None:
    """I = T(0) rho T(45) / (1 - rho R'), R' the slab's reflectance for diffuse light below."""
    stack = slab(0.7, n=1.5)
    depth = [0.7]
    seen = optics.stack([1.5], depth).transmittance_up
    lit = optics.stack([1.5], depth, cosine=math.sqrt(0.5)).transmittance_down
    nodes, weights = np.polynomial.legendre.leggauss(64)
    mu = 0.5 * (nodes + 1.0)
    back = float(np.sum(weights * mu * optics.stack([1.5], depth, cosine=mu).reflectance_below))
    setup = replace(far_panels(), black=ENDLESS, gap=0.5)
    blocks = trace(stack, setup, CHEAP).blocks_by_albedo(BLACK, NO_ALBEDO)
    bounces = rho ** np.arange(blocks.shape[2])
    assert blocks[:, 0, 1].std() >= 0.0
    expected = seen * rho * lit / (1.0 - rho * back)
    # bins above 11 bounces hold several numbers of bounces; nothing gets that far here
    value = blocks[:, 0, :] @ bounces
    assert abs(z_score(value, expected)) < 4.5 or abs(value.mean() / expected - 1.0) < 2e-4
    assert abs(z_score(value, 1.02 * expected)) > 4.5


def test_the_first_bounce_on_the_real_bench_is_a_panel_integral() -> None:
    """n = 1, alpha = 0: exp(-tau) rho times the panels' irradiance weakened by Beer's law."""
    tau, height = 0.6, 1.0
    plane = -height - BARE.background.gap_mm
    nodes, weights = np.polynomial.legendre.leggauss(24)
    irradiance = 0.0
    for shape in map(panel_shape, BARE.panels):
        a, b = np.meshgrid(nodes * shape.half[0], nodes * shape.half[1], indexing="ij")
        area = np.outer(weights, weights) * shape.half[0] * shape.half[1]
        to = np.array(shape.centre) + a[..., None] * np.array(shape.u)
        to = to + b[..., None] * np.array(shape.v) - np.array([0.0, 0.0, plane])
        distance = np.linalg.norm(to, axis=-1)
        cosine = to[..., 2] / distance
        facing = -(to @ np.array(shape.normal)) / distance
        irradiance += float(np.sum(area * cosine * facing / distance**2 * np.exp(-tau / cosine)))
    # the line of sight is a degree from the normal at most: exp(-tau / cos) is exp(-tau)
    expected = math.exp(-tau) * irradiance / reference_factor(BARE, plane)
    tallies = trace(slab(tau), panels_setup(BARE, height), CHEAP)
    for channel in (BLACK, WHITE):
        blocks = tallies.blocks_by_albedo(channel, NO_ALBEDO)[:, 0, 1]
        assert abs(z_score(blocks, expected)) < 4.5
        assert abs(z_score(blocks, 0.99 * expected)) > 4.5


def test_an_opaque_sample_hides_the_background() -> None:
    tallies = trace(slab(40.0, thickness_mm=5.0), panels_setup(BARE, 5.0), CHEAP)
    black, _ = tallies.estimate(BLACK, np.array([0.9]), 0.02)
    white, _ = tallies.estimate(WHITE, np.array([0.9]), 0.99)
    assert black == pytest.approx(white, rel=1e-12)
    assert black[0] > 0.1
    thin = trace(slab(1.0), panels_setup(BARE, 1.0), CHEAP)
    assert thin.estimate(WHITE, np.array([0.9]), 0.99)[0][0] > 1.1 * black[0]


@pytest.mark.parametrize(("n", "g"), [(1.0, 0.0), (1.5, 0.8)])
def test_energy_is_conserved(n: float, g: float) -> None:
    """Reflected + transmitted + absorbed + lost at the sides = 1, at every albedo."""
    setup = Setup(up="hemisphere", down="hemisphere", half_size=(1.5, 2.0))
    effort = Effort(blocks=64, log2_paths=9, balance=True)
    tallies = trace(slab(3.0, g, n), setup, effort, seed=1)
    albedo = np.array([0.0, 0.5, 0.9, 1.0])
    share = [
        tallies.blocks_by_albedo(channel, albedo).sum(axis=2) for channel in (BLACK, DOWN, SIDE)
    ]
    collisions = tallies.value[:, COLLISION].sum(axis=1)
    order = np.maximum(tallies.order, 1.0)
    absorbed = collisions @ ((1.0 - albedo) * albedo ** (order[:, None] - 1.0))
    total = np.stack([*share, absorbed]).sum(axis=0)
    # paths without scattering are summed in closed form: there is no spread at albedo 0 and n 1
    assert np.all(np.abs(total.mean(axis=0) - 1.0) < 4.5 * total.std(axis=0) / 8.0 + 1e-5)
    without_sides = (total - share[2]).mean(axis=0)
    assert np.all(np.abs(without_sides[2:] - 1.0) > 4.5 * total.std(axis=0)[2:] / 8.0 + 1e-5)


def scaled(setup: Setup, factor: float) -> Setup:
    """The same set-up with every length multiplied."""

    def times(shape: PanelShape) -> PanelShape:
        return replace(
            shape,
            centre=tuple(factor * x for x in shape.centre),
            half=tuple(factor * x for x in shape.half),
        )

    def outline(name: str):  # type: ignore[no-untyped-def]
        part = getattr(setup, name)
        return replace(part, half_x=factor * part.half_x, half_y=factor * part.half_y)

    return replace(
        setup,
        radius=factor * setup.radius,
        panels=tuple(map(times, setup.panels)),
        half_size=tuple(factor * x for x in setup.half_size),
        gap=factor * setup.gap,
        black=outline("black"),
        white=outline("white"),
    )


@pytest.mark.parametrize("factor", [2.0, 0.25])
def test_only_ratios_of_lengths_matter(factor: float) -> None:
    """Powers of two scale floating-point numbers exactly, so the very paths are the same."""
    setup = panels_setup(BARE, 1.0)
    here = trace(slab(2.0, 0.4, 1.5), setup, CHEAP)
    there = trace(slab(2.0 / factor, 0.4, 1.5, factor), scaled(setup, factor), CHEAP)
    albedo = np.array([0.3, 0.95])
    for channel, rho in ((BLACK, 0.02), (WHITE, 0.99)):
        np.testing.assert_allclose(
            here.estimate(channel, albedo, rho)[0],
            there.estimate(channel, albedo, rho)[0],
            rtol=1e-6,
        )
    gap_forgotten = replace(scaled(setup, factor), gap=setup.gap)
    unscaled = trace(slab(2.0 / factor, 0.4, 1.5, factor), gap_forgotten, CHEAP)
    assert (
        abs(
            unscaled.estimate(WHITE, albedo, 0.99)[0] / there.estimate(WHITE, albedo, 0.99)[0] - 1.0
        ).max()
        > 1e-4
    )
