"""The simulated world of a stress test: the twin's light, the instrument's noise."""

from __future__ import annotations

import numpy as np
import pytest

from scenarios.stress.light import FIELDS, light_of
from scenarios.stress.plan import Light
from scenarios.stress.simulate import samples_of, take, visit_bench, visit_wavelengths
from tests.stress.tiny import tiny_plan
from twin.bench import Bench
from twin.materials import OpticalProperties
from twin.transport import NoiselessCaptures, captures

MATERIAL = np.array(
    [[0.3, 1.0, 0.2], [0.8, 1.0, 0.2], [0.97, 1.0, 0.2], [0.5, 4.0, 0.7], [0.9, 4.0, 0.7]]
)
LIGHT = Light(relative_error=0.01, most_paths=1 << 14)
PLAN = tiny_plan(thickness_mm=[0.4])
SAMPLE = samples_of(PLAN)[0]


def light(bench: Bench, material: np.ndarray, seed: int = 1) -> NoiselessCaptures:
    wavelength = visit_wavelengths(visit_bench(bench, len(material)))
    return light_of(bench, SAMPLE, wavelength, material, LIGHT, seed=seed)


def worst(one: NoiselessCaptures, other: NoiselessCaptures) -> float:
    """Greatest difference in combined standard errors."""
    found = [
        np.abs(getattr(one, name) - getattr(other, name))
        / np.hypot(getattr(one, f"{name}_se"), getattr(other, f"{name}_se"))
        for name in FIELDS[:3]
    ]
    return float(np.max(found))


@pytest.fixture(scope="module")
def own() -> NoiselessCaptures:
    return light(Bench(), MATERIAL)


def test_shared_paths_give_the_light_of_the_twin(own: NoiselessCaptures):
    albedo, sigma_t, g = MATERIAL.T
    medium = OpticalProperties(own.wavelength_nm, albedo, sigma_t, g, None)
    twin = captures(Bench(), SAMPLE, own.wavelength_nm, properties=medium, paths=1 << 14, seed=5)
    assert worst(own, twin) < 4.5
    assert own.white_reference_factor == twin.white_reference_factor
    assert np.array_equal(own.rho_black, twin.rho_black)


def test_another_material_fails_that_check(own: NoiselessCaptures):
    assert worst(own, light(Bench(), MATERIAL * [1.0, 1.1, 1.0])) > 4.5


def test_the_light_depends_on_the_seed_and_on_nothing_else(own: NoiselessCaptures):
    again, other = light(Bench(), MATERIAL), light(Bench(), MATERIAL, seed=2)
    assert all(getattr(own, f).tobytes() == getattr(again, f).tobytes() for f in FIELDS)
    assert not np.any(own.black == other.black)


def exact(count: int) -> NoiselessCaptures:
    """Light of one material everywhere, without an error of its own."""
    wavelength = visit_wavelengths(visit_bench(Bench(), count))
    value = dict(zip(FIELDS, np.array([0.2, 0.5, 0.4, 0, 0, 0]), strict=True))
    full = {name: np.full(count, number) for name, number in value.items()}
    rho = np.full(count, 0.04), np.full(count, 0.99)
    return NoiselessCaptures(
        wavelength_nm=wavelength,
        rho_black=rho[0],
        rho_white=rho[1],
        white_reference_factor=0.3,
        **full,
    )


def noisy(level: float, count: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """Errors and stated standard errors of the intensities, shape (3, W) each."""
    material = np.tile([0.8, 2.0, 0.5], (count, 1))
    bench = visit_bench(Bench(), count, level)
    taken = take(PLAN, bench, material, [exact(count)], seed=11).intensities
    assert taken.valid.all()
    return taken.value[0] - np.array([[0.2], [0.5], [0.4]]), taken.sigma[0]


def test_errors_are_as_large_as_stated_and_independent_between_points():
    error, sigma = noisy(1.0)
    z = error / sigma
    # 180 squares of mean 1; the three captures of a point share their lamp.
    assert 0.7 < np.mean(z**2) < 1.35
    # A drift common to all points would move the mean by about one.
    assert np.abs(z.mean(axis=1)).max() < 4 / np.sqrt(60)
    wrong = error / (0.5 * sigma)
    assert np.mean(wrong**2) > 1.35


def test_the_noise_level_multiplies_the_standard_errors():
    one, three = noisy(1.0)[1], noisy(3.0)[1]
    ratio = three / one
    assert np.abs(np.median(ratio) - 3.0) < 0.03
    # Rounding to whole counts stays as it is: a part of what is left where there is little light.
    assert ratio.min() > 2.6
    assert ratio.max() < 3.2


def test_neighbouring_materials_do_not_mix():
    bench = visit_bench(Bench(), 7)
    assert not bench.instrument.has("bandwidth")
    wavelength = visit_wavelengths(bench)
    assert wavelength.shape == (7,)
    original = Bench().instrument.wavelength_nm
    assert (wavelength[0], wavelength[-1]) == (original[0], original[-1])
