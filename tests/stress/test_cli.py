"""The command: files, exit codes, options."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from scenarios.outputs import file_digest
from scenarios.stress.tables import PLAN, POINTS, REPORT, SCORES, SUMMARY, TIMING
from tests.scenarios.tiny import answer, call
from tests.stress.tiny import tiny, write


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, dict]:
    base = tmp_path_factory.mktemp("stress")
    plan = write(base / "plan.toml", tiny())
    options = ("--out", base / "out", "--cache", base / "cache", "--json")
    return plan, base, answer(call("stress", plan, *options))


def test_it_writes_what_it_names(run: tuple[Path, Path, dict]):
    _, base, printed = run
    folder = base / "out"
    names = {path.name for path in folder.iterdir() if path.is_file()}
    assert names == {PLAN, POINTS, REPORT, SCORES, SUMMARY, TIMING}
    assert printed["files"] == {n: file_digest(folder / n) for n in (PLAN, POINTS, REPORT, SCORES)}
    kept = json.loads((folder / SUMMARY).read_text())
    assert kept == {
        k: v for k, v in printed.items() if k not in ("folder", "seconds_per_1000_wavelengths")
    }
    assert printed["seconds_per_1000_wavelengths"][0]["seconds"] > 0
    rows = list(csv.DictReader((folder / POINTS).open()))
    assert len(rows) == printed["points"] == 12
    assert all(float(row["sigma_t_per_mm_true"]) > 0 for row in rows)


def test_the_report_needs_nothing_else(run: tuple[Path, Path, dict]):
    page = (run[1] / "out" / REPORT).read_text(encoding="utf-8")
    assert page.startswith("<!DOCTYPE html>")
    assert page.count("<svg") == 3
    assert "<image" not in page  # the page's own policy would not show one
    assert "http" not in page.replace("http-equiv", "")
    assert "beer errs least" in page


def test_options_replace_the_plan(run: tuple[Path, Path, dict]):
    plan, base, printed = run
    options = ("--cache", base / "cache", "--json", "--points", "6", "--seed", "4", "--quiet")
    other = answer(call("stress", plan, "--out", base / "other", *options))
    assert (other["points"], other["seed"]) == (6, 4)
    assert printed["points"] == 12


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("nowhere.toml",), "no such file"),
        (("defualt",), "Did you mean `default`"),
        (("default", "--estimators", "nobody"), "nobody"),
        (("default", "--points", "1"), "points"),
        (("grid", "--points", "9"), "random design only"),
    ],
)
def test_wrong_input_gets_one_message_and_exit_code_2(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], words: str
):
    monkeypatch.chdir(tmp_path)
    result = call("stress", *arguments)
    assert result.exit_code == 2
    assert words in result.stderr
    assert "Traceback" not in result.stderr
    assert list(tmp_path.iterdir()) == []
