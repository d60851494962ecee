"""A small network that gives the posterior mean of a set-up's unknowns, in two looks.

    x  = (asinh z, z / s, ln s)     z: whitened captures; s: size of the linear estimate's cells
    h  = layers(x)
    u  = linear estimate + (s or 0.2) * linear(h) + s * sum_k em_k(h) ex_k(h)
    y  = (asinh w, w / s, h, ln s)  w: what the captures say beyond u, in units of the noise
    unknowns = u + (s or 0.2) * linear(layer(y))

The products are what fluorophores are (Kasha's rule), free of the shapes that the draws have. The
second look is one step of an inference that learns its own steps (Putzky and Welling 2017,
recurrent inference machines): captures of strong dyes say far more than a network that sees them
once comes to. `learned_training` makes one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.fluorescence.cells import Cells
from twin.spectra import FloatArray

Single = NDArray[np.float32]
Layer = tuple[Single, Single]
Weights = dict[str, Layer]
"""Weights and offsets by name: `layer0`, `layer1` ..., `first`, `products`, `second`, `last`,
`spread`."""

FAINT = 1e-3
"""Root mean square of the cells below which all materials count alike."""
DIAGONAL = 0.2
"""Scale of the corrections of the reflectance."""
SIZES = (1e-3, 3e-3, 1e-2, 3e-2, 1e-1)
"""Of the cells, for which covariances are kept: the network's errors grow with them."""


@dataclass(frozen=True, eq=False)
class Fixed:
    """What is known before the training; M valid captures, N = C + D unknowns, m directions.

    Attributes:
        centre: of the captures, (M,); middle: of the unknowns, (N,); linear: (M, N).
        directions: of the captures, (M, m), to variance 1; white: the same, to noise 1.
    """

    centre: Single
    middle: Single
    linear: Single
    directions: Single
    white: Single


@dataclass(frozen=True, eq=False)
class Network:
    """M valid captures, N = C + D unknowns.

    Attributes:
        cells: the unknowns.
        fixed: what is known before the training.
        weights: of the layers.
        inverse: of the covariance of what the captures say beyond the estimate, for every size,
            (L, M, M).
    """

    cells: Cells
    fixed: Fixed
    weights: Weights
    inverse: FloatArray

    def unknowns(
        self, value: FloatArray, beyond: Callable[[FloatArray], FloatArray]
    ) -> tuple[FloatArray, FloatArray, int]:
        """Estimate (N,), how far its quantiles lie below and above it, (2, N), index of `inverse`.

        Args:
            value: captures under the calibration that the network was made for, (M,).
            beyond: what the captures say beyond unknowns (N,): (M,), by any calibration.
        """
        fixed, weights = self.fixed, self.weights
        base, size, seen = first_look(fixed, len(self.cells.emission), value.astype(np.float32), np)
        h = hidden(weights, seen, np)
        scale = np.full(base.size, DIAGONAL, dtype=np.float32)
        scale[: len(self.cells.emission)] = size
        row, column = np.nonzero(self.cells.below_diagonal)
        found = base + scale * _linear(weights["first"], h)
        found[: row.size] += size * products(weights, h, self.cells, np)[row, column]
        np.maximum(found, 0.0, out=found)
        np.minimum(found[row.size :], 1.0, out=found[row.size :])
        left = beyond(found.astype(np.float64)).astype(np.float32)
        h = swish(_linear(weights["second"], second_look(left @ fixed.white, size, h, np)), np)
        found += scale * _linear(weights["last"], h)
        wide = np.logaddexp(0.0, _linear(weights["spread"], h)).reshape(2, -1) * scale
        nearest = int(np.abs(np.log(np.array(SIZES)) - np.log(float(size[0]))).argmin())
        return found.astype(np.float64), wide.astype(np.float64), nearest

    def arrays(self) -> dict[str, Any]:
        """All that the network is, but its cells, as arrays by name."""
        flat = {f"{name}.{k}": each[k] for name, each in self.weights.items() for k in (0, 1)}
        return {**vars(self.fixed), **flat, "inverse": self.inverse}

    @classmethod
    def of(cls, arrays: Mapping[str, Any], cells: Cells) -> Network:
        """The network that `arrays` describes."""
        names = sorted({name.partition(".")[0] for name in arrays if "." in name})
        weights = {name: (arrays[f"{name}.0"], arrays[f"{name}.1"]) for name in names}
        fixed = Fixed(**{name: arrays[name] for name in Fixed.__dataclass_fields__})
        return cls(cells, fixed, weights, arrays["inverse"])


def first_look(fixed: Fixed, count: int, value: Any, xp: Any) -> tuple[Any, Any, Any]:
    """Linear estimate (..., N), size of its `count` cells (..., 1), what the layers see.

    Args:
        fixed: of the network.
        count: C.
        value: captures, (..., M).
        xp: numpy or jax.numpy.
    """
    left = value - fixed.centre
    base = fixed.middle + left @ fixed.linear
    size = xp.sqrt((base[..., :count] ** 2).mean(axis=-1, keepdims=True)) + np.float32(0.5 * FAINT)
    white = left @ fixed.directions
    parts = [xp.arcsinh(white), white * (np.float32(0.02) / size), xp.log(size) + np.float32(4.5)]
    return base, size, xp.concatenate(parts, axis=-1)


def second_look(white: Any, size: Any, h: Any, xp: Any) -> Any:
    """What the last layer sees of captures (..., m) beyond the first estimate, noise 1."""
    near = white * (np.float32(0.002) / size)
    return xp.concatenate([xp.arcsinh(white), near, h, xp.log(size) + np.float32(4.5)], axis=-1)


def hidden(weights: Mapping[str, Any], seen: Any, xp: Any) -> Any:
    """The last of the layers, (..., width)."""
    h, depth = seen, 0
    while f"layer{depth}" in weights:
        h, depth = swish(_linear(weights[f"layer{depth}"], h), xp), depth + 1
    return h


def products(weights: Mapping[str, Any], h: Any, cells: Cells, xp: Any) -> Any:
    """Sum of the products of the first look, (..., Wo, Wi), times the size of the cells."""
    rows, columns = cells.below_diagonal.shape
    both = _linear(weights["products"], h)
    both = both.reshape(*both.shape[:-1], -1, rows + columns)
    return xp.swapaxes(both[..., :rows], -1, -2) @ both[..., rows:]


def swish(x: Any, xp: Any) -> Any:
    """Of x: x times its logistic (Ramachandran, Zoph, Le 2017)."""
    return x / (np.float32(1.0) + xp.exp(-xp.maximum(x, np.float32(-60.0))))


def _linear(layer: Any, x: Any) -> Any:
    return x @ layer[0] + layer[1]
