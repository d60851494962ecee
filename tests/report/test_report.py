"""The report as a file: every section, nothing fetched, the same bytes, plain words for gaps."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from estimators.result import EstimateResult, Status
from scenarios.report import build, write_report
from tests.report.fake import (
    CHIP,
    THICKNESS,
    WAVELENGTH,
    bench,
    estimate,
    fake_map,
    ink,
    intensities,
    visit,
)
from twin.bench import Sample
from twin.errors import InputError
from twin.measurement import Measurement, RelativeRow, RelativeSpectra, relative_intensities

SECTIONS = (
    "verdict", "properties", "colour", "map", "residuals", "beer", "relative", "counts", "bench",
    "lights", "masked", "settings", "again",
)  # fmt: skip
FIGURES = ("bench", "lights", "counts", "relative", "map", "properties", "residuals", "beer")
STATUSES = {
    **dict.fromkeys(range(3), Status.MASKED),
    **dict.fromkeys(range(30, 34), Status.OUTSIDE_MAP),
    **dict.fromkeys(range(50, 60), Status.NOT_IDENTIFIABLE),
}
SETTINGS = {
    "title": "Magenta ink",
    "command": "benchtwin run default --seed 1",
    "protocol": {"repeats": 3},
}


class Page(HTMLParser):
    """What a browser would find: elements, ids, references, text by element."""

    def __init__(self, html: str) -> None:
        super().__init__(convert_charrefs=True)
        self.tags: Counter[str] = Counter()
        self.ids: list[str] = []
        self.references: list[str] = []
        self.texts: list[str] = []
        self._inside: list[str] = []
        self.feed(html)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags[tag] += 1
        self._inside.append(tag)
        for name, value in attrs:
            if name == "id":
                self.ids.append(value or "")
            if name in ("href", "xlink:href", "src", "srcset", "data", "action", "poster"):
                self.references.append(value or "")
            if name.startswith("on"):
                self.tags["handler"] += 1
            self.references += re.findall(r"url\(([^)]*)\)", value or "")

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        self._inside.pop()

    def handle_endtag(self, tag: str) -> None:
        while self._inside and self._inside.pop() != tag:
            pass

    def handle_data(self, data: str) -> None:
        if not {"style", "script"} & set(self._inside):
            self.texts.append(data)

    @property
    def text(self) -> str:
        return re.sub(r"\s+", " ", " ".join(self.texts))


def written(
    folder: Path, measurement: Measurement, result: EstimateResult, *, maps: bool = True
) -> str:
    path = write_report(
        measurement,
        result,
        folder / "report.html",
        maps=[fake_map(thickness) for thickness in THICKNESS] if maps else None,
        settings=SETTINGS,
    )
    return path.read_text("utf-8")


@pytest.fixture(scope="module")
def full(tmp_path_factory: pytest.TempPathFactory) -> str:
    measurement = visit(saturated=6)
    return written(tmp_path_factory.mktemp("full"), measurement, estimate(measurement, STATUSES))


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A chip, no truth, no maps, no settings, g not estimated."""
    measurement = visit(chip=True, truth=False)
    result = estimate(measurement)
    two = replace(
        result,
        g=np.full(CHIP.size, np.nan),
        covariance=np.where(np.arange(3) == 2, np.nan, result.covariance),
        quantile=np.where(np.arange(3) == 2, np.nan, result.quantile),
        identifiable=result.identifiable & (np.arange(3) < 2),
    )
    path = tmp_path_factory.mktemp("bare") / "report.html"
    return write_report(measurement, two, path).read_text("utf-8")


@pytest.mark.parametrize("section", SECTIONS)
def test_every_section_is_there(full: str, bare: str, section: str) -> None:
    for html in (full, bare):
        assert html.count(f'<section id="{section}"') + html.count(f'id="{section}"') >= 1
        assert f'href="#{section}"' in html or section == "verdict"


def test_every_figure_is_drawn_and_described(full: str) -> None:
    page = Page(full)
    assert page.tags["svg"] == len(FIGURES)
    assert full.count('<svg viewBox="') == full.count('role="img" aria-label="') - 1  # and the bar
    for name in FIGURES:
        assert f'id="{name}-figure_1"' in full


def test_axes_have_units(full: str) -> None:
    text = Page(full).text
    for label in ("Wavelength [nm]", "σt [1/mm]", "x [mm]", "z [mm]", "Reflectance [%]",
                  "Residual [σ]", "Relative intensity [–]", "Counts per shot"):  # fmt: skip
        assert label in text


