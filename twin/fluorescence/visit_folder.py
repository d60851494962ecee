"""A fluorescence visit written by hand: a folder with visit.toml and one CSV file of counts.

    visit.toml    sample = "my marker"
                  noise = "instrument"          # or "repeats"
                  [setup]                       # as in a scenario: lights, detector, white ...
                  lights = "L1"
                  detector = "S2"
    counts.csv    kind,illuminant,repeat,integration_s,gain,averages,F1,F2,F3,F4,F5,F6,F7,F8
                  dark,,0,0.278,16,20,3.1,...
                  white,violet,0,0.278,16,20,812.4,...

The columns after the settings are the channels, by their names (a chip) or wavelengths in nm (a
spectrometer). A finer spectrum is read into the bins of the matrix: its counts are averaged over
each bin. repeat, gain and averages may be left out.
"""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from twin.errors import InputError
from twin.files import write_atomically
from twin.fluorescence.readings import check_saturation
from twin.fluorescence.setup import STEP_NM, FluorescenceSetup
from twin.fluorescence.visit import FluorescenceShot, FluorescenceVisit
from twin.instrument import MultispectralChip
from twin.measurement import Provenance
from twin.spectra import FloatArray, Part
from twin.toml import load_toml, read_text

_SETTINGS = ("kind", "illuminant", "repeat", "integration_s", "gain", "averages")
_NEEDED = ("kind", "illuminant", "integration_s")
COUNTS = "counts.csv"


class _Head(Part):
    sample: str = Field(min_length=1)
    noise: str = Field(default="instrument", pattern="^(instrument|repeats)$")
    setup: FluorescenceSetup
    notes: tuple[str, ...] = ()


def read_visit_folder(path: str | Path) -> FluorescenceVisit:
    """Read a visit from a folder with visit.toml and counts.csv; see the module's text.

    Raises:
        InputError: a file that is missing or wrong; says file and line. Channels that are not the
            detector's, in its order.
    """
    folder = Path(path)
    head = load_toml(folder / "visit.toml", _Head)
    file = folder / COUNTS
    rows = list(csv.reader(io.StringIO(read_text(file))))
    rows_with_lines = [
        (number, [field.strip() for field in row])
        for number, row in enumerate(rows, start=1)
        if any(field.strip() for field in row) and not row[0].lstrip().startswith("#")
    ]
    if len(rows_with_lines) < 2:
        raise InputError("no rows", "a line of names and one line for each shot", file=file)
    line, names = rows_with_lines[0]
    missing = [name for name in _NEEDED if name not in names]
    if missing:
        raise InputError(
            f"no column {missing[0]!r}", f"columns {', '.join(_NEEDED)} and the channels",
            file=file, place=f"line {line}",
        )  # fmt: skip
    channels = [name for name in names if name not in _SETTINGS]
    first = names.index(channels[0]) if channels else len(names)
    if any(name in _SETTINGS for name in names[first:]) or not channels:
        raise InputError(
            "settings after channels" if channels else "no channels",
            f"settings ({', '.join(_SETTINGS)}) first, then the channels", file=file,
            place=f"line {line}",
        )  # fmt: skip
    gather, notes = _channels(head.setup, channels, file, line)
    shots, counts = [], []
    for line, row in rows_with_lines[1:]:
        if len(row) != len(names):
            raise InputError(
                f"{len(row)} columns", f"{len(names)}, as in the first line", file=file,
                place=f"line {line}",
            )  # fmt: skip
        shots.append(_shot(dict(zip(names, row, strict=True)), file, line))
        counts.append([_number(value, file, line) for value in row[first:]])
    provenance = Provenance(
        origin="handmade", noise="repeats" if head.noise == "repeats" else "instrument",
        notes=(*head.notes, *notes),
    )  # fmt: skip
    try:
        binned = gather @ np.nan_to_num(np.array(counts), nan=0.0).T
        dead = (gather > 0).astype(float) @ np.isnan(np.array(counts)).T > 0
        value = np.where(dead, np.nan, binned).T
        saturated: NDArray[np.bool_] = np.zeros(value.shape, dtype=bool)
        visit = FluorescenceVisit(
            head.setup, tuple(shots), value, saturated, sample=head.sample, provenance=provenance
        )
        return FluorescenceVisit(
            head.setup, tuple(shots), value, check_saturation(visit), sample=head.sample,
            provenance=provenance,
        )  # fmt: skip
    except InputError as error:
        raise error.at(file) from error


