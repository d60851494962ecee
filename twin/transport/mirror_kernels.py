"""What a mirror below and the starting ray exchange with the light, unscattered, in closed form."""

from __future__ import annotations

import warp as wp

from twin.transport.connect_kernels import (
    R_ALL,
    R_ALL_SLOPE,
    SHIFT_ALL_SLOPE,
    T_ALL,
    T_ALL_SLOPE,
    TARGET_CONE,
    TARGET_HEMISPHERE,
    TARGET_PANELS,
    Problem,
    Stack,
    Tally,
    background_shift,
    beside,
    hits_panel,
    look_up,
    met_radiance,
    moves_away,
    score,
    shifted,
)

wp.set_module_options({"enable_backward": False})


@wp.func
def connect_mirror(problem: Problem, stack: Stack, at: wp.vec3, w: wp.vec3) -> wp.vec2:
    """Light that a mirror at a point of the background sends along w, unscattered, to the target.

    Returns (value at reflectance 1, d value / d sigma_t).
    """
    kind = problem.target_up
    cosine = wp.max(w[2], 1.0e-6)
    shift = background_shift(problem, stack, cosine)
    enters = wp.vec3(at[0] + w[0] / cosine * problem.gap, at[1] + w[1] / cosine * problem.gap, 0.0)
    leaves = shifted(at[0], at[1], w, shift[0])
    through = float(1.0)
    slope = float(0.0)
    if beside(problem, enters[0], enters[1]):
        if not moves_away(problem, enters, w):
            return wp.vec2(0.0, 0.0)
    elif beside(problem, leaves[0], leaves[1]):
        return wp.vec2(0.0, 0.0)
    else:
        through = look_up(stack.table, problem.n_layers, T_ALL, cosine)
        slope = look_up(stack.table, problem.n_layers, T_ALL_SLOPE, cosine)
    scale = float(0.0)
    if kind == TARGET_PANELS:
        for panel in range(problem.n_panels):
            if hits_panel(stack, panel, leaves[0], leaves[1], w):
                radiance = met_radiance(stack, panel, leaves[0], leaves[1], w)
                scale = scale + problem.panel_scale * radiance
    elif kind == TARGET_HEMISPHERE:
        scale = 1.0
    elif kind == TARGET_CONE and cosine >= problem.target_cosine:
        if leaves[0] * leaves[0] + leaves[1] * leaves[1] <= problem.exit_radius**2.0:
            scale = 1.0
    return wp.vec2(scale * through, scale * slope)


@wp.func
def score_unscattered(
    problem: Problem, stack: Stack, tally: Tally, block: int, at: wp.vec3, w: wp.vec3
):
    """Specular reflection and unscattered transmission of the starting ray, in closed form.

    The ray meets the stack at `at` [mm] with direction w in air.
    """
    cosine = wp.abs(w[2])
    row = problem.n_layers
    t = look_up(stack.table, row, T_ALL, cosine)
    r = look_up(stack.table, row, R_ALL, cosine)
    dt = look_up(stack.table, row, T_ALL_SLOPE, cosine)
    dr = look_up(stack.table, row, R_ALL_SLOPE, cosine)
    up = r
    d_up = dr
    down = t
    d_down = dt
    if problem.start_from_below == 1:
        up = t
        d_up = dt
        down = r
        d_down = dr
    if problem.target_up == TARGET_PANELS:
        mirrored = wp.vec3(w[0], w[1], cosine)
        for panel in range(problem.n_panels):
            if hits_panel(stack, panel, at[0], at[1], mirrored):
                scale = problem.panel_scale * met_radiance(stack, panel, at[0], at[1], mirrored)
                score(tally, block, 0, 0, 0, scale * up, scale * d_up, 0.0)
                score(tally, block, 1, 0, 0, scale * up, scale * d_up, 0.0)
    x = at[0]
    y = at[1]
    if problem.start_from_below == 1 and problem.start_sine != 0.0:
        # a tilted beam leaves elsewhere; near the normal the shift goes with the tangent
        along = look_up(stack.table, row, SHIFT_ALL_SLOPE, cosine) / cosine
        x = x + w[0] * along
        y = y + w[1] * along
    inside = x * x + y * y <= problem.exit_radius * problem.exit_radius
    in_cone = cosine >= problem.target_cosine and inside
    if problem.target_up == TARGET_HEMISPHERE or (problem.target_up == TARGET_CONE and in_cone):
        score(tally, block, 0, 0, 0, up, d_up, 0.0)
    if problem.target_down == TARGET_HEMISPHERE or (problem.target_down == TARGET_CONE and in_cone):
        score(tally, block, 1, 0, 0, down, d_down, 0.0)
