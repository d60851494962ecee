"""What happens to a path where its flight has ended: scattering, or a bounce at the background."""

from __future__ import annotations

import warp as wp

from twin.transport.connect_kernels import (
    Problem,
    Stack,
    Tally,
    connect_background,
    connect_scatter,
    phase_draw,
    phase_slope,
    score,
)
from twin.transport.mirror_kernels import connect_mirror
from twin.transport.population_kernels import Path
from twin.transport.sampling_kernels import (
    TWO_PI,
    cosine_cone,
    on_background,
    turn,
    turn_upright,
    uniform2,
    vec8,
)
from twin.transport.unbounded_kernels import connect_unbounded, connect_unbounded_background

wp.set_module_options({"enable_backward": False})

CHANNEL_BLACK = wp.constant(0)
CHANNEL_WHITE = wp.constant(1)
CHANNEL_DOWN = wp.constant(1)
CHANNEL_UNBOUNDED = wp.constant(2)
CHANNEL_COLLISION = wp.constant(3)

# what each coordinate of a step's low-discrepancy point decides
FLIGHT = wp.constant(0)
SCATTER = wp.constant(1)
AZIMUTH = wp.constant(2)
FACE = wp.constant(3)
AIM_U = wp.constant(4)
AIM_V = wp.constant(5)
AIM_PICK = wp.constant(6)
FACE_2 = wp.constant(7)


@wp.func
def scatter_event(
    problem: Problem,
    stack: Stack,
    tally: Tally,
    row: int,
    before: Path,
    points: vec8,
    upright: int,
) -> Path:
    """One scattering event: connect to the targets, play roulette, turn.

    With `upright` the random numbers decide the new direction's height as directly as can be.
    """
    path = before
    layer = path.layer
    if layer == problem.counted_layer:
        path.order = path.order + 1
        path.score_sigma = path.score_sigma + 1.0 / stack.sigma_t[layer]
    else:
        path.weight = path.weight * stack.albedo[layer]
    if tally.balance == 1:
        score(tally, row, CHANNEL_COLLISION, 0, path.order, path.weight, 0.0, 0.0)
    mu = phase_draw(stack, layer, points[SCATTER])
    scattered = path.direction
    if upright == 0:
        scattered = turn(path.direction, mu, TWO_PI * points[AZIMUTH])
    elif stack.g[layer] == 0.0 and stack.two_term == 0:
        sine = wp.sqrt(wp.max(0.0, 1.0 - mu * mu))
        azimuth = TWO_PI * points[AZIMUTH]
        scattered = wp.vec3(sine * wp.cos(azimuth), sine * wp.sin(azimuth), mu)
        mu = wp.dot(scattered, path.direction)
    else:
        scattered = turn_upright(path.direction, mu, TWO_PI * points[AZIMUTH])
    if problem.target_up != 0:
        joined = connect_scatter(
            problem, stack, problem.target_up, 1.0, layer, path.at, path.direction, scattered,
            points[AIM_U], points[AIM_V], points[AIM_PICK],
        )  # fmt: skip
        c = joined[0] * path.weight
        ds = joined[1] * path.weight + c * path.score_sigma
        dg = joined[2] * path.weight + c * path.score_g
        if path.on_black == 1:
            k = path.black_share
            score(tally, row, CHANNEL_BLACK, path.bounces, path.order, c * k, ds * k, dg * k)
        if path.on_white == 1 and problem.has_background == 1:
            k = path.white_share
            score(tally, row, CHANNEL_WHITE, path.bounces, path.order, c * k, ds * k, dg * k)
        if problem.paired == 1:
            c = path.weight * connect_unbounded(
                problem, stack, layer, path.at[2], path.direction, scattered,
                points[AIM_U], points[AIM_V], points[AIM_PICK],
            )  # fmt: skip
            score(tally, row, CHANNEL_UNBOUNDED, path.bounces, path.order, c, 0.0, 0.0)
    if problem.target_down != 0:
        joined = connect_scatter(
            problem, stack, problem.target_down, -1.0, layer, path.at, path.direction, scattered,
            points[AIM_U], points[AIM_V], points[AIM_PICK],
        )  # fmt: skip
        c = joined[0] * path.weight
        ds = joined[1] * path.weight + c * path.score_sigma
        dg = joined[2] * path.weight + c * path.score_g
        score(tally, row, CHANNEL_DOWN, path.bounces, path.order, c, ds, dg)
    if path.order >= problem.max_order or path.weight <= 0.0:
        path.alive = 0
    elif path.order > problem.roulette_free:
        k = float(path.order)
        survival = (
            problem.roulette_albedo
            * (k - 1.0 + problem.roulette_scale)
            / (k + problem.roulette_scale)
        )
        state, u, spare = uniform2(path.state)
        path.state = state
        if u >= survival:
            path.alive = 0
        path.weight = path.weight / survival
    if layer == problem.counted_layer:
        path.score_g = path.score_g + phase_slope(stack, layer, mu)
    path.direction = scattered
    return path


