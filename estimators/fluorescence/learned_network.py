"""A small network that learns the posterior mean of a set-up's unknowns from drawn materials.

    x = (asinh z, z / s, ln s)     z: whitened captures; s: size of the linear estimate's cells
    unknowns = linear estimate + (s or 0.2) * network(x)

Trained on draws of the prior with the noise of the captures, the network of least mean error comes
to the mean of the posterior (simulation-based inference: Cranmer, Brehmer, Louppe 2020), with
every candidate and every product weighed. Here the mean of the logarithm of a material's error is
made least, so that faint materials count as much as bright ones. The 0.05 and 0.95 quantiles are
linear in the last layer and learn the pinball loss (Koenker and Bassett 1978). What the captures
say beyond the network is added by a gain, made from the network's own errors on draws.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.fluorescence.cells import Cells
from estimators.fluorescence.learned_draws import MaterialPrior, materials
from twin.spectra import FloatArray

Single = NDArray[np.float32]
Layer = tuple[Single, Single]

BLOCK, BATCH = 10000, 500
STEP = 2e-3
"""Of Adam, at the start; it falls to 0 as a half cosine."""
FAINT = 1e-3
"""Root mean square of the cells below which all materials count alike."""
DIAGONAL = 0.2
"""Weight of the reflectance in the loss, and scale of its corrections."""
HELD = 8000
"""Most draws that the network's errors are taken from."""
WHITE = 2e-3
"""Standard deviation of single unknowns that the gain leaves room for."""
LEVELS = (0.05, 0.95)
SIZES = (1e-3, 3e-3, 1e-2, 3e-2, 1e-1)
"""Of the cells, for which gains are made: the network's errors grow with them."""


@dataclass(frozen=True, eq=False)
class Network:
    """M valid captures, N = C + D unknowns, m directions.

    Attributes:
        count: C; centre: of the captures, (M,); middle: of the unknowns, (N,).
        linear: (M, N); directions: (M, m).
        layers: weights and offsets; head, spread: from the last layer to N and 2 N.
        move: gains of what is left of the captures, for every size, (L, M, N).
        inverse: of the covariance of what is left, (L, M, M).
    """

    count: int
    centre: Single
    middle: Single
    linear: Single
    directions: Single
    layers: tuple[Layer, ...]
    head: Layer
    spread: Layer
    move: FloatArray
    inverse: FloatArray

    def unknowns(self, value: FloatArray) -> tuple[FloatArray, FloatArray, int]:
        """Estimate (N,), how far its quantiles lie below and above it, (2, N), index of the gain.

        Args:
            value: captures under the calibration that the network was made for, (M,).
        """
        left = (value - self.centre).astype(np.float32)
        base = self.middle + left @ self.linear
        size = _size(base[: self.count], np)
        h = _features(left @ self.directions, size, np)
        for weight, offset in self.layers:
            h = h @ weight + offset
            h = h / (1.0 + np.exp(-np.maximum(h, -60.0)))
        scale = np.full(base.size, DIAGONAL, dtype=np.float32)
        scale[: self.count] = size
        found = base + scale * (h @ self.head[0] + self.head[1])
        wide = np.logaddexp(0.0, h @ self.spread[0] + self.spread[1]).reshape(2, -1) * scale
        nearest = int(np.abs(np.log(np.array(SIZES)) - np.log(float(size[0]))).argmin())
        return found.astype(np.float64), wide.astype(np.float64), nearest


