"""What the baselines share: captures that can be used, and the result put together.

A capture is used or it is not; why not is said by the status of its sample and counted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.beer_law import beer_check
from estimators.protocol import BenchModel, fingerprint
from estimators.result import EstimateResult, Status
from twin.measurement.relative import RelativeIntensities
from twin.spectra import FloatArray

Setting = str | int | float
SHARE = 0.5
"""A 90 % interval wider than this share of the possible range says nothing (sigma_t: ln)."""
RANGE = np.array([1.0, np.log(1000.0), 1.5])
"""Possible range of albedo, ln sigma_t and g that `identified` compares intervals with."""
NINETY = 3.29
"""Width of the central 90 % interval of a normal distribution in standard errors."""


@dataclass(frozen=True, eq=False)
class Screened:
    """Captures fit for use, S samples and W wavelengths.

    Attributes:
        usable: whether a capture can be used, shape (S, 3, W).
        status: code of `Status` of every sample: OK, MASKED or CONTRADICTORY, shape (S, W).
        value: captures, 0 where they cannot be used, shape (S, 3, W).
        covariance: of them, 0 where they cannot be used, shape (W, 3S, 3S).
        noiseless: whether a usable capture has a stated uncertainty of zero, shape (W,).
    """

    usable: NDArray[np.bool_]
    status: NDArray[np.int8]
    value: FloatArray
    covariance: FloatArray
    noiseless: NDArray[np.bool_]

    @property
    def sigma(self) -> FloatArray:
        """Stated standard errors, 0 where a capture cannot be used, shape (S, 3, W)."""
        diagonal = np.diagonal(self.covariance, axis1=1, axis2=2)
        return np.asarray(np.sqrt(diagonal).T.reshape(self.value.shape))


def screen(model: BenchModel, intensities: RelativeIntensities, limit: float = 3.0) -> Screened:
    """Tell usable captures from masked and contradictory ones.

    A sample contradicts itself where it is darker over the brighter background, lets more than
    all of the beam through, or is darker than no light at all, by more than `limit` standard
    errors.

    Args:
        model: tells which background is the brighter one.
        intensities: relative intensities of S samples at W wavelengths.
        limit: standard errors.
    """
    value = np.asarray(intensities.value, dtype=np.float64)
    shape, count = value.shape, value.shape[2]
    variance = np.diagonal(intensities.covariance, axis1=1, axis2=2).T.reshape(shape)
    with np.errstate(invalid="ignore"):
        usable = np.asarray(intensities.valid) & np.isfinite(value) & (variance >= 0.0)
        usable &= np.isfinite(variance)
    value = np.where(usable, value, 0.0)
    flat = usable.reshape(-1, count).T
    both = flat[:, :, None] & flat[:, None, :] & np.isfinite(intensities.covariance)
    covariance = np.where(both, intensities.covariance, 0.0).astype(np.float64)
    noise = np.where(usable, np.sqrt(np.where(usable, variance, 0.0)), 0.0)

    brighter = np.sign(model.rho_white - model.rho_black)
    samples = np.arange(shape[0])
    shared = covariance[:, 3 * samples, 3 * samples + 1].T
    spread = np.sqrt(np.maximum(noise[:, 0] ** 2 + noise[:, 1] ** 2 - 2.0 * shared, 0.0))
    gain = (value[:, 1] - value[:, 0]) * brighter
    wrong = usable[:, 0] & usable[:, 1] & (gain < -limit * spread - 1e-12)
    wrong |= usable[:, 2] & (value[:, 2] > 1.0 + limit * noise[:, 2] + 1e-12)
    wrong |= (usable & (value < -limit * noise - 1e-12)).any(axis=1)
    status = np.where(usable.any(axis=1), Status.OK, Status.MASKED)
    status = np.where(wrong, Status.CONTRADICTORY, status).astype(np.int8)
    noiseless = (usable & (noise == 0.0)).any(axis=(0, 1))
    return Screened(usable, status, value, covariance, np.asarray(noiseless))


def identified(parameters: FloatArray, standard_error: FloatArray) -> NDArray[np.bool_]:
    """Whether 90 % intervals are narrow against the possible range, shape (W, 3).

    Args:
        parameters: albedo, sigma_t [1/mm], g, shape (W, 3).
        standard_error: of them, shape (W, 3).
    """
    width = NINETY * standard_error
    with np.errstate(invalid="ignore", divide="ignore"):
        width[:, 1] = np.where(parameters[:, 1] > 0, width[:, 1] / parameters[:, 1], np.inf)
        return np.asarray(np.isfinite(parameters) & (width <= SHARE * RANGE))


def counted(status: NDArray[np.int8]) -> tuple[str, ...]:
    """One sentence for every status but OK: at how many of the W wavelengths, cause, remedy."""
    codes, number = np.unique(status, return_counts=True)
    return tuple(
        f"{times} of {status.size} wavelengths {Status(code).name.lower()}: {Status(code).text}"
        for code, times in zip(codes.tolist(), number.tolist(), strict=True)
        if code != Status.OK
    )


def impossible(sample_status: NDArray[np.int8]) -> NDArray[np.bool_]:
    """Where a sample's captures are those of no material, shape (S, W) to (W,).

    The other samples may well tell the material, but not without a doubt.
    """
    none = (sample_status == Status.CONTRADICTORY) | (sample_status == Status.OUTSIDE_MAP)
    return np.asarray(none.any(axis=0))


def left_out(
    names: Sequence[str], sample_status: NDArray[np.int8], status: NDArray[np.int8]
) -> tuple[str, ...]:
    """One sentence for every sample that others stand in for, and why it does not count.

    Args:
        names: of S samples.
        sample_status: of every sample, shape (S, W).
        status: of all together, shape (W,).
    """
    sentences = []
    for name, own in zip(names, sample_status, strict=True):
        for code in np.unique(own[(own >= Status.OUTSIDE_MAP) & (status < Status.OUTSIDE_MAP)]):
            times = int(((own == code) & (status < Status.OUTSIDE_MAP)).sum())
            sentences.append(
                f"{name!r} left out at {times} of {status.size} wavelengths:"
                f" {Status(int(code)).cause}"
            )
    return tuple(sentences)


def assembled(
    name: str,
    model: BenchModel,
    intensities: RelativeIntensities,
    screened: Screened,
    *,
    parameters: FloatArray,
    covariance: FloatArray,
    quantile_level: FloatArray,
    quantile: FloatArray,
    identifiable: NDArray[np.bool_],
    status: NDArray[np.int8],
    sample_estimate: FloatArray,
    sample_status: NDArray[np.int8],
    predicted: FloatArray,
    model_error: FloatArray,
    settings: Mapping[str, Setting],
    messages: Sequence[str],
    statistics: Mapping[str, FloatArray],
) -> EstimateResult:
    """The result of a baseline; what a status says to have no value becomes NaN.

    Args:
        name: of the estimator.
        model: the bench.
        intensities: what was measured.
        screened: what of it could be used.
        parameters: albedo, sigma_t [1/mm], g, shape (W, 3).
        covariance: of them, shape (W, 3, 3).
        quantile_level: shape (Q,).
        quantile: shape (Q, W, 3).
        identifiable: shape (W, 3).
        status: shape (W,).
        sample_estimate: shape (S, W, 3).
        sample_status: shape (S, W).
        predicted: captures of the estimate, shape (S, 3, W).
        model_error: standard error of the prediction itself, shape (S, 3, W).
        settings: options of the estimator.
        messages: sentences beside the counted ones.
        statistics: what the solver says of itself, shape (W,) each.
    """
    nothing = status >= Status.OUTSIDE_MAP
    parameters = np.where(nothing[:, None], np.nan, parameters)
    residual = np.where(screened.usable & ~nothing, predicted - screened.value, np.nan)
    total = np.hypot(screened.sigma, model_error)
    with np.errstate(divide="ignore", invalid="ignore"):
        normalised = np.where(total > 0, residual / total, np.nan)
    beer, beer_error = beer_check(intensities, model)
    return EstimateResult(
        estimator=name,
        wavelength_nm=model.wavelength_nm,
        albedo=parameters[:, 0].copy(),
        sigma_t_per_mm=parameters[:, 1].copy(),
        g=parameters[:, 2].copy(),
        covariance=np.where(nothing[:, None, None], np.nan, covariance),
        quantile_level=quantile_level,
        quantile=np.where(nothing[:, None], np.nan, quantile),
        identifiable=identifiable & ~nothing[:, None] & np.isfinite(parameters),
        status=status,
        sample_names=tuple(intensities.sample_names),
        thickness_mm=np.asarray(intensities.thickness_mm, dtype=np.float64),
        sample_estimate=sample_estimate,
        sample_status=sample_status,
        distance=np.full(sample_status.shape, np.nan),
        residual=residual,
        residual_normalised=normalised,
        beer_sigma_t_per_mm=beer,
        beer_standard_error_per_mm=beer_error,
        settings=dict(settings),
        fingerprint=fingerprint(
            intensities, model.fingerprint_parts(), [name, repr(dict(settings))]
        ),
        messages=(*intensities.reasons, *messages, *counted(status)),
        statistics=dict(statistics),
    )
