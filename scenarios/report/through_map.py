"""Relative intensities of known optical properties, read from an appearance map."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from twin.spectra import FloatArray


class Map(Protocol):
    """What is read from an appearance map (twin.appearance.AppearanceMap).

    Grids albedo (A,), sigma_t_per_mm (S,), g (G,); I = sum_b series[..., b] rho**exponent[b].
    """

    @property
    def albedo(self) -> FloatArray:
        """Albedos, shape (A,)."""
        ...

    @property
    def sigma_t_per_mm(self) -> FloatArray:
        """Extinction coefficients [1/mm], shape (S,)."""
        ...

    @property
    def g(self) -> FloatArray:
        """Anisotropy factors, shape (G,)."""
        ...

    @property
    def thickness_mm(self) -> float:
        """Thickness [mm]."""
        ...

    @property
    def n(self) -> float:
        """Refractive index."""
        ...

    @property
    def exponent(self) -> FloatArray:
        """Exponents, shape (B,)."""
        ...

    @property
    def black_series(self) -> FloatArray:
        """Coefficients over black, shape (A, S, G, B)."""
        ...

    @property
    def white_series(self) -> FloatArray:
        """Coefficients over white, shape (A, S, G, B)."""
        ...

    @property
    def collimated(self) -> FloatArray:
        """Collimated intensity, shape (A, S, G)."""
        ...


def map_for(maps: Sequence[Map], thickness_mm: float) -> Map | None:
    """The map of a thickness [mm], or None; a map of another thickness is never used instead."""
    for candidate in maps:
        if abs(candidate.thickness_mm - thickness_mm) <= 1e-6 * max(1.0, thickness_mm):
            return candidate
    return None


def intensities_of(found: Map, rho_black: float, rho_white: float) -> FloatArray:
    """Black, white and collimated intensity at every node, shape (A, S, G, 3)."""
    black = found.black_series @ np.power(rho_black, found.exponent)
    white = found.white_series @ np.power(rho_white, found.exponent)
    return np.stack([black, white, found.collimated], axis=-1)


def intensities_through(
    maps: Sequence[Map],
    thickness_mm: float,
    properties: FloatArray,
    rho_black: FloatArray,
    rho_white: FloatArray,
) -> FloatArray | None:
    """Intensities of optical properties, cubic in albedo, log sigma_t and g between the nodes.

    Args:
        maps: where to look for the map of the thickness.
        thickness_mm: thickness [mm].
        properties: albedo, sigma_t [1/mm] and g, shape (3, W).
        rho_black: reflectance of the black background, shape (W,).
        rho_white: reflectance of the white background, shape (W,).

    Returns:
        Black, white and collimated, shape (3, W), NaN outside the map's grid; None without a map.
    """
    found = map_for(maps, thickness_mm)
    if found is None:
        return None
    with np.errstate(divide="ignore"):
        axes = (
            _nodes(found.albedo, properties[0]),
            _nodes(np.log(found.sigma_t_per_mm), np.log(properties[1])),
            _nodes(found.g, properties[2]),
        )
    (i, wi), (j, wj), (k, wk) = axes
    where = (i[:, :, None, None], j[:, None, :, None], k[:, None, None, :])
    weight = wi[:, :, None, None] * wj[:, None, :, None] * wk[:, None, None, :]
    power_black = rho_black[:, None] ** found.exponent
    power_white = rho_white[:, None] ** found.exponent
    return np.stack(
        [
            np.einsum("wijk,wijkb,wb->w", weight, found.black_series[where], power_black),
            np.einsum("wijk,wijkb,wb->w", weight, found.white_series[where], power_white),
            np.einsum("wijk,wijk->w", weight, found.collimated[where]),
        ]
    )


def _nodes(grid: FloatArray, wanted: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
    """The nearest nodes, at most four, and their Lagrange weights, shape (W, K); NaN outside."""
    count = min(4, grid.size)
    cell = np.searchsorted(grid, wanted, side="right") - 1
    first = np.clip(cell - (count - 1) // 2, 0, grid.size - count)
    index = first[:, None] + np.arange(count)
    x = grid[index]
    weight = np.ones(x.shape)
    for node in range(count):
        for other in range(count):
            if other != node:
                weight[:, node] *= (wanted - x[:, other]) / (x[:, node] - x[:, other])
    tolerance = 1e-9 * max(1.0, abs(float(grid[-1])))
    inside = (wanted >= grid[0] - tolerance) & (wanted <= grid[-1] + tolerance)
    return index, np.where(inside[:, None], weight, np.nan)
