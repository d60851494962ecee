"""Connection of a scattering event to the light (or to the detector's cone) through the stack.

A direction in air towards the target is drawn first; Snell's law then gives the one direction
inside every layer, so no root has to be found. Light can start towards the target or away
from it (and be reflected back): both chains are scored, with every further specular
reflection summed as a geometric series. Where the ray leaves the stack is computed for each
chain; whether it then hits the panel (or the detector's disc) is tested exactly.
"""

from __future__ import annotations

import warp as wp

from twin.transport.sampling_kernels import (
    TWO_PI,
    henyey_greenstein,
    henyey_greenstein_log_derivative,
    phase_function,
    phase_log_derivative,
    sample_henyey_greenstein,
    sample_phase,
)

TABLE_SIZE = wp.constant(1024)
PI = wp.constant(3.141592653589793)

TARGET_NONE = wp.constant(0)
TARGET_PANELS = wp.constant(1)
TARGET_CONE = wp.constant(2)
TARGET_HEMISPHERE = wp.constant(3)
TARGET_DIRECTION = wp.constant(4)

T_UP = wp.constant(0)
R_UP = wp.constant(1)
T_DOWN = wp.constant(2)
R_DOWN = wp.constant(3)
SHIFT_UP = wp.constant(4)
SHIFT_DOWN = wp.constant(5)
SLOPE_UP = wp.constant(6)
SLOPE_DOWN = wp.constant(7)

T_ALL = wp.constant(0)
R_ALL = wp.constant(1)
SHIFT_ALL = wp.constant(2)
T_ALL_SLOPE = wp.constant(3)
R_ALL_SLOPE = wp.constant(4)
SHIFT_ALL_SLOPE = wp.constant(5)
BACK_SHARE = wp.constant(0.25)


@wp.struct
class Problem:
    """What one launch simulates (lengths in mm, cosines and sines of angles)."""

    start_from_below: int
    start_sine: float
    start_cosine: float
    start_cone_sine: float
    start_radius: float
    target_up: int
    target_down: int
    target_cosine: float
    exit_radius: float
    n_panels: int
    panel_scale: float
    n_layers: int
    counted_layer: int
    half_x: float
    half_y: float
    offset_x: float
    offset_y: float
    has_background: int
    gap: float
    black_disc: int
    black_half_x: float
    black_half_y: float
    white_disc: int
    white_half_x: float
    white_half_y: float
    gloss: float  # the larger one of both
    black_gloss: float
    white_gloss: float
    roulette_free: int
    roulette_albedo: float
    roulette_scale: float
    two_ways: int
    first_scatter: float
    lattice: int
    common: int
    max_order: int
    paired: int


@wp.struct
class Stack:
    """Layers from top to bottom, and specular transfer tables over the cosine in air."""

    n: wp.array(dtype=float)
    top: wp.array(dtype=float)
    bottom: wp.array(dtype=float)
    sigma_t: wp.array(dtype=float)
    g: wp.array(dtype=float)  # of the first lobe of the phase function
    two_term: int  # whether some layer has a second lobe; else the next two are not read
    second_share: wp.array(dtype=float)
    second_g: wp.array(dtype=float)
    albedo: wp.array(dtype=float)
    table: wp.array3d(dtype=float)
    panel_centre: wp.array(dtype=wp.vec3)
    panel_u: wp.array(dtype=wp.vec3)
    panel_v: wp.array(dtype=wp.vec3)
    panel_normal: wp.array(dtype=wp.vec3)
    panel_half: wp.array(dtype=wp.vec2)
    uneven: int  # whether panels differ in radiance; else the next is not read
    panel_light: wp.array(dtype=wp.vec2)  # radiance at the centre; relative change to +u


@wp.struct
class Tally:
    """Histograms of one launch: [block, channel, bounce bin, order bin]."""

    value: wp.array4d(dtype=wp.float64)
    d_sigma: wp.array4d(dtype=wp.float64)
    d_g: wp.array4d(dtype=wp.float64)
    order_bin: wp.array(dtype=wp.int32)
    bounce_bin: wp.array(dtype=wp.int32)
    derivatives: int
    balance: int


