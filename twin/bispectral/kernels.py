"""The coupled walk: from the detector at the emitted wavelength back to the panels' wavelengths.

A path starts at the detector at one wavelength o. Wherever it scatters it connects to the panels
at o (elastic light); wherever it collides in the sample it also connects through a re-emission,
at a wavelength i drawn by how much i excites o there. One collision of each generation, drawn by
its weight (reservoir sampling, Chao 1982), is where the walk goes on at the shorter wavelength,
in a direction without memory; generation by generation re-emission after re-emission.

Every wavelength has its own rows in the stack's arrays and tables: the layers, one for the whole
stack, and a copy of the sample with g = 0 for what is emitted. Both backgrounds ride on one path.
"""

from __future__ import annotations

import warp as wp

from twin.transport.connect_kernels import (
    TARGET_PANELS,
    Problem,
    Stack,
    connect_background,
    connect_scatter,
)
from twin.transport.sampling_kernels import (
    TWO_PI,
    cosine_cone,
    fresnel,
    on_background,
    sample_henyey_greenstein,
    stream_start,
    turn,
    uniform2,
    uniform_disc,
)

wp.set_module_options({"enable_backward": False})

FAR = wp.constant(1.0e30)
# what a path has met
FACE = wp.constant(0)
COLLISION = wp.constant(1)
BACKGROUND = wp.constant(2)
TOP = wp.constant(3)
SIDE = wp.constant(4)
MOST_EVENTS = wp.constant(100000)


@wp.struct
class Dyes:
    """What of the sample depends on wavelength beyond the stack; W wavelengths.

    `draw` is the cumulated share of every exciting wavelength among all that excite a collision
    of the emitted one, `excited` their sum: energy per nm that a collision at o returns from i,
    source(o, i) / sigma_t(o). `step` are the bins of wavelength [nm].
    """

    count: int
    layers: int
    sample: int
    generations: int
    excited: wp.array(dtype=float)
    draw: wp.array2d(dtype=float)
    step: wp.array(dtype=float)
    rho_black: wp.array(dtype=float)
    rho_white: wp.array(dtype=float)
    floor: float


@wp.struct
class Walker:
    """A path at one wavelength; `black` and `white` are its factors over both backgrounds."""

    at: wp.vec3
    direction: wp.vec3
    weight: float
    black: float
    white: float
    length: float
    layer: int
    event: int
    alive: int
    state: wp.uint64


@wp.struct
class Site:
    """Where a walk goes on at another wavelength; `total` is the weight of all that were seen."""

    at: wp.vec3
    black: float
    white: float
    wave: int
    total: float


@wp.func
def pick_wave(dyes: Dyes, wave: int, u: float) -> int:
    """An exciting wavelength, by its share; shorter than `wave` by construction."""
    low = int(0)
    high = wave - 1
    while low < high:
        middle = (low + high) // 2
        if u < dyes.draw[wave, middle]:
            high = middle
        else:
            low = middle + 1
    return low


@wp.func
def isotropic(u: float, v: float) -> wp.vec3:
    """Direction uniform over the sphere."""
    cosine = 1.0 - 2.0 * u
    sine = wp.sqrt(wp.max(0.0, 1.0 - cosine * cosine))
    return wp.vec3(sine * wp.cos(TWO_PI * v), sine * wp.sin(TWO_PI * v), cosine)


@wp.func
def advance(problem: Problem, stack: Stack, layers: int, first: int, before: Walker) -> Walker:
    """Carry a path straight to its next collision, face or side; `event` says which.

    `first` is the row of the top layer at the path's wavelength.
    """
    path = before
    x = path.at[0]
    y = path.at[1]
    z = path.at[2]
    dx = path.direction[0]
    dy = path.direction[1]
    dz = path.direction[2]
    row = first + path.layer
    path.event = FACE
    state, u, v = uniform2(path.state)
    path.state = state
    flight = float(FAR)
    if stack.sigma_t[row] > 0.0:
        flight = -wp.log(1.0 - u) / stack.sigma_t[row]
    to_face = float(FAR)
    if dz > 0.0:
        to_face = wp.max(0.0, stack.top[row] - z) / dz
    elif dz < 0.0:
        to_face = wp.max(0.0, z - stack.bottom[row]) / -dz
    to_side = float(FAR)
    if dx != 0.0:
        to_side = (problem.half_x - wp.sign(dx) * (x - problem.offset_x)) / wp.abs(dx)
    if dy != 0.0:
        to_edge = problem.half_y - wp.sign(dy) * (y - problem.offset_y)
        to_side = wp.min(to_side, to_edge / wp.abs(dy))
    step = wp.min(flight, wp.min(to_face, to_side))
    path.length = step
    path.at = wp.vec3(x + dx * step, y + dy * step, z + dz * step)
    if step >= FAR or (to_side < to_face and to_side < flight):
        path.event = SIDE
        path.alive = 0
    elif flight <= to_face:
        path.event = COLLISION
    else:
        following = path.layer - 1
        z = stack.top[row]
        if dz < 0.0:
            following = path.layer + 1
            z = stack.bottom[row]
        path.at = wp.vec3(path.at[0], path.at[1], z)
        n_next = float(1.0)
        if following >= 0 and following < layers:
            n_next = stack.n[first + following]
        reflectance, cosine = fresnel(stack.n[row], n_next, wp.abs(dz))
        if v < reflectance:
            path.direction = wp.vec3(dx, dy, -dz)
        else:
            ratio = stack.n[row] / n_next
            path.direction = wp.vec3(dx * ratio, dy * ratio, wp.sign(dz) * cosine)
            path.layer = following
            if following < 0:
                path.event = TOP
                path.alive = 0
            elif following == layers:
                path.event = BACKGROUND
    return path


