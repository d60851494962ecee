"""benchtwin devices, capture, calibrate and monitor."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
import typer
from typer.testing import CliRunner, Result

from scenarios.cli import guarded
from scenarios.instruments.command import register
from scenarios.instruments.monitor import axis_line, spectrum_line
from tests.scenarios.tiny import tiny, write
from twin.measurement import read_measurement, relative_intensities

PLAN = {"repeats": 1, "reference_repeats": 1, "averages": 2, "warm_up_s": 30.0}


def call(*arguments: object) -> Result:
    app = typer.Typer()
    register(app, guarded)
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def answer(result: Result) -> dict[str, Any]:
    assert result.exit_code == 0, result.stderr
    return json.loads(result.stdout)


def bench(folder: Path, **changes: Any) -> Path:
    write(folder / "tiny.toml", tiny())
    table = {"scenario": "tiny.toml", "quick": True, "plan": PLAN} | changes
    path = folder / "bench.toml"
    path.write_text(tomli_w.dumps(table), encoding="utf-8")
    return path


def test_capture_writes_a_measurement_that_can_be_read(tmp_path: Path) -> None:
    found = answer(call("capture", bench(tmp_path), "--out", tmp_path / "v", "--json"))
    measurement = read_measurement(found["measurement"])
    assert measurement.fingerprint == found["fingerprint"]
    assert found["shots"] == len(measurement.captures.shots) == 27
    assert relative_intensities(measurement).value.shape == (2, 3, 9)
    again = call("capture", bench(tmp_path), "--out", tmp_path / "v", "--json")
    assert again.exit_code == 2
    assert "--resume" in again.stderr
    resumed = answer(
        call("capture", bench(tmp_path), "--out", tmp_path / "v", "--resume", "--json")
    )
    assert resumed["fingerprint"] == found["fingerprint"]


def test_an_interrupted_capture_goes_on(tmp_path: Path) -> None:
    path = bench(tmp_path)
    whole = answer(call("capture", path, "--out", tmp_path / "a", "--json"))
    answer(call("capture", path, "--out", tmp_path / "b", "--json"))
    for name in ("000011", "000012", "000020"):
        (tmp_path / "b" / "journal" / "shots" / f"{name}.shot").unlink()
    found = answer(call("capture", path, "--out", tmp_path / "b", "--resume", "--json"))
    assert len(list((tmp_path / "b" / "journal" / "shots").glob("*.shot"))) == 27
    one, other = (read_measurement(each["measurement"]).captures for each in (whole, found))
    np.testing.assert_array_equal(one.counts, other.counts)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"sensor": {"kind": "real", "model": "ocean"}}, "all devices real, or all"),
        ({"sensor": {"kind": "wire"}}, 'expected model = "ocean" or "as7341"'),
        ({"sensor": {"kind": "vritual"}}, "sensor.kind"),
        ({"sensor": {"kind": "virtual", "sreial": "1"}}, "Did you mean `serial`"),
        ({"scenario": "absent.toml"}, "no such file"),
        ({"samples": [{"name": "a", "thickness_mm": 1.0}]}, "beside virtual devices"),
        ({"range_nm": [600.0, 500.0]}, "two that increase"),
        ({"range_nm": [800.0, 900.0]}, "no pixel from"),
        ({"calibration": "absent.json"}, "Make it with benchtwin calibrate"),
        ({"sensor": {"kind": "virtual", "serial": "99"}}, "'99', which the bench file names"),
        ({"plan": {"exposure": 1e-6}}, "1e-06 s"),
        ({"plan": {"gain": 4.0}}, "a gain of 4; expected no gain at all"),
        ({"kind": "wire", "sensor": {"model": "ocean"}, "plan": {"astep": 9}}, "for a chip only"),
        ({"kind": "wierd"}, "'wierd'"),
        ({"plan": {"order": ["black", "black"]}}, "each once"),
    ],
)
def test_wrong_bench_files_get_one_clear_message(
    changes: dict[str, Any], words: str, tmp_path: Path
) -> None:
    result = call("capture", bench(tmp_path, **changes), "--out", tmp_path / "v", "--quiet")
    assert result.exit_code == 2, result.stderr
    said = [line for line in result.stderr.splitlines() if line.startswith("benchtwin: ")]
    assert len(said) == 1
    assert words in said[0]


REAL: dict[str, Any] = {"lights": {"kind": "real"}, "stage": {"kind": "real"}}


@pytest.mark.parametrize(
    ("lights", "stage", "words"),
    [
        ({}, {}, "real lights without an address"),
        ({"address": "A"}, {"model": "slider"}, "slider without an address"),
        ({"address": "A"}, {"model": "slider", "address": "A"}, "each device on its own"),
    ],
)
def test_real_devices_need_their_addresses(
    lights: dict[str, str], stage: dict[str, str], words: str, tmp_path: Path
) -> None:
    entries = {
        "sensor": {"kind": "real", "model": "ocean"},
        "lights": {"kind": "real"} | lights,
        "stage": {"kind": "real"} | stage,
    }
    result = call("capture", bench(tmp_path, **entries), "--out", tmp_path / "v")
    assert result.exit_code == 2
    assert words in result.stderr


def test_a_real_device_that_is_not_there(tmp_path: Path) -> None:
    entries = {
        "sensor": {"kind": "real", "model": "ocean", "serial": "NOT-THERE"},
        "lights": {"kind": "real", "model": "manual"},
        "stage": {"kind": "real", "model": "manual"},
    }
    result = call("devices", bench(tmp_path, **entries))
    assert result.exit_code == 2
    assert "Ocean spectrometer" in result.stderr
    assert any(word in result.stderr for word in ("NOT-THERE", "pip install", "libusb"))


def test_devices_says_what_there_is(tmp_path: Path) -> None:
    found = answer(call("devices", "--json"))
    assert set(found) == {"connected", "could_be", "missing"}
    assert any("virtual" in line for line in found["could_be"])
    named = " ".join(found["could_be"] + found["missing"])
    for family in ("Ocean spectrometer", "AS7341", "SCPI", "slider"):
        assert family in named
    assert all("Install" in line or "Run: pip install" in line for line in found["missing"])
    opened = answer(call("devices", bench(tmp_path), "--json"))["devices"]
    assert [each["kind"] for each in opened] == ["spectrometer", "lights", "stage", "holder"]
    assert {each["seam"] for each in opened} == {"virtual"}


def test_calibrate_and_a_spectrometer_that_is_another_one(tmp_path: Path) -> None:
    found = answer(call("calibrate", bench(tmp_path), "--lamp", "neon", "--json"))
    path = Path(found["calibration"])
    assert path == tmp_path / "calibration.json"
    assert found["serial"] == "1"
    used = bench(tmp_path, calibration="calibration.json")
    answer(call("capture", used, "--out", tmp_path / "v", "--json"))
    data = json.loads(path.read_text())
    data["wavelength_nm"] = [value + 1.0 for value in data["wavelength_nm"]]
    path.write_text(json.dumps(data))
    result = call("capture", used, "--out", tmp_path / "w")
    assert result.exit_code == 2
    assert "those of the calibration" in result.stderr
    path.write_text("{}")
    result = call("capture", used, "--out", tmp_path / "x")
    assert result.exit_code == 2
    assert "a calibration of benchtwin" in result.stderr


def test_monitor_shows_the_spectrum(tmp_path: Path) -> None:
    result = call("monitor", bench(tmp_path), "--frames", 3, "--integration", 0.2, "--json")
    found = answer(result)
    assert found["frames"] == 3
    assert 450 <= found["peak_nm"] <= 650
    assert result.stderr.count(" peak ") == 3
    wrong = call("monitor", bench(tmp_path), "--frames", 1, "--background", "grey")
    assert wrong.exit_code == 2
    assert "'grey'" in wrong.stderr


def test_the_line_of_a_spectrum() -> None:
    counts = np.array([0.0, 10.0, 50.0, 100.0])
    assert spectrum_line(counts, 100, 4) == " ▁▄█"
    assert spectrum_line(counts, 100, 16) == "    ▁▁▁ ▄▄▄ ███"
    assert axis_line(np.array([415.0, 445.0, 480.0, 515.0]), 16) == "415 445 480 515 nm"
    assert axis_line(np.linspace(350, 1000, 72), 72) == "350" + " " * 62 + "1000 nm"
    assert len(spectrum_line(np.arange(2048.0), 4095, 72)) == 72
