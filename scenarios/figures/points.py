"""What the figures are computed from: single points of the map, with their derivatives.

The bench is bench.md's, with a bare slab as the sample and backgrounds of 1 % and 99 % (Iser et
al. 2022, Fig. 2). One set of paths serves all albedos; its blocks are kept, so that a quantity
made of several values (a Jacobian, a ratio) gets its standard error by the jackknife.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from twin.bench import Bench, Detector, Sample
from twin.materials import OpticalProperties
from twin.spectra import FloatArray
from twin.transport import (
    Effort,
    Setup,
    beam_setup,
    flat_stacks,
    panels_setup,
    run_many,
    trace,
)

RHO_BLACK, RHO_WHITE = 0.01, 0.99
BENCH = Bench(covers_above=(), covers_below=())
BLOCKS = 32
PANELS_STREAM, BEAM_STREAM = 1, 2
CONTOUR_ALBEDO = (0.0, 0.5, 0.8, 0.9, 0.95, 0.98, 0.99, 0.995, 0.999, 1.0)
CONTOUR_SIGMA = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
"""Contours that the maps show: albedos, and extinction coefficients [1/mm]."""
_NOMINAL_NM = np.array([550.0])


def _albedo_grid() -> tuple[float, ...]:
    spaced = 1.0 - np.geomspace(1.0, 1e-4, 41)
    return tuple(np.unique(np.round([*spaced, *CONTOUR_ALBEDO], 9)).tolist())


ALBEDO = _albedo_grid()
"""Albedos of every map: even steps in log(1 - albedo), the contours, and 1."""


def sigma_grid(quick: bool, low: float = 0.01, high: float = 100.0) -> tuple[float, ...]:
    """Extinction coefficients [1/mm]: the preferred numbers R10 (quick: 1, 2, 5) of each decade."""
    steps = (1.0, 2.0, 5.0) if quick else (1.0, 1.25, 1.6, 2.0, 2.5, 3.2, 4.0, 5.0, 6.3, 8.0)
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    values = [round(step * 10.0**decade, 6) for decade in decades for step in steps]
    return tuple(value for value in values if 0.999 * low <= value <= 1.001 * high)


@dataclass(frozen=True)
class Point:
    """One simulation: a bare slab of one medium, all its albedos.

    Attributes:
        sigma_t_per_mm: [1/mm]; g: anisotropy factor; n: refractive index; thickness_mm: [mm].
        lit: by the panels (over both backgrounds) or by the beam (over none).
        acceptance_deg: half-angle of the detector's cone; None collects every direction that
            leaves through the detector's disc.
        albedo: at which the result is evaluated.
        log2_paths: paths per block, as a power of two.
        wider: everything but slab and gap is this many times larger than on the bench.
    """

    sigma_t_per_mm: float
    g: float = 0.4
    n: float = 1.0
    thickness_mm: float = 0.5
    lit: Literal["panels", "beam"] = "panels"
    acceptance_deg: float | None = Detector().acceptance_deg
    albedo: tuple[float, ...] = ALBEDO
    log2_paths: int = 10
    wider: float = 1.0


@dataclass(frozen=True)
class Blocks:
    """Result of a point, block by block; every array has shape (blocks, Q, A).

    Q quantities: for the panels I_black and I_white - I_black (from the same paths, so that the
    difference stays exact where it is small); for the beam the transmittance.

    Attributes:
        value: the quantities; d_albedo, d_sigma [mm], d_g: their derivatives.
    """

    value: FloatArray
    d_albedo: FloatArray
    d_sigma: FloatArray
    d_g: FloatArray

    @cached_property
    def mean(self) -> FloatArray:
        """The quantities, shape (Q, A)."""
        return np.asarray(self.value.mean(axis=0))


def leave_one_out(blocks: FloatArray) -> FloatArray:
    """Means of all blocks but one, in the shape of the blocks (blocks first)."""
    count = blocks.shape[0]
    return np.asarray((blocks.sum(axis=0) - blocks) / (count - 1))


def jackknife(left_out: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean and standard error of a statistic of leave-one-out means (Tukey 1958).

    Args:
        left_out: the statistic without each block, shape (blocks, ...).

    Returns:
        Mean and standard error, shape (...) each.
    """
    count = left_out.shape[0]
    mean = left_out.mean(axis=0)
    spread = np.sum((left_out - mean) ** 2, axis=0)
    return np.asarray(mean), np.sqrt(spread * (count - 1) / count)


def simulate(
    points: Sequence[Point],
    seed: int = 0,
    threads: int | None = None,
    progress: Callable[[float, float], None] | None = None,
) -> dict[Point, Blocks]:
    """Simulate points; every point uses the same random numbers, so that lines come out smooth."""
    wanted = list(dict.fromkeys(points))

    def job(point: Point) -> Callable[[], Blocks]:
        return lambda: _simulate_one(point, seed)

    return dict(zip(wanted, run_many([job(p) for p in wanted], threads, progress), strict=True))


def _setup(point: Point) -> Setup:
    detector = BENCH.detector.model_copy(
        update={"acceptance_deg": point.acceptance_deg or BENCH.detector.acceptance_deg}
    )
    gap = BENCH.background.model_copy(update={"gap_mm": BENCH.background.gap_mm / point.wider})
    bench = BENCH.model_copy(update={"detector": detector, "background": gap})
    if point.lit == "panels":
        return panels_setup(bench, point.thickness_mm / point.wider)
    setup = beam_setup(bench)
    return setup if point.acceptance_deg is not None else replace(setup, up="hemisphere")


def _simulate_one(point: Point, seed: int) -> Blocks:
    # scale invariance (bench.md): a slab made thinner stands for a bench made wider
    sigma_t = point.sigma_t_per_mm * point.wider
    medium = OpticalProperties(
        _NOMINAL_NM, np.zeros(1), np.array([sigma_t]), np.array([point.g]), None
    )
    sample = Sample(name="slab", thickness_mm=point.thickness_mm / point.wider, n=point.n)
    stack = flat_stacks(BENCH, sample, _NOMINAL_NM, medium)[0]
    panels = point.lit == "panels"
    tallies = trace(
        stack,
        _setup(point),
        Effort(BLOCKS, point.log2_paths, derivatives=True),
        seed=seed,
        stream=PANELS_STREAM if panels else BEAM_STREAM,
    )
    albedo = np.array(point.albedo)
    order = tallies.order
    powers = albedo[:, None] ** order
    slopes = order * albedo[:, None] ** np.maximum(order - 1.0, 0.0)

    def quantities(table: FloatArray, weights: FloatArray) -> FloatArray:
        if not panels:
            summed = np.einsum("nbk,ak->na", table[:, 0], weights, optimize=True)
            return np.asarray(summed[:, None])
        series = np.einsum("ncbk,ak->ncab", table[:, :2], weights, optimize=True)
        black = series[:, 0] @ RHO_BLACK**tallies.bounce
        # without a bounce both channels hold the same numbers: leave them out of the difference
        bounced = tallies.bounce > 0
        difference = (
            series[:, 1][..., bounced] @ RHO_WHITE ** tallies.bounce[bounced]
            - series[:, 0][..., bounced] @ RHO_BLACK ** tallies.bounce[bounced]
        )
        return np.stack([black, difference], axis=1)

    if tallies.d_sigma is None or tallies.d_g is None:
        raise ValueError("found no derivatives; expected them from the engine")
    return Blocks(
        quantities(tallies.value, powers),
        quantities(tallies.value, slopes),
        quantities(tallies.d_sigma, powers) * point.wider,
        quantities(tallies.d_g, powers),
    )
