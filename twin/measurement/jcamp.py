"""JCAMP-DX spectra: one block as wavelengths and values.

The format: McDonald and Wilks 1988, "JCAMP-DX: A Standard Form for Exchange of Infrared Spectra in
Computer Readable Form", Applied Spectroscopy 42, 151 (version 4.24). Read are the tables
(X++(Y..Y)) in every form of its section 5 (AFFN, FIX, PAC, SQZ, DIF, DUP) and (XY..XY), the decimal
commas that SpectraSuite writes, and files of several blocks.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from twin.errors import InputError
from twin.measurement.jcamp_table import Line, decoded_lines, pairs
from twin.spectra import FloatArray

_RECORD = re.compile(r"\s*##(?P<label>[^=]*)=(?P<value>.*)")
_NM_PER_UNIT = {
    "NANOMETERS": 1.0, "NANOMETRES": 1.0, "NANOMETER": 1.0, "NM": 1.0,
    "MICROMETERS": 1e3, "MICROMETRES": 1e3, "MICROMETER": 1e3, "MICRONS": 1e3, "UM": 1e3,
}  # fmt: skip
_WAVENUMBER = ("1/CM", "CM-1", "CM^-1", "WAVENUMBERS")
_NM_CM = 1e7
"""Wavelength [nm] times wavenumber [1/cm]."""
_TABLES = ("XYDATA", "XYPOINTS")
_REFUSED = ("PEAKTABLE", "PEAKASSIGNMENTS", "NTUPLES", "RADATA")
_INCREASING, _PAIRS = "(X++(Y..Y))", "(XY..XY)"


@dataclass(frozen=True)
class JcampSettings:
    """What the head of a block says.

    Attributes:
        title: of the block.
        y_units: text of YUNITS, such as "COUNTS".
        acquisition: number in .ACQUISITION TIME, None without it; the format gives it no unit.
        averages: spectra averaged.
        boxcar: half-width [pixels] of a running mean that SpectraSuite applied.
        head: every record of the block but the table, as text by normalised label (capitals,
            without blanks, hyphens, strokes and underscores).
    """

    title: str
    y_units: str
    acquisition: float | None
    averages: int
    boxcar: int
    head: dict[str, str]


@dataclass
class _Block:
    """The records of one block while they are collected."""

    line: int
    head: dict[str, str] = field(default_factory=dict)
    lines: dict[str, int] = field(default_factory=dict)
    table: str = ""
    form: str = ""
    rows: list[Line] = field(default_factory=list)


def read_jcamp(
    path: str | Path, *, block: int | None = None
) -> tuple[FloatArray, FloatArray, JcampSettings]:
    """Read one spectrum; wavelengths increase whatever the order in the file.

    Args:
        path: the file.
        block: which spectrum of a file that holds several, from 1; None: the only one.

    Returns:
        Wavelengths [nm] (W,), values times YFACTOR in the units of the file (W,), settings.

    Raises:
        InputError: not such a file, cut off, or its numbers contradict its head; says the line.
    """
    path = Path(path)
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise InputError(
            f"a file that cannot be read ({error.strerror})", "a JCAMP-DX file", file=path
        ) from error
    text = raw.decode("latin-1").removeprefix("\xef\xbb\xbf")
    chosen = _chosen(path, _blocks(path, text), block)
    wavelength, value = _spectrum(path, chosen)
    return wavelength, value, _settings(chosen)


def is_jcamp(path: Path) -> bool:
    """Whether a file begins as a JCAMP-DX file does, with ##TITLE=."""
    try:
        with path.open("rb") as stream:
            start = stream.read(256).decode("latin-1").removeprefix("\xef\xbb\xbf")
    except OSError:
        return False
    match = _RECORD.match(start)
    return match is not None and _normalised(match["label"]) == "TITLE"


def _normalised(label: str) -> str:
    return re.sub(r"[\s\-/_]", "", label).upper()


