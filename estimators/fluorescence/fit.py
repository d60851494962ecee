"""Maximum a posteriori products for a batch of samples (Levenberg-Marquardt), with evidence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.fluorescence.background import Reduced
from estimators.fluorescence.products import Products
from twin.spectra import FloatArray

LARGEST_STEP = 2.0
"""Of one whitened parameter [prior standard deviations]."""
SETTLED = 0.05
"""Decrease of the cost (twice the negative log posterior) below which a sample is done."""
CONVERGED = 1.0
"""Decrease in the last step that counts as converged when the steps are used up."""


@dataclass(frozen=True, eq=False)
class Fit:
    """Products and background of B samples at one amplitude of the background.

    Attributes:
        products: number of products, K.
        amplitude: standard deviation of the cells that are no product.
        parameters: whitened, (B, K, P).
        hessian: of half the cost, Gauss-Newton, (B, K P, K P).
        log_evidence: Laplace approximation, (B,).
        chi_square: of the whitened values, (B,).
        weighted: inverse covariance times residual, (B, m).
        reduced: the captures with the background that was used.
        converged: (B,).
    """

    products: int
    amplitude: float
    parameters: FloatArray
    hessian: FloatArray
    log_evidence: FloatArray
    chi_square: FloatArray
    weighted: FloatArray
    converged: NDArray[np.bool_]
    reduced: Reduced


def background_fit(reduced: Reduced, amplitude: float) -> Fit:
    """The Gaussian part alone, without any product."""
    batch = len(reduced.value)
    whitening, log_determinant = _whitening(reduced, amplitude)
    white = np.einsum("bmn,bn->bm", whitening, reduced.value)
    chi_square = (white**2).sum(axis=1)
    return Fit(
        0, amplitude, np.zeros((batch, 0, 0)), np.zeros((batch, 0, 0)),
        -0.5 * (chi_square + log_determinant), chi_square,
        np.einsum("bnm,bn->bm", whitening, white), np.ones(batch, dtype=bool),
        reduced,
    )  # fmt: skip


def fit(reduced: Reduced, model: Products, amplitude: float, start: FloatArray, steps: int) -> Fit:
    """Fit products from whitened starts (B, K, P).

    Source: Levenberg 1944, Marquardt 1963, with the damping of the diagonal; the evidence as
    MacKay 1992.
    """
    batch, products, size = start.shape
    total = products * size
    whitening, log_determinant = _whitening(reduced, amplitude)
    t = start.reshape(batch, total).copy()
    residual, jacobian, cost = _evaluate(reduced, model, whitening, t, products, slice(None))
    damping = np.full(batch, 0.1)
    active = np.ones(batch, dtype=bool)
    diagonal = np.arange(total)
    last = np.full(batch, np.inf)
    for _ in range(steps):
        index = np.flatnonzero(active)
        if index.size == 0:
            break
        j, r = jacobian[index], residual[index]
        system = j.transpose(0, 2, 1) @ j
        system[:, diagonal, diagonal] = (system[:, diagonal, diagonal] + 1.0) * (
            1.0 + damping[index, None]
        )
        gradient = np.einsum("bmp,bm->bp", j, r) - t[index]
        step = np.linalg.solve(system, gradient[..., None])[..., 0]
        step *= np.minimum(1.0, LARGEST_STEP / np.maximum(np.abs(step).max(axis=1), 1e-9))[:, None]
        tried = t[index] + step
        r2, j2, c2 = _evaluate(reduced, model, whitening[index], tried, products, index)
        better = c2 < cost[index]
        gain = cost[index] - c2
        chosen = index[better]
        t[chosen], residual[chosen], jacobian[chosen] = tried[better], r2[better], j2[better]
        cost[chosen] = c2[better]
        damping[index] = np.clip(damping[index] * np.where(better, 0.2, 5.0), 1e-7, 1e7)
        last[index] = np.where(better, gain, last[index])
        stuck = ~better & (damping[index] > 1e4)
        active[index[stuck | (better & (gain < SETTLED))]] = False
    hessian = jacobian.transpose(0, 2, 1) @ jacobian
    hessian[:, diagonal, diagonal] += 1.0
    log_det = np.linalg.slogdet(hessian)[1]
    switched = float(np.log(np.arange(1, products + 1)).sum())
    return Fit(
        products, amplitude, t.reshape(start.shape), hessian,
        -0.5 * (cost + log_det + log_determinant) + switched, (residual**2).sum(axis=1),
        np.einsum("bnm,bn->bm", whitening, residual), ~active | (last < CONVERGED), reduced,
    )  # fmt: skip


def _whitening(reduced: Reduced, amplitude: float) -> tuple[FloatArray, FloatArray]:
    """Inverse lower factors (B, m, m) and log determinants (B,) of the covariance."""
    from scipy.linalg.lapack import dtrtri

    factor = np.linalg.cholesky(reduced.covariance(amplitude))
    log_determinant = 2.0 * np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)
    return np.array([dtrtri(each, lower=1)[0] for each in factor]), log_determinant


def _evaluate(
    reduced: Reduced, model: Products, whitening: FloatArray, t: FloatArray, products: int,
    samples: slice | NDArray[np.intp],
) -> tuple[FloatArray, FloatArray, FloatArray]:  # fmt: skip
    value, jacobian = model.values_and_jacobian(t.reshape(len(t), products, -1))
    difference = reduced.value[samples] - value
    residual = np.einsum("bmn,bn->bm", whitening, difference)
    cost = (residual**2).sum(axis=1) + (t**2).sum(axis=1)
    return residual, whitening @ jacobian, cost
