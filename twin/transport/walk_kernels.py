"""The random walk: one Warp thread traces the paths of one block into its own histograms.

A path carries no albedo and no background reflectance: contributions are filed by the number
k of scattering events and the number b of background bounces, so that one set of paths serves
every albedo (power series in albedo) and every pair of backgrounds (power series in rho).
Radiance divided by n^2 is what is conserved across an interface.

All paths of a block advance together, one event at a time. Before each step they are sorted
by depth and direction and matched with a shifted low-discrepancy sequence (array-RQMC:
L'Ecuyer, Lecot, Tuffin 2008), so that each generation of paths samples depth and direction
evenly. Blocks are independent; their spread is the standard error.

With importance splitting the population is resampled where the sorted paths are about to
scatter, before the direction is drawn: for isotropic scattering the depth alone then says what
becomes of a path, and one coordinate is what sorting serves best.
"""

from __future__ import annotations

import warp as wp

from twin.transport.connect_kernels import Problem, Stack, Tally, beside, score
from twin.transport.event_kernels import (
    FACE,
    FACE_2,
    FLIGHT,
    bounce_event,
    scatter_event,
)
from twin.transport.mirror_kernels import score_unscattered
from twin.transport.population_kernels import (
    KEYS,
    Generation,
    Path,
    Splitting,
    log_share,
    log_spacing,
    place,
    resample,
    sort_key,
    sort_pass,
)
from twin.transport.sampling_kernels import (
    GOLDEN_GAMMA,
    cosine_cone,
    fresnel,
    kronecker,
    mix64,
    stream_start,
    uniform2,
    uniform8,
    uniform_disc,
    vec8,
)

wp.set_module_options({"enable_backward": False})

CHANNEL_SIDE = wp.constant(2)
FAR = wp.constant(1.0e30)
FULL = wp.constant(0.999)
FORK = wp.constant(wp.uint64(0xD1B54A32D192ED03))
COVER = wp.constant(wp.uint64(0x8CB92BA72F3D8DD7))

# what a path is about to meet
NOTHING = wp.constant(0)
SCATTERING = wp.constant(1)
BACKGROUND = wp.constant(2)


@wp.func
def start_path(
    problem: Problem, stack: Stack, tally: Tally, row: int, points: vec8, state: wp.uint64
) -> Path:
    """A path that has just entered the stack; files what needs no path at all."""
    at = uniform_disc(problem.start_radius, points[0], points[1])
    cone = cosine_cone(problem.start_cone_sine, points[2], points[3])
    # tilt the cone's axis from +z by the start's polar angle, in the x-z plane
    w = wp.vec3(
        problem.start_cosine * cone[0] + problem.start_sine * cone[2],
        cone[1],
        problem.start_cosine * cone[2] - problem.start_sine * cone[0],
    )
    sign = float(1.0)
    layer = int(0)
    if problem.start_from_below == 1:
        layer = problem.n_layers - 1
        at = wp.vec3(at[0], at[1], stack.bottom[layer])
    else:
        w = wp.vec3(w[0], w[1], -w[2])
        sign = -1.0
    score_unscattered(problem, stack, tally, row, at, w)
    n = stack.n[layer]
    reflectance, cosine = fresnel(1.0, n, wp.abs(w[2]))
    path = Path()
    path.at = at
    path.direction = wp.vec3(w[0] / n, w[1] / n, sign * cosine)
    path.weight = 1.0 - reflectance
    path.layer = layer
    path.on_black = 1
    path.on_white = 1
    path.black_share = 1.0
    path.white_share = 1.0
    path.alive = 1
    path.state = state
    return path


@wp.func
def leave_sideways(problem: Problem, before: Path) -> Path:
    """A path beyond a side of the stack: lost, or alive in the unbounded stack alone."""
    path = before
    path.on_black = 0
    path.on_white = 0
    if problem.paired == 0:
        path.alive = 0
    return path


