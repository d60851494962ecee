"""The Ocean USB650 as it looks from the USB bus: real python-seabreeze runs above it.

`Usb650` is the device: operation codes in, EEPROM texts and frames out. `Usb650Backend` is the
host's side: a backend of pyusb on which the devices are plugged in, found by seabreeze's
pure-Python transport under the name that `plugged_in` gives it.

Source of the layout: seabreeze 2.11 (`seabreeze/pyseabreeze/devices.py`, class USB650;
`features/spectrometer.py`, class SeaBreezeSpectrometerFeatureOOI2K) and the operating manual of
the USB2000, whose commands the USB650 shares.
"""

from __future__ import annotations

import array
import errno
import itertools
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import ModuleType, SimpleNamespace

import numpy as np
import usb.backend
from numpy.typing import NDArray
from usb.core import USBError, USBTimeoutError

from hw_adapters.errors import UnknownCommand
from hw_adapters.wire.ports import FaultHook, FrameSource, Sleep, no_faults
from hw_adapters.wire.usb650_layout import (
    COEFFICIENTS,
    LONGEST_MS,
    SHORTEST_MS,
    coefficient_text,
    frame_bytes,
)

VENDOR, PRODUCT = 0x2457, 0x1014
OUT, SLOW_IN, FAST_IN = 0x02, 0x87, 0x82
INITIALISE, INTEGRATION_TIME, EEPROM, SPECTRUM = 0x01, 0x02, 0x05, 0x09
POWER_UP_MS = 100


