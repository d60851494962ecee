"""What must hold on the bench for any medium (bench.md), on cheap traces."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.transport.scenes import BARE, slab, z_between
from twin.bench import Bench, Panel
from twin.transport import Effort, beam_setup, mean_and_error, panels_setup, trace
from twin.transport.engine import BLACK, WHITE

TINY = Effort(blocks=32, log2_paths=5)
ALBEDO = np.array([0.0, 0.3, 0.7, 0.95, 1.0])

MEDIA = st.tuples(
    st.floats(0.01, 20.0), st.floats(-0.5, 0.95), st.floats(1.0, 1.8), st.floats(0.2, 3.0)
)


@settings(max_examples=12)
@given(medium=MEDIA)
def test_black_is_below_white_and_both_grow_with_the_albedo(
    medium: tuple[float, float, float, float],
) -> None:
    sigma_t, g, n, thickness = medium
    tallies = trace(slab(sigma_t, g, n, thickness), panels_setup(BARE, thickness), TINY)
    # every coefficient of the series in albedo and reflectance is a mean of energies
    assert np.all(tallies.value >= 0.0)
    black, _ = tallies.estimate(BLACK, ALBEDO, 0.02)
    white, error = tallies.estimate(WHITE, ALBEDO, 0.99)
    assert np.all(black >= 0.0)
    assert np.all(black <= white * (1.0 + 1e-6))
    assert np.all(np.diff(black) >= -1e-9)
    assert np.all(np.diff(white) >= -1e-9)
    assert np.all(np.isfinite(error))


@settings(max_examples=8)
@given(medium=MEDIA)
def test_nothing_is_brighter_than_a_perfect_diffuser_without_interfaces(
    medium: tuple[float, float, float, float],
) -> None:
    """n = 1: about 0.5 % per mm comes from lying nearer to the panels; the rest is noise.

    A medium is no Lambertian reflector: a quarter more than the diffuser is allowed for.
    """
    sigma_t, g, _, thickness = medium
    tallies = trace(slab(sigma_t, g, 1.0, thickness), panels_setup(BARE, thickness), TINY)
    white, error = tallies.estimate(WHITE, np.array([1.0]), 0.99)
    assert white[0] < 1.25 + 5.0 * error[0]


@settings(max_examples=8)
@given(medium=MEDIA)
def test_collimated_lies_between_beer_and_all_light(
    medium: tuple[float, float, float, float],
) -> None:
    sigma_t, g, n, thickness = medium
    tallies = trace(slab(sigma_t, g, n, thickness), beam_setup(BARE), TINY)
    value, error = tallies.estimate(BLACK, ALBEDO)
    assert np.all(np.diff(value) >= -1e-12)
    assert np.all(value >= value[0])
    assert np.all(value <= 1.0 + 5.0 * error)


@pytest.mark.parametrize("azimuths", [(180.0, 0.0), (90.0, 270.0)])
def test_panels_may_be_exchanged_and_turned(azimuths: tuple[float, float]) -> None:
    """The square stack and round detector do not know which panel stands where."""
    other = Bench(
        covers_above=(), covers_below=(),
        panels=tuple(Panel(azimuth_deg=azimuth) for azimuth in azimuths),
    )  # fmt: skip
    effort = Effort(blocks=64, log2_paths=7)
    pair = [
        trace(slab(2.0, 0.7, 1.5), panels_setup(bench, 1.0), effort, seed=seed)
        .blocks_by_albedo(WHITE, ALBEDO[1:])
        .sum(axis=2)
        for seed, bench in enumerate((BARE, other))
    ]
    assert np.all(np.abs(z_between(*pair)) < 4.5)
    dimmer = 0.9 * pair[1]
    assert np.all(np.abs(z_between(pair[0], dimmer)) > 4.5)


def test_one_panel_gives_the_same_radiance_factor_as_two() -> None:
    """By symmetry, and because the reference is lit by the same panels."""
    single = Bench(covers_above=(), covers_below=(), panels=(Panel(),))
    effort = Effort(blocks=64, log2_paths=8)
    pair = [
        trace(
            slab(2.0, 0.7, 1.5), panels_setup(bench, 1.0), effort, seed=seed + 5
        ).blocks_by_albedo(BLACK, ALBEDO[1:])[:, :, 0]
        for seed, bench in enumerate((BARE, single))
    ]
    assert np.all(np.abs(z_between(*pair)) < 4.5)


def test_a_smaller_sample_loses_light() -> None:
    small = BARE.model_copy(update={"size_mm": (6.0, 6.0)})
    effort = Effort(blocks=64, log2_paths=7)
    values = []
    for bench in (BARE, small):
        tallies = trace(slab(1.0, 0.0, 1.5, 2.0), panels_setup(bench, 2.0), effort)
        blocks = tallies.blocks_by_albedo(WHITE, np.array([0.99]))[:, 0] @ 0.99**tallies.bounce
        values.append(mean_and_error(blocks))
    (large, error), (lost, other) = values
    assert large - lost > 4.5 * np.hypot(error, other)
