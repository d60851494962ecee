"""What is taken for true: exact captures by either engine."""

from __future__ import annotations

import numpy as np

from estimators import BenchModel
from estimators.objective import engine_of
from twin.spectra import FloatArray

PATHS = 8192


def fast_engine(model: BenchModel, material: FloatArray) -> FloatArray:
    """Captures by adding-doubling, as estimators evaluate it: milliseconds.

    An estimator that inverts this engine is tested on itself: what is found is the estimator's
    own mistakes, not those of the engine.

    Args:
        model: the bench.
        material: albedo, sigma_t [1/mm] and g, shape (W, 3).

    Returns:
        Relative intensities, shape (S, 3, W).
    """
    engine = engine_of(model)
    return np.asarray(engine.forward(engine.parameters(*material.T))).transpose(1, 2, 0)


def monte_carlo(model: BenchModel, material: FloatArray) -> FloatArray:
    """Captures by the Monte Carlo of the finite bench: seconds for every case.

    Its own noise, some 0.1 to 0.3 %, comes on top of the stated one: state 1 % or more.

    Args:
        model: the bench.
        material: albedo, sigma_t [1/mm] and g, shape (W, 3).

    Returns:
        Relative intensities, shape (S, 3, W).

    Raises:
        InputError: the model knows no bench.
    """
    from twin.errors import InputError
    from twin.materials import OpticalProperties
    from twin.transport import captures

    if model.bench is None:
        raise InputError("a bench model without a bench", "the bench", place="model")
    properties = OpticalProperties(
        model.wavelength_nm, material[:, 0], material[:, 1], material[:, 2], None
    )
    found = [
        captures(model.bench, sample, model.wavelength_nm, properties=properties, paths=PATHS)
        for sample in model.samples
    ]
    return np.stack([[one.black, one.white, one.collimated] for one in found])
