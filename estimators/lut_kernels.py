"""Inversion of a piecewise linear map on a structured grid, as Warp kernels.

Every cell of the grid (albedo x sigma_t x g) is split into the six Kuhn tetrahedra; inside a
tetrahedron the captures are linear in the grid coordinates, so that the inverse is
barycentric. A point is found by Newton steps over tetrahedra, then by a walk across faces,
then, when it lies outside, projected to the nearest element by damped least squares inside
the box of the grid (Katzenelson 1965, Bell Syst. Tech. J. 44(8); Kuhn 1960, IBM J. 4(5)).

A capture triple is (I_black, I_white, third); third is ln I_collimated, or g itself in the
two-dimensional map. A place is a point in grid coordinates: node numbers with fractions.
"""

from __future__ import annotations

import warp as wp

DEGENERATE = wp.constant(wp.float64(1e-12))
ROUNDING = wp.constant(wp.float64(1e-8))
EDGE = wp.constant(wp.float64(1e-9))


@wp.func
def captures_at(
    node: int,
    row: int,
    series: wp.array(dtype=wp.float64),
    power: wp.array2d(dtype=wp.float64),
    third: wp.array(dtype=wp.float64),
    terms: int,
) -> wp.vec3d:
    """Capture triple of one node at the backgrounds of one wavelength."""
    black = wp.float64(0.0)
    white = wp.float64(0.0)
    first = node * 2 * terms
    for term in range(terms):
        black += series[first + term] * power[row, term]
        white += series[first + terms + term] * power[row, terms + term]
    return wp.vec3d(black, white, third[node])


@wp.func
def descending(fraction: wp.vec3d) -> wp.vec3i:
    """The axes in the order of falling fractions: names the Kuhn tetrahedron."""
    a = 0
    b = 1
    c = 2
    if fraction[b] > fraction[a]:
        a = 1
        b = 0
    if fraction[c] > fraction[b]:
        swap = b
        b = c
        c = swap
        if fraction[b] > fraction[a]:
            swap = a
            a = b
            b = swap
    return wp.vec3i(a, b, c)


@wp.func
def corner_of(place: wp.vec3d, shape: wp.vec3i) -> wp.vec3i:
    """Lowest node of the cell that holds a place."""
    i = wp.clamp(int(wp.floor(place[0])), 0, shape[0] - 2)
    j = wp.clamp(int(wp.floor(place[1])), 0, shape[1] - 2)
    k = wp.clamp(int(wp.floor(place[2])), 0, shape[2] - 2)
    return wp.vec3i(i, j, k)


@wp.func
def inside_box(place: wp.vec3d, shape: wp.vec3i) -> wp.vec3d:
    """The nearest place inside the grid."""
    return wp.vec3d(
        wp.clamp(place[0], wp.float64(0.0), wp.float64(shape[0] - 1)),
        wp.clamp(place[1], wp.float64(0.0), wp.float64(shape[1] - 1)),
        wp.clamp(place[2], wp.float64(0.0), wp.float64(shape[2] - 1)),
    )


@wp.func
def stride_of(axis: int, shape: wp.vec3i) -> int:
    """Distance of two neighbours along an axis in the flattened grid."""
    stride = int(1)
    if axis == 0:
        stride = shape[1] * shape[2]
    if axis == 1:
        stride = shape[2]
    return stride


@wp.func
def tetrahedron(
    corner: wp.vec3i,
    order: wp.vec3i,
    shape: wp.vec3i,
    row: int,
    series: wp.array(dtype=wp.float64),
    power: wp.array2d(dtype=wp.float64),
    third: wp.array(dtype=wp.float64),
    terms: int,
):
    """Captures at the corner and their change along the axes, in the tetrahedron's order."""
    node = (corner[0] * shape[1] + corner[1]) * shape[2] + corner[2]
    v0 = captures_at(node, row, series, power, third, terms)
    node += stride_of(order[0], shape)
    v1 = captures_at(node, row, series, power, third, terms)
    node += stride_of(order[1], shape)
    v2 = captures_at(node, row, series, power, third, terms)
    node += stride_of(order[2], shape)
    v3 = captures_at(node, row, series, power, third, terms)
    return v0, v1 - v0, v2 - v1, v3 - v2