@wp.func
def enter_from_gap(problem: Problem, stack: Stack, before: Path, u: float) -> Path:
    """From the background up to the stack: enter it or be reflected back down."""
    path = before
    up = path.direction
    ascent = problem.gap / wp.max(up[2], 1.0e-6)
    x = path.at[0] + up[0] * ascent
    y = path.at[1] + up[1] * ascent
    layer = problem.n_layers - 1
    path.at = wp.vec3(x, y, stack.bottom[layer])
    if beside(problem, x, y):
        path = leave_sideways(problem, path)
    reflectance, cosine = fresnel(1.0, stack.n[layer], up[2])
    if u < reflectance:
        path.direction = wp.vec3(up[0], up[1], -up[2])
    else:
        path.direction = wp.vec3(up[0] / stack.n[layer], up[1] / stack.n[layer], cosine)
        path.layer = layer
    return path


@wp.func
def share_kept(
    problem: Problem,
    stack: Stack,
    layer: int,
    dz: float,
    sigma: float,
    to_face: float,
    to_side: float,
) -> float:
    """Share of a flight that scatters on the way or is reflected at the end; 1 if none is lost.

    Light is lost at a face to the outside, unless a background lies there.
    """
    outside = dz > 0.0 and layer == 0
    if dz < 0.0 and layer == problem.n_layers - 1 and problem.has_background == 0:
        outside = True
    if not outside or to_side < to_face:
        return 1.0
    reflectance, cosine = fresnel(stack.n[layer], 1.0, wp.abs(dz))
    if reflectance >= 1.0:
        return 1.0
    return 1.0 - wp.exp(-sigma * to_face) * (1.0 - reflectance)


