"""What every estimator returns: the material by wavelength, how sure, and why not surer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from estimators.status import ExplainedStatus
from twin.spectra import FloatArray

PARAMETERS = ("albedo", "sigma_t_per_mm", "g")
"""Order of the parameters along every axis of length three."""
CAPTURES = ("black", "white", "collimated")
"""Order of the captures along every axis of length three."""


class Status(ExplainedStatus):
    """What became of one wavelength; the greater, the worse."""

    OK = (
        0,
        "The captures determine the material.",
        "Nothing needs to be done.",
    )
    NO_NOISE_STATED = (
        1,
        "The captures come with a stated uncertainty of zero, so the interval holds only the "
        "errors of the map.",
        "State sigma in relative.csv, or repeat the captures.",
    )
    AT_BOUND = (
        2,
        "The estimate lies on the border of the range that was searched.",
        "Compute an appearance map with a wider range; if the border is a physical one "
        "(albedo 0 or 1), average more captures.",
    )
    NOT_IDENTIFIABLE = (
        3,
        "The captures hardly depend on at least one parameter here: no scattering (g has no "
        "meaning), or no light comes back.",
        "Use the parameters marked identifiable; add a sample of another thickness for the rest.",
    )
    INCONSISTENT = (
        4,
        "The samples disagree by more than their uncertainty: the interval was widened, or a "
        "sample whose captures no material gives was left out.",
        "Measure the thickness where the light passes and check that all samples are of one "
        "material; then look for an effect that the bench description lacks.",
    )
    COLLIMATED_LOST = (
        5,
        "The collimated light drowns in noise, so sigma_t has only a lower bound.",
        "Measure a thinner sample, or raise the integration time and the averages of the "
        "collimated capture.",
    )
    OUTSIDE_MAP = (
        6,
        "No material of the appearance map gives these captures; the nearest one is shown.",
        "Check thickness, refractive index, references and backgrounds against the bench "
        "description, or compute a map with a wider range.",
    )
    CONTRADICTORY = (
        7,
        "The captures contradict each other: darker over white than over black, or more light "
        "behind the sample than without it.",
        "Check that captures and references were not swapped and share their integration time.",
    )
    MASKED = (
        8,
        "No sample has all the captures that the estimator needs here.",
        "See the counted reasons: shorten the exposure where it saturated, lengthen it where "
        "the reference is dark.",
    )
    NOT_CONVERGED = (
        9,
        "The solver stopped before it had settled.",
        "Allow more steps, or start from the appearance map.",
    )

    @property
    def has_value(self) -> bool:
        """Whether the estimate at this wavelength is one, and not the nearest or none."""
        return self < Status.OUTSIDE_MAP


@dataclass(frozen=True, eq=False, kw_only=True)
class EstimateResult:
    """Optical properties by wavelength with their uncertainty (S samples, W wavelengths).

    A value that an estimator does not determine is NaN. Where `status` is OUTSIDE_MAP the
    values are those of the nearest material and their covariance is NaN.
    """

    estimator: str
    wavelength_nm: FloatArray
    """Wavelengths [nm], shape (W,)."""
    albedo: FloatArray
    """Single-scattering albedo, all samples together, shape (W,)."""
    sigma_t_per_mm: FloatArray
    """Extinction coefficient [1/mm], shape (W,)."""
    g: FloatArray
    """Anisotropy factor, shape (W,)."""
    covariance: FloatArray
    """Covariance of (albedo, sigma_t, g), shape (W, 3, 3)."""
    quantile_level: FloatArray
    """Levels of the quantiles, shape (Q,)."""
    quantile: FloatArray
    """Quantiles of every parameter, shape (Q, W, 3)."""
    identifiable: NDArray[np.bool_]
    """Whether the captures determine the parameter, shape (W, 3)."""
    status: NDArray[np.int8]
    """Code of `Status`, shape (W,)."""
    sample_names: tuple[str, ...]
    thickness_mm: FloatArray
    """Thickness of every sample [mm], shape (S,)."""
    sample_estimate: FloatArray
    """Parameters from one sample alone, shape (S, W, 3)."""
    sample_status: NDArray[np.int8]
    """Code of `Status` for one sample alone, shape (S, W)."""
    distance: FloatArray
    """Distance of the measured (I_black, I_white, ln I_collimated) to the map, shape (S, W);
    0 inside, NaN where masked or where the estimator has no map."""
    residual: FloatArray
    """Predicted minus measured captures, shape (S, 3, W)."""
    residual_normalised: FloatArray
    """The same in standard deviations, engine errors included, shape (S, 3, W)."""
    beer_sigma_t_per_mm: FloatArray
    """Extinction coefficient [1/mm] from the collimated capture alone, shape (S, W)."""
    beer_standard_error_per_mm: FloatArray
    """Its standard error [1/mm], shape (S, W)."""
    settings: Mapping[str, str | int | float]
    fingerprint: str
    """SHA-256 of everything that went in."""
    messages: tuple[str, ...] = ()
    """What was masked and found odd, counted."""
    statistics: Mapping[str, FloatArray] = field(default_factory=dict)
    """What the solver says of itself by wavelength (steps, chi-square, effective sample size),
    shape (W,) each."""
    draws: FloatArray | None = None
    """Equally weighted posterior draws of (albedo, sigma_t, g), shape (D, W, 3); a draw belongs
    together over wavelengths where the estimator fits them jointly. None: no draws."""

    @property
    def parameters(self) -> FloatArray:
        """(albedo, sigma_t, g), shape (W, 3)."""
        return np.stack([self.albedo, self.sigma_t_per_mm, self.g], axis=-1)

    @property
    def standard_error(self) -> FloatArray:
        """Standard errors of (albedo, sigma_t, g), shape (W, 3)."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2)))

    def interval(self, coverage: float) -> FloatArray:
        """Central intervals of every parameter, shape (2, W, 3): lower, upper.

        Interpolated between the stored quantiles.

        Raises:
            ValueError: a coverage that the stored quantiles do not reach.
        """
        tails = np.array([0.5 - coverage / 2, 0.5 + coverage / 2])
        levels = self.quantile_level
        if not (0.0 < coverage < 1.0 and levels[0] <= tails[0] + 1e-12):
            raise ValueError(
                f"found a coverage of {coverage:g}; expected it above 0 and at most"
                f" {levels[-1] - levels[0]:g}, which the stored quantiles reach"
            )
        # In units of the normal deviate a Gaussian's quantiles lie on a line.
        known = normal_deviate(levels)
        index = np.clip(np.searchsorted(levels, tails, side="right") - 1, 0, levels.size - 2)
        share = (normal_deviate(tails) - known[index]) / (known[index + 1] - known[index])
        low, high = self.quantile[index], self.quantile[index + 1]
        return np.asarray(low + share[:, None, None] * (high - low))

    def counts(self) -> dict[str, int]:
        """Number of wavelengths by name of their status, the most frequent first."""
        codes, number = np.unique(self.status, return_counts=True)
        pairs = sorted(zip(number.tolist(), codes.tolist(), strict=True), reverse=True)
        return {Status(code).name.lower(): count for count, code in pairs}


def normal_deviate(level: FloatArray) -> FloatArray:
    """Standard normal quantiles of levels inside 0 to 1, shape (...)."""
    normal = NormalDist()
    return np.array([normal.inv_cdf(min(max(float(p), 1e-12), 1 - 1e-12)) for p in level])


QUANTILE_LEVELS = np.array(
    [0.005, 0.025, 0.05, 0.1587, 0.25, 0.5, 0.75, 0.8413, 0.95, 0.975, 0.995]
)
"""Levels of the quantiles that every result stores."""


def gaussian_quantiles(mean: FloatArray, standard_error: FloatArray) -> FloatArray:
    """Quantiles at `QUANTILE_LEVELS` of normal distributions, shape (Q, ...)."""
    deviate = normal_deviate(QUANTILE_LEVELS).reshape(-1, *([1] * mean.ndim))
    return np.asarray(mean + deviate * standard_error)
