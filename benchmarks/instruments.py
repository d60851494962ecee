"""Instruments: real driver libraries over stand-ins against devices in process.

`seam_agreement`: counts through both seams are identical for equal seeds, on a USB650 (seabreeze)
and an AS7341 (Adafruit's driver). `end_to_end_equal`: a whole visit (3 samples, 7 kinds of capture)
with the real drivers of sensor, lamps (pyvisa) and slider (pyserial), then an estimate, equals the
one in process bit for bit. `faults_*`: every fault at every step of the sequence in which it can
happen: nothing captured is lost, the message names device and remedy, and resuming completes.
"""

from __future__ import annotations

import contextlib
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.instrument_worlds import (
    World,
    connected,
    sensor_in_process,
    visit_in_process,
    visit_on_the_wire,
    worlds,
)
from hw_adapters.errors import DeviceError
from hw_adapters.plan import PlanSettings
from hw_adapters.sequence import CaptureStopped, capture_visit
from twin.measurement import Measurement

STAGES = (
    "expose white_reference", "expose beam_reference", "expose collimated", "dark",
    "white_reference", "black_reference", "beam_reference", "black", "white", "collimated",
)  # fmt: skip
SPECTROMETER_FAULTS = (
    ("stale_frame", "usb650.frame"), ("timeout", "usb650.frame"), ("unplugging", "usb650.frame"),
    ("unplugging", "usb650.write"), ("dropped_byte", "usb650.frame"),
    ("decimal_comma", "usb650.eeprom"), ("wrong_serial", "usb650.info"),
    ("timeout", "scpi.ask"), ("unplugging", "scpi.*"), ("dropped_byte", "scpi.ask"),
    ("dropped_byte", "scpi.set"), ("wrong_serial", "scpi.info"),
    ("timeout", "slider.line"), ("unplugging", "slider.line"),
    ("saturation", "bench.frame"), ("hot_pixel", "bench.frame"), ("lamp_drift", "bench.frame"),
    ("light_leak", "bench.frame"),
)  # fmt: skip
CHIP_FAULTS = (
    ("timeout", "as7341.frame"), ("unplugging", "as7341.frame"), ("unplugging", "as7341.write"),
    ("dropped_byte", "as7341.read"), ("gain_step_error", "bench.frame"),
    ("saturation", "bench.frame"),
)  # fmt: skip
AT_OPENING = ("decimal_comma", "wrong_serial")
"""Faults that show when a device is opened: here when it is opened again after unplugging."""
BENCH_FAULTS = ("saturation", "hot_pixel", "lamp_drift", "gain_step_error", "light_leak")


def run(quick: bool) -> dict[str, Any]:
    """Compare the seams, time the adapter, and try the faults.

    Args:
        quick: fewer light paths, fewer frames, three steps of the sequence for the faults, and
            the estimator `beer` in place of `least-squares`.
    """
    made = worlds(paths=1024 if quick else 16_384)
    settings = PlanSettings(repeats=1, reference_repeats=1, averages=4, warm_up_s=10.0, astep=599)
    estimator = "beer" if quick else "least-squares"
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        equal, shots = _end_to_end(made, settings, place, estimator)
        faults = _faults(made, settings, place, STAGES[3:6] if quick else STAGES)
    frames, agreed = _seams(made, 50 if quick else 300)
    return {
        "seam_agreement": agreed,
        "seam_frames": frames,
        **_speed(made["spectrometer"], 200 if quick else 1000),
        "end_to_end_equal": equal,
        "end_to_end_shots": shots,
        "end_to_end_estimator": estimator,
        **faults,
    }


def _seams(made: dict[str, World], count: int) -> tuple[int, bool]:
    """Frames compared on both sensors, and whether all of them are identical."""
    agreed, frames = True, 0
    for name, world in made.items():
        first = world.state()
        sensor = sensor_in_process(first)
        with connected(world) as (wire, _):
            other = wire.open_sensor()
            for number in range(count):
                setting = (0.003 + 0.001 * (number % 7), 1 + number % 3)
                registers = (float(1 << number % 5), 99, 399 + number, 1 + number % 3)
                readings = []
                for state, each in ((first, sensor), (wire.state, other)):
                    each.configure(*(setting if name == "spectrometer" else registers))
                    state.announce(number)
                    state.place_sample(state.samples[number % 3], True)
                    state.move_background(("black", "white", "out")[number % 3])
                    lamp = ("panels", "panels", "beam")[number % 3]
                    state.lamps_off()
                    state.set_lamp(lamp, 1.0)
                    readings.append(each.capture())
                one, two = readings
                frames += 1
                agreed &= np.array_equal(one.counts, two.counts)
                agreed &= np.array_equal(one.saturated, two.saturated)
    return frames, bool(agreed)


