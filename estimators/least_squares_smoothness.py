"""How smooth spectra are, by the captures themselves.

With the captures linear around a fit, the probability of the captures under the prior of lengths
L (one for each coordinate), all spectra and common errors integrated out, is in closed form:

    2 ln p(L) = (rank) sum_p 3 ln L_p - ln |precision| - (least cost) + constant

(Wahba 1985, Ann. Stat. 13, 1378: generalised maximum likelihood; the straight lines, which cost
nothing, have no prior.) The lengths that maximise it are taken; what they leave open enters the
covariance to first order (Kass & Steffey 1989, J. Am. Stat. Assoc. 84, 717).
"""

from __future__ import annotations

import numpy as np

from estimators.least_squares_banded import Normal, bend
from twin.spectra import FloatArray

SHORTEST, LONGEST = 0.2, 10.0
"""Least length in mean steps of wavelength, greatest in ranges of wavelength."""
WIDEST = 1.0
"""Standard deviation of ln L before the captures are seen, for its share of the covariance."""
NUDGE = 0.15
"""Step in ln L of differences."""


def evidence(normal: Normal, shape: FloatArray, log_length: FloatArray) -> float:
    """2 ln p(captures | lengths) but for a constant.

    Args:
        normal: around a fit.
        shape: the prior of length 1, from `bending`, (3, W).
        log_length: ln of the lengths [ln nm], (3,).
    """
    prior = shape[..., None] * np.exp(3.0 * log_length)
    solved = normal.solved(prior, blocks=False)
    cost = normal.square + float(np.sum(normal.place * bend(prior, normal.place))) - solved.gain
    rank = shape.shape[1] - 2
    return float(3.0 * rank * log_length.sum() - solved.log_determinant - cost)


def best_lengths(
    normal: Normal, shape: FloatArray, wavelength_nm: FloatArray, start: FloatArray
) -> FloatArray:
    """The most probable lengths [nm], (3,).

    Args:
        normal: around a fit.
        shape: the prior of length 1, (3, W).
        wavelength_nm: [nm], (W,).
        start: lengths to start from, (3,); 0 where there are none.
    """
    from scipy.optimize import minimize

    low, high = _ends(wavelength_nm)
    known = start > 0.0
    middle = 0.5 * (low + high)
    first = np.where(known, np.log(np.where(known, start, 1.0)), middle)

    def cost(log_length: FloatArray) -> float:
        inside = np.clip(log_length, low, high)
        return -evidence(normal, shape, inside) + 10.0 * float(np.sum((log_length - inside) ** 2))

    simplex = first + np.vstack([np.zeros(3), np.where(first > middle, -1.0, 1.0) * np.eye(3)])
    solved = minimize(
        cost,
        first,
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "xatol": 0.03, "fatol": 0.01, "maxfev": 250},
    )
    return np.asarray(np.exp(np.clip(solved.x, low, high)))


def spread_of_lengths(normal: Normal, shape: FloatArray, length_nm: FloatArray) -> FloatArray:
    """Covariance of the coordinates from not knowing the lengths, (W, 3, 3).

    Args:
        normal: around the fit.
        shape: the prior of length 1, (3, W).
        length_nm: the most probable ones, (3,).
    """
    centre = np.log(length_nm)
    unit = NUDGE * np.eye(3)
    at = {0: evidence(normal, shape, centre)}
    slope = np.empty((*normal.place.shape, 3))
    bent = np.empty((3, 3))
    single = []
    for p in range(3):
        ends = [
            normal.solved(shape[..., None] * np.exp(3.0 * (centre + side * unit[p])), blocks=False)
            for side in (-1.0, 1.0)
        ]
        slope[..., p] = (ends[1].step[0] - ends[0].step[0]) / (2.0 * NUDGE)
        single.append([evidence(normal, shape, centre + side * unit[p]) for side in (-1.0, 1.0)])
        bent[p, p] = (single[p][0] + single[p][1] - 2.0 * at[0]) / NUDGE**2
    for p in range(3):
        for q in range(p):
            both = evidence(normal, shape, centre + unit[p] + unit[q])
            mixed = both - single[p][1] - single[q][1] + at[0]
            bent[p, q] = bent[q, p] = mixed / NUDGE**2
    # The evidence is twice a logarithm. Where it is flat, or not yet at its top, the range is left.
    value, vector = np.linalg.eigh(-0.5 * bent)
    precision = np.maximum(value, 0.0) + WIDEST**-2
    covariance = (vector / precision) @ vector.T
    return np.asarray(np.einsum("wip,pq,wjq->wij", slope, covariance, slope))


def _ends(wavelength_nm: FloatArray) -> tuple[float, float]:
    span = float(wavelength_nm[-1] - wavelength_nm[0])
    return float(np.log(SHORTEST * span / (len(wavelength_nm) - 1))), float(np.log(LONGEST * span))