@wp.func
def fly(
    problem: Problem,
    stack: Stack,
    tally: Tally,
    row: int,
    before: Path,
    points: vec8,
    stay: int,
) -> Path:
    """Carry a path to its next event (`path.event`) or to its end.

    With `stay` a path never leaves the stack from the face that its first flight heads for: its
    weight shrinks instead. What would leave has been scored by connection.
    """
    path = before
    path.event = NOTHING
    faces = int(0)
    if path.layer == problem.n_layers:
        faces = 1
        path = enter_from_gap(problem, stack, path, points[FACE])
        if path.alive == 1 and path.layer == problem.n_layers:
            path.event = BACKGROUND
            return path
    first_flight = int(1)
    state = path.state
    x = float(path.at[0])
    y = float(path.at[1])
    z = float(path.at[2])
    dx = float(path.direction[0])
    dy = float(path.direction[1])
    dz = float(path.direction[2])
    layer = int(path.layer)
    moving = int(path.alive)
    stays = int(0)
    cover_state = mix64(state ^ COVER)
    while moving == 1:
        sigma = stack.sigma_t[layer]
        flight = float(FAR)
        in_cover = bool(False)
        if sigma > 0.0:
            u = float(points[FLIGHT])
            # with common random numbers a scattering cover leaves the sample's numbers alone
            in_cover = problem.common == 1 and layer != problem.counted_layer
            if in_cover:
                cover_state, u, spare = uniform2(cover_state)
            elif first_flight == 0:
                state, u, spare = uniform2(state)
            flight = -wp.log(1.0 - u) / sigma
        to_face = float(FAR)
        if dz > 0.0:
            to_face = wp.max(0.0, stack.top[layer] - z) / dz
        elif dz < 0.0:
            to_face = wp.max(0.0, z - stack.bottom[layer]) / -dz
        to_side = float(FAR)
        if dx != 0.0:
            to_side = (problem.half_x - wp.sign(dx) * (x - problem.offset_x)) / wp.abs(dx)
        if dy != 0.0:
            to_edge = problem.half_y - wp.sign(dy) * (y - problem.offset_y)
            to_side = wp.min(to_side, to_edge / wp.abs(dy))
        beyond = float(FAR)
        if problem.paired == 1:
            # the unbounded stack has no sides; what the bounded one loses is noted below
            beyond = to_side
            to_side = float(FAR)
        if sigma > 0.0 and not in_cover:
            if first_flight == 1 and stay == 1:
                kept = share_kept(problem, stack, layer, dz, sigma, to_face, to_side)
                if kept < 1.0:
                    stays = 1
                    u = points[FLIGHT] * kept
                    flight = -wp.log(1.0 - u) / sigma
                    path.weight = path.weight * kept
            elif first_flight == 1 and path.order == 0 and path.bounces == 0:
                # let thin stacks scatter more often than they do, at a smaller weight
                natural = 1.0 - wp.exp(-sigma * wp.min(to_face, to_side))
                if natural > 0.0 and natural < problem.first_scatter:
                    if points[FLIGHT] < problem.first_scatter:
                        u = points[FLIGHT] / problem.first_scatter * natural
                        flight = -wp.log(1.0 - u) / sigma
                        path.weight = path.weight * natural / problem.first_scatter
                    else:
                        flight = float(FAR)
                        path.weight = path.weight * (1.0 - natural) / (1.0 - problem.first_scatter)
            first_flight = 0
        step = wp.min(flight, wp.min(to_face, to_side))
        if step >= FAR:
            path.alive = 0
            moving = 0
        else:
            if step > beyond:
                path = leave_sideways(problem, path)
            x = x + dx * step
            y = y + dy * step
            z = z + dz * step
            if layer == problem.counted_layer:
                path.score_sigma = path.score_sigma - step
            if flight <= to_face and flight <= to_side:
                path.event = SCATTERING
                moving = 0
            elif to_side < to_face:
                if tally.balance == 1:
                    score(tally, row, CHANNEL_SIDE, 0, path.order, path.weight, 0.0, 0.0)
                path.alive = 0
                moving = 0
            else:
                next_layer = layer - 1
                z = stack.top[layer]
                if dz < 0.0:
                    next_layer = layer + 1
                    z = stack.bottom[layer]
                n_here = stack.n[layer]
                n_next = float(1.0)
                if next_layer >= 0 and next_layer < problem.n_layers:
                    n_next = stack.n[next_layer]
                reflectance, cosine = fresnel(n_here, n_next, wp.abs(dz))
                passes = int(1)
                if reflectance >= 1.0 or stays == 1:
                    passes = 0
                    stays = 0
                elif reflectance > 0.0:
                    u = float(points[FACE])
                    if faces == 1:
                        u = points[FACE_2]
                    elif faces > 1:
                        state, u, spare = uniform2(state)
                    faces = faces + 1
                    if u < reflectance:
                        passes = 0
                if passes == 0:
                    dz = -dz
                else:
                    ratio = n_here / n_next
                    dx = dx * ratio
                    dy = dy * ratio
                    dz = wp.sign(dz) * cosine
                    layer = next_layer
                    if layer < 0 or layer == problem.n_layers:
                        moving = 0
                        # a way out through the top has been scored by connection already
                        if layer < 0 or problem.has_background == 0:
                            path.alive = 0
                        else:
                            path.event = BACKGROUND
    path.state = state
    path.at = wp.vec3(x, y, z)
    path.direction = wp.vec3(dx, dy, dz)
    path.layer = layer
    return path


@wp.func
def meet(
    problem: Problem,
    stack: Stack,
    tally: Tally,
    row: int,
    before: Path,
    points: vec8,
    upright: int,
) -> Path:
    """What happens to a path where its flight has ended."""
    if before.event == SCATTERING:
        return scatter_event(problem, stack, tally, row, before, points, upright)
    if before.event == BACKGROUND:
        return bounce_event(problem, stack, tally, row, before, points)
    return before


@wp.func
def numbers(problem: Problem, path: Path, index: int, shift: vec8) -> vec8:
    """The point that decides a path's step: of the lattice, or of its own stream."""
    if problem.lattice == 0:
        return uniform8(path.state)
    return kronecker(index, shift)


