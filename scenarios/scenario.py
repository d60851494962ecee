"""A scenario: one visit to the bench, said completely in one TOML file."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from scenarios.outputs import canonical_json
from twin.bench import Bench, Sample
from twin.errors import InputError
from twin.spectra import FloatArray, Part
from twin.toml import load_toml, near_misses, parse_table, read_text, validate

MAX_WAVELENGTHS = 2000
QUICK_MAP = {"albedo_count": 24, "sigma_t_count": 60, "g_count": 5, "paths": 1024}
"""What --quick changes in the appearance map."""


class WavelengthGrid(Part):
    """Equidistant wavelengths at which light transport is computed."""

    start_nm: float = Field(default=400.0, gt=0)
    stop_nm: float = Field(default=720.0, gt=0)
    """Last wavelength [nm], part of the grid."""
    step_nm: float = Field(default=10.0, gt=0)

    @model_validator(mode="after")
    def _check(self) -> WavelengthGrid:
        if self.stop_nm <= self.start_nm:
            raise ValueError(
                f"found stop_nm {self.stop_nm:g} after start_nm {self.start_nm:g};"
                " expected a grid that increases"
            )
        steps = (self.stop_nm - self.start_nm) / self.step_nm
        if not math.isclose(steps, round(steps), abs_tol=1e-6):
            raise ValueError(
                f"found {self.start_nm:g} to {self.stop_nm:g} nm in steps of {self.step_nm:g} nm;"
                " expected a whole number of steps"
            )
        if not 1 <= round(steps) < MAX_WAVELENGTHS:
            raise ValueError(
                f"found {round(steps) + 1} wavelengths; expected 2 to {MAX_WAVELENGTHS}"
            )
        return self

    @property
    def wavelength_nm(self) -> FloatArray:
        """The wavelengths [nm], shape (W,)."""
        steps = round((self.stop_nm - self.start_nm) / self.step_nm)
        return self.start_nm + self.step_nm * np.arange(steps + 1, dtype=np.float64)


class Protocol(Part):
    """What is captured, in which order, how often, how long."""

    repeats: int = Field(default=3, ge=1, le=1000)
    """How often each capture of a sample is taken."""
    reference_repeats: int = Field(default=3, ge=1, le=1000)
    """How often each reference is taken each time."""
    references: Literal["first", "first_and_last"] = "first_and_last"
    """References before each sample, or before and after it (then lamp drift averages out)."""
    order: tuple[Literal["black", "white", "collimated"], ...] = ("black", "white", "collimated")
    """Captures of a sample in the order in which they are taken, each with its repeats."""
    exposure: float | Literal["auto"] = "auto"
    """Integration time [s] of every capture; "auto": the brightest capture of each light fills
    `fill` of the range."""
    fill: float = Field(default=0.8, gt=0, lt=1)
    """Share of full scale that the automatic exposure aims at."""
    collimated_longest_s: float = Field(default=10.0, gt=0)
    """With automatic exposure the collimated capture may take longer than the beam reference, up
    to this time [s]: little light is left of the beam. A short time here switches that off."""
    pause_s: float = Field(default=5.0, ge=0)
    """Time [s] between two captures, to slide the holder."""

    @field_validator("exposure")
    @classmethod
    def _positive(cls, value: float | str) -> float | str:
        if not isinstance(value, str) and value <= 0:
            raise ValueError(f'found {value:g}; expected seconds above 0, or "auto"')
        return value

    @field_validator("order")
    @classmethod
    def _each_once(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        if sorted(value) != ["black", "collimated", "white"]:
            raise ValueError(
                f"found {', '.join(value)}; expected black, white and collimated, each once"
            )
        return value


class Simulation(Part):
    """Size and seed of the Monte Carlo simulation."""

    paths: int = Field(default=1 << 15, ge=64, le=1 << 26)
    """Light paths per wavelength and capture."""
    quick_paths: int = Field(default=1 << 12, ge=64, le=1 << 26)
    """The same with --quick."""
    seed: int = Field(default=1, ge=0, lt=1 << 63)


class MapSettings(Part):
    """The appearance map that the estimate reads: its grid and how many light paths it takes."""

    albedo_count: int = Field(default=40, ge=2, le=400)
    albedo_top: float = Field(default=0.9999, gt=0, lt=1)
    """Greatest albedo; the steps shrink towards it, the least is 0."""
    sigma_t_count: int = Field(default=60, ge=2, le=400)
    sigma_t_range_per_mm: tuple[float, float] = (0.1, 30.0)
    """Least and greatest extinction coefficient [1/mm]; spaced evenly in its logarithm."""
    g_count: int = Field(default=8, ge=2, le=100)
    g_range: tuple[float, float] = (0.0, 0.95)
    paths: int = Field(default=1 << 13, ge=64, le=1 << 26)
    """Light paths for each pair of extinction coefficient and g."""

    @field_validator("sigma_t_range_per_mm")
    @classmethod
    def _sigma_t(cls, value: tuple[float, float]) -> tuple[float, float]:
        if not 0 < value[0] < value[1]:
            raise ValueError(f"found {value}; expected two coefficients above 0 that increase")
        return value

    @field_validator("g_range")
    @classmethod
    def _g(cls, value: tuple[float, float]) -> tuple[float, float]:
        if not -1 < value[0] < value[1] < 1:
            raise ValueError(f"found {value}; expected two numbers between -1 and 1 that increase")
        return value


class EstimatorChoice(Part):
    """Which estimator runs, and its options."""

    name: str = "lut"
    options: dict[str, float | int | str | bool] = Field(default_factory=dict)


class Scenario(Part):
    """One visit to the bench: the bench, the samples of one material, and what is done."""

    title: str = Field(min_length=1)
    bench: Bench = Bench()
    """A table, or the path of a bench.toml beside the scenario; what is not said is the default."""
    samples: tuple[Sample, ...]
    wavelength: WavelengthGrid = WavelengthGrid()
    protocol: Protocol = Protocol()
    simulation: Simulation = Simulation()
    map: MapSettings = MapSettings()
    estimator: EstimatorChoice = EstimatorChoice()

    @field_validator("samples")
    @classmethod
    def _samples(cls, value: tuple[Sample, ...]) -> tuple[Sample, ...]:
        if not 1 <= len(value) <= 20:
            raise ValueError(f"found {len(value)} samples; expected 1 to 20")
        names = [sample.name for sample in value]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"found the sample name {twice[0]!r} twice; expected each name once")
        for sample in value:
            if sample.material is None:
                raise ValueError(
                    f"found no material for the sample {sample.name!r}; expected the name of a"
                    " library material or a table with albedo, sigma_t_per_mm and g"
                )
            if sample.material != value[0].material or sample.n != value[0].n:
                raise ValueError(
                    f"found another material or n for the sample {sample.name!r} than for"
                    f" {value[0].name!r}; expected samples of one material that differ in thickness"
                )
        return value

    @property
    def text(self) -> str:
        """The scenario as one line of JSON, as `provenance.scenario` of a measurement keeps it."""
        return canonical_json(self.model_dump(mode="json"), indent=None)

    def settled(
        self, *, seed: int | None = None, paths: int | None = None, quick: bool = False
    ) -> Scenario:
        """The same scenario with nothing left to decide: what is stored beside every result.

        Args:
            seed: replaces the scenario's; None keeps it.
            paths: replaces the scenario's number of paths; None keeps it.
            quick: the scenario's quick number of paths and a coarse map.

        Raises:
            InputError: a seed or number of paths out of range.
        """
        data = self.model_dump(mode="python")
        simulation = data["simulation"]
        if quick:
            simulation["paths"] = simulation["quick_paths"]
            data["map"] |= QUICK_MAP
        simulation |= {
            key: value for key, value in (("seed", seed), ("paths", paths)) if value is not None
        }
        return validate(data, Scenario)


def builtin_names() -> tuple[str, ...]:
    """Names of the built-in scenarios, the default first."""
    files = resources.files("scenarios").joinpath("builtin").iterdir()
    names = sorted(file.name[:-5] for file in files if file.name.endswith(".toml"))
    return ("default", *(name for name in names if name != "default"))


def scenario_name(name_or_path: str) -> str:
    """A short name for a scenario: its built-in name, or the file's stem."""
    return name_or_path if name_or_path in builtin_names() else Path(name_or_path).stem