def _blocks(path: Path, text: str) -> list[_Block]:
    """Blocks that hold a table; those that only link others are left out."""
    blocks: list[_Block] = []
    current: _Block | None = None
    in_table = False
    for number, full in enumerate(text.splitlines(), start=1):
        line = full.partition("$$")[0].rstrip()
        match = _RECORD.match(line)
        if match is None:
            if current is None and line.strip():
                raise InputError(
                    f"{line.strip()[:40]!r}", "##TITLE= in the first line of a JCAMP-DX file",
                    file=path, place=f"line {number}",
                )  # fmt: skip
            if current is not None and in_table and line.strip():
                current.rows.append(Line(number, line))
            continue
        label, value = _normalised(match["label"]), match["value"].strip()
        in_table = False
        if label == "":
            continue
        if label == "TITLE":
            current = _Block(number)
            blocks.append(current)
        if current is None:
            raise InputError(
                f"##{match['label']}= before ##TITLE=", "##TITLE= first",
                file=path, place=f"line {number}",
            )  # fmt: skip
        if label in _REFUSED:
            raise InputError(
                f"a table ##{match['label'].strip()}=", "##XYDATA= or ##XYPOINTS=, a spectrum",
                file=path, place=f"line {number}",
            )  # fmt: skip
        if label in _TABLES:
            current.table, current.form = label, value.upper().replace(" ", "")
            in_table = True
        # SpectraSuite writes some labels twice: both are kept.
        current.head[label] = f"{current.head[label]}; {value}" if label in current.head else value
        current.lines.setdefault(label, number)
    if not blocks:
        raise InputError("no ##TITLE=", "a JCAMP-DX file", file=path)
    found = [each for each in blocks if each.table]
    if not found:
        raise InputError(
            "no ##XYDATA= and no ##XYPOINTS=", "a spectrum", file=path,
            remedy="Is the file truncated?",
        )  # fmt: skip
    return found


def _chosen(path: Path, blocks: list[_Block], block: int | None) -> _Block:
    if block is None and len(blocks) > 1:
        titles = "; ".join(
            f"{number}: {each.head['TITLE']}" for number, each in enumerate(blocks, 1)
        )
        raise InputError(
            f"{len(blocks)} spectra ({titles})", "one, or the number of the one that is meant",
            file=path, place="block",
        )  # fmt: skip
    number = 1 if block is None else block
    if not 1 <= number <= len(blocks):
        raise InputError(
            f"block {number}", f"a number of 1 to {len(blocks)}", file=path, place="block"
        )
    return blocks[number - 1]


def _spectrum(path: Path, block: _Block) -> tuple[FloatArray, FloatArray]:
    place = f"line {block.lines[block.table]}"
    x_factor, y_factor = _factor(path, block, "XFACTOR"), _factor(path, block, "YFACTOR")
    comma = any("," in block.head.get(key, "") for key in ("FIRSTX", "LASTX", "FIRSTY"))
    if block.form == _INCREASING:
        x, y = _increasing(path, block, x_factor, comma=comma)
    elif block.form == _PAIRS:
        x, y = pairs(path, block.rows, comma=comma)
        x = x * x_factor
        _check_points(path, block, x)
    else:
        raise InputError(
            f"a table of the form {block.form or 'nothing'}", f"{_INCREASING} or {_PAIRS}",
            file=path, place=place,
        )  # fmt: skip
    y = y * y_factor
    first = _number(path, block, "FIRSTY")
    if first is not None and abs(first - y[0]) > abs(y_factor) + 1e-3 * abs(first):
        raise InputError(
            f"the first ordinate {y[0]:g}", f"##FIRSTY= {first:g}", file=path,
            place=f"line {block.rows[0].number}", remedy="Is ##YFACTOR= right?",
        )  # fmt: skip
    return _in_nm(path, block, x, y)


def _increasing(
    path: Path, block: _Block, x_factor: float, *, comma: bool
) -> tuple[FloatArray, FloatArray]:
    """A table of equal steps: its abscissas follow from the head, those in it are checks."""
    first = _required(path, block, "FIRSTX")
    last = _required(path, block, "LASTX")
    points = _points(path, block)
    if points is None:
        raise _no(path, block, "NPOINTS")
    if (points > 1) == (first == last):
        raise InputError(
            f"{points} points from {first:g} to {last:g}", "ends that fit ##NPOINTS=",
            file=path, place=f"line {block.lines['NPOINTS']}",
        )  # fmt: skip
    x = np.linspace(first, last, points)
    step = abs(last - first) / max(points - 1, 1)
    values: list[float] = []
    for row in decoded_lines(path, block.rows, comma=comma):
        at = len(values) - (1 if row.checks else 0)
        room = 0.5 * step + row.x_rounding * abs(x_factor)
        # The abscissa of a line that begins with a check is that of the check; some write that
        # of the first new point.
        candidates = x[at : at + (2 if row.checks else 1)]
        seen = row.x * x_factor
        if candidates.size == 0:
            if row.ordinates:
                raise _too_many(path, row.number, points)
        elif np.abs(candidates - seen).min() > room:
            raise InputError(
                f"the abscissa {seen:g} at point {at + 1}",
                f"{candidates[0]:g}, by ##FIRSTX=, ##LASTX= and ##NPOINTS=", file=path,
                place=f"line {row.number}", remedy="Is a line missing?",
            )  # fmt: skip
        values += row.ordinates
        if len(values) > points:
            raise _too_many(path, row.number, points)
    if len(values) != points:
        raise InputError(
            f"{len(values)} points", f"{points}, as ##NPOINTS= says", file=path,
            place=f"line {block.lines['NPOINTS']}", remedy="Is the file truncated?",
        )  # fmt: skip
    return x, np.array(values)


