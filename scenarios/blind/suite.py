"""What a sealed suite is: its materials, its arms, its bench."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.scenario import MapSettings, Scenario
from scenarios.stress.design import derived_seed
from twin.errors import InputError
from twin.spectra import FloatArray
from twin.toml import validate

if TYPE_CHECKING:
    from twin.appearance import AppearanceMap
    from twin.bench import Bench, Sample

ARMS = ("none", "single", "pair", "outside", "removed", "ambiguous")
"""Nothing wrong; one effect; two; one that no catalogue has; one whose entry is taken out of the
catalogue; one with a look-alike that these data cannot tell from it."""
LEVELS = (1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0, 30.0)
"""Standard deviations that an effect moves the data by once the material has followed."""
VISIBLE = 5.0
"""The least of the levels at which an effect must be named."""
FAMILIES = ("ink", "resin")
"""Of materials: the first for development, the second for the published run."""
SUITE, MEASUREMENTS, CLOSED, OUTCOMES = "suite.json", "measurements", "closed", "outcomes"
MEASUREMENT, SEAL, SALTS, OPENED = "measurement.nc", "seal.json", "salts.json", "opened.json"
OUTCOMES_FILE = "outcomes.json"
STRONGER = 4.0
"""By which the lamps drift more in every second measurement of the arm "none"."""
VERSION = "6"
"""Of what is made and how it is diagnosed; results of another are not used."""


@dataclass(frozen=True, kw_only=True)
class Suite:
    """A suite; the same suite gives the same measurements.

    Attributes:
        family: of materials, one of `FAMILIES`.
        seed: of everything that is drawn.
        materials: number of materials; each is measured once in every arm.
        first: number of the first material, so that a later suite can go on.
        arms: in which each material is measured.
        paths: light paths per wavelength of each of two independent runs.
        nominal_paths: the same for the undisturbed bench, whose light several arms share.
        step_nm: distance of the wavelengths from 400 to 700 nm.
        response_paths: of the responses that the diagnosis asks the Monte Carlo for.
        map_paths: of the appearance maps that the diagnosis uses.
    """

    family: str = "ink"
    seed: int = 1
    materials: int = 7
    first: int = 0
    arms: tuple[str, ...] = ARMS
    paths: int = 1 << 13
    nominal_paths: int = 1 << 13
    step_nm: float = 10.0
    response_paths: int = 8192
    map_paths: int = 1 << 13

    def __post_init__(self) -> None:
        """Refuse what cannot be made.

        Raises:
            InputError: an unknown family or arm, or numbers that cannot be.
        """
        object.__setattr__(self, "arms", tuple(self.arms))
        for found, known, place in (
            (self.family, FAMILIES, "family"),
            *((arm, ARMS, "arms") for arm in self.arms),
        ):
            if found not in known:
                raise InputError(f'"{found}"', f"one of {', '.join(known)}", place=place)
        if self.materials < 1 or self.seed < 0 or self.first < 0:
            raise InputError(
                f"{self.materials} materials from {self.first} on, seed {self.seed}",
                "one material or more, and a seed of 0 or more",
                place="suite",
            )
        if not 2.0 <= self.step_nm <= 50.0 or (300.0 / self.step_nm) % 1.0 > 1e-9:
            raise InputError(
                f"a step of {self.step_nm:g} nm",
                "one from 2 to 50 nm that divides 300 nm",
                place="step_nm",
            )

    @property
    def numbers(self) -> range:
        """Numbers of the materials."""
        return range(self.first, self.first + self.materials)

    def number(self, material: int, arm: str) -> int:
        """Number of a measurement, from 0."""
        return (material - self.first) * len(self.arms) + self.arms.index(arm)

    @property
    def pixels_nm(self) -> FloatArray:
        """Wavelengths of the instrument [nm], shape (W,)."""
        return np.asarray(400.0 + self.step_nm * np.arange(round(300.0 / self.step_nm) + 1))

    @property
    def point(self) -> dict[str, Any]:
        """The suite as JSON holds it, without how many materials it has."""
        fields = asdict(self)
        for name in ("materials", "first"):
            del fields[name]
        return {**fields, "arms": list(self.arms)}

    @property
    def text(self) -> str:
        """The suite as JSON."""
        return json.dumps({**asdict(self), "arms": list(self.arms)}, indent=1) + "\n"


def read_suite(folder: Path) -> Suite:
    """The suite of a folder.

    Raises:
        InputError: there is none, or a damaged one.
    """
    path = folder / SUITE
    try:
        return Suite(**json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError) as error:
        if isinstance(error, InputError):
            raise error.at(path) from error
        raise InputError(
            f"no suite ({error})",
            "the folder of a suite",
            file=path,
            remedy="Make one first: benchtwin blind make FOLDER.",
        ) from error


def stream(suite: Suite, material: int, purpose: int, part: int = 0) -> np.random.Generator:
    """Random numbers of one purpose of one material."""
    seed = derived_seed(suite.seed, material, purpose, part)
    return np.random.Generator(np.random.Philox(key=[seed, 0x626C696E64]))


def scenario_of(suite: Suite, medium: Mapping[str, Any], *, drift: float = 1.0) -> Scenario:
    """The visit as it is described, with the true material; lamps drift by that much more."""
    walk = {"lamp_walk": 4.7e-4 * drift, "lamp_tilt_walk": 1e-4 * drift}
    step = suite.step_nm
    # pixels lie on the wavelengths of the light: errors of neighbours are then independent
    margin = step * max(1, round(20.0 / step))
    samples = [
        {"name": f"{mm:g} mm", "thickness_mm": mm, "n": 1.5, "material": dict(medium)}
        for mm in (0.4, 0.8, 1.6)
    ]
    return validate(
        {
            "title": "A sealed measurement",
            "bench": {
                "instrument": {
                    "kind": "spectrometer", "start_nm": 400.0, "stop_nm": 700.0, "step_nm": step,
                    "bandwidth_nm": 2.0, **walk,
                }
            },
            "samples": samples,
            "wavelength": {"start_nm": 400.0 - margin, "stop_nm": 700.0 + margin, "step_nm": step},
        },
        Scenario,
    )  # fmt: skip


def maps_of(suite: Suite, bench: Bench, samples: Sequence[Sample]) -> tuple[AppearanceMap, ...]:
    """Appearance maps of the described bench, from the user's cache; the last ones are kept."""
    plain = tuple(sample.model_copy(update={"material": None}) for sample in samples)
    return _maps(suite.map_paths, tuple(suite.pixels_nm), bench, plain)


@lru_cache(maxsize=2)
def _maps(
    paths: int, pixels_nm: tuple[float, ...], bench: Bench, samples: tuple[Sample, ...]
) -> tuple[AppearanceMap, ...]:
    from scenarios.console import Console
    from scenarios.maps import appearance_maps

    settings = MapSettings(
        albedo_count=30, sigma_t_count=30, sigma_t_range_per_mm=(0.3, 20.0), g_count=6, paths=paths,
    )  # fmt: skip
    return appearance_maps(
        bench, samples, np.array(pixels_nm), settings, cache=None, threads=None,
        console=Console(quiet=True),
    )  # fmt: skip
