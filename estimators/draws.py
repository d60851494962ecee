"""Random neighbourhoods of measured captures, and what a cloud of estimates says.

The random numbers of a wavelength come from a Philox stream of its own (Salmon et al. 2011),
keyed by the seed and counted by the wavelength's index: they do not depend on how the
wavelengths are cut into blocks.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.result import QUANTILE_LEVELS
from twin.errors import InputError
from twin.measurement.model import BoolArray
from twin.spectra import FloatArray

MEDIAN, SIGMA_LOW, SIGMA_HIGH, NINETY_LOW, NINETY_HIGH = 5, 3, 7, 2, 8
"""Positions in `QUANTILE_LEVELS`: 50 %, 15.87 %, 84.13 %, 5 % and 95 %."""
SOFT = 1e-3
"""Softening of the logarithms near albedo 0 and 1, sigma_t 0 and g 1."""
FEWEST = 20
"""Draws without which a quantile says nothing."""


def stream(seed: int, wavelength_index: int, purpose: int = 0) -> np.random.Generator:
    """Random numbers of one wavelength; other purposes have other numbers."""
    return np.random.Generator(
        np.random.Philox(key=[seed, 0x6C7574], counter=[0, 0, wavelength_index, purpose])
    )


def gaussian_draws(covariance: FloatArray, draws: int, seed: int, first_index: int) -> FloatArray:
    """Draws from N(0, covariance), shape (W, draws, M).

    Args:
        covariance: shape (W, M, M), positive semidefinite.
        draws: number per wavelength.
        seed: key of the streams.
        first_index: index of the first wavelength of this block.

    Raises:
        InputError: a covariance that is not positive semidefinite.
    """
    count, size, _ = covariance.shape
    diagonal = np.diagonal(covariance, axis1=1, axis2=2)
    # Fully correlated captures are allowed: a trace of independent noise lets Cholesky pass.
    jitter = np.maximum(diagonal, diagonal.max(axis=1, keepdims=True) * 1e-6) * 1e-8 + 1e-300
    try:
        factor = np.linalg.cholesky(covariance + jitter[:, :, None] * np.eye(size))
    except np.linalg.LinAlgError:
        worst = np.linalg.eigvalsh(covariance).min()
        raise InputError(
            f"a covariance with eigenvalue {worst:.3g}",
            "a positive semidefinite covariance",
            place="covariance",
        ) from None
    normal = np.stack(
        [stream(seed, first_index + w).standard_normal((draws, size)) for w in range(count)]
    )
    return np.asarray(normal @ factor.transpose(0, 2, 1))


def uniform_draws(size: int, count: int, draws: int, seed: int, first_index: int) -> FloatArray:
    """Draws uniform in [-1, 1], shape (count, draws, size)."""
    return np.stack(
        [stream(seed, first_index + w).uniform(-1, 1, (draws, size)) for w in range(count)]
    )


def straightened(parameters: FloatArray) -> FloatArray:
    """(albedo, sigma_t, g) in coordinates where materials that look alike lie on a line.

    By the similarity relations (Wyman et al. 1989) an opaque sample tells only
    sigma_a / (sigma_s (1 - g)): a line in (logit albedo, ln sigma_t, ln(1 - g)), a banana in
    the parameters themselves. Softened so that albedo 0 and 1 stay finite. Shape (..., 3).
    """
    albedo, sigma_t, g = np.moveaxis(parameters, -1, 0)
    return np.stack(
        [
            np.log((albedo + SOFT) / (1.0 - albedo + SOFT)),
            np.log(sigma_t + SOFT),
            np.log(1.0 - g + SOFT),
        ],
        axis=-1,
    )


def bent_back(coordinates: FloatArray) -> FloatArray:
    """Inverse of `straightened`, shape (..., 3)."""
    first, second, third = np.moveaxis(coordinates, -1, 0)
    odds = np.exp(first)
    albedo = (odds * (1.0 + SOFT) - SOFT) / (1.0 + odds)
    return np.stack([albedo, np.exp(second) - SOFT, 1.0 + SOFT - np.exp(third)], axis=-1)


class Cloud(NamedTuple):
    """Summary of clouds of estimates, one per wavelength."""

    quantile: FloatArray
    """At `QUANTILE_LEVELS`, shape (Q, W, 3); NaN with fewer than `FEWEST` members."""
    covariance: FloatArray
    """From the central 68 % and correlations of the trimmed members, shape (W, 3, 3)."""
    members: NDArray[np.int64]
    """Draws inside the map, shape (W,)."""

    @property
    def median(self) -> FloatArray:
        """Shape (W, 3)."""
        return np.asarray(self.quantile[MEDIAN])


def quantiles(estimates: FloatArray, kept: BoolArray) -> FloatArray:
    """Quantiles at `QUANTILE_LEVELS` of the members that count, shape (Q, W, 3).

    Args:
        estimates: shape (W, K, 3).
        kept: which members count, shape (W, K).
    """
    members = kept.sum(axis=1)
    by_parameter = np.where(kept[:, None, :], estimates.transpose(0, 2, 1), np.inf)
    by_parameter.sort(axis=2)
    last = np.maximum(members - 1, 0)
    position = QUANTILE_LEVELS[:, None] * last[None, :]
    low = np.floor(position).astype(np.int64)
    high = np.minimum(low + 1, last[None, :])
    rows = np.arange(len(members))
    at_low, at_high = by_parameter[rows, :, low], by_parameter[rows, :, high]
    with np.errstate(invalid="ignore"):
        quantile = at_low + (position - low)[..., None] * (at_high - at_low)
    quantile[:, members < FEWEST] = np.nan
    return np.asarray(quantile)


def summarise(estimates: FloatArray, kept: BoolArray) -> Cloud:
    """Quantiles and a covariance that a few wild members cannot move.

    Args:
        estimates: shape (W, K, 3).
        kept: which members count, shape (W, K).
    """
    members = kept.sum(axis=1)
    counts = kept & (members >= FEWEST)[:, None]
    quantile = quantiles(estimates, kept)
    spread = 0.5 * (quantile[SIGMA_HIGH] - quantile[SIGMA_LOW])
    unit = np.where(spread > 0, spread, 1.0)
    middle = np.where(np.isfinite(quantile[MEDIAN]), quantile[MEDIAN], 0.0)
    standard = np.clip((estimates - middle[:, None, :]) / unit[:, None, :], -3.0, 3.0)
    standard *= counts[..., None]
    standard -= (standard.sum(axis=1) / np.maximum(members, 1)[:, None])[:, None, :]
    standard *= counts[..., None]
    product = standard.transpose(0, 2, 1) @ standard
    deviation = np.sqrt(np.diagonal(product, axis1=1, axis2=2))
    deviation = np.where(deviation > 0, deviation, 1.0)
    correlation = product / (deviation[:, :, None] * deviation[:, None, :])
    covariance = correlation * spread[:, :, None] * spread[:, None, :]
    return Cloud(quantile, covariance, members)


def weighted(
    estimates: FloatArray, kept: BoolArray, clouds: list[Cloud]
) -> tuple[FloatArray, BoolArray]:
    """Draws combined member by member, each sample by the inverse of its covariance.

    The draws of all samples share their noise, so correlations between the samples' captures
    carry over. Samples without a cloud do not take part.

    Args:
        estimates: shape (S, W, K, 3).
        kept: shape (S, W, K).
        clouds: summaries of every sample.

    Returns:
        Combined draws (W, K, 3) and which of them count (W, K).
    """
    takes_part: BoolArray = np.stack(
        [np.isfinite(cloud.covariance).all(axis=(1, 2)) for cloud in clouds]
    )
    precision = []
    for cloud, here in zip(clouds, takes_part, strict=True):
        scale = np.sqrt(np.diagonal(cloud.covariance, axis1=1, axis2=2))
        scale = np.where(here[:, None] & (scale > 1e-9), scale, 1e-9)
        ridge = scale[:, :, None] * np.eye(3) * scale[:, None, :] * 1e-6
        block = np.where(here[:, None, None], cloud.covariance, 0.0) + ridge
        precision.append(np.where(here[:, None, None], np.linalg.inv(block), 0.0))
    total = np.sum(precision, axis=0)
    some: BoolArray = np.any(takes_part, axis=0)
    total[~some] = np.eye(3)
    inverse = np.linalg.inv(total)
    combined = np.zeros(estimates.shape[1:])
    together = np.broadcast_to(some[:, None], estimates.shape[1:3]).copy()
    for index, here in enumerate(takes_part):
        gain = (inverse @ precision[index]).transpose(0, 2, 1)
        member = np.where((kept[index] & here[:, None])[..., None], estimates[index], 0.0)
        combined += member @ gain
        together &= kept[index] | ~here[:, None]
    return combined, together


def disagreement(
    clouds: list[Cloud], centre: FloatArray, freedom: int
) -> tuple[FloatArray, BoolArray]:
    """Whether the samples contradict each other beyond chance (1 in 1000), and how much.

    Args:
        clouds: summaries of every sample.
        centre: combined estimate, shape (W, 3).
        freedom: parameters per sample.

    Returns:
        Factor by which variances must grow (Birge 1932), at least 1, and the verdict, (W,).
    """
    squares = np.zeros(len(centre))
    samples = np.zeros(len(centre))
    for cloud in clouds:
        here = np.asarray(np.isfinite(cloud.covariance).all(axis=(1, 2)))
        here = here & np.isfinite(centre).all(axis=1)
        scale = np.sqrt(np.diagonal(cloud.covariance, axis1=1, axis2=2))
        scale = np.where(here[:, None] & (scale > 1e-9), scale, 1e-9)
        ridge = scale[:, :, None] * np.eye(3) * scale[:, None, :] * 1e-6
        block = np.where(here[:, None, None], cloud.covariance, 0.0) + ridge
        off = np.where(here[:, None], cloud.median - centre, 0.0)
        squares += np.einsum("wi,wij,wj->w", off, np.linalg.inv(block), off)
        samples += here
    from scipy.special import chdtri

    degrees = np.maximum(freedom * (samples - 1), 0)
    limit = np.where(degrees > 0, chdtri(np.maximum(degrees, 1), 0.001), np.inf)
    torn = squares > limit
    return np.where(torn, squares / np.maximum(degrees, 1), 1.0), torn
