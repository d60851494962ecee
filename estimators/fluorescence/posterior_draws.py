"""Estimate and draws of the matrix from the weighed candidates, inside the bounds of a matrix."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimators.fluorescence.background import Reduced
from estimators.fluorescence.background_prior import PriorDraws
from estimators.fluorescence.fit import Fit
from estimators.fluorescence.nonnegative import back_on_captures, nearest, posterior_covariance
from estimators.fluorescence.products import Products
from estimators.fluorescence.search import ALONE
from twin.spectra import FloatArray

UNDETERMINED = 0.5
"""Share of the variance of a smooth prior that is left where a cell counts as undetermined."""
WIDER = 0.5
"""How much wider than normal the products' draws are, per posterior standard deviation [prior
standard deviations]: where captures say little, the normal approximation at a mode misses most.
From the coverage of strong cells on generated matrices."""
MISSHAPEN, MISSHAPEN_UNSEEN = 0.2, 1.5
"""Standard deviation of a cell, over its estimate, by which a fluorophore may have another shape
than any product of the prior: where captures leave nothing of a smooth prior, and what comes on top
per square root of the share of its variance that they leave. From the coverage of strong cells
under few illuminants, on generated matrices."""
NEGLIGIBLE = 0.01
"""Posterior probability below which a candidate is left out."""


def weights(fits: Sequence[Fit]) -> FloatArray:
    """Posterior probabilities of candidates that are equally likely before, shape (F, B)."""
    evidence = np.array([each.log_evidence for each in fits])
    evidence = np.where(np.isfinite(evidence), evidence, -np.inf)
    relative = np.exp(evidence - evidence.max(axis=0))
    share = relative / relative.sum(axis=0)
    share = np.where(share < NEGLIGIBLE, 0.0, share)
    return np.asarray(share / share.sum(axis=0))


def means(model: Products, fits: Sequence[Fit], weight: FloatArray) -> FloatArray:
    """Weighed matrices (B, Wo, Wi) at the candidates' modes, each the best inside the bounds."""
    cells = model.cells
    total = np.zeros((weight.shape[1], *cells.below_diagonal.shape))
    for one, shares in zip(fits, weight, strict=True):
        if not np.any(shares > 0.0):
            continue
        cell, deviation = one.reduced.background(one.amplitude, one.weighted)
        if one.products:
            cell = cell + model.fluorescence(one.parameters)
            deviation = deviation + model.reflectance(one.parameters)
        mode = np.concatenate([cell, one.reduced.prior.reflectance_mean + deviation], axis=1)
        upper = np.ones(mode.shape[1])
        upper[: cell.shape[1]] = np.inf
        for sample in np.flatnonzero(shares > 0.0):
            if np.all((mode[sample] >= 0.0) & (mode[sample] <= upper)):
                best = mode[sample]
            else:
                spread = posterior_covariance(one.reduced, one.amplitude, int(sample))
                best = nearest(mode[sample], spread, np.zeros(upper.size), upper)[0]
            matrix = cells.matrix(best[: cell.shape[1]], best[cell.shape[1] :])
            total[sample] += shares[sample] * matrix
    return total


def draws(
    model: Products,
    fits: Sequence[Fit],
    weight: FloatArray,
    sample: int,
    count: int,
    prior: PriorDraws,
    seed: int,
    unshown: FloatArray,
) -> FloatArray:
    """Equally weighted draws of one matrix, shape (N, Wo, Wi).

    Product parameters from the normal approximation at each mode; the background given them by
    Matheron's rule (a prior draw plus the gain times what it leaves unexplained); then inside the
    bounds, as `back_on_captures`.

    Args:
        model: the products.
        fits: candidates.
        weight: of the candidates, (F, B).
        sample: which of the B samples.
        count: number of draws, N.
        prior: N draws of what is Gaussian.
        seed: of the random numbers.
        unshown: draws of what the captures do not show, as `hidden` makes them, (N, C).
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
        cell, dips = np.zeros_like(background), np.zeros_like(diagonal)
        explained = np.zeros((member.size, reduced.value.shape[1]))
        if one.products:
            value, vector = np.linalg.eigh(one.hessian[sample])
            wide = 1.0 / np.sqrt(np.maximum(value, 1.0))
            normal = random.standard_normal((member.size, wide.size))
            t = one.parameters[sample].reshape(-1)
            t = t + (normal * wide * (1.0 + WIDER * wide)) @ vector.T
            t = t.reshape(member.size, one.products, -1)
            cell = model.fluorescence(t)
            dips = model.reflectance(t)
            explained = model.values(t)
        left = reduced.value[sample] - explained - noise[member]
        left -= background @ reduced.cell_design.T + diagonal @ reduced.diagonal_design.T
        gain = reduced.gain(one.amplitude, sample)
        move = np.linalg.inv(reduced.covariance(one.amplitude, sample)) @ gain
        more = left @ move
        size = cell.shape[1]
        cell = cell + background + more[:, :size]
        reflectance = reduced.prior.reflectance_mean + dips + diagonal + more[:, size:]
        design = np.concatenate([reduced.cell_design, reduced.diagonal_design], axis=1)
        cut = back_on_captures(np.concatenate([cell, reflectance], axis=1), design, move, size)
        shown = np.maximum(cut[:, :size] + unshown[member], 0.0)
        out[member] = cells.matrix(shown, cut[:, size:])
    return out


def remaining_variance(reduced: Reduced) -> FloatArray:
    """Share of the variance of a smooth prior that the captures leave of every cell, (C,).

    What illuminants and channels see, whatever the material is.
    """
    prior, explained = reduced.explained_variance(ALONE)
    return np.asarray(np.clip(1.0 - explained / prior, 0.0, 1.0))


def hidden(reduced: Reduced, prior: PriorDraws, scale: FloatArray) -> FloatArray:
    """Draws (N, C) of smooth fluorescence that the first sample's captures do not show.

    What a prior of amplitude `ALONE` leaves after captures of nothing: its draws less what captures
    of them would have told. Their sign is either, so that 0 is never excluded by them.

    Args:
        reduced: the captures.
        prior: N draws.
        scale: factor of every cell, (C,).
    """
    draw = ALONE * prior.cell
    told = np.linalg.solve(reduced.covariance(ALONE, 0), (draw @ reduced.cell_design.T).T).T
    size = draw.shape[1]
    left = draw - told @ reduced.gain(ALONE, 0)[:, :size]
    return scale * left


def misshapen(
    reduced: Reduced, prior: PriorDraws, sample: int, cells: FloatArray, remaining: FloatArray
) -> FloatArray:
    """Draws (N, C) of what fluorophores of another shape than the estimate's add to it.

    A Gaussian process in proportion to the estimate, less what the captures would have told of it
    (Matheron's rule).

    Args:
        reduced: the captures.
        prior: N draws; their order is turned round, because `draws` uses them too.
        sample: which of the B samples.
        cells: the estimate, (C,).
        remaining: as `remaining_variance`, (C,).
    """
    scale = (MISSHAPEN + MISSHAPEN_UNSEEN * np.sqrt(remaining)) * cells
    draw = scale * prior.local[::-1]
    gain = ((reduced.cell_design * scale) @ reduced.kernels.local) * scale
    covariance = gain @ reduced.cell_design.T + reduced.covariance(0.0, sample)
    told = np.linalg.solve(covariance, (draw @ reduced.cell_design.T).T).T
    return np.asarray(draw - told @ gain)
