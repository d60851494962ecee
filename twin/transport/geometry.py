"""From the bench's description to what the kernels need, and the white reference in closed form."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np

from twin.bench import Background, Bench, Panel, Sample, stack_of
from twin.errors import InputError
from twin.spectra import FloatArray
from twin.transport.engine import Outline, PanelShape, Setup

UNBOUNDED = 1.0e18
QUADRATURE = 128
"""Nodes along every axis of the beam that the empty bench collects."""


def panel_shape(panel: Panel) -> PanelShape:
    """Centre, axes (u in the plane of incidence, v horizontal), normal and half extents."""
    polar, azimuth = math.radians(panel.polar_deg), math.radians(panel.azimuth_deg)
    centre = np.array(panel.centre_mm)
    u = (
        math.cos(polar) * math.cos(azimuth),
        math.cos(polar) * math.sin(azimuth),
        -math.sin(polar),
    )
    v = (-math.sin(azimuth), math.cos(azimuth), 0.0)
    normal = -centre / np.linalg.norm(centre)
    half = (panel.width_mm / 2, panel.length_mm / 2)
    return PanelShape(tuple(centre), u, v, tuple(normal), half, panel.level, panel.gradient)


def relative_radiance(panel: PanelShape, along: FloatArray) -> FloatArray:
    """Radiance of a panel's points in units of the bench, of the shape of `along`.

    Args:
        panel: the panel.
        along: place along its axis u, -1 to 1 from edge to edge.
    """
    return panel.level * (1.0 + panel.gradient * along)


@lru_cache(maxsize=1)
def _rule() -> tuple[FloatArray, FloatArray]:
    nodes, weights = np.polynomial.legendre.leggauss(32)
    return nodes, weights


def irradiance_factor(panels: tuple[PanelShape, ...], x: float, y: float, z: float) -> float:
    """Irradiance on a horizontal element per unit of panel radiance [sr], by quadrature.

    E / L = sum over panels of the integral of l cos(incidence) cos(emission) / r^2 dA with the
    relative radiance l of the panel's point (1 unless the bench says otherwise); 32 x 32
    Gauss-Legendre nodes leave an error below 1e-12 for panels above the horizon.
    """
    nodes, weights = _rule()
    total = 0.0
    for panel in panels:
        a, b = np.meshgrid(nodes * panel.half[0], nodes * panel.half[1], indexing="ij")
        area = np.outer(weights, weights) * panel.half[0] * panel.half[1]
        area = area * relative_radiance(panel, a / panel.half[0])
        points = (
            np.array(panel.centre)
            + a[..., None] * np.array(panel.u)
            + b[..., None] * np.array(panel.v)
        )
        to = points - np.array([x, y, z])
        distance = np.linalg.norm(to, axis=-1)
        incidence = np.maximum(0.0, to[..., 2]) / distance
        emission = np.maximum(0.0, -(to @ np.array(panel.normal))) / distance
        total += float(np.sum(area * incidence * emission / distance**2))
    return total


def reference_factor(bench: Bench, plane_mm: float) -> float:
    """Mean irradiance factor [sr] over the detector's footprint in the plane z = plane_mm.

    The footprint is the detector's disc blurred by its cone; a 7-point rule of degree 5 on the
    disc (Stroud 1971, S2 5-1) averages the nearly constant irradiance.
    """
    spread = math.tan(math.radians(bench.detector.acceptance_deg)) * abs(plane_mm)
    # second moments of disc and cone add; the rule is exact for them
    return _mean_factor(
        bench.panels, math.hypot(bench.detector.spot_panels_mm / 2, spread), plane_mm
    )


@lru_cache(maxsize=4096)
def _mean_factor(panels: tuple[Panel, ...], radius: float, plane_mm: float) -> float:
    """Kept, because benches that differ elsewhere alone are asked for again and again."""
    shapes = tuple(panel_shape(panel) for panel in panels)
    ring = radius * math.sqrt(2.0 / 3.0)
    points = [(0.0, 0.0, 0.25)] + [
        (ring * math.cos(k * math.pi / 3), ring * math.sin(k * math.pi / 3), 0.125)
        for k in range(6)
    ]
    return sum(w * irradiance_factor(shapes, x, y, plane_mm) for x, y, w in points)


def height_of_stack(bench: Bench, sample: Sample) -> float:
    """Thickness [mm] of covers and sample together."""
    return sum(layer.thickness_mm for layer in stack_of(bench, sample, None))


def reference_plane_mm(bench: Bench, stack_height_mm: float) -> float:
    """Z [mm] of the white in the white reference of a sample."""
    if bench.reference_plane_mm is not None:
        return bench.reference_plane_mm
    return -stack_height_mm - bench.background.gap_mm


def outline(background: Background) -> Outline:
    """Outline of a background as half extents."""
    return Outline(background.shape == "disc", background.size_mm[0] / 2, background.size_mm[1] / 2)


def four_fold(bench: Bench) -> bool:
    """Whether stack and backgrounds look the same after a quarter turn about the axis."""
    if bench.offset_mm != (0.0, 0.0):
        return False
    sizes = [bench.background.black.size_mm, bench.background.white.size_mm]
    if bench.size_mm is not None:
        sizes.append(bench.size_mm)
    return all(x == y for x, y in sizes)


def _quarter_turn(shape: PanelShape) -> PanelShape:
    def turned(v: tuple[float, float, float]) -> tuple[float, float, float]:
        return (-v[1], v[0], v[2])

    return replace(
        shape,
        centre=turned(shape.centre),
        u=turned(shape.u),
        v=turned(shape.v),
        normal=turned(shape.normal),
    )


def _half_size(bench: Bench) -> tuple[float, float]:
    if bench.size_mm is None:
        return UNBOUNDED, UNBOUNDED
    return bench.size_mm[0] / 2, bench.size_mm[1] / 2


def panels_setup(bench: Bench, stack_height_mm: float, turned: bool | None = None) -> Setup:
    """The captures `black` and `white`, traced from the detector to the panels.

    The reported quantity is the radiance factor against a perfect diffuser in the reference
    plane: pi times radiance over the reference's irradiance.

    Args:
        bench: the bench.
        stack_height_mm: [mm].
        turned: score the paths turned by 90 degrees too, which only a bench that is
            `four_fold` permits; None does so whenever it is.
    """
    scale = math.pi / reference_factor(bench, reference_plane_mm(bench, stack_height_mm))
    panels = tuple(panel_shape(panel) for panel in bench.panels)
    if four_fold(bench) if turned is None else turned:
        # a path turned by 90 degrees is as likely as the path: score it too, at no cost
        panels += tuple(_quarter_turn(shape) for shape in panels)
        scale /= 2.0
    return Setup(
        cone=math.radians(bench.detector.acceptance_deg),
        radius=bench.detector.spot_panels_mm / 2,
        up="panels",
        panels=panels,
        panel_scale=scale,
        half_size=_half_size(bench),
        offset=bench.offset_mm,
        gap=bench.background.gap_mm,
        black=outline(bench.background.black),
        white=outline(bench.background.white),
        black_gloss=bench.background.black.gloss,
        white_gloss=bench.background.white.gloss,
    )


def beam_setup(bench: Bench) -> Setup:
    """The capture `collimated`, traced from the beam to the detector's cone and disc.

    The reported quantity is the share of the beam's power that is collected, relative to the
    empty bench (whose beam lies inside spot and cone unless it is wider than they are).
    """
    return Setup(
        from_below=True,
        polar=math.radians(bench.beam.tilt_deg),
        cone=math.radians(bench.beam.divergence_deg),
        radius=bench.beam.diameter_mm / 2,
        up="cone",
        target_cosine=math.cos(math.radians(bench.detector.acceptance_deg)),
        exit_radius=bench.detector.spot_beam_mm / 2,
        half_size=_half_size(bench),
        offset=bench.offset_mm,
    )


def _accepted(bench: Bench) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Directions of the beam inside the detector's acceptance, by the midpoint rule.

    Returns:
        Q midpoints of 0 to 1; cosines from the axis on Q rings of Q accepted directions, (Q, Q);
        accepted shares of the rings, (Q,); sine of the outermost ring.
    """
    divergence, tilt = math.radians(bench.beam.divergence_deg), math.radians(bench.beam.tilt_deg)
    acceptance = math.radians(bench.detector.acceptance_deg)
    outermost = min(math.sin(divergence), math.sin(min(acceptance + abs(tilt), math.pi / 2)))
    grid: FloatArray = (np.arange(QUADRATURE) + 0.5) / QUADRATURE
    sine = outermost * np.sqrt(grid)[:, None]
    cosine = np.sqrt(1.0 - sine**2)
    # Of a ring of directions around the axis, those from `first` on rise steeply enough.
    leaning = math.sin(tilt) * sine
    room = math.cos(tilt) * cosine - math.cos(acceptance) + 1e-12
    first = np.arccos(np.clip(room / np.maximum(np.abs(leaning), 1e-300), -1.0, 1.0))
    azimuth = first + (math.pi - first) * grid
    up = math.cos(tilt) * cosine - np.abs(leaning) * np.cos(azimuth)
    return grid, up, 1.0 - first[:, 0] / math.pi, outermost


