"""References: our Monte Carlo against published and computed values for plane-parallel slabs.

Every row of `../shared/data/translucent/reference_values.csv` (beside the repository) that a
slab in air defines is estimated at a standard error of 0.1 % of itself, and compared:

    z = (ours - reference) / sqrt(standard error^2 + reference's uncertainty^2)

Our side is single precision with tabulated specular transfer, so `FLOOR` of the value joins the
combined error (it matters for rows without any randomness only). What is meant by a row:

- "diffuse Lambertian" incidence starts cosine-weighted over the hemisphere; the radiance that
  leaves at mu under diffuse light is, by reciprocity, the hemispherical quantity for light that
  arrives at mu;
- an infinite optical thickness is a slab of 60 mean free paths: with diffusion exponent k the
  truncation is of the order exp(-120 k), below 1e-8 for every such row (albedo at most 0.99);
- H(mu) of a semi-infinite isotropic medium follows from the plane albedo R(mu) by the identity
  H = (1 - R) / sqrt(1 - albedo) (Chandrasekhar 1950, section 33);
- the 45/0 rows are estimated twice: with a beam at 45 degrees and an exact exit direction, and,
  marked [panels], with two small distant panels looked at from above as on the bench;
- light that leaves a bare slab nearly along its surface (`GRAZING`) is traced from there, by
  reciprocity: the radiance factor is the same with both directions exchanged. Rows where light
  also arrives there are traced as they are.

Every other row that is left out is listed under `not_applicable` with its reason. Rows whose
printed value a second, independent program contradicts (`CORRECTED`) are compared with that
program; `as_printed` counts them against the printed values, so that nothing is hidden. Rows
behind a slab 32 mean free paths thick are traced with importance splitting
(docs/decisions/0005), one launch for each albedo. `above_target` lists the rows, if any, whose
standard error is above the target all the same.
"""

from __future__ import annotations

import csv
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from benchmarks.reference_rows import Case, Scene, Score, cases_of, deep_slab
from twin.spectra import FloatArray
from twin.transport import Effort, FlatStack, Outline, PanelShape, Setup, run_many, trace
from twin.transport.engine import Tallies
from twin.transport.geometry import irradiance_factor

CSV = Path(__file__).parents[2] / "shared" / "data" / "translucent" / "reference_values.csv"
FLOOR = 2e-6
TARGET, QUICK_TARGET = 1.0e-3, 5.0e-3
PILOT_LOG2, CHUNK_LOG2, BLOCKS = 9, 13, 64
SAFETY = 1.1
MAX_CHUNKS = 128
DEEP_FROM = 10.0
# sorted paths are best many together: few blocks to a chunk, and no pilot that says how many
DEEP_BLOCKS, DEEP_CHUNKS, MAX_DEEP_CHUNKS = 16, 3, 48
GRAZING = 0.3
# Quadrature with 48 angles does not resolve g = 0.9 behind a cone of 5 degrees at n 1.5: the
# printed uncertainty, a difference of two quadratures, is by chance twenty times smaller there
# than at 10 degrees. Values of `python -m benchmarks analog_slab`.
CORRECTED = {
    "iad_CONE_a0.9_b4_g0.9_n1.5_5deg_Tcone": (0.034483, 3.9e-5),
    "iad_CONE_a0.999_b4_g0.9_n1.5_5deg_Tcone": (0.039970, 4.4e-5),
}
PANEL_DISTANCE_MM, PANEL_HALF_MM = 1.0e6, 5.0e3


@dataclass
class Launch:
    """One scene and one kind of score; serves every albedo and both sides.

    With `split_albedo` it serves that albedo alone, behind a deep slab.
    """

    scene: Scene
    score: Score
    split_albedo: float = 0.0
    cases: list[Case] = field(default_factory=list)

    def stack(self) -> FlatStack:
        """The slab, with lengths in mean free paths."""
        depth = deep_slab(self.scene.optical_thickness)
        one = np.ones(1)
        return FlatStack(depth * one, self.scene.n * one, one, self.scene.g * one, one, counted=0)

    def setup(self) -> Setup:
        """The set-up of the kernel; what no row asks for is not scored."""
        sides = {case.side for case in self.cases}
        start = self.scene.start_cosine
        contact = Outline(False, 1.0e17, 1.0e17) if self.scene.rho > 0.0 else None
        if self.score.kind == "panels":
            panels = distant_panels()
            return Setup(
                up="panels",
                panels=panels,
                panel_scale=math.pi / irradiance_factor(panels, 0.0, 0.0, 0.0),
                black=contact,
            )
        return Setup(
            polar=0.0 if start is None else math.acos(start),
            cone=math.pi / 2 if start is None else 0.0,
            up=self.score.kind if "up" in sides else "none",
            down=self.score.kind if "down" in sides else "none",
            target_cosine=self.score.cosine,
            black=contact,
        )

    @property
    def chunk_blocks(self) -> int:
        """Blocks that are traced in one go."""
        return DEEP_BLOCKS if self.split_albedo else BLOCKS

    def effort(self, log2_paths: int) -> Effort:
        """Splitting behind a deep slab; elsewhere roulette with the largest albedo."""
        if self.split_albedo:
            return Effort(
                blocks=DEEP_BLOCKS,
                log2_paths=log2_paths,
                roulette_free=20_000,
                split_albedo=self.split_albedo,
            )
        albedo = max(case.albedo for case in self.cases)
        return Effort(
            blocks=BLOCKS,
            log2_paths=log2_paths,
            roulette_albedo=max(0.05, min(1.0, albedo)),
            roulette_scale=1.0e9 if albedo < 1.0 else 64.0,
        )

    def blocks(self, tallies: Tallies) -> FloatArray:
        """Block means of every case, shape (blocks, cases)."""
        columns = []
        for case in self.cases:
            channel = 0 if case.side == "up" else 1
            series = tallies.value
            if case.scattered_only:
                series = series.copy()
                series[:, :, 0, 0] = 0.0
            by_bounce = tallies.blocks_by_albedo(channel, np.array([case.albedo]), series)
            columns.append(by_bounce[:, 0, :] @ self.scene.rho**tallies.bounce)
        return np.stack(columns, axis=1)


