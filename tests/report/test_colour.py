"""Colours against closed forms, colour-science's own integration and published pairs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.report.colour import Observer, Swatch, ciede2000, colours_of
from scenarios.report.content import Content
from scenarios.report.reading import content_of
from tests.report.fake import WAVELENGTH, estimate, visit


def swatch(lab: tuple[float, float, float]) -> Swatch:
    return Swatch((0, 0, 0), lab, (0, 0, 0))


@pytest.fixture(scope="module")
def content() -> Content:
    measurement = visit()
    return content_of(measurement, estimate(measurement), ())


@pytest.mark.parametrize(("low", "high"), [(380, 780), (400, 700), (415, 680)])
def test_perfect_diffuser_is_white_over_any_range(low: float, high: float) -> None:
    observer = Observer(low, high)
    white = observer.swatch(np.ones(observer.wavelength_nm.shape))
    np.testing.assert_allclose(white.lab, (100, 0, 0), atol=1e-9)
    np.testing.assert_allclose(white.srgb, (1, 1, 1), atol=2e-3)
    assert white.in_gamut
    assert white.hexadecimal == "#ffffff"


def test_middle_grey_has_lightness_50() -> None:
    observer = Observer(400, 700)
    grey = observer.swatch(np.full(observer.wavelength_nm.shape, ((50 + 16) / 116) ** 3))
    np.testing.assert_allclose(grey.lab, (50, 0, 0), atol=1e-9)


def test_tristimulus_values_agree_with_colour_science() -> None:
    import colour

    observer = Observer(380, 780)
    wavelength = observer.wavelength_nm
    curve = 0.1 + 0.7 / (1 + np.exp(-(wavelength - 580) / 15))
    theirs = colour.sd_to_XYZ(
        colour.SpectralDistribution(curve, wavelength),
        illuminant=colour.SDS_ILLUMINANTS["D65"],
        method="Integration",
    )
    # Theirs runs from 360 to 830 nm.
    np.testing.assert_allclose(np.array(observer.swatch(curve).xyz) * 100, theirs, rtol=3e-4)


@pytest.mark.parametrize(
    ("one", "other", "difference"),
    [
        ((50.0, 2.6772, -79.7751), (50.0, 0.0, -82.7485), 2.0425),
        ((50.0, 2.5, 0.0), (73.0, 25.0, -18.0), 27.1492),
        ((2.0776, 0.0795, -1.1350), (0.9033, -0.0636, -0.5514), 0.9082),
    ],
)
def test_ciede2000_of_published_pairs(
    one: tuple[float, float, float], other: tuple[float, float, float], difference: float
) -> None:
    """Sharma, Wu and Dalal 2005, table 1."""
    assert ciede2000(swatch(one), swatch(other)) == pytest.approx(difference, abs=5e-5)
    assert ciede2000(swatch(one), None) is None


def test_saturated_light_is_flagged_as_outside_srgb() -> None:
    observer = Observer(400, 700)
    green = observer.swatch(np.exp(-(((observer.wavelength_nm - 515) / 12) ** 2)))
    assert not green.in_gamut
    assert min(green.srgb) < 0
    assert green.hexadecimal[1:3] == "00"


@given(st.floats(0.01, 1.0), st.floats(420, 660))
def test_scaling_a_spectrum_scales_its_tristimulus_values(factor: float, centre: float) -> None:
    observer = Observer(400, 700)
    curve = 0.2 + 0.5 * np.exp(-(((observer.wavelength_nm - centre) / 40) ** 2))
    whole, part = observer.swatch(curve), observer.swatch(factor * curve)
    np.testing.assert_allclose(part.xyz, factor * np.array(whole.xyz), rtol=1e-12)


def test_prediction_of_the_measured_curve_has_no_difference(content: Content) -> None:
    same = replace(content, predicted=content.relative.value)
    rows = colours_of(same).rows
    assert len(rows) == 4
    assert all(row.measured_to_predicted == pytest.approx(0, abs=1e-9) for row in rows)
    darker = replace(content, predicted=0.9 * content.relative.value)
    assert all((row.measured_to_predicted or 0) > 1 for row in colours_of(darker).rows)


def test_range_is_where_all_curves_are_known(content: Content) -> None:
    assert content.predicted is not None
    cut = np.where(WAVELENGTH < 420, np.nan, content.predicted)
    cut[:, :, 40] = np.nan
    colours = colours_of(replace(content, predicted=cut))
    assert colours.range_nm == (420, 700)
    assert all(row.bridged == 1 and row.predicted is not None for row in colours.rows)
    none = np.where(WAVELENGTH < 480, np.nan, content.predicted)
    rows = colours_of(replace(content, predicted=none)).rows
    assert all(row.predicted is None and row.range_nm == (400, 700) for row in rows)


def test_no_colour_from_a_hole_or_a_short_range(content: Content) -> None:
    for lost, words in (((480, 560), "a hole of"), ((600, 800), "a colour needs")):
        valid = content.relative.valid & ~((lost[0] < WAVELENGTH) & (lost[1] > WAVELENGTH))
        colours = colours_of(replace(content, relative=replace(content.relative, valid=valid)))
        assert colours.rows == ()
        assert len(colours.missing) == 4
        assert all(words in text for text in colours.missing)
