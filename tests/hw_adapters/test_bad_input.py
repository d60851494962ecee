"""What a person can get wrong with devices: one clear message each, and nothing lost.

Called as a person calls it, through the command line. Where real devices are needed, the real
driver library finds stand-ins on a USB bus of this test.
"""

from __future__ import annotations

import contextlib
import functools
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.hw_adapters.test_commands import PLAN, answer, bench, call
from tests.hw_adapters.wire.seams import bench_state
from tests.scenarios.tiny import tiny, write
from twin.measurement import read_measurement

REAL: dict[str, Any] = {
    "kind": "real",
    "sensor": {"model": "ocean"},
    "lights": {"model": "manual", "settle_s": 0.0},
}


def refused(*arguments: object) -> str:
    """The one message of a command that is refused."""
    result = call(*arguments)
    assert result.exit_code == 2, result.output
    assert "Traceback" not in result.stderr
    said = [line for line in result.stderr.splitlines() if line.startswith("benchtwin: ")]
    assert len(said) == 1, result.stderr
    return said[0]


@contextlib.contextmanager
def on_the_bus(monkeypatch: pytest.MonkeyPatch, *serials: str) -> Iterator[Any]:
    """Spectrometers with these serial numbers on the USB bus of this computer."""
    pytest.importorskip("seabreeze", reason="python-seabreeze is not installed")
    pytest.importorskip("usb", reason="pyusb is not installed")
    from hw_adapters.drivers import ocean
    from hw_adapters.wire.usb650 import Usb650, plugged_in

    state = bench_state("spectrometer")
    units = [Usb650(state.whole_counts, serial=serial) for serial in serials]
    with plugged_in(*units) as bus:
        opened = functools.partial(ocean.open_spectrometer, pyusb_backend=bus)
        monkeypatch.setattr(ocean, "open_spectrometer", opened)
        yield state


# A device that is not there ----------------------------------------------------------------------


