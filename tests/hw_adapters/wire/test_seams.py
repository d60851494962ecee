"""Devices in process and real drivers on the wire agree count for count for equal seeds."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("seabreeze", reason="python-seabreeze is not installed (extra instruments)")
pytest.importorskip("usb", reason="pyusb is not installed (extra instruments)")
pytest.importorskip("adafruit_as7341", reason="Adafruit's driver is not installed (instruments)")
pytest.importorskip("serial", reason="pyserial is not installed (extra instruments)")
pytest.importorskip("pyvisa_py", reason="pyvisa-py is not installed (extra instruments)")

from hw_adapters.errors import (
    BadAnswer,
    DeviceError,
    DeviceLost,
    DeviceMissing,
    DeviceTimeout,
    RequestOutOfLimits,
    UnknownCommand,
    WrongDevice,
)
from hw_adapters.faults import Faults
from hw_adapters.protocols import BackgroundStage, LightSource, MultispectralSensor, Spectrometer
from hw_adapters.wire.bench import wire_bench
from hw_adapters.wire.usb650_layout import usb650_instrument
from tests.hw_adapters.wire.seams import bench_state, in_process, on_both, visit
from twin.errors import InputError

KINDS = ("spectrometer", "chip")


@pytest.mark.parametrize("supply", ["socket", "serial"])
@pytest.mark.parametrize("kind", KINDS)
def test_seams_agree_bit_for_bit(kind: str, supply: str) -> None:
    virtual, wired = on_both(kind, visit, supply)
    assert len(virtual) == len(wired) == 16
    for one, other in zip(virtual, wired, strict=True):
        np.testing.assert_array_equal(one.counts, other.counts)
        np.testing.assert_array_equal(one.saturated, other.saturated)
        assert one.applied == other.applied
        assert one.full_scale == other.full_scale
        assert (one.time_s, one.pass_times_s) == (other.time_s, other.pass_times_s)


@pytest.mark.parametrize("kind", KINDS)
def test_another_seed_gives_other_counts(kind: str) -> None:
    first, _ = on_both(kind, visit, seed=11)
    _, second = on_both(kind, visit, seed=12)
    assert any(not np.array_equal(a.counts, b.counts) for a, b in zip(first, second, strict=True))


@pytest.mark.parametrize("kind", KINDS)
def test_adapters_keep_the_protocols(kind: str) -> None:
    state = bench_state(kind)
    with wire_bench(state) as wire:
        sensor, lights, stage = wire.open_sensor(), wire.open_lights(), wire.open_stage()
        wanted = Spectrometer if kind == "spectrometer" else MultispectralSensor
        assert isinstance(sensor, wanted)
        assert isinstance(lights, LightSource)
        assert isinstance(stage, BackgroundStage)
        assert {each.info.seam for each in (sensor, lights, stage)} == {"wire"}
        assert all(" " in each.info.driver for each in (sensor, lights, stage))
        np.testing.assert_array_equal(sensor.wavelength_nm, state.instrument.wavelength_nm)
        virtual = in_process(state)
        assert set(stage.positions) == set(virtual[2].positions)
        assert lights.channels == virtual[1].channels


def test_the_applied_time_is_the_one_of_the_device() -> None:
    state = bench_state("spectrometer")
    with wire_bench(state) as wire:
        sensor = wire.open_sensor()
        for asked, applied in ((0.0127, 0.012), (0.003, 0.003), (0.0039, 0.003), (0.057, 0.057)):
            assert sensor.configure(asked).integration_s == applied
            assert wire.unit.integration_ms == round(applied * 1000)
            sensor.discard()
            assert sensor.capture().applied.integration_s == applied


@pytest.mark.parametrize("asked", [0.0029, 0.0, -1.0, 655.35, 1e9, float("nan")])
def test_a_time_outside_the_limits_is_refused_and_changes_nothing(asked: float) -> None:
    with wire_bench(bench_state("spectrometer")) as wire:
        sensor = wire.open_sensor()
        sensor.configure(0.02)
        with pytest.raises(RequestOutOfLimits, match=r"USB650.*0\.003"):
            sensor.configure(asked)
        assert wire.unit.integration_ms == 20
        assert sensor.limits.shortest_s == 0.003


def test_settings_that_failed_are_sent_again() -> None:
    for kind, operation in (("spectrometer", "usb650.write"), ("chip", "as7341.write")):
        state = bench_state(kind)
        with wire_bench(state) as wire:
            sensor = wire.open_sensor()
            old, new = ((0.02,), (0.05,)) if kind == "spectrometer" else (
                (16.0, 99, 599), (4.0, 99, 399)
            )  # fmt: skip
            sensor.configure(*old)
            state.faults.arm("timeout", operation=operation)
            with pytest.raises(DeviceTimeout):
                sensor.configure(*new)
            with pytest.raises(InputError, match="`configure` first"):
                sensor.capture()
            applied = sensor.configure(*old)
            sensor.discard()
            assert sensor.capture().applied == applied


@pytest.mark.parametrize(
    "asked",
    [(3.0, 99, 999), (16.0, 256, 9), (16.0, 0, 65535), (16.0, 0, 0), (16.0, 255, 65534)],
)
def test_registers_outside_the_limits_are_refused(asked: tuple) -> None:
    with wire_bench(bench_state("chip")) as wire:
        sensor = wire.open_sensor()
        sensor.configure(16.0, 99, 999)
        with pytest.raises(RequestOutOfLimits, match="AS7341"):
            sensor.configure(*asked)
        state_of = wire.state
        state_of.announce(0)
        assert sensor.capture().applied.atime == 99
        assert wire.unit.passes[-1].atime == 99


def test_a_capture_before_the_settings_is_a_mistake() -> None:
    for kind in KINDS:
        with (
            wire_bench(bench_state(kind)) as wire,
            pytest.raises(InputError, match="`configure` first"),
        ):
            wire.open_sensor().capture()


def test_saturation_is_said_though_the_chips_driver_drops_it() -> None:
    for nonlinearity, digital in ((0.002, True), (-0.002, False)):
        state = bench_state("chip", white_rate_electrons_per_s=4e9, nonlinearity=nonlinearity)
        with wire_bench(state) as wire:
            sensor, lights, stage = wire.open_sensor(), wire.open_lights(), wire.open_stage()
            stage.move_to("white")
            lights.set("panels", 1.0)
            sensor.configure(64.0, 99, 599)
            frame = sensor.capture()
            assert frame.full_scale == 60_000
            assert bool(frame.counts.max() == frame.full_scale) is digital
            assert frame.saturated.any()


def test_a_reading_that_broke_off_between_the_passes_leaves_no_old_data() -> None:
    state = bench_state("chip", faults=Faults())
    with wire_bench(state) as wire:
        sensor = wire.open_sensor()
        sensor.configure(16.0, 99, 599)
        state.announce(0)
        first = sensor.capture()
        state.faults.arm("timeout", operation="as7341.frame", occurrence=2)
        state.announce(1)
        with pytest.raises(DeviceTimeout, match="AS7341"):
            sensor.capture()
        lights, stage = wire.open_lights(), wire.open_stage()
        stage.move_to("white")
        lights.set("panels", 1.0)
        state.announce(2)
        again = sensor.capture()
    assert np.all(again.counts[:4] > first.counts[:4] + 100)


def test_lights_are_set_read_back_and_refused() -> None:
    state = bench_state("chip")
    with wire_bench(state) as wire:
        lights = wire.open_lights()
        assert lights.info.serial == "TWIN0001"
        assert lights.set("panels", 0.3).drive == 0.3 == state.drive("panels")
        assert lights.set("beam", 1.0).drive == 1.0 == state.drive("beam")
        for drive in (1.1, -0.1, float("nan")):
            with pytest.raises(RequestOutOfLimits, match="LED-SUPPLY"):
                lights.set("panels", drive)
        with pytest.raises(UnknownCommand, match="'lamp'"):
            lights.set("lamp", 1.0)
        assert state.drive("panels") == 0.3
        lights.off()
        assert (state.drive("panels"), state.drive("beam")) == (0.0, 0.0)
        lights.set("panels", 1.0)
    assert state.drive("panels") == 0.0, "closing switches the lamps off"


def test_an_error_of_the_supply_is_not_passed_over() -> None:
    from hw_adapters.drivers.scpi import open_lights

    with (
        wire_bench(bench_state("chip")) as wire,
        pytest.raises(DeviceTimeout, match=r"CURR\? MAX,\(@9\)"),
    ):
        open_lights(wire.resource, {"panels": 9}, timeout_s=0.1)
    with wire_bench(bench_state("chip")) as wire:
        lights = open_lights(wire.resource, {"panels": 1})
        lights._channels["panels"] = 9
        with pytest.raises(UnknownCommand, match="-222"):
            lights.set("panels", 1.0)
        lights._channels["panels"] = 1


def test_lamps_on_a_bus_of_messages_are_told_one_line_at_a_time() -> None:
    from hw_adapters.drivers.scpi import ScpiLights
    from hw_adapters.wire.scpi import ScpiSupply

    flowing: dict[int, float] = {}
    device = ScpiSupply(flowing.__setitem__)
    said: list[str] = []

    class Messages:
        def write(self, line: str) -> None:
            said.append(line)
            device.line(line)

        def query(self, line: str) -> str:
            said.append(line)
            return device.line(line) or ""

    lights = ScpiLights(Messages(), {"beam": 2}, streamed=False)
    assert lights.set("beam", 0.25).drive == 0.25
    assert flowing[2] == 0.25
    assert not any("\n" in line for line in said)


def test_the_stage_moves_and_refuses() -> None:
    state = bench_state("chip")
    with wire_bench(state) as wire:
        stage = wire.open_stage()
        assert state.background == "out"
        for position in ("white", "black", "black", "out"):
            stage.move_to(position)
            assert state.background == position
        assert state.clock.now_s() == 6.0
        with pytest.raises(UnknownCommand, match="'grey'"):
            stage.move_to("grey")
        stage._positions_mm["far"] = 900.0
        with pytest.raises(UnknownCommand, match="error:15"):
            stage.move_to("far")
        assert state.background == "out"


# Faults ------------------------------------------------------------------------------------------


def fault_on(kind: str, name: str, operation: str, occurrence: int = 1) -> Faults:
    faults = Faults()
    faults.arm(name, operation=operation, occurrence=occurrence)
    return faults


SENSOR_FAULTS = [
    ("spectrometer", "timeout", "usb650.frame", DeviceTimeout),
    ("spectrometer", "timeout", "usb650.write", DeviceTimeout),
    ("spectrometer", "unplugging", "usb650.frame", DeviceLost),
    ("spectrometer", "unplugging", "usb650.read", DeviceLost),
    ("spectrometer", "dropped_byte", "usb650.frame", BadAnswer),
    ("chip", "timeout", "as7341.frame", DeviceTimeout),
    ("chip", "unplugging", "as7341.frame", DeviceLost),
    ("chip", "unplugging", "as7341.write", DeviceLost),
    ("chip", "dropped_byte", "as7341.read", DeviceLost),
]


@pytest.mark.parametrize(("kind", "name", "operation", "error"), SENSOR_FAULTS)
def test_a_fault_of_the_sensor_names_the_device_and_the_remedy(
    kind: str, name: str, operation: str, error: type[DeviceError]
) -> None:
    state = bench_state(kind)
    with wire_bench(state) as wire:
        sensor = wire.open_sensor()
        configure = (0.02,) if kind == "spectrometer" else (16.0, 99, 599)
        sensor.configure(*configure)
        sensor.discard()
        state.announce(0)
        before = sensor.capture()
        state.faults.arm(name, operation=operation)
        state.announce(0)
        with pytest.raises(error) as caught:
            sensor.capture()
        assert sensor.info.name in str(caught.value)
        assert "--resume" in str(caught.value)
        wire.close()
        wire.plug_in()
        again = wire.open_sensor()
        again.configure(*configure)
        again.discard()
        state.announce(0)
        np.testing.assert_array_equal(again.capture().counts, before.counts)


def test_a_stale_frame_is_read_again() -> None:
    state = bench_state("spectrometer")
    with wire_bench(state) as wire:
        sensor = wire.open_sensor()
        sensor.configure(0.02)
        sensor.discard()
        state.announce(0)
        first = sensor.capture()
        state.faults.arm("stale_frame", operation="*.frame")
        state.announce(1)
        second = sensor.capture()
    assert sensor.repeated == 1
    assert not np.array_equal(first.counts, second.counts)


def test_decimal_commas_in_the_eeprom() -> None:
    faults = Faults()
    faults.arm("decimal_comma", operation="usb650.eeprom", lasting=True)
    with wire_bench(bench_state("spectrometer", faults=faults)) as wire:
        with pytest.raises(BadAnswer, match=r"'0,327'.*decimal commas.*coefficients="):
            wire.open_sensor()
        from hw_adapters.drivers.ocean import open_spectrometer
        from hw_adapters.wire.usb650_layout import COEFFICIENTS, wavelengths_nm

        sensor = open_spectrometer(pyusb_backend=wire.bus, coefficients=COEFFICIENTS)
        np.testing.assert_allclose(sensor.wavelength_nm, wavelengths_nm(), rtol=1e-12)
        sensor.close()


def test_serial_numbers_that_are_not_the_wanted_ones() -> None:
    from hw_adapters.drivers.ocean import open_spectrometer
    from hw_adapters.drivers.scpi import open_lights
    from hw_adapters.wire.usb650 import Usb650, plugged_in

    state = bench_state("spectrometer")
    with wire_bench(state) as wire:
        assert open_spectrometer("USB650-7", pyusb_backend=wire.bus).info.serial == "USB650-7"
        state.faults.arm("wrong_serial", operation="usb650.info", lasting=True)
        with pytest.raises(WrongDevice, match=r"OTHER0-7.*the spectrometer USB650-7"):
            open_spectrometer("USB650-7", pyusb_backend=wire.bus)
        with pytest.raises(WrongDevice, match=r"TWIN0001.*ABC"):
            open_lights(wire.resource, {"panels": 1}, serial="ABC")
    units = [Usb650(state.whole_counts, serial=serial) for serial in ("A", "B", "B")]
    with plugged_in(*units[:2]) as bus:
        assert open_spectrometer("B", pyusb_backend=bus).info.serial == "B"
        with pytest.raises(WrongDevice, match="Name one by its serial number"):
            open_spectrometer(pyusb_backend=bus)
    with plugged_in(*units) as bus, pytest.raises(WrongDevice, match="Unplug all but one"):
        open_spectrometer("B", pyusb_backend=bus)
    with plugged_in() as bus, pytest.raises(DeviceMissing, match="none"):
        open_spectrometer(pyusb_backend=bus)


@pytest.mark.parametrize(
    ("name", "error"), [("timeout", DeviceTimeout), ("unplugging", DeviceError)]
)
@pytest.mark.parametrize("device", ["scpi.ask", "slider.line"])
def test_faults_of_lamps_and_stage(device: str, name: str, error: type[DeviceError]) -> None:
    state = bench_state("chip")
    with wire_bench(state) as wire:
        lights, stage = wire.open_lights(timeout_s=0.1), wire.open_stage()
        state.faults.arm(name, operation=device, occurrence=2)
        with pytest.raises(error, match=r"LED-SUPPLY|Grbl slider") as caught:  # noqa: PT012
            for position, drive in (("white", 1.0), ("black", 0.5), ("out", 0.0)):
                if device == "scpi.ask":
                    lights.set("panels", drive)
                else:
                    stage.move_to(position)
        assert "--resume" in str(caught.value)
        wire.close()
        wire.plug_in()
        lights, stage = wire.open_lights(), wire.open_stage()
        stage.move_to("white")
        assert lights.set("panels", 1.0).drive == 1.0
        assert state.situation == ("white_reference", "thin")


def test_lamp_that_is_not_connected() -> None:
    with wire_bench(bench_state("chip")) as wire:
        lights = wire.open_lights()
        wire.supply._measured = lambda channel, value: "0.0"
        with pytest.raises(BadAnswer, match="wires of beam"):
            lights.set("beam", 1.0)


@pytest.mark.parametrize(
    "changes", [{"off": ("quantisation",)}, {"adc_bits": 16}, {"pixels_nm": (400.0, 500.0)}]
)
def test_an_instrument_that_the_stand_in_cannot_be(changes: dict) -> None:
    from hw_adapters.state import BenchState

    spec = usb650_instrument(**changes)
    rates = {("white", "a"): np.ones(len(spec.wavelength_nm))}
    with (
        pytest.raises(InputError, match="found"),
        wire_bench(BenchState(spec, rates, samples=("a",))),
    ):
        pass
