"""Colours: the perfect white, published colour differences, and refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.predict import Prediction, Slab, colour_of, difference
from scenarios.predict.colour import Weights, ciede2000_of
from scenarios.report.colour import Observer
from twin.errors import InputError
from twin.spectra import FloatArray

WAVELENGTH = np.arange(380.0, 781.0, 10.0)


def prediction(
    value: float | FloatArray, spread: float = 0.0, wavelength_nm: FloatArray = WAVELENGTH
) -> Prediction:
    """A reflectance with normal draws that know nothing of each other."""
    reflectance = np.broadcast_to(np.asarray(value, float), wavelength_nm.shape).copy()
    rng = np.random.Generator(np.random.Philox(key=2))
    draws = reflectance + spread * rng.standard_normal((200, len(wavelength_nm)))
    return Prediction(
        "made up", Slab(1.0), wavelength_nm, reflectance, draws, 0 * reflectance, False
    )


@pytest.mark.parametrize(
    ("illuminant", "xy"),
    [("D65", (0.31272, 0.32903)), ("A", (0.44758, 0.40745)), ("FL4", (0.4402, 0.4031))],
)
def test_a_perfect_white_has_the_illuminants_chromaticity(
    illuminant: str, xy: tuple[float, float]
) -> None:
    """CIE 15:2018, tables T.3 and T.8.1."""
    colour = colour_of(prediction(1.0), illuminant)
    x, y, z = colour.swatch.xyz
    assert (x / (x + y + z), y / (x + y + z)) == pytest.approx(xy, abs=2e-4)
    assert y == pytest.approx(1.0)
    assert colour.swatch.lab == pytest.approx((100.0, 0.0, 0.0), abs=1e-6)
    assert colour.swatch.srgb == pytest.approx((1.0, 1.0, 1.0), abs=2e-3)


@given(st.floats(0.0, 1.0))
def test_a_neutral_grey_is_neutral(value: float) -> None:
    colour = colour_of(prediction(value), "A")
    assert colour.swatch.xyz[1] == pytest.approx(value, abs=1e-12)
    assert colour.swatch.lab[1:] == pytest.approx((0.0, 0.0), abs=1e-6)


def test_under_d65_it_is_the_reports_colour() -> None:
    rng = np.random.Generator(np.random.Philox(key=3))
    reflectance = rng.uniform(0, 1, 301)
    weights = Weights(400.0, 700.0)
    own = weights.swatch(weights.xyz(weights.wavelength_nm, reflectance))
    assert own.lab == pytest.approx(Observer(400.0, 700.0).swatch(reflectance).lab, abs=0.01)


SHARMA = (
    ((50.0, 2.6772, -79.7751), (50.0, 0.0, -82.7485), 2.0425),
    ((50.0, 2.49, -0.001), (50.0, -2.49, 0.0011), 7.2195),
    ((50.0, 2.5, 0.0), (73.0, 25.0, -18.0), 27.1492),
    ((2.0776, 0.0795, -1.135), (0.9033, -0.0636, -0.5514), 0.9082),
)
"""Sharma, Wu and Dalal 2005, Color Res. Appl. 30, 21, table 1, pairs 1, 10, 17 and 34."""


@pytest.mark.parametrize(("one", "other", "published"), SHARMA)
def test_published_colour_differences(
    one: tuple[float, ...], other: tuple[float, ...], published: float
) -> None:
    assert ciede2000_of(np.array(one), np.array(other)) == pytest.approx(published, abs=1e-4)


def test_the_same_colour_differs_by_nothing() -> None:
    found = difference(prediction(0.4), prediction(0.4))
    assert found.ciede2000 == 0.0
    assert found.interval == pytest.approx((0.0, 0.0), abs=1e-6)


def test_a_difference_is_symmetric_and_its_interval_grows_with_the_spread() -> None:
    one, other = prediction(0.4, 0.02), prediction(0.5, 0.02)
    forth, back = difference(one, other), difference(other, one)
    assert forth.ciede2000 == pytest.approx(back.ciede2000)
    sharper = difference(prediction(0.4, 0.002), prediction(0.5, 0.002))
    assert sharper.interval[0] < sharper.ciede2000 < sharper.interval[1]
    assert np.ptp(forth.interval) > 3 * np.ptp(sharper.interval)


def test_the_interval_spans_both_couplings() -> None:
    """Common errors move the lightness, independent ones average out in it."""
    colour = colour_of(prediction(0.4, 0.02))
    width = {how: np.ptp(np.quantile(lab[:, 0], [0.05, 0.95]))
             for how, lab in colour.lab_draws.items()}  # fmt: skip
    assert width["common"] > 3 * width["independent"]
    assert np.ptp(colour.lab_interval[:, 0]) >= width["common"]
    assert set(colour.spread_ciede2000) == {"common", "independent"}


def test_draws_that_belong_together_are_used_as_drawn() -> None:
    ordered = replace(prediction(0.4, 0.02), ordered=True)
    assert set(colour_of(ordered).lab_draws) == {"as drawn"}
    mixed = difference(ordered, prediction(0.5, 0.02))
    assert set(mixed.by_coupling) == {"common", "independent"}


def test_a_few_unknown_wavelengths_are_bridged_and_said() -> None:
    holed = np.linspace(0.2, 0.6, len(WAVELENGTH))
    whole = colour_of(prediction(holed)).swatch.lab
    holed[[10, 11, 20]] = np.nan
    colour = colour_of(prediction(holed))
    assert colour.bridged == 3
    assert "3 of them were bridged linearly" in colour.notes[0]
    assert colour.swatch.lab == pytest.approx(whole, abs=1e-6)


@pytest.mark.parametrize(
    ("unknown", "found"),
    [
        (slice(0, 8), "from 460 to 780 nm"),
        (slice(10, 17), "a hole of 80 nm"),
        (slice(1, 40, 3), "14|13 of 41 visible wavelengths"),
        (slice(None), "known at 0 wavelengths"),
    ],
)
def test_too_little_of_a_spectrum_gives_no_colour(unknown: slice, found: str) -> None:
    holed = np.full(len(WAVELENGTH), 0.4)
    holed[unknown] = np.nan
    with pytest.raises(InputError, match=found):
        colour_of(prediction(holed))


def test_a_colour_difference_uses_the_range_of_both() -> None:
    short = prediction(0.4, wavelength_nm=np.arange(420.0, 691.0, 10.0))
    found = difference(short, prediction(0.4))
    assert found.range_nm == (420.0, 690.0)
    assert found.ciede2000 == pytest.approx(0.0, abs=1e-9)


def test_an_unknown_illuminant_is_refused_with_its_likes() -> None:
    with pytest.raises(InputError, match="D56"):
        colour_of(prediction(0.4), "D56")
