"""Stand-ins on the wire: what a device says to its real driver library, fed by the twin.

    usb650     Ocean USB650 on a USB bus of its own, for python-seabreeze
    as7341     AS7341 on an I2C bus, for adafruit-circuitpython-as7341
    scpi       LED driver or bench supply, for pyvisa-py
    slider     stepper motor under Grbl, for pyserial
    links      the cables of the last two: serial URLs and sockets of this computer
    bench      all of them around one `BenchState`

Importing this package imports none of them. A stand-in raises `UnknownCommand` where it is told
what its device does not know; it never answers with zeros.
"""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

__all__ = ["as7341", "bench", "links", "scpi", "slider", "usb650"]


def __getattr__(name: str) -> ModuleType:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return import_module(f"{__name__}.{name}")