def test_nothing_is_fetched_and_nothing_runs(full: str, bare: str) -> None:
    for html in (full, bare):
        page = Page(html)
        assert "http://" not in html
        assert "https://" not in html
        assert "@import" not in html
        assert not {"script", "link", "iframe", "object", "img", "handler"} & set(page.tags)
        assert page.references
        assert all(reference.startswith("#") for reference in page.references)
        assert not re.search(r"url\((?!#)", html)


def test_ids_are_unique_and_references_lead_somewhere(full: str) -> None:
    page = Page(full)
    assert [name for name, count in Counter(page.ids).items() if count > 1] == []
    assert {reference[1:] for reference in page.references} <= set(page.ids)


def test_the_same_bytes_again_whatever_the_plot_settings(full: str, tmp_path: Path) -> None:
    import matplotlib

    measurement = visit(saturated=6)
    with matplotlib.rc_context({"font.size": 23, "svg.hashsalt": None, "lines.linewidth": 9}):
        before = dict(matplotlib.rcParams)
        again = written(tmp_path, measurement, estimate(measurement, STATUSES))
        assert dict(matplotlib.rcParams) == before
    assert again == full


def test_other_data_give_other_bytes(full: str, tmp_path: Path) -> None:
    measurement = visit(saturated=6)
    result = estimate(measurement, STATUSES)
    assert written(tmp_path, measurement, replace(result, g=result.g + 0.01)) != full


def test_verdict_counts_what_became_of_the_wavelengths(full: str) -> None:
    text = Page(full).text
    total = WAVELENGTH.size
    assert f"({total - len(STATUSES)} of {total} wavelengths without any warning)" in text
    assert "10 with a warning; 3 masked (no usable data); 4 outside the appearance map" in text
    assert "Median distance to the truth: albedo" in text
    assert "Measured: magenta thin, 0.4 mm; magenta thick, 0.8 mm" in text


def test_masked_pixels_are_counted_with_their_reason(full: str) -> None:
    text = Page(full).text
    assert f"6 of {6 * WAVELENGTH.size} relative intensities were masked" in text
    assert "saturated" in text
    assert Status.OUTSIDE_MAP.remedy in text
    assert Status.NOT_CONVERGED.cause not in text  # what did not occur is not listed


def test_outside_the_map_is_not_drawn_as_an_estimate(full: str) -> None:
    from scenarios.report.reading import content_of

    measurement = visit()
    content = content_of(measurement, estimate(measurement, STATUSES), ())
    outside = np.array([STATUSES.get(i) == Status.OUTSIDE_MAP for i in range(WAVELENGTH.size)])
    assert np.isnan(content.estimate.value[:, outside]).all()
    assert np.isfinite(content.estimate.value[:, 10:30]).all()
    assert "outside the map: 4" in Page(full).text


def test_settings_versions_seed_fingerprint_and_command_are_said(full: str) -> None:
    text = Page(full).text
    measurement = visit(saturated=6)
    for words in (measurement.fingerprint, "5a" * 32, "protocol.repeats", "numpy", "matplotlib",
                  "benchtwin run default --seed 1", "simulated on the digital twin",
                  "panels[1].azimuth_deg", "epsilon"):  # fmt: skip
        assert words in text


def test_swatches_state_their_range_and_differences(full: str) -> None:
    text = Page(full).text
    assert text.count("ΔE00 measured to truth") == 4
    assert "nothing is extrapolated" in text
    assert len(re.findall(r'class="field" style="background: #[0-9a-f]{6}"', full)) == 12


def test_what_is_missing_is_said(bare: str) -> None:
    text = Page(bare).text
    for words in ("The truth is not known", "No appearance map came with this result",
                  "g was not estimated", "8 broad channels of a multispectral chip",
                  "the colours are rough", "The command line was not recorded"):  # fmt: skip
        assert words in text
    assert not re.search(r"\bnan\b", text, re.IGNORECASE)


def test_few_pixels_of_a_spectrometer_are_not_a_chip(tmp_path: Path) -> None:
    measurement = visit(truth=False, wavelength=np.arange(400.0, 701.0, 30.0))
    text = Page(written(tmp_path, measurement, estimate(measurement))).text
    assert "11 wavelengths from 400 to 700 nm" in text
    assert "Few wavelengths, joined linearly" in text
    assert "multispectral chip" not in text
    assert "broad channels" not in text


