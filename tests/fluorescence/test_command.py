"""`benchtwin run`, `simulate`, `estimate`, `inspect`, `list` and `figures` for fluorescence."""

from __future__ import annotations

import json
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from estimators.fluorescence import FluorescenceStatus
from estimators.fluorescence.result_file import is_fluorescence_result, read_result, write_result
from scenarios.cli import app
from scenarios.figures import FLUORESCENCE_FIGURES
from scenarios.figures.fluorescence_runs import peaks, turns
from scenarios.figures.fluorescent_materials import generated
from scenarios.fluorescence.facts import regions
from scenarios.report_fluorescence.colour import appearance, lights_for
from twin.errors import InputError
from twin.fluorescence import (
    GRID_NM,
    example,
    from_mixture,
    is_fluorescence_visit,
    read_matrix_csv,
    read_mixture,
    read_visit,
    write_counts_csv,
    write_matrix_csv,
)

RUNNER = CliRunner()
OUTPUTS = {
    "cells.csv", "matrix.csv", "measurement.nc", "mixture.json", "report.html", "result.nc",
    "scenario.json", "summary.json",
}  # fmt: skip
OWN = """title = "Own"
material = {material}
[setup]
name = "own"
detector = "{detector}"
white = 0.99
price_usd = 10
{more}
"""
LED = """[[setup.lights]]
kind = "led"
name = "{name}"
peak_nm = {peak}
fwhm_nm = 18
"""


def command(*arguments: object) -> tuple[int, str, str]:
    result = RUNNER.invoke(app, [str(each) for each in arguments])
    return result.exit_code, result.stdout, result.stderr


def answer(*arguments: object) -> dict:
    code, out, err = command(*arguments, "--json")
    assert code == 0, err
    return json.loads(out)


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("fluorescence") / "run"
    summary = answer("run", "l1-s2", "--out", out, "--quiet", "--seed", 3)
    assert summary["setup"]["price_usd"] == 29
    assert summary["seed"] == 3
    return out


def own(tmp_path: Path, *, detector: str = "S1", more: str = "", material: str = '"white"') -> Path:
    path = tmp_path / "own.toml"
    path.write_text(OWN.format(detector=detector, more=more, material=material), encoding="utf-8")
    return path


def test_a_run_writes_everything_and_its_exports_read_back(ran: Path):
    assert {path.name for path in ran.iterdir()} == OUTPUTS
    result = read_result(ran / "result.nc")
    assert np.array_equal(read_matrix_csv(ran / "matrix.csv").matrix, result.matrix)
    cells = np.genfromtxt(ran / "cells.csv", delimiter=",", names=True, dtype=None, encoding=None)
    assert cells.size == 31 * 32 // 2
    at = np.searchsorted(GRID_NM, cells["emission_nm"]), np.searchsorted(
        GRID_NM, cells["excitation_nm"]
    )  # fmt: skip
    assert np.allclose(cells["upper_90"], result.quantile[-1][at], rtol=1e-8)
    exported = from_mixture(read_mixture(ran / "mixture.json"))
    assert np.abs(exported.matrix - result.matrix).max() < 0.05
    difference = (exported.matrix - result.matrix)[np.tril_indices(31, -1)]
    assert np.sqrt((difference**2).mean()) < 0.3 * np.sqrt((result.fluorescence**2).mean())
    summary = json.loads((ran / "summary.json").read_text(encoding="utf-8"))
    assert summary["errors"]["rmse_fluorescence"] < 0.003
    assert summary["errors"]["share_in_90_percent_interval"] > 0.8
    assert summary["mixture_rmse"] == pytest.approx(np.sqrt((difference**2).mean()))
    assert summary["used"] == summary["captures"] == 64


