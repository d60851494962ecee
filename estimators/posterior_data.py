"""What the posterior is told: usable captures, their noise, and what is wrong with them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.posterior_settings import PosteriorSettings
from estimators.result import Status
from twin.measurement.relative import RelativeIntensities
from twin.spectra import FloatArray

LEAST_CAPTURES = 3
"""As many as there are unknowns."""
FLOOR = 1e-7
"""Least standard deviation of a capture whose noise is stated as zero."""


@dataclass(frozen=True, eq=False)
class Data:
    """The captures of W wavelengths, M = 3 S each (index 3 * sample + capture).

    Attributes:
        value: measured, 0 where not valid, (W, M).
        covariance: 0 where not valid, (W, M, M).
        valid: (W, M).
        sample_status: MASKED, CONTRADICTORY, COLLIMATED_LOST or OK, (S, W).
        noiseless: no capture of the wavelength has noise, (W,).
    """

    value: FloatArray
    covariance: FloatArray
    valid: NDArray[np.bool_]
    sample_status: NDArray[np.int8]
    noiseless: NDArray[np.bool_]

    @classmethod
    def of(cls, intensities: RelativeIntensities, settings: PosteriorSettings) -> Data:
        """Sort the captures; a capture without a finite value or variance is not valid."""
        value = np.asarray(intensities.value, dtype=np.float64)
        samples, _, count = value.shape
        size = 3 * samples
        by_wavelength = value.reshape(size, count).T
        matrix = np.asarray(intensities.covariance, dtype=np.float64)
        diagonal = np.diagonal(matrix, axis1=1, axis2=2)
        valid = np.asarray(intensities.valid).reshape(size, count).T & np.isfinite(by_wavelength)
        valid = valid & np.isfinite(diagonal) & (np.nan_to_num(diagonal) >= 0.0)
        both = valid[:, :, None] & valid[:, None, :] & np.isfinite(matrix)
        covariance = np.where(both, matrix, 0.0)
        variance = np.where(valid, np.nan_to_num(diagonal), 0.0)
        shown = np.where(valid, by_wavelength, 0.0)
        black, white, through = shown.reshape(count, samples, 3).transpose(2, 1, 0)
        spread = np.sqrt(variance).reshape(count, samples, 3).transpose(2, 1, 0)
        usable = valid.reshape(count, samples, 3).transpose(2, 1, 0)
        limit = settings.lost_sigma
        wrong = usable[0] & usable[1]
        wrong &= black - white > limit * np.hypot(spread[0], spread[1]) + 1e-9
        wrong |= usable[2] & (through > 1.0 + limit * spread[2] + 1e-9)
        lost = usable[2] & ((through <= limit * spread[2]) | (through <= 0.0))
        status = np.select(
            [~usable.any(axis=0), wrong, lost],
            [Status.MASKED, Status.CONTRADICTORY, Status.COLLIMATED_LOST],
            Status.OK,
        ).astype(np.int8)
        noiseless = (variance == 0.0).all(axis=1) & valid.any(axis=1)
        return cls(shown, covariance, valid, status, noiseless)

    def status(self) -> NDArray[np.int8]:
        """Of all samples together before anything is fitted, shape (W,).

        A wavelength with fewer than three captures, or without any of the panels, counts as
        masked: priors alone would answer.
        """
        count = len(self.value)
        usable = self.valid.reshape(count, -1, 3)
        few = self.valid.sum(axis=1) < LEAST_CAPTURES
        few |= ~usable[:, :, :2].any(axis=(1, 2))
        seen = usable[:, :, 2].T
        lost = (self.sample_status == Status.COLLIMATED_LOST) | ~seen
        found = np.where(lost.all(axis=0) & seen.any(axis=0), Status.COLLIMATED_LOST, Status.OK)
        found[(self.sample_status == Status.CONTRADICTORY).any(axis=0)] = Status.CONTRADICTORY
        found[few] = Status.MASKED
        return np.asarray(found, dtype=np.int8)

    def with_error(self, captures: FloatArray, relative_error: FloatArray) -> FloatArray:
        """Covariance with the engine's own error at captures (W, M), shape (W, M, M)."""
        error = np.hypot(relative_error.reshape(-1) * captures, FLOOR)
        return np.asarray(self.covariance + error[:, :, None] ** 2 * np.eye(captures.shape[1]))
