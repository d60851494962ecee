"""One suite per type of device, on seams A (in process), B (on the wire) and C (real devices)."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from hw_adapters import (
    BackgroundStage,
    DeviceMissing,
    LightSource,
    MultispectralSensor,
    RequestOutOfLimits,
    SampleHolder,
    Spectrometer,
    UnknownCommand,
    VirtualHolder,
)
from hw_adapters.protocols import Applied, Clock, Frame, RealClock

SENSORS = ("spectrometer", "chip")


@dataclass
class Devices:
    """What a seam offers; None where it has no such device."""

    sensor: Any = None
    lights: Any = None
    stage: Any = None
    holder: Any = None
    clock: Clock = field(default_factory=RealClock)
    announce: Callable[[int, str], None] = lambda shot, stage: None


@contextlib.contextmanager
def virtual(kind: str) -> Iterator[Devices]:
    seams = pytest.importorskip(
        "tests.hw_adapters.wire.seams", reason="the wire's extra is missing"
    )
    state = seams.bench_state(kind)
    sensor, lights, stage = seams.in_process(state)
    yield Devices(sensor, lights, stage, VirtualHolder(state), state.clock, state.announce)


@contextlib.contextmanager
def wire(kind: str) -> Iterator[Devices]:
    for library in ("seabreeze", "usb", "adafruit_as7341", "serial", "pyvisa_py"):
        pytest.importorskip(library, reason=f"{library} is not installed (extra instruments)")
    from hw_adapters.wire.bench import wire_bench
    from tests.hw_adapters.wire.seams import bench_state

    state = bench_state(kind)
    with wire_bench(state) as bench:
        yield Devices(
            bench.open_sensor(), bench.open_lights(), bench.open_stage(), bench.open_holder(),
            state.clock, state.announce,
        )  # fmt: skip


@contextlib.contextmanager
def real(kind: str) -> Iterator[Devices]:
    from hw_adapters.drivers import as7341, ocean

    try:
        opened: Any = ocean.open_spectrometer() if kind == "spectrometer" else as7341.open_as7341()
    except DeviceMissing as missing:
        pytest.skip(f"no {kind} is connected: {missing}")
    with contextlib.closing(opened):
        yield Devices(opened)


SEAMS = {"virtual": virtual, "wire": wire, "real": real}


@pytest.fixture(params=SEAMS)
def seam(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(params=SENSORS)
def devices(seam: str, request: pytest.FixtureRequest) -> Iterator[Devices]:
    with SEAMS[seam](request.param) as found:
        yield found


def configure(sensor: Any, number: int = 0, averages: int = 1) -> Applied:
    if isinstance(sensor, MultispectralSensor):
        return sensor.configure((16.0, 4.0)[number], 99, (599, 499)[number], averages)
    return sensor.configure((0.02, 0.04)[number], averages)


def reading(devices: Devices, shot: int = 0) -> Frame:
    devices.announce(shot, "conformance")
    return devices.sensor.capture()


def test_the_sensor_says_who_it_is(devices: Devices, seam: str) -> None:
    sensor = devices.sensor
    assert isinstance(sensor, Spectrometer | MultispectralSensor)
    assert sensor.info.seam == seam
    assert sensor.info.kind in SENSORS
    assert sensor.info.name.strip()
    assert np.all(np.diff(sensor.wavelength_nm) > 0)
    assert 0 < sensor.limits.shortest_s < sensor.limits.longest_s
    if isinstance(sensor, MultispectralSensor):
        assert len(sensor.channels) == sensor.wavelength_nm.size


def test_a_reading_has_its_shape_and_its_settings(devices: Devices) -> None:
    for number in (0, 1):
        applied = configure(devices.sensor, number, averages=2)
        devices.sensor.discard()
        frame = reading(devices, number)
        assert frame.applied == applied
        assert applied.averages == 2
        assert frame.counts.shape == frame.saturated.shape == devices.sensor.wavelength_nm.shape
        assert frame.counts.dtype == np.float64
        assert 0 <= frame.counts.min() <= frame.counts.max() <= frame.full_scale
        assert frame.time_s <= devices.clock.now_s()
        with pytest.raises(ValueError, match="read-only"):
            frame.counts[0] = 1.0


def test_a_reading_takes_at_least_its_time(devices: Devices) -> None:
    applied = configure(devices.sensor, 1, averages=2)
    devices.sensor.discard()
    before = devices.clock.now_s()
    frame = reading(devices)
    passes = max(1, len(frame.pass_times_s))
    # A real spectrometer exposes without pause: one frame may be under way already.
    assert devices.clock.now_s() - before >= 0.99 * applied.integration_s * (2 * passes - 1)


def test_the_sensor_refuses_and_stays_as_it_was(devices: Devices) -> None:
    sensor = devices.sensor
    applied = configure(sensor)
    limits = sensor.limits
    if isinstance(sensor, MultispectralSensor):
        wrong: list[tuple] = [
            (3.0, 99, 599),
            (16.0, 256, 599),
            (16.0, -1, 599),
            (16.0, 255, 65_534),
        ]
    else:
        wrong = [(0.5 * limits.shortest_s,), (2 * limits.longest_s,), (-1.0,), (float("nan"),)]
    for request in wrong:
        with pytest.raises(RequestOutOfLimits) as error:
            sensor.configure(*request)
        assert sensor.info.name in str(error.value)
        assert "Ask for a setting within the limits" in str(error.value)
    with pytest.raises(RequestOutOfLimits, match="0 averages"):
        configure(sensor, averages=0)
    sensor.discard()
    assert reading(devices).applied == applied


def test_the_time_that_is_said_is_a_whole_step(devices: Devices) -> None:
    sensor = devices.sensor
    if isinstance(sensor, MultispectralSensor):
        assert configure(sensor).integration_s == pytest.approx(0.1668)
        return
    asked = 1.37 * sensor.limits.shortest_s + 0.0004
    applied = sensor.configure(asked).integration_s
    assert applied <= asked
    assert applied == sensor.limits.rounded(asked)
    if sensor.limits.step_s:
        steps = applied / sensor.limits.step_s
        assert steps == pytest.approx(round(steps))


def test_the_lights_obey_and_refuse(devices: Devices) -> None:
    lights = devices.lights
    if lights is None:
        pytest.skip("no lights are connected")
    assert isinstance(lights, LightSource)
    assert set(lights.channels) == {"panels", "beam"}
    assert lights.settle_s >= 0
    for name in lights.channels:
        applied = lights.set(name, 0.5)
        assert (applied.channel, applied.drive) == (name, 0.5)
    for drive in (-0.1, 1.1, float("nan")):
        with pytest.raises(RequestOutOfLimits) as error:
            lights.set("panels", drive)
        assert lights.info.name in str(error.value)
    with pytest.raises(UnknownCommand, match="'torch'"):
        lights.set("torch", 1.0)
    lights.off()


def test_the_stage_goes_where_it_is_told(devices: Devices) -> None:
    stage = devices.stage
    if stage is None:
        pytest.skip("no stage is connected")
    assert isinstance(stage, BackgroundStage)
    assert set(stage.positions) == {"black", "white", "out"}
    for position in (*stage.positions, stage.positions[-1]):
        stage.move_to(position)
    with pytest.raises(UnknownCommand, match="'grey'"):
        stage.move_to("grey")


def test_the_holder_knows_its_samples(devices: Devices) -> None:
    holder = devices.holder
    if holder is None:
        pytest.skip("no holder is connected")
    assert isinstance(holder, SampleHolder)
    for sample in holder.samples:
        holder.place(sample, True)
        holder.place(sample, False)
    with pytest.raises(UnknownCommand, match="'nobody'"):
        holder.place("nobody", True)


def test_light_moves_the_counts_and_the_first_frame_is_thrown_away(devices: Devices) -> None:
    if devices.lights is None:
        pytest.skip("no lights are connected")
    configure(devices.sensor)
    devices.stage.move_to("white")
    devices.sensor.discard()
    dark = reading(devices, 1)
    devices.lights.set("panels", 1.0)
    devices.clock.sleep(devices.lights.settle_s)
    devices.sensor.discard()
    lit = reading(devices, 2)
    devices.lights.set("panels", 0.5)
    devices.clock.sleep(devices.lights.settle_s)
    devices.sensor.discard()
    half = reading(devices, 3)
    signal = lit.counts - dark.counts
    bright = signal > 0.5 * signal.max()
    assert signal.max() > 100
    np.testing.assert_allclose(
        (half.counts - dark.counts)[bright].mean() / signal[bright].mean(), 0.5, rtol=0.03
    )
