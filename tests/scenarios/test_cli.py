"""The command: what it prints, writes and returns, and that the same seed gives the same bytes."""

from __future__ import annotations

import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from scenarios.outputs import file_digest
from scenarios.scenario import builtin_names
from scenarios.wording import sentences
from tests.scenarios.conftest import Run
from tests.scenarios.tiny import answer, call, tiny, write

NUMBER = (int, float)
SUMMARY = {
    "scenario": str,
    "seed": int,
    "origin": str,
    "software": str,
    "measurement_fingerprint": str,
    "result_fingerprint": str,
    "samples": list,
    "estimator": str,
    "wavelengths": int,
    "wavelength_nm": list,
    "status": dict,
    "estimate": dict,
    "messages": list,
    "files": dict,
}
PARAMETER = {
    "determined": int,
    "median": NUMBER,
    "median_standard_error": NUMBER,
    "median_absolute_error": NUMBER,
    "share_in_90_percent_interval": NUMBER,
}


def misfits(value: dict[str, Any], schema: dict[str, Any]) -> list[str]:
    """Keys that are missing, unknown or of another type."""
    found = [f"{key} is missing" for key in schema if key not in value]
    found += [f"{key} is unknown" for key in value if key not in schema]
    found += [
        f"{key} is a {type(value[key]).__name__}"
        for key, kind in schema.items()
        if key in value and not isinstance(value[key], kind)
    ]
    return found


def test_run_prints_one_json_object_of_the_documented_form(finished: Run):
    printed = dict(finished.answer)
    assert printed.pop("folder") == str(finished.folder)
    assert misfits(printed, SUMMARY) == []
    assert sum(printed["status"].values()) == printed["wavelengths"] == 9
    assert set(printed["estimate"]) == {"albedo", "sigma_t_per_mm", "g"}
    for numbers in printed["estimate"].values():
        assert misfits(numbers, PARAMETER) == []
    assert json.loads((finished.folder / "summary.json").read_text()) == printed


def test_the_schema_check_can_fail():
    assert misfits({"scenario": 1, "other": 2}, {"scenario": str, "seed": int}) == [
        "seed is missing",
        "other is unknown",
        "scenario is a int",
    ]


def test_run_writes_the_files_it_names_and_nothing_else(finished: Run):
    files = finished.answer["files"]
    assert set(files) == {
        "measurement.nc", "scenario.json", "result.nc", "result.csv", "report.html",
    }  # fmt: skip
    assert {path.name for path in finished.folder.iterdir()} == {*files, "summary.json"}
    for name, digest in files.items():
        assert hashlib.sha256((finished.folder / name).read_bytes()).hexdigest() == digest


def test_the_estimate_is_near_the_truth(finished: Run):
    estimate = finished.answer["estimate"]
    assert abs(estimate["albedo"]["median"] - 0.8) < 0.05
    assert abs(estimate["sigma_t_per_mm"]["median"] - 3.0) < 0.15


def test_same_seed_same_bytes_whatever_the_threads_and_the_cache(finished: Run, tmp_path: Path):
    again = answer(
        call("run", finished.scenario, "--out", tmp_path / "o", "--cache", tmp_path / "c",
             "--threads", 1, "--json")
    )  # fmt: skip
    assert again["files"] == finished.answer["files"]
    assert file_digest(tmp_path / "o" / "summary.json") == file_digest(
        finished.folder / "summary.json"
    )


def test_another_seed_gives_other_bytes(finished: Run, tmp_path: Path):
    other = answer(call("simulate", finished.scenario, "--out", tmp_path, "--seed", 6, "--json"))
    assert other["measurement"]["seed"] == 6
    assert other["files"]["measurement.nc"] != finished.answer["files"]["measurement.nc"]


def test_scenario_json_repeats_the_run(finished: Run, tmp_path: Path):
    again = answer(call("simulate", finished.folder / "scenario.json", "--out", tmp_path, "--json"))
    assert again["files"]["measurement.nc"] == finished.answer["files"]["measurement.nc"]


