"""Draws of the matrix from the weighed candidates: products, then background given products."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimators.fluorescence.background import PriorDraws, Reduced
from estimators.fluorescence.fit import Fit
from estimators.fluorescence.products import Products
from estimators.fluorescence.search import ALONE
from twin.spectra import FloatArray


def weights(fits: Sequence[Fit]) -> FloatArray:
    """Posterior probabilities of candidates that are equally likely before, shape (F, B)."""
    evidence = np.array([each.log_evidence for each in fits])
    evidence = np.where(np.isfinite(evidence), evidence, -np.inf)
    relative = np.exp(evidence - evidence.max(axis=0))
    return np.asarray(relative / relative.sum(axis=0))


def means(model: Products, fits: Sequence[Fit], weight: FloatArray) -> FloatArray:
    """Weighed matrices at the modes, cells of at least 0, (B, Wo, Wi)."""
    cells = model.cells
    total = np.zeros((weight.shape[1], *cells.below_diagonal.shape))
    for one, share in zip(fits, weight, strict=True):
        cell, deviation = one.reduced.background(one.amplitude, one.weighted)
        if one.products:
            cell = cell + model.fluorescence(one.parameters)
        diagonal = one.reduced.prior.reflectance_mean + deviation
        matrix = cells.matrix(np.maximum(cell, 0.0), np.clip(diagonal, 0.0, 1.0))
        total += share[:, None, None] * matrix
    return total


def draws(
    model: Products,
    fits: Sequence[Fit],
    weight: FloatArray,
    sample: int,
    count: int,
    prior: PriorDraws,
    seed: int,
    unseen: FloatArray,
) -> FloatArray:
    """Equally weighted draws of one matrix, shape (N, Wo, Wi).

    Product parameters from the normal approximation at each mode; the background given them by
    Matheron's rule (a prior draw plus the gain times what it leaves unexplained).

    Args:
        model: the products.
        fits: candidates.
        weight: of the candidates, (F, B).
        sample: which of the B samples.
        count: number of draws, N.
        prior: N draws of what is Gaussian.
        seed: of the random numbers.
        unseen: per cell, 0 to 1: how much of the prior variance is left, (C,); only where a cell is
            undetermined. There, fluorescence that no capture shows may hide.
    """
    random = np.random.Generator(np.random.Philox(key=seed))
    cells = model.cells
    share = weight[:, sample]
    which = np.searchsorted(np.cumsum(share), (np.arange(count) + 0.5) / count)
    which = np.minimum(which, len(fits) - 1)
    noise_factor = np.linalg.cholesky(fits[0].reduced.noise[sample])
    noise = random.standard_normal((count, len(noise_factor))) @ noise_factor.T
    out = np.empty((count, *cells.below_diagonal.shape))
    for number in np.unique(which):
        one = fits[number]
        reduced = one.reduced
        member = np.flatnonzero(which == number)
        diagonal = prior.diagonal[member]
        background = one.amplitude * prior.cell[member]
        background += reduced.roughness[sample] * prior.rough[member]
        if reduced.local is not None:
            background += reduced.local[sample] * prior.local[member]
        background[:, reduced.kernels.near] += prior.leak[member] * reduced.leak_scale[sample]
        cell = np.zeros_like(background)
        explained = np.zeros((member.size, reduced.value.shape[1]))
        if one.products:
            factor = np.linalg.cholesky(one.hessian[sample])
            normal = random.standard_normal((member.size, len(factor)))
            t = one.parameters[sample].reshape(-1) + np.linalg.solve(factor.T, normal.T).T
            t = t.reshape(member.size, one.products, -1)
            cell = model.fluorescence(t)
            explained = model.values(t)
        left = reduced.value[sample] - explained - noise[member]
        left -= background @ reduced.cell_design.T + diagonal @ reduced.diagonal_design.T
        covariance = reduced.covariance(one.amplitude, sample)
        weighted = np.linalg.solve(covariance, left.T).T
        more, deviation = reduced.of_sample(one.amplitude, weighted, sample)
        cell = cell + background + more
        reflectance = reduced.prior.reflectance_mean + diagonal + deviation
        cell = np.maximum(cell, 0.0) + ALONE * np.sqrt(unseen) * np.abs(prior.cell[member])
        out[member] = cells.matrix(cell, np.clip(reflectance, 0.0, 1.0))
    return out


def remaining_variance(reduced: Reduced) -> FloatArray:
    """Share of the variance of a smooth prior that the captures leave of every cell, (C,).

    What illuminants and channels see, whatever the material is.
    """
    prior, explained = reduced.explained_variance(ALONE)
    return np.asarray(np.clip(1.0 - explained / prior, 0.0, 1.0))