class Usb650:
    """The device: what answers at the other end of the cable.

    After a change of the integration time the next frame is still one of the old time, as on the
    real device, which exposes without pause.
    """

    def __init__(
        self,
        frame: FrameSource,
        *,
        serial: str = "USB650-TWIN01",
        coefficients: Sequence[float] = COEFFICIENTS,
        sleep: Sleep | None = None,
        faults: FaultHook = no_faults,
    ) -> None:
        """A device that is plugged in.

        Args:
            frame: integration time [s] -> counts, whole numbers, shape (2048,).
            serial: serial number, at most 14 characters.
            coefficients: four coefficients of the wavelength polynomial [nm].
            sleep: lets time [s] of the bench pass; None passes none.
            faults: asked before every operation; see `hw_adapters.wire.ports.FaultHook`.

        Raises:
            ValueError: a serial number that does not fit, or not four coefficients.
        """
        if not 0 < len(serial.encode()) <= 14 or len(coefficients) != 4:
            raise ValueError(
                f"found serial {serial!r} and {len(coefficients)} coefficients;"
                " expected 1 to 14 characters and 4 coefficients"
            )
        self._frame = frame
        self._texts = [serial, *(coefficient_text(value) for value in coefficients)]
        self._sleep = sleep
        self._faults = faults
        self._milliseconds = POWER_UP_MS
        self._exposing_ms = POWER_UP_MS
        self._slow: list[bytes] = []
        self._frames_asked = 0
        self._last: NDArray[np.integer] | None = None
        self.plugged = True
        self.frames_sent = 0

    @property
    def integration_ms(self) -> int:
        """Integration time [ms] that the host has set."""
        return self._milliseconds

    def write(self, data: bytes) -> None:
        """Take one command.

        Raises:
            USBError: the device is unplugged.
            UnknownCommand: an operation code, a length or a value that the device does not know.
        """
        self._present("write")
        code, rest = data[0], data[1:]
        if code == INITIALISE and not rest:
            self._slow.clear()
            self._frames_asked = 0
        elif code == INTEGRATION_TIME and len(rest) in (2, 4):
            self._set_time(int.from_bytes(rest, "little"))
        elif code == EEPROM and len(rest) == 1:
            self._slow.append(self._slot(rest[0]))
        elif code == SPECTRUM and not rest:
            self._frames_asked += 1
        else:
            raise UnknownCommand("USB650", f"operation {data.hex(' ')}")

    def read(self, endpoint: int, size: int, timeout_ms: int) -> bytes:
        """Give what was asked for by the last command.

        Raises:
            USBError: the device is unplugged.
            USBTimeoutError: nothing was asked for, or it takes longer than the host waits.
            UnknownCommand: an end point that the device does not have.
        """
        self._present("read")
        if endpoint == SLOW_IN:
            if not self._slow:
                raise _timed_out()
            return self._slow.pop(0)[:size]
        if endpoint == FAST_IN:
            return self._next_frame(timeout_ms)[:size]
        raise UnknownCommand("USB650", f"end point 0x{endpoint:02x}")

    def unplug(self) -> None:
        """Pull the plug: from now on nothing answers, and the settings are forgotten."""
        self.plugged = False

    def plug_in(self) -> None:
        """Plug the device in again: it starts as after power-up."""
        self.plugged = True
        self._milliseconds = self._exposing_ms = POWER_UP_MS
        self._slow.clear()
        self._frames_asked = 0

    def _present(self, operation: str) -> None:
        self._act(self._faults(f"usb650.{operation}"))

    def _act(self, fault: str) -> None:
        """What can happen in any operation."""
        if fault == "unplugging":
            self.unplug()
        if not self.plugged:
            raise USBError("No such device (it may have been disconnected)", -4, errno.ENODEV)
        if fault == "timeout":
            raise _timed_out()

    def _set_time(self, milliseconds: int) -> None:
        if not SHORTEST_MS <= milliseconds <= LONGEST_MS:
            raise UnknownCommand("USB650", f"integration time of {milliseconds} ms")
        self._milliseconds = milliseconds

    def _slot(self, slot: int) -> bytes:
        if slot >= len(self._texts):
            raise UnknownCommand("USB650", f"EEPROM slot {slot}")
        text = self._texts[slot]
        fault = self._faults("usb650.eeprom" if slot else "usb650.info")
        self._act(fault)
        if fault == "decimal_comma":
            text = text.replace(".", ",")
        elif fault == "wrong_serial":
            text = "OTHER" + text[5:]
        answer = bytes([EEPROM, slot]) + text.encode().ljust(15, b"\0")
        return answer[1:] if fault == "dropped_byte" else answer

    def _next_frame(self, timeout_ms: int) -> bytes:
        if not self._frames_asked:
            raise _timed_out()
        fault = self._faults("usb650.frame")
        self._frames_asked -= 1
        exposure_s = self._exposing_ms / 1000
        self._exposing_ms = self._milliseconds
        if fault == "timeout" or 1000 * exposure_s > timeout_ms:
            self._pass_time(timeout_ms / 1000)
        self._act(fault)
        if 1000 * exposure_s > timeout_ms:
            raise _timed_out()
        if fault != "stale_frame" or self._last is None:
            self._last = self._frame(exposure_s)
            self._pass_time(exposure_s)
        self.frames_sent += 1
        data = frame_bytes(self._last)
        return data[:1000] + data[1001:] if fault == "dropped_byte" else data

    def _pass_time(self, seconds: float) -> None:
        if self._sleep is not None:
            self._sleep(seconds)


