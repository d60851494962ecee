"""Real python-seabreeze above the stand-in of the USB650."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("seabreeze", reason="python-seabreeze is not installed (extra instruments)")
pytest.importorskip("usb", reason="pyusb is not installed (extra instruments)")

from usb.core import USBError, USBTimeoutError

from hw_adapters.errors import UnknownCommand
from hw_adapters.wire import usb650, usb650_layout
from hw_adapters.wire.usb650 import Usb650, plugged_in


class Frames:
    """Random frames, remembered with the integration time they were asked for."""

    def __init__(self, seed: int = 1) -> None:
        self._random = np.random.Generator(np.random.Philox(key=seed))
        self.sent: list[np.ndarray] = []
        self.times: list[float] = []

    def __call__(self, integration_s: float) -> np.ndarray:
        counts = self._random.integers(0, 4096, usb650_layout.PIXELS)
        self.sent.append(counts)
        self.times.append(integration_s)
        return counts


def opened(bus: str) -> object:
    from seabreeze.pyseabreeze import SeaBreezeDevice
    from seabreeze.pyseabreeze.transport import USBTransport

    handles = list(USBTransport.list_devices(pyusb_backend=bus))
    device = SeaBreezeDevice(handles[0])
    device.open()
    _open_devices.append(device)  # its features hold it by a weak reference only
    return device


_open_devices: list[object] = []


@pytest.fixture(autouse=True)
def close_devices() -> Iterator[None]:
    yield
    while _open_devices:
        _open_devices.pop().close()


def test_the_public_way_into_seabreeze_finds_the_stand_in_and_reads_its_counts() -> None:
    import seabreeze

    frames = Frames()
    with plugged_in(Usb650(frames, serial="USB650-A")) as bus:
        seabreeze.use("pyseabreeze", pyusb_backend=bus)
        from seabreeze.pyseabreeze import SeaBreezeDevice
        from seabreeze.pyseabreeze.transport import USBTransport
        from seabreeze.spectrometers import Spectrometer

        # list_devices() of seabreeze also sends multicast over the network: not from a test.
        handles = list(USBTransport.list_devices(pyusb_backend=bus))
        spectrometer = Spectrometer(SeaBreezeDevice(handles[0]))
        assert (spectrometer.model, spectrometer.serial_number) == ("USB650", "USB650-A")
        np.testing.assert_array_equal(spectrometer.wavelengths(), usb650_layout.wavelengths_nm())
        assert spectrometer.max_intensity == usb650_layout.FULL_SCALE
        for _ in range(3):
            np.testing.assert_array_equal(spectrometer.intensities(), frames.sent[-1])
        spectrometer.close()
    assert len(frames.sent) == 3


def test_seabreeze_truncates_to_whole_milliseconds_and_the_first_frame_is_stale() -> None:
    frames = Frames()
    unit = Usb650(frames)
    with plugged_in(unit) as bus:
        feature = opened(bus).f.spectrometer
        feature.set_integration_time_micros(12_700)
        assert unit.integration_ms == 12
        feature.get_intensities()
        feature.get_intensities()
    assert frames.times == [usb650.POWER_UP_MS / 1000, 0.012]


@settings(deadline=None, derandomize=True, max_examples=30)
@given(st.integers(0, 2**32 - 1))
def test_a_frame_survives_the_interleave_bit_for_bit(seed: int) -> None:
    random = np.random.Generator(np.random.Philox(key=seed))
    counts = random.integers(0, 4096, usb650_layout.PIXELS)
    data = np.frombuffer(usb650_layout.frame_bytes(counts), dtype=np.uint8)
    assert data.size == 4097
    # The index written as seabreeze writes it (SeaBreezeSpectrometerFeatureOOI2K).
    order = [(i // 2) % 64 + (i % 2) * 64 + (i // 128) * 128 for i in range(4096)]
    np.testing.assert_array_equal(data[order].view("<u2"), counts)


@pytest.mark.parametrize(
    "counts",
    [np.zeros(2047, int), np.zeros(2048), np.full(2048, 4096), np.full(2048, -1)],
)
def test_a_frame_that_the_device_could_not_send_is_refused(counts: np.ndarray) -> None:
    with pytest.raises(ValueError, match="expected"):
        usb650_layout.frame_bytes(counts)


@pytest.mark.parametrize(
    "command", [b"\x6a\x00\x00\x00", b"\x0a\x00\x00", b"\x05\x05", b"\x02\x02\x00", b"\x09\x00"]
)
def test_an_unknown_command_fails_loudly(command: bytes) -> None:
    unit = Usb650(Frames())
    with pytest.raises(UnknownCommand, match=r"USB650: found .* expected a command"):
        unit.write(command)
    unit.write(b"\x09")  # a known one passes
    assert len(unit.read(usb650.FAST_IN, 4097, 1000)) == 4097


def test_an_unknown_command_reaches_the_caller_through_seabreeze() -> None:
    with plugged_in(Usb650(Frames())) as bus:
        device = opened(bus)
        with pytest.raises(UnknownCommand, match="operation 0a"):
            device.f.spectrometer.set_trigger_mode(0)


def faulty(name: str, at: str, after: int = 0) -> object:
    seen = {"count": 0}

    def hook(operation: str) -> str:
        if operation != at:
            return ""
        seen["count"] += 1
        return name if seen["count"] == after + 1 else ""

    return hook


def test_a_time_out_and_a_frame_too_long_to_wait_for() -> None:
    unit = Usb650(Frames(), faults=faulty("timeout", "usb650.frame"))
    with plugged_in(unit) as bus:
        feature = opened(bus).f.spectrometer
        with pytest.raises(USBTimeoutError):
            feature.get_intensities()
        assert feature.get_intensities().shape == (2048,)
    slow = Usb650(Frames())
    slow.write(b"\x09")
    with pytest.raises(USBTimeoutError):
        slow.read(usb650.FAST_IN, 4097, 99)


def test_unplugging_and_plugging_in_again() -> None:
    unit = Usb650(Frames(), faults=faulty("unplugging", "usb650.write", after=7))
    with plugged_in(unit) as bus:
        feature = opened(bus).f.spectrometer
        with pytest.raises(USBError, match="disconnected"):  # noqa: PT012
            for _ in range(9):
                feature.get_intensities()
        from seabreeze.pyseabreeze.transport import USBTransport

        assert list(USBTransport.list_devices(pyusb_backend=bus)) == []
        unit.plug_in()
        assert opened(bus).f.spectrometer.get_intensities().shape == (2048,)


def test_a_dropped_byte_makes_a_frame_that_seabreeze_cannot_use() -> None:
    unit = Usb650(Frames(), faults=faulty("dropped_byte", "usb650.frame"))
    with plugged_in(unit) as bus:
        feature = opened(bus).f.spectrometer
        with pytest.raises(ValueError, match="4096"):
            feature.get_intensities()


def test_a_stale_frame_repeats_the_last_one() -> None:
    unit = Usb650(Frames(), faults=faulty("stale_frame", "usb650.frame", after=1))
    with plugged_in(unit) as bus:
        feature = opened(bus).f.spectrometer
        first, second, third = (feature.get_intensities() for _ in range(3))
    np.testing.assert_array_equal(first, second)
    assert not np.array_equal(second, third)


def test_a_decimal_comma_in_the_eeprom_is_no_number_to_seabreeze() -> None:
    unit = Usb650(Frames(), faults=lambda operation: "decimal_comma")
    with plugged_in(unit) as bus, pytest.raises(ValueError, match="could not convert"):
        opened(bus).f.spectrometer.get_wavelengths()


def test_a_wrong_serial_number_is_what_seabreeze_then_reports() -> None:
    unit = Usb650(Frames(), faults=lambda operation: "wrong_serial")
    with plugged_in(unit) as bus:
        assert opened(bus).serial_number == "OTHER0-TWIN01"


def test_time_passes_by_the_integration_time_of_the_frame() -> None:
    passed: list[float] = []
    unit = Usb650(Frames(), sleep=passed.append)
    with plugged_in(unit) as bus:
        feature = opened(bus).f.spectrometer
        feature.set_integration_time_micros(40_000)
        feature.get_intensities()
        feature.get_intensities()
    assert passed == [0.1, 0.04]