def train(
    design: FloatArray, noise: FloatArray, cells: Cells, prior: MaterialPrior, *,
    draws: int, epochs: int, width: int, layers: int, directions: int, seed: int,
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
        layers: number of layers.
        directions: most directions of the captures that are kept.
        seed: of all random numbers.
    """
    random = np.random.Generator(np.random.Philox(key=seed))
    target = np.empty((draws, design.shape[1]), dtype=np.float32)
    for begin in range(0, draws, BLOCK):
        many = min(BLOCK, draws - begin)
        target[begin : begin + many] = materials(many, cells, prior, random)
    value = target @ design.T.astype(np.float32)
    count = int(cells.below_diagonal.sum())
    faint = 1.0 / ((target[:, :count] ** 2).mean(axis=1) + FAINT**2)
    share = (faint / faint.sum()).astype(np.float32)[:, None]
    centre, middle = (share * value).sum(axis=0), (share * target).sum(axis=0)
    weighed = (share * (value - centre)).T
    covariance = weighed.astype(np.float64) @ (value - centre) + noise
    linear = np.linalg.solve(covariance, weighed @ (target - middle)).astype(np.float32)
    sigma = np.sqrt(np.diagonal(noise))
    variance, vector = np.linalg.eigh(covariance / sigma / sigma[:, None])
    most = vector[:, ::-1][:, :directions] / np.sqrt(variance[::-1][:directions])
    fixed = (centre, middle, linear, (most / sigma[:, None]).astype(np.float32))
    root = np.linalg.cholesky(noise).astype(np.float32)

    def noisy(index: NDArray[np.intp]) -> Single:
        drawn = random.standard_normal((index.size, len(root)), dtype=np.float32)
        return np.asarray(value[index] + drawn @ root.T)

    sizes = [2 * fixed[3].shape[1] + 1, *[width] * layers]
    start = [_layer(random, a, b, np.sqrt(2.0 / a)) for a, b in pairwise(sizes)]
    start.append(_layer(random, width, target.shape[1], 0.05 / np.sqrt(width)))
    start.append(_layer(random, width, 2 * target.shape[1], 0.05 / np.sqrt(width)))
    mean_step, spread_step, estimate = _programs(fixed, count)
    found: Any = start
    for step, rounds in ((mean_step, epochs), (spread_step, max(1, epochs // 5))):
        found = _descend(step, found, target, noisy, rounds, random)
    held = np.arange(min(HELD, draws))
    matrix, scale = (np.asarray(each, dtype=np.float64) for each in estimate(found, noisy(held)))
    wrong = (target[held] - matrix) / scale
    relative = wrong.T @ wrong / len(held)
    moves, inverses = [], []
    for size in SIZES:
        wide = np.full(len(relative), DIAGONAL)
        wide[:count] = size
        spread = wide[:, None] * relative * wide
        spread[np.diag_indices_from(spread)] += WHITE**2
        inverse = np.linalg.inv(design @ spread @ design.T + noise)
        inverses.append(inverse)
        moves.append(inverse @ design @ spread)
    *inner, head, outer = [(np.asarray(a), np.asarray(b)) for a, b in found]
    return Network(count, *fixed, tuple(inner), head, outer, np.array(moves), np.array(inverses))


def _layer(random: np.random.Generator, before: int, after: int, scale: float) -> Layer:
    drawn = random.standard_normal((before, after), dtype=np.float32) * np.float32(scale)
    return drawn, np.zeros(after, dtype=np.float32)


def _size(cells: Any, xp: Any) -> Any:
    return xp.sqrt((cells**2).mean(axis=-1, keepdims=True)) + np.float32(0.5 * FAINT)


def _features(white: Any, size: Any, xp: Any) -> Any:
    """What the network sees of whitened captures (..., m), (..., 2 m + 1)."""
    parts = [xp.arcsinh(white), white * (np.float32(0.02) / size), xp.log(size) + np.float32(4.5)]
    return xp.concatenate(parts, axis=-1)


def _descend(
    step: Callable[..., Any], start: Any, target: Single,
    noisy: Callable[[NDArray[np.intp]], Single], epochs: int, random: np.random.Generator,
) -> Any:  # fmt: skip
    """Adam (Kingma and Ba 2015) over all draws, `epochs` times."""
    batch = min(BATCH, len(target))
    total, turn = epochs * (len(target) // batch), 0
    zero = [(np.zeros_like(a), np.zeros_like(b)) for a, b in start]
    state = (start, zero, zero, np.float32(0.0))
    for _ in range(epochs):
        order = random.permutation(len(target))
        for begin in range(0, len(order) - batch + 1, batch):
            index = np.sort(order[begin : begin + batch])
            rate = np.float32(0.5 * STEP * (1.0 + np.cos(np.pi * turn / total)) + 1e-5)
            state = step(state, noisy(index), target[index], rate)
            turn += 1
    return state[0]


def _programs(
    fixed: tuple[Single, ...], count: int
) -> tuple[Callable[..., Any], Callable[..., Any], Callable[..., Any]]:
    """Compiled: a step for the mean, a step for the quantiles, the estimate inside its bounds."""
    from twin.adding_doubling.runtime import prepare_jax

    prepare_jax()
    import jax
    import jax.numpy as jnp

    centre, middle, linear, directions = (jnp.asarray(each) for each in fixed)
    single = jnp.float32

    def hidden(p: Any, value: Any) -> tuple[Any, Any, Any]:
        left = value - centre
        base = middle + left @ linear
        size = _size(base[:, :count], jnp)
        h = _features(left @ directions, size, jnp)
        for weight, offset in p[:-2]:
            h = jax.nn.silu(h @ weight + offset)
        ones = jnp.ones_like(base)
        return h, base, jnp.where(jnp.arange(base.shape[1]) < count, size * ones, single(DIAGONAL))

    def free(p: Any, value: Any) -> Any:
        h, base, scale = hidden(p, value)
        return base + scale * (h @ p[-2][0] + p[-2][1])

    def estimate(p: Any, value: Any) -> tuple[Any, Any]:
        found = jnp.maximum(free(p, value), single(0.0))
        return found.at[:, count:].min(single(1.0)), hidden(p, value)[2]

    def mean_loss(p: Any, value: Any, target: Any) -> Any:
        error = (free(p, value) - target) ** 2
        size = (target[:, :count] ** 2).mean(axis=1) + single(FAINT**2)
        cells = jnp.log(single(1e-3) + error[:, :count].mean(axis=1) / size).mean()
        reflected = jnp.log(single(1e-4) + error[:, count:].mean(axis=1)).mean()
        return cells + single(DIAGONAL) * reflected

    def spread_loss(p: Any, value: Any, target: Any) -> Any:
        h, _, scale = jax.lax.stop_gradient(hidden(p, value))
        wrong = jax.lax.stop_gradient(target - estimate(p, value)[0]) / scale
        wide = jax.nn.softplus(h @ p[-1][0] + p[-1][1])
        low, high = -wide[:, : target.shape[1]], wide[:, target.shape[1] :]
        loss = single(0.0)
        for level, edge in zip(LEVELS, (low, high), strict=True):
            beyond = wrong - edge
            loss += jnp.maximum(single(level) * beyond, single(level - 1.0) * beyond).mean()
        return loss

    def step_of(loss: Any) -> Callable[..., Any]:
        slope = jax.grad(loss)

        def step(state: Any, value: Any, target: Any, rate: Any) -> Any:
            p, mean, square, time = state
            g, time = slope(p, value, target), time + single(1.0)
            a, b = single(0.9), single(0.99)
            mean = jax.tree.map(lambda m, d: a * m + (1 - a) * d, mean, g)
            square = jax.tree.map(lambda s, d: b * s + (1 - b) * d * d, square, g)

            def moved(q: Any, m: Any, s: Any) -> Any:
                root = jnp.sqrt(s / (1 - b**time)) + single(1e-8)
                return q - rate * (m / (1 - a**time)) / root

            return jax.tree.map(moved, p, mean, square), mean, square, time

        return jax.jit(step)

    return step_of(mean_loss), step_of(spread_loss), jax.jit(estimate)
