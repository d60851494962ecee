"""Scores of an estimator against the truth: bias, spread, coverage, failures."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.spectra import FloatArray

PARAMETERS = ("albedo", "sigma_t_per_mm", "g")
COVERAGES = (0.5, 0.9, 0.95)
"""Coverages of the intervals that are checked."""
FAR_SIGMA = 5.0
"""An estimate further from the truth than so many stated standard errors was overconfident."""
RAISED = -1
"""Status of points whose estimator raised an exception."""
WILSON_Z = 1.959963984540054
"""Normal deviate of the 95 % interval of a counted share."""


@dataclass(frozen=True, eq=False)
class Answers:
    """What one estimator said of N points.

    Attributes:
        value: (albedo, sigma_t [1/mm], g), shape (N, 3); NaN: no value.
        sigma: stated standard errors, shape (N, 3).
        interval: lower and upper ends at `COVERAGES`, shape (3, 2, N, 3); NaN: none stated.
        identifiable: whether the estimator claims to know the parameter, shape (N, 3).
        status: code of `estimators.Status`, or `RAISED`, shape (N,).
    """

    value: FloatArray
    sigma: FloatArray
    interval: FloatArray
    identifiable: NDArray[np.bool_]
    status: NDArray[np.int64]

    def __len__(self) -> int:
        """Number of points."""
        return len(self.value)

    @property
    def answered(self) -> NDArray[np.bool_]:
        """Points with a status that carries an estimate, shape (N,)."""
        from estimators import Status

        good = [int(status) for status in Status if status.has_value]
        return np.asarray(np.isin(self.status, good))

    @property
    def claimed(self) -> NDArray[np.bool_]:
        """Values that the estimator gives and claims to be determined, shape (N, 3)."""
        return np.asarray(self.answered[:, None] & self.identifiable & np.isfinite(self.value))


@dataclass(frozen=True)
class Share:
    """A counted share with its 95 % interval (Wilson 1927)."""

    count: int
    total: int

    @property
    def value(self) -> float:
        """The share; NaN of none."""
        return self.count / self.total if self.total else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """Ends of its 95 % interval; 0 and 1 of none."""
        if not self.total:
            return 0.0, 1.0
        square = WILSON_Z**2 / self.total
        centre = (self.value + square / 2) / (1 + square)
        half = math.sqrt(self.value * (1 - self.value) * square + square**2 / 4) / (1 + square)
        return max(0.0, centre - half), min(1.0, centre + half)

    def plain(self) -> dict[str, Any]:
        """As JSON holds it."""
        low, high = self.interval
        return {
            "share": self.value,
            "low": low,
            "high": high,
            "count": self.count,
            "total": self.total,
        }


@dataclass(frozen=True)
class ParameterScore:
    """One parameter over all points; errors of sigma_t are relative, of albedo and g absolute.

    Attributes:
        claimed: points at which the estimator claims to know the parameter; bias, spread,
            coverage and overconfidence are over these.
        bias: median error; bias_error: its standard error.
        spread: half the width of the central 68.27 % of the errors.
        median_error: median absolute error where claimed.
        median_error_all: the same over all points, one without a value counting as infinite.
        z_spread: the spread in stated standard errors; 1 where they are right.
        coverage: of the intervals at `COVERAGES`.
        without_interval: claimed points without an interval of 90 %.
        overconfident: claimed points further than 5 stated standard errors from the truth.
    """

    claimed: int
    bias: float
    bias_error: float
    spread: float
    median_error: float
    median_error_all: float
    z_spread: float
    coverage: tuple[Share, ...]
    without_interval: int
    overconfident: Share

    @property
    def verdict(self) -> str:
        """What the 90 % intervals are, as far as the number of points can tell."""
        share = self.coverage[COVERAGES.index(0.9)]
        low, high = share.interval
        if not share.total:
            return "none"
        return "too narrow" if high < 0.9 else "too wide" if low > 0.9 else "right"


@dataclass(frozen=True)
class Score:
    """What an estimator is worth on some points.

    Attributes:
        points: N; answered: those with an estimate.
        status: points by the name of their status, the most frequent first.
        parameters: by name.
        overconfident: points at which any claimed parameter is further than 5 stated standard
            errors from the truth, of all points.
    """

    points: int
    answered: int
    status: Mapping[str, int]
    parameters: Mapping[str, ParameterScore]
    overconfident: Share

    def plain(self) -> dict[str, Any]:
        """As JSON holds it."""
        return {
            "points": self.points,
            "answered": self.answered,
            "status": dict(self.status),
            "overconfident": self.overconfident.plain(),
            "parameters": {name: _plain(score) for name, score in self.parameters.items()},
        }


def _plain(score: ParameterScore) -> dict[str, Any]:
    return {
        "claimed": score.claimed,
        "bias": score.bias,
        "bias_standard_error": score.bias_error,
        "spread": score.spread,
        "median_absolute_error": score.median_error,
        "median_absolute_error_failures_infinite": score.median_error_all,
        "spread_in_stated_errors": score.z_spread,
        "coverage": {
            f"{100 * level:g}": share.plain()
            for level, share in zip(COVERAGES, score.coverage, strict=True)
        },
        "without_interval": score.without_interval,
        "overconfident": score.overconfident.plain(),
        "intervals": score.verdict,
    }


def errors_of(truth: FloatArray, value: FloatArray) -> FloatArray:
    """Estimate minus truth; of sigma_t in units of the truth, shape (N, 3)."""
    return np.asarray((value - truth) / scale_of(truth))


def scale_of(truth: FloatArray) -> FloatArray:
    """What errors are divided by: 1 for albedo and g, sigma_t itself, shape (N, 3)."""
    scale = np.ones_like(truth)
    scale[:, 1] = truth[:, 1]
    return scale


def held_by(truth: FloatArray, answers: Answers, level: int) -> NDArray[np.bool_]:
    """Whether the interval at `COVERAGES[level]` holds the true value, shape (N, 3)."""
    low, high = answers.interval[level]
    return np.asarray((low <= truth) & (truth <= high))


def far_off(truth: FloatArray, answers: Answers) -> NDArray[np.bool_]:
    """Claimed values further than `FAR_SIGMA` stated errors from the truth, shape (N, 3)."""
    distance = np.abs(answers.value - truth)
    return np.asarray(answers.claimed & (distance > FAR_SIGMA * answers.sigma))


def score_of(truth: FloatArray, answers: Answers) -> Score:
    """Score one estimator on N points.

    Args:
        truth: (albedo, sigma_t [1/mm], g), shape (N, 3).
        answers: what it said.
    """
    far = far_off(truth, answers)
    return Score(
        points=len(answers),
        answered=int(answers.answered.sum()),
        status=_status_counts(answers.status),
        parameters={
            name: _parameter(truth, answers, index, far) for index, name in enumerate(PARAMETERS)
        },
        overconfident=Share(int(far.any(axis=1).sum()), len(answers)),
    )


def _parameter(
    truth: FloatArray, answers: Answers, index: int, far: NDArray[np.bool_]
) -> ParameterScore:
    claimed = answers.claimed[:, index]
    error = errors_of(truth, answers.value)[:, index]
    given = answers.answered & np.isfinite(error)
    of_all = np.where(given, np.abs(error), np.inf)
    own = error[claimed]
    with np.errstate(invalid="ignore", divide="ignore"):
        z = (answers.value - truth)[claimed, index] / answers.sigma[claimed, index]
    shares = []
    for level in range(len(COVERAGES)):
        stated = claimed & np.isfinite(answers.interval[level, :, :, index]).all(axis=0)
        held = held_by(truth, answers, level)[:, index]
        shares.append(Share(int((held & stated).sum()), int(stated.sum())))
    count = int(claimed.sum())
    spread = _half_width(own)
    return ParameterScore(
        claimed=count,
        bias=_median(own),
        # Standard error of a median of normal errors: 1.2533 sigma / sqrt(N) (Kenney 1954).
        bias_error=1.2533 * spread / math.sqrt(count) if count else math.nan,
        spread=spread,
        median_error=_median(np.abs(own)),
        median_error_all=_median(of_all, keep_infinite=True),
        z_spread=_half_width(z),
        coverage=tuple(shares),
        without_interval=count - shares[COVERAGES.index(0.9)].total,
        overconfident=Share(int(far[:, index].sum()), count),
    )


def _half_width(values: FloatArray) -> float:
    finite = values[np.isfinite(values)]
    if finite.size == 0:
        return math.nan
    low, high = np.quantile(finite, [0.15865, 0.84135])
    return float(0.5 * (high - low))


def _median(values: FloatArray, *, keep_infinite: bool = False) -> float:
    kept = values[~np.isnan(values)] if keep_infinite else values[np.isfinite(values)]
    if kept.size == 0:
        return math.nan
    # The middle of two values, one of them infinite, is infinite; never NaN.
    ordered = np.sort(kept)
    low, high = ordered[(kept.size - 1) // 2], ordered[kept.size // 2]
    return float(low if low == high else 0.5 * (low + high))


def _status_counts(status: NDArray[np.int64]) -> dict[str, int]:
    codes, counts = np.unique(status, return_counts=True)
    pairs = sorted(zip(counts.tolist(), codes.tolist(), strict=True), key=lambda p: (-p[0], p[1]))
    return {status_name(code): count for count, code in pairs}


def status_name(code: int) -> str:
    """Name of a status in tables and files."""
    from estimators import Status

    return "raised" if code == RAISED else Status(code).name.lower()