@wp.func
def look_up(table: wp.array3d(dtype=float), row: int, column: int, cosine: float) -> float:
    """Linear interpolation in a transfer table at a cosine in air."""
    x = cosine * float(TABLE_SIZE)
    i = wp.min(int(x), TABLE_SIZE - 1)
    f = x - float(i)
    return table[row, i, column] * (1.0 - f) + table[row, i + 1, column] * f


@wp.func
def phase_of(stack: Stack, layer: int, cosine: float) -> float:
    """Phase function of a layer [1/sr]."""
    if stack.two_term == 0:
        return henyey_greenstein(stack.g[layer], cosine)
    return phase_function(stack.g[layer], stack.second_share[layer], stack.second_g[layer], cosine)


@wp.func
def phase_slope(stack: Stack, layer: int, cosine: float) -> float:
    """D ln p / d g of a layer's phase function."""
    if stack.two_term == 0:
        return henyey_greenstein_log_derivative(stack.g[layer], cosine)
    return phase_log_derivative(
        stack.g[layer], stack.second_share[layer], stack.second_g[layer], cosine
    )


@wp.func
def phase_draw(stack: Stack, layer: int, u: float) -> float:
    """Cosine of the scattering angle in a layer from one uniform."""
    if stack.two_term == 0:
        return sample_henyey_greenstein(stack.g[layer], u)
    return sample_phase(stack.g[layer], stack.second_share[layer], stack.second_g[layer], u)


@wp.func
def beside(problem: Problem, x: float, y: float) -> bool:
    """Whether a lateral position [mm] lies beyond the sides of the stack."""
    return (
        wp.abs(x - problem.offset_x) > problem.half_x
        or wp.abs(y - problem.offset_y) > problem.half_y
    )


@wp.func
def panel_radiance(stack: Stack, panel: int, point: wp.vec3) -> float:
    """Radiance of a panel at one of its points, relative."""
    if stack.uneven == 0:
        return 1.0
    light = stack.panel_light[panel]
    half = stack.panel_half[panel]
    along = wp.dot(point - stack.panel_centre[panel], stack.panel_u[panel]) / half[0]
    return light[0] * (1.0 + light[1] * along)


@wp.func
def met_radiance(stack: Stack, panel: int, x: float, y: float, w: wp.vec3) -> float:
    """Radiance of a panel where the ray from (x, y, 0) along w meets its plane, relative."""
    if stack.uneven == 0:
        return 1.0
    start = wp.vec3(x, y, 0.0)
    height = wp.dot(stack.panel_normal[panel], start - stack.panel_centre[panel])
    point = start + w * (height / -wp.dot(stack.panel_normal[panel], w))
    return panel_radiance(stack, panel, point)


@wp.func
def hits_panel(stack: Stack, panel: int, x: float, y: float, w: wp.vec3) -> bool:
    """Whether the ray from (x, y, 0) along w meets the panel's lit face."""
    approach = -wp.dot(stack.panel_normal[panel], w)
    if approach <= 0.0:
        return False
    offset = wp.vec3(x, y, 0.0) - stack.panel_centre[panel]
    q = offset + w * (wp.dot(stack.panel_normal[panel], offset) / approach)
    half = stack.panel_half[panel]
    return (
        wp.abs(wp.dot(q, stack.panel_u[panel])) <= half[0]
        and wp.abs(wp.dot(q, stack.panel_v[panel])) <= half[1]
    )


@wp.func
def reached(problem: Problem, stack: Stack, kind: int, leaves: wp.vec3, w: wp.vec3) -> int:
    """Which target light reaches that leaves the stack along w: a panel or 0, else -1."""
    if beside(problem, leaves[0], leaves[1]):
        return -1
    if kind == TARGET_PANELS:
        for candidate in range(problem.n_panels):
            if hits_panel(stack, candidate, leaves[0], leaves[1], w):
                return candidate
        return -1
    if leaves[0] * leaves[0] + leaves[1] * leaves[1] <= problem.exit_radius * problem.exit_radius:
        return 0
    return -1


