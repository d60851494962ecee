"""Candidate explanations of the captures: numbers of products, amplitudes of the background.

Each chain goes from a background that may explain much to one that may explain little, so that
the products settle on the peaks one after another instead of in a local minimum. The candidates
are then weighed by their evidence.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimators.fluorescence.background import Reduced
from estimators.fluorescence.fit import Fit, background_fit, fit
from estimators.fluorescence.products import Products
from twin.spectra import FloatArray

LARGEST_CELL = 1.0
ALONE = 0.02
"""Amplitude of the background where it has to explain the fluorescence alone."""


def candidates(
    reduced: Reduced, model: Products, amplitudes: Sequence[float], steps: int, most: int
) -> list[Fit]:
    """Fits of B samples with 0 to `most` products at every amplitude, coarse to fine."""
    alone = background_fit(reduced, ALONE)
    found = [alone]
    if most == 0:
        return found
    rough = residual_cells(reduced, alone)
    chains = [chain(reduced, model, amplitudes, steps, _factors(model, rough, 1))]
    coarse = chains[0][0]
    for number in range(2, most + 1):
        peaks = _peak(model, residual_cells(reduced, coarse))
        grown = np.concatenate([coarse.parameters, peaks[:, None]], axis=1)
        chains.append(chain(reduced, model, amplitudes, steps, grown))
        coarse = chains[-1][0]
        if number == 2:
            start = _factors(model, rough, 2)
            chains.append(chain(reduced, model, amplitudes, steps, start))
    return found + [each for one in chains for each in one]


def chain(
    reduced: Reduced, model: Products, amplitudes: Sequence[float], steps: int, start: FloatArray
) -> list[Fit]:
    """Fits at every amplitude, each from the last."""
    found: list[Fit] = []
    for amplitude in amplitudes:
        one = fit(reduced, model, amplitude, start, steps)
        start = one.parameters
        if not found and reduced.prior.local > 0.0:
            around = np.minimum(model.fluorescence(start), LARGEST_CELL)
            reduced = reduced.but(local=reduced.prior.local * around)
        found.append(one)
    return found


def residual_cells(reduced: Reduced, one: Fit) -> FloatArray:
    """What the background says of the fluorescence cells, as matrices (B, Wo, Wi)."""
    values, _ = reduced.background(one.amplitude, one.weighted)
    values[:, reduced.kernels.near] = 0.0  # reflectance leaks there: no start for a product
    grid = reduced.captures.cells
    return grid.matrix(values, np.zeros((len(values), grid.diagonal_nm.size)))


def _peak(model: Products, matrix: FloatArray) -> FloatArray:
    """One product at the largest cell of every matrix (B, Wo, Wi)."""
    grid = model.cells
    flat = matrix.reshape(len(matrix), -1)
    row, column = np.unravel_index(flat.argmax(axis=1), matrix.shape[1:])
    emission = grid.emission_nm[row]
    peak = np.maximum(flat.max(axis=1), 1e-4)
    return model.start(peak, emission, emission - grid.excitation_nm[column])


def _factors(model: Products, matrix: FloatArray, count: int, rounds: int = 60) -> FloatArray:
    """Starts (B, K, P): peaks of a non-negative factorisation of the cells (Lee and Seung 2001)."""
    grid = model.cells
    seen = grid.below_diagonal.astype(np.float64)
    rows, columns = seen.shape
    target = np.maximum(matrix, 0.0) * seen + 1e-7
    centre = np.linspace(0.2, 0.8, count) * (rows - 1) if count > 1 else np.array([rows / 2])
    width = rows / 5 if count > 1 else rows
    first = np.exp(-0.5 * ((np.arange(rows)[:, None] - centre) / width) ** 2) + 0.05
    tilt = np.exp(0.3 * (centre / rows - 0.5)[:, None] * np.linspace(-1.0, 1.0, columns))
    em = np.repeat(first[None], len(target), axis=0)
    ex = np.repeat(tilt[None] * (seen.mean(axis=0) + 0.1), len(target), axis=0)
    for _ in range(rounds):
        ratio = target / (em @ ex + 1e-9) * seen
        em *= (ratio @ ex.transpose(0, 2, 1)) / (seen @ ex.transpose(0, 2, 1) + 1e-9)
        ratio = target / (em @ ex + 1e-9) * seen
        ex *= (em.transpose(0, 2, 1) @ ratio) / (em.transpose(0, 2, 1) @ seen + 1e-9)
    emission = grid.emission_nm[em.argmax(axis=1)]
    excitation = grid.excitation_nm[ex[:, :, :-1].argmax(axis=2)]
    return model.start(em.max(axis=1) * ex.max(axis=2), emission, emission - excitation)
