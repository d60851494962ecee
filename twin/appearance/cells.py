"""One cell of a map, and its sum with the plane-parallel bench."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.appearance.factors import TAIL_RHO, log_factors
from twin.appearance.plane import PlaneParts
from twin.appearance.smoothing import fine_enough, smoothed_error, smoothed_ratio
from twin.bench import Bench
from twin.spectra import FloatArray
from twin.transport import Effort, trace
from twin.transport.engine import BLACK, UNBOUNDED_STACK, WHITE, bounce_bins, mean_and_error
from twin.transport.geometry import beam_reference_share, beam_setup, panels_setup
from twin.transport.tables import FlatStack

BLOCKS = 32


@dataclass(frozen=True)
class Cell:
    """Result of one (sigma_t, g): arrays over albedo (A,) and bounce bins (B,).

    `unscattered` is the part of `collimated` that no albedo changes, (1,).
    """

    black: FloatArray
    white: FloatArray
    collimated: FloatArray
    unscattered: FloatArray
    errors: FloatArray


def thinning(stack: FlatStack) -> float:
    """Share of the paths that a cell gets.

    A path through an optically thick sample costs up to twenty times as much as one through a
    thin sample, while its relative variance is smaller; both get a similar error this way.
    """
    thick = float(np.sum(stack.sigma_t * stack.thickness))
    return float(np.clip(1.5 / max(thick, 1e-9), 0.0625, 1.0))


def trace_cell(
    bench: Bench,
    stack: FlatStack,
    albedo: FloatArray,
    rho: tuple[float, float],
    paths: int,
    random: tuple[int, int],
    paired: bool,
) -> Cell:
    """One (sigma_t, g): panels and beam, all albedos, both backgrounds.

    Paired: what the finite bench gives more (or less) than the unbounded one.
    """
    seed, stream = random
    log2_paths = max(4, round(np.log2(max(1, paths) * thinning(stack) / BLOCKS)))
    # the plane-parallel engine knows a parallel beam alone
    straight = paired and bench.beam.straight
    panels = trace(
        stack,
        panels_setup(bench, stack.height),
        Effort(BLOCKS, log2_paths, paired=paired),
        seed=seed,
        stream=stream,
    )
    beam = trace(
        stack,
        beam_setup(bench),
        Effort(BLOCKS, max(4, log2_paths - 4), paired=straight),
        seed=seed,
        stream=stream + 1,
    )
    black = panels.blocks_by_albedo(BLACK, albedo)
    white = panels.blocks_by_albedo(WHITE, albedo)
    share = beam_reference_share(bench, stack.height)
    collimated = beam.blocks_by_albedo(BLACK, albedo)[..., 0] / share
    unscattered = beam.blocks_by_albedo(BLACK, np.zeros(1))[..., 0] / share
    if paired:
        black -= panels.blocks_by_albedo(UNBOUNDED_STACK, albedo)
        white -= panels.blocks_by_albedo(UNBOUNDED_STACK, albedo)
    if straight:
        collimated -= beam.blocks_by_albedo(UNBOUNDED_STACK, albedo)[..., 0]
    errors = np.stack(
        [
            mean_and_error(black @ rho[0] ** panels.bounce)[1],
            mean_and_error(white @ rho[1] ** panels.bounce)[1],
            mean_and_error(collimated)[1],
        ]
    )
    return Cell(
        black.mean(axis=0),
        white.mean(axis=0),
        collimated.mean(axis=0),
        unscattered.mean(axis=0),
        errors,
    )


def add_plane(
    slab: dict[str, FloatArray],
    errors: FloatArray,
    plane: PlaneParts,
    rho: tuple[float, float],
    sigma_t: FloatArray,
    straight: bool,
) -> None:
    """From differences between finite and unbounded bench to the finite one, errors included.

    Args:
        slab: differences, (A, S, B) for black and white, (A, S) for collimated; changed.
        errors: standard errors of the three captures, (3, A, S); changed.
        plane: the unbounded bench.
        rho: reflectances at which errors are stated.
        sigma_t: (S,) [1/mm].
        straight: the beam is parallel, so that its capture is a difference too.
    """
    bounce, exponent = bounce_bins()
    series = plane.bounced(exponent, bounce)
    fine = fine_enough(sigma_t)
    step = float(np.log(sigma_t[1] / sigma_t[0]))
    for row, name in enumerate(("black", "white")):
        total = series @ rho[row] ** exponent
        if fine:
            slab[name] = smoothed_ratio(slab[name], series, step)
            use = np.ones(total.shape, dtype=bool)
            relative = errors[row] / np.where(total > 0.0, total, 1.0)
            errors[row] = smoothed_error(relative, use, step) * total
        errors[row] = np.hypot(errors[row], plane.error * total)
        slab[name] = series + slab[name]
    if straight:
        slab["collimated"] = slab["collimated"] + plane.scattered
        errors[2] = np.hypot(errors[2], plane.error * plane.scattered)


def factors_of(slab: dict[str, FloatArray], plane: PlaneParts) -> FloatArray:
    """Logarithms of the factors from the fast plane-parallel engine to the map, (5, A, S).

    They take that engine's own quadrature along, so that it agrees with the map at the nodes.
    """
    exponent = bounce_bins()[1]
    return log_factors(
        np.stack([plane.direct, plane.once, plane.returned, plane.scattered]),
        slab["black"][..., 0],
        (slab["black"][..., 1], slab["white"][..., 1]),
        slab["white"][..., 1:] @ TAIL_RHO ** (exponent[1:] - 1.0),
        slab["collimated"] - slab["unscattered"],
    )
