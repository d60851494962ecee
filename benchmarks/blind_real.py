"""Published sphere measurements with a known effect left out of the model: is it named?

Arm 3 of the blind check: `python -m benchmarks blind_real`. Data: tests of Prahl's inverse
adding-doubling (MIT), read from beside the repository. The description of each measurement is
made wrong on purpose - slides left out, index 1.40 for 1.33, thickness + 5 %, readings of a
single beam taken for a dual beam's (no sphere correction) - and the data are diagnosed with it.
Beside every row stands the same on data of ours: made by the sphere model at the fit to the real
data, as described, with the noise that was taken.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twin.measurement.rxt import SphereVisit, read_rxt
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from diagnosis.sphere_noise import SphereNoise
    from diagnosis.spheres import SphereCase
    from diagnosis.verdict import Diagnosis
    from twin.spheres.readings import Method

FOLDER = Path(__file__).resolve().parents[1] / ".." / "shared/data/translucent/iad_rxt"
SEED = 5
INDEX, TRUE_INDEX, THICKER = 1.40, 1.33, 1.05
AS_DESCRIBED = "as described"


@dataclass(frozen=True)
class Series:
    """A series of dilutions in one file.

    Attributes:
        fillings: equal numbers for rows that repeat a dilution, read off the data, or none.
        diluent: whether an absorption that all dilutions share is searched.
        noise_of: another series of the instrument whose noise is taken, or "".
    """

    fillings: tuple[int, ...] | None
    diluent: bool
    noise_of: str = ""


SERIES = {
    "il_A": Series((8, 7, 6, 5, 4) * 2, True),
    "il_B": Series((8, 7, 6, 5, 4, 3, 2) * 3 + (8, 7, 6), True),
    "ink_A": Series(None, False, "ink_B"),
    "ink_B": Series((0, 0, 1, 2, 2, 0, 0, 2, 2, 3, 4, 5, 6, 3, 3), False),
}
SPECTRA = ("phantom_with_no_slides", "tio2_vis", "vio_A", "AMC")
"""One sample each: as many readings as unknowns at every wavelength."""


def _no_slides(visit: SphereVisit) -> SphereVisit:
    one = np.ones(visit.rows)
    return replace(visit, slide_n=one, slide_thickness_mm=0.0 * one, slide_depth=0.0 * one)


def _same(visit: SphereVisit) -> SphereVisit:
    return visit


LEFT_OUT: dict[str, tuple[Callable[[SphereVisit], SphereVisit], str, float]] = {
    AS_DESCRIBED: (_same, "", 0.0),
    "slides left out": (_no_slides, "slides", 1.0),
    "index 1.40 for 1.33": (
        lambda visit: replace(visit, n=np.full(visit.rows, INDEX)), "sample_index",
        TRUE_INDEX - INDEX,
    ),
    "thickness + 5 %": (
        lambda visit: replace(visit, thickness_mm=THICKER * visit.thickness_mm), "thickness",
        1.0 / THICKER - 1.0,
    ),
    "sphere correction dropped": (_same, "sphere_correction", 1.0),
}  # fmt: skip
"""What is done to the description, the effect that undoes it, and its true value."""


def case_of(
    visit: SphereVisit,
    series: Series,
    left_out: str,
    noise: SphereNoise | None,
    concentration: Sequence[float] | None = None,
) -> SphereCase:
    """The problem of a series with a wrong description."""
    from diagnosis.spheres import sphere_case
    from estimators.sphere import SphereSettings

    change, effect, _ = LEFT_OUT[left_out]
    method: Method = "comparison" if effect == "sphere_correction" else "substitution"
    return sphere_case(
        change(visit), settings=SphereSettings(method=method), dilutions=True,
        fillings=series.fillings if noise is None else None, diluent=series.diluent, noise=noise,
        concentration=concentration,
    )  # fmt: skip


def synthetic(visit: SphereVisit, case: SphereCase, number: int) -> SphereVisit:
    """Readings of the described model at the fit, with the noise that was taken."""
    problem = case.problem
    generator = np.random.Generator(np.random.Philox(key=[SEED, number]))
    data = problem.forward(problem.material, {})
    root = np.linalg.cholesky(problem.independent)
    data = data + np.einsum("wmn,wn->wm", root, generator.standard_normal(data.shape))
    data = data + np.tensordot(generator.standard_normal(len(problem.common)), problem.common, 1)
    value = visit.value.copy()
    value[:, : len(case.twin.captures)] = np.maximum(
        data.reshape(visit.rows, len(case.twin.captures)), 1e-6
    )
    return replace(visit, value=value)


def optical(case: SphereCase) -> tuple[FloatArray, FloatArray]:
    """mu_a and mu_s' [1/mm] of every dilution at the fit without effects, (W, S) each."""
    from diagnosis.sphere_effects import SphereChange

    twin = case.twin
    found = twin.parameters(twin.local(case.problem.material), SphereChange())
    albedo, sigma_t, g = np.moveaxis(found, -1, 0)
    return (1.0 - albedo) * sigma_t, albedo * sigma_t * (1.0 - g)


