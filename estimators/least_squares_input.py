"""What least squares sees of a visit: whitened captures, and what had to be left out and why."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.least_squares_fit import Whitened
from estimators.least_squares_settings import LeastSquaresSettings
from twin.errors import InputError
from twin.measurement.model import BoolArray
from twin.measurement.relative import RelativeIntensities
from twin.spectra import FloatArray

JITTER = 1e-10
"""Of every variance: fully correlated captures are allowed."""
REST = 1e-6
"""Of every variance: what is left without the errors that all wavelengths share may be nothing."""


@dataclass(frozen=True, eq=False)
class Seen:
    """A visit, prepared (S samples, W wavelengths, M = 3S captures).

    Attributes:
        whitened: what the fit sees.
        covariance: of captures and engine together, masked ones zero, (W, M, M).
        masked: samples without any usable capture, (S, W).
        contradictory: samples left out because they contradict themselves, (S, W).
        lost: samples whose collimated capture is below its noise, (S, W).
        noiseless: no capture states any noise, (W,).
        common: modes of the captures' errors that all wavelengths share, without the engine's,
            (K, W, M).
        messages: what was left out, counted.
    """

    whitened: Whitened
    covariance: FloatArray
    masked: BoolArray
    contradictory: BoolArray
    lost: BoolArray
    noiseless: BoolArray
    common: FloatArray
    messages: tuple[str, ...]


def prepare(
    intensities: RelativeIntensities, relative_error: FloatArray, options: LeastSquaresSettings
) -> Seen:
    """Whiten a visit by its covariance and the engine's error.

    The engine's error is taken as independent between captures: what it consists of (too few
    streams, the scatter of the finite bench's correction) differs from capture to capture at one
    wavelength. It is common to all wavelengths, which matters to the joint mode alone.

    Args:
        intensities: of the visit.
        relative_error: of the engine, (S, 3).
        options: of the estimator.

    Raises:
        InputError: a covariance that is not positive semidefinite.
    """
    samples, _, count = intensities.value.shape
    captures = 3 * samples
    value = np.asarray(intensities.value, dtype=np.float64).reshape(captures, count).T
    stated = np.asarray(intensities.covariance, dtype=np.float64)
    used = np.asarray(intensities.valid).reshape(captures, count).T & np.isfinite(value)
    messages = []
    nameless = used & ~np.isfinite(np.diagonal(stated, axis1=1, axis2=2))
    if nameless.any():
        messages.append(f"left out {nameless.sum()} captures whose variance is no number")
    used &= ~nameless
    diagonal = np.where(used, np.diagonal(stated, axis1=1, axis2=2), 0.0)
    if np.any(diagonal < 0.0):
        raise InputError(
            f"a variance of {diagonal.min():.3g}", "variances of 0 or more", place="covariance"
        )
    both = used[:, :, None] & used[:, None, :]
    noise = np.where(both & np.isfinite(stated), stated, 0.0)

    by_sample = used.reshape(count, samples, 3)
    black, white, through = np.moveaxis(value.reshape(count, samples, 3), -1, 0)
    first = 3 * np.arange(samples)
    variance = diagonal.reshape(count, samples, 3)
    apart = variance[..., 0] + variance[..., 1] - 2.0 * noise[:, first, first + 1]
    limit = options.contradictory_sigma
    with np.errstate(invalid="ignore"):
        # equal captures (an opaque sample) are no contradiction: rounding, and the engine's error
        margin = relative_error.max() * np.abs(white) + 1e-12
        darker = by_sample[..., 0] & by_sample[..., 1]
        darker = darker & (black - white > limit * np.sqrt(np.maximum(apart, 0.0)) + margin)
        bright = by_sample[..., 2] & (
            through > 1.0 + limit * np.sqrt(variance[..., 2]) + relative_error.max()
        )
        faint = through <= options.lost_sigma * np.sqrt(variance[..., 2])
    contradictory = darker | bright
    for wrong, text in (
        (darker, "darker over white than over black"),
        (bright, "more collimated light behind the sample than without it"),
    ):
        if wrong.any():
            messages.append(
                f"{text} beyond noise: {wrong.sum()} sample readings, left out at their wavelength"
            )
    masked: BoolArray = np.logical_not(by_sample.any(axis=2))
    lost = by_sample[..., 2] & faint & ~contradictory
    noiseless = used.any(axis=1) & (np.where(used, diagonal, 0.0) == 0.0).all(axis=1)

    used &= ~np.repeat(contradictory, 3, axis=1)
    both = used[:, :, None] & used[:, None, :]
    data = np.where(used, value, 0.0)
    engine = np.where(used, relative_error.reshape(-1) * data, 0.0) ** 2
    covariance = np.where(both, noise, 0.0)
    place = np.arange(captures)
    # what says to have neither noise nor signal is trusted to rounding
    covariance[:, place, place] = (covariance[:, place, place] + engine) * (1 + JITTER) + 1e-18
    whole = covariance.copy()
    covariance[:, place, place] = np.where(used, covariance[:, place, place], 0.0)
    scale = np.sqrt(whole[:, place, place])
    scaled = whole / (scale[:, :, None] * scale[:, None, :])
    try:
        factor = np.linalg.cholesky(scaled)
    except np.linalg.LinAlgError:
        worst = np.linalg.eigvalsh(scaled).min()
        raise InputError(
            f"correlations of the captures with eigenvalue {worst:.3g}",
            "a positive semidefinite covariance",
            place="covariance",
        ) from None
    whitener = np.linalg.inv(factor) / scale[:, None, :]
    whitener = np.where(both, whitener, 0.0)
    return Seen(
        Whitened(data, np.where(used, scale, 0.0), used, whitener),
        covariance,
        masked.T,
        contradictory.T,
        lost.T,
        noiseless,
        _common(intensities, used),
        tuple(messages),
    )


def apart(
    seen: Seen, index: NDArray[np.intp], relative_error: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Errors of their own and common ones, told apart, for R wavelengths `index`.

    Args:
        seen: the visit.
        index: wavelengths, (R,).
        relative_error: of the engine, (S, 3): common to all wavelengths.

    Returns:
        Whitener of what is left of the covariance (R, M, M), and the modes of what all wavelengths
        share, the engine's error included (K', R, M).

    Raises:
        InputError: common errors that exceed the covariance.
    """
    data, used = seen.whitened.data[index], seen.whitened.used[index]
    captures = data.shape[1]
    engine = np.where(used, relative_error.reshape(-1) * data, 0.0)
    modes = [seen.common[:, index], (np.eye(captures)[:, None] * engine)]
    common = np.concatenate(modes)
    whole = seen.covariance[index]
    own = whole - np.einsum("kwi,kwj->wij", common, common)
    place = np.arange(captures)
    scale = np.sqrt(np.where(used, whole[:, place, place], 1.0))
    scaled = own / (scale[:, :, None] * scale[:, None, :])
    scaled[:, place, place] += np.where(used, REST, 1.0)
    if np.linalg.eigvalsh(scaled).min() < 0.0:
        raise InputError(
            "errors common to all wavelengths that exceed the covariance",
            "a covariance that holds them (`RelativeIntensities.common`)",
            place="common",
        )
    whitener = np.linalg.inv(np.linalg.cholesky(scaled)) / scale[:, None, :]
    both = used[:, :, None] & used[:, None, :]
    return np.where(both, whitener, 0.0), common


def _common(intensities: RelativeIntensities, used: BoolArray) -> FloatArray:
    """Modes of the captures' errors, 0 where a capture is not used, (K, W, M).

    Raises:
        InputError: modes of another shape.
    """
    if intensities.common is None:
        return np.zeros((0, *used.shape))
    common = np.asarray(intensities.common, dtype=np.float64)
    if common.ndim != 3 or common.shape[1:] != used.shape:
        raise InputError(
            f"shape {common.shape}", f"shape (K, {used.shape[0]}, {used.shape[1]})", place="common"
        )
    return np.where(used, common, 0.0)