@wp.func
def solve(d0: wp.vec3d, d1: wp.vec3d, d2: wp.vec3d, rest: wp.vec3d):
    """Fractions f with f0 d0 + f1 d1 + f2 d2 = rest, and whether the element has a volume."""
    normal = wp.cross(d1, d2)
    volume = wp.dot(d0, normal)
    size = wp.length(d0) * wp.length(d1) * wp.length(d2)
    if wp.abs(volume) <= DEGENERATE * size or size == wp.float64(0.0):
        return wp.vec3d(), 0
    f = wp.vec3d(
        wp.dot(rest, normal), wp.dot(d0, wp.cross(rest, d2)), wp.dot(d0, wp.cross(d1, rest))
    )
    f = f / volume
    # Rounding spoils the solution of an element that is squeezed almost flat.
    missed = rest - f[0] * d0 - f[1] * d1 - f[2] * d2
    if wp.length_sq(missed) > ROUNDING * ROUNDING * (wp.float64(1.0) + wp.length_sq(rest)):
        return f, 0
    return f, 1


@wp.func
def scattered(order: wp.vec3i, f: wp.vec3d) -> wp.vec3d:
    """Fractions in the tetrahedron's order, put back on the grid's axes."""
    back = wp.vec3d()
    for i in range(3):
        for axis in range(3):
            if order[i] == axis:
                back[axis] = f[i]
    return back


@wp.func
def as_place(corner: wp.vec3i) -> wp.vec3d:
    """A node as a place."""
    return wp.vec3d(wp.float64(corner[0]), wp.float64(corner[1]), wp.float64(corner[2]))


@wp.func
def contains(f: wp.vec3d) -> bool:
    """Whether fractions in the tetrahedron's order lie inside it."""
    one = wp.float64(1.0) + EDGE
    return f[0] <= one and f[0] >= f[1] - EDGE and f[1] >= f[2] - EDGE and f[2] >= -EDGE


@wp.func
def mismatch(
    place: wp.vec3d,
    target: wp.vec3d,
    shape: wp.vec3i,
    row: int,
    series: wp.array(dtype=wp.float64),
    power: wp.array2d(dtype=wp.float64),
    third: wp.array(dtype=wp.float64),
    terms: int,
) -> wp.vec3d:
    """Target minus the captures at a place."""
    corner = corner_of(place, shape)
    fraction = place - as_place(corner)
    order = descending(fraction)
    v0, d0, d1, d2 = tetrahedron(corner, order, shape, row, series, power, third, terms)
    return target - v0 - fraction[order[0]] * d0 - fraction[order[1]] * d1 - fraction[order[2]] * d2


@wp.func
def damped_step(
    j0: wp.vec3d,
    j1: wp.vec3d,
    j2: wp.vec3d,
    rest: wp.vec3d,
    damping: wp.float64,
    place: wp.vec3d,
    shape: wp.vec3i,
) -> wp.vec3d:
    """Levenberg-Marquardt step; axes held at a border that the gradient pushes against."""
    gradient = wp.vec3d(wp.dot(j0, rest), wp.dot(j1, rest), wp.dot(j2, rest))
    normal = wp.mat33d(
        wp.dot(j0, j0),
        wp.dot(j0, j1),
        wp.dot(j0, j2),
        wp.dot(j0, j1),
        wp.dot(j1, j1),
        wp.dot(j1, j2),
        wp.dot(j0, j2),
        wp.dot(j1, j2),
        wp.dot(j2, j2),
    )
    size = wp.trace(normal)
    for axis in range(3):
        low = place[axis] <= EDGE and gradient[axis] < wp.float64(0.0)
        high = place[axis] >= wp.float64(shape[axis] - 1) - EDGE and gradient[axis] > wp.float64(
            0.0
        )
        normal[axis, axis] = normal[axis, axis] * (wp.float64(1.0) + damping) + size * DEGENERATE
        if low or high:
            for other in range(3):
                normal[axis, other] = wp.float64(0.0)
                normal[other, axis] = wp.float64(0.0)
            normal[axis, axis] = wp.float64(1.0)
            gradient[axis] = wp.float64(0.0)
    return wp.inverse(normal) * gradient