@wp.func
def fly(problem: Problem, stack: Stack, layers: int, first: int, before: Walker) -> Walker:
    """Carry a path to its next collision, to the background plane, or to its end.

    A way out through the top has been scored by connection already.
    """
    path = advance(problem, stack, layers, first, before)
    while path.alive == 1 and path.event == FACE:
        path = advance(problem, stack, layers, first, path)
    return path


@wp.func
def bounce(
    problem: Problem, stack: Stack, dyes: Dyes, first: int, wave: int, before: Walker
) -> Walker:
    """From the stack's lower face over the background back to it, as often as it is thrown back."""
    path = before
    descent = problem.gap / wp.max(-path.direction[2], 1.0e-6)
    x = path.at[0] + path.direction[0] * descent
    y = path.at[1] + path.direction[1] * descent
    bottom = stack.bottom[first + dyes.layers - 1]
    path.at = wp.vec3(x, y, bottom - problem.gap)
    if not on_background(problem.black_disc, problem.black_half_x, problem.black_half_y, x, y):
        path.black = 0.0
    if not on_background(problem.white_disc, problem.white_half_x, problem.white_half_y, x, y):
        path.white = 0.0
    path.black = path.black * dyes.rho_black[wave]
    path.white = path.white * dyes.rho_white[wave]
    if path.black == 0.0 and path.white == 0.0:
        path.alive = 0
    return path


@wp.func
def rise(problem: Problem, stack: Stack, dyes: Dyes, first: int, before: Walker) -> Walker:
    """From the background up: into the stack, or back down onto the background."""
    path = before
    state, u, v = uniform2(path.state)
    path.state = state
    up = cosine_cone(1.0, u, v)
    state, u, v = uniform2(path.state)
    path.state = state
    row = first + dyes.layers - 1
    ascent = problem.gap / wp.max(up[2], 1.0e-6)
    x = path.at[0] + up[0] * ascent
    y = path.at[1] + up[1] * ascent
    path.at = wp.vec3(x, y, stack.bottom[row])
    beside_x = wp.abs(x - problem.offset_x) > problem.half_x
    if beside_x or wp.abs(y - problem.offset_y) > problem.half_y:
        path.alive = 0
        return path
    reflectance, cosine = fresnel(1.0, stack.n[row], up[2])
    if u < reflectance:
        path.direction = wp.vec3(up[0], up[1], -up[2])
        path.event = BACKGROUND
        path.layer = dyes.layers
    else:
        path.direction = wp.vec3(up[0] / stack.n[row], up[1] / stack.n[row], cosine)
        path.layer = dyes.layers - 1
        path.event = FACE
    return path


@wp.func
def add(
    tally: wp.array4d(dtype=wp.float64),
    block: int,
    generation: int,
    wave: int,
    black: float,
    white: float,
):
    """File one contribution over both backgrounds."""
    tally[block, 0, generation, wave] = tally[block, 0, generation, wave] + wp.float64(black)
    tally[block, 1, generation, wave] = tally[block, 1, generation, wave] + wp.float64(white)


