"""The devices of one bench together, and what a measurement has to say about them."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from hw_adapters.protocols import (
    BackgroundStage,
    Clock,
    DeviceInfo,
    LightSource,
    MultispectralSensor,
    SampleHolder,
    Spectrometer,
)
from twin.bench import Bench, Sample
from twin.errors import InputError
from twin.measurement import Truth
from twin.spectra import FloatArray

Announce = Callable[[int, str], None]
"""Told the number and the step of the sequence before every reading: virtual benches listen."""


def _nobody(shot: int, stage: str) -> None:
    """A real bench need not be told."""


@dataclass(frozen=True, eq=False)
class DeviceBench:
    """The devices of one bench, and what a measurement has to say about it.

    Attributes:
        sensor: what reads the light.
        lights: panels and beam.
        stage: the backgrounds.
        holder: the samples.
        clock: the time of all of them.
        bench: the bench's description; its instrument describes the sensor's noise.
        samples: the samples in the order in which they are measured.
        announce: told of every reading; `BenchState.announce` of a virtual bench.
        origin: whether the light was the twin's.
        seed: seed of a virtual bench.
        range_nm: only pixels inside these wavelengths [nm] enter the measurement; None: all.
        calibrated_nm: wavelengths [nm] that the sensor must have, shape (P,); None: any.
        serial: serial number that the sensor must have; "": any.
        scenario: the resolved scenario of a virtual bench, as text.
        light_se: standard errors of the twin's light, shape (S, 3, P) of the pixels in range.
        truth: properties of simulated samples.
        noise: whether the uncertainty of the counts follows from the description of the
            instrument, or, where nobody described it, from the scatter of repeats.
    """

    sensor: Spectrometer | MultispectralSensor
    lights: LightSource
    stage: BackgroundStage
    holder: SampleHolder
    clock: Clock
    bench: Bench
    samples: tuple[Sample, ...]
    announce: Announce = _nobody
    origin: Literal["measured", "virtual"] = "measured"
    seed: int | None = None
    range_nm: tuple[float, float] | None = None
    calibrated_nm: FloatArray | None = None
    serial: str = ""
    scenario: str = ""
    light_se: FloatArray | None = None
    truth: Truth | None = None
    noise: Literal["instrument", "repeats"] = "instrument"

    @property
    def devices(self) -> tuple[DeviceInfo, ...]:
        """Which devices they are."""
        return tuple(each.info for each in (self.sensor, self.lights, self.stage, self.holder))

    def close(self) -> None:
        """Switch the lights off and let every device go."""
        with contextlib.suppress(InputError):
            self.lights.off()
        for device in (self.sensor, self.lights, self.stage, self.holder):
            with contextlib.suppress(InputError):
                device.close()
