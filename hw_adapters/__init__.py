"""Instruments, real and virtual: protocols, capture sequences, wire-level stand-ins.

A `DeviceBench` holds the devices of one bench. Its devices follow the protocols `Spectrometer`,
`MultispectralSensor`, `LightSource`, `BackgroundStage` and `SampleHolder`, at any of three seams:
`Virtual...` in process around a `BenchState` that the twin feeds, `hw_adapters.wire` under real
driver libraries, or `hw_adapters.drivers` on real devices. `capture_visit` runs the sequence, keeps
every shot in a journal, and returns a measurement of `twin`, so an estimator cannot tell which of
them took it.
"""

from __future__ import annotations

from hw_adapters.bench import DeviceBench
from hw_adapters.calibrate import Calibration, calibrate
from hw_adapters.errors import (
    BadAnswer,
    DeviceError,
    DeviceLost,
    DeviceMissing,
    DeviceTimeout,
    RequestOutOfLimits,
    Saturated,
    StaleFrame,
    UnknownCommand,
    WrongDevice,
)
from hw_adapters.exposure import Attempt, Exposed, expose
from hw_adapters.faults import FAULTS, Faults
from hw_adapters.journal import Journal, Taken
from hw_adapters.manual import ManualHolder, ManualLights, ManualStage
from hw_adapters.plan import PlannedShot, PlanSettings, capture_plan
from hw_adapters.protocols import (
    Applied,
    AppliedDrive,
    BackgroundStage,
    Clock,
    DeviceInfo,
    Frame,
    LightSource,
    Limits,
    MultispectralSensor,
    RealClock,
    SampleHolder,
    Spectrometer,
    VirtualClock,
)
from hw_adapters.sequence import CaptureStopped, capture_visit
from hw_adapters.state import BenchState
from hw_adapters.virtual import (
    VirtualChip,
    VirtualHolder,
    VirtualLights,
    VirtualSpectrometer,
    VirtualStage,
)

__all__ = [
    "FAULTS",
    "Applied",
    "AppliedDrive",
    "Attempt",
    "BackgroundStage",
    "BadAnswer",
    "BenchState",
    "Calibration",
    "CaptureStopped",
    "Clock",
    "DeviceBench",
    "DeviceError",
    "DeviceInfo",
    "DeviceLost",
    "DeviceMissing",
    "DeviceTimeout",
    "Exposed",
    "Faults",
    "Frame",
    "Journal",
    "LightSource",
    "Limits",
    "ManualHolder",
    "ManualLights",
    "ManualStage",
    "MultispectralSensor",
    "PlanSettings",
    "PlannedShot",
    "RealClock",
    "RequestOutOfLimits",
    "SampleHolder",
    "Saturated",
    "Spectrometer",
    "StaleFrame",
    "Taken",
    "UnknownCommand",
    "VirtualChip",
    "VirtualClock",
    "VirtualHolder",
    "VirtualLights",
    "VirtualSpectrometer",
    "VirtualStage",
    "WrongDevice",
    "calibrate",
    "capture_plan",
    "capture_visit",
    "expose",
]