@wp.func
def walk(
    problem: Problem,
    stack: Stack,
    dyes: Dyes,
    tally: wp.array4d(dtype=wp.float64),
    block: int,
    generation: int,
    wave: int,
    start: Walker,
):
    """One generation of a path: (where it goes on, its stream of random numbers)."""
    path = start
    rows = dyes.layers + 2
    first = wave * rows
    own = problem
    own.n_layers = first + dyes.layers
    site = Site()
    site.wave = -1
    initial = path.weight
    events = int(0)
    while path.alive == 1 and events < MOST_EVENTS:
        events = events + 1
        if path.event != BACKGROUND:
            path = fly(problem, stack, dyes.layers, first, path)
        if path.alive == 1 and path.event == BACKGROUND:
            path = bounce(problem, stack, dyes, first, wave, path)
            if path.alive == 1:
                state, u, v = uniform2(path.state)
                path.state = state
                state, pick, spare = uniform2(path.state)
                path.state = state
                below = wp.vec3(path.at[0], path.at[1], 0.0)
                sent = connect_background(own, stack, below, u, v, pick)
                c = sent[0] * path.weight
                add(tally, block, generation, wave, c * path.black, c * path.white)
                path = rise(problem, stack, dyes, first, path)
        elif path.alive == 1:
            row = first + path.layer
            state, u, v = uniform2(path.state)
            path.state = state
            state, pick, spare = uniform2(path.state)
            path.state = state
            excited = path.weight * dyes.excited[wave]
            if generation > 0:
                # what is emitted and reabsorbed on the way fills a bin of wavelengths
                excited = excited * dyes.step[wave]
            if path.layer == dyes.sample and generation < dyes.generations and excited > 0.0:
                wave_in = pick_wave(dyes, wave, spare)
                state, s, t = uniform2(path.state)
                path.state = state
                emitted = isotropic(s, t)
                joined = connect_scatter(
                    own, stack, TARGET_PANELS, 1.0, wave_in * rows + dyes.layers + 1, path.at,
                    path.direction, emitted, u, v, pick,
                )  # fmt: skip
                c = joined[0] * excited
                add(tally, block, generation + 1, wave_in, c * path.black, c * path.white)
                # over the brighter background: the other factor rides along
                mass = excited * wp.max(path.black, path.white)
                site.total = site.total + mass
                state, s, t = uniform2(path.state)
                path.state = state
                if s * site.total < mass:
                    site.at = path.at
                    site.wave = wave_in
                    site.black = path.black / wp.max(path.black, path.white)
                    site.white = path.white / wp.max(path.black, path.white)
                state, u, v = uniform2(path.state)
                path.state = state
                state, pick, spare = uniform2(path.state)
                path.state = state
            path.weight = path.weight * stack.albedo[row]
            mu = sample_henyey_greenstein(stack.g[row], spare)
            state, s, t = uniform2(path.state)
            path.state = state
            scattered = turn(path.direction, mu, TWO_PI * s)
            if path.weight > 0.0:
                joined = connect_scatter(
                    own, stack, TARGET_PANELS, 1.0, row, path.at, path.direction, scattered,
                    u, v, pick,
                )  # fmt: skip
                c = joined[0] * path.weight
                add(tally, block, generation, wave, c * path.black, c * path.white)
            path.direction = scattered
        else:
            path.alive = 0
        # roulette on what is left of the weight this generation began with
        left = path.weight / initial * wp.max(path.black, path.white)
        if path.alive == 1 and left < dyes.floor:
            state, u, v = uniform2(path.state)
            path.state = state
            if u * dyes.floor >= left:
                path.alive = 0
            else:
                path.weight = path.weight * dyes.floor / left
    return site, path.state


@wp.kernel
def coupled_kernel(
    problem: Problem,
    stack: Stack,
    dyes: Dyes,
    tally: wp.array4d(dtype=wp.float64),
    seed: wp.uint64,
    stream: int,
    first_block: int,
    paths: int,
    wave_out: int,
):
    """Trace the paths of one block; thread i fills row i of [block, background, generation, in]."""
    row = wp.tid()
    rows = dyes.layers + 2
    for index in range(paths):
        path = Walker()
        path.state = stream_start(seed, stream, first_block + row, index)
        state, u, v = uniform2(path.state)
        path.state = state
        state, s, t = uniform2(path.state)
        path.state = state
        at = uniform_disc(problem.start_radius, u, v)
        cone = cosine_cone(problem.start_cone_sine, s, t)
        n = stack.n[wave_out * rows]
        reflectance, cosine = fresnel(1.0, n, cone[2])
        path.at = at
        path.direction = wp.vec3(cone[0] / n, cone[1] / n, -cosine)
        path.weight = 1.0 - reflectance
        path.black = 1.0
        path.white = 1.0
        path.alive = 1
        wave = int(wave_out)
        generation = int(0)
        going = int(1)
        while going == 1:
            site, state = walk(problem, stack, dyes, tally, row, generation, wave, path)
            generation = generation + 1
            if site.wave < 0 or generation > dyes.generations:
                going = 0
            else:
                path = Walker()
                path.state = state
                state, u, v = uniform2(path.state)
                path.state = state
                path.direction = isotropic(u, v)
                path.at = site.at
                path.black = site.black
                path.white = site.white
                path.weight = site.total
                path.layer = dyes.sample
                path.alive = 1
                wave = site.wave
