"""Fluorescence visits, estimates and scenarios as plain values, and cells in words."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from twin.spectra import FloatArray

if TYPE_CHECKING:
    from estimators.fluorescence import FluorescenceResult
    from scenarios.fluorescence.scenario import FluorescenceScenario
    from twin.fluorescence import (
        DonaldsonMatrix,
        FluorescenceData,
        FluorescenceSetup,
        FluorescenceVisit,
    )

ESTIMATOR_NOTES = {
    "donaldson": "fluorophores as smooth products over a smooth background, weighed by evidence;"
    " intervals from draws: the first choice",
    "donaldson-linear": "the smooth background alone: one linear solve, quick",
    "donaldson-quick": "about a millisecond, from a gain kept for the set-up; less exact",
    "donaldson-learned": "the posterior mean, by a network that is trained once for a set-up, in"
    " three to five minutes, and kept; then below a millisecond: for many samples",
    "fluorescence-posterior": "draws of Gaussians and moments (emcee): the posterior of the"
    " exported model; slow",
    "gmm-adam": "six Gaussians and a diagonal by Adam, then bounded MESE (Iser et al. 2023): for"
    " comparison, no intervals",
    "blasinski": "bases, smoothness and a small nuclear norm (Blasinski et al. 2020): for"
    " comparison, no intervals",
}


def visit_facts(visit: FluorescenceVisit) -> dict[str, Any]:
    """What a fluorescence visit holds, as plain values."""
    setup, provenance = visit.setup, visit.provenance
    shots: dict[str, int] = {}
    for shot in visit.shots:
        shots[shot.kind] = shots.get(shot.kind, 0) + 1
    return {
        "origin": provenance.origin,
        "seed": provenance.seed,
        "software": provenance.software,
        "fingerprint": visit.fingerprint,
        "sample": visit.sample,
        "setup": setup_facts(setup),
        "shots": shots,
        "integration_s": sorted({shot.integration_s for shot in visit.shots}),
        "saturated_readings": int(np.count_nonzero(visit.saturated)),
        "dead_readings": int(np.count_nonzero(~np.isfinite(visit.counts))),
        "truth": visit.truth is not None,
        "notes": [*provenance.notes, *(visit.truth.notes if visit.truth is not None else ())],
    }


def setup_facts(setup: FluorescenceSetup) -> dict[str, Any]:
    """A set-up as plain values: its parts and its price."""
    return {
        "name": setup.name,
        "price_usd": float(setup.price_usd),
        "illuminants": list(setup.illuminant_names),
        "detector": setup.detector.kind,
        "channels": len(setup.channel_names),
        "emission_nm": [float(setup.emission_nm[0]), float(setup.emission_nm[-1])],
        "excitation_nm": [float(setup.excitation_nm[0]), float(setup.excitation_nm[-1])],
    }


def scenario_facts(name: str, scenario: FluorescenceScenario) -> dict[str, Any]:
    """What a fluorescence scenario says, as plain values."""
    material = scenario.material
    return {
        "kind": "fluorescence scenario",
        "file": name,
        "title": scenario.title,
        "material": material if isinstance(material, str) else "described in the scenario",
        "add": list(scenario.add),
        "setup": setup_facts(scenario.setup),
        "repeats": scenario.protocol.repeats,
        "seed": scenario.seed,
        "scenario": scenario.model_dump(mode="json"),
    }


def result_facts(
    result: FluorescenceResult, truth: DonaldsonMatrix | None = None
) -> dict[str, Any]:
    """Key numbers of an estimate; against the truth, when there is one."""
    cells = result.fluorescence
    row, column = np.unravel_index(int(cells.argmax()), cells.shape)
    facts: dict[str, Any] = {
        "estimator": result.estimator,
        "sample": result.sample,
        "status": result.status.name.lower(),
        "status_text": result.status.text,
        "result_fingerprint": result.fingerprint,
        "reflectance": {
            "median": float(np.median(result.reflectance)),
            "range": [float(result.reflectance.min()), float(result.reflectance.max())],
        },
        "fluorescence": {
            "largest_cell": float(cells[row, column]),
            "at_emission_nm": float(result.emission_nm[row]),
            "at_excitation_nm": float(result.excitation_nm[column]),
            "largest_photon_yield": float(result.donaldson.photon_yield.max()),
        },
        "undetermined_cells": int(result.undetermined.sum()),
        "undetermined": regions(result.undetermined, result.emission_nm, result.excitation_nm),
        "messages": list(result.messages),
    }
    if truth is not None:
        facts["errors"] = errors_of(result, truth)
    return facts


def errors_of(result: FluorescenceResult, truth: DonaldsonMatrix) -> dict[str, float | None]:
    """RMSE and coverage against the truth (which may have more wavelengths than the estimate).

    Keys: rmse_fluorescence (cells below the diagonal of a matrix printed with emission as rows),
    rmse_reflectance, ciede2000_monochromatic_median, and, with intervals, the shares of cells
    that their 90 % interval holds.
    """
    from estimators.fluorescence.colour import monochromatic_difference

    right = truth.on(result.emission_nm, result.excitation_nm).matrix
    on = result.is_diagonal
    below = result.is_fluorescence
    difference = result.matrix - right
    colours = monochromatic_difference(result.matrix, right, result.emission_nm)
    low, high = result.interval
    inside = (right >= low - 1e-9) & (right <= high + 1e-9)
    known = bool(np.isfinite(low).all())
    return {
        "rmse_fluorescence": float(np.sqrt((difference[below] ** 2).mean())),
        "rmse_reflectance": float(np.sqrt((difference[on] ** 2).mean())),
        "ciede2000_monochromatic_median": float(np.median(colours)),
        "share_in_90_percent_interval": float(inside[below].mean()) if known else None,
        "share_in_90_percent_interval_reflectance": float(inside[on].mean()) if known else None,
    }


def capture_facts(data: FluorescenceData) -> dict[str, int]:
    """How many captures there are, and how many could be used."""
    return {"captures": int(data.valid.size), "used": int(data.valid.sum())}


def regions(
    flagged: NDArray[np.bool_], emission_nm: FloatArray, excitation_nm: FloatArray
) -> list[str]:
    """Flagged cells in words: one line per stretch of excitations with alike emissions.

    Args:
        flagged: shape (Wo, Wi).
        emission_nm: wavelengths [nm] of the rows, (Wo,).
        excitation_nm: wavelengths [nm] of the columns, (Wi,).
    """
    lines: list[tuple[list[float], list[FloatArray]]] = []
    rise = float(emission_nm[1] - emission_nm[0])

    def whole(rows: FloatArray) -> bool:
        """Whether wavelengths follow each other without a hole."""
        return bool(np.all(np.diff(rows) < 1.5 * rise))

    for column, excitation in enumerate(excitation_nm):
        rows = emission_nm[flagged[:, column]]
        if not rows.size:
            continue
        if lines:
            columns, spans = lines[-1]
            step = excitation_nm[1] - excitation_nm[0]
            near = abs(columns[-1] + step - excitation) < 1e-6
            # Columns are shorter by one cell each along the diagonal: only the ends must agree.
            if near and abs(spans[-1][-1] - rows[-1]) < 1e-6 and whole(rows) == whole(spans[-1]):
                columns.append(float(excitation))
                spans.append(rows)
                continue
        lines.append(([float(excitation)], [rows]))
    found = []
    for columns, spans in lines:
        count = sum(rows.size for rows in spans)
        first = min(float(rows[0]) for rows in spans)
        last = max(float(rows[-1]) for rows in spans)
        number = f"{count} cell{'s' if count > 1 else ''}"
        found.append(f"excitation {_span(columns)}, emission {_span([first, last])} ({number})")
    return found


def _span(values: Sequence[float]) -> str:
    low, high = min(values), max(values)
    return f"{low:g} nm" if low == high else f"{low:g} to {high:g} nm"


def describe_path(path: Path) -> dict[str, Any] | None:
    """What a fluorescence file or folder holds; None when it is of another kind.

    Raises:
        InputError: it is damaged.
    """
    from estimators.fluorescence.result_file import is_fluorescence_result, read_result
    from twin.fluorescence import is_fluorescence_visit, read_visit

    if is_fluorescence_visit(path):
        return {"kind": "fluorescence visit", "file": str(path), **visit_facts(read_visit(path))}
    if not path.is_dir() and is_fluorescence_result(path):
        facts = result_facts(read_result(path))
        return {"kind": "fluorescence estimate", "file": str(path), **facts}
    return None


def catalogue() -> dict[str, Callable[[], Any]]:
    """What there is to choose from, by kind; each is made when it is asked for."""
    from estimators.fluorescence import fluorescence_names
    from scenarios.fluorescence.scenario import builtin_names, load_scenario
    from twin.fluorescence import FLUOROPHORES, MATERIALS

    def setups() -> dict[str, str]:
        found = {}
        for name in builtin_names():
            scenario = load_scenario(name)
            found[name] = f"{scenario.title} ({scenario.setup.price_usd:,.0f} USD)"
        return found

    return {
        "fluorescence_scenarios": setups,
        "fluorescence_estimators": lambda: {
            name: ESTIMATOR_NOTES.get(name, "") for name in fluorescence_names()
        },
        # Sentences: as keys, names would lose their underscores in what is printed.
        "fluorescent_materials": lambda: [
            f"{name}: base {base:g}" + "".join(f", {dye} {share:g}" for dye, share in dyes.items())
            for name, (base, dyes) in MATERIALS.items()
        ],
        "fluorophores": lambda: [f"{name}: {dye.source}" for name, dye in FLUOROPHORES.items()],
    }
