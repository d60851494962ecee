"""Every wrong input: one clear message, exit code 2, no traceback, nothing half-written."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from tests.scenarios.conftest import Run
from tests.scenarios.tiny import MATERIAL, call, tiny, write


def edited(**edits: Any) -> dict[str, Any]:
    """The tiny scenario with dotted keys (a double underscore is a dot) set to other values."""
    table = copy.deepcopy(tiny())
    for dotted, value in edits.items():
        *parents, last = dotted.split("__")
        place: Any = table
        for part in parents:
            place = place[int(part)] if part.isdigit() else place[part]
        place[int(last) if last.isdigit() else last] = value
    return table


MISTAKES = {
    "misspelt key": (
        edited(protocol__repeat=3),
        ("protocol.repeat", "unknown key `repeat`", "`repeats`"),
    ),
    "missing key": ({"title": "no samples"}, ("samples",)),
    "negative thickness": (
        edited(samples__0__thickness_mm=-0.4),
        ("samples[0].thickness_mm", "-0.4", "greater than 0"),
    ),
    "albedo above 1": (
        edited(samples__0__material=MATERIAL | {"albedo": 1.2},
               samples__1__material=MATERIAL | {"albedo": 1.2}),
        ("samples[0].material", "1.2", "0 to 1"),
    ),
    "wavelength grid that decreases": (
        edited(wavelength__stop_nm=300.0),
        ("wavelength", "stop_nm 300", "increases"),
    ),
    "wavelength grid that does not reach the instrument": (
        edited(wavelength={"start_nm": 500.0, "stop_nm": 675.0, "step_nm": 25.0}),
        ("wavelength", "500 to 675 nm", "covers"),
    ),
    "table that decreases": (
        edited(bench__panel_spectrum={"wavelength_nm": [700.0, 400.0], "value": [1.0, 1.0]}),
        ("bench.panel_spectrum: found 400 nm after 700 nm; expected wavelengths that",),
    ),
    "lamp that does not overlap": (
        edited(bench__panel_spectrum={"wavelength_nm": [700.0, 900.0], "value": [1.0, 1.0]}),
        ("bench.panel_spectrum", "700 to 900 nm"),
    ),
    "not a number": (
        edited(samples__0__thickness_mm=float("nan")),
        ("samples[0].thickness_mm", "nan", "finite"),
    ),
    "unknown material": (
        edited(samples__0__material="demo_inc", samples__1__material="demo_inc"),
        ("samples[0].material", "demo_inc", "demo_ink"),
    ),
    "two samples of one name": (
        edited(samples__1__name="thin"),
        ("samples", "'thin' twice"),
    ),
    "unknown estimator": (
        edited(estimator={"name": "lutt"}),
        ("lutt", "lut"),
    ),
    "unknown option of the estimator": (
        edited(estimator={"name": "lut", "options": {"drawz": 3}}),
        ("estimator.options", "`drawz`", "`draws`"),
    ),
    "a reference that saturates": (
        edited(protocol__exposure=50.0),
        ("saturated",),
    ),
}  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_wrong_scenario(mistake: str, tmp_path: Path, finished: Run):
    table, words = MISTAKES[mistake]
    scenario = write(tmp_path / "wrong.toml", table)
    result = call("run", scenario, "--out", tmp_path / "out", "--cache", finished.cache)
    said = one_message(result)
    for word in words:
        assert word in said
    assert not (tmp_path / "out" / "result.nc").exists()


FOUND_BEFORE_WORK = [name for name in MISTAKES if name != "a reference that saturates"]


@pytest.mark.parametrize("mistake", FOUND_BEFORE_WORK)
def test_a_wrong_scenario_is_found_before_the_work(
    mistake: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("twin.transport.captures", must_not_run)
    scenario = write(tmp_path / "wrong.toml", MISTAKES[mistake][0])
    said = one_message(call("run", scenario, "--out", tmp_path / "out"))
    assert said.startswith(f"benchtwin: {scenario}: ")
    assert not (tmp_path / "out").exists()


def must_not_run(*_: object, **__: object) -> None:
    raise RuntimeError("light transport ran before the input was checked")


def one_message(result: Any) -> str:
    """The one line on standard error of a command that refused its input."""
    assert result.exit_code == 2, result.stderr
    assert "Traceback" not in result.stderr
    lines = [line for line in result.stderr.splitlines() if line.startswith("benchtwin: ")]
    assert len(lines) == 1
    assert "found " in lines[0]
    assert "; expected " in lines[0]
    return lines[0]


def test_the_message_names_the_file(tmp_path: Path):
    scenario = write(tmp_path / "mine.toml", edited(protocol__repeats=0))
    assert str(scenario) in one_message(call("inspect", scenario))


def test_not_toml(tmp_path: Path):
    scenario = tmp_path / "broken.toml"
    scenario.write_text('title = "x"\nsamples = [\n')
    assert "line" in one_message(call("run", scenario, "--out", tmp_path / "out"))


def test_an_unknown_scenario_is_told_what_is_near(tmp_path: Path):
    said = one_message(call("run", "polyjet-cian", "--out", tmp_path / "out"))
    assert "`polyjet-cyan`" in said
    assert not (tmp_path / "out").exists()


def test_a_bench_file_beside_the_scenario(tmp_path: Path):
    (tmp_path / "bench.toml").write_text(tomli_w.dumps(tiny()["bench"]))
    scenario = write(tmp_path / "mine.toml", tiny(bench="bench.toml"))
    assert call("inspect", scenario).exit_code == 0
    (tmp_path / "bench.toml").write_text("gapp = 1\n")
    said = one_message(call("inspect", scenario))
    assert str(tmp_path / "bench.toml") in said
    assert "gapp" in said


@pytest.mark.parametrize("command", ["estimate", "inspect"])
@pytest.mark.parametrize("damage", ["truncated", "foreign", "text", "empty", "missing"])
def test_a_wrong_measurement_file(command: str, damage: str, finished: Run, tmp_path: Path):
    path = tmp_path / "visit.nc"
    whole = (finished.folder / "measurement.nc").read_bytes()
    contents = {
        "truncated": whole[: len(whole) // 2],
        "foreign": b"CDF\x01" + bytes(200),
        "text": b"wavelength,value\n400,1\n",
        "empty": b"",
    }
    if damage != "missing":
        path.write_bytes(contents[damage])
    more = ("--out", tmp_path / "out") if command == "estimate" else ()
    assert str(path) in one_message(call(command, path, *more)) or damage == "missing"
    assert not (tmp_path / "out").exists()


def test_an_all_zero_white_reference_in_a_folder(finished: Run, tmp_path: Path):
    visit = tmp_path / "visit"
    visit.mkdir()
    (visit / "samples.csv").write_text("name,thickness_mm,n\nleaf,0.5,1.4\n")
    rows = ["capture,sample,repeat,wavelength_nm,integration_s,counts"]
    for repeat in range(2):
        for capture in ("dark", "white_reference", "beam_reference"):
            rows += [f"{capture},,{repeat},{nm},1,0" for nm in (500, 600)]
        for capture in ("black", "white", "collimated"):
            rows += [f"{capture},leaf,{repeat},{nm},1,{100 + repeat}" for nm in (500, 600)]
    (visit / "captures.csv").write_text("\n".join(rows) + "\n")
    said = one_message(call("estimate", visit, "--out", tmp_path / "out"))
    assert "captures.csv" in said
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", ["run", "simulate"])
def test_an_output_folder_that_cannot_be_written_is_found_before_the_work(
    command: str, finished: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("twin.transport.captures", must_not_run)
    (tmp_path / "file").write_text("in the way")
    said = one_message(call(command, finished.scenario, "--out", tmp_path / "file" / "out"))
    assert "cannot be written" in said
    assert "--out" in said


def test_a_cache_that_cannot_be_written_is_found_before_the_work(
    finished: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("twin.transport.captures", must_not_run)
    (tmp_path / "file").write_text("in the way")
    said = one_message(
        call("run", finished.scenario, "--out", tmp_path / "out", "--cache", tmp_path / "file/c")
    )
    assert "--cache" in said
    assert not (tmp_path / "out").exists()


def test_with_json_the_error_is_an_object_too(tmp_path: Path):
    scenario = write(tmp_path / "wrong.toml", MISTAKES["negative thickness"][0])
    result = call("inspect", scenario, "--json")
    assert result.exit_code == 2
    error = json.loads(result.stdout)["error"]
    assert error["file"] == str(scenario)
    assert error["place"] == "samples[0].thickness_mm"
    assert error["found"] == "-0.4"


def test_an_option_that_does_not_exist_is_exit_2():
    result = call("run", "--sed", "3")
    assert result.exit_code == 2
    assert "--sed" in result.stderr


@pytest.mark.parametrize("seed", ["-1", str(2**63)])
def test_a_seed_out_of_range(seed: str, finished: Run, tmp_path: Path):
    said = one_message(call("run", finished.scenario, "--out", tmp_path / "o", "--seed", seed))
    assert "simulation.seed" in said
