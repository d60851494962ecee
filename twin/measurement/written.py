"""A measurement as a folder of tidy tables that `read_folder` reads back as the same object.

bench.toml                    the bench with its instrument, nothing left out
samples.csv, or samples.toml  the samples; TOML where a table cannot hold them
captures.csv or relative.csv  the data
truth.csv, light_se.csv       of a simulated visit
origin.toml                   provenance, and the fingerprint of what was written
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from twin.bench import Bench, Sample
from twin.errors import InputError
from twin.files import write_atomically
from twin.measurement.model import (
    SAMPLE_CAPTURES,
    Captures,
    Measurement,
    Provenance,
    RelativeSpectra,
    Truth,
)
from twin.measurement.table import MISSING, Column, Row, read_table
from twin.spectra import FloatArray, Part
from twin.toml import load_toml

SAMPLES_TOML, ORIGIN, TRUTH, LIGHT_SE = "samples.toml", "origin.toml", "truth.csv", "light_se.csv"
CHANGED = "changed by hand since benchtwin wrote the folder"

_TRUTH_COLUMNS = (
    Column("sample", "text", required=True),
    Column("wavelength_nm", "number", required=True),
    Column("albedo", "number", required=True),
    Column("sigma_t_per_mm", "number", required=True),
    Column("g", "number", required=True),
)
_LIGHT_SE_COLUMNS = (
    Column("sample", "text", required=True),
    Column("capture", "text", required=True),
    Column("wavelength_nm", "number", required=True),
    Column("light_se", "number", required=True),
)


class SamplesFile(Part):
    """samples.toml: what a table cannot hold, such as a refractive index by wavelength."""

    samples: tuple[Sample, ...]


class Origin(Part):
    """origin.toml."""

    fingerprint: str
    """Of the measurement that was written (`Measurement.fingerprint`)."""
    provenance: Provenance


def write_folder(measurement: Measurement, folder: str | Path) -> Path:
    """Write a measurement as a folder of tables; the folder is returned.

    Each file is written whole or not at all.

    Raises:
        InputError: the folder holds files already or cannot be written, or a sample's name cannot
            stand in a table.
    """
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        there = sorted(entry.name for entry in folder.iterdir())
    except OSError as error:
        raise InputError(
            f"a folder that cannot be made ({error.strerror or error})", "a new folder", file=folder
        ) from error
    if there:
        raise InputError(
            f"a folder with {there[0]} in it", "an empty or a new folder", file=folder,
            remedy="Name another one.",
        )  # fmt: skip
    for name, text in _files(measurement).items():
        write_atomically(folder / name, text.encode())
    return folder


def with_origin(folder: Path, measurement: Measurement) -> Measurement:
    """The measurement with the provenance in origin.toml, if the folder has one.

    Where the folder is no longer what was written, it is a measurement made by hand, and says so.

    Raises:
        InputError: an origin.toml that cannot be read.
    """
    if not (folder / ORIGIN).exists():
        return measurement
    origin = load_toml(folder / ORIGIN, Origin)
    found = replace(measurement, provenance=origin.provenance)
    if found.fingerprint == origin.fingerprint:
        return found
    was = origin.provenance
    notes = (*was.notes, f"{CHANGED} (it came from {was.origin} data)")
    return replace(
        measurement,
        provenance=Provenance(origin="handmade", noise=was.noise, notes=notes),
    )


def read_truth(folder: Path, known: list[str]) -> Truth | None:
    """The true properties in truth.csv; None without one.

    Raises:
        InputError: a table that cannot be read, or not that of every sample.
    """
    path = folder / TRUTH
    if not path.exists():
        return None
    rows = read_table(path, _TRUTH_COLUMNS)
    wavelength = _grid(rows, {"sample": known[0]})
    values = {
        name: np.array([_column(path, rows, {"sample": s}, wavelength, name) for s in known])
        for name in ("albedo", "sigma_t_per_mm", "g")
    }
    return Truth(wavelength, **values)


def read_light_se(folder: Path, known: list[str], wavelength_nm: FloatArray) -> FloatArray | None:
    """Standard errors of the simulated light in light_se.csv, shape (S, 3, W); None without one.

    Raises:
        InputError: a table that cannot be read, or not that of every sample and capture.
    """
    path = folder / LIGHT_SE
    if not path.exists():
        return None
    rows = read_table(path, _LIGHT_SE_COLUMNS)
    return np.array(
        [
            [
                _column(path, rows, {"sample": s, "capture": c}, wavelength_nm, "light_se")
                for c in SAMPLE_CAPTURES
            ]
            for s in known
        ]
    )


def _fits(row: Row, key: Mapping[str, str]) -> bool:
    return all(row.values[name] == value for name, value in key.items())


def _grid(rows: list[Row], key: Mapping[str, str]) -> FloatArray:
    return np.array([row.values["wavelength_nm"] for row in rows if _fits(row, key)])


def _column(
    path: Path, rows: list[Row], key: Mapping[str, str], wavelength_nm: FloatArray, name: str
) -> list[float]:
    if not np.array_equal(_grid(rows, key), wavelength_nm):
        raise InputError(
            f"other wavelengths of {' '.join(key.values())}",
            f"the {wavelength_nm.size} wavelengths of the others, in their order", file=path,
        )  # fmt: skip
    return [row.values[name] for row in rows if _fits(row, key)]


# Writing -------------------------------------------------------------------------------------


def _files(measurement: Measurement) -> dict[str, str]:
    """Name and text of every file."""
    for sample in measurement.samples:
        if sample.name != sample.name.strip() or not sample.name.isprintable():
            raise InputError(
                f"the sample {sample.name!r}", "a name of printable characters without blanks"
                " around it", remedy="Rename it before it is written as a table.",
            )  # fmt: skip
    files = {"bench.toml": bench_toml(measurement.bench)}
    if all(_in_table(sample) for sample in measurement.samples):
        files["samples.csv"] = _table(
            ("name", "thickness_mm", "n", "material"),
            ((s.name, s.thickness_mm, s.n, s.material or "") for s in measurement.samples),
        )
    else:
        files[SAMPLES_TOML] = "".join(
            f"[[samples]]\n{toml_text(sample.model_dump(mode='json'))}\n"
            for sample in measurement.samples
        )
    if measurement.captures is not None:
        files["captures.csv"] = _captures(measurement.captures)
        if measurement.captures.light_se is not None:
            files[LIGHT_SE] = _light_se(measurement, measurement.captures)
    if measurement.relative is not None:
        files["relative.csv"] = _relative(measurement.relative)
    if measurement.truth is not None:
        files[TRUTH] = _truth(measurement, measurement.truth)
    provenance = measurement.provenance.model_dump(mode="json")
    files[ORIGIN] = toml_text({"fingerprint": measurement.fingerprint, "provenance": provenance})
    return files


def _in_table(sample: Sample) -> bool:
    """Whether samples.csv can hold a sample."""
    named = isinstance(sample.n, str) and not _is_number(sample.n)
    index = isinstance(sample.n, float) and 1.0 <= sample.n <= 5.0
    return (named or index) and (sample.material is None or isinstance(sample.material, str))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _captures(captures: Captures) -> str:
    head = (
        "capture", "sample", "repeat", "wavelength_nm", "counts", "integration_s", "averages",
        "gain", "time_s", "saturated",
    )  # fmt: skip
    return _table(
        head,
        (
            (
                shot.capture, shot.sample, shot.repeat, wavelength, _reading(counts),
                float(shot.integration_s), shot.averages, float(shot.gain), float(shot.time_s),
                int(saturated),
            )
            for shot, row, flags in zip(
                captures.shots, captures.counts, captures.saturated, strict=True
            )
            for wavelength, counts, saturated in zip(
                captures.wavelength_nm, row, flags, strict=True
            )
        ),
    )  # fmt: skip


def _relative(relative: RelativeSpectra) -> str:
    head = ("capture", "sample", "repeat", "wavelength_nm", "value", "sigma")
    return _table(
        head,
        (
            (
                row.capture, row.sample, row.repeat, wavelength, _reading(value),
                "" if np.isnan(sigma) else sigma,
            )
            for row, values, sigmas in zip(
                relative.rows, relative.value, relative.sigma, strict=True
            )
            for wavelength, value, sigma in zip(
                relative.wavelength_nm, values, sigmas, strict=True
            )
        ),
    )  # fmt: skip


def _truth(measurement: Measurement, truth: Truth) -> str:
    return _table(
        tuple(column.name for column in _TRUTH_COLUMNS),
        (
            (sample.name, wavelength, *values)
            for number, sample in enumerate(measurement.samples)
            for wavelength, *values in zip(
                truth.wavelength_nm, truth.albedo[number], truth.sigma_t_per_mm[number],
                truth.g[number], strict=True,
            )
        ),
    )  # fmt: skip


def _light_se(measurement: Measurement, captures: Captures) -> str:
    light_se = captures.light_se if captures.light_se is not None else np.empty((0, 3, 0))
    return _table(
        tuple(column.name for column in _LIGHT_SE_COLUMNS),
        (
            (sample.name, capture, wavelength, value)
            for sample, own in zip(measurement.samples, light_se, strict=True)
            for capture, row in zip(SAMPLE_CAPTURES, own, strict=True)
            for wavelength, value in zip(captures.wavelength_nm, row, strict=True)
        ),
    )


def _reading(value: float) -> float | str:
    return MISSING if np.isnan(value) else value


def _table(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """CSV; floats with as many digits as give the same number back."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    for row in rows:
        writer.writerow([repr(float(cell)) if isinstance(cell, float) else cell for cell in row])
    return text.getvalue()


def bench_toml(bench: Bench) -> str:
    """A bench as TOML with nothing left out: what reads back as the same bench."""
    table = bench.model_dump(mode="json")
    # The one field whose None is not what a missing key means.
    table["size_mm"] = table["size_mm"] or "unbounded"
    return toml_text(table)


def toml_text(table: Mapping[str, Any]) -> str:
    """TOML with a line for every key; None is left out."""
    lines = [f"{_key(key)} = {_value(value)}" for key, value in table.items() if value is not None]
    return "\n".join(lines) + "\n"


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        inside = (f"{_key(k)} = {_value(v)}" for k, v in value.items() if v is not None)
        return "{ " + ", ".join(inside) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return _text(value)
    return repr(value)


def _text(value: str) -> str:
    # What JSON escapes TOML escapes alike, but for this character.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _key(key: str) -> str:
    return key if key.replace("_", "").replace("-", "").isalnum() and key.isascii() else _text(key)