@wp.func
def trace_plain(
    problem: Problem,
    stack: Stack,
    tally: Tally,
    generation: Generation,
    row: int,
    seed: wp.uint64,
    stream: int,
    block: int,
    paths: int,
):
    """Advance the paths of a block event by event until none is left."""
    alive = int(paths)
    step = int(0)
    while alive > 0:
        if step > 0 and problem.lattice == 1 and alive > 8:
            for i in range(alive):
                index = generation.order[row, i]
                generation.key[row, index] = sort_key(problem, stack, generation.paths[row, index])
            sort_pass(generation, row, alive, 0, 1)
            sort_pass(generation, row, alive, 10, 0)
        shift = uniform8(stream_start(seed, stream, block, -2 - step))
        left = int(0)
        for i in range(alive):
            index = generation.order[row, i]
            path = generation.paths[row, index]
            points = numbers(problem, path, i, shift)
            if problem.common == 1 and step == 0:
                points = kronecker(index, shift)
            following = mix64(path.state ^ FORK)
            if problem.lattice == 0:
                path.state = path.state + GOLDEN_GAMMA * wp.uint64(4)
            path = fly(problem, stack, tally, row, path, points, 0)
            path = meet(problem, stack, tally, row, path, points, 0)
            if problem.common == 1:
                path.state = following
            if path.alive == 1:
                generation.paths[row, index] = path
                generation.order[row, left] = index
                left = left + 1
        alive = left
        step = step + 1


@wp.func
def trace_split(
    problem: Problem,
    stack: Stack,
    tally: Tally,
    generation: Generation,
    splitting: Splitting,
    row: int,
    seed: wp.uint64,
    stream: int,
    block: int,
    paths: int,
):
    """The same with importance splitting: resample, meet what the paths are at, fly on."""
    alive = int(paths)
    step = int(0)
    source = int(0)
    born = int(0)
    spacing = float(0.0)
    while alive > 0:
        family = stream_start(seed, stream, block, -2 - step)
        shift = uniform8(family)
        if step > 0:
            if problem.lattice == 1 and alive > 8:
                sort_pass(generation, row, alive, 0, 1)
                sort_pass(generation, row, alive, 10, 0)
            if step == 1:
                spacing = log_spacing(generation, row, alive, float(paths), -FAR)
            # a population that no longer fits is thinned for good
            spacing = log_spacing(
                generation, row, alive, FULL * float(splitting.capacity), spacing
            )  # fmt: skip
            family, comb, spare = uniform2(family + GOLDEN_GAMMA * wp.uint64(4))
            alive, born = resample(
                splitting, generation, row, source, alive, spacing, comb, family, born
            )
            source = splitting.capacity - source
        left = int(0)
        for i in range(alive):
            path = generation.paths[row, source + i]
            points = numbers(problem, path, i, shift)
            if problem.lattice == 0:
                path.state = path.state + GOLDEN_GAMMA * wp.uint64(4)
            if step > 0:
                path = meet(problem, stack, tally, row, path, points, 1)
            if path.alive == 1:
                path = fly(problem, stack, tally, row, path, points, 1)
            if path.alive == 1 and path.weight > 0.0:
                at = place(problem, stack, splitting, path)
                generation.paths[row, source + i] = path
                generation.key[row, i] = int(at * KEYS)
                generation.share[row, i] = log_share(splitting, path, at)
                generation.order[row, left] = i
                left = left + 1
        alive = left
        step = step + 1


@wp.kernel
def trace_kernel(
    problem: Problem,
    stack: Stack,
    tally: Tally,
    generation: Generation,
    splitting: Splitting,
    seed: wp.uint64,
    stream: int,
    first_block: int,
    paths: int,
):
    """Trace the paths of one block; thread i fills row i of the tally."""
    row = wp.tid()
    block = first_block + row
    shift = uniform8(stream_start(seed, stream, block, -1))
    for index in range(paths):
        generation.paths[row, index] = start_path(
            problem, stack, tally, row, kronecker(index, shift),
            stream_start(seed, stream, block, index),
        )  # fmt: skip
        generation.order[row, index] = index
    if splitting.active == 1:
        trace_split(
            problem, stack, tally, generation, splitting, row, seed, stream, block, paths
        )  # fmt: skip
    else:
        trace_plain(problem, stack, tally, generation, row, seed, stream, block, paths)