@wp.kernel
def invert(
    series: wp.array(dtype=wp.float64),
    power: wp.array2d(dtype=wp.float64),
    third: wp.array(dtype=wp.float64),
    shape: wp.vec3i,
    terms: int,
    target: wp.array(dtype=wp.vec3d),
    row: wp.array(dtype=wp.int32),
    start: wp.array(dtype=wp.vec3d),
    scale: wp.array(dtype=wp.vec3d),
    steps: wp.vec3i,
    first: int,
    place: wp.array(dtype=wp.vec3d),
    rest: wp.array(dtype=wp.vec3d),
    inside: wp.array(dtype=wp.int32),
):
    """Find the place in the grid whose captures are the target.

    Args:
        series: black, then white coefficients of every node, shape [node_count * 2 * terms].
        power: background reflectance to the exponents, black then white, shape
            [wavelength_count, 2 * terms].
        third: third capture of every node, shape [node_count].
        shape: nodes along albedo, sigma_t, g.
        terms: number of coefficients of each background.
        target: capture triples, shape [query_count].
        row: wavelength of every query, shape [query_count].
        start: place to start from, shape [query_count].
        scale: unit of the mismatch in the projection, shape [wavelength_count].
        steps: most Newton steps, face crossings, projection steps.
        first: number of the first query of this launch.
        place: place found, shape [query_count].
        rest: target minus captures at the place, shape [query_count].
        inside: 1 where an element contains the target, else 0, shape [query_count].
    """
    query = first + wp.tid()
    y = target[query]
    w = row[query]
    u = inside_box(start[query], shape)
    limit = wp.float64(8.0)
    corner = corner_of(u, shape)
    order = descending(u - as_place(corner))

    for step in range(steps[0]):
        v0, d0, d1, d2 = tetrahedron(corner, order, shape, w, series, power, third, terms)
        f, fine = solve(d0, d1, d2, y - v0)
        if fine == 0:
            break
        goal = as_place(corner) + scattered(order, f)
        if contains(f):
            place[query] = inside_box(goal, shape)
            rest[query] = wp.vec3d()
            inside[query] = 1
            return
        move = goal - u
        longest = wp.max(wp.abs(move))
        if longest > limit:
            move = move * (limit / longest)
        following = inside_box(u + move, shape)
        if wp.max(wp.abs(following - u)) < EDGE:
            break
        u = following
        corner = corner_of(u, shape)
        order = descending(u - as_place(corner))
        # Shrinking steps break the cycles that Newton falls into at a kink.
        if step > 2:
            limit = limit * wp.float64(0.6)

    for _step in range(steps[1]):
        v0, d0, d1, d2 = tetrahedron(corner, order, shape, w, series, power, third, terms)
        f, fine = solve(d0, d1, d2, y - v0)
        if fine == 0:
            break
        if contains(f):
            place[query] = inside_box(as_place(corner) + scattered(order, f), shape)
            rest[query] = wp.vec3d()
            inside[query] = 1
            return
        share = wp.vec4d(wp.float64(1.0) - f[0], f[0] - f[1], f[1] - f[2], f[2])
        # Faces on the border of the grid cannot be crossed.
        if corner[order[0]] >= shape[order[0]] - 2:
            share[0] = wp.float64(0.0)
        if corner[order[2]] <= 0:
            share[3] = wp.float64(0.0)
        across = int(-1)
        least = -EDGE
        for side in range(4):
            if share[side] < least:
                least = share[side]
                across = side
        if across < 0:
            break
        if across == 0:
            corner[order[0]] = corner[order[0]] + 1
            order = wp.vec3i(order[1], order[2], order[0])
        elif across == 1:
            order = wp.vec3i(order[1], order[0], order[2])
        elif across == 2:
            order = wp.vec3i(order[0], order[2], order[1])
        else:
            corner[order[2]] = corner[order[2]] - 1
            order = wp.vec3i(order[2], order[0], order[1])

    unit = scale[w]
    best = mismatch(u, y, shape, w, series, power, third, terms)
    least_squares = wp.length_sq(wp.cw_div(best, unit))
    damping = wp.float64(1e-3)
    look = u
    for _step in range(steps[2]):
        # After a rejected step the element on the other side of the kink leads the way.
        corner = corner_of(look, shape)
        order = descending(look - as_place(corner))
        v0, d0, d1, d2 = tetrahedron(corner, order, shape, w, series, power, third, terms)
        j = wp.mat33d()
        for i in range(3):
            column = d0
            if i == 1:
                column = d1
            if i == 2:
                column = d2
            column = wp.cw_div(column, unit)
            for axis in range(3):
                if order[i] == axis:
                    j[0, axis] = column[0]
                    j[1, axis] = column[1]
                    j[2, axis] = column[2]
        j0 = wp.vec3d(j[0, 0], j[1, 0], j[2, 0])
        j1 = wp.vec3d(j[0, 1], j[1, 1], j[2, 1])
        j2 = wp.vec3d(j[0, 2], j[1, 2], j[2, 2])
        move = damped_step(j0, j1, j2, wp.cw_div(best, unit), damping, u, shape)
        trial = inside_box(u + move, shape)
        there = mismatch(trial, y, shape, w, series, power, third, terms)
        squares = wp.length_sq(wp.cw_div(there, unit))
        if squares < least_squares:
            gain = least_squares - squares
            u = trial
            look = trial
            best = there
            least_squares = squares
            damping = wp.max(damping * wp.float64(0.2), wp.float64(1e-9))
            if gain < wp.float64(1e-10) * squares:
                break
        else:
            if damping > wp.float64(1e8):
                break
            damping = damping * wp.float64(6.0)
            look = inside_box(u + move * wp.float64(0.5), shape)
    place[query] = u
    rest[query] = best
    inside[query] = 0
