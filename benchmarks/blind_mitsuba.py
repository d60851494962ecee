"""Another program's data: visits whose light Mitsuba 3 renders, with one effect withheld.

Arm 4 of the blind check. A bare, index-matched slab in three thicknesses is rendered over both
backgrounds in worlds that have one effect which the description does not have, as large as three
of the catalogue's prior scales; instrument and its noise are ours. (A slab behind smooth faces
takes Mitsuba ten times as long: the index is wrong in the description instead.) Every visit is
diagnosed by `benchtwin diagnose`, told of nothing. Renders are kept: a run goes on where it was.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.mitsuba_scene import SlabCase
from benchmarks.mitsuba_visit import Studio, Truth
from twin.materials import optical_properties, reflectance, refractive_index
from twin.spectra import FloatArray
from twin.toml import validate

if TYPE_CHECKING:
    from scenarios.scenario import Scenario
    from twin.effects import World
    from twin.measurement import Measurement
    from twin.transport import NoiselessCaptures

THICKNESS_MM = (0.4, 0.8, 1.6)
N = 1.0
NODES_NM = [400.0, 500.0, 600.0, 700.0]
MATERIAL = {
    "albedo": {"wavelength_nm": NODES_NM, "value": [0.80, 0.88, 0.93, 0.95]},
    "sigma_t_per_mm": {"wavelength_nm": NODES_NM, "value": [2.6, 2.2, 1.9, 1.7]},
    "g": {"wavelength_nm": NODES_NM, "value": [0.55, 0.52, 0.50, 0.48]},
}
STEP_NM, QUICK_STEP_NM = 60.0, 100.0
ERROR, QUICK_ERROR = 0.01, 0.02
"""Relative standard error of Mitsuba's radiances."""
SEED = 20261122
OUR_PATHS = 1 << 14
"""Of the Monte Carlo that the renders are compared with."""
SCALES = 3.0
"""Size of every effect in prior scales of the catalogue, set before the first render."""
NOTHING = "no effect"


@dataclass(frozen=True)
class Withheld:
    """One effect: a candidate of the catalogue by name, and the sign of its parameters.

    Attributes:
        name: of the candidate, or `NOTHING`.
        sign: of its parameters.
        described_n: refractive index of the samples as it is described.
    """

    name: str
    sign: tuple[float, ...] = (1.0,)
    described_n: float = N


CASES = (
    Withheld(NOTHING),
    Withheld("black_level"),
    Withheld("thickness[0.8 mm]"),
    Withheld("refractive_index", (-1.0,), 1.06),
    Withheld("panel_angle"),
    Withheld("gap"),
    Withheld("white_ageing", (1.0, 1.0)),
    Withheld("phase_function"),
    Withheld("reference_plane", (-1.0,)),
)
QUICK_CASES = CASES[:4]


def scenario(step_nm: float, n: float = N) -> Scenario:
    """The visit as it is described, with the true material."""
    from scenarios.scenario import Scenario

    samples = [
        {"name": f"{mm:g} mm", "thickness_mm": mm, "n": n, "material": MATERIAL}
        for mm in THICKNESS_MM
    ]
    # pixels see the very wavelengths that are rendered: nothing lies between them
    instrument = {
        "kind": "spectrometer", "start_nm": 400.0, "stop_nm": 700.0, "step_nm": step_nm,
        "off": ["bandwidth"],
    }  # fmt: skip
    return validate(
        {
            "title": "A visit rendered by Mitsuba",
            "bench": {"covers_above": [], "covers_below": [], "instrument": instrument},
            "samples": samples,
            "wavelength": {"start_nm": 400.0, "stop_nm": 700.0, "step_nm": step_nm},
        },
        Scenario,
    )


def world_of(described: Scenario, withheld: Withheld) -> tuple[World, tuple[float, ...]]:
    """The true world of a case, and the values of what is withheld, as deviations from nominal."""
    from twin.effects import World, candidate

    world = World.nominal(described.bench, described.samples)
    if withheld.name == NOTHING:
        return world, ()
    found = candidate(world, withheld.name)
    away = tuple(
        sign * SCALES * parameter.prior_scale
        for sign, parameter in zip(withheld.sign, found.parameters, strict=True)
    )
    if withheld.name == "reference_plane":
        return world, away  # Mitsuba itself renders the white there
    return found.apply(world, np.array(found.nominal) + away), away


def light_of(
    world: World, wavelength_nm: FloatArray, reference_mm: float, error: float
) -> tuple[list[NoiselessCaptures], Studio]:
    """Mitsuba's captures of all samples of a world, and what rendered them."""
    studio = Studio(world.bench, error)
    background = world.bench.background
    rho = [
        reflectance(part.reflectance, wavelength_nm)
        for part in (background.black, background.white)
    ]
    share, second = world.second_lobe
    light = []
    for sample in world.samples:
        medium = optical_properties(sample.material or "", wavelength_nm)
        n = np.round(refractive_index(sample.n, wavelength_nm), 9)
        truth = [
            Truth(
                SlabCase(
                    float(n[i]), float(medium.albedo[i]), float(medium.sigma_t_per_mm[i]),
                    float(medium.g[i]), sample.thickness_mm, "", 0.0, share, second,
                ),
                (float(rho[0][i]), float(rho[1][i])),
                reference_mm,
            )
            for i in range(len(wavelength_nm))
        ]  # fmt: skip
        light.append(studio.captures(truth, wavelength_nm))
    return light, studio


