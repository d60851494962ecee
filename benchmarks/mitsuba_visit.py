"""The light of a visit to the bench, rendered by Mitsuba 3 on one thread, every render kept.

What is Mitsuba's: the radiance of the sample over both backgrounds, that of the reference white in
its plane, and the light that a slab scatters into the collimated detector. What is a closed form:
the unscattered part of the collimated capture (Bouguer, Beer, Fresnel), because a renderer that
draws free paths sees it as hits and misses.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.mitsuba_scene import NO_ROULETTE, Renderer, SlabCase, panels_of, scene_of, slab_of
from twin.bench import Bench
from twin.cache import cache_folder, content_key
from twin.files import write_atomically
from twin.transport.geometry import reference_plane_mm

if TYPE_CHECKING:
    from twin.transport import NoiselessCaptures

RAYS, MOST_RAYS = 2**13, 2**22
REFERENCE_RAYS = 2**19
IN_SCATTER_RAYS = {True: 2**13, False: 2**17}
"""With a direct connection to the detector (index matched), and without."""
WIDE_DEG, BLOCKED_DEG = 10.0, 0.05
"""In-scattered light is collected outside the second half-angle, which keeps the unscattered beam
away; and without a direct connection within the first, where its radiance is still even."""
FAR_MM = 1000.0
"""Distance of the collecting disc; far beyond the sample, so that places on it are directions."""
FOLDER = "mitsuba"


@dataclass(frozen=True)
class Truth:
    """What Mitsuba renders at one wavelength of one sample.

    Attributes:
        slab: the slab; its background and reflectance are set for each capture.
        rho: reflectances of black and white.
        reference_mm: of the reference white above the plane of the background.
    """

    slab: SlabCase
    rho: tuple[float, float]
    reference_mm: float = 0.0


@dataclass(frozen=True)
class Rendered:
    """Mean of all rays, its standard error, and the processor time it took once [s]."""

    value: float
    standard_error: float
    seconds: float


class Studio:
    """Renders what is asked for unless it was rendered before.

    Args:
        bench: panels, backgrounds, detector.
        relative_error: of the radiances over black and white.
        folder: of finished renders; None takes the user's cache.
    """

    def __init__(self, bench: Bench, relative_error: float, folder: Path | None = None) -> None:
        self.bench = bench
        self.relative_error = relative_error
        self.folder = folder or cache_folder(FOLDER)
        self.used: dict[str, float] = {}
        """Processor time [s] of every render that was used, by its key, whenever it was made."""

    def captures(self, truth: list[Truth], wavelength_nm: np.ndarray) -> NoiselessCaptures:
        """Noiseless captures of one sample, one `Truth` for each wavelength."""
        from twin.transport import NoiselessCaptures

        plane = reference_plane_mm(self.bench, truth[0].slab.thickness_mm)
        factor = self.reference(plane + truth[0].reference_mm).value
        panels = {}
        for number, name in enumerate(("black", "white")):
            found = [self.radiance(each.slab, name, each.rho[number]) for each in truth]
            panels[name] = np.array([[f.value, f.standard_error] for f in found])
            panels[name] *= math.pi / factor
        beam = [self.scattered_into_beam_detector(each.slab) for each in truth]
        collimated = np.array([unscattered(each.slab) for each in truth])
        return NoiselessCaptures(
            wavelength_nm=wavelength_nm,
            black=panels["black"][:, 0],
            white=panels["white"][:, 0],
            collimated=collimated + [f.value for f in beam],
            black_se=panels["black"][:, 1],
            white_se=panels["white"][:, 1],
            collimated_se=np.array([f.standard_error for f in beam]),
            rho_black=np.array([each.rho[0] for each in truth]),
            rho_white=np.array([each.rho[1] for each in truth]),
            white_reference_factor=factor,
        )

    def radiance(self, slab: SlabCase, background: str, rho: float) -> Rendered:
        """Radiance of the sample towards the detector, for panels of radiance 1."""
        case = SlabCase(**{**asdict(slab), "background": background, "rho": rho})
        asked = {
            "what": "radiance", "slab": asdict(case), "error": self.relative_error,
            "background": getattr(self.bench.background, background).model_dump(
                mode="json", exclude={"reflectance"}
            ),
            "gap": self.bench.background.gap_mm,
        }  # fmt: skip

        def scene(mi: Any) -> Any:
            return scene_of(mi, self.bench, case)

        return self._rendered(asked, scene, _from_detector, RAYS, self.relative_error)

    def reference(self, plane_mm: float) -> Rendered:
        """Irradiance [sr] per panel radiance of a white at z = plane_mm [mm], where it is seen."""

        def scene(mi: Any) -> Any:
            t = mi.ScalarTransform4f
            white = {
                "type": "rectangle",
                "to_world": t().translate([0, 0, plane_mm]).scale([20.0, 20.0, 1.0]),
                "bsdf": {"type": "diffuse", "reflectance": 1.0},
            }
            return mi.load_dict({"type": "scene", "white": white, **panels_of(mi, self.bench)})

        found = self._rendered(
            {"what": "reference", "plane": plane_mm}, scene, _from_detector, REFERENCE_RAYS, 1.0
        )
        return Rendered(math.pi * found.value, math.pi * found.standard_error, found.seconds)

    def scattered_into_beam_detector(self, slab: SlabCase) -> Rendered:
        """Share of the beam that is scattered into the detector's spot and cone.

        By reciprocity: rays start where the beam does, and the far disc shines. The spot is a
        square hole of the disc's area.
        """
        if slab.albedo == 0.0:
            return Rendered(0.0, 0.0, 0.0)
        matched = slab.n == 1.0
        own = self.bench.detector.acceptance_deg
        collected = own if matched else WIDE_DEG
        wide, blocked, cone = (
            math.sin(math.radians(angle)) ** 2 for angle in (collected, BLOCKED_DEG, own)
        )
        asked = {"what": "in-scattering", "slab": asdict(slab), "collected": collected}

        def scene(mi: Any) -> Any:
            return mi.load_dict(
                {
                    "type": "scene",
                    **slab_of(mi, self.bench, slab),
                    **_collector(mi, self.bench, collected),
                }
            )

        found = self._rendered(asked, scene, _from_beam, IN_SCATTER_RAYS[matched], 1.0)
        scale = cone / (wide - blocked)
        return Rendered(scale * found.value, scale * found.standard_error, found.seconds)

    def _rendered(
        self, asked: dict[str, Any], scene: Callable[[Any], Any], start: _Start, rays: int,
        error: float,
    ) -> Rendered:  # fmt: skip
        """A render from the cache, or made now: passes until the error is small enough."""
        bench = self.bench.model_dump(mode="json", include={"panels", "size_mm", "detector"})
        bench["beam"] = self.bench.beam.diameter_mm
        key = content_key({**asked, "bench": bench, "rays": rays, "version": 1})
        path = self.folder / f"{key}.json"
        if path.exists():
            kept = json.loads(path.read_text(encoding="utf-8"))
        else:
            kept = _passes(self.bench, scene, start, rays, error, int(key[:7], 16))
            self.folder.mkdir(parents=True, exist_ok=True)
            write_atomically(path, json.dumps(kept).encode())
        self.used[key] = kept["seconds"]
        return Rendered(kept["value"], kept["standard_error"], kept["seconds"])


_Start = Callable[[Any, Any, Bench], Any]
"""Mitsuba, a sampler and the bench to the rays that are traced."""


def unscattered(slab: SlabCase) -> float:
    """Share of the beam that crosses the slab unscattered, reflections inside it added up.

    Incoherent sum of Fresnel's reflections at normal incidence (Born and Wolf 1999, 7.6).
    """
    reflected = ((slab.n - 1.0) / (slab.n + 1.0)) ** 2
    left = math.exp(-slab.sigma_t * slab.thickness_mm)
    return (1.0 - reflected) ** 2 * left / (1.0 - (reflected * left) ** 2)


def _passes(
    bench: Bench, scene: Callable[[Any], Any], start: _Start, rays: int, error: float, seed: int
) -> dict[str, float]:
    mi = _mitsuba()
    began = time.process_time()
    renderer = _Rays(mi, bench, scene(mi), start)
    total = squares = 0.0
    count = 0
    while True:
        values = renderer.values(rays, seed + count // rays)
        total, squares = total + float(values.sum()), squares + float((values**2).sum())
        count += rays
        mean = total / count
        spread = math.sqrt(max(0.0, squares / count - mean**2) / (count - 1))
        if count >= MOST_RAYS or spread <= error * mean:
            break
    seconds = time.process_time() - began
    return {"value": mean, "standard_error": spread, "rays": count, "seconds": seconds}


_LOADED: list[Any] = []


def _mitsuba() -> Any:
    """Mitsuba, told once to use one thread: renders may run beside other work."""
    if not _LOADED:
        from benchmarks.mitsuba_scene import load

        mi, _ = load()
        import drjit

        drjit.set_thread_count(1)
        _LOADED.append(mi)
    return _LOADED[0]


class _Rays(Renderer):
    """Rays from anywhere through any scene."""

    def __init__(self, mi: Any, bench: Bench, scene: Any, start: _Start) -> None:
        self.mi, self.bench, self.scene, self.start = mi, bench, scene, start
        self.integrator = mi.load_dict(
            {"type": "volpath", "max_depth": -1, "rr_depth": NO_ROULETTE}
        )
        self.scale = 1.0
        self.vectorised = mi.variant().startswith("llvm")

    def values(self, rays: int, seed: int) -> np.ndarray:
        """Radiances of the rays, shape (rays,)."""
        sampler = self.mi.load_dict({"type": "independent", "sample_count": 1})
        if self.vectorised:
            sampler.seed(seed, rays)
            return np.array(self._radiance(sampler), dtype=np.float64)
        sampler.seed(seed, 1)
        return np.array([self._radiance(sampler) for _ in range(rays)], dtype=np.float64)

    def _radiance(self, sampler: Any) -> Any:
        ray = self.start(self.mi, sampler, self.bench)
        return self.integrator.sample(self.scene, sampler, ray)[0][0]


def _from_detector(mi: Any, sampler: Any, bench: Bench) -> Any:
    """Rays down from the detector: its disc uniformly, its cone uniformly in projected angle."""
    spot, cone = sampler.next_2d(), sampler.next_2d()
    disc = mi.warp.square_to_uniform_disk(spot) * (bench.detector.spot_panels_mm / 2)
    sine = math.sin(math.radians(bench.detector.acceptance_deg))
    tilt = mi.warp.square_to_uniform_disk(cone) * sine
    up = (1.0 - tilt.x * tilt.x - tilt.y * tilt.y) ** 0.5
    # the disc lies on z = 0; the ray is only drawn back along itself by 1 mm
    origin = mi.Point3f(disc.x + tilt.x / up, disc.y + tilt.y / up, 1.0)
    return mi.RayDifferential3f(mi.Ray3f(origin, mi.Vector3f(-tilt.x, -tilt.y, -up)))


def _from_beam(mi: Any, sampler: Any, bench: Bench) -> Any:
    """Rays up along the beam, from below every sample."""
    disc = mi.warp.square_to_uniform_disk(sampler.next_2d()) * (bench.beam.diameter_mm / 2)
    origin = mi.Point3f(disc.x, disc.y, -FAR_MM)
    return mi.RayDifferential3f(mi.Ray3f(origin, mi.Vector3f(0.0, 0.0, 1.0)))


def _collector(mi: Any, bench: Bench, collected_deg: float) -> dict[str, Any]:
    """A hole as large as the detector's spot, and a far disc that shines but in its middle."""
    t = mi.ScalarTransform4f
    black = {"type": "diffuse", "reflectance": 0.0}
    half = 0.5 * math.sqrt(math.pi) * (bench.detector.spot_beam_mm / 2)
    wide = 200.0
    found: dict[str, Any] = {}
    for number, (x, y, hx, hy) in enumerate(
        ((1, 0, wide, 2 * wide), (-1, 0, wide, 2 * wide), (0, 1, half, wide), (0, -1, half, wide))
    ):
        centre = [x * (half + hx), y * (half + hy), 1e-3]
        found[f"stop_{number}"] = {
            "type": "rectangle", "to_world": t().translate(centre).scale([hx, hy, 1.0]),
            "bsdf": black,
        }  # fmt: skip
    for name, angle, height in (
        ("far", collected_deg, FAR_MM),
        ("block", BLOCKED_DEG, FAR_MM - 1.0),
    ):
        radius = height * math.tan(math.radians(angle))
        turned = t().translate([0, 0, height]).rotate([1, 0, 0], 180)
        found[name] = {
            "type": "disk", "to_world": turned.scale([radius, radius, 1.0]), "bsdf": black,
        }  # fmt: skip
    found["far"]["emitter"] = {"type": "area", "radiance": 1.0}
    return found
