"""From a fit to an honest result: covariance, intervals, status and words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.draws import NINETY_HIGH, NINETY_LOW
from estimators.least_squares_coordinates import Coordinates
from estimators.least_squares_fit import Fit
from estimators.least_squares_input import Seen
from estimators.least_squares_settings import LeastSquaresSettings
from estimators.result import PARAMETERS, Status, normal_deviate
from twin.measurement.model import BoolArray
from twin.spectra import FloatArray

DECADES = np.log(100.0)
"""The range of ln sigma_t against which an interval is judged."""
SEEN = 3.0
"""Standard deviations by which an albedo must differ from 0 before g has a meaning."""
LEANS_ON_VAGUE = 2.0
"""A standard error that grows by more when vague parameters are let go leans on them."""
UNIFORM = 1.0 / np.sqrt(12.0)
"""Standard deviation of a uniform distribution over its range."""


@dataclass(frozen=True, eq=False)
class Linearised:
    """A fit in the parameters themselves, captures taken as linear (W wavelengths).

    Attributes:
        natural: (albedo, sigma_t, g), (W, 3).
        centre: where the linearised captures fit best, bounds ignored, (W, 3).
        covariance: Gauss-Newton, (W, 3, 3): the inverse of the Fisher information and of a
            uniform prior over the bounds, which only matters where the captures say nothing.
        information: Fisher information by the captures alone, but for collimated ones that are lost
            in noise, (W, 3, 3).
        slope: derivatives of the captures by the parameters, (W, M, 3).
        prior: precision of the uniform prior, (W, 3).
    """

    natural: FloatArray
    centre: FloatArray
    covariance: FloatArray
    information: FloatArray
    slope: FloatArray
    prior: FloatArray


def linearise(
    fit: Fit, seen: Seen, coordinates: Coordinates, thickness_mm: FloatArray
) -> Linearised:
    """Covariance of a fit; see `Linearised`.

    Args:
        fit: of W wavelengths.
        seen: what was fitted.
        coordinates: of the fit.
        thickness_mm: of the samples, (S,).
    """
    natural, stretch = coordinates.natural(fit.place)
    low, high = coordinates.g_range
    slope = fit.slope / np.maximum(stretch, 1e-200)[:, None, :]
    slope = np.where(np.isfinite(slope), slope, 0.0)
    # Light lost in noise bounds sigma_t from one side only: the slope at a chance fluctuation
    # would bound it from both, so such captures take no part in the covariance.
    told = slope.copy()
    told[:, 2::3] *= ~seen.lost.T[:, :, None]
    lean = seen.whitened.whitener @ told
    information = lean.transpose(0, 2, 1) @ lean
    # sigma_t has no upper bound: four times itself, or what would make a sample opaque
    wide = np.stack(
        [
            np.full(len(natural), UNIFORM),
            4.0 * (natural[:, 1] + 1.0 / thickness_mm.max()),
            np.full(len(natural), UNIFORM * (high - low)),
        ],
        axis=-1,
    )
    wide = np.where(np.isfinite(wide), wide, 1.0)
    prior = wide**-2.0
    # in units of the prior the matrix is well conditioned
    scaled = information * wide[:, :, None] * wide[:, None, :] + np.eye(3)
    covariance = np.linalg.inv(scaled) * wide[:, :, None] * wide[:, None, :]
    rest = np.where(np.isfinite(fit.value), fit.value - seen.whitened.data, 0.0)
    white = np.einsum("wij,wj->wi", seen.whitened.whitener, rest)
    centre = natural - np.einsum("wij,wmj,wm->wi", covariance, lean, white)
    return Linearised(natural, centre, covariance, information, slope, prior)


def birge(
    chi_square: FloatArray, freedom: FloatArray, probability: float
) -> tuple[FloatArray, BoolArray]:
    """Factor by which variances grow (Birge 1932, Phys. Rev. 40, 207), and where, both (W,)."""
    from scipy.special import chdtrc

    some = (freedom > 0) & np.isfinite(chi_square)
    chance = chdtrc(np.maximum(freedom, 1), np.where(some, chi_square, 0.0))
    torn = some & (chance < probability)
    factor = np.where(torn, chi_square / np.maximum(freedom, 1), 1.0)
    return np.maximum(factor, 1.0), torn


def identifiable(
    quantile: FloatArray,
    line: Linearised,
    coordinates: Coordinates,
    options: LeastSquaresSettings,
) -> BoolArray:
    """Whether the 90 % interval is narrow against the range and can be believed, (W, 3).

    The interval of a parameter whose uncertainty comes from another one that is not identifiable
    rests on captures that are linear over that one's whole range: it is not believed.
    """
    low, high = quantile[NINETY_LOW], quantile[NINETY_HIGH]
    bounds = coordinates.g_range
    span = np.array([1.0, DECADES, bounds[1] - bounds[0]])
    with np.errstate(invalid="ignore", divide="ignore"):
        width = high - low
        width[:, 1] = np.log(high[:, 1] / np.maximum(low[:, 1], 1e-12))
        # near a bound an interval may be short although the captures say nothing
        spread = (
            np.sqrt(np.diagonal(line.covariance, axis1=1, axis2=2))
            * 2.0
            * normal_deviate(np.array([0.95]))
        )
        spread[:, 1] = 0.0
        width = np.maximum(width, spread)
        narrow = np.asarray(width <= options.unidentifiable_share * span)
    vague = np.flatnonzero(~narrow.all(axis=1) & narrow.any(axis=1))
    if vague.size:
        total = line.information[vague] + line.prior[vague][:, :, None] * np.eye(3)
        held = total.copy()
        diagonal = np.arange(3)
        # holding the vague parameters still: an enormous precision
        held[:, diagonal, diagonal] *= np.where(narrow[vague], 1.0, 1e9)
        marginal, conditional = (
            np.sqrt(np.diagonal(_inverse(matrix), axis1=1, axis2=2)) for matrix in (total, held)
        )
        narrow[vague] &= marginal <= LEANS_ON_VAGUE * conditional
    # at albedo 0 there is no g: scattering must be seen before its direction is
    scatters = line.natural[:, 0] > SEEN * np.sqrt(line.covariance[:, 0, 0])
    narrow[:, 2] &= scatters
    return narrow


def _inverse(matrix: FloatArray) -> FloatArray:
    """Inverse of positive definite matrices of any scaling, (W, 3, 3)."""
    scale = 1.0 / np.sqrt(np.diagonal(matrix, axis1=1, axis2=2))
    outer = scale[:, :, None] * scale[:, None, :]
    return np.asarray(np.linalg.inv(matrix * outer) * outer)


def status_of(
    fit: Fit,
    seen: Seen,
    line: Linearised,
    known: BoolArray,
    torn: BoolArray,
    coordinates: Coordinates,
    options: LeastSquaresSettings,
) -> NDArray[np.int8]:
    """The worst of what is true of every wavelength, (W,)."""
    observed = seen.whitened.used.sum(axis=1)
    low, high = options.sigma_t_range_per_mm
    outside = (line.centre < coordinates.low) | (line.centre > coordinates.high)
    outside[:, 1] |= (line.natural[:, 1] < low) | (line.natural[:, 1] > high)
    lost = seen.lost.all(axis=0) & ~known[:, 1]
    status = np.zeros(len(known), dtype=np.int8)
    for code, where in (
        (Status.NO_NOISE_STATED, seen.noiseless),
        (Status.AT_BOUND, outside.any(axis=1)),
        (Status.NOT_IDENTIFIABLE, ~known.all(axis=1) | (observed < 3)),
        (Status.INCONSISTENT, torn),
        (Status.COLLIMATED_LOST, lost),
        (Status.NOT_CONVERGED, ~fit.settled),
    ):
        status[where] = code
    nothing = observed == 0
    status[nothing] = Status.MASKED
    status[nothing & seen.contradictory.any(axis=0)] = Status.CONTRADICTORY
    return status


def words(
    seen: Seen,
    known: BoolArray,
    status: NDArray[np.int8],
    line: Linearised,
    coordinates: Coordinates,
    wavelength_nm: FloatArray,
) -> tuple[str, ...]:
    """What a person must know beside the numbers, counted over wavelengths."""
    count = len(status)
    observed = seen.whitened.used.sum(axis=1)
    said = list(seen.messages)
    for number in (1, 2):
        here = observed == number
        if here.any():
            said.append(
                f"{_where(here, wavelength_nm)}: {number} usable capture"
                f"{'s' if number > 1 else ''} for 3 unknowns; only combinations are determined"
            )
    usable = (observed > 0) & (status != Status.NOT_CONVERGED)
    why = {
        "albedo": "the captures hardly depend on it (little light comes back)",
        "sigma_t_per_mm": "no collimated light arrives and the reflectances do not tell, or it"
        " trades off against a parameter that is not identifiable",
        "g": "there is too little scattering, or so much that g and sigma_t trade off",
    }
    for number, name in enumerate(PARAMETERS):
        vague = usable & ~known[:, number]
        if vague.any():
            said.append(
                f"{name} is not identifiable at {vague.sum()} of {count} wavelengths"
                f" ({_where(vague, wavelength_nm)}): {why[name]}"
            )
        low = usable & (line.centre[:, number] < coordinates.low[number])
        high = usable & (line.centre[:, number] > coordinates.high[number])
        for here, side in ((low, "lower"), (high, "upper")):
            if here.any():
                said.append(
                    f"{name} sits at its {side} bound at {here.sum()} of {count} wavelengths"
                )
    dark = seen.lost.all(axis=0)
    if dark.any():
        told = dark & known[:, 1]
        said.append(
            f"the collimated light is lost in noise in all samples at {dark.sum()} wavelengths;"
            f" at {told.sum()} of them the reflectances determine sigma_t nevertheless"
        )
    return tuple(said)


def _where(here: BoolArray, wavelength_nm: FloatArray) -> str:
    at = wavelength_nm[here]
    if at.size == 1:
        return f"{at[0]:g} nm"
    return (
        f"{at[0]:g} to {at[-1]:g} nm"
        if np.all(np.diff(np.flatnonzero(here)) == 1)
        else (f"{at.size} wavelengths from {at[0]:g} to {at[-1]:g} nm")
    )