@wp.func
def aim(problem: Problem, kind: int, u: float, v: float):
    """Draw a direction in air, z > 0, towards a cone, a polar angle or the hemisphere.

    Returns (direction, weight = 1 / density per solid angle).
    """
    azimuth = TWO_PI * v
    cosine = problem.target_cosine
    weight = PI / cosine
    if kind == TARGET_CONE:
        cosine = 1.0 - u * (1.0 - problem.target_cosine)
        weight = TWO_PI * (1.0 - problem.target_cosine)
    elif kind == TARGET_HEMISPHERE:
        cosine = wp.max(u, 1.0e-6)
        weight = TWO_PI
    sine = wp.sqrt(wp.max(0.0, 1.0 - cosine * cosine))
    return wp.vec3(sine * wp.cos(azimuth), sine * wp.sin(azimuth), cosine), weight


@wp.func
def panel_point(stack: Stack, panel: int, u: float, v: float) -> wp.vec3:
    """Point of a panel, uniform over its area [mm]."""
    half = stack.panel_half[panel]
    return (
        stack.panel_centre[panel]
        + stack.panel_u[panel] * ((2.0 * u - 1.0) * half[0])
        + stack.panel_v[panel] * ((2.0 * v - 1.0) * half[1])
    )


@wp.func
def panel_inverse_density(
    problem: Problem, stack: Stack, panel: int, leaves: wp.vec3, w: wp.vec3, shift: wp.vec2
) -> float:
    """Inverse density per solid angle in air of rays to uniform points of a panel.

    The ray leaves the stack at `leaves` along w. `shift` is its lateral shift [mm] inside the
    stack and the slope of that over the tangent in air: a turned ray also leaves elsewhere,
    which stretches its track on the panel.
    """
    half = stack.panel_half[panel]
    facing = wp.max(1.0e-6, -wp.dot(w, stack.panel_normal[panel]))
    distance = wp.dot(stack.panel_normal[panel], leaves - stack.panel_centre[panel]) / facing
    height = distance * w[2]
    tangent = wp.sqrt(wp.max(0.0, 1.0 - w[2] * w[2])) / w[2]
    radial = shift[1]
    if tangent > 1.0e-3:
        radial = shift[0] / tangent
    stretch = (1.0 + radial / height) * (1.0 + shift[1] / height)
    area = 4.0 * half[0] * half[1] * float(problem.n_panels)
    return area * facing / (distance * distance * stretch)


@wp.func
def score(
    tally: Tally,
    block: int,
    channel: int,
    bounces: int,
    order: int,
    value: float,
    d_sigma: float,
    d_g: float,
):
    """Add one contribution to the histograms of a block."""
    b = tally.bounce_bin[bounces]
    k = tally.order_bin[order]
    tally.value[block, channel, b, k] = tally.value[block, channel, b, k] + wp.float64(value)
    if tally.derivatives == 1:
        tally.d_sigma[block, channel, b, k] = tally.d_sigma[block, channel, b, k] + wp.float64(
            d_sigma
        )
        tally.d_g[block, channel, b, k] = tally.d_g[block, channel, b, k] + wp.float64(d_g)


@wp.struct
class Chain:
    """One specular way from an event to the outside, for one direction in air.

    `value` is its transmission, every further reflection included; `slope` is d ln value /
    d sigma_t; `shift` the lateral shift [mm] and its slope over the tangent in air; `inner`
    the direction inside the layer; `spread` solid angle inside per solid angle in air.
    """

    value: float
    slope: float
    shift: wp.vec2
    inner: wp.vec3
    spread: float


