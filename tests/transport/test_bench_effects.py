"""Effects that a bench may have: off-axis sample, tilted beam, glossy background, uneven panels."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.transport.scenes import BARE, CHEAP, ENDLESS, far_panels, slab, z_between, z_score
from twin.adding_doubling import captures_model
from twin.bench import Background, Beam, Bench, Medium, Panel, Sample
from twin.errors import InputError
from twin.materials import OpticalProperties, optical_properties
from twin.transport import (
    Effort,
    FlatStack,
    Setup,
    beam_setup,
    captures,
    flat_stacks,
    mean_and_error,
    panels_setup,
    reference_factor,
    stack_transfer,
    trace,
)
from twin.transport.engine import BLACK, UNBOUNDED_STACK, WHITE

DOWN = 1
ALBEDO = np.array([0.5, 0.95])
NOMINAL = np.array([550.0])
SAMPLE = Sample(name="s", thickness_mm=1.0, n=1.5)


def medium(sigma_t: float, g: float = 0.0, albedo: float = 0.9, **second: float):
    return OpticalProperties(
        NOMINAL, np.array([albedo]), np.array([sigma_t]), np.array([g]), None, **second
    )


# off the axis


def over_white(offset: tuple[float, float], seed: int) -> np.ndarray:
    bench = Bench(covers_above=(), covers_below=(), size_mm=(12.0, 12.0), offset_mm=offset)
    stack = flat_stacks(bench, SAMPLE, NOMINAL, medium(0.5, 0.8))[0]
    tallies = trace(stack, panels_setup(bench, 1.0), Effort(64, 9), seed=seed)
    return tallies.blocks_by_albedo(WHITE, np.array([0.999]))[:, 0] @ 0.99**tallies.bounce


def test_a_sample_off_centre_loses_more_and_the_same_to_both_sides() -> None:
    centred, left, right = (over_white(x, s) for x, s in (((0, 0), 1), ((-4, 0), 2), ((4, 0), 3)))
    assert abs(z_between(left, right)) < 4.5
    assert z_between(centred, right) > 4.5


def test_a_long_way_off_the_axis_of_an_endless_sample_is_nowhere() -> None:
    bench = BARE.model_copy(update={"size_mm": (1e7, 1e7)})
    moved = bench.model_copy(update={"offset_mm": (50.0, -80.0)})
    stack = slab(2.0, 0.5, 1.4)
    own = trace(stack, panels_setup(bench, 1.0, turned=False), Effort(8, 6), seed=4).value
    np.testing.assert_array_equal(
        own, trace(stack, panels_setup(moved, 1.0), Effort(8, 6), seed=4).value
    )


def test_the_sample_must_cover_the_spots() -> None:
    Bench(offset_mm=(17.9, 0.0))
    with pytest.raises(ValueError, match="off the axis"):
        Bench(offset_mm=(18.1, 0.0))
    assert "off the axis" in " ".join(
        captures_model(Bench(offset_mm=(3.0, 0.0)), [SAMPLE], 550.0).not_represented
    )


# beam


@pytest.mark.parametrize("tilt", [0.6, 9.0])
def test_a_tilted_beam_goes_a_longer_way(tilt: float) -> None:
    wide = Bench().detector.model_copy(update={"acceptance_deg": 10.0})
    bench = BARE.model_copy(update={"beam": Beam(tilt_deg=tilt), "detector": wide})
    found = captures(bench, SAMPLE, NOMINAL, properties=medium(3.0, albedo=0.0), paths=512)
    stack = flat_stacks(bench, SAMPLE, NOMINAL, medium(3.0))[0]
    expected, _ = stack_transfer(stack, np.array([math.cos(math.radians(tilt))]), from_below=True)
    assert found.collimated == pytest.approx(expected, rel=2e-5)
    straight, _ = stack_transfer(stack, np.ones(1), from_below=True)
    assert abs(found.collimated / straight - 1.0) > 2.0 * abs(expected / straight - 1.0) / 3.0


def test_a_beam_outside_the_acceptance_is_refused_and_half_a_beam_is_half() -> None:
    with pytest.raises(InputError, match="collects nothing"):
        captures(
            BARE.model_copy(update={"beam": Beam(tilt_deg=1.2)}), SAMPLE, NOMINAL,
            properties=medium(1.0), paths=512,
        )  # fmt: skip
    # a cone of 1 degree around an axis at 1 degree: a lens-shaped part of it is accepted
    from twin.transport.geometry import beam_reference_share

    bench = BARE.model_copy(update={"beam": Beam(divergence_deg=1.0, tilt_deg=1.0)})
    lens = 2.0 / 3.0 - math.sqrt(3.0) / (2.0 * math.pi)
    assert beam_reference_share(bench, 1.0) == pytest.approx(lens, abs=2e-4)
    tiny = BARE.model_copy(update={"beam": Beam(divergence_deg=0.7, tilt_deg=1e-9)})
    whole = BARE.model_copy(update={"beam": Beam(divergence_deg=0.7)})
    assert beam_reference_share(tiny, 1.0) == beam_reference_share(whole, 1.0) == 1.0
    clear = captures(bench, SAMPLE, NOMINAL, properties=medium(1.0, albedo=0.0), paths=2**15)
    assert clear.collimated[0] == pytest.approx(0.96**2 * math.exp(-1.0), rel=0.02)


def test_a_cone_wider_than_the_acceptance_is_collected_by_solid_angle() -> None:
    from twin.transport.geometry import beam_reference_share

    accepted = math.sin(math.radians(BARE.detector.acceptance_deg)) ** 2
    for divergence in (1.01, 1.5, 4.56, 6.0):
        bench = BARE.model_copy(update={"beam": Beam(divergence_deg=divergence)})
        expected = accepted / math.sin(math.radians(divergence)) ** 2
        assert beam_reference_share(bench, 1.0) == pytest.approx(expected, rel=1e-9)


# gloss


@pytest.mark.parametrize("g", [0.0, 0.7])
def test_over_a_mirror_a_slab_is_one_of_twice_its_thickness(g: float) -> None:
    """Matched index, no gap: what would have gone through the double slab comes back."""
    effort = replace(CHEAP, log2_paths=9)
    mirror = Setup(up="hemisphere", black=ENDLESS, black_gloss=1.0)
    single = trace(slab(1.0, g), mirror, effort, seed=5)
    lambert = trace(slab(1.0, g), replace(mirror, black_gloss=0.0), effort, seed=6)
    both = trace(
        slab(1.0, g, thickness_mm=2.0), Setup(up="hemisphere", down="hemisphere"), effort, seed=7
    )
    double = sum(both.blocks_by_albedo(side, ALBEDO).sum(axis=2) for side in (BLACK, DOWN))
    folded = single.blocks_by_albedo(BLACK, ALBEDO).sum(axis=2)
    assert np.all(np.abs(z_between(folded, double)) < 4.5)
    control = lambert.blocks_by_albedo(BLACK, ALBEDO).sum(axis=2)
    assert np.max(np.abs(z_between(control, double))) > 4.5


def scattered_once_at_a_mirror(panels: tuple, sigma: float, g: float) -> float:
    """Matched slab of 1 mm on a mirror, seen along the normal: before the mirror or after it.

    Radiance along the normal per radiance of the panels, for an albedo of 1.
    """
    nodes, weights = np.polynomial.legendre.leggauss(24)
    depth = np.linspace(0.0, 1.0, 801)
    total = 0.0
    for panel in panels:
        a, b = np.meshgrid(nodes * panel.half[0], nodes * panel.half[1], indexing="ij")
        area = np.outer(weights, weights) * panel.half[0] * panel.half[1]
        points = np.array(panel.centre) + np.multiply.outer(a, panel.u)
        points = points + np.multiply.outer(b, panel.v)
        distance = np.linalg.norm(points, axis=-1)
        cosine = (points[..., 2] / distance)[..., None]
        angle = area * -(points @ np.array(panel.normal)) / distance**3
        phase = (1 - g * g) / (4 * math.pi * (1 + g * g - 2 * g * cosine) ** 1.5)
        after = np.exp(-sigma * (depth + (2.0 - depth) / cosine))
        before = np.exp(-sigma * (2.0 - depth + depth / cosine))
        way = np.trapezoid(phase * (after + before), depth, axis=-1)
        total += sigma * float(np.sum(angle * way))
    return total


def test_mirror_and_panels_in_closed_form() -> None:
    """One scattering and one mirror."""
    sigma, g = 0.8, 0.5
    far = far_panels(half_mm=2.5e5)
    setup = replace(far, black=ENDLESS, white=ENDLESS, black_gloss=1.0, white_gloss=0.25)
    tallies = trace(slab(sigma, g), setup, Effort(64, 11), seed=8)
    expected = far.panel_scale * scattered_once_at_a_mirror(far.panels, sigma, g)
    found = tallies.value[:, BLACK, 1, 1]
    assert abs(z_score(found, expected)) < 4.5
    assert abs(z_score(found, 1.05 * expected)) > 4.5
    # the other background's mirror is a quarter of that; its diffuse share comes on top
    diffuse = trace(slab(sigma, g), replace(setup, white_gloss=0.0), Effort(64, 11), seed=9)
    mixed = 0.25 * expected + 0.75 * diffuse.value[:, WHITE, 1, 1]
    assert abs(z_between(tallies.value[:, WHITE, 1, 1], mixed)) < 4.5
    assert abs(z_between(tallies.value[:, WHITE, 1, 1], diffuse.value[:, WHITE, 1, 1])) > 4.5


def test_half_a_mirror_keeps_all_light() -> None:
    setup = Setup(up="hemisphere", black=ENDLESS, gap=0.3, black_gloss=0.4)
    tallies = trace(slab(1.0, 0.3, 1.5), setup, replace(CHEAP, log2_paths=9), seed=10)
    mean, error = tallies.estimate(BLACK, np.ones(1), 1.0)
    assert abs(mean[0] - 1.0) < 4.5 * error[0] + 1e-3
    lost, _ = tallies.estimate(BLACK, np.ones(1), 0.9)
    assert lost[0] < 0.99


def test_gloss_alone_takes_its_share_of_the_white() -> None:
    """Seen along the normal, lit at 45 degrees: nothing of the mirror's share comes back."""
    white = Background(reflectance="spectralon", gloss=0.2)
    backgrounds = BARE.background.model_copy(update={"white": white})
    glossy = BARE.model_copy(update={"background": backgrounds})
    nothing = Sample(name="air", thickness_mm=1.0, n=1.0)
    found, plain = (
        captures(bench, nothing, NOMINAL, properties=medium(1e-6), paths=4096)
        for bench in (glossy, BARE)
    )
    assert found.white == pytest.approx(0.8 * plain.white, rel=1e-3)
    np.testing.assert_array_equal(found.white_reference_factor, plain.white_reference_factor)


