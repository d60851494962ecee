"""Scattering and absorbing media: published values, mixtures, compositions, bounds, messages."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from twin.bench import Medium
from twin.errors import InputError
from twin.materials import (
    Material,
    Share,
    checked_properties,
    material,
    mixture,
    names,
    optical_properties,
)
from twin.spectra import SpectralTable

VISIBLE = np.arange(380.0, 781.0, 4.0)


def _error(call: object) -> str:
    assert callable(call)
    with pytest.raises(InputError) as caught:
        call()
    return str(caught.value)


# Michels, Foschum and Kienle 2008, Table 5: their own quadratic fits of sigma_s' [1/mm], which
# are independent of the fits of sigma_s and g that the library holds.
TABLE_5 = {10: (4.957e1, -9.063e-2, 4.616e-5), 20: (8.261e1, -1.288e-1, 6.093e-5)}


@pytest.mark.parametrize("percent", [10, 20])
@pytest.mark.parametrize("wavelength_nm", [450.0, 550.0, 633.0, 750.0])
def test_intralipid_has_the_published_reduced_scattering(
    percent: int, wavelength_nm: float
) -> None:
    found = optical_properties(f"intralipid_{percent}", [wavelength_nm])
    reduced = (found.sigma_s_per_mm * (1 - found.g))[0]
    a, b, c = TABLE_5[percent]
    published = a + b * wavelength_nm + c * wavelength_nm**2
    assert reduced == pytest.approx(published, rel=0.06)


def test_the_three_intralipids_scatter_in_the_order_of_their_fat() -> None:
    at_633 = [optical_properties(f"intralipid_{p}", [633.0]) for p in (10, 20, 30)]
    np.testing.assert_allclose(
        [p.sigma_s_per_mm[0] for p in at_633], [19.03, 74.6, 182.9], rtol=0.005
    )
    np.testing.assert_allclose([p.g[0] for p in at_633], [0.4597, 0.6588, 0.7870], atol=1e-4)


def test_van_staveren_intralipid_has_its_published_fit() -> None:
    found = optical_properties("intralipid_10_van_staveren(1%)", [632.8])
    assert found.sigma_s_per_mm[0] == pytest.approx(10 * 0.016 * 0.6328**-2.4, rel=1e-9)
    assert found.g[0] == pytest.approx(1.1 - 0.58 * 0.6328, abs=1e-12)
    reduced = (found.sigma_s_per_mm * (1 - found.g))[0]
    michels = optical_properties("intralipid_10(1%)", [632.8])
    assert reduced == pytest.approx((michels.sigma_s_per_mm * (1 - michels.g))[0], rel=0.35)


@pytest.mark.parametrize(
    ("name", "wavelength_nm", "epsilon"),
    [
        ("methylene_blue", 664.0, 74028.0),
        ("methylene_blue", 612.0, 38121.0),
        ("carmoisine", 512.0, 24000.0),
        ("methyl_orange", 466.0, 25900.0),
        ("oxyhaemoglobin", 414.0, 524280.0),
        ("oxyhaemoglobin", 576.0, 55540.0),
    ],
)
def test_a_dye_obeys_beer_with_its_published_extinction(
    name: str, wavelength_nm: float, epsilon: float
) -> None:
    found = optical_properties(f"{name}(1 mmol/l)", [wavelength_nm])
    water = optical_properties("water", [wavelength_nm])
    absorbance_of_1_cm = (found.sigma_a_per_mm - water.sigma_a_per_mm)[0] * 10 / math.log(10)
    assert absorbance_of_1_cm == pytest.approx(epsilon * 1e-3, rel=1e-9)
    assert found.albedo[0] == 0.0


def test_a_dye_beyond_its_table_is_assumed_clear_and_says_so() -> None:
    ink = material("carmoisine")
    assert ink.assumed_nm == ((700.0, 800.0),)
    assert ink.at([750.0]).sigma_a_per_mm[0] == 0.0
    assert ink.at([690.0]).sigma_a_per_mm[0] > 0.0


@pytest.mark.parametrize(
    ("wavelength_nm", "per_m"), [(417.5, 0.00442), (500.0, 0.0204), (660.0, 0.410), (760.0, 2.55)]
)
def test_water_absorbs_as_published(wavelength_nm: float, per_m: float) -> None:
    assert optical_properties("water", [wavelength_nm]).sigma_t_per_mm[0] == pytest.approx(
        1e-3 * per_m, rel=1e-9
    )


def test_the_polyjet_inks_are_the_quoted_channels(shared_data: Path) -> None:
    record = shared_data / "translucent" / "polyjet_inks_elek2017_rgb_QUOTED.csv"
    if not record.is_file():
        pytest.skip("no PolyJet channels among the reference data")
    rows = list(csv.DictReader(record.read_text("utf-8").splitlines()))
    assert len(rows) == 5
    for row in rows:
        found = optical_properties(f"polyjet_{row['ink'].lower()}", [611.0, 549.0, 464.0])
        albedo = [float(row[f"albedo_{channel}"]) for channel in "RGB"]
        sigma_t = [float(row[f"sigma_t_{channel}_permm"]) for channel in "RGB"]
        np.testing.assert_allclose(found.albedo, albedo, rtol=1e-12)
        np.testing.assert_allclose(found.sigma_t_per_mm, sigma_t, rtol=1e-12)
        np.testing.assert_allclose(found.g, 0.4)


def test_the_measured_media_are_the_tabulated_channels(shared_data: Path) -> None:
    record = shared_data / "translucent" / "measured_media_jensen2001_narasimhan2006.csv"
    if not record.is_file():
        pytest.skip("no measured media among the reference data")
    ours = {
        "Apple": "apple",
        "Cream": "cream",
        "Ketchup": "ketchup",
        "Marble": "marble",
        "Potato": "potato",
        "Skimmilk": "skim_milk",
        "Skin1": "skin",
        "Wholemilk": "whole_milk",
        "Regular Chocolate Milk": "chocolate_milk",
        "Espresso": "espresso",
        "Regular Soy Milk": "soy_milk",
        "White Grapefruit Juice": "white_grapefruit_juice",
    }
    rows = {row["name"]: row for row in csv.DictReader(record.read_text("utf-8").splitlines())}
    for theirs, name in ours.items():
        row = rows[theirs]
        found = optical_properties(name, [611.0, 549.0, 464.0])
        reduced = [float(row[f"sigma_s_prime_{channel}"]) for channel in "RGB"]
        absorption = [float(row[f"sigma_a_{channel}"]) for channel in "RGB"]
        np.testing.assert_allclose(found.sigma_s_per_mm * (1 - found.g), reduced, rtol=1e-9)
        np.testing.assert_allclose(found.sigma_a_per_mm, absorption, rtol=1e-9)
        assert material(name).citation.startswith(("Jensen", "Narasimhan"))


def test_three_channels_are_marked_as_interpolated_and_fits_are_not() -> None:
    for name in names("material"):
        channels = "Three channels" in material(name).note
        assert material(name).interpolated is channels, name
    assert material("polyjet_cyan(50%) + polyjet_white(50%)").interpolated
    assert not material("demo_ink").interpolated


@pytest.mark.parametrize("name", names("material"))
def test_every_material_works_from_380_to_780_nm(name: str) -> None:
    found = material(name)
    text = f"{name}(10 umol/l)" if found.measure == "molar" else name
    properties = optical_properties(text, VISIBLE)
    assert properties.albedo.shape == VISIBLE.shape
    assert np.all((properties.albedo >= 0) & (properties.albedo <= 1))
    assert np.all(properties.sigma_t_per_mm > 0)
    assert np.all(np.abs(properties.g) < 1)
    assert properties.n is None or np.all((properties.n > 1.3) & (properties.n < 1.6))
    assert found.citation
    assert found.note


def test_the_demo_ink_is_worth_measuring_through_0_4_and_0_8_mm() -> None:
    found = optical_properties("demo_ink", np.arange(396.0, 705.0, 2.0))
    assert np.all((found.sigma_t_per_mm * 0.4 > 0.5) & (found.sigma_t_per_mm * 0.8 < 6.0))
    assert np.ptp(found.albedo) > 0.2
    turns = np.diff(np.sign(np.diff(found.albedo)))
    assert np.count_nonzero(turns) >= 3
    assert np.all((found.g > 0.5) & (found.g < 0.9))
    assert found.n is not None


AMOUNTS = st.floats(min_value=0.0, max_value=0.3, allow_nan=False)
CONCENTRATIONS = st.floats(min_value=0.0, max_value=1e-3, allow_nan=False)


@given(AMOUNTS, CONCENTRATIONS, CONCENTRATIONS)
def test_coefficients_of_a_mixture_add(fat: float, blue: float, red: float) -> None:
    emulsion, methylene, carmoisine, water = (
        material(name) for name in ("intralipid_20", "methylene_blue", "carmoisine", "water")
    )
    mixed = mixture(
        "mixed", [Share(emulsion, fat), Share(methylene, blue), Share(carmoisine, red)]
    ).at(VISIBLE)
    parts = [
        (fat, emulsion.at(VISIBLE)),
        (1 - fat, water.at(VISIBLE)),
        (blue, methylene.at(VISIBLE)),
        (red, carmoisine.at(VISIBLE)),
    ]
    absorption = sum(amount * part.sigma_a_per_mm for amount, part in parts)
    scattering = sum(amount * part.sigma_s_per_mm for amount, part in parts)
    np.testing.assert_allclose(mixed.sigma_a_per_mm, absorption, rtol=1e-12)
    np.testing.assert_allclose(mixed.sigma_s_per_mm, scattering, rtol=1e-12, atol=1e-300)


@given(st.floats(min_value=0.01, max_value=0.99))
def test_g_of_a_mixture_is_weighted_by_scattering(fraction: float) -> None:
    first, second = material("skim_milk"), material("intralipid_20")
    mixed = mixture("mixed", [Share(first, fraction), Share(second, 1 - fraction)]).at(VISIBLE)
    one, two = first.at(VISIBLE), second.at(VISIBLE)
    weight_one = fraction * one.sigma_s_per_mm
    weight_two = (1 - fraction) * two.sigma_s_per_mm
    expected = (weight_one * one.g + weight_two * two.g) / (weight_one + weight_two)
    np.testing.assert_allclose(mixed.g, expected, rtol=1e-12)
    unweighted = fraction * one.g + (1 - fraction) * two.g
    assert not np.allclose(mixed.g, unweighted, rtol=1e-6)


def test_a_composition_is_the_mixture_it_writes() -> None:
    written = optical_properties("intralipid(4%)+methylene_blue( 5 umol/l )", VISIBLE)
    mixed = mixture(
        "by hand", [Share(material("intralipid_20"), 0.04), Share(material("methylene_blue"), 5e-6)]
    ).at(VISIBLE)
    np.testing.assert_allclose(written.sigma_s_per_mm, mixed.sigma_s_per_mm, rtol=1e-12)
    np.testing.assert_allclose(written.sigma_a_per_mm, mixed.sigma_a_per_mm, rtol=1e-9)
    for same in ("methylene_blue(5000 nmol/l)", "methylene_blue(5e-3 mmol/l)"):
        np.testing.assert_allclose(
            optical_properties(f"{same} + intralipid(4%)", VISIBLE).sigma_t_per_mm,
            written.sigma_t_per_mm,
            rtol=1e-12,
        )


def test_a_named_composition_can_be_diluted() -> None:
    whole = optical_properties("demo_ink", VISIBLE)
    half = optical_properties("demo_ink(50%)", VISIBLE)
    np.testing.assert_allclose(half.sigma_s_per_mm, whole.sigma_s_per_mm / 2, rtol=1e-12)
    assert material("demo_ink").name == "demo_ink"


def test_a_mixture_keeps_the_sources_the_range_and_the_index() -> None:
    mixed = material("intralipid(4%) + methylene_blue(5 umol/l)")
    for author in ("Michels", "Prahl", "Pope and Fry"):
        assert author in mixed.citation
    assert mixed.range_nm == (380.0, 780.0)
    assert mixed.n == "water"
    assert optical_properties("polyjet_cyan(30%) + polyjet_white(70%)", [500.0]).n == 1.5


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("intralipid(4%) + metylene_blue(1 umol/l)", "Did you mean methylene_blue"),
        ("marbel", "Did you mean marble"),
        ("intralipid(4%) + carmoisine", "carmoisine without mol/l"),
        ("carmoisine", "carmoisine without a concentration"),
        ("carmoisine(4%)", "carmoisine without mol/l"),
        ("intralipid(4 umol/l)", "intralipid without a volume fraction"),
        ("intralipid + carmoisine(5 umol/l)", "intralipid without an amount"),
        ("intralipid(4)", "one of %, mol/l"),
        ("intralipid(-4%)", "0 to 100 %"),
        ("intralipid(101%)", "0 to 100 %"),
        ("intralipid(4,5%)", 'the amount "4,5"'),
        ("intralipid(60%) + intralipid_10(60%)", "120 % of the volume"),
        ("polyjet_cyan(50%)", "add up to 100 %"),
        ("marble(50%) + intralipid(50%)", "materials that mix with water"),
        ("intralipid(4%", "name(amount unit)"),
        ("intralipid(4%) carmoisine(1 umol/l)", "name(amount unit)"),
        ("intralipid(4%) +", "name(amount unit)"),
        ("", "not in the library"),
    ],
)
def test_a_composition_that_cannot_be_says_why(text: str, told: str) -> None:
    assert told in _error(lambda: optical_properties(text, [500.0]))


@given(st.text(alphabet="intralp_20(). %+-emulo/l\u00b5", max_size=40) | st.text(max_size=30))
def test_any_text_is_a_material_or_one_clear_error(text: str) -> None:
    found: object = None
    said = ""
    try:
        found = material(text)
    except InputError as error:
        said = str(error)
    assert isinstance(found, Material) or "expected" in said


def test_nothing_is_extrapolated() -> None:
    for name in ("demo_ink", "intralipid", "polyjet_cyan"):
        low, high = material(name).range_nm
        for wavelength in (low - 1, high + 1):
            message = _error(lambda n=name, w=wavelength: optical_properties(n, [500.0, w]))
            assert f"{low:g} to {high:g} nm" in message
            assert f"{wavelength:g} nm" in message


def test_a_medium_of_numbers_tables_and_names() -> None:
    table = SpectralTable(wavelength_nm=(400.0, 600.0), value=(1.0, 3.0))
    medium = Medium(albedo=0.5, sigma_t_per_mm=table, g="intralipid")
    found = optical_properties(medium, [400.0, 500.0])
    np.testing.assert_allclose(found.albedo, 0.5)
    np.testing.assert_allclose(found.sigma_t_per_mm, [1.0, 2.0])
    np.testing.assert_allclose(found.g, optical_properties("intralipid", [400.0, 500.0]).g)
    assert found.n is None
    assert "400 to 600 nm" in _error(lambda: optical_properties(medium, [601.0]))


FINITE = st.floats(min_value=-3.0, max_value=3.0, allow_nan=False)


@given(FINITE, FINITE, FINITE)
def test_a_medium_is_physical_or_refused(albedo: float, sigma_t: float, g: float) -> None:
    medium = Medium(albedo=albedo, sigma_t_per_mm=sigma_t, g=g)
    physical = 0 <= albedo <= 1 and sigma_t >= 0 and abs(g) < 1
    if not physical:
        assert "at 500 nm" in _error(lambda: optical_properties(medium, [500.0]))
        return
    found = optical_properties(medium, [500.0])
    assert found.sigma_s_per_mm[0] + found.sigma_a_per_mm[0] == pytest.approx(sigma_t)
    assert found.sigma_s_per_mm[0] == pytest.approx(albedo * sigma_t)


def test_the_message_names_the_wavelength_that_is_wrong() -> None:
    rising = SpectralTable(wavelength_nm=(400.0, 600.0), value=(0.5, 1.5))
    medium = Medium(albedo=rising, sigma_t_per_mm=1.0)
    assert "the albedo 1.25 at 550 nm" in _error(
        lambda: optical_properties(medium, [400.0, 450.0, 550.0, 600.0])
    )
    wavelength_nm, good = np.array([500.0, 510.0]), np.array([0.5, 0.5])
    bad = np.array([0.5, np.nan])
    assert "g nan at 510 nm" in _error(lambda: checked_properties(wavelength_nm, good, good, bad))


def test_a_clear_medium_has_no_albedo_and_no_anisotropy() -> None:
    clear = optical_properties("water", [500.0])
    assert clear.albedo[0] == 0.0
    assert clear.g[0] == 0.0
