"""Walks through a slab between slides that ask how much light leaves beside a port.

A path carries no albedo: it is filed by its number of scattering events, so that one set of
paths serves every albedo. Nor has it a place in the beam: a path that ends a distance d from
where it began lies, with the beam spread evenly over a disc, beside a round port with a
probability that is an area of two discs. That takes most of the noise away.
"""

from __future__ import annotations

import warp as wp

from twin.transport.sampling_kernels import (
    TWO_PI,
    cosine_cone,
    fresnel,
    sample_henyey_greenstein,
    stream_start,
    turn,
    uniform2,
)

wp.set_module_options({"enable_backward": False})


@wp.struct
class Slab:
    """A slab between two equal slides, lit over a disc (lengths [mm])."""

    n: float
    thickness: float
    sigma_t: float
    g: float
    slide_n: float
    slide_thickness: float
    diffuse: int
    sine: float
    cosine: float
    beam_radius: float
    port_above: float
    port_below: float


@wp.func
def beside(distance: float, beam: float, port: float) -> float:
    """Share of a disc (radius beam) that a shift moves out of a port's disc (radius port)."""
    if distance + beam <= port:
        return 0.0
    if distance >= beam + port:
        return 1.0
    if beam <= 0.0:
        return wp.where(distance > port, 1.0, 0.0)
    if distance + port <= beam:
        return 1.0 - (port * port) / (beam * beam)
    d = wp.max(distance, 1.0e-6)
    x = wp.clamp((d * d + beam * beam - port * port) / (2.0 * d * beam), -1.0, 1.0)
    y = wp.clamp((d * d + port * port - beam * beam) / (2.0 * d * port), -1.0, 1.0)
    corner = (beam + port - d) * (d + beam - port) * (d - beam + port) * (d + beam + port)
    lens = beam * beam * wp.acos(x) + port * port * wp.acos(y) - 0.5 * wp.sqrt(wp.max(corner, 0.0))
    return wp.clamp(1.0 - lens / (0.5 * TWO_PI * beam * beam), 0.0, 1.0)


@wp.kernel
def lost_kernel(
    slab: Slab,
    seed: wp.uint64,
    stream: int,
    paths: int,
    max_order: int,
    order_bin: wp.array(dtype=wp.int32),
    tally: wp.array3d(dtype=wp.float64),
):
    """Fill [block, quantity, order bin]; quantities: lost above, below, all above, below."""
    row = wp.tid()
    for path in range(paths):
        state = stream_start(seed, stream, row, path)
        w = wp.vec3(slab.sine, 0.0, slab.cosine)
        if slab.diffuse == 1:
            state, u, v = uniform2(state)
            w = cosine_cone(1.0, u, v)
        # z points into the stack; layer 0 and 2 are slides, 1 the sample; -1 and 3 air
        dx = w[0]
        dy = w[1]
        dz = wp.max(w[2], 1.0e-6)
        x = float(0.0)
        y = float(0.0)
        z = float(-slab.slide_thickness)
        layer = int(-1)
        n_here = float(1.0)
        order = int(0)
        alive = int(1)
        crossing = int(1)
        while alive == 1:
            if crossing == 0:
                top = -slab.slide_thickness
                bottom = float(0.0)
                if layer == 1:
                    top = 0.0
                    bottom = slab.thickness
                elif layer == 2:
                    top = slab.thickness
                    bottom = slab.thickness + slab.slide_thickness
                flight = float(1.0e30)
                if layer == 1:
                    state, u, v = uniform2(state)
                    flight = -wp.log(1.0 - u) / slab.sigma_t
                to_face = float(1.0e30)
                if dz > 0.0:
                    to_face = wp.max(bottom - z, 0.0) / dz
                elif dz < 0.0:
                    to_face = wp.max(z - top, 0.0) / -dz
                step = wp.min(flight, to_face)
                if step >= 1.0e30:
                    alive = 0
                else:
                    x = x + dx * step
                    y = y + dy * step
                    z = z + dz * step
                    if flight < to_face:
                        order = order + 1
                        state, u, v = uniform2(state)
                        mu = sample_henyey_greenstein(slab.g, u)
                        after = turn(wp.vec3(dx, dy, dz), mu, TWO_PI * v)
                        dx = after[0]
                        dy = after[1]
                        dz = after[2]
                        if order >= max_order:
                            alive = 0
                    else:
                        crossing = 1
                        z = top
                        if dz > 0.0:
                            z = bottom
            if alive == 1 and crossing == 1:
                crossing = 0
                beyond = layer - 1
                if dz > 0.0:
                    beyond = layer + 1
                n_next = float(1.0)
                if beyond == 1:
                    n_next = slab.n
                elif beyond == 0 or beyond == 2:
                    n_next = slab.slide_n
                reflectance, cosine = fresnel(n_here, n_next, wp.abs(dz))
                state, u, v = uniform2(state)
                if u < reflectance:
                    dz = -dz
                    beyond = layer
                else:
                    ratio = n_here / n_next
                    dx = dx * ratio
                    dy = dy * ratio
                    dz = wp.sign(dz) * cosine
                    n_here = n_next
                layer = beyond
                if layer < 0 or layer > 2:
                    alive = 0
                    side = int(0)
                    port = slab.port_above
                    if layer > 2:
                        side = 1
                        port = slab.port_below
                    index = order_bin[order]
                    distance = wp.sqrt(x * x + y * y)
                    share = beside(distance, slab.beam_radius, port)
                    tally[row, side, index] = tally[row, side, index] + wp.float64(share)
                    tally[row, 2 + side, index] = tally[row, 2 + side, index] + wp.float64(1.0)
