"""Small stacks, set-ups and comparisons that the transport tests share."""

from __future__ import annotations

import math

import numpy as np

from twin.bench import Bench
from twin.spectra import FloatArray
from twin.transport import Effort, FlatStack, Outline, PanelShape, Setup
from twin.transport.geometry import irradiance_factor

ENDLESS = Outline(False, 1.0e17, 1.0e17)
BARE = Bench(covers_above=(), covers_below=())
CHEAP = Effort(blocks=64, log2_paths=8)


def slab(sigma_t: float, g: float = 0.0, n: float = 1.0, thickness_mm: float = 1.0) -> FlatStack:
    """One scattering layer whose albedo stays free."""
    one = np.ones(1)
    return FlatStack(thickness_mm * one, n * one, sigma_t * one, g * one, one, counted=0)


def covered(sigma_t: float, g: float = 0.0, n: float = 1.4) -> FlatStack:
    """The usual stack: the sample between two cover glasses."""
    return FlatStack(
        np.array([0.15, 1.0, 0.15]),
        np.array([1.52, n, 1.52]),
        np.array([0.0, sigma_t, 0.0]),
        np.array([0.0, g, 0.0]),
        np.zeros(3),
        counted=1,
    )


def far_panels(distance_mm: float = 1.0e6, half_mm: float = 5.0e3) -> Setup:
    """Panels at 45 degrees that look like points, seen from above along the normal."""
    s = math.sqrt(0.5)
    shapes = tuple(
        PanelShape(
            (sign * s * distance_mm, 0.0, s * distance_mm),
            (sign * s, 0.0, -s),
            (0.0, 1.0, 0.0),
            (-sign * s, 0.0, -s),
            (half_mm, half_mm),
        )
        for sign in (1.0, -1.0)
    )
    scale = math.pi / irradiance_factor(shapes, 0.0, 0.0, 0.0)
    return Setup(up="panels", panels=shapes, panel_scale=scale)


def z_score(blocks: FloatArray, expected: FloatArray | float = 0.0) -> FloatArray:
    """How many standard errors the mean over blocks is away from `expected`."""
    error = blocks.std(axis=0, ddof=1) / math.sqrt(len(blocks))
    return np.asarray((blocks.mean(axis=0) - expected) / error)


def z_between(a: FloatArray, b: FloatArray) -> FloatArray:
    """How many combined standard errors two independent sets of blocks are apart."""
    variance = a.var(axis=0, ddof=1) / len(a) + b.var(axis=0, ddof=1) / len(b)
    return np.asarray((a.mean(axis=0) - b.mean(axis=0)) / np.sqrt(variance))