def test_simulate_then_estimate_is_the_same_as_run(finished: Run, tmp_path: Path):
    answer(call("simulate", finished.scenario, "--out", tmp_path, "--json"))
    estimated = answer(
        call("estimate", tmp_path / "measurement.nc", "--scenario", finished.scenario,
             "--out", tmp_path, "--cache", finished.cache, "--json")
    )  # fmt: skip
    for name in ("result.nc", "result.csv"):
        assert estimated["files"][name] == finished.answer["files"][name]
    assert "measurement.nc" not in estimated["files"]


def test_resume_takes_the_measurement_of_the_same_scenario_only(finished: Run, tmp_path: Path):
    call("simulate", finished.scenario, "--out", tmp_path)
    before = (tmp_path / "measurement.nc").stat().st_mtime_ns
    kept = call("simulate", finished.scenario, "--out", tmp_path, "--resume")
    assert "is used again" in kept.stderr
    assert (tmp_path / "measurement.nc").stat().st_mtime_ns == before
    other = call("simulate", finished.scenario, "--out", tmp_path, "--resume", "--seed", 9)
    assert "another scenario, seed or version" in other.stderr
    assert json.loads((tmp_path / "scenario.json").read_text())["simulation"]["seed"] == 9


def test_resume_writes_the_settings_that_an_interrupt_left_out(finished: Run, tmp_path: Path):
    call("simulate", finished.scenario, "--out", tmp_path)
    settings = (tmp_path / "scenario.json").read_bytes()
    (tmp_path / "scenario.json").unlink()
    resumed = call("simulate", finished.scenario, "--out", tmp_path, "--resume")
    assert resumed.exit_code == 0, resumed.stderr
    assert (tmp_path / "scenario.json").read_bytes() == settings


def test_an_interrupt_names_resume_only_where_it_exists(monkeypatch: pytest.MonkeyPatch):
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("scenarios.describe.describe", interrupted)
    monkeypatch.setattr("scenarios.commands.run_scenario", interrupted)
    without, with_resume = call("inspect", "default"), call("run", "default")
    assert without.exit_code == with_resume.exit_code == 130
    assert "--resume" not in without.stderr
    assert "--resume" in with_resume.stderr


def test_messages_take_a_line_each_and_tables_are_no_python():
    answer_ = {"messages": ["one thing, and", "another thing"], "maps": [{"g": {"count": 3}}]}
    assert list(sentences(answer_ | {"origin": ""})) == [
        "messages", "  one thing, and", "  another thing", "maps", "  g count 3", "origin    -",
    ]  # fmt: skip


def test_resume_simulates_again_when_the_measurement_is_damaged(finished: Run, tmp_path: Path):
    path = tmp_path / "measurement.nc"
    path.write_bytes((finished.folder / "measurement.nc").read_bytes()[:-1000])
    result = call("simulate", finished.scenario, "--out", tmp_path, "--resume", "--json")
    assert "not resumed" in result.stderr
    assert answer(result)["files"]["measurement.nc"] == finished.answer["files"]["measurement.nc"]


def test_estimate_reads_a_folder_made_by_hand(finished: Run, tmp_path: Path):
    visit = tmp_path / "visit"
    visit.mkdir()
    (visit / "bench.toml").write_text("covers_above = []\ncovers_below = []\n")
    (visit / "samples.csv").write_text("name,thickness_mm,n\nleaf,0.5,1.4\n")
    rows = ["capture,sample,repeat,wavelength_nm,value,sigma"]
    for wavelength in (500, 550, 600):
        for capture, value in (("black", 0.16), ("white", 0.5), ("collimated", 0.2)):
            rows.append(f"{capture},leaf,0,{wavelength},{value},0.002")
    (visit / "relative.csv").write_text("\n".join(rows) + "\n")
    found = answer(
        call("estimate", visit, "--scenario", finished.scenario, "--out", tmp_path / "out",
             "--cache", tmp_path / "cache", "--json")
    )  # fmt: skip
    assert (found["origin"], found["wavelengths"]) == ("handmade", 3)
    assert found["estimate"]["sigma_t_per_mm"]["determined"] == 3
    assert 2.5 < found["estimate"]["sigma_t_per_mm"]["median"] < 3.5  # -ln(0.2) / 0.5 = 3.2
    assert "median_absolute_error" not in found["estimate"]["g"]  # no truth to compare with


