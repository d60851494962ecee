"""Importance splitting: the same expectations at a fraction of the variance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.transport.scenes import ENDLESS, covered, slab, z_between, z_score
from twin.transport import Effort, FlatStack, Setup, Tallies, run_many, trace
from twin.transport.engine import BLACK, COLLISION
from twin.transport.importance import diffusion_exponent, importance_of

DOWN = 1
ALBEDO = np.array([0.6, 0.95, 1.0])
PLAIN = Effort(blocks=64, log2_paths=9, roulette_free=20_000)
SPLIT = replace(PLAIN, log2_paths=7, split_albedo=0.99)

THROUGH = Setup(down="hemisphere")
DIFFUSE = Setup(cone=np.pi / 2, down="hemisphere")
INTO_CONE = Setup(down="cone", target_cosine=float(np.cos(np.radians(20.0))))
OBLIQUE = Setup(polar=1.2, down="direction", target_cosine=0.5)


def upside_down(setup: Setup) -> Setup:
    """The same with light from below."""
    return replace(setup, from_below=True, up=setup.down, down="none")


def transmitted(tallies: Tallies, setup: Setup) -> np.ndarray:
    """Block means of what gets through at `ALBEDO`, shape (blocks, 3)."""
    channel = BLACK if setup.from_below else DOWN
    return tallies.blocks_by_albedo(channel, ALBEDO)[:, :, 0]


CASES = {
    "UT1, tau 4": (slab(4.0), THROUGH),
    "UTU, tau 4, n 1.5": (slab(4.0, 0.0, 1.5), DIFFUSE),
    "cone, tau 4, g 0.6, n 1.5, from below": (slab(4.0, 0.6, 1.5), upside_down(INTO_CONE)),
    "cone, tau 8": (slab(8.0), INTO_CONE),
    "oblique, tau 8, g 0.8": (slab(8.0, 0.8), OBLIQUE),
    "UTU, tau 8, g -0.3, from below": (slab(8.0, -0.3), upside_down(DIFFUSE)),
    "covers, tau 8": (covered(8.0, 0.5), THROUGH),
    "covers, tau 4, from below": (covered(4.0, 0.0, 1.6), upside_down(THROUGH)),
}


@pytest.mark.parametrize("name", CASES)
def test_split_and_plain_paths_agree(name: str) -> None:
    """The control: 3 % more optical thickness, which is what a wrong weight would look like."""
    stack, setup = CASES[name]
    thicker = replace(stack, sigma_t=1.03 * stack.sigma_t)
    plain, split, control = run_many(
        [
            lambda: trace(stack, setup, PLAIN, seed=31),
            lambda: trace(stack, setup, SPLIT, seed=32),
            lambda: trace(thicker, setup, replace(SPLIT, log2_paths=9), seed=33),
        ]
    )
    pair = [transmitted(tallies, setup) for tallies in (plain, split)]
    assert np.all(np.abs(z_between(*pair)) < 4.5)
    finer = transmitted(trace(stack, setup, replace(SPLIT, log2_paths=9), seed=34), setup)
    assert np.all(np.abs(z_between(pair[0], finer)) < 4.5)
    assert np.max(np.abs(z_between(transmitted(control, setup), finer))) > 4.5


@pytest.mark.parametrize(
    ("albedo", "setup", "value", "uncertainty"),
    [
        # C iad (scottprahl/iad), 48 quadrature points: UT1 and UTU at optical thickness 32
        (0.99, THROUGH, 0.001868, 1.0e-6),
        (0.99, DIFFUSE, 0.001464, 1.0e-6),
        # DISORT's test problem 1e: beam at mu 0.1, conservative
        (1.0, replace(THROUGH, polar=float(np.arccos(0.1))), 0.0215481, 2.0e-6),
    ],
)
def test_deep_slabs_match_published_transmittances(
    albedo: float, setup: Setup, value: float, uncertainty: float
) -> None:
    effort = Effort(blocks=32, log2_paths=10, roulette_free=20_000, split_albedo=albedo)
    tallies = trace(slab(32.0), setup, effort, seed=35)
    mean, error = tallies.estimate(DOWN, np.array([albedo]))
    assert error[0] < 0.01 * value
    assert abs(mean[0] - value) < 4.5 * np.hypot(error[0], uncertainty)
    assert abs(mean[0] - 1.05 * value) > 4.5 * np.hypot(error[0], uncertainty)


def test_splitting_is_worth_it() -> None:
    """Relative variance per starting path behind optical thickness 16: a tenth at most."""
    variances = []
    for effort in (PLAIN, replace(PLAIN, split_albedo=0.95)):
        tallies = trace(slab(16.0), THROUGH, effort, seed=36)
        blocks = tallies.blocks_by_albedo(DOWN, np.array([0.95]))[:, 0, 0]
        variances.append(blocks.var() / blocks.mean() ** 2)
    assert variances[1] < 0.1 * variances[0]


@pytest.mark.parametrize(("n", "g"), [(1.0, 0.0), (1.5, 0.8)])
def test_energy_is_conserved(n: float, g: float) -> None:
    """Reflected + transmitted + absorbed + lost at the sides = 1, whatever is split."""
    setup = Setup(up="hemisphere", down="hemisphere", half_size=(1.5, 2.0))
    tallies = trace(slab(3.0, g, n), setup, replace(SPLIT, log2_paths=9, balance=True), seed=37)
    albedo = np.array([0.5, 0.9, 1.0])
    parts = [tallies.blocks_by_albedo(channel, albedo).sum(axis=2) for channel in (BLACK, DOWN, 2)]
    collisions = tallies.value[:, COLLISION].sum(axis=1)
    order = np.maximum(tallies.order, 1.0)
    parts.append(collisions @ ((1.0 - albedo) * albedo ** (order[:, None] - 1.0)))
    total = np.stack(parts).sum(axis=0)
    assert np.all(np.abs(z_score(total, 1.0)) < 4.5)
    assert np.all(np.abs(z_score(total - parts[2], 1.0)) > 4.5)


def test_backgrounds_and_derivatives_survive_splitting() -> None:
    """Light that comes back from a white background, and the slope over sigma_t."""
    stack = slab(2.0, 0.5, 1.3)
    setup = Setup(up="hemisphere", black=ENDLESS, gap=0.5)
    columns = []
    for effort in (replace(PLAIN, roulette_free=16), replace(SPLIT, log2_paths=10)):
        tallies = trace(stack, setup, replace(effort, derivatives=True), seed=38)
        values = (tallies.value, tallies.d_sigma, tallies.d_g)
        blocks = [tallies.blocks_by_albedo(BLACK, ALBEDO[:2], table) for table in values]
        columns.append(np.concatenate(blocks, axis=1) @ 0.9**tallies.bounce)
    assert np.all(np.abs(z_between(*columns)) < 4.5)
    assert np.max(np.abs(z_between(1.2 * columns[0], columns[1]))) > 4.5


def test_blocks_are_the_same_in_chunks_and_threads() -> None:
    stack, setup = CASES["oblique, tau 8, g 0.8"]
    effort = replace(SPLIT, blocks=8)

    def jobs() -> list[Callable[[], np.ndarray]]:
        return [
            lambda first=first: (
                trace(stack, setup, replace(effort, blocks=4), seed=39, first_block=first).value
            )
            for first in (0, 4)
        ]

    whole = trace(stack, setup, effort, seed=39).value
    for threads in (1, 2):
        np.testing.assert_array_equal(whole, np.concatenate(run_many(jobs(), threads=threads)))
    assert not np.array_equal(whole, trace(stack, setup, effort, seed=40).value)


def combed(keep_weight: bool, wanted: float, capacity: int = 64) -> np.ndarray:
    """Sums over a hand-made population of 32 paths, resampled with evenly spread combs."""
    import warp as wp

    from tests.transport.comb_kernels import comb_kernel
    from twin.transport import population_kernels as population

    rows, size = 512, (512, capacity)
    splitting, generation = population.Splitting(), population.Generation()
    splitting.capacity = capacity
    generation.paths = wp.zeros((rows, 2 * capacity), dtype=population.Path, device="cpu")
    generation.order = wp.zeros(size, dtype=wp.int32, device="cpu")
    generation.share = wp.zeros(size, dtype=float, device="cpu")
    out = wp.zeros((rows, 5), dtype=float, device="cpu")
    combs = (np.arange(rows) + 0.5) / rows
    inputs = [
        splitting, generation, wp.array(WEIGHT, dtype=float, device="cpu"),
        wp.array(WORTH, dtype=float, device="cpu"), wanted,
        wp.array(combs, dtype=float, device="cpu"), int(keep_weight), out,
    ]  # fmt: skip
    wp.launch(comb_kernel, dim=rows, inputs=inputs, device="cpu")
    return np.asarray(out.numpy(), dtype=np.float64)


WEIGHT = 1.0 + np.sin(np.arange(32.0)) ** 2
WORTH = np.exp(0.1 * np.arange(32.0))


@pytest.mark.parametrize("wanted", [12.0, 40.0, 500.0])
def test_the_comb_keeps_every_sum(wanted: float) -> None:
    """Mean over combs of sums over the resampled paths; the control keeps the old weights."""
    sums = combed(False, wanted)
    expected = [WEIGHT.sum(), WEIGHT @ np.arange(32.0)]
    np.testing.assert_allclose(sums[:, 1:3].mean(axis=0), expected, rtol=2e-3)
    np.testing.assert_allclose(sums[:, 3:], 1.0, rtol=1e-4)
    assert np.all(np.abs(sums[:, 0] - min(wanted, 64.0)) <= 1.0)
    wrong = combed(True, wanted)[:, 1:3].mean(axis=0)
    assert np.all(np.abs(wrong / expected - 1.0) > 0.05)


def test_turning_upright_is_turning() -> None:
    """The angle asked for, azimuths all around, highest at azimuth 0; also along the axis."""
    import warp as wp

    from tests.transport.comb_kernels import turn_kernel

    random = np.random.Generator(np.random.Philox(key=41))
    count = 4096
    axis = random.normal(size=(count, 3))
    axis[:64, :2] = 0.0
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    cosine, azimuth = random.uniform(-1, 1, count), random.uniform(0, 2 * np.pi, count)
    out = wp.zeros(count, dtype=wp.vec3, device="cpu")
    inputs = [
        wp.array(axis, dtype=wp.vec3, device="cpu"),
        wp.array(cosine, dtype=float, device="cpu"),
        wp.array(azimuth, dtype=float, device="cpu"),
        out,
    ]
    wp.launch(turn_kernel, dim=count, inputs=inputs, device="cpu")
    turned = out.numpy()
    np.testing.assert_allclose(np.linalg.norm(turned, axis=1), 1.0, atol=1e-5)
    np.testing.assert_allclose(np.sum(turned * axis, axis=1), cosine, atol=1e-5)
    level, sine = np.hypot(axis[:, 0], axis[:, 1]), np.sqrt(1.0 - cosine**2)
    height = axis[:, 2] * cosine + level * sine * np.cos(azimuth)
    np.testing.assert_allclose(turned[64:, 2], height[64:], atol=1e-5)
    # left and right of the vertical plane alike
    side = (axis[:, 0] * turned[:, 1] - axis[:, 1] * turned[:, 0])[64:] / (level * sine)[64:]
    np.testing.assert_allclose(side, np.sin(azimuth)[64:], atol=2e-3)


def test_diffusion_exponents_are_those_of_the_transport_equation() -> None:
    """Isotropic scattering: a / (2 k) ln((1 + k) / (1 - k)) = 1 (Case and Zweifel 1967)."""
    for albedo in (0.5, 0.9, 0.99):
        k = diffusion_exponent(albedo, 0.0)
        assert albedo / (2.0 * k) * np.log((1.0 + k) / (1.0 - k)) == pytest.approx(1.0, abs=1e-9)
    # diffusion theory: kappa^2 = 3 (1 - a) (1 - a g) to first order in 1 - a
    assert diffusion_exponent(0.9999, 0.8) == pytest.approx(np.sqrt(3e-4 * 0.2), rel=1e-3)
    assert diffusion_exponent(1.0, 0.5) < 1e-3


def test_importance_grows_towards_the_far_side() -> None:
    for stack in (slab(32.0), slab(8.0, 0.8, 1.5), covered(8.0, 0.5)):
        above, below = (importance_of(stack, 0.99, side) for side in (False, True))
        assert np.all(np.diff(above.log_importance) >= 0.0)
        np.testing.assert_allclose(above.log_importance, below.log_importance, rtol=1e-12)
        assert above.highest - above.lowest > 8.0
    dark = importance_of(slab(1.0e4), 0.5, False)
    assert np.all(np.isfinite(dark.log_importance))


def test_layers_of_one_medium_are_one_layer() -> None:
    """The importance of a slab cut in two is that of the whole."""
    whole = importance_of(slab(8.0, 0.5, 1.4), 0.97, False)
    halves = FlatStack(
        np.full(2, 0.5), np.full(2, 1.4), np.full(2, 8.0), np.full(2, 0.5), np.full(2, 0.97), 0
    )
    cut = importance_of(halves, 0.97, False)
    np.testing.assert_allclose(cut.log_importance, whole.log_importance, atol=1e-9)


def test_wrong_requests_are_refused() -> None:
    with pytest.raises(ValueError, match="split_albedo"):
        trace(slab(4.0), THROUGH, replace(SPLIT, split_albedo=1.2))
    with pytest.raises(ValueError, match="scattering layer"):
        importance_of(slab(0.0), 0.9, from_below=False)
