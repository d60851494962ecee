"""Relations between results: reciprocity, background series, albedo series, derivatives."""

from __future__ import annotations

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
    z_between,
    z_score,
)
from twin.transport import Effort, FlatStack, Setup, beam_setup, panels_setup, trace
from twin.transport.engine import BLACK, WHITE

DOWN = 1
ALBEDO = np.array([0.4, 0.9, 0.99])


@pytest.mark.parametrize("stack", [slab(2.0, 0.6), slab(3.0, 0.8, 1.5), covered(2.0, 0.5)])
def test_hemispherical_reflectance_equals_radiance_factor_under_diffuse_light(
    stack: FlatStack,
) -> None:
    """Light scattered at least once; specular light is left out of both."""
    effort = replace(CHEAP, log2_paths=9)
    forward = trace(stack, Setup(up="hemisphere"), effort, seed=2)
    backward = trace(stack, Setup(cone=np.pi / 2, up="direction"), effort, seed=3)
    pair = []
    for tallies in (forward, backward):
        tallies.value[:, :, :, 0] = 0.0
        pair.append(tallies.blocks_by_albedo(BLACK, ALBEDO).sum(axis=2))
    assert np.all(np.abs(z_between(*pair)) < 4.5)
    assert np.all(np.abs(z_between(1.25 * pair[0], pair[1])) > 4.5)


@pytest.mark.parametrize("n", [1.0, 1.5])
def test_the_background_enters_as_a_geometric_series(n: float) -> None:
    """Unbounded slab: R + T1 rho T2 / (1 - rho R'), R' and T2 for diffuse light from below."""
    stack = slab(2.0, 0.5, n)
    effort = replace(CHEAP, log2_paths=9)
    beam = trace(stack, Setup(up="hemisphere", down="hemisphere"), effort, seed=4)
    diffuse = trace(
        stack, Setup(cone=np.pi / 2, up="hemisphere", down="hemisphere"), effort, seed=5
    )
    lit = trace(stack, Setup(up="hemisphere", black=ENDLESS, gap=0.5), effort, seed=6)
    parts = {}
    for name, tallies in (("beam", beam), ("diffuse", diffuse)):
        for channel, side in ((BLACK, "up"), (DOWN, "down")):
            parts[name, side] = tallies.blocks_by_albedo(channel, ALBEDO).sum(axis=2)
    blocks = lit.blocks_by_albedo(BLACK, ALBEDO)
    for rho in (0.3, 0.99):
        mean = {key: value.mean(axis=0) for key, value in parts.items()}
        trapped = 1.0 - rho * mean["diffuse", "up"]
        through = mean["beam", "down"] * rho * mean["diffuse", "down"] / trapped
        # linearised block by block, so that the blocks' spread is the error of the formula
        slope = parts["beam", "down"] / mean["beam", "down"] - 1.0
        formula = parts["beam", "up"] + through * (1.0 + slope)
        formula = formula + through * (parts["diffuse", "down"] / mean["diffuse", "down"] - 1.0)
        formula += through * rho * (parts["diffuse", "up"] - mean["diffuse", "up"]) / trapped
        traced = blocks @ rho**lit.bounce
        assert np.all(np.abs(z_between(traced, formula)) < 4.5)
        assert np.all(np.abs(z_between(traced, parts["beam", "up"])) > 4.5)


def panels_blocks(stack: FlatStack, effort: Effort, seed: int) -> np.ndarray:
    """Block means over black and over white at `ALBEDO`, shape (blocks, 6)."""
    tallies = trace(stack, panels_setup(BARE, 1.0), effort, seed=seed)
    return np.concatenate(
        [
            tallies.blocks_by_albedo(channel, ALBEDO) @ rho**tallies.bounce
            for channel, rho in ((BLACK, 0.02), (WHITE, 0.99))
        ],
        axis=1,
    )


@pytest.mark.parametrize(("g", "n"), [(0.2, 1.0), (0.8, 1.5)])
def test_sorted_and_plain_paths_agree(g: float, n: float) -> None:
    """Sorted low-discrepancy paths against plain Monte Carlo, and a control that must fail."""
    effort = replace(CHEAP, log2_paths=9)
    ordered = panels_blocks(slab(3.0, g, n), effort, 7)
    plain = panels_blocks(slab(3.0, g, n), replace(effort, lattice=False), 8)
    assert np.all(np.abs(z_between(ordered, plain)) < 4.5)
    control = panels_blocks(slab(3.0, g - 0.1, n), replace(effort, lattice=False), 9)
    assert np.max(np.abs(z_between(ordered, control))) > 4.5


def test_blocks_are_independent() -> None:
    """Neighbouring blocks do not correlate; blocks with a common part (the control) do."""
    blocks = panels_blocks(slab(3.0, 0.5, 1.5), Effort(blocks=1024, log2_paths=4), 10)
    blocks = (blocks - blocks.mean(axis=0)) / blocks.std(axis=0)

    def worst(values: np.ndarray) -> float:
        count = len(values)
        return max(
            float(np.max(np.abs((values[lag:] * values[:-lag]).mean(axis=0)))) * np.sqrt(count)
            for lag in (1, 2, 3, 64)
        )

    assert worst(blocks) < 4.5
    assert worst((blocks[1:] + blocks[:-1]) / np.sqrt(2.0)) > 4.5


