"""How the network of `learned_network` is made: drawn materials, noise of the captures, descent.

Trained on draws of the prior with the noise of the captures, the network of least mean error comes
to the mean of the posterior (simulation-based inference: Cranmer, Brehmer, Louppe 2020), with
every candidate and every product weighed. Here the mean of the logarithm of a material's error is
made least, so that faint materials count as much as bright ones; the first look counts too. The
0.05 and 0.95 quantiles are linear in the last layer and learn the pinball loss (Koenker and
Bassett 1978).
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.fluorescence.cells import Cells
from estimators.fluorescence.learned_draws import MaterialPrior, materials
from estimators.fluorescence.learned_network import (
    DIAGONAL,
    FAINT,
    SIZES,
    Fixed,
    Layer,
    Network,
    Single,
    Weights,
)
from estimators.fluorescence.learned_programs import SHARES, programs
from twin.spectra import FloatArray

Report = Callable[[float, float], None]

BLOCK, BATCH = 10000, 500
"""Materials of one drawing, of one step."""
STEP = 2e-3
"""Of Adam, at the start; it falls to 0 as a half cosine."""
HELD = 8000
"""Most draws that the network's errors are taken from."""
WHITE = 2e-3
"""Standard deviation of single unknowns that the covariance of what is left has room for."""
DRAWING = 2000.0
"""Materials that are drawn in the time of a step, about."""


def train(
    design: FloatArray, noise: FloatArray, cells: Cells, prior: MaterialPrior, *,
    draws: int, epochs: int, width: int, layers: int, terms: int, directions: int, seed: int,
    report: Report,
) -> Network:  # fmt: skip
    """Train a network for one calibration and one noise.

    Args:
        design: captures of the unknowns, (M, N).
        noise: covariance of the captures, (M, M).
        cells: the unknowns.
        prior: of the materials.
        draws: number of materials.
        epochs: how often each is seen, with new noise each time.
        width: of a layer.
        layers: of the first look.
        terms: products of the first look.
        directions: most directions of the captures that are kept.
        seed: of all random numbers.
        report: told how much is done, of how much.
    """
    random = np.random.Generator(np.random.Philox(key=seed))
    batch = min(BATCH, draws)
    steps = draws // batch
    rounds = (epochs, max(1, epochs // 5))
    total, done = draws / DRAWING + sum(rounds) * steps, 0.0

    def tell(more: float) -> None:
        nonlocal done
        done += more
        report(min(done, total), total)

    target = np.empty((draws, design.shape[1]), dtype=np.float32)
    for begin in range(0, draws, BLOCK):
        many = min(BLOCK, draws - begin)
        target[begin : begin + many] = materials(many, cells, prior, random)
        tell(many / DRAWING)
    value = target @ design.T.astype(np.float32)
    fixed = _fixed(target, value, noise, len(cells.emission), directions)
    root = np.linalg.cholesky(noise).astype(np.float32)

    def noisy(index: NDArray[np.intp]) -> Single:
        drawn = random.standard_normal((index.size, len(root)), dtype=np.float32)
        return np.asarray(value[index] + drawn @ root.T)

    found: Any = _start(fixed, cells, width, layers, terms, random)
    with ThreadPoolExecutor(min(SHARES, os.cpu_count() or 1)) as pool:
        *both, estimate = programs(fixed, design.astype(np.float32), cells, batch, pool)
        for step, many in zip(both, rounds, strict=True):
            found = _descend(step, found, target, noisy, many, random, tell)
    held = np.arange(min(HELD, draws))
    matrix, scale = (np.asarray(each, dtype=np.float64) for each in estimate(found, noisy(held)))
    inverse = _inverses((target[held] - matrix) / scale, design, noise, len(cells.emission))
    weights = {name: (np.asarray(a), np.asarray(b)) for name, (a, b) in found.items()}
    return Network(cells, fixed, weights, inverse)


def _fixed(target: Single, value: Single, noise: FloatArray, count: int, directions: int) -> Fixed:
    """The linear estimate, and the directions of the captures that vary most, over the noise."""
    faint = 1.0 / ((target[:, :count] ** 2).mean(axis=1) + FAINT**2)
    share = (faint / faint.sum()).astype(np.float32)[:, None]
    centre, middle = (share * value).sum(axis=0), (share * target).sum(axis=0)
    weighed = (share * (value - centre)).T
    covariance = weighed.astype(np.float64) @ (value - centre) + noise
    linear = np.linalg.solve(covariance, weighed @ (target - middle)).astype(np.float32)
    sigma = np.sqrt(np.diagonal(noise))
    variance, vector = np.linalg.eigh(covariance / sigma / sigma[:, None])
    most = vector[:, ::-1][:, :directions] / sigma[:, None]
    to_one = most / np.sqrt(variance[::-1][:directions])
    return Fixed(centre, middle, linear, to_one.astype(np.float32), most.astype(np.float32))


def _start(
    fixed: Fixed, cells: Cells, width: int, layers: int, terms: int, random: np.random.Generator
) -> Weights:
    kept, unknowns = fixed.directions.shape[1], fixed.middle.size

    def layer(before: int, after: int, scale: float) -> Layer:
        drawn = random.standard_normal((before, after), dtype=np.float32) * np.float32(scale)
        return drawn, np.zeros(after, dtype=np.float32)

    sizes = [2 * kept + 1, *[width] * layers]
    start = {f"layer{k}": layer(a, b, np.sqrt(2.0 / a)) for k, (a, b) in enumerate(pairwise(sizes))}
    thin = 1.0 / np.sqrt(width)
    return start | {
        "first": layer(width, unknowns, 0.05 * thin),
        "products": layer(width, terms * sum(cells.below_diagonal.shape), 0.3 * thin),
        "second": layer(2 * kept + width + 1, width, np.sqrt(2.0 / (2 * kept + width + 1))),
        "last": layer(width, unknowns, 0.02 * thin),
        "spread": layer(width, 2 * unknowns, 0.05 * thin),
    }


def _inverses(wrong: FloatArray, design: FloatArray, noise: FloatArray, count: int) -> FloatArray:
    """Of the captures' covariance around the estimate, from relative errors (H, N)."""
    relative, found = wrong.T @ wrong / len(wrong), []
    for size in SIZES:
        wide = np.full(len(relative), DIAGONAL)
        wide[:count] = size
        spread = wide[:, None] * relative * wide
        spread[np.diag_indices_from(spread)] += WHITE**2
        found.append(np.linalg.inv(design @ spread @ design.T + noise))
    return np.array(found)


def _descend(
    step: Callable[..., Any], start: Any, target: Single,
    noisy: Callable[[NDArray[np.intp]], Single], epochs: int, random: np.random.Generator,
    tell: Callable[[float], None],
) -> Any:  # fmt: skip
    """Adam (Kingma and Ba 2015) over all draws, `epochs` times."""
    batch = min(BATCH, len(target))
    total, turn = epochs * (len(target) // batch), 0
    zero = {name: (np.zeros_like(a), np.zeros_like(b)) for name, (a, b) in start.items()}
    state = (start, zero, zero, np.float32(0.0))
    for _ in range(epochs):
        order = random.permutation(len(target))
        for begin in range(0, len(order) - batch + 1, batch):
            index = np.sort(order[begin : begin + batch])
            rate = np.float32(0.5 * STEP * (1.0 + np.cos(np.pi * turn / total)) + 1e-5)
            state = step(state, noisy(index), target[index], rate)
            turn += 1
            tell(1.0)
    return state[0]
