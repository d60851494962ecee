"""Whole visits on the wire: faults at stages of the sequence, and going on afterwards."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("seabreeze", reason="python-seabreeze is not installed (extra instruments)")
pytest.importorskip("usb", reason="pyusb is not installed (extra instruments)")
pytest.importorskip("adafruit_as7341", reason="Adafruit's driver is not installed (instruments)")
pytest.importorskip("serial", reason="pyserial is not installed (extra instruments)")
pytest.importorskip("pyvisa_py", reason="pyvisa-py is not installed (extra instruments)")

from hw_adapters import CaptureStopped, DeviceBench, Journal, PlanSettings, capture_visit
from hw_adapters.wire.bench import WireBench, wire_bench
from tests.hw_adapters.wire.seams import SAMPLES, bench_state
from twin.bench import Bench, Sample
from twin.measurement import Measurement

KINDS = ("spectrometer", "chip")
PLAN = PlanSettings(
    repeats=1, reference_repeats=1, references="first", last_darks=False, averages=2, warm_up_s=10.0
)
DEVICE = {"spectrometer": "usb650", "chip": "as7341"}
FAULTS = {
    "timeout": ("{device}.frame", "LED|USB650|AS7341"),
    "unplugging": ("{device}.*", "USB650|AS7341"),
    "dropped_byte": ("{device}.{byte}", "USB650|AS7341"),
    "stale_frame": ("{device}.frame", ""),
}


def opened(wire: WireBench) -> DeviceBench:
    state = wire.state
    return DeviceBench(
        sensor=wire.open_sensor(), lights=wire.open_lights(), stage=wire.open_stage(),
        holder=wire.open_holder(), clock=state.clock, bench=Bench(instrument=state.instrument),
        samples=tuple(Sample(name=name, thickness_mm=0.5) for name in SAMPLES),
        announce=state.announce, origin="virtual", seed=state.seed,
    )  # fmt: skip


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Measurement]:
    """An undisturbed visit with each sensor."""
    found = {}
    for kind in KINDS:
        with wire_bench(bench_state(kind)) as wire:
            found[kind] = capture_visit(opened(wire), PLAN, tmp_path_factory.mktemp("w") / kind)
    return found


@pytest.mark.parametrize("stage", ["expose white_reference", "white_reference", "collimated"])
@pytest.mark.parametrize("name", FAULTS)
@pytest.mark.parametrize("kind", KINDS)
def test_a_fault_on_the_wire_loses_nothing(
    kind: str, name: str, stage: str, whole: dict[str, Measurement], tmp_path: Path
) -> None:
    state = bench_state(kind)
    operation, named = FAULTS[name]
    byte = "frame" if kind == "spectrometer" else "read"
    state.faults.arm(name, operation=operation.format(device=DEVICE[kind], byte=byte), stage=stage)
    with wire_bench(state) as wire:
        stopped = None
        try:
            found = capture_visit(opened(wire), PLAN, tmp_path / "j")
        except CaptureStopped as error:
            stopped = error
        # A frame sent twice is read again, or known by its gain: the visit may go on or stop.
        assert stopped is not None or not named
        if stopped is not None:
            assert re.search(named, str(stopped))
            assert "--resume" in str(stopped)
            kept = Journal(tmp_path / "j").shots()
            assert len(kept) == stopped.taken
            for number, taken in kept.items():
                np.testing.assert_array_equal(
                    taken.frame.counts, whole[kind].captures.counts[number]
                )
            wire.close()
            wire.plug_in()
            found = capture_visit(opened(wire), PLAN, tmp_path / "j", resume=True)
    assert state.faults.log
    np.testing.assert_array_equal(found.captures.counts, whole[kind].captures.counts)
    if stopped is not None:
        assert found == whole[kind]
