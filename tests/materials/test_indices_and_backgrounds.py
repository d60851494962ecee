"""Refractive indices, backgrounds and lamps against published values, and their error messages."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from twin.errors import InputError
from twin.materials import Entry, entry, lamp, names, reflectance, refractive_index
from twin.spectra import SpectralTable

E_LINE, D_LINE, F_LINE, C_LINE = 546.074, 587.562, 486.133, 656.273
VISIBLE = np.arange(380.0, 781.0, 5.0)


@pytest.mark.parametrize(
    ("name", "wavelength_nm", "published", "tolerance"),
    [
        ("glass_bk7", D_LINE, 1.51680, 1e-5),
        ("glass_bk7", E_LINE, 1.51872, 1e-5),
        ("glass_d263", D_LINE, 1.5230, 5e-4),
        ("glass_d263", E_LINE, 1.5255, 5e-4),
        ("fused_silica", D_LINE, 1.45846, 1e-5),
        ("fused_silica", 632.8, 1.45702, 1e-5),
        ("pmma", D_LINE, 1.4918, 1.5e-3),
        ("water", 589.3, 1.33334, 2e-5),
        ("immersion_oil", E_LINE, 1.5180, 1e-6),
        ("air", 589.3, 1.000277, 1e-6),
        ("pdms_rtv615", 633.0, 1.4283, 3e-4),
    ],
)
def test_an_index_has_its_published_value(
    name: str, wavelength_nm: float, published: float, tolerance: float
) -> None:
    assert refractive_index(name, [wavelength_nm])[0] == pytest.approx(published, abs=tolerance)


@pytest.mark.parametrize(("name", "abbe"), [("glass_bk7", 64.17), ("fused_silica", 67.82)])
def test_the_dispersion_has_the_published_abbe_number(name: str, abbe: float) -> None:
    n_f, n_d, n_c = refractive_index(name, [F_LINE, D_LINE, C_LINE])
    assert (n_d - 1) / (n_f - n_c) == pytest.approx(abbe, abs=0.02)


def test_the_immersion_oil_has_the_abbe_number_of_its_standard() -> None:
    n_f, n_e, n_c = refractive_index("immersion_oil", [479.99, 546.07, 643.85])
    assert (n_e - 1) / (n_f - n_c) == pytest.approx(44.0, abs=1e-6)


@pytest.mark.parametrize("name", names("refractive_index"))
def test_every_index_falls_with_wavelength_over_the_visible(name: str) -> None:
    index = refractive_index(name, VISIBLE)
    assert index.shape == VISIBLE.shape
    assert np.all(np.diff(index) < 0)
    assert index.min() >= 1.0


def test_pmma_is_the_record_of_refractiveindex_info(shared_data: Path) -> None:
    record = shared_data / "translucent" / "PMMA_Beadie_refractiveindex.yml"
    if not record.is_file():
        pytest.skip("no PMMA record among the reference data")
    line = next(line for line in record.read_text("utf-8").splitlines() if "coefficients:" in line)
    numbers = [float(word) for word in line.split(":")[1].split()]
    wavelength_nm = np.linspace(420.0, 1620.0, 61)
    square = np.full_like(wavelength_nm, numbers[0])
    for factor, power in zip(numbers[1::2], numbers[2::2], strict=True):
        square += factor * (wavelength_nm * 1e-3) ** power
    np.testing.assert_allclose(
        refractive_index("pmma", wavelength_nm), np.sqrt(square), rtol=0, atol=1e-12
    )


def test_spectralon_lies_within_the_uncertainty_of_a_calibrated_panel(shared_data: Path) -> None:
    record = shared_data / "translucent" / "spectralon_8h_calibration_350-2500nm.txt"
    if not record.is_file():
        pytest.skip("no Spectralon calibration among the reference data")
    wavelength_nm, calibrated, uncertainty = np.loadtxt(record).T
    inside = wavelength_nm <= 1000
    difference = reflectance("spectralon", wavelength_nm[inside]) - calibrated[inside]
    assert np.all(np.abs(difference) <= uncertainty[inside])
    ptfe = reflectance("ptfe", wavelength_nm[inside]) - calibrated[inside]
    assert np.all(np.abs(ptfe) > uncertainty[inside])


@pytest.mark.parametrize(
    ("name", "level"),
    [("spectralon", 0.99), ("ptfe", 0.92), ("flocked_paper", 0.02), ("black_foil", 0.05)],
)
def test_a_background_has_the_level_of_the_seed(name: str, level: float) -> None:
    found = entry("reflectance", name)
    assert isinstance(found, Entry)
    assert found.approximation
    np.testing.assert_allclose(reflectance(name, [450.0, 550.0, 650.0]), level)


def test_flocked_paper_alone_rises_beyond_650_nm() -> None:
    beyond = [650.0, 680.0, 720.0, 780.0]
    assert np.all(np.diff(reflectance("flocked_paper", beyond)) > 0)
    assert np.all(np.diff(reflectance("black_foil", beyond)) == 0)


@pytest.mark.parametrize("name", names("lamp"))
def test_every_lamp_peaks_at_one(name: str) -> None:
    power = lamp(name, np.arange(380.0, 780.5, 1.0))
    assert power.max() == pytest.approx(1.0, abs=1e-12)
    assert power.min() >= 0.0


def test_a_lamp_is_the_table_of_colour_science() -> None:
    import colour

    for name, table_name in (("led_cool_white", "LED-B5"), ("led_warm_white", "LED-B2")):
        table = colour.SDS_ILLUMINANTS[table_name]
        np.testing.assert_allclose(
            lamp(name, table.wavelengths), table.values / table.values.max(), rtol=1e-12
        )
    assert lamp("led_cool_white", [450.0])[0] > 1.5 * lamp("led_warm_white", [450.0])[0]


def test_an_illuminant_that_is_not_listed_is_found_too() -> None:
    name = "ISO 7589 Studio Tungsten"
    assert name not in names("lamp")
    power = lamp(name, np.arange(380.0, 691.0, 1.0))
    assert power.max() == pytest.approx(1.0)


def test_numbers_and_tables_are_spectra_too() -> None:
    table = SpectralTable(wavelength_nm=(400.0, 500.0, 900.0), value=(1.0, 3.0, 12.0))
    np.testing.assert_allclose(refractive_index(1.5, [400.0, 500.0]), 1.5)
    np.testing.assert_allclose(lamp(7.0, [400.0, 500.0]), 1.0)
    np.testing.assert_allclose(lamp(table, [400.0, 450.0, 500.0, 900.0]), [1 / 3, 2 / 3, 1.0, 4.0])


def test_the_table_of_a_lamp_outside_the_visible_is_divided_by_its_own_peak() -> None:
    table = SpectralTable(wavelength_nm=(900.0, 1000.0), value=(2.0, 8.0))
    np.testing.assert_allclose(lamp(table, [900.0, 1000.0]), [0.25, 1.0])


def _error(call: object) -> str:
    assert callable(call)
    with pytest.raises(InputError) as caught:
        call()
    return str(caught.value)


def test_an_unknown_name_lists_those_that_look_like_it() -> None:
    for call, expected in (
        (lambda: refractive_index("glas_bk7", [500.0]), "glass_bk7"),
        (lambda: reflectance("spectralonn", [500.0]), "spectralon"),
        (lambda: lamp("led_warmwhite", [500.0]), "led_warm_white"),
        (lambda: lamp("d65", [500.0]), "D65"),
    ):
        message = _error(call)
        assert "not in the library" in message
        assert f"Did you mean {expected}" in message


def test_an_unknown_kind_lists_the_kinds() -> None:
    for call in (lambda: names("lens"), lambda: entry("lens", "x")):  # type: ignore[arg-type]
        assert "refractive_index, reflectance, lamp, material" in _error(call)


def test_nothing_is_extrapolated() -> None:
    table = SpectralTable(wavelength_nm=(400.0, 700.0), value=(0.5, 0.5))
    for call, span in (
        (lambda: refractive_index("pdms_rtv615", [500.0, 781.0]), "350 to 780 nm"),
        (lambda: reflectance("flocked_paper", [781.0]), "350 to 780 nm"),
        (lambda: lamp("led_cool_white", [379.0]), "380 to 780 nm"),
        (lambda: reflectance(table, [399.0]), "400 to 700 nm"),
    ):
        message = _error(call)
        assert span in message
        assert "extrapolated" in message


def test_values_that_cannot_be_are_refused_with_their_wavelength() -> None:
    rising = SpectralTable(wavelength_nm=(400.0, 500.0), value=(0.9, 1.1))
    assert "at 500 nm" in _error(lambda: reflectance(rising, [400.0, 500.0]))
    assert "-0.1 at 400 nm" in _error(lambda: reflectance(-0.1, [400.0, 500.0]))
    assert "0.5 at 400 nm" in _error(lambda: refractive_index(0.5, [400.0]))
    negative = SpectralTable(wavelength_nm=(400.0, 500.0), value=(1.0, -1.0))
    assert "-1 at 500 nm" in _error(lambda: lamp(negative, [400.0]))
    dark = SpectralTable(wavelength_nm=(400.0, 500.0), value=(0.0, 0.0))
    assert "no light" in _error(lambda: lamp(dark, [400.0]))
    assert "the lamp 0" in _error(lambda: lamp(0.0, [400.0]))


@pytest.mark.parametrize("bad", [[], [[400.0]], [-1.0], [float("nan")], ["blue"], [0.0]])
def test_wavelengths_must_be_numbers_above_zero(bad: list[object]) -> None:
    assert "wavelength" in _error(lambda: reflectance(0.5, bad))
