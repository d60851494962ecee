"""Coordinates in which the posterior is sampled, and the priors in them.

Albedo, ln sigma_t and g have uniform priors over ranges. Each is the sigmoid of a natural
coordinate that runs over all numbers, so that nothing has a bound: u = 1 / (1 + exp(-x)), and the
prior density of x is the Jacobian of that map, u (1 - u).

By the similarity relations (Wyman et al. 1989) a sample that scatters much tells first its
reduced albedo a (1 - g) / (1 - a g), whose logit is logit(a) + ln(1 - g). So y_1 = x_1 + ln(1 - g)
stands in place of x_1: what is known well and what is not lie along different axes, and because
the change is a shear it has no Jacobian.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.posterior_settings import PosteriorSettings
from twin.spectra import FloatArray

LEAST_CURVATURE = 0.08
"""Of the prior in its coordinates: in its tails the prior is straight, and Laplace knows no width.
"""


@dataclass(frozen=True, eq=False)
class Coordinates:
    """The map between (albedo, sigma_t, g) and unbounded coordinates y.

    Attributes:
        low, high: ends of the priors of (albedo, ln sigma_t, g), shape (3,).
    """

    low: FloatArray
    high: FloatArray

    @classmethod
    def of(cls, settings: PosteriorSettings) -> Coordinates:
        """The ranges of the settings."""
        ends = np.log([settings.sigma_t_low_per_mm, settings.sigma_t_high_per_mm])
        return cls(
            np.array([0.0, ends[0], settings.g_low]), np.array([1.0, ends[1], settings.g_high])
        )

    def natural(self, y: FloatArray) -> FloatArray:
        """Natural coordinates x of coordinates y, both (..., 3)."""
        x = np.array(y, dtype=np.float64)
        x[..., 0] -= np.log(1.0 - self._g(y))
        return x

    def share(self, y: FloatArray) -> FloatArray:
        """Position in the prior range, 0 to 1, of coordinates (..., 3)."""
        return _sigmoid(self.natural(y))

    def material(self, y: FloatArray) -> FloatArray:
        """(albedo, sigma_t [1/mm], g) of coordinates, both (..., 3)."""
        value = self.low + (self.high - self.low) * self.share(y)
        value[..., 1] = np.exp(value[..., 1])
        return np.asarray(value)

    def of_material(self, material: FloatArray) -> FloatArray:
        """Coordinates of (albedo, sigma_t, g), (..., 3); the ends of the ranges are kept off."""
        value = np.array(material, dtype=np.float64)
        value[..., 1] = np.log(np.maximum(value[..., 1], 1e-300))
        u = np.clip((value - self.low) / (self.high - self.low), 1e-6, 1.0 - 1e-6)
        y = np.log(u / (1.0 - u))
        y[..., 0] += np.log(1.0 - self._g(y))
        return np.asarray(y)

    def slopes(self, y: FloatArray) -> FloatArray:
        """d(albedo, sigma_t, g) / dy, shape (..., 3, 3)."""
        u = self.share(y)
        slope = (self.high - self.low) * u * (1.0 - u)
        slope[..., 1] *= self.material(y)[..., 1]
        return np.asarray(slope[..., :, None] * self._shear(y))

    def log_prior(self, y: FloatArray) -> FloatArray:
        """Ln of the prior density of the coordinates, (..., 3) to (...)."""
        size = np.abs(self.natural(y))
        return np.asarray(-(size + 2.0 * np.log1p(np.exp(-size))).sum(axis=-1))

    def prior_gradient(self, y: FloatArray) -> FloatArray:
        """Derivatives of `log_prior`, shape (..., 3)."""
        along = 1.0 - 2.0 * self.share(y)
        return np.asarray(np.einsum("...i,...ij->...j", along, self._shear(y)))

    def prior_precision(self, y: FloatArray) -> FloatArray:
        """Curvature of minus `log_prior` with a floor, without that of the shear, (..., 3, 3)."""
        u = self.share(y)
        curvature = np.maximum(2.0 * u * (1.0 - u), LEAST_CURVATURE)
        shear = self._shear(y)
        return np.asarray(np.einsum("...i,...ij,...ik->...jk", curvature, shear, shear))

    def _g(self, y: FloatArray) -> FloatArray:
        return np.asarray(self.low[2] + (self.high[2] - self.low[2]) * _sigmoid(y[..., 2]))

    def _shear(self, y: FloatArray) -> FloatArray:
        """Dx / dy, shape (..., 3, 3)."""
        u = _sigmoid(y[..., 2])
        shear = np.zeros((*y.shape, 3))
        shear[...] = np.eye(3)
        shear[..., 0, 2] = (self.high[2] - self.low[2]) * u * (1.0 - u) / (1.0 - self._g(y))
        return shear


def _sigmoid(x: FloatArray) -> FloatArray:
    from scipy.special import expit

    return np.asarray(expit(x))


def coarse(values: FloatArray, bits: int = 12) -> FloatArray:
    """Values rounded to so many binary digits: what depends on them forgets their last bits."""
    mantissa, exponent = np.frexp(values)
    return np.asarray(np.ldexp(np.round(np.ldexp(mantissa, bits)), exponent - bits))


def wavelength_stream(seed: int, wavelength_nm: float, purpose: int) -> np.random.Generator:
    """Random numbers of one wavelength [nm], whatever else is measured; other purposes, others."""
    bits = int(np.float64(wavelength_nm).view(np.uint64))
    return np.random.Generator(
        np.random.Philox(key=[seed, 0x706F7374], counter=[0, 0, bits, purpose])
    )


def random_state(stream: np.random.Generator) -> np.random.RandomState:
    """The generator that emcee wants, seeded from a stream."""
    seeds: NDArray[np.uint32] = stream.integers(0, 2**32, 8, dtype=np.uint32)
    return np.random.RandomState(seeds)
