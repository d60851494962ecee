"""What the estimator for integrating spheres returns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from estimators.result import Status
from twin.spectra import FloatArray


@dataclass(frozen=True, eq=False, kw_only=True)
class SphereEstimate:
    """Optical properties by row of a visit with spheres (W rows, in the order of the file).

    A value that the readings do not determine is NaN. `status` holds codes of
    `estimators.result.Status`; its texts speak of captures, `messages` of this visit.
    """

    estimator: str
    source: str
    """The file, or what the visit was called."""
    wavelength_nm: FloatArray
    """Wavelengths [nm], shape (W,); NaN where the file has none."""
    albedo: FloatArray
    """Single-scattering albedo, shape (W,)."""
    sigma_t_per_mm: FloatArray
    """Extinction coefficient [1/mm], shape (W,)."""
    g: FloatArray
    """Anisotropy factor, found or held, shape (W,)."""
    g_held: NDArray[np.bool_]
    """Whether g was held and not found, shape (W,)."""
    covariance: FloatArray
    """Covariance of (albedo, sigma_t, g), shape (W, 3, 3); 0 for a held g."""
    identifiable: NDArray[np.bool_]
    """Whether the readings determine the parameter, shape (W, 3)."""
    status: NDArray[np.int8]
    """Code of `Status`, shape (W,)."""
    value: FloatArray
    """The readings M_R, M_T, M_U, shape (W, 3)."""
    sigma: FloatArray
    """Standard deviation given to each reading, shape (W, 3)."""
    fitted: FloatArray
    """The readings of the estimate, shape (W, 3)."""
    settings: Mapping[str, str | int | float | bool]
    messages: tuple[str, ...] = ()
    statistics: Mapping[str, FloatArray] = field(default_factory=dict)
    """Steps, chi-square and lost light by row, shape (W,) each."""

    @property
    def mu_a_per_mm(self) -> FloatArray:
        """Absorption coefficient [1/mm], shape (W,)."""
        return np.asarray((1.0 - self.albedo) * self.sigma_t_per_mm)

    @property
    def mu_s_per_mm(self) -> FloatArray:
        """Scattering coefficient [1/mm], shape (W,)."""
        return np.asarray(self.albedo * self.sigma_t_per_mm)

    @property
    def mu_s_prime_per_mm(self) -> FloatArray:
        """Reduced scattering coefficient mu_s (1 - g) [1/mm], shape (W,)."""
        return np.asarray(self.mu_s_per_mm * (1.0 - self.g))

    @property
    def residual(self) -> FloatArray:
        """Fitted minus measured readings, shape (W, 3)."""
        return np.asarray(self.fitted - self.value)

    @property
    def standard_error(self) -> FloatArray:
        """Standard errors of (albedo, sigma_t, g), shape (W, 3)."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2)))

    def derived_standard_error(self) -> FloatArray:
        """Standard errors of (mu_a, mu_s, mu_s') [1/mm] to first order, shape (W, 3)."""
        albedo, sigma, g = self.albedo, self.sigma_t_per_mm, self.g
        zero = np.zeros_like(albedo)
        slopes = np.stack(
            [
                np.stack([-sigma, 1.0 - albedo, zero], axis=-1),
                np.stack([sigma, albedo, zero], axis=-1),
                np.stack([sigma * (1 - g), albedo * (1 - g), -albedo * sigma], axis=-1),
            ],
            axis=1,
        )
        variance = np.einsum("wik,wkl,wil->wi", slopes, self.covariance, slopes)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))

    def counts(self) -> dict[str, int]:
        """Number of rows by name of their status, the most frequent first."""
        codes, number = np.unique(self.status, return_counts=True)
        pairs = sorted(zip(number.tolist(), codes.tolist(), strict=True), reverse=True)
        return {Status(code).name.lower(): count for count, code in pairs}