def load_scenario(name_or_path: str | Path) -> Scenario:
    """Read a scenario: a built-in one by name, any other by the path of its TOML file.

    The `scenario.json` of an output folder is one too: it repeats that run.

    Raises:
        InputError: no such scenario, or a file that does not describe one.
    """
    name = str(name_or_path)
    if name in builtin_names():
        source = resources.files("scenarios").joinpath("builtin", f"{name}.toml")
        return _scenario(source.read_text(encoding="utf-8"), f"built-in scenario {name}", None)
    path = Path(name_or_path)
    if path.suffix not in (".toml", ".json") and len(path.parts) == 1 and not path.exists():
        known = builtin_names()
        raise InputError(
            f"the scenario {name!r}",
            f"a built-in scenario ({', '.join(known)}) or the path of a .toml file",
            remedy=near_misses(name, known),
        )
    return _scenario(read_text(path), path, path.parent)


def _scenario(text: str, file: object, folder: Path | None) -> Scenario:
    data = _parsed_json(text, file) if str(file).endswith(".json") else parse_table(text, file=file)
    bench = data.get("bench")
    if isinstance(bench, str):
        if folder is None:
            raise InputError(repr(bench), "a table", file=file, place="bench")
        data["bench"] = load_toml(folder / bench, Bench).model_dump(mode="python")
    elif isinstance(bench, dict) and isinstance(bench.get("instrument"), dict):
        bench["instrument"].setdefault("kind", "spectrometer")
    scenario = validate(data, Scenario, file=file)
    try:
        check_spectra(scenario)
    except InputError as error:
        raise (error if error.file else error.at(file)) from error
    return scenario


