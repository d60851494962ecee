"""Geometry of the drawings, the way through the map, text that stays text."""

from __future__ import annotations

import math
from html.parser import HTMLParser

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenarios.report.bench_drawing import draw_bench, lengths, panel_corners_mm
from scenarios.report.build import flattened
from scenarios.report.figure import figure_style, literal, new_figure, series_style, svg_of
from scenarios.report.map_plot import draw_maps, median_g, slice_at_g
from scenarios.report.reading import content_of
from scenarios.report.result_plots import nines
from scenarios.report.through_map import intensities_of, intensities_through, map_for
from tests.report.fake import (
    RHO_WHITE,
    WAVELENGTH,
    estimate,
    fake_map,
    ink,
    intensities,
    rho_black,
    visit,
)
from twin.bench import Backgrounds, Bench, Panel, Sample

ANGLES = st.floats(0, 84), st.floats(-180, 360)


@given(*ANGLES, st.floats(1, 500), st.floats(1, 500))
def test_panel_corners_span_a_rectangle_that_faces_the_origin(
    polar: float, azimuth: float, width: float, length: float
) -> None:
    panel = Panel(polar_deg=polar, azimuth_deg=azimuth, width_mm=width, length_mm=length)
    corners = panel_corners_mm(panel)
    centre = np.array(panel.centre_mm)
    np.testing.assert_allclose(corners.mean(axis=0), centre, atol=1e-9)
    np.testing.assert_allclose((corners - centre) @ centre, 0, atol=1e-6)
    sides = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    np.testing.assert_allclose(sorted(sides), sorted([width, width, length, length]), rtol=1e-9)


def test_default_panels_have_their_long_side_along_y() -> None:
    corners = panel_corners_mm(Bench().panels[0])
    assert np.ptp(corners[:, 1]) == pytest.approx(283)
    assert np.ptp(corners[:, 0]) == pytest.approx(141 * math.cos(math.pi / 4))


@pytest.mark.parametrize(
    "described",
    [
        Bench(size_mm=None, covers_above=(), covers_below=()),
        Bench(background=Backgrounds(gap_mm=0)),
        Bench(panels=tuple(Panel(azimuth_deg=45 * k, polar_deg=30) for k in range(8))),
        Bench(panels=(Panel(polar_deg=0),)),
    ],
)
def test_any_bench_can_be_drawn(described: Bench) -> None:
    samples = [Sample(name="cuvette", thickness_mm=10.0)]
    svg = draw_bench(described, samples)
    assert svg.startswith("<svg viewBox=")
    assert "sample 10 mm" in svg
    assert ("Stack", "unbounded; no covers") in lengths(described, samples) or described.size_mm


def test_drawing_names_the_lengths_of_the_description() -> None:
    svg = draw_bench(
        Bench(panels=(Panel(distance_mm=512.0),)),
        [Sample(name="b", thickness_mm=0.83), Sample(name="a", thickness_mm=0.41)],
    )
    for words in ("512 mm", "sample 0.41 mm (also 0.83)", "cover 0.15 mm, n 1.52", "⌀ 4 mm"):
        assert words in svg


def test_map_gives_its_nodes_back_and_nothing_outside() -> None:
    found = fake_map(0.4)
    grid = intensities_of(found, 0.02, 0.99)
    at = (np.array([3, 20, 38]), np.array([0, 25, 49]), np.array([0, 3, 5]))
    properties = np.stack([found.albedo[at[0]], found.sigma_t_per_mm[at[1]], found.g[at[2]]])
    dark, bright = np.full(3, 0.02), np.full(3, 0.99)
    through = intensities_through([found], 0.4, properties, dark, bright)
    assert through is not None
    np.testing.assert_allclose(through.T, grid[at], rtol=1e-9)
    beyond = intensities_through([found], 0.4, properties * [[1], [100], [1]], dark, bright)
    assert beyond is not None
    assert np.isnan(beyond[:, 2]).all()


def test_between_nodes_the_map_follows_the_closed_form() -> None:
    properties = np.stack(ink(WAVELENGTH))
    black, white = rho_black(WAVELENGTH), np.full(WAVELENGTH.shape, RHO_WHITE)
    through = intensities_through([fake_map(0.4)], 0.4, properties, black, white)
    truth = intensities(WAVELENGTH, (0.4,), tuple(properties))[0]
    assert through is not None
    np.testing.assert_allclose(through, truth, rtol=5e-3)
    other = intensities_through([fake_map(0.44)], 0.44, properties, black, white)
    assert other is not None
    assert np.abs(other / truth - 1).max() > 5e-3  # another thickness is not the same map


def test_a_map_of_another_thickness_is_never_used() -> None:
    maps = [fake_map(0.4)]
    assert map_for(maps, 0.4) is maps[0]
    assert map_for(maps, 0.401) is None
    measurement = visit()
    content = content_of(measurement, estimate(measurement), ())
    assert draw_maps(content, [fake_map(0.5)]) is None
    one = draw_maps(content, maps)
    assert one is not None
    assert "magenta thin" in one
    assert "magenta thick" not in one


def test_slice_between_two_g_lies_between_them() -> None:
    found = fake_map(0.4)
    middle = 0.5 * (found.g[2] + found.g[3])
    low, high = (intensities_of(found, 0.02, 0.99)[:, :, k] for k in (2, 3))
    np.testing.assert_allclose(slice_at_g(found, middle, 0.02, 0.99), 0.5 * (low + high))
    measurement = visit()
    content = content_of(measurement, estimate(measurement), ())
    assert median_g(content, found) == pytest.approx(0.705, abs=0.01)


def test_albedo_axis_counts_nines() -> None:
    np.testing.assert_allclose(nines(np.array([0, 0.9, 0.99, 0.999])), [0, 1, 2, 3], atol=1e-12)
    assert np.isfinite(nines(np.array([1.0, 1.2]))).all()
    assert np.isnan(nines(np.array([np.nan]))).all()


class Texts(HTMLParser):
    """The text elements of a drawing."""

    def __init__(self, svg: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.texts: list[str] = []
        self.feed(svg)

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.tags.append(tag)

    def handle_data(self, data: str) -> None:
        self.texts.append(data.strip())


@settings(max_examples=30)
@given(st.text(st.characters(exclude_categories=("C", "Z")), min_size=1, max_size=20))
def test_any_name_stays_text_in_a_drawing(name: str) -> None:
    with figure_style():
        figure = new_figure(2, 1)
        figure.add_subplot().set_title(literal(name))
        svg = svg_of(figure, "x", name)
    found = Texts(svg)
    assert name in found.texts
    assert "script" not in found.tags
    assert found.tags.count("svg") == 1


def test_samples_beyond_six_differ_in_marker() -> None:
    styles = [series_style(index) for index in range(12)]
    assert len(set(styles)) == 12


def test_settings_become_rows() -> None:
    rows = dict(
        flattened({"a": {"b": [1, 2], "c": None}, "d": list(range(40)), "e": [{"f": True}]})
    )
    assert rows["a.b"] == "1, 2"
    assert rows["a.c"] == "none"
    assert rows["d"].endswith("(40 values)")
    assert rows["e[0].f"] == "yes"
