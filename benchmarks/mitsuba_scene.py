"""The bare-slab bench of bench.md as a Mitsuba 3 scene, and its radiance factor by `volpath`.

Mitsuba has no sensor that collects a small cone from a disc, so the rays are made here (the
disc uniformly, the cone uniformly in projected solid angle) and handed to the integrator.
"""

from __future__ import annotations

import math
import os
import re
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from twin.bench import Background, Bench
from twin.transport.geometry import panel_shape, reference_factor, reference_plane_mm

OLDEST_LLVM = 17
NO_ROULETTE = 100_000
ABOVE_MM = 1.0


@dataclass(frozen=True)
class SlabCase:
    """A bare slab over one background: thickness [mm], sigma_t [1/mm].

    With a second lobe the phase function is that of `twin.bench.Medium`: g stays its mean cosine.
    """

    n: float
    albedo: float
    sigma_t: float
    g: float
    thickness_mm: float
    background: str
    rho: float
    second_share: float = 0.0
    second_g: float = 0.0


@dataclass(frozen=True)
class Rendering:
    """Mean radiance factor of all rays so far, its standard error, and what it took."""

    value: float
    standard_error: float
    rays: int
    seconds: float


def _llvm_libraries() -> Iterator[tuple[int, str]]:
    """Installed LLVM libraries with their versions, oldest first."""
    found = set()
    for pattern in ("*/libLLVM*.so*", "llvm-*/lib/libLLVM*.so*", "libLLVM*.so*"):
        for root in ("/usr/lib", "/usr/local/lib", "/opt/homebrew/opt"):
            for path in Path(root).glob(pattern):
                version = re.search(r"libLLVM(?:-|\.so\.)(\d+)", path.name)
                if version:
                    found.add((int(version.group(1)), str(path)))
    yield from sorted(found)


def load(variants: tuple[str, ...] = ("llvm_ad_mono", "scalar_rgb")) -> tuple[Any, str]:
    """Mitsuba with the first of the variants that works here, and a sentence about it.

    Raises:
        ModuleNotFoundError: Mitsuba is not installed.
        RuntimeError: none of the variants works.
    """
    if "DRJIT_LIBLLVM_PATH" not in os.environ:
        recent = [path for version, path in _llvm_libraries() if version >= OLDEST_LLVM]
        if recent:
            os.environ["DRJIT_LIBLLVM_PATH"] = recent[-1]
    import mitsuba as mi

    failed = []
    for variant in variants:
        if variant not in mi.variants():
            failed.append(f"{variant} is not in this wheel")
            continue
        try:
            mi.set_variant(variant)
            mi.Float(1.0) + mi.Float(1.0)
        except (ImportError, RuntimeError) as error:
            failed.append(f"{variant}: {str(error).splitlines()[0]}")
            continue
        return mi, variant + (f" ({'; '.join(failed)})" if failed else "")
    raise RuntimeError(f"no variant of Mitsuba works here: {'; '.join(failed)}")


def _rectangle(mi: Any, transform: Any, **parts: Any) -> dict[str, Any]:
    return {"type": "rectangle", "to_world": transform, **parts}


def _phase(case: SlabCase) -> dict[str, Any]:
    share = case.second_share
    if share == 0.0:
        return {"type": "hg", "g": case.g}
    first = (case.g - share * case.second_g) / (1.0 - share)
    return {
        "type": "blendphase",
        "weight": share,
        "first": {"type": "hg", "g": first},
        "second": {"type": "hg", "g": case.second_g},
    }


def panels_of(mi: Any, bench: Bench) -> dict[str, Any]:
    """The panels as shapes that emit a radiance of 1."""
    t = mi.ScalarTransform4f
    found = {}
    for number, panel in enumerate(bench.panels):
        shape = panel_shape(panel)
        turn = t().look_at(origin=list(shape.centre), target=[0, 0, 0], up=[0, 1, 0])
        found[f"panel_{number}"] = _rectangle(
            mi,
            turn.scale([shape.half[0], shape.half[1], 1.0]),
            bsdf={"type": "diffuse", "reflectance": 0.0},
            emitter={"type": "area", "radiance": 1.0},
        )
    return found