def test_a_result_file_comes_back_whole_and_a_damaged_one_does_not(ran: Path, tmp_path: Path):
    result = read_result(ran / "result.nc")
    again = read_result(write_result(result, tmp_path / "again.nc"))
    assert (tmp_path / "again.nc").read_bytes() == (ran / "result.nc").read_bytes()
    for name in ("matrix", "quantile", "draws", "residual", "undetermined", "emission_nm"):
        assert np.array_equal(getattr(again, name), getattr(result, name), equal_nan=True)
    assert again.status is result.status
    assert again.messages == result.messages
    assert not is_fluorescence_visit(ran / "result.nc")
    assert is_fluorescence_result(ran / "result.nc")
    assert not is_fluorescence_result(ran / "measurement.nc")
    raw = bytearray((ran / "result.nc").read_bytes())
    raw[len(raw) // 2] ^= 1
    (tmp_path / "damaged.nc").write_bytes(raw)
    with pytest.raises(InputError):
        read_result(tmp_path / "damaged.nc")


def test_the_same_seed_gives_the_same_bytes_and_scenario_json_repeats_the_run(
    ran: Path, tmp_path: Path
):
    answer("run", ran / "scenario.json", "--out", tmp_path / "again", "--quiet")
    answer("simulate", "l1-s2", "--out", tmp_path / "other", "--quiet", "--seed", 4)
    for name in OUTPUTS - {"summary.json"}:  # it holds the scenario's name
        assert (tmp_path / "again" / name).read_bytes() == (ran / name).read_bytes(), name
    other = (tmp_path / "other" / "measurement.nc").read_bytes()
    assert other != (ran / "measurement.nc").read_bytes()


class _Page(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.ids: list[str] = []
        self.links: list[str] = []
        self.tags: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        for name, value in attrs:
            if name == "id" and value:
                self.ids.append(value)
            if name in ("href", "xlink:href", "src") and value:
                self.links.append(value)


def test_the_report_is_one_offline_page_that_shows_what_it_should(ran: Path):
    text = (ran / "report.html").read_text(encoding="utf-8")
    page = _Page()
    page.feed(text)
    assert len(page.ids) == len(set(page.ids))
    assert all(link.startswith("#") for link in page.links)
    assert page.tags.count("svg") == 6
    assert not {"script", "img", "image", "link"} & set(page.tags)
    assert "http" not in re.sub(r"http-equiv", "", text)
    for words in (
        "Estimate minus truth", "Width of the 90 % interval", "Excitation wavelength [nm]",
        "Emission wavelength [nm]", "under D65", "under A", "under FL4", "under 450 nm",
        "CIEDE2000", "Reflectance (the diagonal)", "29 USD", "standard deviation [–]",
    ):  # fmt: skip
        assert words in text, words
    assert FluorescenceStatus.OK.cause in text
    weights = [g.weight for g in read_mixture(ran / "mixture.json").gaussians]
    assert f"{weights.count(0.0)} of the {len(weights)} Gaussians" in text
    assert text.count('<td class="number">') == 5 * sum(weight > 0.0 for weight in weights)
    assert len(text) < 2_000_000


def test_a_folder_by_hand_with_a_dead_reading_and_a_baseline_without_intervals(
    ran: Path, tmp_path: Path
):
    folder = _by_hand(ran, tmp_path)
    counts = (folder / "counts.csv").read_text(encoding="utf-8").splitlines()
    row = next(k for k, line in enumerate(counts) if line.startswith("sample,violet"))
    counts[row] = counts[row].rsplit(",", 1)[0] + ",nan"
    (folder / "counts.csv").write_text("\n".join(counts) + "\n", encoding="utf-8")
    out = tmp_path / "out"
    found = answer("estimate", folder, "--out", out, "--quiet", "--estimator", "blasinski")
    assert found["estimator"] == "blasinski"
    assert found["origin"] == "handmade"
    assert found["used"] == 63
    assert found["status"] == "masked"
    assert any("masked" in message and "'violet'" in message for message in found["messages"])
    assert "errors" not in found
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "This estimator gives no band." in page
    assert "Width of the 90 % interval" not in page
    assert "Truth" not in page
    assert ",,," in (out / "cells.csv").read_text(encoding="utf-8")
    assert read_result(out / "result.nc").draws is None
    assert answer("inspect", folder)["dead_readings"] == 1


def _by_hand(ran: Path, tmp_path: Path) -> Path:
    folder = tmp_path / "visit"
    folder.mkdir()
    write_counts_csv(read_visit(ran / "measurement.nc"), folder)
    (folder / "visit.toml").write_text(
        'sample = "marker"\n[setup]\nlights = "L1"\ndetector = "S2"\n', encoding="utf-8"
    )
    return folder


def test_channels_in_the_wrong_order_are_refused(ran: Path, tmp_path: Path):
    folder = _by_hand(ran, tmp_path)
    text = (folder / "counts.csv").read_text(encoding="utf-8")
    (folder / "counts.csv").write_text(text.replace("F1,F2", "F2,F1"), encoding="utf-8")
    code, out, err = command("estimate", folder, "--out", tmp_path / "out", "--json")
    assert code == 2
    assert "F2, F1" in err
    assert "another order" in json.loads(out)["error"]["remedy"]
    assert not (tmp_path / "out" / "result.nc").exists()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"more": 'lights = "L1"\nwhite_material = "brightened_paper"'}, "white"),
        ({"more": LED.format(name="far", peak=900)}, "far"),
        ({"more": 'lights = "L1"', "material": '"missing.csv"'}, "missing.csv"),
    ],
    ids=["fluorescent white", "no overlap", "no file"],
)
def test_what_cannot_be_measured_is_refused_in_one_sentence(
    tmp_path: Path, change: dict[str, str], words: str
):
    path = own(tmp_path, **change)
    code, _, err = command("run", path, "--out", tmp_path / "out", "--quiet")
    assert code == 2
    assert words in err
    assert err.count("\n") == 1
    assert not (tmp_path / "out" / "result.nc").exists()


