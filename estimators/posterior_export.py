"""Posterior draws as an ArviZ DataTree."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from estimators.result import CAPTURES, EstimateResult
from twin.errors import InputError
from twin.measurement.relative import RelativeIntensities

if TYPE_CHECKING:
    from xarray import DataTree

CHAINS = 4


def to_inference_data(
    result: EstimateResult, intensities: RelativeIntensities, *, chains: int = CHAINS
) -> DataTree:
    """Groups posterior, sample_stats, observed_data and constant_data, as ArviZ reads them.

    The result's draws are evenly thinned from one ensemble. They are cut, in the order of the
    run, into `chains` stretches, which stand for chains: walkers of an ensemble are not
    independent, so ArviZ's R-hat over them would say nothing of convergence, but over stretches
    of time it shows a drift. The verdict itself is `converged` in sample_stats, from the
    autocorrelation time.

    Args:
        result: an estimate with draws.
        intensities: what it was made from.
        chains: number of stretches; draws that do not fill one are left out.

    Raises:
        InputError: the estimate has no draws, or too few.
    """
    if result.draws is None or len(result.draws) < chains:
        raise InputError(
            "an estimate without draws" if result.draws is None else f"{len(result.draws)} draws",
            f"draws for {chains} chains",
            place="result.draws",
            remedy='Estimate with "posterior".',
        )
    import xarray

    each = len(result.draws) // chains
    cut = result.draws[: each * chains].reshape(chains, each, *result.draws.shape[1:])
    dims = ("chain", "draw", "wavelength_nm")
    at = {"wavelength_nm": np.asarray(result.wavelength_nm, dtype=np.float64)}
    coords = {**at, "chain": np.arange(chains), "draw": np.arange(each)}
    names = {"albedo": "1", "sigma_t_per_mm": "1/mm", "g": "1"}
    posterior = xarray.Dataset(
        {
            name: (dims, cut[..., column], {"units": unit})
            for column, (name, unit) in enumerate(names.items())
        },
        coords=coords,
        attrs={
            "inference_library": "emcee",
            "sampling": "one ensemble per wavelength, or one for joint spectra",
            "chains": "consecutive stretches of the ensemble's run",
        },
    )
    statistics = xarray.Dataset(
        {
            name: ("wavelength_nm", np.asarray(value))
            for name, value in sorted(result.statistics.items())
        },
        coords=at,
    )
    place = {
        **at,
        "sample": np.array(result.sample_names, dtype=object),
        "capture": np.array(CAPTURES, dtype=object),
    }
    by_capture = ("sample", "capture", "wavelength_nm")
    observed = xarray.Dataset(
        {"relative_intensity": (by_capture, np.asarray(intensities.value), {"units": "1"})},
        coords=place,
    )
    constant = xarray.Dataset(
        {
            "thickness_mm": ("sample", np.asarray(result.thickness_mm), {"units": "mm"}),
            "sigma": (by_capture, np.asarray(intensities.sigma), {"units": "1"}),
        },
        coords=place,
    )
    return xarray.DataTree.from_dict(
        {
            "/posterior": posterior,
            "/sample_stats": statistics,
            "/observed_data": observed,
            "/constant_data": constant,
        }
    )
