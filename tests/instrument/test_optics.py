from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from twin.errors import InputError
from twin.instrument import (
    MultispectralChip,
    Spectrometer,
    band_average,
    electron_rates,
    fine_grid_nm,
    response_matrix,
)
from twin.spectra import SpectralTable

INSTRUMENTS = [
    Spectrometer(),
    Spectrometer(bandwidth_nm=9.0, step_nm=5.0),
    Spectrometer(off=("bandwidth",)),
    Spectrometer(pixels_nm=(555.0,)),
    MultispectralChip(),
    MultispectralChip(leak_fraction=0.4),
    MultispectralChip(off=("bandwidth", "stray_light")),
]


@pytest.mark.parametrize("instrument", INSTRUMENTS)
def test_a_constant_spectrum_stays_constant(instrument: Spectrometer | MultispectralChip) -> None:
    grid = fine_grid_nm(instrument)
    average = band_average(instrument, grid, np.full(grid.size, 0.37))
    np.testing.assert_allclose(average, 0.37, rtol=1e-12)


@pytest.mark.parametrize("instrument", INSTRUMENTS)
def test_responses_are_shares(instrument: Spectrometer | MultispectralChip) -> None:
    matrix = response_matrix(instrument, fine_grid_nm(instrument))
    assert matrix.shape[0] == len(instrument.wavelength_nm)
    assert matrix.min() >= 0
    np.testing.assert_allclose(matrix.sum(axis=1), 1.0, rtol=1e-12)


def test_a_line_becomes_a_gaussian_of_the_bandwidth() -> None:
    instrument = Spectrometer(bandwidth_nm=6.0, step_nm=1.0)
    grid = np.linspace(388.0, 712.0, 3241)
    line = np.zeros(grid.size)
    line[np.argmin(np.abs(grid - 550.0))] = 1.0
    seen = band_average(instrument, grid, line)
    pixels = np.asarray(instrument.wavelength_nm)
    expected = np.exp(-4 * np.log(2) * ((pixels - 550.0) / 6.0) ** 2)
    np.testing.assert_allclose(seen / seen.max(), expected, atol=1e-9)
    half = seen[np.argmin(np.abs(pixels - 553.0))] / seen.max()
    assert half == pytest.approx(0.5, rel=1e-9)


def test_gaussians_convolve_to_the_closed_form() -> None:
    instrument = Spectrometer(bandwidth_nm=8.0, step_nm=5.0)
    grid = fine_grid_nm(instrument)
    sigma, width = 20.0, 8.0 / np.sqrt(8 * np.log(2))
    seen = band_average(instrument, grid, np.exp(-0.5 * ((grid - 550.0) / sigma) ** 2))
    total = np.hypot(sigma, width)
    pixels = np.asarray(instrument.wavelength_nm)
    expected = sigma / total * np.exp(-0.5 * ((pixels - 550.0) / total) ** 2)
    # The responses end at two widths, which leaves 2.5e-6 of their area out.
    np.testing.assert_allclose(seen, expected, atol=5e-5)
    unconvolved = np.exp(-0.5 * ((pixels - 550.0) / sigma) ** 2)
    assert np.abs(seen - unconvolved).max() > 100 * 5e-5


def test_without_bandwidth_the_pixels_see_their_own_wavelength() -> None:
    instrument = Spectrometer(off=("bandwidth",), pixels_nm=(450.0, 511.0, 690.0))
    assert fine_grid_nm(instrument).tolist() == [450.0, 511.0, 690.0]
    np.testing.assert_array_equal(
        band_average(instrument, fine_grid_nm(instrument), [3.0, 1.0, 2.0]), [3.0, 1.0, 2.0]
    )
    grid = np.linspace(400.0, 700.0, 31)
    np.testing.assert_allclose(band_average(instrument, grid, 2 * grid), [900.0, 1022.0, 1380.0])


def test_the_chips_leak_is_the_mean_over_its_range() -> None:
    tight = MultispectralChip(off=("stray_light",))
    leaky = MultispectralChip(leak_fraction=0.25)
    grid = fine_grid_nm(leaky)
    spectrum = np.exp(-(((grid - 600.0) / 60.0) ** 2))
    mean = np.trapezoid(spectrum, grid) / (grid[-1] - grid[0])
    expected = 0.75 * band_average(tight, grid, spectrum) + 0.25 * mean
    np.testing.assert_allclose(band_average(leaky, grid, spectrum), expected, rtol=1e-12)


