"""The estimator `donaldson-both`: the fit and the network of one prior, averaged.

    matrix = 0.7 donaldson + 0.3 donaldson-learned

The fit comes to modes, and errs with the candidates that it chose; the network to a mean, and errs
as networks do. They share only a part of their errors, so that the mean of both (Bates and Granger
1969) is nearer the truth than either where materials are no clean sums of products, and as near as
the fit where they are. Draws are those of the fit, moved with it; what is exactly 0 stays 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from estimators.fluorescence.cells import fingerprint
from estimators.fluorescence.donaldson import DonaldsonEstimator, DonaldsonSettings
from estimators.fluorescence.learned import DonaldsonLearnedEstimator, DonaldsonLearnedSettings
from estimators.fluorescence.quick import deviation_of
from estimators.fluorescence.result import FluorescenceResult
from twin.errors import InputError
from twin.fluorescence.system import FluorescenceData


@dataclass(frozen=True, kw_only=True)
class DonaldsonBothSettings:
    """Options of the estimator `donaldson-both`."""

    share: float = 0.3
    """Weight of the network, 0 to 1; from generated matrices."""
    seed: int = 1
    """Of the draws."""
    fit: DonaldsonSettings = field(default_factory=DonaldsonSettings)
    network: DonaldsonLearnedSettings = field(default_factory=DonaldsonLearnedSettings)

    def __post_init__(self) -> None:
        if isinstance(self.share, bool) or not 0.0 <= self.share <= 1.0:
            raise InputError(f"{self.share!r}", "a number from 0 to 1", place="share")


class DonaldsonBothEstimator:
    """The weighed mean of the fit and of the network.

    Args:
        settings: options.
        learned: an estimator whose networks are used; a new one by default.
    """

    def __init__(
        self,
        settings: DonaldsonBothSettings | None = None,
        learned: DonaldsonLearnedEstimator | None = None,
    ) -> None:
        self._settings = own = settings or DonaldsonBothSettings()
        self._fit = DonaldsonEstimator(replace(own.fit, seed=own.seed))
        self._learned = learned or DonaldsonLearnedEstimator(own.network)

    @property
    def name(self) -> str:
        """Name in the registry and in reports."""
        return "donaldson-both"

    @property
    def report(self) -> Callable[[float, float], None]:
        """Told how much of a training is done, of how much."""
        return self._learned.report

    @report.setter
    def report(self, told: Callable[[float, float], None]) -> None:
        self._learned.report = told

    def estimate(self, data: FluorescenceData) -> FluorescenceResult:
        """Estimate one matrix, with the network of an earlier sample where it serves.

        Raises:
            InputError: captures that cannot be used.
        """
        return self.estimate_batch([data])[0]

    def estimate_batch(self, data: list[FluorescenceData]) -> list[FluorescenceResult]:
        """Estimate several; a network is trained for all samples like the first that needs one.

        Raises:
            InputError: captures that cannot be used.
        """
        fitted = self._fit.estimate_batch(data)
        learned = self._learned.estimate_batch(data)
        return [self._mean(*each) for each in zip(data, fitted, learned, strict=True)]

    def _mean(
        self, data: FluorescenceData, fitted: FluorescenceResult, learned: FluorescenceResult
    ) -> FluorescenceResult:
        step = self._settings.share * (learned.matrix - fitted.matrix)
        matrix, drawn, quantile = fitted.matrix + step, None, fitted.quantile
        deviation = fitted.standard_deviation
        if fitted.draws is not None:
            drawn = np.where(fitted.draws != 0.0, np.maximum(fitted.draws + step, 0.0), 0.0)
            np.minimum(
                drawn, 1.0, out=drawn, where=np.broadcast_to(fitted.is_diagonal, drawn.shape)
            )
            quantile = np.quantile(drawn, fitted.quantile_level, axis=0)
            deviation = drawn.std(axis=0)
        residual = np.where(data.valid, data.system.captures(matrix) - data.value, np.nan)
        sigma = np.full(data.valid.shape, np.nan)
        sigma[data.valid] = deviation_of(data)
        plain: dict[str, str | int | float] = {
            "share": self._settings.share, "seed": self._settings.seed,
            "fit": str(dict(fitted.settings)), "network": str(dict(learned.settings)),
        }  # fmt: skip
        return replace(
            fitted, estimator=self.name, matrix=matrix, draws=drawn, quantile=quantile,
            standard_deviation=deviation, residual=residual, residual_normalised=residual / sigma,
            settings=plain,
            messages=tuple(dict.fromkeys((*fitted.messages, *learned.messages))),
            fingerprint=fingerprint(data, self.name, {**plain, "learned": learned.fingerprint}),
            statistics={
                **fitted.statistics, "network_chi_square": learned.statistics["chi_square"],
            },
        )  # fmt: skip
