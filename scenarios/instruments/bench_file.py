"""BENCH.toml: which devices a person has, and at which seam each of them is."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal, get_args

from pydantic import Field, model_validator

from hw_adapters.plan import PlanSettings
from hw_adapters.protocols import Seam
from twin.bench import Bench, Sample
from twin.errors import InputError
from twin.spectra import Part
from twin.toml import load_toml

CHIP_KEYS = ("gain", "atime", "astep")
"""Keys of [plan] that only a chip has."""


class DeviceEntry(Part):
    """What all devices have in common."""

    kind: Seam = "virtual"
    """"virtual": in process; "wire": the real driver above a stand-in; "real": the device."""
    serial: str = ""
    """Serial number that it must have; "" takes any."""


class SensorEntry(DeviceEntry):
    """The spectrometer or chip."""

    model: Literal["scenario", "ocean", "as7341"] = "scenario"
    """"scenario": the scenario's instrument, in process only; "ocean": an Ocean spectrometer (on
    the wire a USB650); "as7341": the chip."""
    coefficients: tuple[float, float, float, float] | None = None
    """Wavelength polynomial [nm] by pixel number, in place of the EEPROM's."""


class LightsEntry(DeviceEntry):
    """The lamps."""

    model: Literal["scpi", "manual"] = "scpi"
    """Of real lamps: a supply that obeys SCPI, or a person who switches them."""
    address: str = ""
    """VISA resource name, such as "ASRL/dev/ttyUSB0::INSTR"."""
    panels: int = Field(default=1, ge=1)
    """Channel of the panels."""
    beam: int = Field(default=2, ge=1)
    """Channel of the beam."""
    settle_s: float = Field(default=0.5, ge=0)
    """Time [s] after a change until the light is steady."""


class StageEntry(DeviceEntry):
    """What moves the backgrounds."""

    model: Literal["slider", "manual"] = "manual"
    """Of a real stage: a slider under Grbl, or a person."""
    address: str = ""
    """Serial port of the slider."""
    out_mm: float = 0.0
    black_mm: float = 40.0
    white_mm: float = 80.0


class BenchFile(Part):
    """One bench: devices, what they look at, and what is captured."""

    kind: Seam | None = None
    """Of every device whose own table does not say it: "virtual", "wire" or "real"."""
    scenario: str = "default"
    """Built-in scenario, or path of a file: bench, samples and wavelengths; of virtual and wire
    devices also the light."""
    quick: bool = False
    """Fewer light paths for virtual and wire devices."""
    seed: int | None = None
    """Seed of virtual and wire devices; None takes the scenario's."""
    bench: Bench | None = None
    """Description of a real bench, in place of the scenario's."""
    samples: tuple[Sample, ...] | None = None
    """Samples on a real bench, in place of the scenario's."""
    range_nm: tuple[float, float] | None = None
    """Only these wavelengths [nm] enter the measurement."""
    calibration: str = ""
    """File that `benchtwin calibrate` wrote, beside this file: the sensor must be that one."""
    sensor: SensorEntry = SensorEntry()
    lights: LightsEntry = LightsEntry()
    stage: StageEntry = StageEntry()
    plan: PlanSettings = PlanSettings()

    @model_validator(mode="before")
    @classmethod
    def _one_line(cls, data: Any) -> Any:
        """`kind` of the file is that of its devices, so that one line changes the seam."""
        if not isinstance(data, dict) or data.get("kind") not in get_args(Seam):
            return data
        filled = dict(data)
        for name in ("sensor", "lights", "stage"):
            entry = data.get(name, {})
            if isinstance(entry, dict):
                filled[name] = {"kind": data["kind"]} | entry
        return filled

    @model_validator(mode="after")
    def _check(self) -> BenchFile:
        kinds = {self.sensor.kind, self.lights.kind, self.stage.kind}
        if "real" in kinds and len(kinds) > 1:
            raise ValueError(
                f"found the kinds {', '.join(sorted(kinds))}; expected all devices real, or all of"
                " them virtual or wire: the light of the twin does not reach a real sensor"
            )
        if self.sensor.kind != "virtual" and self.sensor.model == "scenario":
            raise ValueError(
                f"found a sensor of kind {self.sensor.kind} without a model;"
                ' expected model = "ocean" or "as7341"'
            )
        registers = [key for key in CHIP_KEYS if key in self.plan.model_fields_set]
        if self.sensor.model == "ocean" and registers:
            raise ValueError(
                f"found {', '.join(registers)} in [plan] of a spectrometer; expected them for a"
                " chip only: a spectrometer has `exposure`"
            )
        if self.is_real:
            if self.lights.model == "scpi" and not self.lights.address:
                raise ValueError(
                    "found real lights without an address; expected a VISA resource name, or"
                    ' model = "manual"'
                )
            if self.stage.model == "slider" and not self.stage.address:
                raise ValueError("found a slider without an address; expected its serial port")
            if self.stage.model == "slider" and self.lights.address == self.stage.address:
                raise ValueError(
                    f"found the address {self.stage.address!r} for lights and stage;"
                    " expected each device on its own"
                )
        elif self.bench is not None or self.samples is not None:
            raise ValueError(
                "found bench or samples beside virtual devices; expected them in the scenario,"
                " whose light is computed from them"
            )
        if self.range_nm is not None and not self.range_nm[0] < self.range_nm[1]:
            raise ValueError(f"found range_nm {self.range_nm}; expected two that increase")
        return self

    @property
    def is_real(self) -> bool:
        """Whether the devices are real."""
        return self.sensor.kind == "real"


def load_bench_file(path: str | Path) -> BenchFile:
    """Read a BENCH.toml.

    Raises:
        InputError: no such file, or one that does not describe a bench.
    """
    path = Path(path)
    if path.is_dir():
        raise InputError("a folder", "the path of a bench file", file=path)
    return load_toml(path, BenchFile)