def _channels(
    setup: FluorescenceSetup, channels: list[str], file: Path, line: int
) -> tuple[FloatArray, tuple[str, ...]]:
    """Which columns are averaged into each channel of the detector, (K, columns)."""
    known = setup.channel_names
    place = f"line {line}"
    if isinstance(setup.detector, MultispectralChip):
        if tuple(channels) != known:
            order = sorted(channels) == sorted(known)
            raise InputError(
                f"channels {', '.join(channels)}", f"{', '.join(known)}", file=file, place=place,
                remedy="They are in another order: sort the columns." if order else "",
            )  # fmt: skip
        return np.eye(len(known)), ()
    wavelength = np.array([_number(name, file, line) for name in channels])
    if np.any(np.diff(wavelength) <= 0):
        at = int(np.argmax(np.diff(wavelength) <= 0))
        raise InputError(
            f"{wavelength[at + 1]:g} nm after {wavelength[at]:g} nm", "wavelengths that increase",
            file=file, place=place, remedy="The channels are in the wrong order.",
        )  # fmt: skip
    wanted = np.asarray(setup.detector.wavelength_nm)
    if wavelength.shape == wanted.shape and np.allclose(wavelength, wanted, atol=1e-6):
        return np.eye(wanted.size), ()
    near = np.abs(wanted[:, None] - wavelength[None, :]) <= STEP_NM / 2.0 + 1e-9
    if np.any(near.sum(axis=1) < 2):
        at = int(np.argmax(near.sum(axis=1) < 2))
        raise InputError(
            f"spectra from {wavelength[0]:g} to {wavelength[-1]:g} nm with"
            f" {int(near[at].sum())} samples in the bin of {wanted[at]:g} nm",
            "the detector's wavelengths, or two samples or more in every bin", file=file,
            place=place,
        )  # fmt: skip
    gather = near / near.sum(axis=1, keepdims=True)
    return gather, (f"{wavelength.size} samples of each spectrum averaged into {wanted.size} bins",)


def _shot(row: dict[str, str], file: Path, line: int) -> FluorescenceShot:
    whole = {}
    for name, default in (("repeat", 0), ("averages", 1)):
        value = _number(row.get(name) or str(default), file, line)
        if not value.is_integer():
            raise InputError(f"{name} {value:g}", "a whole number", file=file, place=f"line {line}")
        whole[name] = int(value)
    return FluorescenceShot(
        kind=row["kind"],
        illuminant=row["illuminant"],
        integration_s=_number(row["integration_s"], file, line),
        gain=_number(row.get("gain") or "1", file, line),
        **whole,
    )


def _number(text: str, file: Path, line: int) -> float:
    """A number; "nan" and "" are a missing reading."""
    if text.lower() in ("", "nan"):
        return math.nan
    try:
        value = float(text)
    except ValueError:
        value = math.inf
    if not math.isfinite(value):
        raise InputError(
            repr(text[:40]), "a number", file=file, place=f"line {line}",
            remedy="Write a decimal point." if "," in text else "",
        )  # fmt: skip
    return value


def write_counts_csv(visit: FluorescenceVisit, folder: str | Path) -> Path:
    """Write the counts of a visit as the counts.csv of a hand-made folder; the path is returned.

    Raises:
        InputError: the folder cannot be written.
    """
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow([*_SETTINGS, *visit.setup.channel_names])
    for shot, counts in zip(visit.shots, visit.counts, strict=True):
        settings = [getattr(shot, name) for name in _SETTINGS]
        writer.writerow([*settings, *(repr(float(value)) for value in counts)])
    return write_atomically(Path(folder) / COUNTS, buffer.getvalue().encode())
