"""Whole visits with real drivers on the wire: equal to visits in process, whatever goes wrong."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("seabreeze", reason="python-seabreeze is not installed (extra instruments)")
pytest.importorskip("usb", reason="pyusb is not installed (extra instruments)")
pytest.importorskip("adafruit_as7341", reason="Adafruit's driver is not installed (instruments)")
pytest.importorskip("serial", reason="pyserial is not installed (extra instruments)")
pytest.importorskip("pyvisa_py", reason="pyvisa-py is not installed (extra instruments)")

from hw_adapters import (
    CaptureStopped,
    DeviceBench,
    DeviceError,
    PlanSettings,
    VirtualHolder,
    capture_visit,
)
from hw_adapters.faults import Faults
from hw_adapters.wire.bench import wire_bench
from tests.hw_adapters.wire.seams import SAMPLES, bench_state, in_process
from twin.bench import Bench, Sample
from twin.measurement import Measurement

BEDS = tuple(Sample(name=name, thickness_mm=0.4 + 0.4 * i) for i, name in enumerate(SAMPLES))
RANGE_NM = (500.0, 520.0)


def settings(**changes: Any) -> PlanSettings:
    table = {"repeats": 1, "reference_repeats": 1, "averages": 2, "warm_up_s": 10.0, "astep": 599}
    return PlanSettings(**(table | changes))


def in_process_visit(kind: str, folder: Path) -> Measurement:
    state = bench_state(kind)
    sensor, lights, stage = in_process(state)
    bench = Bench(instrument=state.instrument)
    devices = DeviceBench(
        sensor, lights, stage, VirtualHolder(state), state.clock, bench, BEDS, state.announce,
        "virtual", state.seed, RANGE_NM if kind == "spectrometer" else None,
    )  # fmt: skip
    return capture_visit(devices, settings(), folder)


def facts(kind: str) -> dict[str, Any]:
    return {"range_nm": RANGE_NM} if kind == "spectrometer" else {}


def same(one: Measurement, other: Measurement) -> bool:
    a, b = one.captures, other.captures
    assert a is not None
    assert b is not None
    return (
        a.shots == b.shots
        and np.array_equal(a.counts, b.counts)
        and np.array_equal(a.saturated, b.saturated)
        and np.array_equal(a.wavelength_nm, b.wavelength_nm)
    )


@pytest.fixture(autouse=True)
def quick_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """A power cut is not what is tested here: waiting for a busy disk takes most of the time."""
    monkeypatch.setattr("os.fsync", lambda descriptor: None)


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Measurement]:
    folder = tmp_path_factory.mktemp("reference")
    return {kind: in_process_visit(kind, folder / kind) for kind in ("spectrometer", "chip")}


@pytest.mark.parametrize("kind", ["spectrometer", "chip"])
def test_a_visit_on_the_wire_is_the_visit_in_process(
    kind: str, tmp_path: Path, reference: dict[str, Measurement]
) -> None:
    state = bench_state(kind)
    with wire_bench(state) as wire:
        devices = wire.devices(Bench(instrument=state.instrument), BEDS, **facts(kind))
        found = capture_visit(devices, settings(), tmp_path / "visit")
    assert same(found, reference[kind])
    other = bench_state(kind, seed=12)
    with wire_bench(other) as wire:
        devices = wire.devices(Bench(instrument=other.instrument), BEDS, **facts(kind))
        assert not same(capture_visit(devices, settings(), tmp_path / "other"), reference[kind])


CASES = [
    ("spectrometer", "timeout", "usb650.frame", "black"),
    ("spectrometer", "unplugging", "usb650.write", "white_reference"),
    ("spectrometer", "dropped_byte", "usb650.frame", "collimated"),
    ("spectrometer", "timeout", "usb650.frame", "expose beam_reference"),
    ("spectrometer", "unplugging", "scpi.*", "beam_reference"),
    ("spectrometer", "timeout", "scpi.ask", "white_reference"),
    ("spectrometer", "dropped_byte", "scpi.set", "collimated"),
    ("spectrometer", "dropped_byte", "scpi.ask", "beam_reference"),
    ("spectrometer", "unplugging", "slider.line", "black"),
    ("chip", "unplugging", "as7341.frame", "dark"),
    ("chip", "timeout", "as7341.frame", "white"),
    ("chip", "dropped_byte", "as7341.read", "beam_reference"),
]


@pytest.mark.parametrize(("kind", "name", "operation", "stage"), CASES)
def test_a_fault_loses_nothing_and_resume_completes(
    kind: str,
    name: str,
    operation: str,
    stage: str,
    tmp_path: Path,
    reference: dict[str, Measurement],
) -> None:
    state = bench_state(kind, faults=Faults())
    bench = Bench(instrument=state.instrument)
    with wire_bench(state) as wire:
        devices = wire.devices(bench, BEDS, timeout_s=0.2, **facts(kind))
        names = {each.name for each in devices.devices}
        state.faults.arm(name, operation=operation, stage=stage)
        with pytest.raises(CaptureStopped) as caught:
            capture_visit(devices, settings(), tmp_path / "visit")
        assert state.faults.log[0][0] == name
        assert caught.value.device in names
        assert "--resume" in str(caught.value)
        kept = sorted((tmp_path / "visit" / "shots").glob("*.shot"))
        assert len(kept) == caught.value.taken
        before = [path.read_bytes() for path in kept]
        wire.close()
        wire.plug_in()
        again = wire.devices(bench, BEDS, timeout_s=0.2, **facts(kind))
        found = capture_visit(again, settings(), tmp_path / "visit", resume=True)
        assert [path.read_bytes() for path in kept] == before
    one, other = found.captures, reference[kind].captures
    assert one is not None
    assert other is not None
    np.testing.assert_array_equal(one.counts, other.counts)
    np.testing.assert_array_equal(one.saturated, other.saturated)


def test_another_spectrometer_after_the_failure_is_refused(tmp_path: Path) -> None:
    state = bench_state("spectrometer", faults=Faults())
    bench = Bench(instrument=state.instrument)
    with wire_bench(state) as wire:
        devices = wire.devices(bench, BEDS, range_nm=RANGE_NM)
        state.faults.arm("unplugging", operation="usb650.frame", stage="white")
        with pytest.raises(CaptureStopped):
            capture_visit(devices, settings(), tmp_path / "visit")
        wire.close()
        wire.plug_in()
        state.faults.arm("wrong_serial", operation="usb650.info", lasting=True)
        other = wire.devices(bench, BEDS, range_nm=RANGE_NM)
        with pytest.raises(DeviceError, match=r"OTHER0-7.*USB650-7"):
            capture_visit(other, settings(), tmp_path / "visit", resume=True)
