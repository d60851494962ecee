"""The fast engine's answer to effects: closed forms, known sizes, and no new compilation."""

from __future__ import annotations

import numpy as np
import pytest

from tests.effects.worlds import WAVELENGTH, candidates, engine, material, samples, sharp, world
from twin.bench import Bench, Panel
from twin.effects import EffectEngine, World, expected_intensities
from twin.effects.fast import _program
from twin.materials import reflectance

BLACK, WHITE, COLLIMATED = range(3)
CLEAR = np.tile((0.0, 2.0, 0.0), (len(WAVELENGTH), 1))
ROUNDS = 2e-3
"""Light that goes forth and back between the faces again: left out of the closed forms."""


def relative(name: str, values: tuple[float, ...], at: np.ndarray) -> np.ndarray:
    """Relative change of the expected intensities."""
    own = candidates()[name]
    return engine().response(own, at, values) / engine().intensities(world(), at)


def test_thickness_follows_beer() -> None:
    change = relative("thickness[0.6 mm]", (0.02,), CLEAR)
    assert np.allclose(change[:, 1, COLLIMATED], np.expm1(-2.0 * 0.6 * 0.02), atol=ROUNDS * 0.1)
    assert np.all(change[:, 0] == 0.0), "the other sample is as it was"


def test_thickness_has_the_size_to_expect() -> None:
    """bench.md: +2 % gives I_black +0.6..1.9 % and I_white -1.3..0 %."""
    change = relative("thickness[0.6 mm]", (0.02,), material())
    assert np.all((change[:, 1, BLACK] > 0.0) & (change[:, 1, BLACK] < 0.019))
    assert change[-1, 1, BLACK] > 0.006
    assert np.all((change[:, 1, WHITE] > -0.025) & (change[:, 1, WHITE] < 0.0))


def test_wedge_averages_the_exponential() -> None:
    """Three nodes: 1/2 + 1/2 cosh(sigma_t slope a / sqrt 2), spot radius a of each lamp."""
    slope = 0.5
    change = relative("wedge[0.6 mm]", (slope,), CLEAR)
    expected = 0.5 * (np.cosh(2.0 * slope * 0.5 / np.sqrt(2.0)) - 1.0)
    assert np.allclose(change[:, 1, COLLIMATED], expected, rtol=0.02)


def test_wedge_is_even() -> None:
    one, two = (relative("wedge[0.6 mm]", (slope,), material()) for slope in (0.05, 0.1))
    assert np.allclose(two[:, 1], 4.0 * one[:, 1], rtol=0.05, atol=1e-6)


def test_black_level_adds_what_crosses_the_sample() -> None:
    """Kubelka 1954, layers: I_black and I_white lie on one curve over rho."""
    light = engine().intensities(world(), material())
    raised = engine().response(candidates()["black_level"], material(), (0.02,))
    rho = [reflectance(name, WAVELENGTH) for name in ("flocked_paper", "spectralon")]
    chord = (light[:, 1, WHITE] - light[:, 1, BLACK]) / (rho[1] - rho[0])
    share = raised[:, 1, BLACK] / (0.02 * chord)
    assert np.all((share > 0.2) & (share < 1.0)), "the curve over rho bends upwards"
    assert np.all(raised[..., WHITE:] == 0.0)


def test_black_level_has_the_size_to_expect() -> None:
    """bench.md: .02 -> .04 raises I_black by 0.3 to 15 %."""
    bench = Bench()
    black = bench.background.black.model_copy(update={"reflectance": 0.02})
    bench = bench.model_copy(
        update={"background": bench.background.model_copy(update={"black": black})}
    )
    own = EffectEngine(World.nominal(bench, samples(0.3, 0.6)), WAVELENGTH)
    raised = own.response(candidates()["black_level"], material(), (0.02,))
    change = raised[..., BLACK] / own.intensities(own.world, material())[..., BLACK]
    assert np.all((change > 0.003) & (change < 0.15))


def test_ageing_of_the_white_cancels_but_for_the_rounds() -> None:
    change = relative("white_ageing", (0.05, 0.0), material())
    assert np.allclose(change[..., BLACK], 1.0 / 0.95 - 1.0, rtol=1e-6), "over black: the reference"
    assert np.all(change[..., WHITE] < 1.0 / 0.95 - 1.0)
    assert np.allclose(change[..., COLLIMATED], 0.0, atol=1e-12)