def _too_many(path: Path, line: int, points: int) -> InputError:
    return InputError(
        f"more than {points} points", f"{points}, as ##NPOINTS= says", file=path,
        place=f"line {line}",
    )  # fmt: skip


def _check_points(path: Path, block: _Block, x: FloatArray) -> None:
    """NPOINTS, FIRSTX and LASTX against a table of pairs."""
    points = _points(path, block)
    if points is not None and points != x.size:
        raise InputError(
            f"{x.size} points", f"{points}, as ##NPOINTS= says", file=path,
            place=f"line {block.lines['NPOINTS']}", remedy="Is the file truncated?",
        )  # fmt: skip
    for label, value, step in (
        ("FIRSTX", x[0], np.diff(x[:2]).sum()), ("LASTX", x[-1], np.diff(x[-2:]).sum()),
    ):  # fmt: skip
        stated = _number(path, block, label)
        if stated is not None and abs(stated - value) > 0.5 * abs(step) + 1e-6 * abs(value):
            raise InputError(
                f"the abscissa {value:g}", f"##{label}= {stated:g}", file=path,
                place=f"line {block.lines[label]}", remedy="Is ##XFACTOR= right?",
            )  # fmt: skip


def _in_nm(
    path: Path, block: _Block, x: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray]:
    units = block.head.get("XUNITS", "")
    place = f"line {block.lines.get('XUNITS', block.line)}"
    name = units.upper().replace(" ", "")
    if name in _WAVENUMBER:
        if np.any(x <= 0):
            raise InputError(
                f"a wavenumber of {x.min():g}", "numbers above 0 [1/cm]", file=path, place=place
            )
        wavelength = _NM_CM / x
    elif name in _NM_PER_UNIT:
        wavelength = x * _NM_PER_UNIT[name]
    else:
        raise InputError(
            f"##XUNITS= {units}" if units else "no ##XUNITS=",
            "NANOMETERS, MICROMETERS or 1/CM", file=path, place=place,
        )  # fmt: skip
    if wavelength.size > 1 and wavelength[-1] < wavelength[0]:
        wavelength, y = wavelength[::-1], y[::-1]
    falls = np.diff(wavelength) <= 0
    if np.any(falls):
        at = int(np.argmax(falls))
        raise InputError(
            f"{wavelength[at + 1]:g} nm beside {wavelength[at]:g} nm",
            "wavelengths that increase, or decrease, all along", file=path,
            place=f"line {block.lines[block.table]}",
        )  # fmt: skip
    return wavelength.copy(), y.copy()


def _settings(block: _Block) -> JcampSettings:
    head = {key: value for key, value in block.head.items() if key not in _TABLES}
    averages = re.match(r"\d{1,9}", head.get(".AVERAGES", ""), re.ASCII)
    boxcar = re.search(r"BOXCAR:\s*(\d{1,9})", head.get("DATAPROCESSING", ""), re.ASCII)
    return JcampSettings(
        title=head["TITLE"],
        y_units=head.get("YUNITS", ""),
        acquisition=_float(head.get(".ACQUISITIONTIME", "")),
        averages=max(int(averages[0]), 1) if averages else 1,
        boxcar=int(boxcar[1]) if boxcar else 0,
        head=head,
    )


def _float(text: str) -> float | None:
    try:
        value = float(text.strip().replace(",", "."))
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _factor(path: Path, block: _Block, label: str) -> float:
    value = _number(path, block, label)
    return 1.0 if value is None else value


def _number(path: Path, block: _Block, label: str) -> float | None:
    if not block.head.get(label):
        return None
    value = _float(block.head[label])
    if value is None or (label.endswith("FACTOR") and value == 0):
        raise InputError(
            f"##{label}= {block.head[label]}", "a number", file=path,
            place=f"line {block.lines[label]}",
        )  # fmt: skip
    return value


def _required(path: Path, block: _Block, label: str) -> float:
    value = _number(path, block, label)
    if value is None:
        raise _no(path, block, label)
    return value


def _no(path: Path, block: _Block, label: str) -> InputError:
    return InputError(
        f"no ##{label}=", f"it before ##{block.table}=", file=path, place=f"line {block.line}"
    )


def _points(path: Path, block: _Block) -> int | None:
    text = block.head.get("NPOINTS", "")
    if not text:
        return None
    if not re.fullmatch(r"\d{1,8}", text, re.ASCII) or int(text) < 1:
        raise InputError(
            f"##NPOINTS= {text}", "a whole number of 1 or more", file=path,
            place=f"line {block.lines['NPOINTS']}",
        )  # fmt: skip
    return int(text)