def test_map_fills_the_cache_that_run_reads(finished: Run):
    found = answer(call("map", finished.scenario, "--cache", finished.cache, "--json"))
    assert [each["sample"] for each in found["maps"]] == ["thin", "thick"]
    assert [each["thickness_mm"] for each in found["maps"]] == [0.4, 0.8]
    assert found["maps"][0]["albedo"]["count"] == 8


def test_inspect_says_what_each_file_holds(finished: Run):
    kinds = {
        finished.folder / "measurement.nc": "measurement",
        finished.folder / "result.nc": "result",
        next(finished.cache.glob("*.map")): "appearance map",
        finished.scenario: "scenario",
        finished.folder / "scenario.json": "scenario",
        Path("quick"): "scenario",
    }
    for file, kind in kinds.items():
        assert answer(call("inspect", file, "--json"))["kind"] == kind
    shots = answer(call("inspect", finished.folder / "measurement.nc", "--json"))["shots"]
    assert shots["black"] == 4  # 2 samples, 2 repeats
    assert shots["white_reference"] == 8  # first and last


def test_list_names_everything_there_is_to_choose():
    found = answer(call("list", "--json"))
    assert tuple(sorted(found["scenarios"])) == tuple(sorted(builtin_names()))
    assert "demo_ink" in found["materials"]
    assert "lut" in found["estimators"]
    only = call("list", "estimators")
    assert "lut" in only.stdout
    assert "demo_ink" not in only.stdout


def test_help_shows_examples_and_exit_codes():
    shown = call("--help").stdout
    assert "benchtwin run intralipid" in shown
    for code in ("0", "2", "130", "1"):
        assert code in shown.partition("Exit codes")[2]
    for command in ("run", "simulate", "estimate", "map", "inspect", "list"):
        assert "Example: benchtwin " + command in call(command, "--help").stdout


def test_a_mistake_of_the_program_is_exit_1_with_a_traceback(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("scenarios.describe.describe", lambda file: 1 / 0)
    result = call("inspect", "default")
    assert result.exit_code == 1
    assert "ZeroDivisionError" in result.stderr
    assert "error of the program" in result.stderr


IN_AN_IMPORT = """
from scenarios.cli.guard import guarded
import typer
def command():
    exec("raise KeyboardInterrupt")
try:
    guarded(command)()
except typer.Exit as end:
    raise SystemExit(end.exit_code)
"""


def test_an_interrupt_while_a_class_is_being_made_is_exit_130_too(tmp_path: Path):
    # Only a module that is run by its name shows what is remembered.
    (tmp_path / "interrupted.py").write_text(IN_AN_IMPORT)
    path = os.pathsep.join([str(tmp_path), str(Path(__file__).parents[2])])
    done = subprocess.run(
        [sys.executable, "-m", "interrupted"], check=False, capture_output=True, text=True,
        env={**os.environ, "PYTHONPATH": path},
    )  # fmt: skip
    assert done.returncode == 130
    assert "interrupted" in done.stderr


@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGINT for another process")
def test_an_interrupt_is_exit_130_and_leaves_no_half_file(tmp_path: Path):
    scenario = write(tmp_path / "long.toml", tiny(simulation={"paths": 1 << 22}))
    out = tmp_path / "out"
    process = subprocess.Popen(
        [sys.executable, "-m", "scenarios.cli", "run", scenario, "--out", out,
         "--cache", tmp_path / "cache"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        cwd=Path(__file__).parents[2],
    )  # fmt: skip
    deadline = time.monotonic() + 60
    while not out.exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    time.sleep(1.0)
    process.send_signal(signal.SIGINT)
    printed, said = process.communicate(timeout=120)
    assert process.returncode == 130, said
    assert "interrupted" in said
    assert "Traceback" not in said
    assert printed == ""
    assert list(out.iterdir()) == []
