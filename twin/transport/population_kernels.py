"""The population of one block: its paths, their order, and how it is split and thinned.

All paths of a block advance together, so that between two events the whole population can be
sorted and resampled. Importance splitting keeps weight x importance the same for all paths:
each is replaced by a whole number of copies whose mean is weight x importance in units of the
block's `spacing` (systematic resampling, the comb of Booth 1996, over the sorted paths, so
that the rounding of one path is made up for by its neighbour in depth). Weights are divided by
that mean, not by the number of copies: every sum over paths keeps its expectation whatever the
importance is; a poor importance costs variance only.
"""

from __future__ import annotations

import warp as wp

from twin.transport.connect_kernels import Problem, Stack
from twin.transport.sampling_kernels import GOLDEN_GAMMA, mix64

wp.set_module_options({"enable_backward": False})

DIGIT = wp.constant(1024)
KEYS = wp.constant(1048576.0)
FAR_LOG = wp.constant(1.0e30)
IMPORTANCE_SIZE = wp.constant(4096)


@wp.struct
class Path:
    """State of one path after its latest event, or with splitting just before the next one."""

    at: wp.vec3
    direction: wp.vec3
    weight: float
    score_sigma: float
    score_g: float
    layer: int  # n_layers when the path leaves the background, through the gap
    order: int
    bounces: int
    on_black: int
    on_white: int
    black_share: float  # of the weight: a background is a mirror or Lambertian with a share each
    white_share: float
    alive: int
    event: int  # what the path is about to meet
    state: wp.uint64


@wp.struct
class Generation:
    """Working memory of the blocks: paths and their order, [block, path].

    With splitting, `paths` holds two populations of `capacity` places each: one is read while
    the other is written. `share` is weight x importance over the spacing.
    """

    paths: wp.array2d(dtype=Path)
    order: wp.array2d(dtype=wp.int32)
    spare: wp.array2d(dtype=wp.int32)
    key: wp.array2d(dtype=wp.int32)
    count: wp.array2d(dtype=wp.int32)
    share: wp.array2d(dtype=float)


@wp.struct
class Splitting:
    """Importance over the optical depth from the face where light starts.

    `log_importance` is tabulated between the optical depths `lowest` and `highest`; `depth` is
    that of each layer's face on the starting side, `lead` how much optical depth a path gains
    that moves straight on rather than sideways.
    """

    active: int
    capacity: int
    sign: float
    log_albedo: float
    lowest: float
    highest: float
    depth: wp.array(dtype=float)
    lead: wp.array(dtype=float)
    log_importance: wp.array(dtype=float)


@wp.func
def sort_key(problem: Problem, stack: Stack, path: Path) -> int:
    """Place of a path on a Z-order curve through depth and direction cosine, 20 bits."""
    lowest = stack.bottom[problem.n_layers - 1] - problem.gap
    depth = wp.clamp(path.at[2] / lowest, 0.0, 0.99999)
    turned = wp.clamp(0.5 * (path.direction[2] + 1.0), 0.0, 0.99999)
    a = int(depth * 1024.0)
    b = int(turned * 1024.0)
    key = int(0)
    for bit in range(10):
        key = key | (((a >> bit) & 1) << (2 * bit + 1)) | (((b >> bit) & 1) << (2 * bit))
    return key


@wp.func
def sort_pass(generation: Generation, row: int, count: int, shift: int, to_spare: int):
    """One stable counting pass over ten bits of the keys."""
    for digit in range(DIGIT + 1):
        generation.count[row, digit] = 0
    for i in range(count):
        index = generation.order[row, i]
        if to_spare == 0:
            index = generation.spare[row, i]
        digit = (generation.key[row, index] >> shift) & (DIGIT - 1)
        generation.count[row, digit + 1] = generation.count[row, digit + 1] + 1
    for digit in range(DIGIT):
        generation.count[row, digit + 1] = (
            generation.count[row, digit + 1] + generation.count[row, digit]
        )
    for i in range(count):
        index = generation.order[row, i]
        if to_spare == 0:
            index = generation.spare[row, i]
        digit = (generation.key[row, index] >> shift) & (DIGIT - 1)
        place = generation.count[row, digit]
        generation.count[row, digit] = place + 1
        if to_spare == 1:
            generation.spare[row, place] = index
        else:
            generation.order[row, place] = index


@wp.func
def place(problem: Problem, stack: Stack, splitting: Splitting, path: Path) -> float:
    """Where a path stands in the table of importance, 0 to 1."""
    x = splitting.highest
    if path.layer < problem.n_layers and path.event == 1:
        layer = path.layer
        into = stack.top[layer] - path.at[2]
        if splitting.sign > 0.0:
            into = path.at[2] - stack.bottom[layer]
        onwards = splitting.sign * path.direction[2]
        x = splitting.depth[layer] + stack.sigma_t[layer] * into + splitting.lead[layer] * onwards
    elif splitting.sign > 0.0:
        # the background lies on the side where light starts
        x = splitting.lowest
    return wp.clamp((x - splitting.lowest) / (splitting.highest - splitting.lowest), 0.0, 0.999999)


@wp.func
def log_share(splitting: Splitting, path: Path, at: float) -> float:
    """Logarithm of a path's weight x importance at its place in the table."""
    x = at * float(IMPORTANCE_SIZE)
    i = int(x)
    f = x - float(i)
    table = splitting.log_importance[i] * (1.0 - f) + splitting.log_importance[i + 1] * f
    return wp.log(path.weight) + float(path.order) * splitting.log_albedo + table


@wp.func
def log_spacing(generation: Generation, row: int, alive: int, wanted: float, least: float) -> float:
    """Logarithm of the spacing that makes `wanted` copies of a population, at least `least`.

    `generation.share` holds the logarithms of weight x importance.
    """
    highest = float(-FAR_LOG)
    for i in range(alive):
        highest = wp.max(highest, generation.share[row, generation.order[row, i]])
    total = wp.float64(0.0)
    for i in range(alive):
        share = generation.share[row, generation.order[row, i]]
        total = total + wp.float64(wp.exp(share - highest))
    return wp.max(least, highest + wp.log(float(total) / wanted))


@wp.func
def resample(
    splitting: Splitting,
    generation: Generation,
    row: int,
    source: int,
    alive: int,
    spacing: float,
    comb: float,
    family: wp.uint64,
    born: int,
):
    """Split and thin a population in its sorted order, into the other half of the memory.

    `source` is where the population begins, 0 or `capacity`; `comb` in [0, 1) places the comb;
    the streams of copies are hashed from `family` and from `born`, the number of paths so far.

    Returns:
        (number of paths, number of paths born so far).
    """
    target = splitting.capacity - source
    count = int(0)
    births = int(born)
    passed = wp.float64(comb)
    for i in range(alive):
        index = generation.order[row, i]
        share = wp.exp(generation.share[row, index] - spacing)
        before = wp.floor(passed)
        passed = passed + wp.float64(share)
        copies = wp.min(int(wp.floor(passed) - before), splitting.capacity - count)
        if copies > 0:
            path = generation.paths[row, source + index]
            path.weight = path.weight / share
            for copy in range(copies):
                if copy > 0:
                    births = births + 1
                    path.state = mix64(family + wp.uint64(births) * GOLDEN_GAMMA)
                generation.paths[row, target + count] = path
                count = count + 1
    for i in range(count):
        generation.order[row, i] = i
    return count, births
