"""What a file holds, and what there is to choose from."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.scenario import Scenario, builtin_names, load_scenario
from scenarios.summary import parameters_of
from twin.errors import InputError
from twin.toml import near_misses

if TYPE_CHECKING:
    from collections.abc import Callable

    from estimators import EstimateResult
    from twin.appearance import AppearanceMap
    from twin.measurement import Measurement

HDF5 = b"\x89HDF\r\n\x1a\n"
KINDS = (
    "scenarios",
    "estimators",
    "stress_plans",
    "materials",
    "reflectances",
    "lamps",
    "refractive_indices",
    "fluorescence_scenarios",
    "fluorescence_estimators",
    "fluorescent_materials",
    "fluorophores",
)
"""What `benchtwin list` lists."""
MAP_ERRORS = ("black_se", "white_se", "collimated_se")


def describe(file: str) -> dict[str, Any]:
    """What a file holds: a visit to either bench, a result, an appearance map or a scenario.

    Args:
        file: a path, or the name of a built-in scenario.

    Raises:
        InputError: it is none of these, truncated or damaged.
    """
    from scenarios.fluorescence import facts, is_fluorescence_scenario

    path = Path(file)
    if is_fluorescence_scenario(file):
        from scenarios.fluorescence import load_scenario as load_fluorescence

        return facts.scenario_facts(file, load_fluorescence(file))
    if path.exists() and (found := facts.describe_path(path)) is not None:
        return found
    if path.is_dir():
        return _measurement(path)
    if not path.exists() or path.suffix in (".toml", ".json"):
        return scenario_facts(file, load_scenario(file))
    readers: tuple[Callable[[Path], dict[str, Any]], ...] = (_measurement, _result)
    if not _is_hdf5(path):
        readers = (_map,)
    refusals = []
    for reader in readers:
        try:
            return reader(path)
        except InputError as error:
            refusals.append(error)
    raise InputError(
        " and ".join(dict.fromkeys(error.found for error in refusals)),
        "a measurement, a result, an appearance map or a scenario made by benchtwin",
        file=path,
        remedy=refusals[0].remedy,
    )


def _is_hdf5(path: Path) -> bool:
    try:
        with path.open("rb") as stream:
            return stream.read(len(HDF5)) == HDF5
    except OSError as error:
        raise InputError(
            f"a file that cannot be read ({error.strerror})", "a file", file=path
        ) from error


def _measurement(path: Path) -> dict[str, Any]:
    from twin.measurement import read_measurement

    return {"kind": "measurement", "file": str(path), **measurement_facts(read_measurement(path))}


def _result(path: Path) -> dict[str, Any]:
    from estimators import read_netcdf

    return {"kind": "result", "file": str(path), **result_facts(read_netcdf(path))}


def _map(path: Path) -> dict[str, Any]:
    from twin.appearance import AppearanceMap
    from twin.cache import load_arrays

    arrays = load_arrays(path, lambda _: None)
    tables = ("exponent", "black_series", "white_series", "collimated")
    keys = {name: name.removesuffix("_series") for name in (*tables, *MAP_ERRORS)}
    if arrays is None or not {"albedo", "sigma_t", "g", "sample", *keys.values()} <= set(arrays):
        raise InputError("a file of another make, truncated or damaged", "an appearance map")
    thickness, n = (float(number) for number in arrays["sample"])
    found = AppearanceMap(
        albedo=arrays["albedo"],
        sigma_t_per_mm=arrays["sigma_t"],
        g=arrays["g"],
        thickness_mm=thickness,
        n=n,
        key=path.stem,
        **{name: arrays[key] for name, key in keys.items()},
    )
    return {"kind": "appearance map", "file": str(path), **map_facts(found)}


def measurement_facts(measurement: Measurement) -> dict[str, Any]:
    """What a measurement holds, as plain values."""
    provenance, wavelength = measurement.provenance, measurement.wavelength_nm
    facts: dict[str, Any] = {
        "origin": provenance.origin,
        "seed": provenance.seed,
        "software": provenance.software,
        "fingerprint": measurement.fingerprint,
        "instrument": measurement.bench.instrument.kind,
        "samples": [
            {"name": sample.name, "thickness_mm": sample.thickness_mm}
            for sample in measurement.samples
        ],
        "wavelengths": int(wavelength.size),
        "wavelength_nm": [float(wavelength[0]), float(wavelength[-1])],
        "truth": measurement.truth is not None,
        "notes": list(provenance.notes),
    }
    captures = measurement.captures
    if captures is not None:
        shots: dict[str, int] = {}
        for shot in captures.shots:
            shots[shot.capture] = shots.get(shot.capture, 0) + 1
        facts["shots"] = shots
        facts["integration_s"] = sorted({shot.integration_s for shot in captures.shots})
        facts["saturated_readings"] = int(np.count_nonzero(captures.saturated))
    elif measurement.relative is not None:
        facts["relative_spectra"] = len(measurement.relative.rows)
    return facts


def result_facts(result: EstimateResult) -> dict[str, Any]:
    """What a result holds, as plain values."""
    return {
        "estimator": result.estimator,
        "fingerprint": result.fingerprint,
        "samples": [
            {"name": name, "thickness_mm": float(thickness)}
            for name, thickness in zip(result.sample_names, result.thickness_mm, strict=True)
        ],
        "wavelengths": int(result.wavelength_nm.size),
        "wavelength_nm": [float(result.wavelength_nm[0]), float(result.wavelength_nm[-1])],
        "status": result.counts(),
        "estimate": parameters_of(result),
        "settings": dict(result.settings),
        "messages": list(result.messages),
    }


def map_facts(found: AppearanceMap) -> dict[str, Any]:
    """What an appearance map holds, as plain values."""
    axes = {"albedo": found.albedo, "sigma_t_per_mm": found.sigma_t_per_mm, "g": found.g}
    facts: dict[str, Any] = {"thickness_mm": float(found.thickness_mm), "n": float(found.n)}
    for name, axis in axes.items():
        facts[name] = {"count": int(axis.size), "range": [float(axis[0]), float(axis[-1])]}
    for capture in ("black", "white", "collimated"):
        error = np.asarray(getattr(found, f"{capture}_se"))
        facts[f"median_{capture}_standard_error"] = float(np.median(error))
    return facts


def scenario_facts(name: str, scenario: Scenario) -> dict[str, Any]:
    """What a scenario says, as plain values; the whole of it under "scenario"."""
    grid = scenario.wavelength
    return {
        "kind": "scenario",
        "file": name,
        "title": scenario.title,
        "samples": [
            {"name": sample.name, "thickness_mm": sample.thickness_mm, "material": _name(sample)}
            for sample in scenario.samples
        ],
        "instrument": scenario.bench.instrument.kind,
        "wavelength_nm": [grid.start_nm, grid.stop_nm],
        "step_nm": grid.step_nm,
        "paths": scenario.simulation.paths,
        "seed": scenario.simulation.seed,
        "estimator": scenario.estimator.name,
        "scenario": scenario.model_dump(mode="json"),
    }


def _name(sample: Any) -> str:
    return sample.material if isinstance(sample.material, str) else "a table of numbers"


def catalogue(kind: str | None = None) -> dict[str, Any]:
    """What there is to choose from: names, and one line about each.

    Raises:
        InputError: an unknown kind.
    """
    if kind is not None and kind not in KINDS:
        raise InputError(
            f"the kind {kind!r}", f"one of {', '.join(KINDS)}", remedy=near_misses(kind, KINDS)
        )
    from estimators import names as estimator_names
    from scenarios.estimator_notes import note
    from scenarios.fluorescence.facts import catalogue as fluorescence_catalogue
    from scenarios.stress.plan import builtin_plans, load_plan
    from twin.materials import names

    listing: dict[str, Callable[[], Any]] = {
        "scenarios": lambda: {name: load_scenario(name).title for name in builtin_names()},
        "estimators": lambda: {name: note(name) for name in estimator_names()},
        "stress_plans": lambda: {name: load_plan(name).title for name in builtin_plans()},
        "materials": lambda: {name: _source(name) for name in names("material")},
        "reflectances": lambda: list(names("reflectance")),
        "lamps": lambda: list(names("lamp")),
        "refractive_indices": lambda: list(names("refractive_index")),
        **fluorescence_catalogue(),
    }
    return {name: make() for name, make in listing.items() if kind in (None, name)}


def _source(name: str) -> str:
    from twin.materials import material

    found = material(name)
    return f"{found.citation} (interpolated)" if found.interpolated else found.citation