@wp.func
def chain_shift(
    stack: Stack, layer: int, sign: float, onwards: int, z: float, cosine_air: float
) -> wp.vec2:
    """Lateral shift [mm] of a chain between event and exit, and its slope over tan in air."""
    ahead = stack.top[layer] - z
    thickness = stack.top[layer] - stack.bottom[layer]
    column = SHIFT_UP
    if sign < 0.0:
        ahead = z - stack.bottom[layer]
        column = SHIFT_DOWN
    n = stack.n[layer]
    sine = wp.sqrt(wp.max(0.0, 1.0 - cosine_air * cosine_air)) / n
    cosine = wp.sqrt(wp.max(1.0e-12, 1.0 - sine * sine))
    length = ahead
    shift = look_up(stack.table, layer, column, cosine_air)
    slope = look_up(stack.table, layer, column + 2, cosine_air)
    if onwards == 0:
        length = 2.0 * thickness - ahead
        other = SHIFT_UP + SHIFT_DOWN - column
        shift = shift + 2.0 * look_up(stack.table, layer, other, cosine_air)
        slope = slope + 2.0 * look_up(stack.table, layer, other + 2, cosine_air)
    bend = cosine_air / cosine
    return wp.vec2(shift + length * sine / cosine, slope + length * bend * bend * bend / n)


@wp.func
def follow_chain(
    stack: Stack, layer: int, sign: float, onwards: int, z: float, w: wp.vec3, shift: wp.vec2
) -> Chain:
    """Transmission of a chain that leaves the stack along w."""
    n = stack.n[layer]
    sigma = stack.sigma_t[layer]
    cosine = wp.sqrt(wp.max(1.0e-12, 1.0 - (1.0 - w[2] * w[2]) / (n * n)))
    thickness = stack.top[layer] - stack.bottom[layer]
    ahead = stack.top[layer] - z
    column = T_UP
    if sign < 0.0:
        ahead = z - stack.bottom[layer]
        column = T_DOWN
    # the columns of the table for "down" are those for "up" with above and below exchanged
    t_ahead = look_up(stack.table, layer, column, w[2])
    r_ahead = look_up(stack.table, layer, column + 1, w[2])
    r_behind = look_up(stack.table, layer, R_UP + R_DOWN - column - 1, w[2])
    full = wp.exp(-sigma * thickness / cosine)
    echo = r_ahead * r_behind * full * full
    series = 1.0 / (1.0 - echo)
    chain = Chain()
    chain.shift = shift
    chain.spread = w[2] / (n * n * cosine)
    length = ahead
    chain.value = t_ahead * series
    side = sign * cosine
    if onwards == 0:
        length = 2.0 * thickness - ahead
        chain.value = chain.value * r_behind
        side = -side
    chain.value = chain.value * wp.exp(-sigma * length / cosine)
    chain.slope = -(length + 2.0 * thickness * echo * series) / cosine
    chain.inner = wp.vec3(w[0] / n, w[1] / n, side)
    return chain


@wp.func
def shifted(x: float, y: float, w: wp.vec3, shift: float) -> wp.vec3:
    """Where light from the lateral position (x, y) leaves the stack, on z = 0."""
    sine = wp.sqrt(wp.max(1.0e-12, 1.0 - w[2] * w[2]))
    return wp.vec3(x + w[0] / sine * shift, y + w[1] / sine * shift, 0.0)


@wp.func
def contribution(stack: Stack, layer: int, chain: Chain, before: wp.vec3, scale: float):
    """(value, d/d sigma_t, d/d g) of a chain whose direction was drawn by aiming."""
    mu = wp.dot(chain.inner, before)
    c = scale * chain.value * phase_of(stack, layer, mu)
    return wp.vec3(c, c * chain.slope, c * phase_slope(stack, layer, mu))