def test_lights_that_miss_a_region_leave_named_and_widened_cells(tmp_path: Path):
    lights = "".join(LED.format(name=f"led_{peak}", peak=peak) for peak in (530, 592, 634))
    path = own(tmp_path, more=lights, material='"yellow_and_pink"')
    found = answer("run", path, "--out", tmp_path / "out", "--quiet")
    assert found["status"] == "undetermined_cells"
    assert found["undetermined_cells"] > 100
    assert found["undetermined"][0].startswith("excitation 400 to ")
    result = read_result(tmp_path / "out" / "result.nc")
    width = result.quantile[-1] - result.quantile[0]
    below = np.tril(np.ones((31, 31), dtype=bool), -1)
    seen = width[below & ~result.undetermined]
    assert np.median(width[below & result.undetermined]) > 5.0 * np.median(seen)
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "hatched: undetermined" in page
    assert found["undetermined"][0] in page


def test_energy_below_the_diagonal_is_removed_and_said(tmp_path: Path):
    matrix = example("pink_paper")
    text = write_matrix_csv(matrix, tmp_path / "own.csv").read_text(encoding="utf-8").splitlines()
    fields = text[1].split(",")
    fields[-1] = "0.01"  # emission 400 nm, excitation 700 nm
    text[1] = ",".join(fields)
    (tmp_path / "own.csv").write_text("\n".join(text) + "\n", encoding="utf-8")
    path = own(tmp_path, detector="S2", more='lights = "L1"', material='"own.csv"')
    found = answer("run", path, "--out", tmp_path / "out", "--quiet", "--estimator", "blasinski")
    assert any("below the diagonal removed" in note for note in found["notes"])
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "below the diagonal removed" in page


def test_options_of_the_other_bench_are_refused_and_names_are_corrected(ran: Path):
    code, _, err = command("run", "l1-s3")
    assert code == 2
    assert "fluorescence scenario 'l1-s3'" in err
    assert "l2-s2" in err
    visit = ran / "measurement.nc"
    for extra, words in (
        (("--budget",), "--budget"),
        (("--scenario", "chip"), "no --scenario"),
        (("--estimator", "lut"), "gmm-adam"),
    ):
        code, _, err = command("estimate", visit, "--out", ran.parent / "no", *extra)
        assert code == 2
        assert words in err
    assert not (ran.parent / "no").exists()


def test_inspect_and_list_know_fluorescence(ran: Path):
    visit = answer("inspect", ran / "measurement.nc")
    assert visit["kind"] == "fluorescence visit"
    assert visit["setup"]["price_usd"] == 29
    assert set(visit["shots"]) == {"dark", "white", "sample"}
    assert answer("inspect", ran / "result.nc")["kind"] == "fluorescence estimate"
    assert answer("inspect", "l2-s1")["setup"]["price_usd"] == 2165
    listed = answer("list", "fluorescence_scenarios")["fluorescence_scenarios"]
    assert "29 USD" in listed["l1-s2"]
    assert "20,500 USD" in listed["reference"]
    names = set(answer("list", "fluorescence_estimators")["fluorescence_estimators"])
    assert {"donaldson", "gmm-adam", "blasinski"} <= names


def test_resume_uses_the_same_visit_and_no_other(ran: Path, tmp_path: Path):
    shutil.copy(ran / "measurement.nc", tmp_path / "measurement.nc")
    resume = ("simulate", "l1-s2", "--out", tmp_path, "--resume", "--seed")
    assert "is used again" in command(*resume, 3)[2]
    assert "not resumed" in command(*resume, 5)[2]


def test_regions_name_every_flagged_cell():
    flagged = np.zeros((31, 31), dtype=bool)
    flagged[5:, :3] = True
    flagged[20, 10] = True
    assert regions(flagged, GRID_NM, GRID_NM) == [
        "excitation 400 to 420 nm, emission 450 to 700 nm (78 cells)",
        "excitation 500 nm, emission 600 nm (1 cell)",
    ]
    pierced = np.zeros((31, 31), dtype=bool)
    pierced[[8, 20], 3] = True
    pierced[8:21, 4] = True
    assert regions(pierced, GRID_NM, GRID_NM) == [
        "excitation 430 nm, emission 480 to 600 nm (2 cells)",
        "excitation 440 nm, emission 480 to 600 nm (13 cells)",
    ]


