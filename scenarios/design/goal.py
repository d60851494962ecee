"""GOAL.toml: what a set-up must reach, for which materials, with which parts and how much money."""

from __future__ import annotations

import math
from importlib import resources
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from scenarios.design.media import MaterialOfInterest, Medium
from scenarios.design.parts import Parts, load_parts
from scenarios.scenario import WavelengthGrid
from twin.errors import InputError
from twin.spectra import FloatArray, Part
from twin.toml import near_misses, parse_table, read_text, validate

TRANSLUCENT = ("albedo", "sigma_t_relative", "g", "de2000")
FLUORESCENT = ("fluorescence_rmse", "fluorescence_de2000")
Search = Literal["auto", "exhaustive", "greedy", "bayes"]


class Targets(Part):
    """Largest standard uncertainties that are good enough; at least one."""

    albedo: float | None = Field(default=None, gt=0)
    sigma_t_relative: float | None = Field(default=None, gt=0)
    g: float | None = Field(default=None, gt=0)
    de2000: float | None = Field(default=None, gt=0)
    """CIEDE2000 of a slab 5 mm thick over black, predicted from the estimate."""
    fluorescence_rmse: float | None = Field(default=None, gt=0)
    """Root mean square error of the strictly lower cells of a Donaldson matrix."""
    fluorescence_de2000: float | None = Field(default=None, gt=0)
    """CIEDE2000 under monochromatic light."""

    @model_validator(mode="after")
    def _some(self) -> Targets:
        if not self.names:
            raise ValueError("found no target; expected one or more")
        translucent = [name for name in self.names if name in TRANSLUCENT]
        if translucent and len(translucent) < len(self.names):
            raise ValueError(
                "found targets of translucent and of fluorescent materials; expected one kind"
            )
        return self

    @property
    def names(self) -> tuple[str, ...]:
        """Of the targets that are set."""
        return tuple(n for n in (*TRANSLUCENT, *FLUORESCENT) if getattr(self, n) is not None)

    @property
    def values(self) -> FloatArray:
        """Of the targets that are set, shape (T,)."""
        return np.array([getattr(self, name) for name in self.names])

    @property
    def fluorescent(self) -> bool:
        """Whether they are of fluorescent materials."""
        return self.names[0] in FLUORESCENT


