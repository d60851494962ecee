"""What the bench's panels and its white reference are for a plane-parallel stack, in numpy."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from twin.adding_doubling.streams import condensed
from twin.bench import Bench, Panel, Sample
from twin.spectra import FloatArray
from twin.transport.geometry import (
    height_of_stack,
    panel_shape,
    reference_factor,
    reference_plane_mm,
    relative_radiance,
)

PANEL_NODES = 8
NODES_PER_SIDE = 32


class PanelLight(NamedTuple):
    """Irradiance of the panels on z = 0 by the cosine in air, P nodes.

    Attributes:
        cosine: (P,); share: of the irradiance, (P,), sum 1.
        lowest, highest: extreme cosines at which a panel is seen.
    """

    cosine: FloatArray
    share: FloatArray
    lowest: float
    highest: float


def panel_light(bench: Bench) -> PanelLight:
    """Directions from which the panels light the origin.

    The detector looks along the normal, so only the mean over azimuth matters, and with it the
    distribution of the irradiance over the cosine: a Gauss rule of 8 nodes for it is exact for
    radiance factors that are polynomials of degree 15 in the cosine.
    """
    return _light_of(bench.panels)


@lru_cache(maxsize=64)
def _light_of(panels: tuple[Panel, ...]) -> PanelLight:
    """Many models of one bench share its panels, and are made often."""
    nodes, weights = np.polynomial.legendre.leggauss(NODES_PER_SIDE)
    cosine, light = [], []
    for panel in map(panel_shape, panels):
        a, b = np.meshgrid(nodes * panel.half[0], nodes * panel.half[1], indexing="ij")
        points = (
            np.array(panel.centre)
            + a[..., None] * np.array(panel.u)
            + b[..., None] * np.array(panel.v)
        )
        distance = np.linalg.norm(points, axis=-1)
        mu = np.maximum(points[..., 2], 0.0) / distance
        emission = np.maximum(0.0, -(points @ np.array(panel.normal))) / distance
        area = np.outer(weights, weights) * panel.half[0] * panel.half[1]
        area = area * relative_radiance(panel, a / panel.half[0])
        cosine.append(mu.ravel())
        light.append((area * mu * emission / distance**2).ravel())
    every, flux = np.concatenate(cosine), np.concatenate(light)
    lit = flux > 0.0
    rule = condensed(every[lit], flux[lit], PANEL_NODES)
    for own in rule:
        own.flags.writeable = False
    return PanelLight(*rule, float(every[lit].min()), float(every[lit].max()))


def plane_factors(bench: Bench, samples: tuple[Sample, ...]) -> FloatArray:
    """Irradiance on z = 0 over that on the white in its reference plane, shape (S, 3).

    Columns: logarithm at each sample's thickness, and its first two derivatives with respect
    to the thickness [1/mm, 1/mm^2], by central differences over 0.1 mm.
    """
    step = 0.1
    top = reference_factor(bench, 0.0)
    rows = []
    for sample in samples:
        height = height_of_stack(bench, sample)
        logs = [
            math.log(top / reference_factor(bench, reference_plane_mm(bench, height + shift)))
            for shift in (-step, 0.0, step)
        ]
        rows.append(
            (
                logs[1],
                (logs[2] - logs[0]) / (2.0 * step),
                (logs[2] - 2.0 * logs[1] + logs[0]) / step**2,
            )
        )
    return np.array(rows)
