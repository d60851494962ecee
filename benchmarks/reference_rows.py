"""What a row of the table of reference values asks for, as a scene and a score."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

DEEP = 60.0


@dataclass(frozen=True)
class Scene:
    """A slab in air and how light arrives.

    Attributes:
        n: refractive index; optical_thickness: sigma_t times thickness, may be infinite;
        g: anisotropy factor; start_cosine: cosine of incidence, None for diffuse light;
        rho: reflectance of a Lambertian face in contact below.
    """

    n: float
    optical_thickness: float
    g: float
    start_cosine: float | None
    rho: float


@dataclass(frozen=True)
class Score:
    """What is collected: hemisphere, direction (radiance factor), cone, or distant panels."""

    kind: str
    cosine: float = 1.0


@dataclass(frozen=True)
class Case:
    """One comparison: offset + slope * (our score) against value and its uncertainty."""

    name: str
    scene: Scene
    score: Score
    side: str
    albedo: float
    value: float
    uncertainty: float
    scattered_only: bool = False
    offset: float = 0.0
    slope: float = 1.0


def deep_slab(optical_thickness: float) -> float:
    """The optical thickness that is traced: `DEEP` in place of an infinite one."""
    return min(optical_thickness, DEEP)


def _start_cosine(incidence: str) -> float | None:
    """Cosine of incidence, or None for diffuse light."""
    if incidence.startswith("diffuse"):
        return None
    exact = re.search(r"mu0=([\d.]+)", incidence)
    if exact:
        return float(exact.group(1))
    angle = re.search(r"([\d.]+)deg", incidence)
    if angle is None:
        raise ValueError(f"found incidence {incidence!r}; expected an angle or 'diffuse'")
    return math.cos(math.radians(float(angle.group(1))))


def _score(quantity: str) -> tuple[Score, str, bool]:
    """Score, side and whether unscattered light is left out."""
    exit_cosine = re.search(r"at (?:exit cosine |exit )?mu=([\d.]+)", quantity)
    cone = re.search(r"half-angle ([\d.]+) deg", quantity)
    if cone:
        return Score("cone", math.cos(math.radians(float(cone.group(1))))), "down", False
    if quantity.startswith("radiance factor") and exit_cosine:
        side = "down" if "transmitted" in quantity else "up"
        return Score("direction", float(exit_cosine.group(1))), side, True
    without = "EXCLUDING" in quantity or (
        "diffuse transmittance" in quantity and "absorber" not in quantity
    )
    up = re.search(r"reflectance|reflected|plane albedo", quantity) is not None
    if not up and re.search(r"transmittance|transmitted", quantity) is None:
        raise ValueError(f"found quantity {quantity!r}; expected a reflectance or transmittance")
    return Score("hemisphere"), "up" if up else "down", without


def _h_function(row: dict[str, str], scene_values: tuple[float, float, float]) -> Case:
    """H(mu) from the plane albedo for incidence at mu."""
    n, thickness, g = scene_values
    albedo = float(row["albedo"])
    name = row["name"]
    # the names round cos(45 deg) to three decimals
    mu = float(name.rpartition("mu")[2])
    mu = math.sqrt(0.5) if mu == 0.707 else mu
    scale = 1.0 / math.sqrt(1.0 - albedo)
    return Case(
        name, Scene(n, thickness, g, mu, 0.0), Score("hemisphere"), "up", albedo,
        float(row["value"]), float(row["uncertainty"]), offset=scale, slope=-scale,
    )  # fmt: skip


def cases_of(rows: list[dict[str, str]]) -> tuple[list[Case], list[dict[str, str]]]:
    """Cases of all rows that a slab in air defines, and the others with a reason."""
    cases: list[Case] = []
    left_out: list[dict[str, str]] = []
    for row in rows:
        values = (float(row["n_medium"]), float(row["optical_thickness"]), float(row["g"]))
        if row["quantity"] == "H(mu)":
            cases.append(_h_function(row, values))
            continue
        score, side, scattered_only = _score(row["quantity"])
        if score.cosine == 0.0:
            reason = (
                "radiance along the surface: the limit mu -> 0 is approached as mu ln(mu), and "
                "the kernel's single precision ends at mu = 2.5e-4"
            )
            left_out.append({"row": row["name"], "reason": reason})
            continue
        start = _start_cosine(row["incidence"])
        exit_cosine = re.search(r"radiance.*/ incident radiance at mu=([\d.]+)", row["quantity"])
        if exit_cosine:
            # reciprocity: as much as a beam from that direction sends into the hemisphere
            start = float(exit_cosine.group(1))
        contact = re.search(r"rho=([\d.]+)", row["n_below"])
        scene = Scene(*values, start, float(contact.group(1)) if contact else 0.0)
        case = Case(
            row["name"], scene, score, side, float(row["albedo"]),
            float(row["value"]), float(row["uncertainty"]), scattered_only,
        )  # fmt: skip
        cases.append(case)
        if "45/0" in row["quantity"]:
            looked_at = Scene(*values, 1.0, scene.rho)
            cases.append(
                Case(
                    f"{row['name']} [panels]", looked_at, Score("panels"), "up", case.albedo,
                    case.value, case.uncertainty, scattered_only=True,
                )
            )  # fmt: skip
    return cases, left_out