def test_a_table_replaces_a_channels_gaussian() -> None:
    table = SpectralTable(
        wavelength_nm=(380.0, 499.0, 500.0, 520.0, 521.0, 780.0), value=(0, 0, 1, 1, 0, 0)
    )
    chip = MultispectralChip.model_validate(
        {
            "channels": ({"name": "box", "centre_nm": 510.0, "fwhm_nm": 21.0, "response": table},),
            "leak_fraction": 0.0,
        }
    )
    grid = fine_grid_nm(chip)
    assert band_average(chip, grid, grid)[0] == pytest.approx(510.0, abs=1e-9)


@settings(deadline=None, derandomize=True, max_examples=40)
@given(
    scale=st.floats(1e-3, 1e3),
    centre=st.floats(420.0, 680.0),
    which=st.integers(0, len(INSTRUMENTS) - 1),
)
def test_rates_are_linear_and_scaled_by_the_reference(
    scale: float, centre: float, which: int
) -> None:
    instrument = INSTRUMENTS[which]
    grid = fine_grid_nm(instrument)
    lamp = 1.0 + np.exp(-(((grid - centre) / 30.0) ** 2))
    rates = electron_rates(
        instrument,
        grid,
        np.stack([lamp, 0.5 * lamp, np.zeros(grid.size)]) * scale,
        reference=lamp * scale,
        peak_rate_electrons_per_s=1e5,
    )
    assert rates[0].max() == pytest.approx(1e5, rel=1e-12)
    np.testing.assert_allclose(rates[1], rates[0] / 2, rtol=1e-12)
    assert np.all(rates[2] == 0)


def test_responsivity_and_sensitivity_shape_the_rates() -> None:
    table = SpectralTable(wavelength_nm=(300.0, 800.0), value=(0.5, 1.0))
    instrument = Spectrometer(responsivity=table, off=("bandwidth",))
    grid = fine_grid_nm(instrument)
    flat = np.ones(grid.size)
    rates = electron_rates(instrument, grid, flat, reference=flat, peak_rate_electrons_per_s=1e5)
    np.testing.assert_allclose(rates, 1e5 * (grid + 200.0) / 900.0)
    chip = MultispectralChip()
    grid = fine_grid_nm(chip)
    flat = np.ones(grid.size)
    rates = electron_rates(chip, grid, flat, reference=flat, peak_rate_electrons_per_s=1.0)
    np.testing.assert_allclose(rates, [channel.sensitivity for channel in chip.channels])


def test_a_weight_is_the_light_under_which_a_material_is_seen() -> None:
    chip = MultispectralChip()
    grid = fine_grid_nm(chip)
    lamp, material = np.exp(-grid / 100.0), grid / 1000.0
    seen = band_average(chip, grid, material, weight=lamp)
    ratio = band_average(chip, grid, lamp * material) / band_average(chip, grid, lamp)
    np.testing.assert_allclose(seen, ratio, rtol=1e-12)
    np.testing.assert_allclose(band_average(chip, grid, np.full(grid.size, 0.2), lamp), 0.2)


@pytest.mark.parametrize(
    ("grid", "said"),
    [
        (np.linspace(420.0, 700.0, 500), "396 to 704"),
        (np.linspace(390.0, 710.0, 50), "steps"),
        (np.linspace(710.0, 390.0, 500), "increase"),
        (np.array([[400.0]]), "shape"),
        (np.array([np.nan, 500.0]), "finite"),
    ],
)
def test_light_on_an_unfit_grid_is_refused(grid: np.ndarray, said: str) -> None:
    with pytest.raises(InputError, match=said):
        band_average(Spectrometer(), grid, np.ones(grid.shape))


def test_unfit_light_is_refused() -> None:
    instrument = Spectrometer()
    grid = fine_grid_nm(instrument)
    good = np.ones(grid.size)
    bad = good.copy()
    bad[3] = np.nan
    with pytest.raises(InputError, match="1 values in the spectrum"):
        band_average(instrument, grid, bad)
    with pytest.raises(InputError, match="463 wavelengths"):
        band_average(instrument, grid, good[:-1])
    with pytest.raises(InputError, match="weight"):
        band_average(instrument, grid, good, weight=np.zeros(grid.size))
    with pytest.raises(InputError, match="no light"):
        electron_rates(instrument, grid, good, reference=0 * good, peak_rate_electrons_per_s=1.0)
    with pytest.raises(InputError, match="negative"):
        electron_rates(instrument, grid, -good, reference=good, peak_rate_electrons_per_s=1.0)
    short = Spectrometer(responsivity=SpectralTable(wavelength_nm=(500, 600), value=(1, 1)))
    with pytest.raises(InputError, match="responsivity"):
        electron_rates(short, grid, good, reference=good, peak_rate_electrons_per_s=1.0)
