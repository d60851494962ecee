"""A folder of exports, one spectrum each, whose names say what they are.

    files.toml      how the names are made: pattern = "{sample}_{capture}_{repeat}.txt"
    samples.csv     the samples
    *.txt, *.jdx    exports of OceanView or SpectraSuite (ASCII), or JCAMP-DX files

Every key of files.toml: docs/measurement.md.
"""

from __future__ import annotations

import datetime
import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from twin.bench import Bench
from twin.errors import InputError
from twin.instrument import saturation_counts
from twin.measurement.file_names import FILE, Named, NamedFiles, check_complete, named_files
from twin.measurement.jcamp import is_jcamp, read_jcamp
from twin.measurement.model import Captures, Shot, label
from twin.measurement.oceanview import read_oceanview
from twin.spectra import FloatArray
from twin.toml import load_toml, near_misses

_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
_COUNTS = ("COUNT", "INTENSITY", "ARBITRARY", "SCOPE", "A.U")
"""What YUNITS of raw counts contains; transmittance, absorbance and the like are no counts."""
_DATE = re.compile(r"(?:\w{3} )?(\w{3}) +(\d{1,2}) (\d\d):(\d\d):(\d\d)(?: \S+)? (\d{4})", re.ASCII)
_MONTHS = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")


@dataclass(frozen=True)
class _Read:
    """One file: its shot, its spectrum, and what its program did to the counts."""

    named: Named
    shot: Shot
    wavelength_nm: FloatArray
    counts: FloatArray
    processing: tuple[tuple[str, str], ...]
    time: datetime.datetime | None


def read_named_files(
    folder: Path, known: list[str], bench: Bench, *, described: bool
) -> tuple[Captures, list[str]]:
    """Read every spectrum of a folder that files.toml describes.

    Args:
        folder: the folder.
        known: names of the samples.
        bench: its instrument says which counts are saturated.
        described: whether somebody described that instrument.

    Returns:
        The captures, and notes about what the programs did to the counts.

    Raises:
        InputError: a file whose name says nothing or two things, one that is missing, or one that
            cannot be read; always named.
    """
    rules = load_toml(folder / FILE, NamedFiles)
    for name in rules.samples.values():
        if name not in known:
            raise InputError(
                f"{name!r}", f"a name from the table of samples: {', '.join(known)}",
                file=folder / FILE, place="samples", remedy=near_misses(name, known),
            )  # fmt: skip
    named = named_files(folder, rules, known)
    check_complete(folder, rules, named, known)
    read = [_read(each, rules) for each in named]
    _check_alike(read)
    _check_twice(read)
    notes = _notes(read)
    if dict(read[0].processing)["linearised"] == "yes" and described:
        instrument = bench.instrument
        if instrument.has("nonlinearity") and instrument.nonlinearity != 0:
            raise InputError(
                "counts that the program has linearised, and a nonlinearity of the instrument",
                'off = ["nonlinearity"] in [instrument] of bench.toml', file=read[0].named.path,
            )  # fmt: skip
    read = _in_order(read, notes)
    counts = np.array([each.counts for each in read])
    full = saturation_counts(bench.instrument)
    if np.any(counts >= full):
        notes.append(f"counts of {full:g} and more taken as saturated")
    shots = tuple(each.shot for each in read)
    return Captures(shots, read[0].wavelength_nm, counts, counts >= full), notes


def _read(named: Named, rules: NamedFiles) -> _Read:
    path = named.path
    if is_jcamp(path):
        wavelength, counts, jcamp = read_jcamp(path, block=rules.block)
        if not any(word in jcamp.y_units.upper() for word in _COUNTS):
            raise InputError(
                f"##YUNITS= {jcamp.y_units or 'nothing'}", "COUNTS (raw counts, dark included)",
                file=path, remedy="Ratios of your own go into relative.csv.",
            )  # fmt: skip
        in_head = None
        if jcamp.acquisition is not None and rules.integration_unit is not None:
            in_head = jcamp.acquisition * _SECONDS[rules.integration_unit]
        elif jcamp.acquisition is not None and named.integration_s is None:
            raise InputError(
                f"##.ACQUISITION TIME= {jcamp.acquisition:g} without a unit",
                f'integration_unit = "ms" (or "s", "us") in {FILE}', file=path,
            )  # fmt: skip
        averages, time = jcamp.averages, None
        dark = re.search(r"DARK:\s*(\w+)", jcamp.head.get("DATAPROCESSING", ""))
        processing = {
            "dark": "yes" if dark and dark[1].lower() in ("yes", "true") else "no",
            "linearised": "no", "boxcar": str(jcamp.boxcar),
        }  # fmt: skip
    else:
        wavelength, counts, ocean = read_oceanview(path)
        in_head, averages = ocean.integration_s, ocean.averages
        time = _date(ocean.head.get("Date", ""))
        processing = {
            "dark": "yes" if ocean.dark_corrected else "no",
            "linearised": "yes" if ocean.nonlinearity_corrected else "no",
            "boxcar": str(ocean.boxcar),
        }  # fmt: skip
    shot = Shot(
        capture=named.capture,
        integration_s=_time(named, in_head, rules),
        sample=named.sample,
        repeat=named.repeat,
        averages=averages,
    )
    return _Read(named, shot, wavelength, counts, tuple(processing.items()), time)


