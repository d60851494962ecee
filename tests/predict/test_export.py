"""Media for renderers: written, and read back to the same values."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.predict import (
    RenderMedium,
    mitsuba_text,
    pbrt_text,
    read_pbrt,
    reflectance_45_0,
    render_medium,
    write_medium,
)
from scenarios.predict.export import parse_pbrt
from tests.predict.estimates import WAVELENGTH, constant, exact
from twin.errors import InputError

SLOPE = np.stack([np.linspace(0.2, 0.9, 7), np.linspace(2.0, 9.0, 7), np.linspace(0.1, 0.6, 7)], -1)

SPREAD = np.random.Generator(np.random.Philox(key=2)).uniform(0, 1, 200)

coefficient = st.floats(0, 1e4, allow_subnormal=False)


@given(
    st.lists(st.tuples(coefficient, coefficient), min_size=2, max_size=8),
    st.floats(-0.99, 0.99),
    st.floats(1e-3, 1e3),
    st.text(max_size=60),
)
def test_pbrt_text_is_read_back_to_the_bit(
    pairs: list[tuple[float, float]], g: float, unit: float, note: str
) -> None:
    absorption, scattering = np.array(pairs).T
    wavelength = 400.0 + 7.25 * np.arange(len(pairs), dtype=np.float64)
    medium = RenderMedium("ink", wavelength, absorption, scattering, g, unit, 1.5, (note,))
    found = parse_pbrt(pbrt_text(medium))
    assert found.name == "ink"
    for name in ("wavelength_nm", "sigma_a_per_mm", "sigma_s_per_mm"):
        assert np.array_equal(getattr(found, name), getattr(medium, name))
    assert (found.g, found.unit_mm) == (g, unit)


@given(st.text(max_size=200))
def test_any_text_is_a_medium_or_the_clear_error(text: str) -> None:
    try:
        found: object = parse_pbrt('MakeNamedMedium "a" ' + text)
    except InputError as error:
        found = error
    assert isinstance(found, RenderMedium) or "expected" in str(found)


def test_a_constant_g_is_exported_exactly() -> None:
    medium = render_medium(exact(constant(0.8, 5.0, 0.4)), unit_mm=1000.0, n=1.5)
    np.testing.assert_allclose(medium.albedo, 0.8)
    np.testing.assert_allclose(medium.sigma_t_per_mm, 5.0)
    assert medium.g == pytest.approx(0.4)
    assert not any("rescaled" in note for note in medium.notes)


def test_one_g_for_all_keeps_absorption_and_reduced_scattering() -> None:
    medium = render_medium(exact(SLOPE))
    albedo, sigma_t, g = SLOPE.T
    np.testing.assert_allclose(medium.sigma_a_per_mm, (1 - albedo) * sigma_t)
    np.testing.assert_allclose(medium.sigma_s_per_mm * (1 - medium.g), albedo * sigma_t * (1 - g))
    assert any("g varies from 0.1 to 0.6" in note for note in medium.notes)


def test_the_stated_cost_of_one_g_is_kept() -> None:
    """0.005 and 0.015 for g from 0.2 to 0.6, as the note says; below half of it would be news."""
    rng = np.random.Generator(np.random.Philox(key=1))
    true = np.stack([rng.uniform(0.3, 0.99, 200), rng.uniform(1, 10, 200), 0.2 + 0 * SPREAD], -1)
    true[:, 2] += 0.4 * SPREAD
    at = np.linspace(400.0, 700.0, 200)
    medium = render_medium(exact(true, at))
    common = np.stack([medium.albedo, medium.sigma_t_per_mm, np.full(200, medium.g)], -1)
    for thickness, stated in ((5.0, 0.005), (0.2, 0.015)):
        one, other = (reflectance_45_0(p, thickness, 1.5, 0.02) for p in (true, common))
        assert 0.4 * stated < np.abs(one - other).max() < stated


def test_unknown_wavelengths_are_left_out_and_the_range_is_said() -> None:
    holed = SLOPE.copy()
    holed[[0, 3]] = np.nan
    medium = render_medium(exact(holed))
    assert medium.wavelength_nm.tolist() == [450.0, 500.0, 600.0, 650.0, 700.0]
    assert "450 to 700 nm" in medium.notes[0]


def test_no_note_and_no_name_breaks_the_files() -> None:
    medium = render_medium(exact(SLOPE), name='30 % "cyan" --> <x/>')
    wicked = RenderMedium(
        medium.name, medium.wavelength_nm, medium.sigma_a_per_mm, medium.sigma_s_per_mm,
        medium.g, notes=('--> <medium type="x"/>\nMakeNamedMedium "other"',),
    )  # fmt: skip
    from xml.etree import ElementTree

    root = ElementTree.fromstring(mitsuba_text(wicked))
    assert [child.tag for child in root] == ["medium"]
    assert root[0].get("id") == medium.name == "30-cyan-x"
    assert parse_pbrt(pbrt_text(wicked)).name == medium.name


def test_mitsuba_reads_the_same_medium(tmp_path: Path) -> None:
    mi = pytest.importorskip("mitsuba")
    before = mi.variant()
    mi.set_variant("scalar_spectral")
    try:
        medium = render_medium(exact(SLOPE), unit_mm=10.0, n=1.5, name="ink")
        write_medium(medium, "mitsuba", tmp_path / "medium.xml")
        (tmp_path / "scene.xml").write_text(
            '<scene version="3.0.0"><include filename="medium.xml"/>'
            '<shape type="sphere"><ref id="ink" name="interior"/><ref id="ink-face"/></shape>'
            "</scene>"
        )
        loaded: Any = mi.load_file(str(tmp_path / "scene.xml")).shapes()[0].interior_medium()
        params = mi.traverse(loaded)
        for key, own in (("sigma_t", medium.sigma_t_per_mm), ("albedo", medium.albedo)):
            np.testing.assert_allclose(np.array(params[f"{key}.value.values"]), own, rtol=1e-6)
        assert params["phase_function.g"] == pytest.approx(medium.g, rel=1e-6)
        # between two nodes and with the unit: what the renderer computes with
        point = mi.MediumInteraction3f()
        at = [401.0, 425.0, 500.0, 699.0]
        point.wavelengths = at
        scattering, _, extinction = loaded.get_scattering_coefficients(point)
        expected = np.interp(at, WAVELENGTH, medium.sigma_t_per_mm)
        albedo = np.interp(at, WAVELENGTH, medium.albedo)
        np.testing.assert_allclose(np.array(extinction), 10 * expected, rtol=1e-5)
        np.testing.assert_allclose(np.array(scattering), 10 * expected * albedo, rtol=1e-5)
    finally:
        if before:
            mi.set_variant(before)


def test_a_file_is_written_whole_and_read_back(tmp_path: Path) -> None:
    medium = render_medium(exact(SLOPE))
    path = write_medium(medium, "pbrt", tmp_path / "medium.pbrt")
    assert [entry.name for entry in tmp_path.iterdir()] == ["medium.pbrt"]
    assert np.array_equal(read_pbrt(path).sigma_a_per_mm, medium.sigma_a_per_mm)


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("", "no MakeNamedMedium"),
        ('MakeNamedMedium "a" "string type" [ "cloud" ]', "cloud"),
        ('MakeNamedMedium "a" "string type" [ "homogeneous" ]', "no such parameter"),
        ('MakeNamedMedium "a', "without its partner"),
        ('MakeNamedMedium "a" "string type" [ "homogeneous"', "without its"),
        (
            'MakeNamedMedium "a" "string type" "homogeneous" "spectrum sigma_a" [ 400 1 390 2 ]',
            "4 numbers",
        ),
        ('MakeNamedMedium "a" "string type" "homogeneous" "spectrum sigma_a" [ x ]', "could not"),
        (
            'MakeNamedMedium "a" "string type" "homogeneous" "spectrum sigma_a" [ 400 nan 500 2 ]',
            "nan",
        ),
    ],
)
def test_a_wrong_pbrt_file_gets_one_message(tmp_path: Path, text: str, found: str) -> None:
    path = tmp_path / "wrong.pbrt"
    path.write_text(text)
    with pytest.raises(InputError, match=found) as error:
        read_pbrt(path)
    assert str(path) in str(error.value)


def test_wrong_requests_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="blender"):
        write_medium(render_medium(exact(SLOPE)), "blender", tmp_path / "m")
    with pytest.raises(InputError, match="unit of -1"):
        render_medium(exact(SLOPE), unit_mm=-1.0)
    with pytest.raises(InputError, match="0 wavelengths"):
        render_medium(exact(np.full((7, 3), np.nan)))
    with pytest.raises(InputError, match="cannot be read"):
        read_pbrt(tmp_path / "nowhere.pbrt")