def slab_of(mi: Any, bench: Bench, case: SlabCase) -> dict[str, Any]:
    """The slab as shapes, its top at z = 0.

    bench.md: what reaches a side face is lost; so the walls are black.

    Raises:
        ValueError: an unbounded stack.
    """
    t = mi.ScalarTransform4f
    medium = {
        "type": "homogeneous",
        "albedo": case.albedo,
        "sigma_t": case.sigma_t,
        # behind a smooth dielectric a direct connection never succeeds: leave it out there
        "sample_emitters": case.n == 1.0,
        "phase": _phase(case),
    }
    medium = mi.load_dict(medium)
    surface: dict[str, Any] = {"type": "null"}
    if case.n != 1.0:
        surface = {"type": "dielectric", "int_ior": case.n, "ext_ior": 1.0}
    black = {"type": "diffuse", "reflectance": 0.0}
    if bench.size_mm is None:
        raise ValueError("found an unbounded stack; expected a rectangle")
    hx, hy = bench.size_mm[0] / 2, bench.size_mm[1] / 2
    h = case.thickness_mm
    found: dict[str, Any] = {
        "top": _rectangle(mi, t().scale([hx, hy, 1.0]), bsdf=surface, interior=medium),
        "bottom": _rectangle(
            mi,
            t().translate([0, 0, -h]).rotate([1, 0, 0], 180).scale([hx, hy, 1.0]),
            bsdf=surface,
            interior=medium,
        ),
    }
    for number, (axis, half) in enumerate((([0, 1, 0], hx), ([1, 0, 0], hy))):
        for sign in (-1.0, 1.0):
            size = [h / 2, hy, 1.0] if number == 0 else [hx, h / 2, 1.0]
            turned = t().translate([0, 0, -h / 2]).rotate(axis, 90.0 * sign)
            found[f"wall_{number}_{int(sign)}"] = _rectangle(
                mi, turned.translate([0, 0, half]).scale(size), bsdf=black
            )
    return found


def scene_of(mi: Any, bench: Bench, case: SlabCase) -> Any:
    """The scene: panels, slab with absorbing side walls, background plane."""
    t = mi.ScalarTransform4f
    scene: dict[str, Any] = {"type": "scene"}
    scene |= slab_of(mi, bench, case) | panels_of(mi, bench)
    part: Background = getattr(bench.background, case.background)
    plane = -case.thickness_mm - bench.background.gap_mm
    extent = [part.size_mm[0] / 2, part.size_mm[1] / 2, 1.0]
    scene["background"] = {
        "type": "disk" if part.shape == "disc" else "rectangle",
        "to_world": t().translate([0, 0, plane]).scale(extent),
        "bsdf": {"type": "diffuse", "reflectance": case.rho},
    }
    return mi.load_dict(scene)


class Renderer:
    """Radiance factor of one case, one pass of rays after the other."""

    def __init__(self, mi: Any, bench: Bench, case: SlabCase) -> None:
        self.mi = mi
        self.scene = scene_of(mi, bench, case)
        self.integrator = mi.load_dict(
            {"type": "volpath", "max_depth": -1, "rr_depth": NO_ROULETTE}
        )
        self.radius = bench.detector.spot_panels_mm / 2
        self.sine = math.sin(math.radians(bench.detector.acceptance_deg))
        plane = reference_plane_mm(bench, case.thickness_mm)
        self.scale = math.pi / reference_factor(bench, plane)
        self.vectorised = mi.variant().startswith("llvm")

    def render(self, rays: int, seed: int) -> tuple[float, float, float]:
        """Sum and sum of squares of the radiance factors of `rays` rays, and the seconds."""
        started = time.perf_counter()
        sampler = self.mi.load_dict({"type": "independent", "sample_count": 1})
        if self.vectorised:
            sampler.seed(seed, rays)
            values = np.array(self._radiance(sampler), dtype=np.float64)
        else:
            sampler.seed(seed, 1)
            values = np.array([self._radiance(sampler) for _ in range(rays)], dtype=np.float64)
        values *= self.scale
        seconds = time.perf_counter() - started
        return float(values.sum()), float((values**2).sum()), seconds

    def _radiance(self, sampler: Any) -> Any:
        mi = self.mi
        spot, cone = sampler.next_2d(), sampler.next_2d()
        disc = mi.warp.square_to_uniform_disk(spot) * self.radius
        tilt = mi.warp.square_to_uniform_disk(cone) * self.sine
        up = (1.0 - tilt.x * tilt.x - tilt.y * tilt.y) ** 0.5
        # the disc lies on z = 0; the ray is only drawn back along itself
        origin = mi.Point3f(
            disc.x + tilt.x / up * ABOVE_MM, disc.y + tilt.y / up * ABOVE_MM, ABOVE_MM
        )
        ray = mi.RayDifferential3f(mi.Ray3f(origin, mi.Vector3f(-tilt.x, -tilt.y, -up)))
        return self.integrator.sample(self.scene, sampler, ray)[0][0]

    def until(self, relative_error: float, rays: int, most: int, seed: int) -> Rendering:
        """Passes of `rays` rays until the standard error is small enough or `most` are spent."""
        self.render(rays, seed)  # compiles; neither counted nor timed
        total = squares = seconds = 0.0
        count = 0
        while True:
            one, two, spent = self.render(rays, seed + 1 + count // rays)
            total, squares, seconds, count = (
                total + one,
                squares + two,
                seconds + spent,
                count + rays,
            )
            mean = total / count
            error = math.sqrt(max(0.0, squares / count - mean**2) / (count - 1))
            if count >= most or (count >= 4 * rays and error <= relative_error * mean):
                return Rendering(mean, error, count, seconds)
