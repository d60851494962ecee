from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from twin.optics import (
    Slab,
    add,
    attenuating,
    fresnel_unpolarised,
    layer_transmittance,
    sigma_t_from_transmittance,
    snell_cosine,
    stack,
    stack_transmittance,
    windows,
)

INDEX = st.floats(1.0, 2.5)
DEPTH = st.floats(0.0, 5.0)
COSINE = st.floats(0.05, 1.0)


def test_a_face_of_glass_reflects_four_percent() -> None:
    assert fresnel_unpolarised(1.0, 1.5, 1.0) == pytest.approx(0.04)


def test_a_clear_slab_of_glass_transmits_as_published() -> None:
    # (1 - R) / (1 + R) with R = 0.04: 0.9231 in every textbook.
    slab = stack([1.5], [0.0])
    assert slab.transmittance_up == pytest.approx(0.96 / 1.04)
    assert slab.reflectance_above == pytest.approx(2 * 0.04 / 1.04)


def test_light_at_brewsters_angle_loses_half_of_the_perpendicular_part() -> None:
    cosine = np.cos(np.arctan(1.5))
    perpendicular = ((1 - 1.5**2) / (1 + 1.5**2)) ** 2
    assert fresnel_unpolarised(1.0, 1.5, cosine) == pytest.approx(0.5 * perpendicular)


def test_beyond_the_critical_angle_everything_is_reflected() -> None:
    cosine = np.cos(np.radians(45.0))  # the critical angle of glass is 41.8 degrees
    assert fresnel_unpolarised(1.5, 1.0, cosine) == 1.0
    assert snell_cosine(1.5, 1.0, cosine) == 0.0
    assert fresnel_unpolarised(1.5, 1.0, np.cos(np.radians(41.0))) < 1.0


def test_a_matched_face_is_no_face_even_at_grazing_incidence() -> None:
    assert fresnel_unpolarised(1.5, 1.5, [0.0, 0.3, 1.0]).tolist() == [0.0, 0.0, 0.0]


@given(INDEX, INDEX, COSINE)
def test_a_face_reflects_alike_from_both_sides(n1: float, n2: float, cosine: float) -> None:
    refracted = snell_cosine(n1, n2, cosine)
    if refracted > 0:
        there = fresnel_unpolarised(n1, n2, cosine)
        assert fresnel_unpolarised(n2, n1, refracted) == pytest.approx(there, abs=1e-9)


@given(st.lists(INDEX, min_size=1, max_size=4), COSINE)
def test_a_clear_stack_keeps_the_energy(n: list[float], cosine: float) -> None:
    slab = stack(n, [0.0] * len(n), cosine=cosine)
    assert slab.reflectance_above + slab.transmittance_down == pytest.approx(1.0)


@given(st.lists(st.tuples(INDEX, DEPTH), min_size=1, max_size=4), COSINE)
def test_an_absorbing_stack_transmits_alike_both_ways(
    layers: list[tuple[float, float]], cosine: float
) -> None:
    slab = stack([n for n, _ in layers], [depth for _, depth in layers], cosine=cosine)
    assert slab.transmittance_down == pytest.approx(slab.transmittance_up, abs=1e-12)
    assert slab.reflectance_above + slab.transmittance_down <= 1.0 + 1e-12


def test_adding_is_associative() -> None:
    parts = [stack([1.3], [0.2]), stack([1.7, 1.5], [0.4, 0.1]), attenuating(0.6)]
    left = add(add(parts[0], parts[1]), parts[2])
    right = add(parts[0], add(parts[1], parts[2]))
    np.testing.assert_allclose(left, right, rtol=1e-14)


def test_adding_reversed_stacks_reverses_the_result() -> None:
    one, two = stack([1.3], [0.2]), stack([1.7], [0.9])

    def flipped(slab: Slab) -> Slab:
        return Slab(slab[2], slab[3], slab[0], slab[1])

    np.testing.assert_allclose(add(flipped(two), flipped(one)), flipped(add(one, two)), rtol=1e-14)


@given(INDEX, INDEX, st.floats(1e-6, 1.0))
def test_the_window_form_is_the_stack(n: float, cover: float, share: float) -> None:
    around = windows(n, [cover], [cover])
    whole = stack([cover, n, cover], [0.0, -np.log(share), 0.0])
    assert stack_transmittance(share, around) == pytest.approx(float(whole.transmittance_up))
    assert layer_transmittance(whole.transmittance_up, around) == pytest.approx(share)


@given(st.floats(0.01, 20.0), st.floats(0.1, 2.0))
def test_sigma_t_comes_back_with_its_slope(sigma_t: float, thickness: float) -> None:
    around = windows(1.5, [1.52], [1.52])
    total = stack_transmittance(np.exp(-sigma_t * thickness), around)
    found, slope = sigma_t_from_transmittance(total, thickness, around)
    assert found == pytest.approx(sigma_t, rel=1e-9)
    step = 1e-6 * total
    there, _ = sigma_t_from_transmittance(total + step, thickness, around)
    assert slope == pytest.approx((there - found) / step, rel=1e-4)


def test_no_light_gives_no_extinction() -> None:
    sigma_t, slope = sigma_t_from_transmittance([0.0, -1e-4], 1.0, windows(1.5))
    assert np.isnan(sigma_t).all()
    assert np.isnan(slope).all()


def test_unequal_lists_are_refused() -> None:
    with pytest.raises(ValueError, match="as many of each"):
        stack([1.5, 1.3], [0.0])
