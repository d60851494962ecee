"""Extinction coefficient from the collimated capture alone (Beer's law through windows)."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from estimators.beer_law import beer_check
from estimators.protocol import BenchModel, fingerprint
from estimators.result import (
    QUANTILE_LEVELS,
    EstimateResult,
    Status,
    gaussian_quantiles,
)
from estimators.screening import counted, impossible, left_out, screen
from twin.measurement.relative import RelativeIntensities
from twin.optics import stack_transmittance

__all__ = ["BeerEstimator", "BeerSettings", "beer_check"]


@dataclass(frozen=True)
class BeerSettings:
    """Options of the Beer estimator."""

    lost_sigma: float = 3.0
    """A collimated intensity below so many standard deviations counts as lost in noise."""
    inconsistent_sigma: float = 4.0
    """Samples that differ by more standard deviations are called inconsistent."""


class BeerEstimator:
    """sigma_t by inverting I_collimated = q t / (1 - p t^2), t = exp(-sigma_t H).

    Valid for thin samples that scatter little or not forward; albedo and g stay NaN. Samples
    are combined by the inverse of their variances. Source: Iser et al. 2022, eq. (2), with
    the windows of `twin.optics`.
    """

    name = "beer"

    def __init__(self, model: BenchModel, settings: BeerSettings | None = None) -> None:
        self.model = model
        self.settings = settings or BeerSettings()

    def estimate(self, intensities: RelativeIntensities) -> EstimateResult:
        """Estimate sigma_t; see `estimators.protocol.Estimator`."""
        self.model.check(intensities)
        sigma_t, error = beer_check(intensities, self.model)
        samples, count = sigma_t.shape
        limit = self.settings.lost_sigma
        screened = screen(self.model, intensities, limit)
        measured, noise = screened.value[:, 2], screened.sigma[:, 2]
        masked = ~screened.usable[:, 2]
        with np.errstate(invalid="ignore"):
            wrong = ~masked & ((sigma_t < -limit * error) | (measured < -limit * noise - 1e-12))
            lost = ~masked & (measured <= limit * noise)
        sample_status = np.select(
            [masked, wrong, lost],
            [Status.MASKED, Status.CONTRADICTORY, Status.COLLIMATED_LOST],
            Status.OK,
        ).astype(np.int8)
        usable = sample_status == Status.OK

        exact = usable & (error == 0.0)
        # Captures without stated noise weigh alike, and more than any other.
        weight = np.where(usable, np.where(exact.any(axis=0), exact, 1.0), 0.0)
        noisy = usable & ~exact.any(axis=0)
        weight[noisy] = error[noisy] ** -2.0
        total = weight.sum(axis=0)
        some = total > 0
        scale = np.where(some, total, 1.0)
        mean = np.where(some, np.where(usable, weight * sigma_t, 0.0).sum(axis=0) / scale, np.nan)
        variance = np.where(some, (weight**2 * np.where(usable, error, 0.0) ** 2).sum(0), np.nan)
        variance = variance / scale**2
        with np.errstate(invalid="ignore", divide="ignore"):
            pull = np.where(usable & (error > 0), np.abs(sigma_t - mean) / error, 0.0).max(axis=0)
        torn = pull > self.settings.inconsistent_sigma
        variance = np.where(torn, variance * pull**2, variance)

        status = np.where(some, Status.OK, sample_status.min(axis=0)).astype(np.int8)
        status[some & exact.any(axis=0)] = Status.NO_NOISE_STATED
        status[torn | (some & impossible(sample_status))] = Status.INCONSISTENT
        status[some & (mean < 0.0)] = Status.AT_BOUND
        covariance = np.full((count, 3, 3), np.nan)
        covariance[:, 1, 1] = variance
        blank = np.full(count, np.nan)
        predicted = np.stack(
            [
                stack_transmittance(
                    np.exp(-mean * intensities.thickness_mm[s]), self.model.windows(s)
                )
                for s in range(samples)
            ]
        )
        residual = np.full((samples, 3, count), np.nan)
        residual[:, 2] = np.where(masked, np.nan, predicted - measured)
        normalised = np.full_like(residual, np.nan)
        with np.errstate(divide="ignore", invalid="ignore"):
            normalised[:, 2] = np.where(noise > 0, residual[:, 2] / noise, np.nan)
        estimate = np.full((samples, count, 3), np.nan)
        estimate[..., 1] = sigma_t
        quantile = np.full((QUANTILE_LEVELS.size, count, 3), np.nan)
        quantile[..., 1] = gaussian_quantiles(mean, np.sqrt(variance))
        identifiable = np.zeros((count, 3), dtype=bool)
        identifiable[:, 1] = some
        settings = asdict(self.settings)
        return EstimateResult(
            estimator=self.name,
            wavelength_nm=self.model.wavelength_nm,
            albedo=blank,
            sigma_t_per_mm=mean,
            g=blank.copy(),
            covariance=covariance,
            quantile_level=QUANTILE_LEVELS,
            quantile=quantile,
            identifiable=identifiable,
            status=status,
            sample_names=tuple(intensities.sample_names),
            thickness_mm=np.asarray(intensities.thickness_mm, dtype=np.float64),
            sample_estimate=estimate,
            sample_status=sample_status,
            distance=np.full((samples, count), np.nan),
            residual=residual,
            residual_normalised=normalised,
            beer_sigma_t_per_mm=sigma_t,
            beer_standard_error_per_mm=error,
            settings=settings,
            fingerprint=fingerprint(
                intensities, self.model.fingerprint_parts(), [self.name, repr(settings)]
            ),
            messages=(
                *intensities.reasons,
                *left_out(intensities.sample_names, sample_status, status),
                *counted(status),
            ),
        )
