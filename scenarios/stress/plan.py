"""A stress plan: what is tried on which points, said completely in one TOML file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import (
    Field,
    SerializerFunctionWrapHandler,
    field_validator,
    model_serializer,
    model_validator,
)

from scenarios.scenario import QUICK_MAP, EstimatorChoice, MapSettings, Protocol
from twin.bench import Bench
from twin.errors import InputError
from twin.spectra import Part
from twin.toml import load_toml, near_misses, parse_table, read_text, validate

QUICK_POINTS = 64
QUICK_LIGHT = {"relative_error": 0.003, "most_paths": 1 << 17}
"""What --quick changes in the simulated light."""


NONE = "none"
"""Name of the case without effects, which every plan has."""
EffectValues = float | dict[str, float]
"""Value of an effect with one parameter, or values by parameter."""


class Contender(EstimatorChoice):
    """One estimator of the test: its name in the registry, with options."""

    label: str = ""
    """What tables call it; "" takes the name. Two entries of one name need labels."""

    @property
    def title(self) -> str:
        """What tables call it."""
        return self.label or self.name


class Materials(Part):
    """Ranges of the design: each is covered evenly in a scale on which the bench sees steps."""

    albedo: tuple[float, float] = (0.1, 0.999)
    """Least and greatest single-scattering albedo; even in log(1 - albedo)."""
    sigma_t_per_mm: tuple[float, float] = (0.3, 15.0)
    """Least and greatest extinction coefficient [1/mm]; even in its logarithm."""
    g: tuple[float, float] = (0.0, 0.9)
    """Least and greatest anisotropy factor; even in -log(1 - g)."""
    grid: tuple[int, int, int] | None = None
    """Numbers of albedos, extinction coefficients and g of a grid; None: a random design."""
    spectra: bool = False
    """Whether the points of a visit are one smooth spectrum, as those of a real material are
    (`scenarios.stress.spectra`), measured in one visit whose lamps drift for all wavelengths
    together; else every wavelength carries a material of its own."""

    @field_validator("albedo")
    @classmethod
    def _albedo(cls, value: tuple[float, float]) -> tuple[float, float]:
        if not 0 <= value[0] < value[1] < 1:
            raise ValueError(f"found {value}; expected two albedos from 0 to below 1 that increase")
        return value

    @field_validator("sigma_t_per_mm")
    @classmethod
    def _sigma_t(cls, value: tuple[float, float]) -> tuple[float, float]:
        if not 0 < value[0] < value[1]:
            raise ValueError(f"found {value}; expected two coefficients above 0 that increase")
        return value

    @field_validator("g")
    @classmethod
    def _g(cls, value: tuple[float, float]) -> tuple[float, float]:
        if not -1 < value[0] < value[1] < 1:
            raise ValueError(f"found {value}; expected two numbers inside -1 to 1 that increase")
        return value

    @field_validator("grid")
    @classmethod
    def _grid(cls, value: tuple[int, int, int] | None) -> tuple[int, int, int] | None:
        if value is not None and (min(value) < 1 or value[0] * value[1] * value[2] < 2):
            raise ValueError(f"found a grid {value}; expected counts from 1, two points or more")
        return value

    @model_validator(mode="after")
    def _one_design(self) -> Materials:
        if self.spectra and self.grid is not None:
            raise ValueError("found a grid of spectra; expected either a grid or spectra")
        return self


class Light(Part):
    """How exactly the Monte Carlo computes the light of every point."""

    relative_error: float = Field(default=7e-4, gt=0, lt=1)
    """Relative standard error that black and white shall reach (root mean square over the albedos
    of one medium), unless `most_paths` stops it; it belongs well below the noise."""
    most_paths: int = Field(default=1 << 20, ge=1 << 12, le=1 << 26)
    """Most light paths for one pair of extinction coefficient and g."""


class StressPlan(Part):
    """What is tried (estimators) on which points (materials, benches, noise levels)."""

    title: str = Field(min_length=1)
    estimators: tuple[Contender, ...] = (Contender(name="lut"),)
    seed: int = Field(default=1, ge=0, lt=1 << 63)
    points: int = Field(default=256, ge=2, le=1_000_000)
    """Materials of a random design; a grid has as many as its counts say."""
    materials: Materials = Materials()
    albedos_per_medium: int = Field(default=8, ge=1, le=1000)
    """Albedos of a random design that share one pair of extinction coefficient and g: one set of
    light paths serves them all."""
    n: float = Field(default=1.5, ge=1, le=4)
    """Refractive index of the samples."""
    thickness_mm: tuple[float, ...] = (0.4, 0.8)
    """Thicknesses [mm] of the samples of every material."""
    noise: tuple[float, ...] = (1.0,)
    """Noise levels: multiples of the standard deviations of the bench's instrument and lamps."""
    benches: dict[str, Bench] = Field(default_factory=lambda: {"bench": Bench()})
    """Benches by name: tables, or paths of bench.toml files; every point is tried on each."""
    effects: dict[str, dict[str, EffectValues]] = Field(default_factory=dict)
    """What is true and not told to the estimators, by a name of your own: effects of
    `twin.effects` at one place each, such as "thickness[0.4 mm]", with their values. Every point is
    tried with each entry, and without any."""
    protocol: Protocol = Protocol()
    points_per_visit: int = Field(default=64, ge=2, le=1000)
    """Wavelengths of one simulated visit: each carries another material, or a point of the visit's
    spectrum."""
    light: Light = Light()
    map: MapSettings = MapSettings()

    @field_validator("estimators")
    @classmethod
    def _titles(cls, value: tuple[Contender, ...]) -> tuple[Contender, ...]:
        if not value:
            raise ValueError("found no estimator; expected one or more")
        titles = [each.title for each in value]
        twice = sorted({title for title in titles if titles.count(title) > 1})
        if twice:
            raise ValueError(f"found {twice[0]!r} twice; expected a label of its own for each")
        return value

    @field_validator("thickness_mm")
    @classmethod
    def _thicknesses(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if not 1 <= len(value) <= 20 or min(value) <= 0 or len(set(value)) < len(value):
            raise ValueError(f"found {value}; expected 1 to 20 different lengths above 0 mm")
        return value

    @field_validator("noise")
    @classmethod
    def _levels(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if not value or min(value) < 0.01 or max(value) > 100 or len(set(value)) < len(value):
            raise ValueError(f"found {value}; expected different factors from 0.01 to 100")
        return value

    @field_validator("effects")
    @classmethod
    def _entries(
        cls, value: dict[str, dict[str, EffectValues]]
    ) -> dict[str, dict[str, EffectValues]]:
        for name, entry in value.items():
            if name in ("", NONE):
                raise ValueError(
                    f"found an entry called {name!r}; expected another name: the case without"
                    " effects is always there"
                )
            if not entry:
                raise ValueError(f"found nothing in {name!r}; expected one effect or more")
        return value

    @model_serializer(mode="wrap")
    def _plain(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """A plan without effects is stored as it was before there were any."""
        data: dict[str, Any] = handler(self)
        if not data.get("effects", True):
            del data["effects"]
        return data

    @model_validator(mode="after")
    def _spectrometers(self) -> StressPlan:
        if not self.benches:
            raise ValueError("found no bench; expected one or more")
        for name, bench in self.benches.items():
            if bench.instrument.kind != "spectrometer":
                raise ValueError(
                    f"found a {bench.instrument.kind} on the bench {name!r}; expected a"
                    " spectrometer: a channel that sees many wavelengths cannot carry one material"
                )
        return self

    def settled(
        self,
        *,
        seed: int | None = None,
        points: int | None = None,
        estimators: Sequence[str] = (),
        quick: bool = False,
    ) -> StressPlan:
        """The same plan with nothing left to decide: what is stored beside every result.

        Args:
            seed: replaces the plan's; None keeps it.
            points: replaces the plan's number; None keeps it.
            estimators: names that replace the plan's; one that the plan has keeps its options.
            quick: at most 64 points, coarse light and a coarse map.

        Raises:
            InputError: a value out of range, or a number of points for a grid.
        """
        data = self.model_dump(mode="python")
        if points is not None and self.materials.grid is not None:
            raise InputError(
                f"{points} points for a grid of {' x '.join(map(str, self.materials.grid))}",
                "a number of points for a random design only",
                place="points",
            )
        if quick:
            data["points"] = min(self.points, QUICK_POINTS)
            data["light"] |= QUICK_LIGHT
            data["map"] |= QUICK_MAP
        if seed is not None:
            data["seed"] = seed
        if points is not None:
            data["points"] = points
        if estimators:
            known = {each.title: each.model_dump() for each in reversed(self.estimators)}
            data["estimators"] = tuple(known.get(name, {"name": name}) for name in estimators)
        return validate(data, StressPlan)


def builtin_plans() -> tuple[str, ...]:
    """Names of the built-in plans, the default first."""
    files = resources.files("scenarios.stress").joinpath("plans").iterdir()
    names = sorted(file.name[:-5] for file in files if file.name.endswith(".toml"))
    return ("default", *(name for name in names if name != "default"))


def load_plan(name_or_path: str | Path) -> StressPlan:
    """Read a plan: a built-in one by name, any other by the path of its TOML file.

    Raises:
        InputError: no such plan, or a file that does not describe one; an effect that no visit
            can hold.
    """
    name = str(name_or_path)
    known = builtin_plans()
    if name in known:
        source = resources.files("scenarios.stress").joinpath("plans", f"{name}.toml")
        return _plan(source.read_text(encoding="utf-8"), f"built-in plan {name}", None)
    path = Path(name_or_path)
    if path.suffix != ".toml" and len(path.parts) == 1 and not path.exists():
        raise InputError(
            f"the plan {name!r}",
            f"a built-in plan ({', '.join(known)}) or the path of a .toml file",
            remedy=near_misses(name, known),
        )
    return _plan(read_text(path), path, path.parent)


def _plan(text: str, file: object, folder: Path | None) -> StressPlan:
    from scenarios.stress.effects import check_effects

    data = parse_table(text, file=file)
    benches = data.get("benches")
    if isinstance(benches, dict):
        data["benches"] = {
            name: _bench(entry, f"benches.{name}", file, folder) for name, entry in benches.items()
        }
    estimators = data.get("estimators")
    if isinstance(estimators, list):
        data["estimators"] = [
            {"name": entry} if isinstance(entry, str) else entry for entry in estimators
        ]
    plan = validate(data, StressPlan, file=file)
    check_effects(plan, file)
    return plan


def _bench(entry: Any, place: str, file: object, folder: Path | None) -> Any:
    if isinstance(entry, str):
        if folder is None:
            raise InputError(repr(entry), "a table", file=file, place=place)
        return load_toml(folder / entry, Bench).model_dump(mode="python")
    if isinstance(entry, Mapping) and isinstance(entry.get("instrument"), dict):
        entry["instrument"].setdefault("kind", "spectrometer")
    return entry