def judged(diagnosis: Diagnosis, effect: str) -> dict[str, object]:
    """One row of the table."""
    names = [each.name for each in diagnosis.effects]
    hidden = {each.name: each.reason for each in diagnosis.not_identifiable}
    null = diagnosis.null
    row: dict[str, object] = {
        "verdict": diagnosis.verdict,
        "named": list(diagnosis.leading),
        "credible_set": list(diagnosis.credible_set),
        "p": diagnosis.p,
        "none_of_these": diagnosis.unknown_probability,
        "chi_square": None if null is None else null.chi_square,
        "freedom": None if null is None else null.reduction.freedom,
        "chi_square_after": None if diagnosis.best is None else diagnosis.best.chi_square,
        "closure": None,
        "leaders": [[each.name, each.probability] for each in diagnosis.effects[:3]],
    }
    if diagnosis.closure is not None:
        row["closure"] = [diagnosis.closure.value, *diagnosis.closure.interval]
    if effect:
        seen = effect in names
        own = diagnosis.effects[names.index(effect)] if seen else None
        row |= {
            "truth": effect,
            "truth_rank": names.index(effect) + 1 if seen else None,
            "truth_probability": own.probability if own else None,
            "truth_value": own.parameters[0].value if own else None,
            "truth_sd": own.parameters[0].sd if own else None,
            "truth_hidden": hidden.get(effect, ""),
            "truth_in_set": effect in diagnosis.credible_set,
        }
    return row


def series_rows(name: str, quick: bool) -> list[dict[str, object]]:
    """All rows of one series."""
    from diagnosis import diagnose

    series = SERIES[name]
    visit = read_rxt(FOLDER / f"{name}.rxt")
    noise = None
    if series.noise_of:
        other = read_rxt(FOLDER / f"{series.noise_of}.rxt")
        noise = case_of(other, SERIES[series.noise_of], AS_DESCRIBED, None).noise
    described = case_of(visit, series, AS_DESCRIBED, noise)
    rows: list[dict[str, object]] = []
    # noise is found once, from the right description: a wrong one must not hide in it
    noise = described.noise
    made = synthetic(visit, described, list(SERIES).index(name))
    right: dict[str, tuple[FloatArray, FloatArray]] = {}
    for left_out, (_, effect, value) in LEFT_OUT.items():
        for data, own in (("measured", visit), ("synthetic", made)):
            if quick and data == "synthetic":
                continue
            case = case_of(own, series, left_out, noise)
            diagnosis = diagnose(case.problem, seed=SEED)
            absorption, scattering = optical(case)
            if left_out == AS_DESCRIBED:
                right[data] = absorption, scattering
            row = {"series": name, "data": data, "left_out": left_out, "true_value": value}
            row |= judged(diagnosis, effect)
            row["shift_mu_a"] = float(np.median(absorption / right[data][0]) - 1.0)
            row["shift_mu_s_prime"] = float(np.median(scattering / right[data][1]) - 1.0)
            rows.append(row)
    if series.diluent:
        alone = case_of(visit, replace(series, diluent=False), AS_DESCRIBED, noise)
        found = judged(diagnose(alone.problem, seed=SEED), "")
        place = {"series": name, "data": "measured"}
        rows.append({**place, "left_out": "absorption of the diluent not searched", **found})
        steps = [float(step) for step in series.fillings or ()]
        stepped = case_of(visit, series, AS_DESCRIBED, noise, steps)
        found = judged(diagnose(stepped.problem, seed=SEED), "")
        rows.append({**place, "left_out": "concentrations taken as equal steps", **found})
    oracle = {row["data"]: row["chi_square"] for row in rows if row["left_out"] == AS_DESCRIBED}
    for row in rows:
        row["chi_square_as_described"] = oracle.get(str(row["data"]))
        _say(row)
    return rows