@wp.func
def bounce_or_mirror(
    problem: Problem,
    stack: Stack,
    tally: Tally,
    row: int,
    before: Path,
    x: float,
    y: float,
    diffuse: wp.vec3,
    points: vec8,
) -> Path:
    """A bounce at backgrounds of which a share reflects like a mirror.

    Both shares are scored; one of them carries the path on. The backgrounds may differ in their
    gloss: the path's weight in each of them is kept apart.
    The path meets the background at (x, y) [mm]; `diffuse` is the value and the slopes of the
    connection if all of the background were Lambertian.
    """
    path = before
    w = wp.vec3(path.direction[0], path.direction[1], -path.direction[2])
    joined = connect_mirror(problem, stack, wp.vec3(x, y, 0.0), w)
    c = joined[0] * path.weight
    mirrored = wp.vec3(
        c, joined[1] * path.weight + c * path.score_sigma, c * path.score_g
    )  # fmt: skip
    if path.on_black == 1:
        found = diffuse * (1.0 - problem.black_gloss) + mirrored * problem.black_gloss
        found = found * path.black_share
        score(tally, row, CHANNEL_BLACK, path.bounces, path.order, found[0], found[1], found[2])
    if path.on_white == 1:
        found = diffuse * (1.0 - problem.white_gloss) + mirrored * problem.white_gloss
        found = found * path.white_share
        score(tally, row, CHANNEL_WHITE, path.bounces, path.order, found[0], found[1], found[2])
    u = points[SCATTER]
    if u < problem.gloss:
        path.black_share = path.black_share * problem.black_gloss / problem.gloss
        path.white_share = path.white_share * problem.white_gloss / problem.gloss
    else:
        rest = 1.0 - problem.gloss
        path.black_share = path.black_share * (1.0 - problem.black_gloss) / rest
        path.white_share = path.white_share * (1.0 - problem.white_gloss) / rest
        w = cosine_cone(1.0, (u - problem.gloss) / rest, points[AZIMUTH])
    if path.black_share <= 0.0:
        path.on_black = 0
    if path.white_share <= 0.0:
        path.on_white = 0
    if path.on_black == 0 and path.on_white == 0:
        path.alive = 0
    path.direction = w
    path.at = wp.vec3(x, y, stack.bottom[problem.n_layers - 1] - problem.gap)
    path.layer = problem.n_layers
    return path


@wp.func
def bounce_event(
    problem: Problem, stack: Stack, tally: Tally, row: int, before: Path, points: vec8
) -> Path:
    """Arrival at the background plane from the stack: connect to the target, bounce."""
    path = before
    descent = problem.gap / wp.max(-path.direction[2], 1.0e-6)
    x = path.at[0] + path.direction[0] * descent
    y = path.at[1] + path.direction[1] * descent
    if not on_background(problem.black_disc, problem.black_half_x, problem.black_half_y, x, y):
        path.on_black = 0
    if not on_background(problem.white_disc, problem.white_half_x, problem.white_half_y, x, y):
        path.on_white = 0
    lost = path.on_black == 0 and path.on_white == 0 and problem.paired == 0
    if lost or path.bounces >= 63:
        path.alive = 0
        return path
    path.bounces = path.bounces + 1
    joined = connect_background(
        problem, stack, wp.vec3(x, y, 0.0), points[AIM_U], points[AIM_V], points[AIM_PICK]
    )
    c = joined[0] * path.weight
    ds = joined[1] * path.weight + c * path.score_sigma
    dg = c * path.score_g
    if problem.gloss > 0.0:
        return bounce_or_mirror(
            problem, stack, tally, row, path, x, y, wp.vec3(c, ds, dg), points
        )  # fmt: skip
    if path.on_black == 1:
        score(tally, row, CHANNEL_BLACK, path.bounces, path.order, c, ds, dg)
    if path.on_white == 1:
        score(tally, row, CHANNEL_WHITE, path.bounces, path.order, c, ds, dg)
    if problem.paired == 1:
        c = path.weight * connect_unbounded_background(
            problem, stack, points[AIM_U], points[AIM_V], points[AIM_PICK]
        )
        score(tally, row, CHANNEL_UNBOUNDED, path.bounces, path.order, c, 0.0, 0.0)
    up = cosine_cone(1.0, points[SCATTER], points[AZIMUTH])
    path.direction = up
    path.at = wp.vec3(x, y, stack.bottom[problem.n_layers - 1] - problem.gap)
    path.layer = problem.n_layers
    return path
