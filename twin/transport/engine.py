"""Launching the Monte Carlo: blocks over threads, histograms into estimates with errors."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from concurrent.futures import CancelledError, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np

from twin.spectra import FloatArray
from twin.transport.importance import importance_of
from twin.transport.tables import FlatStack, transfer_table

MAX_ORDER = 20_000
TWO_WAYS_G = 0.4
CAPACITY = 2
BLACK, WHITE, SIDE, COLLISION = range(4)
UNBOUNDED_STACK = 2
UP, DOWN = 0, 1

TARGETS = {"none": 0, "panels": 1, "cone": 2, "hemisphere": 3, "direction": 4}


@dataclass(frozen=True)
class PanelShape:
    """A panel as the kernel sees it: centre, two unit axes, normal, half extents [mm].

    Its radiance, relative, is level * (1 + gradient * place along u / half extent).
    """

    centre: tuple[float, float, float]
    u: tuple[float, float, float]
    v: tuple[float, float, float]
    normal: tuple[float, float, float]
    half: tuple[float, float]
    level: float = 1.0
    gradient: float = 0.0


@dataclass(frozen=True)
class Outline:
    """Outline of a background: ellipse or rectangle with half extents [mm] around the axis."""

    disc: bool
    half_x: float
    half_y: float


@dataclass(frozen=True)
class Setup:
    """Everything around the stack for one kind of capture (lengths [mm], angles [rad]).

    Attributes:
        from_below: light (or importance) starts below the stack.
        polar: angle of the starting axis to the normal; cone: half-angle around that axis;
        radius: of the starting disc.
        up, down: targets above and below, keys of `TARGETS`.
        target_cosine: cosine of the cone's half-angle, or of the target direction.
        exit_radius: disc on the face through which light must leave to count.
        panels: lit rectangles; panel_scale: factor that turns radiance into the reported
        quantity (pi / reference factor).
        half_size: half the lateral extent of the stack along x and y.
        offset: where the middle of the stack lies along x and y [mm].
        gap: air between stack and background; black, white: outlines, or None.
        black_gloss, white_gloss: share of each background's reflectance that is mirror-like.
    """

    from_below: bool = False
    polar: float = 0.0
    cone: float = 0.0
    radius: float = 0.0
    up: str = "none"
    down: str = "none"
    target_cosine: float = 1.0
    exit_radius: float = 1.0e18
    panels: tuple[PanelShape, ...] = ()
    panel_scale: float = 1.0
    half_size: tuple[float, float] = (1.0e18, 1.0e18)
    offset: tuple[float, float] = (0.0, 0.0)
    gap: float = 0.0
    black: Outline | None = None
    white: Outline | None = None
    black_gloss: float = 0.0
    white_gloss: float = 0.0


@dataclass(frozen=True)
class Effort:
    """How much to trace.

    Attributes:
        blocks: independent blocks; their spread gives the standard error.
        log2_paths: paths per block, as a power of two.
        roulette_albedo, roulette_scale, roulette_free: Russian roulette beyond `roulette_free`
            scattering events with survival albedo * (k - 1 + scale) / (k + scale).
        lattice: sorted paths and low-discrepancy points (off: plain Monte Carlo).
        common: random numbers fixed by path and event, whatever the other paths do: two traces
            that differ a little then have most of their noise in common (needs lattice off).
        derivatives: also estimate d/d sigma_t and d/d g.
        balance: also count collisions and losses at the sides.
        paired: also tell, by the same paths, what the unbounded stack of the plane-parallel
            engine would give (channel `UNBOUNDED_STACK`): panels or cone above, no derivatives.
        first_scatter: share of paths that are made to scatter on their first flight, at least.
        split_albedo: 0 for no splitting; else an albedo of the sample for which paths are split
            and thinned so that as many as possible get through the stack, to the side where
            light does not start. The estimates serve every albedo all the same; they are best
            near this one. Roulette as above is then superfluous.
    """

    blocks: int = 32
    log2_paths: int = 10
    roulette_albedo: float = 1.0
    roulette_scale: float = 64.0
    roulette_free: int = 16
    lattice: bool = True
    common: bool = False
    derivatives: bool = False
    balance: bool = False
    paired: bool = False
    first_scatter: float = 0.5
    split_albedo: float = 0.0


@lru_cache(maxsize=1)
def order_bins() -> tuple[np.ndarray, FloatArray]:
    """Bin of every scattering order (0..MAX_ORDER) and each bin's mean order.

    Orders below 64 have a bin each; above, bins are 3 % wide, so that albedo**order at a bin's
    mean is wrong by less than 4e-5 of itself where it matters.
    """
    order = np.arange(MAX_ORDER + 1)
    wide = 64 + np.floor(np.log(np.maximum(order, 64) / 64.0) / np.log(1.03)).astype(int)
    index = np.where(order < 64, order, wide)
    _, index = np.unique(index, return_inverse=True)
    mean = np.bincount(index, weights=order) / np.bincount(index)
    return index.astype(np.int32), mean


@lru_cache(maxsize=1)
def bounce_bins() -> tuple[np.ndarray, FloatArray]:
    """Bin of every number of background bounces (0..64) and each bin's mean number."""
    bounce = np.arange(65)
    index = np.concatenate([np.arange(12), 12 + np.log2(np.arange(12, 65) / 12.0) // 0.25])
    _, index = np.unique(index, return_inverse=True)
    mean = np.bincount(index, weights=bounce) / np.bincount(index)
    return index.astype(np.int32), mean


@dataclass(frozen=True)
class Tallies:
    """Block means of one launch.

    Attributes:
        value: [block, channel, bounce bin, order bin], float64, per path.
        d_sigma, d_g: the same for derivatives, or None.
        order, bounce: mean order and mean number of bounces of the bins.
    """

    value: FloatArray
    d_sigma: FloatArray | None
    d_g: FloatArray | None
    order: FloatArray = field(default_factory=lambda: order_bins()[1])
    bounce: FloatArray = field(default_factory=lambda: bounce_bins()[1])

    def blocks_by_albedo(
        self, channel: int, albedo: FloatArray, values: FloatArray | None = None
    ) -> FloatArray:
        """Block means at given albedos: shape (blocks, A, bounce bins)."""
        table = self.value if values is None else values
        orders = table[:, channel]
        # most bins of high order are empty: they need not be multiplied
        used = int(np.max(np.nonzero(orders.any(axis=(0, 1)))[0], initial=0)) + 1
        powers = np.asarray(albedo, dtype=np.float64)[None, :] ** self.order[:used, None]
        by_bounce: FloatArray = orders[..., :used] @ powers
        return np.moveaxis(by_bounce, 1, 2)

    def estimate(
        self, channel: int, albedo: FloatArray, rho: float = 1.0
    ) -> tuple[FloatArray, FloatArray]:
        """Mean and standard error at given albedos and one reflectance, shape (A,) each."""
        series = self.blocks_by_albedo(channel, np.atleast_1d(albedo))
        return mean_and_error(series @ rho**self.bounce)


def mean_and_error(blocks: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean over the first axis and its standard error from the spread of the blocks.

    Args:
        blocks: shape (N, ...), N independent estimates.

    Returns:
        (mean, standard error), shape (...) each.
    """
    count = blocks.shape[0]
    return blocks.mean(axis=0), blocks.std(axis=0, ddof=1) / np.sqrt(count)


_MODULES: dict[str, Any] = {}
_WORKER = threading.local()
PATHS_OF_A_LAUNCH = 1 << 17
"""A long trace is cut into launches of about so many paths, whole blocks each: same bytes."""


def _warp() -> Any:
    """Warp, started quietly, with the kernels of this package loaded once."""
    if not _MODULES:
        import warp as wp

        wp.config.log_level = wp.LOG_WARNING
        wp.init()
        from twin.transport import connect_kernels, population_kernels, walk_kernels

        _MODULES.update(
            wp=wp, connect=connect_kernels, population=population_kernels, walk=walk_kernels
        )
    return _MODULES["wp"]


def default_device() -> str:
    """Name of the first GPU when Warp finds one, else "cpu"."""
    wp = _warp()
    return "cuda:0" if wp.is_cuda_available() else "cpu"


def default_threads() -> int:
    """Number of processors this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def compile_kernels(device: str | None = None) -> None:
    """Compile (or load from Warp's cache) before threads fan out."""
    wp = _warp()
    wp.load_module(_MODULES["walk"], device=device or default_device())


def trace(
    stack: FlatStack,
    setup: Setup,
    effort: Effort,
    *,
    seed: int = 0,
    stream: int = 0,
    device: str | None = None,
    first_block: int = 0,
) -> Tallies:
    """Trace `effort.blocks` blocks of one stack in one set-up.

    The result depends on nothing but the arguments: blocks may be split over calls
    (`first_block`), threads, processes and machines, and are the same to the bit on one kind
    of processor.

    Raises:
        ValueError: derivatives are asked for with a second scattering layer; an albedo for
            splitting is outside 0 to 1, or no layer scatters; options that exclude each other.
    """
    _warp()
    device = device or default_device()
    if effort.derivatives and np.count_nonzero(stack.sigma_t) > int(stack.counted >= 0):
        raise ValueError("derivatives need a stack whose only scattering layer is the sample")
    if not 0.0 <= effort.split_albedo <= 1.0:
        raise ValueError(f"split_albedo is {effort.split_albedo}; expected 0 to 1")
    if effort.paired and (effort.balance or effort.derivatives or setup.down != "none"):
        raise ValueError("a paired trace tells panels or a cone above, without balance or slopes")
    glossy = setup.black_gloss > 0.0 or setup.white_gloss > 0.0
    if glossy and (effort.paired or setup.up == "direction"):
        raise ValueError("a glossy background is neither paired nor seen from one direction")
    if effort.common and (effort.lattice or effort.split_albedo > 0.0):
        raise ValueError("common random numbers need paths that are neither sorted nor split")
    piece = effort.blocks
    if device == "cpu":
        piece = max(1, PATHS_OF_A_LAUNCH >> effort.log2_paths)
    parts = []
    for first in range(0, effort.blocks, piece):
        stop: threading.Event | None = getattr(_WORKER, "stop", None)
        if stop is not None and stop.is_set():
            raise CancelledError("the run was interrupted")
        own = replace(effort, blocks=min(piece, effort.blocks - first))
        parts.append(_launch(stack, setup, own, seed, stream, device, first_block + first))
    return parts[0] if len(parts) == 1 else _joined(parts)


def _joined(parts: list[Tallies]) -> Tallies:
    """The blocks of several launches, one after the other."""

    def rows(name: str) -> FloatArray | None:
        if getattr(parts[0], name) is None:
            return None
        return np.concatenate([getattr(part, name) for part in parts])

    return Tallies(np.concatenate([part.value for part in parts]), rows("d_sigma"), rows("d_g"))


def _launch(
    stack: FlatStack,
    setup: Setup,
    effort: Effort,
    seed: int,
    stream: int,
    device: str,
    first_block: int,
) -> Tallies:
    """One launch of the kernel: the blocks of `effort`, from `first_block` on."""
    wp = _warp()
    connect, population = _MODULES["connect"], _MODULES["population"]
    nothing = np.zeros(len(stack.n))
    second_share = nothing if stack.second_share is None else stack.second_share
    second_g = nothing if stack.second_g is None else stack.second_g
    problem = connect.Problem()
    problem.start_from_below = int(setup.from_below)
    problem.start_sine = np.sin(setup.polar)
    problem.start_cosine = np.cos(setup.polar)
    problem.start_cone_sine = np.sin(setup.cone)
    problem.start_radius = setup.radius
    problem.target_up = TARGETS[setup.up]
    problem.target_down = TARGETS[setup.down]
    problem.target_cosine = setup.target_cosine
    problem.exit_radius = setup.exit_radius
    problem.n_panels = len(setup.panels)
    problem.panel_scale = setup.panel_scale
    problem.n_layers = len(stack.n)
    problem.counted_layer = stack.counted
    problem.half_x, problem.half_y = setup.half_size
    problem.offset_x, problem.offset_y = setup.offset
    problem.has_background = int(setup.black is not None or setup.white is not None)
    problem.gap = setup.gap
    for name, outline in (("black", setup.black), ("white", setup.white)):
        edge = outline or Outline(False, -1.0, -1.0)
        setattr(problem, f"{name}_disc", int(edge.disc))
        setattr(problem, f"{name}_half_x", edge.half_x)
        setattr(problem, f"{name}_half_y", edge.half_y)
    problem.black_gloss, problem.white_gloss = setup.black_gloss, setup.white_gloss
    problem.gloss = max(setup.black_gloss, setup.white_gloss)
    problem.roulette_free = effort.roulette_free
    problem.roulette_albedo = effort.roulette_albedo
    problem.roulette_scale = effort.roulette_scale
    # next to a nearly isotropic phase function, aiming alone is as good and cheaper
    lobes = np.abs(np.concatenate([stack.first_g, second_g]))
    problem.two_ways = int(np.max(lobes) > TWO_WAYS_G)
    problem.first_scatter = effort.first_scatter
    problem.lattice, problem.common = int(effort.lattice), int(effort.common)
    problem.max_order = MAX_ORDER
    problem.paired = int(effort.paired)

    def array(values: Any, dtype: Any = float) -> Any:
        return wp.array(values, dtype=dtype, device=device)

    layers = connect.Stack()
    bottom = -np.cumsum(stack.thickness)
    layers.n, layers.sigma_t, layers.g = array(stack.n), array(stack.sigma_t), array(stack.first_g)
    layers.two_term = int(np.any(second_share))
    layers.second_share, layers.second_g = array(second_share), array(second_g)
    layers.albedo = array(stack.albedo)
    layers.top, layers.bottom = array(bottom + stack.thickness), array(bottom)
    layers.table = array(transfer_table(stack, setup.from_below).astype(np.float32))
    shapes = setup.panels or (PanelShape((0, 0, 1), (1, 0, 0), (0, 1, 0), (0, 0, -1), (0, 0)),)
    layers.panel_centre = array([s.centre for s in shapes], wp.vec3)
    layers.panel_u = array([s.u for s in shapes], wp.vec3)
    layers.panel_v = array([s.v for s in shapes], wp.vec3)
    layers.panel_normal = array([s.normal for s in shapes], wp.vec3)
    layers.panel_half = array([s.half for s in shapes], wp.vec2)
    layers.uneven = int(any(s.level != 1.0 or s.gradient != 0.0 for s in shapes))
    layers.panel_light = array([(s.level, s.gradient) for s in shapes], wp.vec2)

    order_bin, order = order_bins()
    bounce_bin, bounce = bounce_bins()
    channels = 4 if effort.balance else 3 if effort.paired else 2
    shape = (effort.blocks, channels, len(bounce), len(order))
    tally = connect.Tally()
    tally.value = wp.zeros(shape, dtype=wp.float64, device=device)
    extra = shape if effort.derivatives else (1, 1, 1, 1)
    tally.d_sigma = wp.zeros(extra, dtype=wp.float64, device=device)
    tally.d_g = wp.zeros(extra, dtype=wp.float64, device=device)
    tally.order_bin, tally.bounce_bin = array(order_bin, wp.int32), array(bounce_bin, wp.int32)
    tally.derivatives, tally.balance = int(effort.derivatives), int(effort.balance)
    paths = 2**effort.log2_paths
    splitting = population.Splitting()
    splitting.active = int(effort.split_albedo > 0.0)
    splitting.capacity = CAPACITY * paths
    size, places = (effort.blocks, paths), paths
    if splitting.active:
        size, places = (effort.blocks, CAPACITY * paths), 2 * CAPACITY * paths
        found = importance_of(stack, effort.split_albedo, setup.from_below)
        splitting.sign = 1.0 if setup.from_below else -1.0
        splitting.log_albedo = np.log(effort.split_albedo)
        splitting.lowest, splitting.highest = found.lowest, found.highest
        splitting.depth, splitting.lead = array(found.depth), array(found.lead)
        splitting.log_importance = array(found.log_importance)
    generation = population.Generation()
    generation.paths = wp.empty((effort.blocks, places), dtype=population.Path, device=device)
    generation.order = wp.empty(size, dtype=wp.int32, device=device)
    generation.spare = wp.empty(size, dtype=wp.int32, device=device)
    generation.key = wp.empty(size, dtype=wp.int32, device=device)
    generation.share = wp.empty(size if splitting.active else (1, 1), dtype=float, device=device)
    generation.count = wp.empty((effort.blocks, 1025), dtype=wp.int32, device=device)
    wp.launch(
        _MODULES["walk"].trace_kernel,
        dim=effort.blocks,
        inputs=[
            problem, layers, tally, generation, splitting, wp.uint64(seed), stream, first_block,
            paths,
        ],
        device=device,
    )  # fmt: skip
    return Tallies(
        tally.value.numpy() / paths,
        tally.d_sigma.numpy() / paths if effort.derivatives else None,
        tally.d_g.numpy() / paths if effort.derivatives else None,
    )


def run_many(
    jobs: list[Callable[[], Any]],
    threads: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[Any]:
    """Run independent jobs on a thread pool; results in the order of the jobs.

    Warp's launches on the CPU release the interpreter lock, so threads use all cores.

    Args:
        jobs: functions without arguments.
        threads: size of the pool; None takes all processors.
        progress: called with (done, total) after each job.
    """
    compile_kernels()
    total, done = len(jobs), 0
    stop = threading.Event()

    def know() -> None:
        _WORKER.stop = stop

    with ThreadPoolExecutor(threads or default_threads(), initializer=know) as pool:
        futures = [pool.submit(job) for job in jobs]
        try:
            results = []
            for future in futures:
                results.append(future.result())
                done += 1
                if progress is not None:
                    progress(done, total)
        except BaseException:
            # long traces look at this between their launches: an interrupt acts within a second
            stop.set()
            for future in futures:
                future.cancel()
            raise
    return results