class ProtocolRanges(Part):
    """What a protocol may be: every value in its list is tried."""

    thickness_mm: tuple[float, ...] = (0.3, 0.6, 1.2, 2.4)
    """Thicknesses [mm] from which the samples are chosen."""
    samples: tuple[int, ...] = (2, 3)
    """Numbers of samples."""
    averages: tuple[int, ...] = (10,)
    """Frames in a shot."""
    repeats: tuple[int, ...] = (3,)
    """Shots of every capture and every reference."""
    acceptance_deg: tuple[float, ...] = (1.0,)
    """Half-angles [deg] of the view: the aperture."""
    polar_deg: tuple[float, ...] = (45.0,)
    """Angles [deg] of the panels."""
    leds: tuple[int, ...] = (8,)
    """Fluorescent materials: numbers of illuminants that are lit."""

    @field_validator("*")
    @classmethod
    def _listed(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if not value or len(set(value)) < len(value) or min(value) <= 0:
            raise ValueError(f"found {value}; expected different numbers above 0, one or more")
        return tuple(sorted(value))

    @model_validator(mode="after")
    def _enough(self) -> ProtocolRanges:
        if max(self.samples) > len(self.thickness_mm):
            raise ValueError(
                f"found {max(self.samples)} samples of {len(self.thickness_mm)} thicknesses;"
                " expected a thickness for each"
            )
        return self


class Verification(Part):
    """How the leading candidates are simulated."""

    candidates: int = Field(default=4, ge=0, le=200)
    """How many; 0: none."""
    seeds: int = Field(default=32, ge=4, le=1000)
    """Visits of each, each with errors of its own."""
    paths: int = Field(default=1 << 15, ge=64, le=1 << 24)
    """Light paths per wavelength and sample."""
    map_paths: int = Field(default=4096, ge=64, le=1 << 20)


class Goal(Part):
    """A design study."""

    title: str = Field(min_length=1)
    materials: tuple[MaterialOfInterest, ...]
    targets: Targets
    budget_usd: float = Field(default=math.inf, ge=0, allow_inf_nan=True)
    parts: str = ""
    """A TOML file with parts of your own, beside this one."""
    allowed: tuple[str, ...] = ()
    """Names of the parts that may be bought; none: all."""
    compare: tuple[str, ...] = ()
    """Assemblies that are shown beside what is found."""
    protocol: ProtocolRanges = ProtocolRanges()
    wavelength: WavelengthGrid = WavelengthGrid(start_nm=420.0, stop_nm=680.0, step_nm=20.0)
    """Where a spectrometer is judged; a chip is at its channels inside this range."""
    search: Search = "auto"
    trials: int = Field(default=1000, ge=10, le=1_000_000)
    """Candidates that the Bayesian search looks at."""
    seed: int = Field(default=1, ge=0, lt=1 << 63)
    quick: bool = False
    """A coarse look: fewer candidates verified by fewer paths."""
    verification: Verification = Verification()

    @field_validator("materials")
    @classmethod
    def _named(cls, value: tuple[MaterialOfInterest, ...]) -> tuple[MaterialOfInterest, ...]:
        if not value:
            raise ValueError("found no material; expected one or more")
        return value

    @property
    def media(self) -> tuple[Medium, ...]:
        """All materials."""
        return tuple(medium for each in self.materials for medium in each.media())

    def settled(self) -> Goal:
        """With `quick` said in numbers."""
        if not self.quick:
            return self
        few = {"candidates": min(2, self.verification.candidates), "paths": 4096, "map_paths": 1024,
               "seeds": min(16, self.verification.seeds)}  # fmt: skip
        return self.model_copy(update={"verification": self.verification.model_copy(update=few)})


def builtin_goals() -> tuple[str, ...]:
    """Names of the goals that come with the program."""
    files = resources.files("scenarios.design").joinpath("builtin").iterdir()
    names = (file.name[:-5] for file in files if file.name.startswith("goal-"))
    return tuple(sorted(name.removeprefix("goal-") for name in names))


def load_goal(name_or_path: str | Path, *, quick: bool = False) -> tuple[Goal, Parts]:
    """Read a goal and the parts that it may use.

    Args:
        name_or_path: a goal that comes with the program, or the path of a TOML file.
        quick: as the goal's own `quick`.

    Raises:
        InputError: no such goal, one that does not fit, an unknown part or material, a part
            without a price, or a budget of zero.
    """
    name = str(name_or_path)
    path = Path(name_or_path)
    if name in builtin_goals():
        source = (
            resources.files("scenarios.design").joinpath("builtin").joinpath(f"goal-{name}.toml")
        )
        text, file, folder = source.read_text("utf-8"), f"built-in goal {name}", None
    elif path.suffix != ".toml" and len(path.parts) == 1 and not path.exists():
        raise InputError(
            f"the goal {name!r}",
            f"one of {', '.join(builtin_goals())}, or the path of a .toml file",
            remedy=near_misses(name, builtin_goals()),
        )
    else:
        text, file, folder = read_text(path), str(path), path.parent
    goal = validate(parse_table(text, file=file), Goal, file=file)
    if quick:
        goal = goal.model_copy(update={"quick": True})
    if goal.budget_usd == 0:
        raise InputError(
            "a budget of 0 USD", "a budget above 0, or none", file=file, place="budget_usd",
            remedy="Parts cost money: leave budget_usd out to see what each dollar buys.",
        )  # fmt: skip
    if goal.parts and folder is None:
        raise InputError(repr(goal.parts), "no parts of one's own here", file=file, place="parts")
    parts = load_parts(folder / goal.parts if goal.parts and folder is not None else None)
    try:
        parts.allowed(goal.allowed)
        for each in goal.compare:
            parts.assembly(each)
        for number, medium in enumerate(goal.media):
            if not goal.targets.fluorescent:
                _known(medium, goal, number)
    except InputError as error:
        raise (error if error.file else error.at(file)) from error
    return goal.settled(), parts


def _known(medium: Medium, goal: Goal, number: int) -> None:
    from twin.materials import refractive_index

    wavelength = goal.wavelength.wavelength_nm
    try:
        medium.at(wavelength)
        refractive_index(medium.n, wavelength)
    except InputError as error:
        raise error.at(error.file, f"materials[{number}]") from error