def _parsed_json(text: str, file: object) -> dict[str, Any]:
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"a mistake: {error}", "JSON", file=file) from error
    if not isinstance(data, dict):
        raise InputError(f"a {type(data).__name__}", "an object", file=file)
    return data


def check_spectra(scenario: Scenario) -> None:
    """Look up every spectrum of a scenario at all its wavelengths, before any work starts.

    Raises:
        InputError: an unknown name, a spectrum that does not cover the wavelengths, or a value
            that cannot be (an albedo above 1, a negative extinction coefficient).
    """
    from twin.materials import lamp, optical_properties, reflectance, refractive_index

    wavelength = scenario.wavelength.wavelength_nm
    bench = scenario.bench
    layers = [("covers_above", bench.covers_above), ("covers_below", bench.covers_below)]
    checks: list[tuple[str, Callable[..., Any], Any]] = [
        ("bench.panel_spectrum", lamp, bench.panel_spectrum),
        ("bench.beam.spectrum", lamp, bench.beam.spectrum),
        ("bench.background.black.reflectance", reflectance, bench.background.black.reflectance),
        ("bench.background.white.reflectance", reflectance, bench.background.white.reflectance),
    ]
    for name, stack in layers:
        for number, layer in enumerate(stack):
            checks.append((f"bench.{name}[{number}].n", refractive_index, layer.n))
            if layer.medium is not None:
                place = f"bench.{name}[{number}].medium"
                checks.append((place, optical_properties, layer.medium))
    for number, sample in enumerate(scenario.samples):
        checks.append((f"samples[{number}].n", refractive_index, sample.n))
        checks.append((f"samples[{number}].material", optical_properties, sample.material))
    for place, look_up, value in checks:
        try:
            look_up(value, wavelength)
        except InputError as error:
            raise InputError(
                error.found, error.expected, file=error.file,
                place=".".join(part for part in (place, error.place) if part),
                remedy=error.remedy,
            ) from error  # fmt: skip
