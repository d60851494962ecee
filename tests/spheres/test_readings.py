"""Formulas of the spheres against power balances, limits and other people's programs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from twin.errors import InputError
from twin.spheres import (
    IntegratingSphere,
    Lost,
    SampleLight,
    SphereSetup,
    Surfaces,
    cap_share,
    sphere_readings,
)

SPHERE = IntegratingSphere(200.0, 60.0, 30.0, 10.0, 0.95, 0.3)
LIGHT = SampleLight(0.45, 0.35, 0.5, 0.3, 0.04, 0.05)


def balance(
    sphere: IntegratingSphere, wall: float, third: float, sample: float
) -> tuple[np.ndarray, np.ndarray]:
    """Transfer matrix over (wall, third, sample, detector), and what each one lets out again.

    Entry (i, j): share of what leaves j that arrives at i. With a baffle, light between
    sample and detector lands on what is not the third port, that is, on the wall.
    """
    shares = np.array(
        [sphere.wall_share, sphere.third_share, sphere.sample_share, sphere.detector_share]
    )
    matrix = np.tile(shares[:, None], (1, 4))
    if sphere.baffle:
        for source in (2, 3):
            matrix[:, source] = [1.0 - sphere.third_share, sphere.third_share, 0.0, 0.0]
    return matrix, np.array([wall, third, sample, sphere.detector_reflectance])


@pytest.mark.parametrize("baffle", [True, False])
@pytest.mark.parametrize("third", [0.0, 0.99])
def test_gain_is_the_sum_over_all_bounces(baffle: bool, third: float) -> None:
    sphere = IntegratingSphere(200.0, 60.0, 30.0, 10.0, 0.95, 0.3, baffle)
    matrix, reflectance = balance(sphere, 0.95, third, 0.6)
    # one unit of diffuse light leaves the wall: what the detector gets, bounce by bounce
    leaving = np.array([1.0, 0.0, 0.0, 0.0])
    detected = 0.0
    for _ in range(3000):
        arriving = matrix @ leaving
        detected += arriving[3]
        leaving = reflectance * arriving
    gain = sphere.gain(0.6, 0.95, third)
    assert detected / sphere.detector_share == pytest.approx(gain, rel=1e-10)
    assert sphere.gain(0.5, 0.95, third) < gain * 0.999


def test_iadpythons_gains() -> None:
    """Its `gain` is the reciprocal with a baffle, its `multiplier` the one without."""
    iadpython = pytest.importorskip("iadpython")
    theirs = iadpython.Sphere(200, 60, 30, 10, 0.3, 0.95)
    assert theirs.a_sample == pytest.approx(SPHERE.sample_share, rel=1e-12)
    bare = IntegratingSphere(200.0, 60.0, 30.0, 10.0, 0.95, 0.3, baffle=False)
    for sample in (0.0, 0.3, 0.9):
        assert 1.0 / theirs.gain(sample) == pytest.approx(SPHERE.gain(sample, 0.95), rel=1e-9)
        assert theirs.multiplier(1.0, sample) == pytest.approx(bare.gain(sample, 0.95), rel=1e-9)


def test_gain_of_black_and_white_spheres() -> None:
    """Textbook limits: 1 for a black wall, total area over open ports for a white one."""
    closed = IntegratingSphere(200.0, 40.0, 0.0, 20.0, 1.0, 0.0, baffle=False)
    assert closed.gain(0.0, 0.0) == pytest.approx(1.0)
    open_area = closed.sample_share + closed.detector_share
    assert closed.gain(0.0, 1.0) == pytest.approx(1.0 / open_area)
    assert cap_share(200.0 * math.sin(0.3), 200.0) == pytest.approx((1 - math.cos(0.3)) / 2)


def one(sphere: IntegratingSphere, **how: object) -> SphereSetup:
    return SphereSetup(1, sphere, sphere, **how)  # type: ignore[arg-type]


def test_readings_of_no_sphere_and_of_two_beams_are_the_sample() -> None:
    surfaces = Surfaces(0.95, 0.95, 0.98)
    assert sphere_readings(SphereSetup(0), LIGHT, Lost(), surfaces) == pytest.approx((0.45, 0.35))
    dual = one(SPHERE, method="comparison")
    lost = Lost(0.01, 0.02, 0.5, 0.5)
    assert sphere_readings(dual, LIGHT, lost, surfaces) == pytest.approx((0.44, 0.33))
    dark = one(SPHERE, method="comparison", unscattered_in_r=0.0, unscattered_in_t=0.0)
    assert sphere_readings(dark, LIGHT, Lost(), surfaces) == pytest.approx((0.41, 0.30))


def test_an_ideal_sphere_reads_the_sample() -> None:
    """A port that is no part of the sphere changes no gain: M = R and M = T."""
    ideal = IntegratingSphere(1e5, 1.0, 0.0, 1.0, 0.98)
    light = LIGHT._replace(unscattered_reflectance=0.0)
    reading = sphere_readings(one(ideal), light, Lost(), Surfaces(0.98, 0.98, 0.9))
    assert reading == pytest.approx((0.45, 0.35), abs=1e-7)
    real = sphere_readings(one(SPHERE), light, Lost(), Surfaces(0.95, 0.95, 0.9))
    assert abs(real[0] - 0.45) > 0.01  # the substitution error
    assert real[1] > 0.35


@pytest.mark.parametrize("spheres", [1, 2])
@pytest.mark.parametrize("baffle", [True, False])
def test_standards_read_themselves(spheres: int, baffle: bool) -> None:
    sphere = IntegratingSphere(200.0, 60.0, 30.0, 10.0, 0.95, 0.0, baffle)
    setup = SphereSetup(spheres, sphere, sphere)
    surfaces = Surfaces(0.95, 0.93, 0.8, 1.0)
    standard = SampleLight(0.8, 0.0, 0.8, 0.0, 0.0, 0.0)
    assert sphere_readings(setup, standard, Lost(), surfaces) == pytest.approx((0.8, 0.0))
    nothing = SampleLight(0.0, 1.0, 0.0, 1.0, 0.0, 1.0)
    assert sphere_readings(setup, nothing, Lost(), surfaces)[1] == pytest.approx(1.0)


def test_two_spheres_are_the_sum_over_all_bounces() -> None:
    first = IntegratingSphere(200.0, 60.0, 30.0, 10.0, 0.95, 0.3)
    second = IntegratingSphere(150.0, 60.0, 20.0, 8.0, 0.9, 0.1)
    light, surfaces = LIGHT, Surfaces(0.95, 0.9, 0.85, 0.99)

    def detected(
        direct: tuple[float, float], specular: tuple[float, float], back: float, through: float
    ) -> np.ndarray:
        """Light on both detectors per port area, bounce by bounce."""
        one_, r_one = balance(first, 0.95, 0.0, back)
        two, r_two = balance(second, 0.9, 0.99, back)
        matrix = np.zeros((8, 8))
        matrix[:4, :4], matrix[4:, 4:] = one_, two
        reflect = np.diag(np.concatenate([r_one, r_two]))
        # what arrives at the sample in one sphere leaves it in the other
        reflect[6, 2] = reflect[2, 6] = through
        leaving = np.zeros(8)
        leaving[2], leaving[6] = direct
        # specular light meets the wall, unscattered light the third port
        leaving[0] += 0.95 * specular[0]
        leaving[5] += 0.99 * specular[1]
        total = np.zeros(2)
        for _ in range(4000):
            arriving = matrix @ leaving
            total += arriving[[3, 7]]
            leaving = reflect @ arriving
        return total / np.array([first.detector_share, second.detector_share])

    sample = detected((0.41, 0.30), (0.04, 0.05), 0.5, 0.3)
    standard = detected((0.85, 0.0), (0.0, 0.0), 0.85, 0.0)
    empty = detected((0.0, 0.0), (0.0, 1.0), 0.0, 1.0)
    reading = sphere_readings(SphereSetup(2, first, second), light, Lost(), surfaces)
    assert reading[0] == pytest.approx(0.85 * sample[0] / standard[0], rel=1e-9)
    assert reading[1] == pytest.approx(0.99 * sample[1] / empty[1], rel=1e-9)
    # IAD's code has the walls' areas where the loop needs their reflectances
    alone = sphere_readings(one(first), light, Lost(), surfaces)
    assert abs(alone[0] - reading[0]) > 1e-3


def test_spheres_that_exchange_nothing_are_single() -> None:
    surfaces = Surfaces(0.95, 0.95, 0.85)
    opaque = LIGHT._replace(diffuse_transmittance=0.0)
    single = sphere_readings(one(SPHERE), opaque, Lost(), surfaces)
    double = sphere_readings(SphereSetup(2, SPHERE, SPHERE), opaque, Lost(), surfaces)
    assert double[0] == pytest.approx(single[0], rel=1e-12)
    coupled = sphere_readings(SphereSetup(2, SPHERE, SPHERE), LIGHT, Lost(), surfaces)
    assert coupled[0] > single[0] * 1.001


@settings(max_examples=50, deadline=None, derandomize=True)
@given(
    back=st.floats(0.0, 1.0), share=st.floats(0.0, 1.0), wall=st.floats(0.0, 0.99),
    spheres=st.sampled_from([1, 2]),
)  # fmt: skip
def test_readings_grow_with_the_light_and_stay_finite(
    back: float, share: float, wall: float, spheres: int
) -> None:
    setup = SphereSetup(spheres, SPHERE, SPHERE)
    surfaces = Surfaces(max(wall, 0.01), max(wall, 0.01), 0.98)
    through = (1.0 - back) * share
    light = SampleLight(back, through, back, through, 0.0, 0.0)
    low = sphere_readings(setup, light, Lost(), surfaces)
    more = light._replace(reflectance=back + 0.01, transmittance=through + 0.01)
    high = sphere_readings(setup, more, Lost(), surfaces)
    assert all(0.0 <= value < 3.0 for value in low)
    assert high[0] > low[0]
    assert high[1] > low[1]


@pytest.mark.parametrize(
    ("how", "place"),
    [
        (lambda: IntegratingSphere(0.0, 1.0), "sphere"),
        (lambda: IntegratingSphere(100.0, 100.0), "sample_port_mm"),
        (lambda: IntegratingSphere(100.0, 10.0, wall_reflectance=1.1), "wall_reflectance"),
        (lambda: IntegratingSphere(100.0, 99.9, 99.9, 99.9), "ports"),
        (lambda: SphereSetup(3), "spheres"),
        (lambda: SphereSetup(1), "spheres"),
        (lambda: SphereSetup(2, SPHERE, SPHERE, "comparison"), "method"),
        (lambda: SphereSetup(0, unscattered_in_t=1.5), "unscattered_in_t"),
        (lambda: one(SPHERE, method="comparison", beam_on_wall=0.1), "beam_on_wall"),
    ],
)
def test_what_cannot_be_is_said(how: object, place: str) -> None:
    with pytest.raises(InputError) as caught:
        how()  # type: ignore[operator]
    assert caught.value.place == place
