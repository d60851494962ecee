"""Coordinates without bounds for (albedo, sigma_t, g), and intervals that keep the bounds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from estimators.result import QUANTILE_LEVELS, normal_deviate
from twin.spectra import FloatArray

ROOM = 2.0
"""Standard deviations between an estimate and its bound below which the bound is felt."""


@dataclass(frozen=True)
class Coordinates:
    """(logit albedo, ln sigma_t, logit of g in its range); sigma_t in 1/mm.

    The logits run over the open intervals (0, 1) and `g_range`.
    """

    g_range: tuple[float, float] = (-1.0, 1.0)

    @property
    def low(self) -> FloatArray:
        """Lower bounds, (3,)."""
        return np.array([0.0, 0.0, self.g_range[0]])

    @property
    def high(self) -> FloatArray:
        """Upper bounds, (3,)."""
        return np.array([1.0, np.inf, self.g_range[1]])

    def natural(self, place: Any, xp: Any = np) -> tuple[Any, Any]:
        """(albedo, sigma_t, g) and their slopes by the coordinates, both (..., 3).

        Args:
            place: coordinates, (..., 3).
            xp: numpy, or jax.numpy inside a program.
        """
        low, high = self.g_range
        # a wavelength without captures has no place
        with np.errstate(invalid="ignore"):
            share = xp.exp(-xp.logaddexp(0.0, -place))
            other = xp.exp(-xp.logaddexp(0.0, place))
            sigma_t = xp.exp(place[..., 1])
        value = [share[..., 0], sigma_t, low + (high - low) * share[..., 2]]
        slope = [
            share[..., 0] * other[..., 0],
            sigma_t,
            (high - low) * share[..., 2] * other[..., 2],
        ]
        return xp.stack(value, axis=-1), xp.stack(slope, axis=-1)

    def place(self, natural: FloatArray) -> FloatArray:
        """Coordinates of (albedo, sigma_t, g) inside the bounds, (..., 3)."""
        low, high = self.g_range
        albedo, sigma_t, g = np.moveaxis(np.asarray(natural, dtype=np.float64), -1, 0)
        share = (g - low) / (high - low)
        return np.stack(
            [np.log(albedo / (1 - albedo)), np.log(sigma_t), np.log(share / (1 - share))], axis=-1
        )

    def quantiles(
        self, place: FloatArray, centre: FloatArray, covariance: FloatArray
    ) -> FloatArray:
        """Quantiles at `QUANTILE_LEVELS` that stay inside the bounds, (Q, W, 3).

        Away from bounds the estimate is Gaussian in the coordinates. Within `ROOM` standard
        deviations of a bound the coordinates stretch without end; there the likelihood is taken
        as Gaussian in the parameter itself, in two ways: clipped to the bounds, which covers as
        often as it says but may shrink to the bound, and cut off at the bound (the posterior
        under a uniform prior; Gelman et al. 2013, Bayesian Data Analysis, 2.8), which never
        shrinks but excludes the bound. The outer of both is taken on either side.

        Args:
            place: coordinates of the estimate, (W, 3).
            centre: (albedo, sigma_t, g) where the linearised captures fit best, bounds ignored.
            covariance: of (albedo, sigma_t, g), (W, 3, 3).
        """
        from scipy.special import log_ndtr, ndtri_exp

        value, slope = self.natural(place)
        spread = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
        deviate = normal_deviate(QUANTILE_LEVELS)[:, None, None]
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
            safe = np.maximum(slope, 1e-300)
            smooth, _ = self.natural(place + deviate * (spread / safe))
            near = (value - self.low < ROOM * spread) | (self.high - value < ROOM * spread)
            near[:, 1] = value[:, 1] < ROOM * spread[:, 1]
            # in whichever tail the interval lies, so that nothing rounds to 0 or 1
            left, right = (self.low - centre) / spread, (self.high - centre) / spread
            flip = left > 0.0
            first = np.where(flip, -right, left)
            last = np.where(flip, -left, right)
            level = QUANTILE_LEVELS[:, None, None]
            level = np.where(flip, 1.0 - level, level)
            inner, outer = log_ndtr(first), log_ndtr(last)
            log_level = outer + np.log(level + (1.0 - level) * np.exp(inner - outer))
            at = ndtri_exp(log_level)
            cut = centre + spread * np.where(flip, -at, at)
        cut = np.minimum(np.maximum(cut, self.low), self.high)
        clipped = np.minimum(np.maximum(centre + deviate * spread, self.low), self.high)
        outer_of_both = np.where(deviate < 0.0, np.minimum(cut, clipped), np.maximum(cut, clipped))
        outer_of_both = np.where(deviate == 0.0, cut, outer_of_both)
        return np.asarray(np.where(near, outer_of_both, smooth))
