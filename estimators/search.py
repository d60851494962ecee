"""Look-ups of many capture triples at once in one appearance map, on all cores."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.map_grid import MapNodes
from twin.spectra import FloatArray

STEPS = (24, 48, 32)
"""Most Newton steps, face crossings and projection steps of one look-up."""

RETRIES = 4
"""Further starting points of a search that ended outside the map."""


class Found(NamedTuple):
    """Answers of a look-up of Q capture triples."""

    place: FloatArray
    """Grid coordinates, shape (Q, 3): of the triple, or of the nearest element found."""
    rest: FloatArray
    """Triple minus the captures at the place, shape (Q, 3); 0 inside the map."""
    inside: NDArray[np.bool_]
    """Whether an element of the map contains the triple, shape (Q,)."""


def search(
    grid: MapNodes,
    triple: FloatArray,
    row: NDArray[np.int32],
    power: FloatArray,
    rho: tuple[float, float],
    scale: FloatArray,
    *,
    threads: int = 2,
) -> Found:
    """Find capture triples in the map without knowing where to start.

    As `look_up`, starting from the nearest node; what is not found inside is looked for again
    from the next `RETRIES` nodes, and the answer with the least scaled mismatch stays: the map
    is squeezed, and may be folded by its noise, where little scatters or no light comes back.

    Args:
        grid: the map.
        triple: (I_black, I_white, third) to find, finite, shape (Q, 3).
        row: wavelength of every triple, shape (Q,).
        power: `grid.power` of the wavelengths, shape (W, 2B).
        rho: black and white reflectance at which the nearest nodes are taken.
        scale: unit of the mismatch, shape (W, 3).
        threads: launches at a time.
    """
    found = look_up(grid, triple, row, power, grid.nearest(triple, *rho), scale, threads=threads)
    for rank in range(2, 2 + RETRIES):
        again = np.flatnonzero(~found.inside)
        if again.size == 0:
            break
        start = grid.nearest(triple[again], *rho, rank=rank * (rank - 1) // 2 + 1)
        other = look_up(grid, triple[again], row[again], power, start, scale, threads=threads)
        unit = scale[row[again]]
        better = other.inside | (
            np.sum((other.rest / unit) ** 2, axis=1)
            < np.sum((found.rest[again] / unit) ** 2, axis=1)
        )
        for old, new in zip(found, other, strict=True):
            old[again[better]] = new[better]
    return found


def look_up(
    grid: MapNodes,
    triple: FloatArray,
    row: NDArray[np.int32],
    power: FloatArray,
    start: FloatArray,
    scale: FloatArray,
    *,
    steps: Sequence[int] = STEPS,
    threads: int = 2,
) -> Found:
    """Find capture triples in the map.

    Args:
        grid: the map.
        triple: (I_black, I_white, third) to find, finite, shape (Q, 3).
        row: wavelength of every triple, shape (Q,).
        power: `grid.power` of the wavelengths, shape (W, 2B).
        start: places to start from, shape (Q, 3).
        scale: unit of the mismatch that the projection of points outside minimises, (W, 3).
        steps: most Newton steps, face crossings and projection steps.
        threads: launches at a time; the answers do not depend on it.
    """
    import warp as wp

    # A greeting on standard output would spoil what a command prints there.
    wp.config.log_level = wp.LOG_WARNING
    from estimators import lut_kernels

    count = len(triple)
    place, rest = np.zeros((count, 3)), np.zeros((count, 3))
    inside = np.zeros(count, dtype=np.int32)
    if count == 0:
        return Found(place, rest, inside.astype(bool))
    wp.init()

    def shared(values: Any, dtype: Any) -> Any:
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device="cpu", copy=False)

    inputs: list[Any] = [
        shared(grid.series.reshape(-1), wp.float64),
        shared(power, wp.float64),
        shared(grid.third, wp.float64),
        wp.vec3i(*grid.shape),
        grid.exponent.size,
        shared(triple, wp.vec3d),
        shared(row.astype(np.int32), wp.int32),
        shared(start, wp.vec3d),
        shared(scale, wp.vec3d),
        wp.vec3i(*steps),
    ]
    outputs = [shared(place, wp.vec3d), shared(rest, wp.vec3d), shared(inside, wp.int32)]
    wp.load_module(lut_kernels, device="cpu")

    def launch(part: tuple[int, int]) -> None:
        first, size = part
        wp.launch(
            lut_kernels.invert, dim=size, inputs=[*inputs, first], outputs=outputs, device="cpu"
        )

    blocks = threads * 8 if count > 4096 else threads if count > 256 else 1
    edges = np.linspace(0, count, blocks + 1).astype(int)
    parts = [(int(a), int(b - a)) for a, b in pairwise(edges) if b > a]
    if threads > 1 and len(parts) > 1:
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(launch, parts))
    else:
        for part in parts:
            launch(part)
    return Found(place, rest, inside.astype(bool))