def _time(named: Named, in_head: float | None, rules: NamedFiles) -> float:
    """Integration time [s]: of head, name, or files.toml."""
    in_name = named.integration_s
    if in_head is not None and in_name is not None and abs(in_head / in_name - 1) > 1e-3:
        raise InputError(
            f"{in_name:g} s in its name and {in_head:g} s in its head", "the same in both",
            file=named.path,
        )  # fmt: skip
    for value in (in_head, in_name, rules.integration_s):
        if value is not None and value > 0:
            return value
    raise InputError(
        "no integration time", f"one in its head, in its name, or as integration_s in {FILE}",
        file=named.path,
    )  # fmt: skip


def _date(text: str) -> datetime.datetime | None:
    """Date and time in the computer's own zone, as OceanView writes them; None for others."""
    match = _DATE.fullmatch(text.strip())
    if match is None or match[1] not in _MONTHS:
        return None
    month, (day, hour, minute, second, year) = match[1], map(int, match.groups()[1:])
    try:
        return datetime.datetime(year, _MONTHS.index(month) + 1, day, hour, minute, second)
    except ValueError:
        return None


def _check_alike(read: list[_Read]) -> None:
    """All spectra have the same pixels, and were treated alike."""
    first = read[0]
    for each in read[1:]:
        wavelength = each.wavelength_nm
        if not np.array_equal(wavelength, first.wavelength_nm):
            raise InputError(
                f"{wavelength.size} wavelengths from {wavelength[0]:g} to {wavelength[-1]:g} nm",
                f"those of {first.named.path.name}: {first.wavelength_nm.size} from"
                f" {first.wavelength_nm[0]:g} to {first.wavelength_nm[-1]:g} nm",
                file=each.named.path, remedy="Is it of another spectrometer?",
            )  # fmt: skip
        for (what, value), (_, other) in zip(each.processing, first.processing, strict=True):
            if value != other:
                raise InputError(
                    f"{_TREATED[what]}: {value}", f"{other}, as in {first.named.path.name}",
                    file=each.named.path, remedy="Export all spectra with the same processing.",
                )  # fmt: skip


_TREATED = {
    "dark": "electric dark correction",
    "linearised": "nonlinearity correction",
    "boxcar": "boxcar width",
}


def _check_twice(read: list[_Read]) -> None:
    seen: dict[tuple[str, str, int, float], Path] = {}
    for each in read:
        shot = each.shot
        key = (shot.capture, shot.sample, shot.repeat, shot.integration_s)
        if key in seen:
            raise InputError(
                f"two files that are {label(shot.capture, shot.sample)}, repeat {shot.repeat}:"
                f" {seen[key].name} and {each.named.path.name}", "one of them",
                file=each.named.path.parent,
            )  # fmt: skip
        seen[key] = each.named.path


def _notes(read: list[_Read]) -> list[str]:
    """What the program did to the counts before it wrote them."""
    done = dict(read[0].processing)
    notes = []
    if done["dark"] == "yes":
        notes.append(
            "the counts come with the mean of the dark pixels, or a dark, subtracted: saturation"
            " is seen only where full scale is still reached"
        )
    if done["boxcar"] != "0":
        notes.append(
            f"the counts are smoothed over {2 * int(done['boxcar']) + 1} pixels: noise of"
            " neighbours is correlated, which the stated uncertainty does not hold"
        )
    return notes


def _in_order(read: list[_Read], notes: list[str]) -> list[_Read]:
    """In the order of their dates, with times since the first; without dates that of the names."""
    times = [each.time for each in read if each.time is not None]
    if len(times) < len(read):
        notes.append(
            "not every file says when it was taken: the order of their names stands for it"
        )
        return read
    start = min(times)
    timed = [
        replace(each, shot=replace(each.shot, time_s=(time - start).total_seconds()))
        for each, time in zip(read, times, strict=True)
    ]
    return sorted(timed, key=lambda each: (each.shot.time_s, each.named.path.name))