def test_a_paired_trace_refuses_gloss() -> None:
    setup = Setup(up="panels", panels=far_panels().panels, black=ENDLESS, black_gloss=0.1)
    with pytest.raises(ValueError, match="glossy"):
        trace(slab(1.0), setup, Effort(paired=True))


# panels

UNEVEN = (Panel(level=2.0, gradient=0.5), Panel(azimuth_deg=180.0, polar_deg=30.0, gradient=-0.3))


def test_uneven_panels_agree_with_adding_doubling() -> None:
    def bench_of(panels: tuple[Panel, ...]) -> Bench:
        return Bench(panels=panels, covers_above=(), covers_below=())

    properties = medium(2.0, 0.6)
    bench = bench_of(UNEVEN)
    stack = flat_stacks(bench, SAMPLE, NOMINAL, properties)[0]
    effort = Effort(blocks=64, log2_paths=9, paired=True)
    tallies = trace(stack, panels_setup(bench, stack.height), effort, seed=11)
    blocks = tallies.blocks_by_albedo(UNBOUNDED_STACK, np.array([0.9]))[:, 0] @ 0.98**tallies.bounce
    mean, error = mean_and_error(blocks)
    even = tuple(panel.model_copy(update={"level": 1.0, "gradient": 0.0}) for panel in UNEVEN)
    z = []
    for panels in (UNEVEN, even):
        model = captures_model(bench_of(panels), [SAMPLE], NOMINAL)
        parts = model.parts(model.parameters(0.9, 2.0, 0.6))
        direct, once, returned = (float(np.asarray(part)[0, 0]) for part in parts[:3])
        z.append(abs(mean - direct - 0.98 * once / (1.0 - 0.98 * returned)) / error)
    assert z[0] < 4.5 < z[1]


