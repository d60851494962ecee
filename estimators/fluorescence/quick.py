"""The estimator `donaldson-quick`: the Gaussian background alone, with a gain that is kept.

Everything that does not change from sample to sample of one set-up is made once: the gain of the
linear posterior mean, its fit and its standard deviations, for the mean noise and the mean
calibration of the samples it is made from. A sample then costs a few products with it. Its own
calibration enters through the forward model, which is exact, and the bounds of a matrix through
alternating projections (`nonnegative.back_on_captures`), so that what is reported fits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from hashlib import sha256

import numpy as np
from numpy.typing import NDArray

from estimators.fluorescence.background import BackgroundPrior, reduce
from estimators.fluorescence.cells import (
    Captures,
    Cells,
    assumed_variance,
    checked,
    fingerprint,
    gather,
)
from estimators.fluorescence.nonnegative import posterior_covariance
from estimators.fluorescence.posterior_draws import UNDETERMINED, remaining_variance
from estimators.fluorescence.result import LEVELS, FluorescenceResult, FluorescenceStatus
from estimators.fluorescence.search import ALONE
from twin.errors import InputError
from twin.fluorescence.system import FluorescenceData, FluorescenceSystem
from twin.spectra import FloatArray

LIKE_LIGHT, LIKE_NOISE = 0.05, 4.0
"""Largest relative difference of the calibration, and factor of the noise, that one gain serves."""
Z90 = 1.6448536269514722
"""95 % quantile of the standard normal distribution."""


@dataclass(frozen=True, kw_only=True)
class DonaldsonQuickSettings:
    """Options of the estimator `donaldson-quick`."""

    roughness: float = 1.2e-3
    """Standard deviation of single cells; nothing chooses it here."""
    rounds: int = 4
    """Alternating projections on bounds and captures; with more the error grows again."""
    samples: int = 16
    """Most samples of a batch that a gain is made from."""
    background: BackgroundPrior = field(default_factory=BackgroundPrior)

    def __post_init__(self) -> None:
        for name in ("rounds", "samples"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= 1000:
                raise InputError(f"{value!r}", "an integer of 1 to 1000", place=name)
        if not 0.0 < self.roughness < 1.0:
            raise InputError(f"{self.roughness!r}", "a number above 0, below 1", place="roughness")


@dataclass(frozen=True, eq=False)
class Gain:
    """What is made once; M valid captures, N = C + D unknowns.

    Attributes:
        system: the mean calibration; valid: (J K,); sigma: noise, (M,); noise: covariance, (M, M).
        cells: the unknowns; places: of the unknowns in the flattened matrix, (N,).
        move: unknowns of captures, (M, N); left: residual of captures, (M, M).
        mean: of the unknowns a priori, (N,); upper: bounds, (N,); deviation: posterior, (N,).
        inverse: of the captures' covariance, (M, M); undetermined: (Wo, Wi).
        made_from: SHA-256 of the samples that it was made from.
    """

    system: FluorescenceSystem
    valid: NDArray[np.bool_]
    sigma: FloatArray
    noise: FloatArray
    cells: Cells
    places: NDArray[np.intp]
    move: FloatArray
    left: FloatArray
    mean: FloatArray
    upper: FloatArray
    deviation: FloatArray
    inverse: FloatArray
    undetermined: NDArray[np.bool_]
    made_from: str

    def serves(self, data: FluorescenceData, sigma: FloatArray) -> bool:
        """Whether a sample is close enough to what this was made from."""
        one, other = data.system, self.system
        if not np.array_equal(data.valid.reshape(-1), self.valid):
            return False
        for name in ("emission_nm", "excitation_nm"):
            if not np.array_equal(getattr(one, name), getattr(other, name)):
                return False
        for name in ("illuminants", "sensitivities"):
            mine, theirs = getattr(one, name), getattr(other, name)
            if mine.shape != theirs.shape:
                return False
            if np.abs(mine - theirs).max() > LIKE_LIGHT * np.abs(theirs).max():
                return False
        level = float(np.median(sigma / self.sigma))
        return 1.0 / LIKE_NOISE < level < LIKE_NOISE

    def captured(self, system: FluorescenceSystem, unknowns: FloatArray) -> FloatArray:
        """Valid captures (M,) of unknowns (N,) under the calibration of one sample."""
        shape = (self.cells.emission_nm.size, self.cells.excitation_nm.size)
        full = np.zeros(shape[0] * shape[1])
        full[self.places] = unknowns
        seen = system.illuminants @ full.reshape(shape).T @ system.sensitivities.T
        return np.asarray(seen.reshape(-1)[self.valid])


class DonaldsonQuickEstimator:
    """The linear estimate in about a millisecond, after the first sample of a set-up."""

    def __init__(self, settings: DonaldsonQuickSettings | None = None) -> None:
        self._settings = settings or DonaldsonQuickSettings()
        self._plain = {
            k: v if isinstance(v, (int, float)) else str(v)
            for k, v in asdict(self._settings).items()
        }
        self._kept: list[Gain] = []

    @property
    def name(self) -> str:
        """Name in the registry and in reports."""
        return "donaldson-quick"

    def estimate(self, data: FluorescenceData) -> FluorescenceResult:
        """Estimate one matrix, with the gain of an earlier sample where it serves.

        Raises:
            InputError: captures that cannot be used.
        """
        return self._one(data, self.gain_for(data, [data]))

    def estimate_batch(self, data: list[FluorescenceData]) -> list[FluorescenceResult]:
        """Estimate several; a gain is made from all samples like the first that needs one.

        Raises:
            InputError: captures that cannot be used.
        """
        return [self._one(one, self.gain_for(one, data)) for one in data]

    def gain_for(self, data: FluorescenceData, others: Sequence[FluorescenceData]) -> Gain:
        """The kept gain that serves a sample, or one made from it and others like it.

        Raises:
            InputError: captures that cannot be used.
        """
        checked(data)
        sigma = deviation_of(data)
        for known in self._kept:
            if known.serves(data, sigma):
                return known
        alike = make_gain([data], self._settings)
        if len(others) > 1:
            like = [one for one in others if alike.serves(one, deviation_of(one))]
            alike = make_gain(like[: self._settings.samples] or [data], self._settings)
        self._kept = [alike, *self._kept[:7]]
        return alike

    def _one(self, data: FluorescenceData, known: Gain) -> FluorescenceResult:
        value = data.value.reshape(-1)[known.valid]
        left = value - known.captured(data.system, known.mean)
        target = value - known.left @ left
        found = np.clip(known.mean + left @ known.move, 0.0, known.upper)
        for _ in range(self._settings.rounds):
            found += (target - known.captured(data.system, found)) @ known.move
            np.clip(found, 0.0, known.upper, out=found)
        quantile = found + np.array([[-Z90], [0.0], [Z90]]) * known.deviation
        return result_of(
            self.name, self._plain, data, known, found, np.clip(quantile, 0.0, known.upper),
            known.deviation, float(left @ known.inverse @ left), known.made_from,
        )  # fmt: skip


def result_of(
    name: str, settings: dict[str, str | int | float], data: FluorescenceData, known: Gain,
    found: FloatArray, quantile: FloatArray, deviation: FloatArray, chi_square: float,
    made_from: str,
) -> FluorescenceResult:  # fmt: skip
    """The result of an estimate with something that was kept.

    Args:
        name: of the estimator.
        settings: its own.
        data: one sample.
        known: the gain that serves it.
        found: unknowns inside their bounds, (N,).
        quantile: 0.05, 0.5 and 0.95 quantiles, (3, N).
        deviation: standard deviations, (N,).
        chi_square: what tells an inconsistent sample, over the M captures.
        made_from: identifies what was kept.
    """
    cells, valid = known.cells, known.valid
    shape = (cells.emission_nm.size, cells.excitation_nm.size)

    def whole(unknowns: FloatArray) -> FloatArray:
        full = np.zeros((*unknowns.shape[:-1], shape[0] * shape[1]))
        full[..., known.places] = unknowns
        return full.reshape(*unknowns.shape[:-1], *shape)

    off = np.full(valid.size, np.nan)
    off[valid] = known.captured(data.system, found) - data.value.reshape(-1)[valid]
    residual = off.reshape(data.value.shape)
    sigma = np.full(valid.size, np.nan)
    sigma[valid] = known.sigma
    size = known.sigma.size
    status = FluorescenceStatus.OK
    if chi_square > size + 5.0 * np.sqrt(2.0 * size):
        status = FluorescenceStatus.INCONSISTENT
    elif not valid.all():
        status = FluorescenceStatus.MASKED
    elif known.undetermined.any():
        status = FluorescenceStatus.UNDETERMINED_CELLS
    elif assumed_variance(data).any():
        status = FluorescenceStatus.NO_NOISE_STATED
    return FluorescenceResult(
        estimator=name, sample=data.sample, emission_nm=cells.emission_nm,
        excitation_nm=cells.excitation_nm, matrix=whole(found),
        standard_deviation=whole(deviation), quantile_level=LEVELS, quantile=whole(quantile),
        undetermined=known.undetermined, status=status, residual=residual,
        residual_normalised=residual / sigma.reshape(residual.shape), settings=settings,
        fingerprint=fingerprint(data, name, {**settings, "gain": made_from}),
        messages=data.reasons,
        statistics={"chi_square": chi_square, "directions": float(size)},
    )  # fmt: skip


def deviation_of(data: FluorescenceData) -> FloatArray:
    """Standard deviation of the valid captures, (M,)."""
    valid = data.valid
    common = data.common.reshape(len(data.common), valid.size)
    shared = np.einsum("km,km->m", common, common)[valid.reshape(-1)]
    variance = data.variance[valid] + shared
    return np.asarray(np.sqrt(variance + assumed_variance(data)))


def make_gain(data: Sequence[FluorescenceData], settings: DonaldsonQuickSettings) -> Gain:
    """The gain of the linear estimate for samples of one set-up with the same valid captures."""
    each = [gather([one]) for one in data]
    system = FluorescenceSystem(
        np.mean([one.system.illuminants for one in data], axis=0),
        np.mean([one.system.sensitivities for one in data], axis=0),
        data[0].system.emission_nm, data[0].system.excitation_nm,
    )  # fmt: skip
    cells, valid = each[0].cells, each[0].valid
    noise = np.mean([one.covariance[0] for one in each], axis=0)
    captures = Captures(system, cells, each[0].value, noise[None], valid, each[0].assumed)
    prior = replace(settings.background, roughness=(settings.roughness,), local=0.0)
    # The leak is a share of a reflectance that is not known here: that of the prior.
    flat = np.full((1, cells.diagonal_nm.size), prior.reflectance_mean)
    reduced = replace(reduce(captures, prior, 10**6), reflectance=flat)
    sigma = np.sqrt(np.diagonal(noise))
    inverse = np.linalg.inv(reduced.covariance(ALONE, 0)) / sigma / sigma[:, None]
    gain = sigma[:, None] * reduced.gain(ALONE, 0)
    variance = np.diagonal(posterior_covariance(reduced, ALONE, 0))
    shape = (cells.emission_nm.size, cells.excitation_nm.size)
    row, column = np.nonzero(cells.below_diagonal)
    places = np.concatenate(
        [row * shape[1] + column, cells.diagonal[0] * shape[1] + cells.diagonal[1]]
    )
    mean, upper = np.zeros(places.size), np.full(places.size, np.inf)
    mean[row.size :], upper[row.size :] = prior.reflectance_mean, 1.0
    undetermined = system.blind()
    undetermined[cells.below_diagonal] |= remaining_variance(reduced) > UNDETERMINED
    return Gain(
        system, valid, sigma, noise, cells, places, np.ascontiguousarray(inverse @ gain),
        noise @ inverse, mean, upper, np.sqrt(np.maximum(variance, 0.0)), inverse, undetermined,
        sha256("".join(fingerprint(one, "", {}) for one in data).encode()).hexdigest(),
    )  # fmt: skip
