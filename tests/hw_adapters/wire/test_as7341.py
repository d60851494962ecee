"""The real Adafruit driver above the stand-in of the AS7341."""

from __future__ import annotations

import pytest

pytest.importorskip(
    "adafruit_as7341", reason="adafruit-circuitpython-as7341 is not installed (extra instruments)"
)

from adafruit_as7341 import AS7341, Gain

from hw_adapters.errors import UnknownCommand
from hw_adapters.wire.as7341 import ADDRESS, STEP_S, As7341, ChipPass, I2cBus, PassReading

LOW = ("F1", "F2", "F3", "F4", "CLEAR", "NIR")
HIGH = ("F5", "F6", "F7", "F8", "CLEAR", "NIR")
READING = {name: 1000 + 7 * index for index, name in enumerate((*LOW, *HIGH[:4]))}


def readings(setting: ChipPass) -> PassReading:
    return PassReading([READING[name] for name in setting.channels])


def test_the_driver_reads_the_very_counts_in_two_passes() -> None:
    chip = As7341(readings)
    sensor = AS7341(I2cBus(chip))
    assert list(sensor.all_channels) == [READING[name] for name in (*LOW[:4], *HIGH[:4])]
    assert [one.channels for one in chip.passes] == [LOW, HIGH]
    assert sensor.channel_680nm == READING["F8"]
    assert sensor.channel_415nm == READING["F1"]


def test_gain_and_times_reach_the_measurement() -> None:
    chip = As7341(readings)
    sensor = AS7341(I2cBus(chip))
    sensor.gain, sensor.atime, sensor.astep = Gain.GAIN_0_5X, 29, 599
    _ = sensor.channel_555nm
    assert chip.passes == [ChipPass(HIGH, 0.5, 29, 599)]
    assert chip.passes[0].full_scale == 18_000
    assert chip.passes[0].integration_s == pytest.approx(18_000 * STEP_S)
    assert (sensor.gain, sensor.atime, sensor.astep) == (0, 29, 599)


def test_saturation_is_in_the_registers_though_the_driver_drops_it() -> None:
    for astep, saturated in ((9, True), (999, False)):
        bus = I2cBus(
            As7341(lambda setting: PassReading([min(1005, setting.full_scale), 5, 5, 5, 5, 5]))
        )
        sensor = AS7341(bus)
        sensor.atime, sensor.astep = 99, astep
        assert sensor.channel_415nm == (1000 if saturated else 1005)
        assert bus.try_lock()
        status = bytearray(2)
        bus.writeto_then_readfrom(ADDRESS, b"\x94", status, in_end=1)
        bus.writeto_then_readfrom(ADDRESS, b"\xa3", status, in_start=1)
        assert bool(status[0] & 0x80) is saturated
        assert bool(status[1] & 0x10) is saturated
        assert status[0] & 0x0F == Gain.GAIN_128X


def test_the_lamp_of_the_board_lives_in_the_low_bank() -> None:
    sensor = AS7341(I2cBus(As7341(readings)))
    sensor.led_current = 50
    assert sensor.led_current == 50


@pytest.mark.parametrize(
    ("register", "data", "said"),
    [
        (0x93, b"\x00", "write of 0x00 to register 0x93"),
        (0xAA, b"\x0b", "gain 11"),
        (0x80, b"\x41", "ENABLE 0x41"),
        (0x80, b"\x11", "multiplexer command"),
        (0x74, b"\x80", "while the high bank is on"),
        (0x92, b"\x00", "register 0x92"),
    ],
)
def test_an_unknown_register_or_bit_fails_loudly(register: int, data: bytes, said: str) -> None:
    with pytest.raises(UnknownCommand, match=said):
        As7341(readings).write(register, data)


def test_registers_that_the_stand_in_lacks_are_not_read_as_zero() -> None:
    with pytest.raises(UnknownCommand, match="read of register 0xdb"):
        As7341(readings).read(0xDB, 1)
    with pytest.raises(UnknownCommand, match="0x18"):
        AS7341(I2cBus(As7341(readings))).flicker_detection_enabled = True


def test_half_a_photodiode_or_two_colours_on_one_converter_fail_loudly() -> None:
    for cells in ({1: 0x01}, {1: 0x01, 16: 0x01, 19: 0x01}, {2: 0x01}, {19: 0x07}):
        chip = As7341(readings)
        for cell, value in cells.items():
            chip.write(cell, bytes([value]))
        chip.write(0xAF, b"\x10")
        chip.write(0x80, b"\x11")
        with pytest.raises(UnknownCommand, match=r"converter|cell"):
            chip.write(0x80, b"\x03")


def test_a_bus_without_the_chip() -> None:
    chip = As7341(readings)
    chip.unplug()
    with pytest.raises(ValueError, match="No I2C device at address: 0x39"):
        AS7341(I2cBus(chip))
    with pytest.raises(ValueError, match="0x38"):
        AS7341(I2cBus(As7341(readings)), address=0x38)


def test_unplugging_dropped_byte_and_stale_data() -> None:
    told: list[str] = []
    faults: list[str] = []

    def hook(operation: str) -> str:
        told.append(operation)
        return faults.pop() if faults and operation == "as7341.frame" else ""

    counter = iter(range(100))
    chip = As7341(lambda setting: PassReading([next(counter)] * 6), faults=hook)
    sensor = AS7341(I2cBus(chip))
    assert sensor.channel_415nm == 0
    faults.append("stale_frame")
    assert sensor.channel_555nm == 0
    assert sensor.channel_415nm == 1
    chip.unplug()
    with pytest.raises(OSError, match="Remote I/O"):
        _ = sensor.channel_555nm
    assert {"as7341.frame", "as7341.read", "as7341.write"} <= set(told)


def test_time_passes_by_the_integration_time_of_each_pass() -> None:
    passed: list[float] = []
    sensor = AS7341(I2cBus(As7341(readings, sleep=passed.append)))
    _ = sensor.all_channels
    assert passed == [pytest.approx(101 * 1000 * STEP_S)] * 2