def test_glasses_between_air_and_glass_take_light() -> None:
    change = relative("extra_covers", (1.0,), CLEAR)
    assert np.allclose(change[..., COLLIMATED], 0.92**2 - 1.0, atol=0.03), "two more plates"
    half = relative("extra_covers", (0.5,), CLEAR)
    assert np.allclose(half, 0.5 * change, rtol=1e-9), "half of the spot is half of the change"


def test_missing_covers_are_those_of_a_bare_bench() -> None:
    own = candidates()["missing_covers"].apply(world(), (1.0,))
    bare = World.nominal(Bench(covers_above=(), covers_below=()), world().samples)
    light = engine().light(own, material())
    assert np.allclose(light, engine().light(bare, material()), rtol=1e-12)


def test_covers_of_a_bare_bench_cannot_be_missing() -> None:
    bare = World.nominal(Bench(covers_above=(), covers_below=()), world().samples)
    assert candidates()["missing_covers"].effect.candidates(bare) == ()


def test_wider_acceptance_collects_forward_scattering() -> None:
    """bench.md: T / exp(-tau) at 5 degrees is 1.03 for g .4 and 1.13 for g .75 at tau 2.

    Those are for a matched index; faces of index 1.4 narrow the cone inside, which counts more
    the more forward the scattering is.

    """
    found = []
    for g in (0.4, 0.75):
        at = np.tile((1.0 - 1e-6, 2.0 / 0.6, g), (len(WAVELENGTH), 1))
        found.append(relative("aperture", (4.0,), at)[0, 1, COLLIMATED])
    assert found[0] == pytest.approx(0.03, rel=0.3)
    assert found[1] == pytest.approx(0.083, rel=0.2)


def test_phase_function_sends_more_back() -> None:
    """The second lobe at the same mean cosine moves thin samples' I_black by percents."""
    change = relative("phase_function", (0.1,), material())
    assert np.all(np.abs(change[..., BLACK]) > 0.005)
    assert np.all(np.abs(change[..., BLACK]) < 0.54)


def test_panels_at_another_angle_are_another_bench() -> None:
    moved = Bench(panels=(Panel(polar_deg=48.0), Panel(polar_deg=48.0, azimuth_deg=180.0)))
    other = World.nominal(moved, world().samples)
    own = candidates()["panel_angle"].apply(world(), (3.0,))
    light = engine().light(own, material())
    assert np.allclose(light, engine().light(other, material()), rtol=1e-12)
    assert not np.allclose(light, engine().light(world(), material()), rtol=1e-4)


def test_signatures_are_slopes_of_responses() -> None:
    for name in ("thickness[0.3 mm]", "refractive_index", "drift[white]", "black_level"):
        own = candidates()[name]
        slope = engine().signature(own, material())
        assert slope.shape == (len(own.parameters), len(WAVELENGTH), 2, 3)
        for number, parameter in enumerate(own.parameters):
            away = 0.02 * parameter.prior_scale
            change = engine().response(own, material(), {parameter.name: away})
            top = np.abs(slope[number]).max()
            assert np.allclose(slope[number], change / away, atol=0.02 * top), name


def test_nothing_is_compiled_again() -> None:
    """What effects change are constants: one program serves all benches of one form."""
    engine().light(world(), material())
    before = _program()._cache_size()
    for name in (
        "thickness[0.3 mm]", "wedge[0.3 mm]", "refractive_index", "panel_angle", "panel_distance",
        "black_level", "black_red", "white_ageing", "aperture", "drift[black]", "dark_offset",
    ):  # fmt: skip
        engine().signature(candidates()[name], material())
    assert _program()._cache_size() == before
    engine().light(candidates()["extra_covers"].apply(world(), (1.0,)), material())
    assert _program()._cache_size() >= before, "other covers may take a program of their own"


def test_a_world_without_changes_after_the_light_is_its_light() -> None:
    own = candidates()["thickness[0.3 mm]"].apply(sharp(), (0.02,))
    light = engine().light(own, material())
    assert np.array_equal(expected_intensities(own, light, WAVELENGTH), light)


@pytest.mark.parametrize("name", ["thickness[0.3 mm]", "refractive_index"])
def test_signature_works_on_another_world(name: str) -> None:
    drifted = candidates()["drift[panels]"].apply(world(), (0.1, 0.0))
    own = candidates()[name]
    plain = engine().signature(own, material())
    scaled = engine().signature(own, material(), drifted)
    assert np.allclose(scaled[..., :2], np.exp(0.1) * plain[..., :2], rtol=1e-6, atol=1e-9)