def test_relative_intensities_made_by_hand(tmp_path: Path) -> None:
    values = intensities(WAVELENGTH, THICKNESS, ink(WAVELENGTH))
    names = ("thin", "thick")
    rows = tuple(RelativeRow(n, c) for n in names for c in ("black", "white", "collimated"))
    measurement = Measurement(
        bench=bench(),
        samples=tuple(
            Sample(name=n, thickness_mm=t) for n, t in zip(names, THICKNESS, strict=True)
        ),
        relative=RelativeSpectra(
            rows, WAVELENGTH, values.reshape(6, -1), np.full((6, WAVELENGTH.size), 0.002)
        ),
    )
    text = Page(written(tmp_path, measurement, estimate(measurement))).text
    assert "This measurement has no raw counts" in text
    assert "none: a real measurement, or not recorded" in text


def test_no_wavelength_usable(tmp_path: Path) -> None:
    measurement = visit(truth=False)
    lost = dict.fromkeys(range(WAVELENGTH.size), Status.OUTSIDE_MAP)
    text = Page(written(tmp_path, measurement, estimate(measurement, lost))).text
    assert "Most wavelengths have no estimate to rely on" in text
    assert "not determined by these captures" in text
    assert not re.search(r"\bnan\b", text, re.IGNORECASE)


def test_names_are_text_and_nothing_else(tmp_path: Path) -> None:
    names = ("<script>alert(1)</script>", '"x\' onload=alert(1) $a_1$ id="y" & {{ 7*7 }} -->')
    measurement = visit(names=names)
    html = written(tmp_path, measurement, estimate(measurement))
    page = Page(html)
    assert page.tags["script"] == 0
    assert page.tags["handler"] == 0
    assert "y" not in page.ids
    for name in names:
        assert name in page.text
        assert any(name in text for text in page.texts if "mm" in text)  # in a figure's legend


def test_a_failure_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "report.html"
    path.write_text("old")

    def fails(*_arguments: object, **_options: object) -> str:
        raise RuntimeError("half way")

    monkeypatch.setattr(build, "render", fails)
    measurement = visit()
    with pytest.raises(RuntimeError, match="half way"):
        write_report(measurement, estimate(measurement), path)
    assert path.read_text() == "old"
    assert [file.name for file in tmp_path.iterdir()] == ["report.html"]


def test_a_path_that_cannot_be_written(tmp_path: Path) -> None:
    measurement = visit()
    with pytest.raises(InputError, match="a folder"):
        write_report(measurement, estimate(measurement), tmp_path)


def test_a_result_of_another_measurement_is_refused(tmp_path: Path) -> None:
    measurement = visit()
    result = estimate(measurement)
    path = tmp_path / "report.html"
    with pytest.raises(InputError, match="samples"):
        write_report(measurement, replace(result, sample_names=("a", "b")), path)
    with pytest.raises(InputError, match="wavelengths"):
        write_report(measurement, replace(result, wavelength_nm=WAVELENGTH + 1), path)
    assert not path.exists()


def test_residuals_and_prediction_agree_with_the_result() -> None:
    from scenarios.report.reading import content_of

    measurement = visit()
    result = estimate(measurement)
    content = content_of(measurement, result, ())
    relative = relative_intensities(measurement)
    assert content.predicted is not None
    np.testing.assert_allclose(content.predicted, relative.value + result.residual)
    np.testing.assert_allclose(content.relative.sd, relative.sigma)
    low, high = content.estimate.low, content.estimate.high
    assert low is not None
    assert high is not None
    # A normal distribution's 90 % interval is 2 x 1.6449 standard deviations wide.
    np.testing.assert_allclose((high - low) / content.estimate.sd, 2 * 1.6448536, rtol=1e-6)


def test_intervals_that_miss_the_truth_are_said_first(tmp_path: Path) -> None:
    measurement = visit()
    result = estimate(measurement)
    narrow = replace(
        result, quantile=result.parameters + 0.05 * (result.quantile - result.parameters)
    )
    text = Page(written(tmp_path, measurement, narrow)).text
    assert "The estimate is further from the truth than it says" in text


def test_the_thickness_is_said_once() -> None:
    from scenarios.report.content import sample_label

    assert sample_label(Sample(name="ink 0.4 mm", thickness_mm=0.4)) == "ink 0.4 mm"
    assert sample_label(Sample(name="ink", thickness_mm=0.4)) == "ink, 0.4 mm"