@wp.func
def connect_panels(
    problem: Problem,
    stack: Stack,
    sign: float,
    layer: int,
    at: wp.vec3,
    before: wp.vec3,
    onwards: int,
    panel: int,
    point: wp.vec3,
) -> wp.vec3:
    """Aim one chain at a point of a panel through the refracting surface.

    The direction follows from the straight line by two corrections for the shift inside the
    stack; each shrinks the error by shift / distance (1 mm in 300 mm).
    """
    w = wp.normalize(point - wp.vec3(at[0], at[1], 0.0))
    shift = chain_shift(stack, layer, sign, onwards, at[2], w[2])
    w = wp.normalize(point - shifted(at[0], at[1], w, shift[0]))
    shift = chain_shift(stack, layer, sign, onwards, at[2], w[2])
    leaves = shifted(at[0], at[1], w, shift[0])
    w = wp.normalize(point - leaves)
    if beside(problem, leaves[0], leaves[1]) or wp.dot(w, stack.panel_normal[panel]) >= 0.0:
        return wp.vec3(0.0, 0.0, 0.0)
    chain = follow_chain(stack, layer, sign, onwards, at[2], w, shift)
    inverse = panel_inverse_density(problem, stack, panel, leaves, w, shift) * chain.spread
    scale = problem.panel_scale * panel_radiance(stack, panel, point) * inverse
    if problem.two_ways == 1:
        scale = scale / (1.0 + inverse * phase_of(stack, layer, wp.dot(chain.inner, before)))
    return contribution(stack, layer, chain, before, scale)


@wp.func
def connect_scatter(
    problem: Problem,
    stack: Stack,
    kind: int,
    sign: float,
    layer: int,
    at: wp.vec3,
    before: wp.vec3,
    scattered: wp.vec3,
    u: float,
    v: float,
    pick: float,
) -> wp.vec3:
    """Light (or importance) that one scattering event exchanges with the target.

    Panels can be found in two ways, combined by the balance heuristic (Veach and Guibas 1995):
    aim at them, or take the direction in which the path is scattered anyway. A whole
    hemisphere is reached by the second alone, a cone or a direction by the first alone.

    `sign` is +1 for a target above the stack, -1 for one below; `at` is the position [mm];
    `before` and `scattered` are unit vectors before and after the event; u, v and pick are
    uniforms for the aim.

    Returns:
        (value, d value / d sigma_t of the connection, d value / d g of the connection).
    """
    total = wp.vec3(0.0, 0.0, 0.0)
    if kind == TARGET_PANELS:
        choice = pick * float(problem.n_panels)
        panel = wp.min(int(choice), problem.n_panels - 1)
        point = panel_point(stack, panel, u, v)
        total = connect_panels(problem, stack, sign, layer, at, before, 1, panel, point)
        # the reflected chain is weak: it is tried for a share of the events
        if choice - float(panel) < BACK_SHARE:
            total = total + connect_panels(
                problem, stack, sign, layer, at, before, 0, panel, point
            ) * (1.0 / BACK_SHARE)
    elif kind != TARGET_HEMISPHERE:
        w, weight = aim(problem, kind, u, v)
        for onwards in range(2):
            shift = chain_shift(stack, layer, sign, onwards, at[2], w[2])
            leaves = shifted(at[0], at[1], w, shift[0])
            if reached(problem, stack, kind, leaves, w) >= 0:
                chain = follow_chain(stack, layer, sign, onwards, at[2], w, shift)
                total = total + contribution(stack, layer, chain, before, weight * chain.spread)
    if kind == TARGET_HEMISPHERE or (kind == TARGET_PANELS and problem.two_ways == 1):
        n = stack.n[layer]
        x = scattered[0] * n
        y = scattered[1] * n
        sine_squared = x * x + y * y
        if sine_squared < 1.0:
            w = wp.vec3(x, y, wp.sqrt(1.0 - sine_squared))
            onwards = int(1)
            if scattered[2] * sign < 0.0:
                onwards = 0
            shift = chain_shift(stack, layer, sign, onwards, at[2], w[2])
            leaves = shifted(at[0], at[1], w, shift[0])
            hit = reached(problem, stack, kind, leaves, w)
            if hit >= 0:
                chain = follow_chain(stack, layer, sign, onwards, at[2], w, shift)
                mu = wp.dot(scattered, before)
                c = chain.value
                if kind == TARGET_PANELS:
                    inverse = panel_inverse_density(problem, stack, hit, leaves, w, shift)
                    share = inverse * chain.spread * phase_of(stack, layer, mu)
                    scale = problem.panel_scale * met_radiance(stack, hit, leaves[0], leaves[1], w)
                    c = c * scale * share / (1.0 + share)
                d_g = c * phase_slope(stack, layer, mu)
                total = total + wp.vec3(c, c * chain.slope, d_g)
    return total


