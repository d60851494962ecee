"""Extinction coefficient from the collimated capture alone (Beer's law through windows)."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from estimators.protocol import BenchModel, fingerprint
from estimators.result import (
    QUANTILE_LEVELS,
    EstimateResult,
    Status,
    gaussian_quantiles,
)
from twin.measurement.relative import RelativeIntensities
from twin.optics import sigma_t_from_transmittance, stack_transmittance
from twin.spectra import FloatArray


@dataclass(frozen=True)
class BeerSettings:
    """Options of the Beer estimator."""

    lost_sigma: float = 3.0
    """A collimated intensity below so many standard deviations counts as lost in noise."""
    inconsistent_sigma: float = 4.0
    """Samples that differ by more standard deviations are called inconsistent."""


def beer_check(
    intensities: RelativeIntensities, model: BenchModel
) -> tuple[FloatArray, FloatArray]:
    """sigma_t [1/mm] from the collimated capture and its standard error, both (S, W).

    All internal reflections of faces and covers are taken off in closed form; in-scattered
    light is not, so that strong forward scattering makes sigma_t too small (Iser et al. 2022,
    fig. 6). NaN where the capture is masked or not positive.
    """
    count = len(intensities.sample_names)
    values, errors = [], []
    for sample in range(count):
        valid = np.asarray(intensities.valid)[sample, 2]
        total = np.where(valid, np.asarray(intensities.value)[sample, 2], np.nan)
        sigma_t, slope = sigma_t_from_transmittance(
            total, float(intensities.thickness_mm[sample]), model.windows(sample)
        )
        variance = np.asarray(intensities.covariance)[:, 3 * sample + 2, 3 * sample + 2]
        values.append(sigma_t)
        errors.append(np.abs(slope) * np.sqrt(variance))
    return np.stack(values), np.stack(errors)


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
        measured = np.asarray(intensities.value)[:, 2]
        noise = np.sqrt(np.diagonal(intensities.covariance, axis1=1, axis2=2)[:, 2::3].T)
        masked = ~np.asarray(intensities.valid)[:, 2] | ~np.isfinite(measured)
        with np.errstate(invalid="ignore"):
            lost = ~masked & (measured <= self.settings.lost_sigma * noise)
            excess = ~masked & (sigma_t < -self.settings.lost_sigma * error)
        sample_status = np.select(
            [masked, lost, excess],
            [Status.MASKED, Status.COLLIMATED_LOST, Status.CONTRADICTORY],
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
        status[torn] = Status.INCONSISTENT
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
            messages=tuple(intensities.reasons),
        )
