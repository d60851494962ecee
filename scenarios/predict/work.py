"""What `benchtwin predict` does: read estimates, predict, write a folder, answer."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.predict.inputs import illuminants_of, medium_from, read_medium, slab_of
from twin.errors import InputError

if TYPE_CHECKING:
    from scenarios.console import Console
    from scenarios.predict.appearance import Prediction
    from scenarios.predict.colour import Colour, Difference
    from scenarios.predict.mixture import UncertainMedium

TABLE, SUMMARY, MEDIUM = "prediction.csv", "summary.json", "medium"
TABLE_HEADER = "wavelength_nm,albedo,sigma_t_per_mm,g,reflectance,lower_90,upper_90"


def predict_files(
    estimates: Sequence[str],
    *,
    mix: bool = False,
    compare: Path | None = None,
    thickness_mm: float = 5.0,
    n: str = "1.5",
    background: str = "black",
    illuminants: Sequence[str] = ("D65",),
    engine: str = "adding-doubling",
    draws: int = 200,
    missing_share: float = 0.2,
    export: str | None = None,
    unit_mm: float = 1.0,
    out: Path | None = None,
    seed: int = 1,
    paths: int = 1 << 13,
    threads: int | None = None,
    console: Console,
) -> dict[str, Any]:
    """Predict one estimate or a mixture; returns the summary that is also written.

    Raises:
        InputError: estimates that cannot be read or mixed, or options that cannot be.
    """
    from scenarios.outputs import canonical_json, prepare_folder
    from scenarios.predict.appearance import ENGINES, predict
    from scenarios.predict.colour import colour_of, difference
    from scenarios.predict.export import SUFFIXES, render_medium, write_medium
    from twin.files import write_atomically
    from twin.materials import refractive_index

    slab = slab_of(thickness_mm, n, background)
    if engine not in ENGINES:
        raise InputError(f'the engine "{engine}"', " or ".join(ENGINES), place="--engine")
    if export is not None and export not in SUFFIXES:
        raise InputError(f'the renderer "{export}"', " or ".join(SUFFIXES), place="--export")
    if not 0 <= missing_share < 1:
        raise InputError(f"a share of {missing_share:g}", "0 to below 1", place="--missing")
    lamps = illuminants_of(illuminants)
    medium = medium_from(estimates, mix, draws, seed)
    media = [medium]
    if compare is not None:
        media.append(read_medium(compare, draws, seed + 500))
    folder = prepare_folder(out or Path("benchtwin-predict"))
    found = []
    with console.step(f"predict by {engine}") as progress:
        for number, one in enumerate(media):
            found.append(
                predict(
                    one, slab, engine=engine, paths=paths, seed=seed + number, threads=threads,
                    progress=progress,
                )
            )  # fmt: skip
    answer: dict[str, Any] = {
        "command": "predict",
        "medium": medium.name,
        "thickness_mm": _finite(thickness_mm),
        "n": n,
        "background": background,
        "engine": engine,
        "wavelengths": len(medium.wavelength_nm),
        "range_nm": [medium.wavelength_nm[0], medium.wavelength_nm[-1]],
        "predicted_at": int(medium.known.sum()),
        "median_interval_90": _median_width(found[0]),
        "wavelengths_go_together": _coupling_text(found[0]),
    }
    colours = [colour_of(found[0], lamp, missing_share=missing_share) for lamp in lamps]
    answer["colours"] = [colour_facts(colour) for colour in colours]
    if compare is not None:
        answer["compared_with"] = media[1].name
        answer["differences"] = [
            difference_facts(difference(found[0], found[1], lamp, missing_share=missing_share))
            for lamp in lamps
        ]
    said = [*found[0].notes, *(note for colour in colours for note in colour.notes)]
    if compare is not None:
        said += [f"{media[1].name}: {note}" for note in found[1].notes]
    ready = None
    if export is not None:
        index = float(np.mean(refractive_index(slab.n, medium.wavelength_nm)))
        ready = render_medium(medium, unit_mm=unit_mm, n=index)
        said += ready.notes
        answer["exported"] = {"renderer": export, "id": ready.name, "g": ready.g}
    # everything that can be refused has been: now the files
    files = [write_atomically(folder / TABLE, _table(medium, found[0]).encode())]
    if ready is not None and export is not None:
        files.append(write_medium(ready, export, folder / (MEDIUM + SUFFIXES[export])))
    answer["notes"] = list(dict.fromkeys(said))
    answer["files"] = [path.name for path in (*files, folder / SUMMARY)]
    write_atomically(folder / SUMMARY, canonical_json(answer).encode() + b"\n")
    return {"folder": str(folder), **answer}


def predict_checker(
    *,
    thickness_mm: float = 5.0,
    n: str = "1.5",
    background: str = "black",
    illuminant: Sequence[str] = ("D65",),
    estimator: str = "lut",
    draws: int = 200,
    quick: bool = False,
    out: Path | None = None,
    seed: int = 1,
    threads: int | None = None,
    resume: bool = False,
    cache: Path | None = None,
    console: Console,
) -> dict[str, Any]:
    """The colour checker from start to end; returns the summary that is also written.

    Raises:
        InputError: options that cannot be, an unknown estimator, a folder that cannot be written.
    """
    from scenarios.outputs import canonical_json, prepare_folder
    from scenarios.predict.checker import run_checker
    from scenarios.predict.checker_page import checker_facts, write_checker
    from scenarios.scenario import EstimatorChoice
    from twin.files import write_atomically

    slab = slab_of(thickness_mm, n, background)
    if math.isinf(thickness_mm):
        raise InputError("an infinite checker", "a finite thickness [mm]", place="--thickness")
    lamps = illuminants_of(illuminant)
    if len(lamps) != 1:
        raise InputError(f"{len(lamps)} illuminants", "one with --checker", place="--illuminant")
    folder = prepare_folder(out or Path("benchtwin-checker"))
    checker = run_checker(
        slab=slab,
        illuminant=lamps[0],
        estimator=EstimatorChoice(name=estimator),
        quick=quick,
        seed=seed,
        draws=draws,
        work=prepare_folder(folder / "work"),
        resume=resume,
        cache=cache,
        threads=threads,
        console=console,
    )
    answer = {"command": "predict", **checker_facts(checker)}
    written = write_checker(checker, folder)
    answer["files"] = [path.name for path in (*written, folder / SUMMARY)]
    write_atomically(folder / SUMMARY, canonical_json(answer).encode() + b"\n")
    return {"folder": str(folder), **answer}


def _finite(value: float) -> float | str:
    return value if math.isfinite(value) else "inf"


def _median_width(prediction: Prediction) -> float:
    low, high = prediction.interval(0.9)
    return float(np.nanmedian(high - low))


def _coupling_text(prediction: Prediction) -> str:
    if prediction.ordered:
        return "as the posterior's draws"
    return "unknown: intervals of colours span independent and common errors"


def colour_facts(colour: Colour) -> dict[str, Any]:
    """A colour as plain values."""
    low, high = colour.lab_interval
    swatch = colour.swatch
    return {
        "illuminant": colour.illuminant,
        "lab": list(swatch.lab),
        "lab_lower_90": low.tolist(),
        "lab_upper_90": high.tolist(),
        "xyz": list(swatch.xyz),
        "srgb": swatch.hexadecimal,
        "in_gamut": swatch.in_gamut,
        "spread_ciede2000_90": colour.spread_ciede2000,
        "range_nm": list(colour.range_nm),
        "bridged": colour.bridged,
    }


def difference_facts(found: Difference) -> dict[str, Any]:
    """A colour difference as plain values."""
    return {
        "illuminant": found.illuminant,
        "ciede2000": found.ciede2000,
        "interval_90": list(found.interval),
        "by_coupling": {how: list(interval) for how, interval in found.by_coupling.items()},
        "range_nm": list(found.range_nm),
    }


def _table(medium: UncertainMedium, prediction: Prediction) -> str:
    """One row per wavelength; an unknown value is an empty cell."""
    low, high = prediction.interval(0.9)
    columns = (medium.wavelength_nm, *medium.value.T, prediction.reflectance, low, high)
    rows = [
        ",".join("" if not math.isfinite(v) else repr(float(v)) for v in values)
        for values in zip(*columns, strict=True)
    ]
    return "\n".join([TABLE_HEADER, *rows, ""])
