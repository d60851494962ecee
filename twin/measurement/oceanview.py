"""ASCII exports of OceanView and SpectraSuite (Ocean Optics / Ocean Insight)."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twin.errors import InputError
from twin.spectra import FloatArray

_BEGIN = re.compile(r">>>>>Begin (Processed )?Spectral Data<<<<<")
_END = re.compile(r">>>>>End (Processed )?Spectral Data<<<<<")
_TIME_UNITS = {"sec": 1.0, "s": 1.0, "msec": 1e-3, "ms": 1e-3, "usec": 1e-6, "us": 1e-6}
_FIRST_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?")


@dataclass(frozen=True)
class OceanViewSettings:
    """What the head of an export says.

    Attributes:
        integration_s: integration time [s].
        averages: scans averaged.
        dark_corrected: whether the program subtracted the dark pixels' mean.
        nonlinearity_corrected: whether it linearised the counts.
        boxcar: half-width [pixels] of the running mean it applied.
        head: every line of the head with a colon, as text by name.
    """

    integration_s: float
    averages: int
    dark_corrected: bool
    nonlinearity_corrected: bool
    boxcar: int
    head: dict[str, str]


def read_oceanview(path: str | Path) -> tuple[FloatArray, FloatArray, OceanViewSettings]:
    """Read one spectrum; decimal points and decimal commas are both understood.

    Returns:
        Wavelengths [nm] (W,), counts (W,), settings.

    Raises:
        InputError: not such a file, cut off, or without integration time; says the line.
    """
    path = Path(path)
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise InputError(
            f"a file that cannot be read ({error.strerror})", "an OceanView export", file=path
        ) from error
    # Names in the head come in the computer's own encoding and do not matter: numbers are ASCII.
    lines = raw.decode("latin-1").removeprefix("\xef\xbb\xbf").splitlines()
    begin = next((i for i, line in enumerate(lines) if _BEGIN.search(line)), None)
    if begin is None:
        raise InputError(
            "no line >>>>>Begin Spectral Data<<<<<", "an ASCII export of OceanView", file=path
        )
    head = {}
    for line in lines[:begin]:
        name, colon, value = line.partition(":")
        if colon:
            head[name.strip()] = value.strip()
    settings = _settings(path, head)
    wavelength, counts = _spectrum(path, lines, begin)
    stated = head.get("Number of Pixels in Spectrum") or head.get("Number of Pixels in File")
    if stated and stated.isascii() and stated.isdigit() and int(stated) != wavelength.size:
        raise InputError(
            f"{wavelength.size} pixels",
            f"{stated}, as the head says",
            file=path,
            remedy="Is the file truncated?",
        )
    return wavelength, counts, settings


def _spectrum(path: Path, lines: list[str], begin: int) -> tuple[FloatArray, FloatArray]:
    rows: list[tuple[float, float]] = []
    for number, line in enumerate(lines[begin + 1 :], start=begin + 2):
        place = f"line {number}"
        if _END.search(line):
            break
        if not line.strip():
            continue
        cells = line.split()
        values = [_number(cell) for cell in cells]
        if len(cells) != 2 or None in values:
            raise InputError(
                f"{line.strip()[:40]!r}",
                "a wavelength [nm] and counts, separated by a tab",
                file=path,
                place=place,
            )
        wavelength, counts = float(values[0] or 0.0), float(values[1] or 0.0)
        if rows and wavelength <= rows[-1][0]:
            raise InputError(
                f"{wavelength:g} nm after {rows[-1][0]:g} nm",
                "wavelengths that increase",
                file=path,
                place=place,
            )
        rows.append((wavelength, counts))
    if not rows:
        raise InputError("no spectrum", "one pixel or more", file=path, place=f"line {begin + 2}")
    table = np.array(rows)
    return table[:, 0].copy(), table[:, 1].copy()


def _number(cell: str) -> float | None:
    if not _FIRST_NUMBER.fullmatch(cell):
        return None
    value = float(cell.replace(",", "."))
    return value if math.isfinite(value) else None


def _settings(path: Path, head: dict[str, str]) -> OceanViewSettings:
    integration = None
    for name, text in head.items():
        match = re.fullmatch(r"Integration Time \((\w+)\)", name)
        if match and match[1].lower() in _TIME_UNITS:
            number = _FIRST_NUMBER.match(text)
            integration = _number(number[0]) if number else None
            if integration is not None:
                integration *= _TIME_UNITS[match[1].lower()]
    if integration is None or not integration > 0:
        raise InputError(
            "no integration time", "a line `Integration Time (sec): ...` in the head", file=path
        )
    return OceanViewSettings(
        integration_s=integration,
        averages=max(_whole(head, 1, "Scans to average", "Spectra Averaged"), 1),
        dark_corrected=_yes(
            head, "Electric dark correction enabled", "Correct for Electrical Dark"
        ),
        nonlinearity_corrected=_yes(
            head, "Nonlinearity correction enabled", "Correct for Detector Non-linearity"
        ),
        boxcar=_whole(head, 0, "Boxcar width", "Boxcar Smoothing"),
        head=head,
    )


def _whole(head: dict[str, str], default: int, *keys: str) -> int:
    for key in keys:
        match = re.match(r"\d{1,9}", head.get(key, ""), re.ASCII)
        if match:
            return int(match[0])
    return default


def _yes(head: dict[str, str], *keys: str) -> bool:
    return any(head.get(key, "").lower().startswith(("true", "yes")) for key in keys)
