"""What is connected to this computer, what could be, and what is missing for it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from hw_adapters.drivers.library import driver_name, load
from hw_adapters.errors import DeviceMissing

_OCEAN_VENDOR = 0x2457


@dataclass(frozen=True)
class Family:
    """A kind of device and its driver library.

    Attributes:
        device: what it is.
        library: name and version, or "".
        connected: what was found, in words; nothing is opened to find it.
        missing: what to do before it can be used, or "".
    """

    device: str
    library: str
    connected: tuple[str, ...] = field(default=())
    missing: str = ""


def inventory() -> tuple[Family, ...]:
    """Look for devices without opening any; a missing library is answered with its installation."""
    return (
        _family("Ocean spectrometer (USB)", "seabreeze", "seabreeze", _usb),
        _family("AS7341 chip (I2C)", "adafruit_as7341", "adafruit-circuitpython-as7341", _i2c),
        _family("lamp supply (SCPI)", "pyvisa_py", "PyVISA-py", lambda: ()),
        _family("background slider (serial)", "serial", "pyserial", _ports),
    )


def _family(device: str, module: str, distribution: str, look: Any) -> Family:
    try:
        load(module, device)
        return Family(device, driver_name(distribution), tuple(look()))
    except DeviceMissing as missing:
        return Family(device, "", missing=f"{missing.found}. {missing.remedy}")


def _usb() -> list[str]:
    core: Any = load("usb.core", "Ocean spectrometer (USB)")
    try:
        found = list(core.find(find_all=True, idVendor=_OCEAN_VENDOR))
    except (core.NoBackendError, core.USBError) as error:
        raise DeviceMissing(
            "Ocean spectrometer (USB)", f"no way to the USB bus ({error})", "libusb",
            "Install libusb (Debian: apt-get install libusb-1.0-0), then run seabreeze_os_setup.",
        ) from error  # fmt: skip
    return [
        f"USB {each.idVendor:04x}:{each.idProduct:04x}, address {each.address}" for each in found
    ]


def _ports() -> list[str]:
    tools: Any = load("serial.tools.list_ports", "background slider (serial)")
    # What hangs on a port is known only when it is opened, and opening resets some boards.
    return [
        f"perhaps on {each.device}"
        + (f" ({each.description})" if each.description not in ("", "n/a") else "")
        for each in tools.comports()
    ]


def _i2c() -> list[str]:
    # Blinka is asked only when a chip is opened: on a computer without I2C its import raises.
    return []