def distant_panels() -> tuple[PanelShape, ...]:
    """Two panels at 45 degrees that look like points from everywhere in the slab."""
    panels = []
    for sign in (1.0, -1.0):
        s = math.sqrt(0.5)
        panels.append(
            PanelShape(
                (sign * s * PANEL_DISTANCE_MM, 0.0, s * PANEL_DISTANCE_MM),
                (sign * s, 0.0, -s),
                (0.0, 1.0, 0.0),
                (-sign * s, 0.0, -s),
                (PANEL_HALF_MM, PANEL_HALF_MM),
            )
        )
    return tuple(panels)


def behind_deep(case: Case) -> bool:
    """Whether a case collects light that comes through a deep slab of finite thickness."""
    return case.side == "down" and DEEP_FROM < case.scene.optical_thickness < math.inf


def traced_as(scene: Scene, score: Score) -> tuple[Scene, Score]:
    """Scene and score to trace: those asked for, or by reciprocity both directions exchanged."""
    start, leaves = scene.start_cosine, score.cosine
    if score.kind != "direction" or scene.rho > 0.0 or start is None:
        return scene, score
    if leaves > GRAZING or leaves >= start:
        return scene, score
    return replace(scene, start_cosine=leaves), Score("direction", start)


def launches_of(cases: list[Case]) -> list[Launch]:
    """Cases that one trace can serve, together."""
    found: dict[tuple[Scene, Score, float], Launch] = {}
    for case in cases:
        key = (*traced_as(case.scene, case.score), case.albedo if behind_deep(case) else 0.0)
        found.setdefault(key, Launch(*key)).cases.append(case)
    return list(found.values())


def read_rows(path: Path = CSV) -> list[dict[str, str]]:
    """Rows of the table of reference values."""
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def relative_errors(launch: Launch, blocks: FloatArray) -> FloatArray:
    """Standard errors over |reference| (over 1 where the reference is zero), shape (cases,)."""
    error = blocks.std(axis=0, ddof=1) / math.sqrt(len(blocks))
    error = error * np.abs([case.slope for case in launch.cases])
    scale = np.array([abs(case.value) or 1.0 for case in launch.cases])
    return np.asarray(error / scale)


def measure(launches: list[Launch], target: float, seed: int) -> tuple[list[FloatArray], int]:
    """Block means of every launch, with as many paths as the target asks for.

    A pilot says how many paths are needed; its own paths are not used again. A launch that
    misses the target goes on until it meets it or `MAX_CHUNKS` chunks are spent. Launches with
    splitting have no pilot and begin with `DEEP_CHUNKS`.
    """

    def job(number: int, chunk: int, log2_paths: int) -> Callable[[], FloatArray]:
        launch = launches[number]

        def run() -> FloatArray:
            return launch.blocks(
                trace(
                    launch.stack(),
                    launch.setup(),
                    launch.effort(log2_paths),
                    seed=seed,
                    stream=2 * number + int(chunk >= 0),
                    first_block=launch.chunk_blocks * max(chunk, 0),
                )
            )

        return run

    numbers = range(len(launches))
    shallow = [n for n in numbers if not launches[n].split_albedo]
    log2 = [CHUNK_LOG2] * len(launches)
    limit = [MAX_DEEP_CHUNKS] * len(launches)
    wanted = [DEEP_CHUNKS] * len(launches)
    pilots = run_many([job(n, -1, PILOT_LOG2) for n in shallow])
    for n, pilot in zip(shallow, pilots, strict=True):
        ratio = float(np.max(relative_errors(launches[n], pilot), initial=0.0)) / target * SAFETY
        paths = max(1.0, ratio**2) * 2.0**PILOT_LOG2
        log2[n] = min(CHUNK_LOG2, math.ceil(math.log2(paths)))
        limit[n] = MAX_CHUNKS
        wanted[n] = min(MAX_CHUNKS, math.ceil(paths / 2.0 ** log2[n]))
    done: list[list[FloatArray]] = [[] for _ in numbers]
    total = 0
    while True:
        order = [(n, c) for n in numbers for c in range(len(done[n]), wanted[n])]
        if not order:
            break
        order.sort(key=lambda item: -wanted[item[0]])
        for (n, _), blocks in zip(
            order, run_many([job(n, c, log2[n]) for n, c in order]), strict=True
        ):
            done[n].append(blocks)
            total += launches[n].chunk_blocks * 2 ** log2[n]
        for n in numbers:
            miss = np.max(relative_errors(launches[n], np.concatenate(done[n]))) / target
            if miss > 1.0:
                more = math.ceil(len(done[n]) * float(miss) ** 2 * 1.05)
                wanted[n] = min(limit[n], max(len(done[n]) + 1, more))
            else:
                wanted[n] = len(done[n])
    return [np.concatenate(part) for part in done], total


