"""Materials drawn from what `donaldson` assumes of them, for an estimator that learns from draws.

    fluorescence = sum of 0 to 4 products (`products`), each times 1 + 0.2 GP(40 nm)
                 + GP(90 nm) of an amplitude that is drawn too + rough cells, then nothing below 0
                 + the reflectance in the next two cells
    reflectance  = logistic of GP(50 or 120 nm), in half of the materials less where dyes absorb

Every scale is broad, and none is of a measured matrix.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from estimators.fluorescence.background_prior import BackgroundPrior, kernels, matern52
from estimators.fluorescence.cells import Cells
from estimators.fluorescence.products import Products, ShapePrior
from twin.spectra import FloatArray

MOST_RAISED = 30.0
"""A dye that is hardly lit is not made brighter than by this factor."""


@dataclass(frozen=True, kw_only=True)
class MaterialPrior:
    """What materials are like; pairs are means and standard deviations, or lower and upper ends."""

    counts: tuple[float, ...] = (0.04, 0.40, 0.38, 0.12, 0.06)
    """Probabilities of 0, 1, 2 ... products."""
    log_largest: tuple[float, float] = (-2.9, 1.3)
    """ln of the largest cell of a product that can be lit."""
    largest: float = 0.5
    """No product has a larger cell."""
    amplitude: tuple[float, float] = (2e-4, 4e-3)
    """Of smooth cells that are no product, lowest and highest (log-uniform)."""
    roughness: tuple[float, float] = (2e-4, 1.5e-3)
    """Standard deviation of single cells, lowest and highest (log-uniform)."""
    level: tuple[float, float] = (-0.3, 1.0)
    """Logit of a material's reflectance."""
    variation: float = 0.9
    """Standard deviation of the logit over wavelength."""
    lengths_nm: tuple[float, float] = (50.0, 120.0)
    """Of the reflectance, either as likely."""
    dips: float = 0.5
    """Share of the materials whose reflectance is less where their dyes absorb."""
    deepest: float = 0.9
    """Largest relative depth of such a dip."""
    shapes: ShapePrior = field(default_factory=ShapePrior)
    background: BackgroundPrior = field(default_factory=BackgroundPrior)


def materials(
    count: int, cells: Cells, prior: MaterialPrior, random: np.random.Generator
) -> NDArray[np.float32]:
    """Draws of the unknowns: C fluorescence cells, then D reflectances, shape (count, C + D)."""
    low, high = cells.below_diagonal, cells.diagonal[1]
    row, column = np.nonzero(low)
    model = Products(np.zeros((1, *low.shape)), cells, prior.shapes)
    background = prior.background
    found = np.zeros((count, row.size), dtype=np.float32)
    cover = np.zeros((count, high.size))
    number = random.choice(len(prior.counts), size=count, p=prior.counts)
    for turn in range(len(prior.counts) - 1):
        member = np.flatnonzero(number > turn)
        if member.size == 0:
            break
        emission, excitation = model.spectra(_parameters(member.size, model, random))
        product = emission[:, row] * excitation[:, column]
        mean, scale = prior.log_largest
        top = np.exp(mean + scale * random.standard_normal(member.size))
        top = np.minimum(top, prior.largest)
        raised = MOST_RAISED * top / (emission.max(axis=1) * excitation.max(axis=1) + 1e-12)
        product *= np.minimum(top / (product.max(axis=1) + 1e-12), raised)[:, None]
        uneven = _smooth(member.size, cells, background.local_length_nm, random)
        product *= np.maximum(1.0 + background.local * uneven, 0.0)
        found[member] += product
        absorbed = excitation[:, high] / (excitation.max(axis=1, keepdims=True) + 1e-12)
        cover[member] = np.maximum(cover[member], absorbed)
    smooth = _smooth(count, cells, background.length_nm, random)
    found += _log_uniform(prior.amplitude, count, random) * smooth
    reflectance = _reflectances(count, cells, prior, cover, random)
    known = kernels(cells, background)
    away = np.rint(
        (cells.emission - cells.excitation)[known.near] / np.diff(cells.emission_nm[:2])
    ).astype(int)
    share = np.abs(random.standard_normal((count, 1)))
    root = _root(cells.diagonal_nm, background.leak_length_nm)
    curve = random.standard_normal((count, high.size)) @ root.T
    share = share * np.maximum(1.0 + background.leak_variation * curve, 0.0) * reflectance
    found[:, known.near] += (share @ known.neighbour.T) * np.array((0.0, *background.leak))[away]
    rough = random.standard_normal(found.shape, dtype=np.float32)
    found += _log_uniform(prior.roughness, count, random) * rough
    return np.concatenate([np.maximum(found, 0.0), reflectance], axis=1).astype(np.float32)


def _parameters(count: int, model: Products, random: np.random.Generator) -> FloatArray:
    """Whitened parameters (count, P) with emission peaks longer than excitation peaks."""
    drawn = random.standard_normal((count, model.size))
    mean, scale = model.prior.stokes_nm
    drawn[:, 0] = 0.0
    drawn[:, 4] = (np.abs(mean + scale * drawn[:, 4]) - mean) / scale
    return np.asarray(drawn)


def _reflectances(
    count: int, cells: Cells, prior: MaterialPrior, cover: FloatArray, random: np.random.Generator
) -> FloatArray:
    logit = np.empty((count, cells.diagonal_nm.size))
    which = random.integers(2, size=count)
    for index, length in enumerate(prior.lengths_nm):
        member = np.flatnonzero(which == index)
        drawn = random.standard_normal((member.size, logit.shape[1]))
        logit[member] = drawn @ _root(cells.diagonal_nm, length).T
    mean, scale = prior.level
    logit = random.normal(mean, scale, (count, 1)) + prior.variation * logit
    depth = random.uniform(0.0, prior.deepest, (count, 1))
    depth *= random.random((count, 1)) < prior.dips
    return np.asarray(np.clip((1.0 - depth * cover) / (1.0 + np.exp(-logit)), 0.01, 0.98))


def _log_uniform(
    ends: tuple[float, float], count: int, random: np.random.Generator
) -> NDArray[np.float32]:
    drawn = random.uniform(np.log(ends[0]), np.log(ends[1]), (count, 1))
    return np.asarray(np.exp(drawn), dtype=np.float32)


def _root(wavelength: FloatArray, length_nm: float) -> FloatArray:
    kernel = matern52(wavelength[:, None] - wavelength, length_nm)
    return np.asarray(np.linalg.cholesky(kernel + 1e-6 * np.eye(wavelength.size)))


def _smooth(
    count: int, cells: Cells, length_nm: float, random: np.random.Generator
) -> NDArray[np.float32]:
    """Draws (count, C) of a Gaussian process of standard deviation 1 over both wavelengths."""
    out = _root(cells.emission_nm, length_nm).astype(np.float32)
    into = _root(cells.excitation_nm, length_nm).astype(np.float32)
    low = cells.below_diagonal
    drawn = random.standard_normal((count, *low.shape), dtype=np.float32)
    return np.asarray((out @ drawn @ into.T)[:, low])