def accepted_cosine(bench: Bench) -> float:
    """Cosine from the axis, in air, that stands for the beam's directions that are accepted.

    That of their mean square sine: transmittances, smooth in it, are exact to its first order.

    Raises:
        InputError: none is accepted.
    """
    _, up, ring, _ = _accepted(bench)
    if not np.any(ring > 0.0):
        raise InputError(
            f"a beam at {bench.beam.tilt_deg:g} degrees",
            f"one inside the detector's acceptance of {bench.detector.acceptance_deg:g} degrees",
            place="beam",
        )
    return float(np.sqrt(1.0 - np.average((1.0 - up**2).mean(axis=1), weights=ring)))


def beam_reference_share(bench: Bench, stack_height_mm: float) -> float:
    """Share of the beam's power that the detector collects on the empty bench.

    A beam of half-angle d (even in solid angle of its projection) that leaves a disc of radius a
    at the bottom of the (absent) stack arrives at z = 0 on a disc blurred by d; directions beyond
    the acceptance are not collected. Midpoint quadrature over the radius and the directions that
    are accepted; what is accepted on a ring of directions, and what of a circle of starting points
    hits the spot, are closed forms, so that the share has no steps.
    """
    a, spot = bench.beam.diameter_mm / 2, bench.detector.spot_beam_mm / 2
    divergence, tilt = math.radians(bench.beam.divergence_deg), math.radians(bench.beam.tilt_deg)
    acceptance = math.radians(bench.detector.acceptance_deg)
    farthest = divergence + abs(tilt)
    if a + stack_height_mm * math.tan(farthest) <= spot and farthest <= acceptance:
        return 1.0
    grid, up, ring, outermost = _accepted(bench)
    shift = stack_height_mm * np.sqrt(1.0 - up**2) / up
    inside = _share_of_circles(a * np.sqrt(grid), shift[..., None], spot).mean(axis=(1, 2))
    collected = float(np.mean(ring * inside))
    return collected * (outermost / math.sin(divergence)) ** 2 if divergence else collected


def _share_of_circles(radius: FloatArray, shift: FloatArray, spot: float) -> FloatArray:
    """Share of a circle around the axis that lies in the spot once it is shifted sideways."""
    product = 2.0 * radius * shift
    room = spot**2 - radius**2 - shift**2
    share: FloatArray = 1.0 - np.arccos(np.clip(room / np.maximum(product, 1e-300), -1, 1)) / np.pi
    return share
