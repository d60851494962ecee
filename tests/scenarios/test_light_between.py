"""Light between the wavelengths of its transport: exact where known, honest in between."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from scenarios import load_scenario
from scenarios.light_between import LightBetween
from twin.materials import optical_properties
from twin.spectra import FloatArray
from twin.transport import NoiselessCaptures

DENSE = np.arange(390.0, 710.5, 1.0)


@lru_cache(maxsize=1)
def fast_engine() -> FloatArray:
    """Captures (S, 3, W) of the default ink by adding-doubling, which has no noise."""
    from twin.adding_doubling import captures_model

    scenario = load_scenario("default")
    found = optical_properties("demo_ink", DENSE)
    model = captures_model(scenario.bench, scenario.samples, DENSE)
    parameters = model.parameters(found.albedo, found.sigma_t_per_mm, found.g)
    captures = np.array(model.forward(parameters)).transpose(1, 2, 0)
    # Light scattered into the aperture, which this engine leaves out.
    captures[:, 2] *= 1.0 + 0.02 * found.albedo * found.sigma_t_per_mm
    return captures


def world(number: int, wavelength: FloatArray) -> FloatArray:
    """Black, white and collimated at some of the wavelengths, shape (3, W)."""
    return fast_engine()[number][:, np.searchsorted(DENSE, wavelength)]


def between(number: int, step: int, noise: float = 0.0) -> LightBetween:
    scenario = load_scenario("default")
    grid = DENSE[::step]
    light = world(number, grid)
    random = np.random.Generator(np.random.Philox(key=[1, number]))
    error = noise * light
    black, white, collimated = light + error * random.standard_normal(light.shape)
    return LightBetween(
        scenario.bench,
        scenario.samples[number],
        NoiselessCaptures(
            wavelength_nm=grid,
            black=black,
            white=white,
            collimated=collimated,
            black_se=error[0],
            white_se=error[1],
            collimated_se=error[2],
            white_reference_factor=1.0,
            rho_black=np.zeros(grid.size),
            rho_white=np.ones(grid.size),
        ),
    )


def test_at_the_wavelengths_of_the_transport_its_own_values_are_returned() -> None:
    light = between(0, 20)
    found = light.intensities(light.noiseless.wavelength_nm)
    np.testing.assert_allclose(found, world(0, light.noiseless.wavelength_nm), rtol=1e-12)


@pytest.mark.parametrize("number", [0, 1])
@pytest.mark.parametrize("step", [5, 10, 20])
def test_between_them_the_error_is_as_large_as_stated(number: int, step: int) -> None:
    light = between(number, step)
    off = light.intensities(DENSE) - world(number, DENSE)
    size = np.sqrt(np.mean(off**2, axis=1))
    stated = np.sqrt(np.mean(light.standard_error(DENSE) ** 2, axis=1))
    # Bands narrower than two steps of 20 nm show in part only.
    assert np.all(stated > (0.6 if step < 20 else 0.2) * size)
    assert np.all(stated < 6.0 * size)


@pytest.mark.parametrize("step", [5, 20])
def test_the_closed_forms_serve_better_than_the_intensities_alone(step: int) -> None:
    from scipy.interpolate import PchipInterpolator

    light, exact = between(1, step), world(1, DENSE)
    plain = PchipInterpolator(DENSE[::step], exact[:, ::step], axis=1)(DENSE) - exact
    ours = light.intensities(DENSE) - exact
    assert np.all(np.mean(ours**2, axis=1) < 0.5 * np.mean(plain**2, axis=1))


def test_noise_of_the_transport_stays_most_of_the_error_it_causes() -> None:
    light = between(0, 5, noise=0.01)
    grid = light.noiseless.wavelength_nm
    own = np.stack([light.noiseless.black_se, light.noiseless.white_se])
    stated = light.standard_error(grid)[:2]
    assert np.all(stated >= own)
    assert np.median(stated / own) < 1.15


def test_two_wavelengths_are_enough() -> None:
    light = between(0, 320)
    assert np.all(np.isfinite(light.intensities(DENSE)))
    assert np.all(light.standard_error(DENSE) == 0.0)
