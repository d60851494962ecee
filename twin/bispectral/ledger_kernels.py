"""The forward walk: light from above at one wavelength, and what becomes of all its energy.

Independent of the coupled walk: light is followed the way it goes. Absorption is scored by the
length of the ways (so it can be wrong), escape by counting; their sum is 1 only if the walk is.
"""

from __future__ import annotations

import warp as wp

from twin.bispectral.kernels import (
    BACKGROUND,
    COLLISION,
    SIDE,
    TOP,
    Dyes,
    Walker,
    advance,
    isotropic,
)
from twin.transport.connect_kernels import Problem, Stack
from twin.transport.sampling_kernels import (
    TWO_PI,
    fresnel,
    sample_henyey_greenstein,
    stream_start,
    turn,
    uniform2,
)

wp.set_module_options({"enable_backward": False})

HOST = wp.constant(0)
HEAT = wp.constant(1)
UP = wp.constant(2)
DOWN = wp.constant(3)
LOST = wp.constant(4)
UP_LONGER = wp.constant(5)
DOWN_LONGER = wp.constant(6)


@wp.func
def note(tally: wp.array2d(dtype=wp.float64), row: int, column: int, value: float):
    """File one contribution."""
    tally[row, column] = tally[row, column] + wp.float64(value)


@wp.func
def note_way(
    profile: wp.array2d(dtype=wp.float64),
    row: int,
    low: float,
    high: float,
    length: float,
    scale: float,
):
    """Spread a way's length over the bins between two heights, in units of a bin."""
    bins = profile.shape[1]
    start = wp.clamp(wp.min(low, high), 0.0, float(bins))
    stop = wp.clamp(wp.max(low, high), 0.0, float(bins))
    span = wp.max(stop - start, 1.0e-9)
    first = wp.min(int(start), bins - 1)
    last = wp.min(int(stop), bins - 1)
    for cell in range(first, last + 1):
        part = wp.min(stop, float(cell + 1)) - wp.max(start, float(cell))
        share = float(1.0)
        if last > first:
            share = part / span
        profile[row, cell] = profile[row, cell] + wp.float64(scale * length * share)


@wp.kernel
def ledger_kernel(
    problem: Problem,
    stack: Stack,
    dyes: Dyes,
    host: wp.array(dtype=float),
    heat: wp.array(dtype=float),
    emits: wp.array(dtype=float),
    forward: wp.array2d(dtype=float),
    cosine_air: wp.array(dtype=float),
    cosine_share: wp.array(dtype=float),
    tally: wp.array2d(dtype=wp.float64),
    profile: wp.array2d(dtype=wp.float64),
    seed: wp.uint64,
    stream: int,
    paths: int,
    wave_in: int,
):
    """Trace one block of light that lands on the axis; there is no background.

    `host` and `heat` [1/mm] are what absorption turns into heat in host and fluorophores, by
    wavelength; `emits` the share of a collision that is emitted again; `forward` [in, out] the
    cumulated energy over emitted wavelengths; `profile` the length of ways by depth before any
    re-emission; `cosine_share` the cumulated irradiance over the nodes `cosine_air`.
    """
    row = wp.tid()
    rows = dyes.layers + 2
    for index in range(paths):
        path = Walker()
        path.state = stream_start(seed, stream, row, index)
        state, u, v = uniform2(path.state)
        path.state = state
        node = int(0)
        while node < cosine_share.shape[0] - 1 and u >= cosine_share[node]:
            node = node + 1
        mu_air = cosine_air[node]
        sine = wp.sqrt(wp.max(0.0, 1.0 - mu_air * mu_air))
        wave = int(wave_in)
        longer = int(0)
        n = stack.n[wave * rows]
        reflectance, cosine = fresnel(1.0, n, mu_air)
        note(tally, row, UP, reflectance)
        path.direction = wp.vec3(
            sine / n * wp.cos(TWO_PI * v), sine / n * wp.sin(TWO_PI * v), -cosine
        )
        path.weight = 1.0 - reflectance
        path.alive = 1
        while path.alive == 1:
            first = wave * rows
            height = path.at[2]
            inside = path.layer == dyes.sample
            path = advance(problem, stack, dyes.layers, first, path)
            if inside:
                note(tally, row, HOST, path.weight * host[wave] * path.length)
                note(tally, row, HEAT, path.weight * heat[wave] * path.length)
                if longer == 0:
                    top = stack.top[first + dyes.sample]
                    scale = float(profile.shape[1]) / (top - stack.bottom[first + dyes.sample])
                    note_way(
                        profile, row, (top - height) * scale, (top - path.at[2]) * scale,
                        path.length, path.weight,
                    )  # fmt: skip
            if path.event == SIDE:
                note(tally, row, LOST, path.weight)
            elif path.event == TOP:
                note(tally, row, UP + 3 * longer, path.weight)
            elif path.event == BACKGROUND:
                note(tally, row, DOWN + 3 * longer, path.weight)
                path.alive = 0
            elif path.event == COLLISION:
                state, u, v = uniform2(path.state)
                path.state = state
                state, s, t = uniform2(path.state)
                path.state = state
                scatters = stack.albedo[first + path.layer]
                if u < scatters:
                    mu = sample_henyey_greenstein(stack.g[first + path.layer], v)
                    path.direction = turn(path.direction, mu, TWO_PI * s)
                elif path.layer == dyes.sample and u < scatters + emits[wave]:
                    found = int(0)
                    while found < dyes.count - 1 and t >= forward[wave, found]:
                        found = found + 1
                    wave = found
                    longer = 1
                    path.direction = isotropic(v, s)
                else:
                    path.alive = 0