class Usb650Backend(usb.backend.IBackend):  # type: ignore[misc]
    """The host's side of the bus, in the terms of pyusb: which devices there are, and transfers."""

    def __init__(self, devices: Sequence[Usb650]) -> None:
        super().__init__()
        self._devices = list(devices)

    def enumerate_devices(self) -> Iterator[int]:
        """Numbers of the devices that are plugged in."""
        return (index for index, device in enumerate(self._devices) if device.plugged)

    def get_device_descriptor(self, dev: int) -> SimpleNamespace:
        """The device descriptor (USB 2.0, table 9-8)."""
        return SimpleNamespace(
            bLength=18, bDescriptorType=1, bcdUSB=0x0200, bDeviceClass=0, bDeviceSubClass=0,
            bDeviceProtocol=0, bMaxPacketSize0=64, idVendor=VENDOR, idProduct=PRODUCT,
            bcdDevice=2, iManufacturer=0, iProduct=0, iSerialNumber=0, bNumConfigurations=1,
            bus=1, address=dev + 1, port_number=dev + 1, port_numbers=(dev + 1,), speed=3,
        )  # fmt: skip

    def get_configuration_descriptor(self, dev: int, config: int) -> SimpleNamespace:
        """The only configuration (USB 2.0, table 9-10)."""
        _only(config)
        return SimpleNamespace(
            bLength=9, bDescriptorType=2, wTotalLength=39, bNumInterfaces=1, bConfigurationValue=1,
            iConfiguration=0, bmAttributes=0x80, bMaxPower=200, extra_descriptors=[],
        )  # fmt: skip

    def get_interface_descriptor(
        self, dev: int, intf: int, alt: int, config: int
    ) -> SimpleNamespace:
        """The only interface (USB 2.0, table 9-12)."""
        _only(intf, alt, config)
        return SimpleNamespace(
            bLength=9, bDescriptorType=4, bInterfaceNumber=0, bAlternateSetting=0, bNumEndpoints=3,
            bInterfaceClass=0xFF, bInterfaceSubClass=0, bInterfaceProtocol=0, iInterface=0,
            extra_descriptors=[],
        )  # fmt: skip

    def get_endpoint_descriptor(
        self, dev: int, ep: int, intf: int, alt: int, config: int
    ) -> SimpleNamespace:
        """One of the three end points (USB 2.0, table 9-13)."""
        _only(intf, alt, config)
        address = (OUT, SLOW_IN, FAST_IN)[ep]
        return SimpleNamespace(
            bLength=7, bDescriptorType=5, bEndpointAddress=address, bmAttributes=2,
            wMaxPacketSize=512 if address == FAST_IN else 64, bInterval=0, bRefresh=0,
            bSynchAddress=0, extra_descriptors=[],
        )  # fmt: skip

    def open_device(self, dev: int) -> int:
        """A handle: the number of the device."""
        self._plugged(dev)
        return dev

    def close_device(self, dev_handle: int) -> None:
        """Nothing is held."""

    def set_configuration(self, dev_handle: int, config_value: int) -> None:
        """There is one configuration."""
        self._plugged(dev_handle)

    def get_configuration(self, dev_handle: int) -> int:
        """There is one configuration."""
        return 1

    def claim_interface(self, dev_handle: int, intf: int) -> None:
        """There is one interface."""
        _only(intf)

    def release_interface(self, dev_handle: int, intf: int) -> None:
        """There is one interface."""

    def reset_device(self, dev_handle: int) -> None:
        """Seabreeze resets a device when it closes it; the settings stay."""
        self._plugged(dev_handle)

    def is_kernel_driver_active(self, dev_handle: int, intf: int) -> bool:
        """No kernel driver takes a USB650."""
        return False

    def bulk_write(
        self, dev_handle: int, ep: int, intf: int, data: array.array[int], timeout: int
    ) -> int:
        """One command to the device."""
        if ep != OUT:
            raise UnknownCommand("USB650", f"a write to end point 0x{ep:02x}")
        self._devices[dev_handle].write(data.tobytes())
        return len(data)

    def bulk_read(
        self, dev_handle: int, ep: int, intf: int, buff: array.array[int], timeout: int
    ) -> int:
        """One answer of the device, into the host's buffer; returns the number of bytes."""
        data = self._devices[dev_handle].read(ep, len(buff), timeout)
        memoryview(buff)[: len(data)] = data
        return len(data)

    def _plugged(self, dev: int) -> None:
        if not self._devices[dev].plugged:
            raise USBError("No such device (it may have been disconnected)", -4, errno.ENODEV)


_names = (f"benchtwin_usb650_{number}" for number in itertools.count(1))


@contextmanager
def plugged_in(*devices: Usb650) -> Iterator[str]:
    """Plug devices into a bus of their own, and give its name for `pyusb_backend`.

        with plugged_in(Usb650(frame)) as bus:
            seabreeze.use("pyseabreeze", pyusb_backend=bus)

    seabreeze looks backends up as modules of the package `usb.backend`, so a module of that name
    exists while the context lasts.
    """
    name = next(_names)
    backend = Usb650Backend(devices)
    module = ModuleType(f"usb.backend.{name}")
    module.get_backend = lambda: backend  # type: ignore[attr-defined]
    sys.modules[module.__name__] = module
    try:
        yield name
    finally:
        del sys.modules[module.__name__]


def _only(*numbers: int) -> None:
    # pyusb probes for a next descriptor until IndexError.
    if any(numbers):
        raise IndexError(numbers)


def _timed_out() -> USBTimeoutError:
    return USBTimeoutError("Operation timed out", -7, errno.ETIMEDOUT)
