"""Kernels that turn directions and resample hand-made populations, for the tests."""

from __future__ import annotations

import warp as wp

from twin.transport.population_kernels import (
    Generation,
    Splitting,
    log_spacing,
    resample,
)
from twin.transport.sampling_kernels import turn_upright


@wp.kernel
def turn_kernel(
    direction: wp.array(dtype=wp.vec3),
    cosine: wp.array(dtype=float),
    azimuth: wp.array(dtype=float),
    out: wp.array(dtype=wp.vec3),
):
    """Each direction turned by its angle, at its azimuth."""
    i = wp.tid()
    out[i] = turn_upright(direction[i], cosine[i], azimuth[i])


@wp.kernel
def comb_kernel(
    splitting: Splitting,
    generation: Generation,
    weight: wp.array(dtype=float),
    importance: wp.array(dtype=float),
    wanted: float,
    combs: wp.array(dtype=float),
    keep_weight: int,
    out: wp.array2d(dtype=float),
):
    """Row i: resample one population with one comb.

    Returns in `out` the number of paths, the sum of weights, the weighted sum of the paths'
    numbers, the least and the greatest share. With `keep_weight` weights stay what they were:
    what must fail.
    """
    row = wp.tid()
    paths = weight.shape[0]
    for i in range(paths):
        path = generation.paths[row, i]
        path.weight = weight[i]
        path.order = i
        generation.paths[row, i] = path
        generation.order[row, i] = i
        generation.share[row, i] = wp.log(weight[i] * importance[i])
    spacing = log_spacing(generation, row, paths, wanted, -1.0e30)
    spacing = log_spacing(generation, row, paths, float(splitting.capacity), spacing)
    count, born = resample(
        splitting, generation, row, 0, paths, spacing, combs[row], wp.uint64(row), 0
    )
    total = float(0.0)
    moment = float(0.0)
    least = float(1.0e30)
    most = float(0.0)
    for i in range(count):
        path = generation.paths[row, splitting.capacity + i]
        now = path.weight
        share = now * importance[path.order] / wp.exp(spacing)
        if keep_weight == 1:
            now = weight[path.order]
        total = total + now
        moment = moment + now * float(path.order)
        least = wp.min(least, share)
        most = wp.max(most, share)
    out[row, 0] = float(count)
    out[row, 1] = total
    out[row, 2] = moment
    out[row, 3] = least
    out[row, 4] = most
