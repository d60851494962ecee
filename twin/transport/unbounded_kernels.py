"""The unbounded stack told by the paths of the bounded one (`Effort.paired`).

What adding-doubling knows without noise: no sides, backgrounds without edge, and light that
leaves anywhere counts as if it left on the axis.
"""

from __future__ import annotations

import warp as wp

from twin.transport.connect_kernels import (
    BACK_SHARE,
    PI,
    T_ALL,
    TARGET_PANELS,
    Problem,
    Stack,
    aim,
    follow_chain,
    hits_panel,
    look_up,
    met_radiance,
    panel_inverse_density,
    panel_point,
    panel_radiance,
    phase_of,
)

wp.set_module_options({"enable_backward": False})


@wp.func
def connect_unbounded(
    problem: Problem,
    stack: Stack,
    layer: int,
    z: float,
    before: wp.vec3,
    scattered: wp.vec3,
    u: float,
    v: float,
    pick: float,
) -> float:
    """What `connect_scatter` is on an unbounded stack: the target above, seen from the axis.

    Position does not matter there: light that leaves anywhere towards a direction counts as
    if it left at the origin. The same uniforms make it follow `connect_scatter` closely.
    """
    total = float(0.0)
    kind = problem.target_up
    nowhere = wp.vec2(0.0, 0.0)
    origin = wp.vec3(0.0, 0.0, 0.0)
    if kind == TARGET_PANELS:
        choice = pick * float(problem.n_panels)
        panel = wp.min(int(choice), problem.n_panels - 1)
        point = panel_point(stack, panel, u, v)
        light = problem.panel_scale * panel_radiance(stack, panel, point)
        w = wp.normalize(point)
        if w[2] > 0.0 and wp.dot(w, stack.panel_normal[panel]) < 0.0:
            density = panel_inverse_density(problem, stack, panel, origin, w, nowhere)
            for back in range(2):
                weight = float(1.0)
                if back == 1:
                    weight = 0.0
                    if choice - float(panel) < BACK_SHARE:
                        weight = 1.0 / BACK_SHARE
                if weight > 0.0:
                    chain = follow_chain(stack, layer, 1.0, 1 - back, z, w, nowhere)
                    phase = phase_of(stack, layer, wp.dot(chain.inner, before))
                    inverse = density * chain.spread
                    share = inverse * phase
                    if problem.two_ways == 1:
                        share = share / (1.0 + share)
                    total = total + weight * light * share * chain.value
        if problem.two_ways == 1:
            n = stack.n[layer]
            x = scattered[0] * n
            y = scattered[1] * n
            sine_squared = x * x + y * y
            if sine_squared < 1.0:
                w = wp.vec3(x, y, wp.sqrt(1.0 - sine_squared))
                onwards = int(1)
                if scattered[2] < 0.0:
                    onwards = 0
                for candidate in range(problem.n_panels):
                    if hits_panel(stack, candidate, 0.0, 0.0, w):
                        chain = follow_chain(stack, layer, 1.0, onwards, z, w, nowhere)
                        inverse = panel_inverse_density(
                            problem, stack, candidate, origin, w, nowhere
                        )
                        phase = phase_of(stack, layer, wp.dot(scattered, before))
                        share = inverse * chain.spread * phase
                        light = problem.panel_scale * met_radiance(stack, candidate, 0.0, 0.0, w)
                        total = total + light * chain.value * share / (1.0 + share)
                        break
    else:
        w, weight = aim(problem, kind, u, v)
        for onwards in range(2):
            chain = follow_chain(stack, layer, 1.0, onwards, z, w, nowhere)
            phase = phase_of(stack, layer, wp.dot(chain.inner, before))
            total = total + weight * chain.spread * chain.value * phase
    return total


@wp.func
def connect_unbounded_background(
    problem: Problem, stack: Stack, u: float, v: float, pick: float
) -> float:
    """What `connect_background` is for panels seen from the axis of an unbounded stack."""
    row = problem.n_layers
    panel = wp.min(int(pick * float(problem.n_panels)), problem.n_panels - 1)
    point = panel_point(stack, panel, u, v)
    w = wp.normalize(point)
    if w[2] <= 0.0 or wp.dot(w, stack.panel_normal[panel]) >= 0.0:
        return 0.0
    origin = wp.vec3(0.0, 0.0, 0.0)
    weight = panel_inverse_density(problem, stack, panel, origin, w, wp.vec2(0.0, 0.0))
    light = problem.panel_scale * panel_radiance(stack, panel, point)
    lit = weight * light * w[2] / PI
    return lit * look_up(stack.table, row, T_ALL, w[2])