def _speed(world: World, count: int) -> dict[str, float]:
    """Captures per second with the twin behind them, and time [ms] of our adapter alone."""
    with connected(world) as (wire, _):
        sensor: Any = wire.open_sensor()
        sensor.configure(0.003)
        start = time.perf_counter()
        for _ in range(count):
            sensor.capture()
        seconds = time.perf_counter() - start
        # For the overhead the stand-in sends two frames in turn: the twin's time is not the
        # adapter's. The bare driver and the adapter take turns, so that both see the same machine.
        frames = [wire.state.whole_counts(0.003), wire.state.whole_counts(0.003)]
        wire.unit._frame = lambda integration_s: frames[wire.unit.frames_sent % 2]  # type: ignore[union-attr]
        bare, ours = sensor._feature.get_intensities, sensor.capture
        blocks = [(_cpu(bare, 20), _cpu(ours, 20)) for _ in range(max(count // 20, 10))]
    both = 1000 * np.median(np.array(blocks), axis=0) / 20
    return {
        "captures_per_s": count / seconds,
        "driver_ms": float(both[0]),
        "overhead_ms": float(both[1] - both[0]),
    }


def _cpu(work: Callable[[], object], count: int) -> float:
    start = time.process_time()
    for _ in range(count):
        work()
    return time.process_time() - start


def _end_to_end(
    made: dict[str, World], settings: PlanSettings, place: Path, estimator: str
) -> tuple[bool, int]:
    equal, shots = True, 0
    for name, world in made.items():
        one = visit_in_process(world, settings, place / f"process-{name}")
        two = visit_on_the_wire(world, settings, place / f"wire-{name}")
        equal &= _same_counts(one, two)
        results = [_estimate(each, estimator) for each in (one, two)]
        for field in ("albedo", "sigma_t_per_mm", "g", "covariance", "status", "residual"):
            a, b = (np.asarray(getattr(result, field)) for result in results)
            equal &= a.tobytes() == b.tobytes()
        shots += len(one.captures.shots) if one.captures else 0
    return bool(equal), shots


def _estimate(measurement: Measurement, name: str) -> Any:
    # Without appearance maps, which take minutes and are the same for both measurements.
    from estimators import BenchModel, estimator
    from twin.measurement import relative_intensities

    seen = relative_intensities(measurement)
    model = BenchModel.of(measurement.bench, measurement.samples, seen.wavelength_nm)
    return estimator(name, model).estimate(seen)


def _same_counts(one: Measurement, two: Measurement) -> bool:
    a, b = one.captures, two.captures
    return (
        a is not None
        and b is not None
        and np.array_equal(a.counts, b.counts)
        and np.array_equal(a.saturated, b.saturated)
    )


def _faults(
    made: dict[str, World], settings: PlanSettings, place: Path, stages: tuple[str, ...]
) -> dict[str, Any]:
    tried = survived = equal = device_faults = 0
    failed: list[str] = []
    for name, faults in (("spectrometer", SPECTROMETER_FAULTS), ("chip", CHIP_FAULTS)):
        whole = visit_in_process(made[name], settings, place / f"whole-{name}")
        for number, (fault, operation) in enumerate(faults):
            for stage in stages:
                folder = place / f"fault-{name}-{number}-{stage.replace(' ', '-')}"
                found = _try(made[name], settings, folder, fault, operation, stage)
                if found is None:
                    continue  # the operation does not occur in this step
                well, measurement = found
                tried += 1
                survived += well
                if not well:
                    failed.append(f"{fault} in {operation} at {stage}")
                if fault not in BENCH_FAULTS:
                    device_faults += 1
                    equal += measurement is not None and _same_counts(measurement, whole)
    return {
        "faults_tried": tried,
        "faults_survived": survived,
        "faults_failed": failed,
        "device_faults_tried": device_faults,
        "device_faults_same_counts": equal,
    }


def _try(
    world: World, settings: PlanSettings, folder: Path, fault: str, operation: str, stage: str
) -> tuple[bool, Measurement | None] | None:
    """Whether a fault is survived, and the measurement after it; None where it cannot happen."""
    with connected(world) as (wire, opened):
        faults = wire.state.faults
        devices = opened()
        names = [info.name for info in devices.devices]
        if fault in AT_OPENING:
            faults.arm("unplugging", operation="usb650.frame", stage=stage)
        else:
            faults.arm(fault, operation=operation, stage=stage)
        well = True
        try:
            result = capture_visit(devices, settings, folder)
            return (True, result) if faults.log else None
        except CaptureStopped as stopped:
            well &= any(name and name in str(stopped) for name in names)
            well &= "--resume" in str(stopped)
        kept = {path: path.read_bytes() for path in folder.glob("shots/*.shot")}
        wire.close()
        wire.plug_in()
        faults.disarm()
        if fault in AT_OPENING:
            faults.arm(fault, operation=operation, lasting=True)
            try:
                # Another device may open; the journal then refuses it.
                capture_visit(opened(), settings, folder, resume=True)
                well = False
            except DeviceError as error:
                well &= bool(error.device) and bool(error.remedy)
            faults.disarm()
            wire.close()
        completed: Measurement | None = None
        with contextlib.suppress(DeviceError):
            completed = capture_visit(opened(), settings, folder, resume=True)
        well &= completed is not None
        well &= all(path.read_bytes() == data for path, data in kept.items())
        return bool(well), completed
