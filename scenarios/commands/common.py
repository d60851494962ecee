"""What every command does: check before the work starts, and write what it made."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from scenarios.outputs import canonical_json, file_digest, prepare_folder
from scenarios.pipeline import check_estimator
from scenarios.scenario import EstimatorChoice, Scenario, builtin_names, load_scenario
from twin.errors import InputError
from twin.files import write_atomically


@contextlib.contextmanager
def said_of(source: str | Path) -> Iterator[None]:
    """A wrong input that names no file is said of the scenario or the measurement."""
    try:
        yield
    except InputError as error:
        from scenarios.fluorescence import builtin_names as fluorescence_names

        builtin = source in (*builtin_names(), *fluorescence_names())
        file = f"built-in scenario {source}" if builtin else source
        raise (error if error.file else error.at(file)) from error


def cache_of(folder: Path | None) -> Path:
    """The folder of the maps, proved to be writable before minutes of work.

    Raises:
        InputError: it is not.
    """
    from twin.cache import cache_folder

    try:
        return prepare_folder(folder or cache_folder("maps"))
    except InputError as error:
        raise InputError(
            error.found.replace("an output folder", "a cache folder"),
            error.expected,
            file=error.file,
            remedy="Name another folder with --cache, or set BENCHTWIN_CACHE.",
        ) from error


def with_estimator(scenario: Scenario, name: str | None) -> Scenario:
    """The scenario with another estimator, whose options are its defaults; None keeps its own."""
    if name is None or name == scenario.estimator.name:
        return scenario
    return scenario.model_copy(update={"estimator": EstimatorChoice(name=name)})


def settings_for_file(
    name: str, estimator: str | None, seed: int | None, *, quick: bool
) -> Scenario:
    """Map and estimator settings for a measurement on disk, from a scenario.

    Args:
        name: of the scenario.
        estimator: in place of the scenario's.
        seed: of the estimator's random draws; None keeps what is set.
        quick: a coarse map.

    Raises:
        InputError: no such scenario, estimator or option.
    """
    scenario = with_estimator(load_scenario(name).settled(quick=quick), estimator)
    choice = scenario.estimator
    if seed is not None:
        choice = choice.model_copy(update={"options": choice.options | {"seed": seed}})
    check_estimator(choice)
    return scenario.model_copy(update={"estimator": choice})


def digests(folder: Path, files: Iterable[str]) -> dict[str, str]:
    """SHA-256 of each file: how a person sees that two runs are the same."""
    return {name: file_digest(folder / name) for name in files}


def write_json(path: Path, value: Mapping[str, Any]) -> None:
    """Write canonical JSON, whole or not at all.

    Raises:
        InputError: the file cannot be written.
    """
    write_atomically(path, (canonical_json(value) + "\n").encode())