def visit(withheld: Withheld, number: int, quick: bool) -> tuple[Measurement, Studio, list[float]]:
    """The measurement of one case as a person has it, and the true values of its effect."""
    from scenarios.blind.material_bench import stripped
    from scenarios.worlds import world_visits

    described = scenario(QUICK_STEP_NM if quick else STEP_NM, withheld.described_n)
    world, away = world_of(described, withheld)
    offset = away[0] if withheld.name == "reference_plane" else 0.0
    light, studio = light_of(
        world, described.wavelength.wavelength_nm, offset, QUICK_ERROR if quick else ERROR
    )
    measurement = next(iter(world_visits(described, world, light, [SEED + number])))
    return stripped(measurement), studio, list(away)


def agreement(quick: bool) -> tuple[int, float]:
    """How Mitsuba's captures of the world as described compare with our Monte Carlo's.

    Returns:
        Number of captures, and the root mean square of their differences in standard errors.
    """
    from twin.effects import world_captures

    described = scenario(QUICK_STEP_NM if quick else STEP_NM)
    wavelength = described.wavelength.wavelength_nm
    world, _ = world_of(described, CASES[0])
    theirs, _ = light_of(world, wavelength, 0.0, QUICK_ERROR if quick else ERROR)
    ours = world_captures(world, wavelength, paths=OUR_PATHS, seeds=[SEED])
    z = [
        (getattr(one, name) - getattr(other, name))
        / np.hypot(getattr(one, f"{name}_se"), getattr(other, f"{name}_se"))
        for one, other in zip(theirs, ours, strict=True)
        for name in ("black", "white", "collimated")
    ]
    return int(np.size(z)), float(np.sqrt(np.mean(np.square(z))))


def judged(found: dict[str, Any], withheld: Withheld, away: list[float]) -> dict[str, Any]:
    """One row: what `benchtwin diagnose` said, beside the truth."""
    closure = found["closure"]
    row: dict[str, Any] = {
        "withheld": withheld.name,
        "true_value": away,
        "verdict": found["verdict"],
        "leading": found["leading"],
        "p": found["p"],
        "top": [[e["name"], e["probability"]] for e in found["effects"][:3]],
        "credible_set": found["credible_set"],
        "none_of_these": found["unknown_probability"],
        "closure": None if closure is None else [closure["value"], *closure["interval"]],
    }
    if withheld.name == NOTHING:
        return row
    own = next((e for e in found["effects"] if e["name"] == withheld.name), None)
    hidden = {e["name"]: e["reason"] for e in found["not_identifiable"]}
    answered = found["verdict"] in ("effect", "pair", "group")
    row |= {
        "rank": None if own is None else found["effects"].index(own) + 1,
        "probability": None if own is None else own["probability"],
        "value": None if own is None else [p["value"] for p in own["parameters"]],
        "sd": None if own is None else [p["sd"] for p in own["parameters"]],
        "hidden": hidden.get(withheld.name, ""),
        "named": answered and found["leading"] == [withheld.name],
        "in_set": withheld.name in {*found["credible_set"], *found["leading_set"]},
    }
    return row


def run(quick: bool) -> dict[str, object]:
    """Render, diagnose, compare.

    Args:
        quick: four cases, four wavelengths, noisier renders, coarse maps.

    Returns:
        cases: one row each; named: cases whose effect leads alone; in_set: cases whose effect is
        in the 90 % set; effects: cases that have one; false_alarm: whether the case without an
        effect got a verdict other than "no gap"; agreement_rms_z: `agreement`, of
        captures_compared; mitsuba_s: processor time of all renders, once.
    """
    from scenarios.commands.diagnosis import diagnose_file
    from twin.measurement import write_measurement

    began = time.perf_counter()
    rows = []
    spent: dict[str, float] = {}
    with TemporaryDirectory() as folder:
        for number, withheld in enumerate(QUICK_CASES if quick else CASES):
            measurement, studio, away = visit(withheld, number, quick)
            own = Path(folder) / f"{number}"
            own.mkdir()
            path = write_measurement(measurement, own / "measurement.nc")
            found = diagnose_file(path, out=own / "diagnosis", quick=quick, as_json=True)
            rows.append(judged(found, withheld, away))
            spent |= studio.used
            print(f"{withheld.name}: {found['verdict']}, {found['leading']}", file=sys.stderr)
    compared, rms_z = agreement(quick)
    real = [row for row in rows if row["withheld"] != NOTHING]
    return {
        "cases": rows,
        "effects": len(real),
        "named": sum(bool(row["named"]) for row in real),
        "in_set": sum(bool(row["in_set"]) for row in real),
        "false_alarm": any(
            row["verdict"] != "no_gap" for row in rows if row["withheld"] == NOTHING
        ),
        "captures_compared": compared,
        "agreement_rms_z": rms_z,
        "mitsuba_s": sum(spent.values()),
        "seconds": time.perf_counter() - began,
    }


def table(rows: list[dict[str, Any]]) -> str:
    """The rows as a table of Markdown."""
    lines = [
        "| withheld | true value | verdict | leading | most probable | truth: rank, value |"
        " gap closed |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        true = ", ".join(f"{value:g}" for value in row["true_value"]) or "-"
        top = ", ".join(f"{name} {share:.2f}" for name, share in row["top"]) or "-"
        truth = "-"
        if row.get("rank"):
            values = ", ".join(
                f"{v:.3g} +- {s:.1g}" for v, s in zip(row["value"], row["sd"], strict=True)
            )
            truth = f"{row['rank']}, {values}"
        elif row.get("hidden"):
            truth = "not visible"
        closed = "-"
        if row["closure"] is not None:
            closed = "{:.2f} ({:.2f} to {:.2f})".format(*row["closure"])
        leading = " + ".join(row["leading"]) or "-"
        lines.append(
            f"| {row['withheld']} | {true} | {row['verdict'].replace('_', ' ')} | {leading} |"
            f" {top} | {truth} | {closed} |"
        )
    return "\n".join(lines)
