"""Standard errors of albedo, sigma_t and g from Fisher information, and what they mean."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.least_squares_settings import LeastSquaresSettings
from scenarios.explore.source import Spectrum
from twin.spectra import FloatArray

PARAMETERS = ("albedo", "sigma_t_per_mm", "g")
WORDS = ("albedo", "σt", "g")
SPAN = np.array([1.0, np.log(100.0), 2.0])
"""Ranges of albedo, ln sigma_t and g against which an interval is wide (as in least squares)."""
NINETY = 2.0 * 1.6449
TRADES_OFF = 0.95
"""Correlation from which two parameters are said to trade off."""
WHY = (
    "the captures hardly depend on it: little light comes back",
    "no collimated light arrives, and the reflectances do not tell",
    "there is too little scattering, or so much that the direction is forgotten",
)


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """What the captures tell of the material.

    Attributes:
        standard_error: of albedo, sigma_t [1/mm] and g, shape (W, 3).
        correlation: between them, shape (W, 3, 3).
        determined: whether the 90 % interval says something, shape (W, 3).
        beam: collimated light over its standard error in the sample where it is largest, (W,).
    """

    standard_error: FloatArray
    correlation: FloatArray
    determined: NDArray[np.bool_]
    beam: FloatArray

    def sentences(self, index: int) -> tuple[str, ...]:
        """What is not identifiable at one wavelength, in words; at least one sentence."""
        said = [
            f"{word} is not determined: {why}."
            for word, why, known in zip(WORDS, WHY, self.determined[index], strict=True)
            if not known
        ]
        if self.beam[index] < LeastSquaresSettings().lost_sigma:
            said.append("The collimated beam drowns in noise in every sample that is used.")
        for one, other in ((0, 1), (0, 2), (1, 2)):
            together = float(self.correlation[index, one, other])
            if abs(together) >= TRADES_OFF:
                said.append(
                    f"{WORDS[one]} and {WORDS[other]} trade off (correlation {together:+.2f}):"
                    " together they are known better than each."
                )
        return tuple(said) or ("The captures determine all three.",)


def uncertainty_of(
    spectrum: Spectrum, captures: FloatArray, slopes: FloatArray, covariance: FloatArray
) -> Uncertainty:
    """Standard errors from the Fisher information of Gaussian noise, at each wavelength alone.

    In albedo, ln sigma_t and g, with a prior as wide as their ranges, so that what the captures
    do not tell comes out as wide as the range and not as infinity.

    Args:
        spectrum: the material.
        captures: expected relative intensities, shape (W, S, 3).
        slopes: their derivatives by albedo, sigma_t and g, shape (W, S, 3, 3).
        covariance: of each sample's captures, shape (W, S, 3, 3).
    """
    sigma_t = spectrum.sigma_t_per_mm
    ones = np.ones_like(sigma_t)
    moved = slopes * np.stack([ones, sigma_t, ones], axis=-1)[:, None, None, :]
    information = np.einsum("wscp,wscq->wpq", moved, np.linalg.solve(covariance, moved))
    found = np.linalg.inv(information + np.diag(1.0 / SPAN**2))
    error = np.sqrt(np.diagonal(found, axis1=1, axis2=2))
    share = LeastSquaresSettings().unidentifiable_share
    beam = captures[..., 2] / np.sqrt(covariance[..., 2, 2])
    natural = error.copy()
    natural[:, 1] *= sigma_t
    return Uncertainty(
        natural,
        found / (error[:, :, None] * error[:, None, :]),
        NINETY * error <= share * SPAN,
        np.asarray(beam.max(axis=1)),
    )
