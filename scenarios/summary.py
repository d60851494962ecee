"""The key numbers of an estimate as plain values: `summary.json` and what the command prints."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.simulate import software

if TYPE_CHECKING:
    from estimators import EstimateResult
    from twin.measurement import Measurement
    from twin.spectra import FloatArray

COVERAGE = 0.9
"""Coverage of the intervals that are checked against the truth."""


def summary_of(
    measurement: Measurement, result: EstimateResult, *, scenario: str = ""
) -> dict[str, Any]:
    """Key numbers of an estimate.

    Args:
        measurement: the visit.
        result: the estimate.
        scenario: name of the scenario that was simulated, or "".

    Returns:
        Plain values: what was measured, the number of wavelengths by status, the median of every
        parameter and its standard error where it is determined, and against the truth, when
        there is one, the median absolute error and the share of 90 % intervals that hold it.
    """
    provenance = measurement.provenance
    return {
        "scenario": scenario,
        "seed": provenance.seed,
        "origin": provenance.origin,
        "software": software(),
        "measurement_fingerprint": measurement.fingerprint,
        "result_fingerprint": result.fingerprint,
        "samples": [
            {"name": sample.name, "thickness_mm": sample.thickness_mm}
            for sample in measurement.samples
        ],
        "estimator": result.estimator,
        "wavelengths": int(result.wavelength_nm.size),
        "wavelength_nm": [float(result.wavelength_nm[0]), float(result.wavelength_nm[-1])],
        "status": result.counts(),
        "estimate": parameters_of(result, _truth(measurement, result.wavelength_nm)),
        "messages": list(result.messages),
    }


def parameters_of(
    result: EstimateResult, truth: FloatArray | None = None
) -> dict[str, dict[str, Any]]:
    """Key numbers of albedo, sigma_t and g over the wavelengths that determine them.

    Args:
        result: the estimate.
        truth: true albedo, sigma_t and g, shape (3, W), NaN where unknown; None without a truth.
    """
    from estimators import PARAMETERS, Status

    has_value = np.array([Status(int(code)).has_value for code in result.status])
    low, high = result.interval(COVERAGE)
    found: dict[str, dict[str, Any]] = {}
    for index, name in enumerate(PARAMETERS):
        value = result.parameters[:, index]
        use = has_value & result.identifiable[:, index] & np.isfinite(value)
        numbers: dict[str, Any] = {
            "determined": int(use.sum()),
            "median": _median(value[use]),
            "median_standard_error": _median(result.standard_error[use, index]),
        }
        if truth is not None:
            known = use & np.isfinite(truth[index])
            right = truth[index][known]
            held = (low[known, index] <= right) & (right <= high[known, index])
            numbers["median_absolute_error"] = _median(np.abs(value[known] - right))
            numbers["share_in_90_percent_interval"] = float(held.mean()) if held.size else None
        found[name] = numbers
    return found


def _truth(measurement: Measurement, wavelength_nm: FloatArray) -> FloatArray | None:
    """True albedo, sigma_t, g of the first sample, (3, W), as the instrument sees them; or None."""
    from twin.measurement import seen_truth

    truth = seen_truth(measurement)
    if truth is None:
        return None
    rows = (truth.albedo[0], truth.sigma_t_per_mm[0], truth.g[0])
    return np.stack(
        [
            np.interp(wavelength_nm, truth.wavelength_nm, row, left=np.nan, right=np.nan)
            for row in rows
        ]
    )


def _median(values: FloatArray) -> float | None:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if finite.size else None
