"""Kernels that hand out the random numbers of the Monte Carlo, for the tests."""

from __future__ import annotations

import warp as wp

from twin.transport.sampling_kernels import kronecker, stream_start, uniform2, uniform8, vec8


@wp.kernel
def kronecker_kernel(shift: vec8, out: wp.array(dtype=vec8)):
    """Points of the sequence at one shift."""
    i = wp.tid()
    out[i] = kronecker(i, shift)


@wp.kernel
def uniform8_kernel(seed: wp.uint64, out: wp.array(dtype=vec8)):
    """Eight numbers from the start of each stream."""
    i = wp.tid()
    out[i] = uniform8(stream_start(seed, 0, 0, i))


@wp.kernel
def uniform2_kernel(seed: wp.uint64, out: wp.array(dtype=wp.vec2)):
    """Successive pairs of one stream per thread: row i holds the 1 + i % 8-th pair."""
    i = wp.tid()
    state = stream_start(seed, 1, i / 8, 3)
    u = float(0.0)
    v = float(0.0)
    for _step in range(1 + i % 8):
        state, u, v = uniform2(state)
    out[i] = wp.vec2(u, v)
