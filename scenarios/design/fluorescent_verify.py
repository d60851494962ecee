"""The whole simulation beside the prediction: visits, corrections and the estimator `donaldson`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from scenarios.design.fluorescent_population import fluorescent_population
from scenarios.design.fluorescent_prior import KNOWN
from twin.errors import InputError
from twin.fluorescence import (
    DonaldsonMatrix,
    FluorescenceProtocol,
    FluorescenceSetup,
    corrected,
    simulate_fluorescence,
)
from twin.spectra import FloatArray
from twin.toml import validate

TASK = "scenarios.design.fluorescent_verify:simulated"
"""For `scenarios.sweep.sweep`."""
VERSION = "1"


def verification_point(
    setup: FluorescenceSetup,
    *,
    protocol: FluorescenceProtocol | None = None,
    materials: int = 12,
    population_seed: int = 1,
    seed: int = 1,
) -> dict[str, Any]:
    """One point of a sweep with `TASK`: a set-up, a protocol, a generated population, one seed."""
    return {
        "setup": setup.model_dump(mode="json"),
        "protocol": (protocol or FluorescenceProtocol()).model_dump(mode="json"),
        "materials": materials, "population_seed": population_seed, "seed": seed,
    }  # fmt: skip


def simulated(point: dict[str, Any]) -> dict[str, FloatArray]:
    """Errors of the estimator on simulated visits to a generated population.

    Args:
        point: as `verification_point` makes it.

    Returns:
        lower, diagonal: RMSE of the fluorescence cells and of the reflectance, (B,) each; colour:
        median CIEDE2000 under monochromatic light, (B,).

    Raises:
        InputError: a key that is missing, or a set-up or protocol that does not fit.
    """
    keys = ("setup", "protocol", "materials", "population_seed", "seed")
    missing = [key for key in keys if key not in point]
    if missing:
        raise InputError(f"no {missing[0]}", ", ".join(keys), place="point")
    setup = validate(point["setup"], FluorescenceSetup)
    population = fluorescent_population(
        int(point["materials"]), seed=int(point["population_seed"]),
        emission_nm=setup.emission_nm, excitation_nm=setup.excitation_nm,
    )  # fmt: skip
    protocol = validate(point["protocol"], FluorescenceProtocol)
    return errors_of_visits(setup, population, protocol, int(point["seed"]))


def errors_of_visits(
    setup: FluorescenceSetup, materials: Sequence[DonaldsonMatrix],
    protocol: FluorescenceProtocol, seed: int,
) -> dict[str, FloatArray]:  # fmt: skip
    """Simulate one visit to each material, estimate it, compare: as `simulated` returns it."""
    from estimators.fluorescence.colour import monochromatic_difference
    from estimators.fluorescence.donaldson import DonaldsonEstimator

    data = [
        corrected(simulate_fluorescence(setup, each, protocol=protocol, seed=1000 * seed + number))
        for number, each in enumerate(materials)
    ]
    found = DonaldsonEstimator(KNOWN).estimate_batch(data)
    first = found[0]
    truth = np.array([each.physical().matrix for each in materials])
    matrix = np.array([each.matrix for each in found])
    below = first.emission_nm[:, None] > first.excitation_nm + 1e-6
    square = (matrix - truth) ** 2
    return {
        "lower": np.sqrt(square[:, below].mean(axis=1)),
        "diagonal": np.sqrt(square[:, first.is_diagonal].mean(axis=1)),
        "colour": np.median(monochromatic_difference(matrix, truth, first.emission_nm), axis=1),
    }