def test_a_white_looks_white_under_uneven_panels() -> None:
    """The reference sees the panels as the white sample does; a common level cancels."""
    nothing = Sample(name="air", thickness_mm=1.0, n=1.0)

    def white(panels: tuple[Panel, ...]) -> float:
        bench = Bench(panels=panels, covers_above=(), covers_below=())
        return float(
            captures(bench, nothing, NOMINAL, properties=medium(1e-6), paths=8192).white[0]
        )

    assert white(UNEVEN) == pytest.approx(white((Panel(), Panel(azimuth_deg=180.0))), rel=2e-3)
    twice = (Panel(level=2.0), Panel(azimuth_deg=180.0, level=2.0))
    assert white(twice) == pytest.approx(white(Bench().panels), rel=1e-6)
    uneven = reference_factor(Bench(panels=UNEVEN), -1.0)
    assert uneven > 1.2 * reference_factor(Bench(), -1.0)


# descriptions


def test_effects_that_are_off_are_not_written_down() -> None:
    assert "gloss" not in Bench().model_dump_json()
    assert set(Bench().model_dump()) == set(Bench.model_fields) - {"offset_mm", "effects"}
    assert "second_g" not in Medium(albedo=0.5, sigma_t_per_mm=1.0).model_dump()
    on = Bench(offset_mm=(1.0, 0.0), beam=Beam(tilt_deg=-0.5), panels=UNEVEN)
    assert Bench.model_validate_json(on.model_dump_json()) == on
    assert on.model_dump()["beam"]["tilt_deg"] == -0.5