def test_a_spectrometer_that_is_not_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    named = REAL | {"sensor": {"model": "ocean", "serial": "USB2G1"}}
    with on_the_bus(monkeypatch):
        said = refused("capture", bench(tmp_path, **REAL), "--out", tmp_path / "v")
        assert "found these on the USB bus: none; expected a spectrometer, connected" in said
    with on_the_bus(monkeypatch, "USB2G7"):
        said = refused("capture", bench(tmp_path, **named), "--out", tmp_path / "v")
        assert "USB650 USB2G7; expected the spectrometer USB2G1, connected" in said
    assert list((tmp_path / "v").iterdir()) == []


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"lights": {"address": "ASRL/dev/not-there::INSTR"}}, "nothing at 'ASRL/dev/not-there"),
        (
            {"stage": {"model": "slider", "address": "/dev/not-there"}},
            "Grbl slider: found no port '/dev/not-there'",
        ),
    ],
)
def test_lights_and_stage_that_are_not_there(
    changes: dict[str, Any], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pyvisa_py", reason="pyvisa-py is not installed")
    pytest.importorskip("serial", reason="pyserial is not installed")
    with on_the_bus(monkeypatch, "A"):
        said = refused("devices", bench(tmp_path, **(REAL | changes)))
    assert words in said
    assert "--resume" not in said


def test_other_devices_than_the_bench_file_names(tmp_path: Path) -> None:
    for table in ("sensor", "lights", "stage"):
        path = bench(tmp_path, **{table: {"serial": "99"}})
        for command in (("devices",), ("monitor", "--frames", "1"), ("calibrate",)):
            said = refused(command[0], path, *command[1:])
            assert "expected '99', which the bench file names" in said


# Two devices with one serial number --------------------------------------------------------------


def test_two_spectrometers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for serial, words in (
        ("", "several on the USB bus: USB650 A, USB650 A; expected one. Unplug all but one."),
        ("A", "expected one with the serial number A. Unplug all but one."),
    ):
        path = bench(tmp_path, **(REAL | {"sensor": {"model": "ocean", "serial": serial}}))
        with on_the_bus(monkeypatch, "A", "A"):
            assert words in refused("capture", path, "--out", tmp_path / "v")
    with on_the_bus(monkeypatch, "A", "B"):
        said = refused("devices", bench(tmp_path, **REAL))
        assert "Name one by its serial number." in said
        named = REAL | {"sensor": {"model": "ocean", "serial": "B"}}
        found = answer(call("devices", bench(tmp_path, **named), "--json"))
        assert found["devices"][0]["serial"] == "B"


# Integration times outside the limits ------------------------------------------------------------


@pytest.mark.parametrize("exposure", [1e-6, 61.0])
def test_an_exposure_outside_the_limits_is_refused_before_the_lamps_burn(
    exposure: float, tmp_path: Path
) -> None:
    out = tmp_path / "v"
    wrong = bench(tmp_path, plan=PLAN | {"exposure": exposure})
    result = call("capture", wrong, "--out", out)
    assert result.exit_code == 2
    assert f"{exposure:g} s; expected 0.008 to 60 s" in result.stderr
    assert "warm-up" not in result.stderr
    assert not list(out.rglob("*.shot"))
    right = bench(tmp_path, plan=PLAN | {"exposure": 0.01})
    assert answer(call("capture", right, "--out", out, "--json"))["shots"] == 21
    said = refused("monitor", right, "--frames", 1, "--integration", exposure)
    assert "expected 0.008 to 60 s" in said


# A white that saturates --------------------------------------------------------------------------


def bright(folder: Path, rate: float) -> Path:
    table = tiny()
    table["bench"]["instrument"]["white_rate_electrons_per_s"] = rate
    path = bench(folder)
    write(folder / "tiny.toml", table)
    return path


def test_a_white_that_saturates_at_the_shortest_time(tmp_path: Path) -> None:
    out = tmp_path / "v"
    said = refused("capture", bright(tmp_path, 1e9), "--out", out)
    assert "virtual spectrometer 1: found white_reference that saturates at the shortest" in said
    assert "0.008 s" in said
    assert "Dim the lamp" in said
    events = [json.loads(line) for line in (out / "journal" / "log.jsonl").open()]
    tried = [each for each in events if each["event"] == "exposure"]
    assert tried
    assert all(each["saturated"] for each in tried)
    assert not (out / "measurement.nc").exists()
    assert "saturates" in refused("calibrate", bright(tmp_path, 1e9), "--out", tmp_path / "c")
    dimmed = answer(call("capture", bright(tmp_path, 4e6), "--out", out, "--resume", "--json"))
    assert dimmed["shots"] == 27


def test_light_that_saturates_in_the_middle_keeps_what_was_taken(tmp_path: Path) -> None:
    path, out = bench(tmp_path), tmp_path / "v"
    whole = answer(call("capture", path, "--out", tmp_path / "whole", "--json"))
    said = refused("capture", path, "--out", out, "--fault", "saturation:bench.frame:white")
    assert "saturated in white of 'thin'" in said
    kept = {each.name: each.read_bytes() for each in out.rglob("*.shot")}
    assert kept
    found = answer(call("capture", path, "--out", out, "--resume", "--json"))
    for name, data in kept.items():
        assert (out / "journal" / "shots" / name).read_bytes() == data
    one, other = (read_measurement(each["measurement"]) for each in (whole, found))
    np.testing.assert_array_equal(one.captures.counts, other.captures.counts)
    assert found["notes"][-1] == "acted out on purpose: saturation from white on"


def test_faults_that_cannot_be_acted_out(tmp_path: Path) -> None:
    path = bench(tmp_path)
    said = refused("capture", path, "--out", tmp_path / "v", "--fault", "unpluging")
    assert "Did you mean `unplugging`?" in said
    result = call("capture", path, "--out", tmp_path / "v", "--fault", "unplugging:usb650.frame")
    assert result.exit_code == 0
    assert "was not acted out" in result.stderr
    path = bench(tmp_path, **REAL)
    said = refused("capture", path, "--out", tmp_path / "w", "--fault", "unplugging")
    assert "for real devices; expected virtual devices" in said


# A spectrometer that was replaced ----------------------------------------------------------------


def test_a_replaced_spectrometer(tmp_path: Path) -> None:
    out, path = tmp_path / "v", bench(tmp_path)
    answer(call("calibrate", path, "--json"))
    used = bench(tmp_path, calibration="calibration.json")
    refused("capture", used, "--out", out, "--fault", "unplugging:spectrometer.frame:white")
    kept = sorted(each.name for each in out.rglob("*.shot"))
    table = tiny()
    table["bench"]["instrument"]["start_nm"] = 455.0
    write(tmp_path / "tiny.toml", table)
    for resume in ((), ("--resume",)):
        result = call("capture", used, "--out", out if resume else tmp_path / "w", *resume)
        assert result.exit_code == 2
        assert "those of the calibration, 9 from 450.00 to 650.00 nm" in result.stderr
        assert "warm-up" not in result.stderr
    table["bench"]["instrument"] = tiny()["bench"]["instrument"] | {"serial": 2}
    write(tmp_path / "tiny.toml", table)
    said = refused("capture", used, "--out", out, "--resume", "--quiet")
    assert "found the serial number '2'; expected '1'" in said
    assert "its calibration" in said
    assert sorted(each.name for each in out.rglob("*.shot")) == kept
    write(tmp_path / "tiny.toml", tiny())
    assert answer(call("capture", used, "--out", out, "--resume", "--json"))["shots"] == 27


# Real devices as they are described --------------------------------------------------------------


def test_a_real_visit_is_not_described_by_the_twin(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its noise comes from its repeats, and nobody knows what its samples are made of."""
    from hw_adapters import capture_visit
    from scenarios.console import Console
    from scenarios.instruments.bench_file import load_bench_file
    from scenarios.instruments.opening import open_bench

    plan = {
        "repeats": 2, "reference_repeats": 2, "averages": 1, "warm_up_s": 0.0, "exposure": 0.02,
    }  # fmt: skip
    path = bench(tmp_path, **REAL, plan=plan, range_nm=[500.0, 520.0])
    with on_the_bus(monkeypatch, "A") as state:

        def ask(text: str) -> None:
            words = text.split()
            for name in state.samples:
                if f"'{name}'" in text:
                    state.place_sample(name, text.startswith("Lay"))
            if text.startswith("Switch"):
                state.set_lamp(words[2], 1.0 if "on." in words else 0.0)
            if "background" in text:
                place = next((each for each in ("black", "white") if each in words), "out")
                state.move_background(place)

        file = load_bench_file(path)
        with open_bench(file, folder=tmp_path, console=Console(quiet=True), ask=ask) as opened:
            found = capture_visit(opened.devices, file.plan, tmp_path / "journal")
    assert found.provenance.origin == "measured"
    assert found.provenance.noise == "repeats"
    assert found.bench.instrument.full_scale_counts == 4095
    assert {sample.material for sample in found.samples} == {None}
    assert found.truth is None
    assert found.captures.counts.shape[1] == len(found.bench.instrument.wavelength_nm)