def _say(row: Mapping[str, object]) -> None:
    """One line of progress."""
    print(
        f"{row['series']} ({row['data']}), {row['left_out']}: {row['verdict']}",
        row["named"], file=sys.stderr, flush=True,
    )  # fmt: skip


def spectra_rows() -> list[dict[str, object]]:
    """The single samples: nothing can be told, whatever is left out."""
    from diagnosis import diagnose
    from diagnosis.spheres import sphere_case

    rows = []
    for name in SPECTRA:
        visit = read_rxt(FOLDER / f"{name}.rxt")
        for left_out, (change, effect, _) in LEFT_OUT.items():
            diagnosis = diagnose(sphere_case(change(visit)).problem)
            row = judged(diagnosis, effect)
            rows.append({"series": name, "data": "measured", "left_out": left_out, **row})
    return rows


def run(quick: bool) -> dict[str, object]:
    """Diagnose every data set with every effect left out.

    Args:
        quick: il_B and ink_B only, and no synthetic data beside them.

    Returns:
        real_data: the rows; named, visible, possible: left-out effects of the dilutions that
        lead alone or are in the 90 % set, that these data can show at all, and all of them;
        the same of the synthetic data.
    """
    if not FOLDER.is_dir():
        reason = "the measurements of the inverse adding-doubling community are not beside"
        return {"skipped": f"{reason} the repository: expected {'/'.join(FOLDER.parts[-4:])}"}
    started = time.perf_counter()
    rows = [row for name in (("il_B", "ink_B") if quick else SERIES)
            for row in series_rows(name, quick)]  # fmt: skip
    figures: dict[str, object] = {}
    for data in ("measured",) if quick else ("measured", "synthetic"):
        asked = [r for r in rows if r["data"] == data and "truth" in r]
        prefix = "" if data == "measured" else "synthetic_"
        figures[f"{prefix}possible"] = len(asked)
        figures[f"{prefix}visible"] = sum(not r["truth_hidden"] for r in asked)
        figures[f"{prefix}named"] = sum(bool(r["named"] == [r["truth"]]) for r in asked)
        figures[f"{prefix}in_set"] = sum(bool(r["truth_in_set"]) for r in asked)
    single = spectra_rows()
    figures["cannot_tell"] = sum(row["verdict"] == "cannot_tell" for row in single)
    figures["single_samples"] = len(single)
    figures["real_data"] = rows + single
    figures["seconds"] = time.perf_counter() - started
    return figures


def table(rows: list[dict[str, Any]]) -> str:
    """The rows of the dilutions as a table of Markdown."""
    lines = [
        "| data | left out | verdict | leading | truth: rank, probability, value | chi-square"
        " (freedom) | after | as described | gap closed | mu_a, mu_s' off by |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        if row["chi_square"] is None:
            continue
        truth = "-"
        if row.get("truth"):
            if row["truth_rank"] is None:
                truth = "not visible"
            else:
                truth = f"{row['truth_rank']}, {row['truth_probability']:.2f}"
                truth += f", {row['truth_value']:.3g} +- {row['truth_sd']:.2g}"
                truth += f" (true {row['true_value']:.3g})"
        chi = f"{row['chi_square']:.0f} ({row['freedom']})"
        after = row["chi_square_after"]
        chi += " | -" if after is None else f" | {after:.0f}"
        oracle = row.get("chi_square_as_described")
        chi += " | -" if oracle is None else f" | {oracle:.0f}"
        closed = "-"
        if row["closure"] is not None:
            closed = "{:.2f} ({:.2f} to {:.2f})".format(*row["closure"])
        leading = " + ".join(row["named"]) or "-"
        shift = "-"
        if row.get("shift_mu_a") is not None and row["left_out"] != AS_DESCRIBED:
            shift = f"{row['shift_mu_a']:+.1%}, {row['shift_mu_s_prime']:+.1%}"
        kind = f"{row['series']}" + (" (synthetic)" if row["data"] == "synthetic" else "")
        lines.append(
            f"| {kind} | {row['left_out']} | {row['verdict']} | {leading} | {truth} | {chi} |"
            f" {closed} | {shift} |"
        )
    return "\n".join(lines)