@pytest.mark.parametrize("albedo", [0.3, 0.95])
def test_one_set_of_paths_serves_every_albedo(albedo: float) -> None:
    """The series against paths that roulette shortens with that very albedo, other seed."""
    series = trace(slab(2.0, 0.6, 1.4), far_panels(), replace(CHEAP, log2_paths=9), seed=11)
    own = Effort(64, 9, roulette_albedo=albedo, roulette_scale=1e9, roulette_free=2, lattice=False)
    direct = trace(slab(2.0, 0.6, 1.4), far_panels(), own, seed=12)
    blocks = [t.blocks_by_albedo(BLACK, np.array([albedo]))[:, 0, 0] for t in (series, direct)]
    assert abs(z_between(*blocks)) < 4.5
    wrong = series.blocks_by_albedo(BLACK, np.array([albedo - 0.05]))[:, 0, 0]
    assert abs(z_between(wrong, blocks[1])) > 4.5


def test_wide_order_bins_do_not_shift_the_series() -> None:
    """Albedo to the mean order of a bin against the mean over the orders in it."""
    from twin.transport.engine import order_bins

    index, mean = order_bins()
    orders = np.arange(len(index))
    for albedo in (0.9, 0.99, 0.999):
        weight = 1.0 / (1.0 + orders) ** 1.5
        exact = float(np.sum(weight * albedo**orders))
        binned = float(np.bincount(index, weights=weight) @ albedo**mean)
        assert binned == pytest.approx(exact, rel=1e-4)


SETUPS = {
    "panels": (panels_setup(BARE, 1.0), 0.99),
    "beam": (beam_setup(BARE), 1.0),
}


@pytest.mark.parametrize("setup", SETUPS)
@pytest.mark.parametrize("parameter", ["sigma_t", "g"])
def test_derivatives_match_finite_differences(setup: str, parameter: str) -> None:
    """Score functions against central differences with common random numbers."""
    around, rho = SETUPS[setup]
    channel = WHITE if setup == "panels" else BLACK
    centre = {"sigma_t": 1.5, "g": 0.5}
    step = 0.05
    effort = Effort(blocks=64, log2_paths=11, lattice=False)
    albedo = np.array([0.9])

    def blocks(shift: float) -> np.ndarray:
        values = dict(centre)
        values[parameter] += shift
        stack = slab(values["sigma_t"], values["g"], 1.3)
        tallies = trace(stack, around, effort, seed=13)
        return tallies.blocks_by_albedo(channel, albedo)[:, 0] @ rho**tallies.bounce

    difference = (blocks(step) - blocks(-step)) / (2 * step)
    tallies = trace(
        slab(centre["sigma_t"], centre["g"], 1.3), around, replace(effort, derivatives=True),
        seed=14,
    )  # fmt: skip
    own = tallies.d_sigma if parameter == "sigma_t" else tallies.d_g
    score = tallies.blocks_by_albedo(channel, albedo, own)[:, 0] @ rho**tallies.bounce
    # the difference quotient's own error is of second order in the step: 1 % is ample
    slack = 0.01 * abs(score.mean())
    error = np.hypot(z_error(difference), z_error(score))
    assert abs(difference.mean() - score.mean()) < 4.5 * error + slack
    assert abs(difference.mean() + score.mean()) > 4.5 * error + slack


def z_error(blocks: np.ndarray) -> float:
    """Standard error of the mean of blocks."""
    return float(blocks.std(ddof=1) / np.sqrt(len(blocks)))


def test_derivatives_need_a_single_scattering_layer() -> None:
    both = FlatStack(np.ones(2), np.ones(2), np.ones(2), np.zeros(2), np.ones(2), counted=0)
    with pytest.raises(ValueError, match="only scattering layer"):
        trace(both, Setup(up="hemisphere"), replace(CHEAP, derivatives=True))


def test_a_split_layer_is_the_same_layer() -> None:
    """Two scattering halves of one index against one whole; the lower half's albedo fixed."""
    albedo = np.array([0.8])
    half = FlatStack(
        np.array([0.5, 0.5]), np.full(2, 1.5), np.full(2, 3.0), np.full(2, 0.6),
        np.array([1.0, 0.8]), counted=0,
    )  # fmt: skip
    setup = Setup(up="hemisphere", down="hemisphere")
    effort = replace(CHEAP, log2_paths=9)
    split, whole = trace(half, setup, effort, seed=15), trace(slab(3.0, 0.6, 1.5), setup, effort)
    for channel in (BLACK, DOWN):
        pair = [t.blocks_by_albedo(channel, albedo).sum(axis=2)[:, 0] for t in (split, whole)]
        assert abs(z_between(*pair)) < 4.5
    assert abs(z_score(pair[0], 1.05 * pair[1].mean())) > 4.5