def test_a_perfect_diffuser_is_white_and_a_tinted_truth_is_not():
    white, tint = np.eye(31), np.diag(np.linspace(0.6, 1.0, 31))
    for light in lights_for(GRID_NM)[:3]:
        look = appearance(light, white, GRID_NM, GRID_NM, draws=white[None], truth=tint)
        assert look.patch.lab == pytest.approx([100.0, 0.0, 0.0], abs=1e-6)
        assert look.patch.hexadecimal == "#ffffff"
        assert look.uncertainty == pytest.approx(0.0, abs=1e-6)
        assert look.difference is not None
        assert look.difference > 5.0
    green = next(light for light in lights_for(GRID_NM) if light.wavelength_nm == 530.0)
    assert appearance(green, white, GRID_NM, GRID_NM).patch.lab[1] < -50.0


DOCS = Path(__file__).resolve().parents[2] / "docs"


def test_figures_of_chapter_5_are_made_again_with_the_same_bytes(tmp_path: Path):
    make = ("figures", "--chapter", 5, "--quick", "--quiet")
    found = answer(*make, tmp_path / "one", "fluorescence10")
    assert {Path(name).name for name in found["files"]} == {
        "fluorescence10.svg", "fluorescence10.png", "figures_fluorescence.json",
    }  # fmt: skip
    checks = json.loads((tmp_path / "one" / "figures_fluorescence.json").read_text("utf-8"))
    assert "fluorescence7" not in checks
    assert checks["fluorescence10"]["turns"].keys() == {"truth", "gmm-adam", "blasinski",
                                                        "donaldson"}  # fmt: skip
    assert checks["fluorescence10"]["share_in_90_percent_interval"] > 0.6
    for extra, words in (
        (("figure6",), "figure6"),
        (("--materials", tmp_path / "none"), "--materials"),
        (("--materials", tmp_path), "0 .BFC files"),
    ):
        code, _, err = command(*make, tmp_path / "two", *extra)
        assert code == 2
        assert words in err
    assert command("figures", tmp_path, "--chapter", 6)[0] == 2


def test_generated_materials_are_possible_and_two_have_the_reflectance_of_the_first():
    found = generated(6, 1)
    for matrix in (*found.one, *found.two):
        assert matrix.matrix.min() >= 0.0
        assert matrix.photon_yield.max() < 1.0
    # The seed's sums of two keep the first's reflectance, so only single ones keep the energy.
    assert all((each.matrix.sum(axis=0) <= 1.0).all() for each in found.one)
    reflectances = [each.reflectance.tolist() for each in found.one]
    assert all(each.reflectance.tolist() in reflectances for each in found.two)
    assert not np.array_equal(generated(6, 2).one[0].matrix, found.one[0].matrix)
    assert np.array_equal(generated(3, 1).one[2].matrix, found.one[2].matrix)


def test_peaks_and_turns_count_hills():
    out, into = GRID_NM[:, None], GRID_NM[None, :]
    hill = np.exp(-(((out - 560.0) / 30.0) ** 2) - ((into - 450.0) / 30.0) ** 2)
    other = np.exp(-(((out - 660.0) / 30.0) ** 2) - ((into - 560.0) / 30.0) ** 2)
    assert peaks(hill) == 1
    assert peaks(hill + 0.5 * other) == 2
    assert peaks(hill + 0.05 * other) == 1
    assert turns(np.linspace(0.2, 0.8, 31)) == 0
    assert turns(0.5 + 0.1 * np.cos(GRID_NM * 2.0 * np.pi / 150.0)) == 4


def _numbers(value: object) -> set[str]:
    if isinstance(value, dict):
        return set().union(*map(_numbers, value.values()))
    return {f"{value:.3g}"} if isinstance(value, (int, float)) else set()


def test_the_page_on_the_figures_quotes_what_was_computed():
    page = (DOCS / "figures_fluorescence.md").read_text(encoding="utf-8")
    path = DOCS / "images" / "figures_fluorescence.json"
    known = json.loads(path.read_text(encoding="utf-8"))
    assert known["quick"] is False
    found = _numbers(known)
    said = [f"{float(number):.3g}" for number in re.findall(r"\*\*([\d.]+)\*\*", page)]
    assert len(said) > 30
    assert [number for number in said if number not in found] == []
    assert "0.987" not in found, "the control: not every number is in there"
    for name in FLUORESCENCE_FIGURES:
        assert f"images/{name}.svg" in page
        for kind in ("svg", "png"):
            assert (DOCS / "images" / f"{name}.{kind}").stat().st_size < 300_000
