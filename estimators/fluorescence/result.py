"""What an estimator of Donaldson matrices returns, and what became of the estimate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from estimators.result import QUANTILE_LEVELS
from estimators.status import ExplainedStatus
from twin.fluorescence.donaldson import DonaldsonMatrix
from twin.fluorescence.system import FluorescenceData
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from twin.fluorescence.mixture import MixtureModel

BoolArray = NDArray[np.bool_]
LEVELS = QUANTILE_LEVELS[[2, 5, 8]]
"""Levels of the quantiles that every result stores: 0.05, 0.5, 0.95."""


class FluorescenceStatus(ExplainedStatus):
    """What became of one matrix; the greater, the worse."""

    OK = (
        0,
        "The captures determine the matrix.",
        "Nothing needs to be done.",
    )
    NO_FLUORESCENCE_SEEN = (
        1,
        "No cell of the fluorescence differs from zero by more than its interval.",
        "If fluorescence is expected, use stronger or shorter-wavelength illuminants and average "
        "more captures.",
    )
    NO_NOISE_STATED = (
        2,
        "Captures came with a stated noise of zero; a thousandth of the brightest capture was "
        "assumed instead.",
        "State the variance, or repeat the captures.",
    )
    UNDETERMINED_CELLS = (
        3,
        "Some cells are hardly seen by any pair of illuminant and channel: their value and their "
        "wide interval come from the prior.",
        "Add an illuminant or a channel in the region that is marked undetermined.",
    )
    MASKED = (
        4,
        "Some captures could not be used.",
        "See the counted reasons: shorten exposures that saturated, lengthen dark ones.",
    )
    INCONSISTENT = (
        5,
        "No matrix of the model explains the captures within their noise; the interval was "
        "widened.",
        "Check the order of the channels, the calibration of the illuminants against the white "
        "(is the white itself fluorescent?) and the stated noise.",
    )
    NOT_CONVERGED = (
        6,
        "The solver or the sampler stopped before it had settled.",
        "Allow more steps.",
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class FluorescenceResult:
    """A Donaldson matrix [emission, excitation] in energy units with its uncertainty.

    Wo emission rows, Wi excitation columns, D diagonal cells. Cells below the diagonal (emission
    shorter than excitation) are exactly 0.
    """

    estimator: str
    sample: str
    emission_nm: FloatArray
    """Wavelengths [nm] of the rows, shape (Wo,)."""
    excitation_nm: FloatArray
    """Wavelengths [nm] of the columns, shape (Wi,)."""
    matrix: FloatArray
    """The estimate, shape (Wo, Wi); its diagonal is the reflectance."""
    standard_deviation: FloatArray
    """Of every cell, shape (Wo, Wi); NaN where the estimator has none."""
    quantile_level: FloatArray
    """Levels of the quantiles, shape (Q,)."""
    quantile: FloatArray
    """Quantiles of every cell, shape (Q, Wo, Wi); NaN where the estimator has none."""
    undetermined: BoolArray
    """Cells that the captures hardly say anything about, shape (Wo, Wi)."""
    status: FluorescenceStatus
    residual: FloatArray
    """Predicted minus captured, shape (J, K); NaN where masked."""
    residual_normalised: FloatArray
    """The same in the standard deviations of the captures, shape (J, K)."""
    settings: Mapping[str, str | int | float]
    fingerprint: str
    """SHA-256 of everything that went in."""
    messages: tuple[str, ...] = ()
    statistics: Mapping[str, float] = field(default_factory=dict)
    draws: FloatArray | None = None
    """Equally weighted posterior draws of the matrix, shape (D, Wo, Wi), or None."""
    mixture: MixtureModel | None = None
    """Gaussians and moments, where the estimator fitted those; `export.mixture_of` makes them
    of any other result."""
    mixture_draws: FloatArray | None = None
    """Draws of (weight, excitation, emission, two variances) of M Gaussians, relabelled so that a
    Gaussian keeps its index, shape (D, M, 5), or None."""
    moment_draws: FloatArray | None = None
    """Draws of the MESE moments of the diagonal, shape (D, 8), or None."""

    @property
    def is_diagonal(self) -> BoolArray:
        """Which cells are the reflectance, shape (Wo, Wi)."""
        return np.asarray(np.abs(self.emission_nm[:, None] - self.excitation_nm) < 1e-6)

    @property
    def is_fluorescence(self) -> BoolArray:
        """Which cells can hold fluorescence (emission longer than excitation), (Wo, Wi)."""
        return np.asarray(self.emission_nm[:, None] > self.excitation_nm + 1e-6)

    @cached_property
    def interval(self) -> FloatArray:
        """The 90 % interval of every cell, (2, Wo, Wi): lower, upper.

        Between the 0.05 and 0.95 quantiles, but where one of them lies at a bound that a matrix
        has (a cell of 0, a reflectance of 1) from that bound on: a tenth of the draws lies
        outside either way. Without draws the outermost stored quantiles.
        """
        if self.draws is None:
            return np.asarray(self.quantile[[0, -1]])
        low, ten, ninety, high = np.quantile(self.draws, (0.05, 0.1, 0.9, 0.95), axis=0)
        zero, one = low <= 0.0, self.is_diagonal & (high >= 1.0)
        return np.stack([np.where(one & ~zero, ten, low), np.where(zero & ~one, ninety, high)])

    @property
    def reflectance(self) -> FloatArray:
        """The diagonal, shape (D,)."""
        return np.asarray(self.matrix[self.is_diagonal])

    @property
    def reflectance_band(self) -> FloatArray:
        """The outermost stored quantiles of the diagonal, shape (2, D): lower, upper."""
        return np.asarray(self.quantile[[0, -1]][:, self.is_diagonal])

    @property
    def fluorescence(self) -> FloatArray:
        """The matrix without its diagonal, shape (Wo, Wi)."""
        return np.where(self.is_diagonal, 0.0, self.matrix)

    @property
    def donaldson(self) -> DonaldsonMatrix:
        """The estimate as a Donaldson matrix of the twin."""
        return DonaldsonMatrix(
            self.matrix, self.emission_nm, self.excitation_nm,
            name=self.sample, source=self.estimator,
        )  # fmt: skip

    def quantiles_of(self, quantity: FloatArray) -> FloatArray:
        """The stored levels' quantiles of a quantity that was computed of every draw.

        Args:
            quantity: shape (D, ...), for example colours of `reflected(light)`.

        Returns:
            Shape (Q, ...).
        """
        return np.asarray(np.quantile(quantity, self.quantile_level, axis=0))

    def reflected(self, light: FloatArray) -> FloatArray:
        """Energy per emission bin under light (Wi,) for every draw, shape (D, Wo).

        Without draws the estimate itself, shape (1, Wo).
        """
        cells = self.matrix[None] if self.draws is None else self.draws
        return np.asarray(cells @ np.asarray(light, dtype=np.float64))


@runtime_checkable
class FluorescenceEstimator(Protocol):
    """Captures in, Donaldson matrix with uncertainty out."""

    @property
    def name(self) -> str:
        """Name in the registry and in reports."""
        ...

    def estimate(self, data: FluorescenceData) -> FluorescenceResult:
        """Estimate the matrix behind the captures of one sample.

        Raises:
            twin.errors.InputError: captures that cannot be used.
        """
        ...

    def estimate_batch(self, data: list[FluorescenceData]) -> list[FluorescenceResult]:
        """Estimate several samples of one set-up together."""
        ...
