"""Estimates made up for tests: any values, any covariance, any statuses."""

from __future__ import annotations

import numpy as np

from estimators import EstimateResult, Status
from estimators.result import QUANTILE_LEVELS, gaussian_quantiles
from scenarios.predict import UncertainMedium
from twin.spectra import FloatArray

WAVELENGTH = np.arange(400.0, 701.0, 50.0)


def estimate(
    properties: FloatArray,
    error: tuple[float, float, float] = (0.01, 0.02, 0.03),
    *,
    wavelength_nm: FloatArray | None = None,
    status: FloatArray | None = None,
    draws: FloatArray | None = None,
) -> EstimateResult:
    """An estimate of albedo, sigma_t, g (W, 3) with uncorrelated standard errors."""
    count = len(properties)
    wavelength = WAVELENGTH if wavelength_nm is None else wavelength_nm
    covariance = np.broadcast_to(np.diag(np.square(error)), (count, 3, 3)).copy()
    nothing = np.zeros((1, count))
    return EstimateResult(
        estimator="made up",
        wavelength_nm=wavelength,
        albedo=properties[:, 0],
        sigma_t_per_mm=properties[:, 1],
        g=properties[:, 2],
        covariance=covariance,
        quantile_level=QUANTILE_LEVELS,
        quantile=gaussian_quantiles(properties, np.broadcast_to(error, properties.shape)),
        identifiable=np.ones((count, 3), dtype=bool),
        status=np.full(count, Status.OK, np.int8) if status is None else status.astype(np.int8),
        sample_names=("one",),
        thickness_mm=np.array([1.0]),
        sample_estimate=properties[None],
        sample_status=np.zeros((1, count), np.int8),
        distance=nothing,
        residual=np.zeros((1, 3, count)),
        residual_normalised=np.zeros((1, 3, count)),
        beer_sigma_t_per_mm=nothing,
        beer_standard_error_per_mm=nothing,
        settings={},
        fingerprint="0" * 64,
        draws=draws,
    )


def constant(albedo: float, sigma_t: float, g: float, count: int = len(WAVELENGTH)) -> FloatArray:
    """The same properties at every wavelength, (W, 3)."""
    return np.tile([albedo, sigma_t, g], (count, 1))


def exact(properties: FloatArray, wavelength_nm: FloatArray | None = None) -> UncertainMedium:
    """A medium that is known exactly, with equal draws."""
    wavelength = WAVELENGTH if wavelength_nm is None else wavelength_nm
    return UncertainMedium("exact", wavelength, properties, np.stack([properties] * 60), True)