def test_a_second_lobe_without_room_for_the_first_is_refused() -> None:
    with pytest.raises(InputError, match="first lobe"):
        optical_properties(
            Medium(albedo=0.5, sigma_t_per_mm=1.0, g=0.95, second_share=0.2), NOMINAL
        )
    with pytest.raises(InputError, match="first lobe"):
        flat_stacks(BARE, SAMPLE, NOMINAL, medium(1.0, 0.9, second_share=0.3, second_g=-0.5))
    with pytest.raises(ValueError, match="second_share"):
        Medium(albedo=0.5, sigma_t_per_mm=1.0, second_share=1.0)


def test_two_lobes_keep_the_mean_cosine_and_the_slope_over_g() -> None:
    """Mean cosine of a chain of draws, and score functions against differences."""
    own = medium(1.5, 0.5, 0.9, second_share=0.2, second_g=-0.4)
    assert 0.8 * own.first_g[0] + 0.2 * -0.4 == pytest.approx(0.5, abs=1e-12)
    setup = beam_setup(BARE)
    effort = Effort(blocks=64, log2_paths=10, lattice=False, common=True)

    def stack(g: float) -> FlatStack:
        return flat_stacks(BARE, SAMPLE, NOMINAL, replace(own, g=np.array([g])))[0]

    def blocks(g: float) -> np.ndarray:
        return trace(stack(g), setup, effort, seed=12).blocks_by_albedo(BLACK, ALBEDO).sum(axis=2)

    difference = (blocks(0.503) - blocks(0.497)) / 0.006
    tallies = trace(stack(0.5), setup, replace(effort, derivatives=True), seed=13)
    slopes = tallies.blocks_by_albedo(BLACK, ALBEDO, tallies.d_g).sum(axis=2)
    assert np.all(np.abs(z_between(difference, slopes)) < 4.5)
    assert np.any(np.abs(z_between(difference, -slopes)) > 4.5)
