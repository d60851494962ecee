"""Light that leaves the sample beside a port and is missing from the readings.

Adding-doubling knows no width. How much light misses the ports is found by a Monte Carlo of
the slab between its slides, filed by the number of scattering events (so one walk serves every
albedo), at nodes of optical thickness, anisotropy and refractive index that are computed when
they are first needed. Source of the idea: Prahl (2011), manual of inverse adding-doubling,
sec. 6, whose MC repeats the walk at every step of the fit instead.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.spectra import FloatArray

NODE_STEP = 0.3
"""Distance of the nodes in the logarithm of optical thickness."""
DEPTHS = (0.02, 400.0)
"""Optical thicknesses between which nodes lie; beyond, the nearest one is taken."""
G_NODES = np.array(
    [-0.9, -0.6, -0.3, 0.0, 0.25, 0.45, 0.6, 0.7, 0.78, 0.84, 0.88, 0.91, 0.935, 0.955, 0.97, 0.98]
)
"""Anisotropy factors of the nodes where g is not known beforehand."""
BLOCKS = 16
QUANTITIES = ("reflectance", "transmittance", "diffuse_reflectance", "diffuse_transmittance")


@dataclass(frozen=True)
class LossGeometry:
    """What decides how much light misses the ports (lengths [mm]).

    Attributes:
        thickness_mm: of the sample.
        slide_n, slide_thickness_mm: of both slides; 1 and 0: none.
        beam_mm: diameter of the beam.
        port_r_mm, port_t_mm: sample ports of the reflection and transmission side.
        incidence_deg: angle of the beam to the normal.
        diffuse: also find the losses of diffuse light, which only a sphere's gain needs.
    """

    thickness_mm: float
    slide_n: float
    slide_thickness_mm: float
    beam_mm: float
    port_r_mm: float
    port_t_mm: float
    incidence_deg: float = 0.0
    diffuse: bool = True

    def __post_init__(self) -> None:
        if not (self.port_r_mm > 0.0 and self.port_t_mm > 0.0 and self.thickness_mm > 0.0):
            raise InputError(
                f"ports of {self.port_r_mm:g} and {self.port_t_mm:g} mm, a thickness of"
                f" {self.thickness_mm:g} mm",
                "lengths above 0 mm",
                place="ports",
            )


@dataclass(frozen=True)
class LostLight:
    """Shares of lost light with slopes and standard errors (W problems).

    Attributes:
        share: (W, 4) in the order of `QUANTITIES`.
        slope: derivative by (albedo, sigma_t [mm], g), shape (W, 4, 3).
        standard_error: of the Monte Carlo, shape (W, 4).
    """

    share: FloatArray
    slope: FloatArray
    standard_error: FloatArray


@dataclass
class LossTable:
    """Lost light of one geometry, its nodes computed on demand.

    Attributes:
        log2_paths: walks per node, as a power of two; a quarter of them for diffuse light.
        seed: the same seed gives the same table, whatever the order of the questions.
        g_nodes: anisotropy factors between which it interpolates.
        n_nodes: refractive indices likewise.
    """

    geometry: LossGeometry
    g_nodes: FloatArray
    n_nodes: FloatArray
    log2_paths: int = 16
    seed: int = 0
    _nodes: dict[tuple[int, int, int], FloatArray] = field(default_factory=dict, repr=False)

    @classmethod
    def of(
        cls,
        geometry: LossGeometry,
        g: FloatArray | None,
        n: FloatArray,
        *,
        log2_paths: int = 16,
        seed: int = 0,
    ) -> LossTable:
        """A table for known anisotropy factors (or None) and refractive indices (W,)."""
        n = np.asarray(n, dtype=np.float64)
        ends = np.array([n.min(), n.max()])
        n_nodes = ends if ends[1] - ends[0] > 2e-3 else ends.mean(keepdims=True)
        if g is None:
            g_nodes = G_NODES
        else:
            ends = np.array([np.min(g), np.max(g)])
            g_nodes = ends[:1] if ends[1] == ends[0] else np.union1d(ends, G_NODES)
        return cls(geometry, g_nodes, n_nodes, log2_paths, seed)

    @property
    def walks(self) -> int:
        """Nodes computed so far."""
        return len(self._nodes)

    def at(self, parameters: FloatArray, n: FloatArray) -> LostLight:
        """Lost light of W materials (albedo, sigma_t [1/mm], g), (W, 3), of index n (W,)."""
        from twin.transport.engine import order_bins

        albedo, sigma_t_per_mm, g = np.moveaxis(np.asarray(parameters, dtype=np.float64), -1, 0)
        lowest, highest = np.log(DEPTHS)
        position = np.log(np.maximum(sigma_t_per_mm * self.geometry.thickness_mm, 1e-9))
        inside = (position > lowest) & (position < highest)
        position = np.clip(position, lowest, highest) / NODE_STEP
        cell = np.floor(position).astype(int)
        weight, weight_slope = _cubic(position - cell)
        g_cell, g_share, g_slope = _linear(self.g_nodes, g)
        n_cell, n_share, _ = _linear(self.n_nodes, n)
        self._fill(cell, g_cell, n_cell, n_share)
        order = order_bins()[1]
        albedo = np.clip(albedo, 1e-12, 1.0)
        power = albedo[:, None] ** order
        power_slope = order * power / albedo[:, None]
        count = albedo.size
        slope = np.zeros((count, 4, 3))
        blocks = np.zeros((count, BLOCKS, 4))
        per_sigma = np.where(inside, 1.0 / (NODE_STEP * np.maximum(sigma_t_per_mm, 1e-12)), 0.0)
        for i, dg, dn in np.ndindex(4, 2, 2):
            part_g = g_share if dg else 1.0 - g_share
            part_n = n_share if dn else 1.0 - n_share
            used = (part_n > 0.0) & ((part_g > 0.0) | (g_slope > 0.0))
            keys = np.stack([cell + i - 1, g_cell + dg, n_cell + dn], axis=1)
            for key in {(int(c), int(gc), int(nc)) for c, gc, nc in keys[used]}:
                rows = np.flatnonzero(used & (keys == key).all(axis=1))
                series = self._nodes[key]
                by_block = np.einsum("bqk,rk->rbq", series, power[rows], optimize=True)
                mean = by_block.mean(axis=1)
                by_albedo = power_slope[rows] @ series.mean(axis=0).T
                at_i, of_g, of_n = (v[rows, None] for v in (weight[:, i], part_g, part_n))
                blocks[rows] += (at_i * of_g * of_n)[:, None] * by_block
                slope[rows, :, 0] += at_i * of_g * of_n * by_albedo
                by_depth = (weight_slope[rows, i] * per_sigma[rows])[:, None]
                slope[rows, :, 1] += by_depth * of_g * of_n * mean
                slope[rows, :, 2] += at_i * (2 * dg - 1) * g_slope[rows, None] * of_n * mean
        share = blocks.mean(axis=1)
        error = blocks.std(axis=1, ddof=1) / np.sqrt(BLOCKS)
        return LostLight(share, slope, error)

    def _fill(
        self,
        cell: NDArray[np.int_],
        g_cell: NDArray[np.int_],
        n_cell: NDArray[np.int_],
        n_share: FloatArray,
    ) -> None:
        """Compute the nodes around every problem that are not there yet."""
        several = len(self.g_nodes) > 1
        wanted = {
            (int(c) + i, int(gc) + dg, int(nc) + dn)
            for c, gc, nc, ns in zip(cell, g_cell, n_cell, n_share, strict=True)
            for i in range(-1, 3)
            for dg in range(2 if several else 1)
            for dn in range(2 if ns > 0.0 else 1)
        }
        missing = sorted(key for key in wanted if key not in self._nodes)
        if not missing:
            return
        _prepare()
        from twin.transport.engine import default_threads

        with ThreadPoolExecutor(max_workers=default_threads()) as pool:
            for key, series in zip(missing, pool.map(self._walk, missing), strict=True):
                self._nodes[key] = series

    def _walk(self, key: tuple[int, int, int]) -> FloatArray:
        """Series of one node, shape (blocks, 4, order bins)."""
        depth = float(np.clip(np.exp(key[0] * NODE_STEP), *DEPTHS))
        g, n = float(self.g_nodes[key[1]]), float(self.n_nodes[key[2]])
        stream = (key[0] + 4096) + 16384 * (key[1] + 64 * key[2])
        beam = walk_losses(
            self.geometry, depth, g, n, diffuse=False,
            paths=2**self.log2_paths, seed=self.seed, stream=2 * stream,
        )  # fmt: skip
        if not self.geometry.diffuse:
            return np.concatenate([beam[:, :2], np.zeros_like(beam[:, :2])], axis=1)
        diffuse = walk_losses(
            self.geometry, depth, g, n, diffuse=True,
            paths=2 ** max(self.log2_paths - 2, 4), seed=self.seed, stream=2 * stream + 1,
        )  # fmt: skip
        return np.concatenate([beam[:, :2], diffuse[:, :2]], axis=1)


def _prepare() -> None:
    """Compile the kernel before threads fan out."""
    from twin.transport.engine import default_device

    device = default_device()
    import warp as wp

    from twin.spheres import lost_kernels

    wp.load_module(lost_kernels, device=device)


def walk_losses(
    geometry: LossGeometry,
    optical_thickness: float,
    g: float,
    n: float,
    *,
    diffuse: bool,
    paths: int,
    seed: int = 0,
    stream: int = 0,
) -> FloatArray:
    """Walk through one slab of albedo 1.

    Returns:
        Shares per path by block, quantity and order bin of `twin.transport.engine.order_bins`,
        shape (blocks, 4, bins). Quantities: lost above, lost below, all above, all below. The
        share at an albedo is the sum over the bins with weights albedo**order.
    """
    from twin.transport.engine import MAX_ORDER, default_device, order_bins

    device = default_device()
    import warp as wp

    from twin.spheres import lost_kernels as kernels

    slab = kernels.Slab()
    slab.n, slab.thickness, slab.g = n, geometry.thickness_mm, g
    slab.sigma_t = optical_thickness / geometry.thickness_mm
    has_slide = geometry.slide_thickness_mm > 0.0 and geometry.slide_n > 1.0
    slab.slide_n = geometry.slide_n if has_slide else 1.0
    slab.slide_thickness = geometry.slide_thickness_mm if has_slide else 0.0
    angle = np.radians(geometry.incidence_deg)
    slab.sine, slab.cosine = float(np.sin(angle)), float(np.cos(angle))
    slab.diffuse = int(diffuse)
    slab.port_above, slab.port_below = geometry.port_r_mm / 2, geometry.port_t_mm / 2
    slab.beam_radius = (geometry.port_r_mm if diffuse else geometry.beam_mm) / 2
    bins, order = order_bins()
    each = max(paths // BLOCKS, 1)
    tally = wp.zeros((BLOCKS, 4, len(order)), dtype=wp.float64, device=device)
    wp.launch(
        kernels.lost_kernel,
        dim=BLOCKS,
        inputs=[
            slab, wp.uint64(seed), stream, each, MAX_ORDER,
            wp.array(bins, dtype=wp.int32, device=device), tally,
        ],
        device=device,
    )  # fmt: skip
    return np.asarray(tally.numpy() / each)


def _cubic(x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Weights of four even nodes at 0 <= x < 1 past the second (Keys 1981, eq. (4)) and slopes."""
    weights = np.stack(
        [
            -0.5 * x + x**2 - 0.5 * x**3,
            1.0 - 2.5 * x**2 + 1.5 * x**3,
            0.5 * x + 2.0 * x**2 - 1.5 * x**3,
            -0.5 * x**2 + 0.5 * x**3,
        ],
        axis=-1,
    )
    slopes = np.stack(
        [
            -0.5 + 2.0 * x - 1.5 * x**2,
            -5.0 * x + 4.5 * x**2,
            0.5 + 4.0 * x - 4.5 * x**2,
            -x + 1.5 * x**2,
        ],
        axis=-1,
    )
    return weights, slopes


def _linear(nodes: FloatArray, at: FloatArray) -> tuple[NDArray[np.int_], FloatArray, FloatArray]:
    """Cell, share of the upper node and slope of that share; the nearest node outside."""
    at = np.asarray(at, dtype=np.float64)
    if len(nodes) == 1:
        zero = np.zeros(at.shape)
        return np.zeros(at.shape, dtype=int), zero, zero
    cell = np.clip(np.searchsorted(nodes, at, side="right") - 1, 0, len(nodes) - 2).astype(int)
    width = nodes[cell + 1] - nodes[cell]
    share = np.clip((at - nodes[cell]) / width, 0.0, 1.0)
    return cell, share, np.where((share > 0.0) & (share < 1.0), 1.0 / width, 0.0)