def distance(ours: float, error: float, value: float, uncertainty: float) -> float:
    """How many combined standard errors apart two values are."""
    combined = math.sqrt(error**2 + uncertainty**2 + (FLOOR * value) ** 2)
    return (ours - value) / combined if combined > 0.0 else 0.0


def compared(launch: Launch, blocks: FloatArray) -> list[dict[str, object]]:
    """One line per case: ours, theirs, how far apart."""
    mean = blocks.mean(axis=0)
    spread = blocks.std(axis=0, ddof=1) / math.sqrt(len(blocks))
    lines: list[dict[str, object]] = []
    for case, raw, raw_error in zip(launch.cases, mean, spread, strict=True):
        ours, error = case.offset + case.slope * float(raw), abs(case.slope) * float(raw_error)
        value, uncertainty = CORRECTED.get(case.name, (case.value, case.uncertainty))
        z = distance(ours, error, value, uncertainty)
        lines.append(
            {
                "row": case.name,
                "ours": ours,
                "standard_error": error,
                "reference": value,
                "uncertainty": uncertainty,
                "z": z,
                "z_as_printed": distance(ours, error, case.value, case.uncertainty),
                "relative_error": (ours / value - 1.0) if value else None,
                "relative_standard_error": error / abs(value) if value else None,
            }
        )
    return lines


def thinned(cases: list[Case], every: int) -> list[Case]:
    """Every n-th case, without the deep slabs (for a quick look)."""
    return [case for case in cases if case.scene.optical_thickness <= 8.0][::every]


def summary(lines: list[dict[str, object]], target: float) -> dict[str, object]:
    """The figures of the benchmark from the lines of `compared`."""

    def number(line: Mapping[str, object], key: str) -> float:
        value = line[key]
        return abs(float(value)) if isinstance(value, float) else 0.0

    z, printed = (np.array([number(line, key) for line in lines]) for key in ("z", "z_as_printed"))
    return {
        "rows": len(lines),
        "beyond3": int(np.sum(z > 3.0)),
        "failed": int(np.sum(z > 4.5)),
        "max_z": float(z.max()),
        "max_relative_error": max(number(line, "relative_error") for line in lines),
        "max_relative_standard_error": max(
            number(line, "relative_standard_error") for line in lines
        ),
        "rms_z": float(np.sqrt(np.mean(z**2))),
        "as_printed": {
            "beyond3": int(np.sum(printed > 3.0)),
            "failed": int(np.sum(printed > 4.5)),
            "max_z": float(printed.max()),
        },
        "corrected": [line for line in lines if line["row"] in CORRECTED],
        "above_target": [
            {"row": line["row"], "relative_standard_error": line["relative_standard_error"]}
            for line in lines
            if number(line, "relative_standard_error") > target
        ],
        "worst": sorted(lines, key=lambda line: -number(line, "z"))[:12],
    }


def run(quick: bool) -> dict[str, object]:
    """Estimate and compare; see the module's docstring for the keys' meaning."""
    if not CSV.is_file():
        reason = "the table of reference values is not beside the repository"
        return {"rows": 0, "skipped": f"{reason}: expected {'/'.join(CSV.parts[-4:])}"}
    started = time.perf_counter()
    cases, not_applicable = cases_of(read_rows())
    if quick:
        cases = thinned(cases, 5)
    launches = launches_of(cases)
    target = QUICK_TARGET if quick else TARGET
    blocks, paths = measure(launches, target, seed=2026)
    lines = [
        line
        for launch, part in zip(launches, blocks, strict=True)
        for line in compared(launch, part)
    ]
    return {
        **summary(lines, target),
        "not_applicable": not_applicable,
        "launches": len(launches),
        "paths": paths,
        "seconds": time.perf_counter() - started,
        "lines": lines,
    }
