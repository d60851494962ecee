"""Other estimators, budgets and integrating spheres from the command line."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import NamedTuple

import pytest

from estimators import names
from scenarios.outputs import file_digest
from scenarios.pipeline import check_estimator
from scenarios.scenario import EstimatorChoice
from tests.scenarios.conftest import Run
from tests.scenarios.tiny import answer, call

SPHERELESS = """IAD1
1.4   # n of the sample
1.0   # n of the slides
1.0   # thickness [mm]
0.0   # of the slides
1.0   # beam [mm]
0.99  # standard
0     # spheres
2
500 0.30 0.40
510 0.32 0.38
"""


class Fitted(NamedTuple):
    """The tiny scenario estimated by least squares, with its budget."""

    folder: Path
    answer: dict


@pytest.fixture(scope="module")
def fitted(finished: Run, tmp_path_factory: pytest.TempPathFactory) -> Fitted:
    folder = tmp_path_factory.mktemp("fitted")
    result = call(
        "estimate", finished.folder / "measurement.nc", "--scenario", finished.scenario,
        "--estimator", "least-squares", "--budget", "--out", folder, "--cache", finished.cache,
        "--json",
    )  # fmt: skip
    return Fitted(folder, answer(result))


def test_estimate_with_another_estimator_and_a_budget(fitted: Fitted):
    found = fitted.answer
    assert found["estimator"] == "least-squares"
    assert abs(found["estimate"]["albedo"]["median"] - 0.8) < 0.02
    assert [row["parameter"] for row in found["budget"]] == ["albedo", "sigma_t_per_mm", "g"]
    assert found["files"]["budget.csv"] == file_digest(fitted.folder / "budget.csv")
    settings = json.loads((fitted.folder / "scenario.json").read_text())
    assert settings["estimator"] == {"name": "least-squares", "options": {}}


def test_the_report_has_the_solver_and_the_budget(fitted: Fitted, finished: Run):
    page = (fitted.folder / "report.html").read_text(encoding="utf-8")
    assert '<section id="solver">' in page
    assert '<section id="budget">' in page
    assert "chi square" in page
    assert "0.01 mm, each sample" in page
    without = (finished.folder / "report.html").read_text(encoding="utf-8")
    assert '<section id="solver">' not in without
    assert '<section id="budget">' not in without


def test_budget_writes_what_it_names(finished: Run, tmp_path: Path):
    arguments = (
        "budget", finished.folder / "measurement.nc", "--scenario", finished.scenario,
        "--cache", finished.cache, "--json", "--quiet",
    )  # fmt: skip
    found = answer(call(*arguments, "--out", tmp_path / "one", "--thickness", 0.02, "--draws", 20))
    folder = tmp_path / "one"
    assert {path.name for path in folder.iterdir()} == {*found["files"], "summary.json"}
    assert found["stated"]["thickness_mm"] == 0.02
    assert found["monte_carlo_draws"] == 20
    assert found["improve_first"]["sigma_t_per_mm"] == "thickness"
    rows = list(csv.DictReader((folder / "budget.csv").open()))
    assert len(rows) == 9 * 3 * 9  # wavelengths, parameters, inputs and their sum
    page = (folder / "budget.html").read_text(encoding="utf-8")
    assert page.count("<svg") == 1
    assert "20 draws of all inputs" in page
    assert "http" not in page.replace("http-equiv", "")
    exact = answer(call(*arguments, "--out", tmp_path / "two", "--thickness", 0))
    assert exact["improve_first"]["sigma_t_per_mm"] != "thickness"


@pytest.mark.parametrize("name", names())
def test_every_estimator_can_be_chosen(name: str):
    check_estimator(EstimatorChoice(name=name))


def test_run_checks_another_estimator_before_the_work(tmp_path: Path):
    result = call("run", "quick", "--estimator", "least-sqares", "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert 'Did you mean "least-squares"' in result.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", ["run", "estimate"])
def test_a_budget_is_of_least_squares_alone(finished: Run, tmp_path: Path, command: str):
    what = {"run": finished.scenario, "estimate": finished.folder / "measurement.nc"}[command]
    result = call(command, what, "--estimator", "beer", "--budget", "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert "Add --estimator least-squares" in result.stderr
    assert not (tmp_path / "out").exists()


def test_a_number_that_is_no_uncertainty_is_refused(finished: Run, tmp_path: Path):
    result = call(
        "budget", finished.folder / "measurement.nc", "--n", -1, "--out", tmp_path / "out"
    )
    assert result.exit_code == 2
    assert "a standard uncertainty of 0 or more" in result.stderr
    assert not (tmp_path / "out").exists()


def test_spheres_reads_an_rxt_file(tmp_path: Path):
    file = tmp_path / "sheet.rxt"
    file.write_text(SPHERELESS)
    found = answer(call("spheres", file, "--g", 0.5, "--out", tmp_path / "out", "--json"))
    assert found["rows"] == 2
    assert found["g_held_rows"] == 2
    assert found["median"]["g"] == 0.5
    assert found["median"]["mu_a_per_mm"] > 0
    assert set(found["files"]) == {"sheet.json", "sheet.csv", "sheet.svg"}
    for name, digest in found["files"].items():
        assert file_digest(tmp_path / "out" / name) == digest


def test_estimate_sends_an_rxt_file_to_spheres(tmp_path: Path):
    file = tmp_path / "sheet.rxt"
    file.write_text(SPHERELESS)
    result = call("estimate", file, "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert f"benchtwin spheres {file}" in result.stderr


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--method", "magic"), "magic"),
        (("--g", "1.5"), "-0.98 to 0.98"),
        (("--incidence", "95"), "95"),
        (("--reference", "nowhere.txt"), "nowhere.txt"),
    ],
)
def test_wrong_options_of_spheres_get_one_message(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...], words: str
):
    monkeypatch.chdir(tmp_path)
    Path("sheet.rxt").write_text(SPHERELESS)
    result = call("spheres", "sheet.rxt", *options)
    assert result.exit_code == 2
    assert words in result.stderr
    assert "Traceback" not in result.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["sheet.rxt"]


def test_list_shows_plans_and_where_estimators_are_valid():
    found = answer(call("list", "--json"))
    assert {"default", "grid"} <= set(found["stress_plans"])
    assert "extinction coefficient only" in found["estimators"]["beer"]
