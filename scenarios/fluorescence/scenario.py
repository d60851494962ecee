"""A fluorescence scenario: one visit to the fluorescence bench, said in one TOML file."""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import Field, model_validator

from scenarios.outputs import canonical_json
from twin.errors import InputError
from twin.fluorescence import (
    MATERIALS,
    DonaldsonMatrix,
    FluorescenceProtocol,
    FluorescenceSetup,
    MixtureModel,
    dyed,
    example,
    from_mixture,
    read_bfc,
    read_matrix_csv,
    read_mixture,
)
from twin.spectra import FloatArray, Part
from twin.toml import near_misses, parse_table, read_text, validate

FILES = (".bfc", ".csv", ".json")
"""Endings of files that hold a Donaldson matrix."""


class Dyed(Part):
    """A diffuse base with dyes of the library in it."""

    base: float = Field(default=0.85, ge=0, le=1)
    """Reflectance of the base."""
    fluorophores: dict[str, float] = Field(default_factory=dict)
    """Share of the light absorbed at the excitation peak, by the dye's name."""


class FluorescenceScenario(Part):
    """One visit to the fluorescence bench: the set-up, the sample, and what is captured."""

    title: str = Field(min_length=1)
    setup: FluorescenceSetup
    material: str | Dyed | MixtureModel = "yellow_highlighter"
    """The sample: an example of the library, a file (.BFC, .csv, .json), dyes in a base, or a
    mixture of Gaussians with the moments of its diagonal."""
    add: tuple[str, ...] = ()
    """Materials or files whose fluorescence alone is added: a second fluorophore on top."""
    protocol: FluorescenceProtocol = FluorescenceProtocol()
    seed: int = Field(default=1, ge=0, lt=1 << 63)
    folder: str = ""
    """Where the files of `material` and `add` are; set from the place of the scenario's file."""

    @model_validator(mode="after")
    def _known(self) -> FluorescenceScenario:
        for name in (self.material, *self.add):
            if isinstance(name, str) and name not in MATERIALS and not _is_file(name):
                raise ValueError(
                    f"found the material {name!r}; expected one of {', '.join(MATERIALS)}, or a"
                    f" file that ends with {', '.join(FILES)}"
                )
        return self

    @property
    def text(self) -> str:
        """The scenario as one line of JSON, as the provenance of a visit keeps it."""
        return canonical_json(self.model_dump(mode="json"), indent=None)

    def settled(
        self, *, seed: int | None = None, repeats: int | None = None
    ) -> FluorescenceScenario:
        """The same scenario with another seed or number of repeats.

        Raises:
            InputError: a number out of range.
        """
        data = self.model_dump(mode="python")
        if seed is not None:
            data["seed"] = seed
        if repeats is not None:
            data["protocol"] |= {"repeats": repeats, "white_repeats": repeats}
        return validate(data, FluorescenceScenario)


def builtin_names() -> tuple[str, ...]:
    """Names of the built-in fluorescence scenarios, the cheapest set-ups first as the seed has."""
    files = resources.files("scenarios.fluorescence").joinpath("builtin").iterdir()
    return tuple(sorted(file.name[:-5] for file in files if file.name.endswith(".toml")))


def is_fluorescence_scenario(name_or_path: str | Path) -> bool:
    """Whether a name or file is a fluorescence scenario rather than one of the translucent bench.

    A file is one when its `setup` is a table; a file that cannot be read is none.
    """
    name = str(name_or_path)
    if name in builtin_names():
        return True
    path = Path(name_or_path)
    if path.suffix not in (".toml", ".json") or not path.is_file():
        return False
    try:
        return isinstance(_table(path).get("setup"), dict)
    except InputError:
        return False


def load_scenario(name_or_path: str | Path) -> FluorescenceScenario:
    """Read a fluorescence scenario: a built-in one by name, any other by the path of its file.

    Raises:
        InputError: no such scenario, or a file that does not describe one.
    """
    name = str(name_or_path)
    known = builtin_names()
    if name in known:
        source = resources.files("scenarios.fluorescence").joinpath("builtin", f"{name}.toml")
        file = f"built-in scenario {name}"
        data = parse_table(source.read_text(encoding="utf-8"), file=file)
        return validate(data, FluorescenceScenario, file=file)
    path = Path(name_or_path)
    if path.suffix not in (".toml", ".json") and len(path.parts) == 1 and not path.exists():
        raise InputError(
            f"the fluorescence scenario {name!r}",
            f"a built-in one ({', '.join(known)}) or the path of a .toml file",
            remedy=near_misses(name, known),
        )
    data = _table(path)
    data.setdefault("folder", str(path.parent))
    return validate(data, FluorescenceScenario, file=path)


def material_of(scenario: FluorescenceScenario) -> DonaldsonMatrix:
    """The Donaldson matrix of a scenario's sample on the wavelengths of its set-up.

    Raises:
        InputError: a file that is missing or wrong, a matrix without the wavelengths of the
            set-up.
    """
    emission, excitation = scenario.setup.emission_nm, scenario.setup.excitation_nm
    folder = Path(scenario.folder)
    value = scenario.material
    if isinstance(value, Dyed):
        found = dyed(value.base, value.fluorophores, emission_nm=emission, excitation_nm=excitation)
    elif isinstance(value, MixtureModel):
        found = from_mixture(value, emission_nm=emission, excitation_nm=excitation)
    else:
        found = _named(value, folder, emission, excitation)
    others = [_named(name, folder, emission, excitation) for name in scenario.add]
    return found.with_fluorescence_of(*others) if others else found


def _named(
    name: str, folder: Path, emission: FloatArray, excitation: FloatArray
) -> DonaldsonMatrix:
    if name in MATERIALS:
        return example(name, emission, excitation)
    path = folder / name
    ending = path.suffix.lower()
    if ending == ".bfc":
        return read_bfc(path).on(emission, excitation)
    if ending == ".csv":
        return read_matrix_csv(path, below="zero").on(emission, excitation)
    return from_mixture(read_mixture(path), emission_nm=emission, excitation_nm=excitation)


def _is_file(name: str) -> bool:
    return Path(name).suffix.lower() in FILES


def _table(path: Path) -> dict[str, Any]:
    text = read_text(path)
    if path.suffix != ".json":
        return parse_table(text, file=path)
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"a mistake: {error}", "JSON", file=path) from error
    if not isinstance(data, dict):
        raise InputError(f"a {type(data).__name__}", "an object", file=path)
    return data