@wp.func
def background_shift(problem: Problem, stack: Stack, cosine: float) -> wp.vec2:
    """Lateral shift [mm] from the background to the top, and its slope over the tangent."""
    row = problem.n_layers
    tangent = wp.sqrt(wp.max(0.0, 1.0 - cosine * cosine)) / wp.max(cosine, 1.0e-6)
    return wp.vec2(
        look_up(stack.table, row, SHIFT_ALL, cosine) + problem.gap * tangent,
        look_up(stack.table, row, SHIFT_ALL_SLOPE, cosine) + problem.gap,
    )


@wp.func
def moves_away(problem: Problem, enters: wp.vec3, w: wp.vec3) -> bool:
    """Whether a ray beside the stack, at the height of its lower face, moves away from it."""
    x = enters[0] - problem.offset_x
    y = enters[1] - problem.offset_y
    away_x = wp.abs(x) > problem.half_x and x * w[0] >= 0.0
    away_y = wp.abs(y) > problem.half_y and y * w[1] >= 0.0
    return away_x or away_y


@wp.func
def connect_background(
    problem: Problem, stack: Stack, at: wp.vec3, u: float, v: float, pick: float
) -> wp.vec2:
    """Light that a Lambertian point of the background exchanges with the target above.

    Returns (value at reflectance 1, d value / d sigma_t).
    """
    row = problem.n_layers
    kind = problem.target_up
    x = at[0]
    y = at[1]
    panel = wp.min(int(pick * float(problem.n_panels)), problem.n_panels - 1)
    w = wp.vec3(0.0, 0.0, 1.0)
    weight = float(0.0)
    shift = wp.vec2(0.0, 0.0)
    if kind == TARGET_PANELS:
        point = panel_point(stack, panel, u, v)
        w = wp.normalize(point - wp.vec3(x, y, 0.0))
        for correction in range(2):
            shift = background_shift(problem, stack, w[2])
            w = wp.normalize(point - shifted(x, y, w, shift[0]))
        leaves = shifted(x, y, w, shift[0])
        if wp.dot(w, stack.panel_normal[panel]) >= 0.0:
            return wp.vec2(0.0, 0.0)
        weight = panel_inverse_density(problem, stack, panel, leaves, w, shift)
        weight = weight * (problem.panel_scale * panel_radiance(stack, panel, point))
    else:
        w, weight = aim(problem, kind, u, v)
        shift = background_shift(problem, stack, w[2])
    cosine = wp.max(w[2], 1.0e-6)
    lit = weight * cosine / PI
    enters = wp.vec3(x + w[0] / cosine * problem.gap, y + w[1] / cosine * problem.gap, 0.0)
    leaves = shifted(x, y, w, shift[0])
    if beside(problem, enters[0], enters[1]):
        if moves_away(problem, enters, w):
            return wp.vec2(lit, 0.0)
        return wp.vec2(0.0, 0.0)
    if kind == TARGET_PANELS:
        if beside(problem, leaves[0], leaves[1]):
            return wp.vec2(0.0, 0.0)
    elif reached(problem, stack, kind, leaves, w) < 0:
        return wp.vec2(0.0, 0.0)
    return wp.vec2(
        lit * look_up(stack.table, row, T_ALL, w[2]),
        lit * look_up(stack.table, row, T_ALL_SLOPE, w[2]),
    )
