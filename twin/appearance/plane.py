"""The plane-parallel bench on a map's grid, by adding-doubling.

A map's Monte Carlo tells only by how much the finite bench differs from this one: both are
traced by the same paths (`Effort.paired`), so that nearly all noise cancels, and what is left of
it needs a hundredth of the paths. The plane-parallel part itself has no noise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from twin.bench import Bench, Sample
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from twin.adding_doubling import CapturesModel

ALBEDO_NODES = 22
FORWARD_G = 0.65
"""Anisotropy above which more streams are taken."""
NOMINAL_MM = 1.0


@dataclass(frozen=True)
class PlaneParts:
    """Parts of the plane-parallel captures at A albedos and S sigma_t, one g; (A, S) each.

    Attributes:
        direct: radiance factor without light from a background.
        once: what one bounce at a perfectly white background adds; each further one multiplies
            by `returned`.
        scattered: share of the beam scattered into the detector's cone.
        error: relative standard error of the quadrature, one number.
    """

    direct: FloatArray
    once: FloatArray
    returned: FloatArray
    scattered: FloatArray
    error: float

    def bounced(self, exponent: FloatArray, bounce: FloatArray) -> FloatArray:
        """Series over the reflectance of the background, (A, S, B).

        Args:
            exponent: mean number of bounces of each bin, (B,).
            bounce: bin of every number of bounces, shape (N,), from 0 on.
        """
        series = np.zeros((*self.direct.shape, len(exponent)))
        series[..., 0] = self.direct
        term = self.once
        for number in range(1, len(bounce)):
            series[..., bounce[number]] += term
            term = term * self.returned
        return series


def representable(bench: Bench) -> bool:
    """Whether a plane-parallel stack shows this bench but for its finite extent."""
    if bench.background.glossy:
        return False
    return not any(layer.medium is not None for layer in (*bench.covers_above, *bench.covers_below))


@lru_cache(maxsize=16)
def _model(described: str, n: float, forward: bool, points: int) -> CapturesModel:
    from twin.adding_doubling import captures_model, make_streams

    bench = Bench.model_validate_json(described)
    sample = Sample(name="plane", thickness_mm=NOMINAL_MM, n=n)
    if n == 1.0:
        streams = make_streams(30, 0) if forward else make_streams(18, 0)
    else:
        streams = make_streams(20, 16) if forward else make_streams(12, 8)
    return captures_model(bench, [sample], np.full(points, 550.0), streams=streams)


def quadrature_error(g: float) -> float:
    """Relative standard error of the parts for one g: measured against 40 + 40 streams."""
    size = abs(g)
    if size <= FORWARD_G:
        return 1e-4
    return 5e-5 if size <= 0.8 else float(np.interp(size, (0.8, 0.9, 0.95), (5e-5, 2e-4, 1e-3)))


def plane_parts(
    bench: Bench,
    thickness_mm: float,
    n: float,
    albedo: FloatArray,
    sigma_t_per_mm: FloatArray,
    g: float,
    *,
    fast: bool = False,
) -> PlaneParts:
    """Parts at a grid of albedo (A,) and sigma_t (S,) [1/mm], for one g.

    The parts are computed at Chebyshev nodes in sqrt(1 - albedo), in which diffuse light is
    smooth (the diffusion exponent is proportional to it), and interpolated to the albedos: as
    logarithms where they span decades; to 5e-5 of themselves.

    `fast` takes the default streams of `captures_model` whatever g: what estimators evaluate.
    """
    from twin.adding_doubling.panels import plane_factors

    nodes, to_albedo = _albedo_nodes(tuple(np.asarray(albedo).tolist()))
    count = len(sigma_t_per_mm)
    points = len(nodes) * count
    described = bench.model_copy(update={"reference_plane_mm": 0.0}).model_dump_json(
        exclude={"instrument", "panel_spectrum"}
    )
    model = _model(described, float(n), abs(g) > FORWARD_G and not fast, points)
    parts = model.parts(
        model.parameters(
            np.repeat(nodes, count),
            np.tile(sigma_t_per_mm, len(nodes)),
            g,
            thickness_mm=np.array([thickness_mm]),
        )
    )
    height = math.exp(
        plane_factors(bench, (Sample(name="plane", thickness_mm=thickness_mm, n=n),))[0, 0]
    )

    def at_nodes(values: object) -> FloatArray:
        return np.asarray(values, dtype=np.float64)[:, 0].reshape(len(nodes), count)

    def decades(values: FloatArray) -> FloatArray:
        return np.asarray(np.exp(to_albedo @ np.log(np.maximum(values, 1e-300))))

    share = np.asarray(albedo)[:, None]
    return PlaneParts(
        height * share * decades(at_nodes(parts.direct) / nodes[:, None]),
        height * decades(at_nodes(parts.once)),
        to_albedo @ at_nodes(parts.returned),
        share * decades(at_nodes(parts.scattered) / nodes[:, None]),
        quadrature_error(g),
    )


@lru_cache(maxsize=8)
def _albedo_nodes(albedo: tuple[float, ...]) -> tuple[FloatArray, FloatArray]:
    """Albedos (N,) of the nodes, and the matrix (A, N) that interpolates from them.

    Barycentric interpolation at Chebyshev points of the first kind (Berrut and Trefethen 2004).
    """
    angle = math.pi * (np.arange(ALBEDO_NODES) + 0.5) / ALBEDO_NODES
    root = 0.5 * (1.0 - np.cos(angle))
    weight = (-1.0) ** np.arange(ALBEDO_NODES) * np.sin(angle)
    away = np.sqrt(1.0 - np.array(albedo))[:, None] - root[None, :]
    hit = away == 0.0
    share = weight / np.where(hit, 1.0, away)
    share = np.where(hit.any(axis=1, keepdims=True), hit, share)
    return 1.0 - root**2, share / share.sum(axis=1, keepdims=True)
