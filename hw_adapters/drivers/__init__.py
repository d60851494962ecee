"""Our adapters above the real driver libraries: one module for each kind of device.

Nothing here is imported unless a device is asked for, and a library that is missing is answered
with the command that installs it (`pip install "benchtwin[instruments]"`).

    ocean           spectrometers of Ocean Optics and Ocean Insight, through python-seabreeze
    as7341          the chip AS7341, through adafruit-circuitpython-as7341
    scpi            bench supplies and LED drivers, through pyvisa and pyvisa-py
    serial_slider   a slider under Grbl, through pyserial

A stage, a holder or lamps that are a person need no library: `hw_adapters.manual`.
"""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

__all__ = ["as7341", "ocean", "scpi", "serial_slider"]


def __getattr__(name: str) -> ModuleType:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return import_module(f"{__name__}.{name}")
