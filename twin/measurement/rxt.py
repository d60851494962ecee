"""Files `.rxt` of the inverse adding-doubling community (IAD; Prahl, 1995 to 2024).

A file begins with IAD1. Then numbers follow, in one order, with comments from # to the end of
a line wherever one likes: refractive index of the sample and of the slides, thickness [mm] of
the sample and of each slide, diameter [mm] of the beam, reflectance of the standard, number of
spheres, and for the reflection and the transmission sphere each the diameter, the ports for
sample, entrance (third port) and detector [mm] and the wall's reflectance. Then either how
many readings a row has (1 to 7: M_R, M_T, M_U, r_w, t_w, r_std, t_std; a row may begin with a
wavelength) or one letter per column (L r t u n N d D B R T w W g i c C S ...). Then the rows.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.spectra import FloatArray
from twin.spheres.sphere import IntegratingSphere

READINGS = ("M_R", "M_T", "M_U")
"""Order of the readings along every axis of length three."""
LARGEST_BYTES = 50_000_000

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_HEADER = (
    ("n", "refractive index of the sample", 1.0, 4.0),
    ("slide_n", "refractive index of the slides (0 or 1: none)", 0.0, 4.0),
    ("thickness", "thickness of the sample [mm]", 1e-6, 1e6),
    ("slide_thickness", "thickness of a slide [mm]", 0.0, 1e6),
    ("beam", "diameter of the beam [mm]", 0.0, 1e6),
    ("standard", "reflectance of the standard", 1e-6, 1.0),
    ("spheres", "number of spheres", 0.0, 2.0),
)
_SPHERE = (
    ("diameter of the sphere [mm]", 1e-6, 1e6),
    ("diameter of the sample port [mm]", 0.0, 1e6),
    ("diameter of the third port [mm]", 0.0, 1e6),
    ("diameter of the detector port [mm]", 0.0, 1e6),
    ("reflectance of the wall", 0.0, 1.0),
)
_COUNTED = "rtuwWRT"
# letter -> (meaning, lowest, highest); readings are masked, not refused, outside 0 to 1
_COLUMNS = {
    "L": ("wavelength [nm]", 1e-3, 1e7),
    "n": ("refractive index of the sample", 1.0, 4.0),
    "N": ("refractive index of the slides", 0.0, 4.0),
    "d": ("thickness of the sample [mm]", 1e-6, 1e6),
    "D": ("thickness of a slide [mm]", 0.0, 1e6),
    "E": ("optical thickness of a slide", 0.0, 100.0),
    "B": ("diameter of the beam [mm]", 0.0, 1e6),
    "R": ("reflectance of the reflectance standard", 1e-6, 1.0),
    "T": ("reflectance of the transmittance standard", 1e-6, 1.0),
    "w": ("reflectance of the reflection sphere's wall", 0.0, 1.0),
    "W": ("reflectance of the transmission sphere's wall", 0.0, 1.0),
    "g": ("anisotropy factor", -0.999, 0.999),
    "i": ("angle of incidence [degrees]", 0.0, 89.99),
    "c": ("collected share of unscattered reflected light", 0.0, 1.0),
    "C": ("collected share of unscattered transmitted light", 0.0, 1.0),
    "S": ("number of spheres", 0.0, 2.0),
}
_CONSTRAINTS = dict.fromkeys("aAbFeqM", "steers the search of the program iad")


@dataclass(frozen=True, eq=False, kw_only=True)
class SphereVisit:
    """One visit with integrating spheres, W rows in the order of the file.

    A reading that is absent, or masked because it cannot be one, is NaN.
    """

    file: str
    wavelength_nm: FloatArray
    """Wavelengths [nm], shape (W,); NaN where the file has none."""
    row_line: NDArray[np.int_]
    """Line of the file that each row comes from, shape (W,)."""
    value: FloatArray
    """M_R, M_T and M_U, shape (W, 3)."""
    valid: NDArray[np.bool_]
    """Which readings are there and possible, shape (W, 3)."""
    measured: tuple[str, ...]
    """Which of `READINGS` have a column."""
    n: FloatArray
    """Refractive index of the sample, shape (W,)."""
    slide_n: FloatArray
    """Refractive index of both slides, 1 without slides, shape (W,)."""
    thickness_mm: FloatArray
    """Thickness of the sample [mm], shape (W,)."""
    slide_thickness_mm: FloatArray
    """Thickness of each slide [mm], 0 without slides, shape (W,)."""
    slide_depth: FloatArray
    """Optical thickness of each slide, shape (W,)."""
    beam_mm: FloatArray
    """Diameter of the beam [mm], shape (W,)."""
    standard_r: FloatArray
    """Reflectance of the reflectance standard, shape (W,)."""
    standard_t: FloatArray
    """Reflectance of what closes the third port of the transmission sphere, shape (W,)."""
    wall_r: FloatArray
    """Reflectance of the reflection sphere's wall, shape (W,); 0 where it is not described."""
    wall_t: FloatArray
    """Reflectance of the transmission sphere's wall, shape (W,); likewise."""
    g: FloatArray
    """Anisotropy factor that the file gives, shape (W,), or NaN."""
    spheres: int
    """Number of spheres used at a time: 0, 1 or 2."""
    reflection_sphere: IntegratingSphere | None
    transmission_sphere: IntegratingSphere | None
    incidence_deg: float = 0.0
    """Angle of the beam to the normal [degrees]: of the file's column, else 0."""
    unscattered_in_r: float = 1.0
    unscattered_in_t: float = 1.0
    reasons: tuple[str, ...] = ()
    """What was masked, counted, and what was left unused."""
    comments: tuple[str, ...] = ()
    """Whole lines of comment, without #."""

    @property
    def rows(self) -> int:
        """Number of rows W."""
        return len(self.n)


@dataclass(frozen=True)
class _Token:
    text: str
    line: int


class _Reader:
    """Numbers of a file one by one, with errors that say where."""

    def __init__(self, path: str, lines: list[str]) -> None:
        self.path = path
        self.lines = [line.partition("#")[0] for line in lines]
        self.tokens = [
            _Token(text, number)
            for number, line in enumerate(self.lines, start=1)
            for text in line.split()
        ]
        self.at = 0
        self.last_line = len(lines)

    def fail(self, line: int, found: str, expected: str, remedy: str = "") -> NoReturn:
        raise InputError(found, expected, file=self.path, place=f"line {line}", remedy=remedy)

    def next(self, meaning: str) -> _Token:
        if self.at >= len(self.tokens):
            self.fail(self.last_line, "the end of the file", meaning, "Is the file cut off?")
        self.at += 1
        return self.tokens[self.at - 1]

    def number(self, meaning: str, low: float, high: float) -> tuple[float, int]:
        token = self.next(meaning)
        value = self.convert(token, meaning)
        if not low <= value <= high:
            self.fail(token.line, f"{token.text[:40]!r}", f"{meaning}, {low:g} to {high:g}")
        return value, token.line

    def convert(self, token: _Token, meaning: str) -> float:
        """A finite number, or NaN for the word nan."""
        if token.text.lower() in ("nan", "+nan", "-nan"):
            return math.nan
        value = float(token.text) if _NUMBER.fullmatch(token.text) else math.inf
        if not math.isfinite(value):
            remedy = "Write a decimal point and no separators." if "," in token.text else ""
            self.fail(token.line, f"{token.text[:40]!r}", f"a number: {meaning}", remedy)
        return value


def read_rxt(path: str | Path) -> SphereVisit:
    """Read one `.rxt` file.

    Raises:
        InputError: not such a file, cut off, or with a number that cannot be; says the line.
            Readings outside 0 to 1 are masked and counted instead.
    """
    path = Path(path)
    try:
        if path.stat().st_size > LARGEST_BYTES:
            raise InputError("a file above 50 MB", "an .rxt file of IAD", file=path)
        raw = path.read_bytes()
    except OSError as error:
        raise InputError(
            f"a file that cannot be read ({error.strerror})", "an .rxt file of IAD", file=path
        ) from error
    return parse_rxt(raw, path)


def parse_rxt(raw: bytes, path: str | Path = "") -> SphereVisit:
    """The same from bytes; `path` is for messages."""
    path = str(path)
    # comments come in the computer's own encoding and do not matter: numbers are ASCII
    text = raw.decode("latin-1").removeprefix("\xef\xbb\xbf")
    lines = re.split(r"\r\n|\r|\n", text)
    if not lines[0].startswith("IAD1"):
        raise InputError(
            f"{lines[0][:20]!r} at the start", "IAD1, the mark of an .rxt file",
            file=path, place="line 1",
        )  # fmt: skip
    lines[0] = lines[0][4:]
    reader = _Reader(path, lines)
    head = {name: reader.number(text, low, high) for name, text, low, high in _HEADER}
    spheres, line = head["spheres"]
    if spheres != int(spheres):
        reader.fail(line, f"{spheres:g} spheres", "0, 1 or 2")
    described = _spheres(reader, int(spheres))
    letters, counted = _columns(reader)
    table, row_line = _rows(reader, letters, counted)
    comments = tuple(line.strip()[1:].strip() for line in lines if line.strip().startswith("#"))
    return _visit(reader, {k: v[0] for k, v in head.items()}, described, table, row_line, comments)


def _spheres(reader: _Reader, count: int) -> tuple[IntegratingSphere, IntegratingSphere] | None:
    """Both spheres; without spheres their description may be left out."""
    if count == 0:
        following = reader.tokens[reader.at : reader.at + 1]
        # no sphere is 7 mm wide, no file has more than 7 readings in a row
        short = following and (
            not _NUMBER.fullmatch(following[0].text) or float(following[0].text) <= 7.0
        )
        if short:
            return None
    found = []
    for which in ("reflection", "transmission"):
        values: list[float] = []
        line = 0
        for meaning, low, high in _SPHERE:
            value, line = reader.number(f"{meaning}, {which} sphere", low, high)
            values.append(value)
        try:
            size, sample, third, detector, wall = values
            found.append(IntegratingSphere(size, sample, third, detector, wall))
        except InputError as error:
            raise InputError(
                f"{error.found} ({error.place})", error.expected,
                file=reader.path, place=f"line {line}",
            ) from error  # fmt: skip
    return found[0], found[1]


def _columns(reader: _Reader) -> tuple[str, bool]:
    """Letters of the columns, and whether they come from a number of readings."""
    token = reader.next("the number of readings in a row, or letters of columns")
    if re.fullmatch(r"[1-7]", token.text):
        return _COUNTED[: int(token.text)], True
    text = "".join(reader.lines[token.line - 1].split()).replace("-", "")
    if not re.fullmatch(r"[A-Za-z]+", text) or any(
        t.line == token.line for t in reader.tokens[: reader.at - 1]
    ):
        reader.fail(
            token.line, f"{token.text[:40]!r}",
            "the number of readings in a row (1 to 7), or letters of columns such as L r t",
        )  # fmt: skip
    known = {**{k: v[0] for k, v in _COLUMNS.items()}, **_CONSTRAINTS}
    for letter in text:
        if letter not in known and letter not in "rtu":
            reader.fail(token.line, f"column {letter!r}", f"letters of {' '.join('rtu')} "
                        f"{' '.join(sorted(known))}")  # fmt: skip
        if text.count(letter) > 1:
            reader.fail(token.line, f"column {letter!r} twice", "every column once")
    if not set(text) & set("rtu"):
        reader.fail(token.line, f"columns {text[:40]}", "at least one of r, t and u")
    while reader.at < len(reader.tokens) and reader.tokens[reader.at].line == token.line:
        reader.at += 1
    return text, False


def _rows(
    reader: _Reader, letters: str, counted: bool
) -> tuple[dict[str, FloatArray], NDArray[np.int_]]:
    """Columns by letter, (W,) each, and the line of every row."""
    by_line: dict[int, list[_Token]] = {}
    for token in reader.tokens[reader.at :]:
        by_line.setdefault(token.line, []).append(token)
    if not by_line:
        reader.fail(reader.last_line, "no rows", "at least one row of readings")
    rows: list[list[float]] = []
    row_line: list[int] = []
    width, waved = len(letters), None
    for line, tokens in by_line.items():
        values = [reader.convert(token, "a reading") for token in tokens]
        with_wave = (
            counted
            and len(values) % (width + 1) == 0
            and all(v > 1.0 for v in values[:: width + 1])
        )
        each = width + 1 if with_wave else width
        if len(values) % each:
            reader.fail(
                line, f"{len(values)} numbers",
                f"{width} in a row" + (", or one more with a wavelength first" if counted else ""),
            )  # fmt: skip
        if waved is not None and waved != with_wave:
            reader.fail(line, "a row " + ("with" if with_wave else "without") + " a wavelength",
                        "the same kind of rows all through")  # fmt: skip
        waved = with_wave
        for start in range(0, len(values), each):
            rows.append(values[start : start + each])
            row_line.append(line)
    names = ("L" if waved else "") + letters
    table = dict(zip(names, np.array(rows, dtype=np.float64).T, strict=True))
    lines = np.array(row_line)
    for letter, values_of in table.items():
        if letter in _COLUMNS:
            meaning, low, high = _COLUMNS[letter]
            bad = ~((values_of >= low) & (values_of <= high))
            if bad.any():
                at = int(np.argmax(bad))
                reader.fail(int(lines[at]), f"{values_of[at]:g} in column {letter}",
                            f"{meaning}, {low:g} to {high:g}")  # fmt: skip
    return table, lines


def _visit(
    reader: _Reader,
    head: dict[str, float],
    described: tuple[IntegratingSphere, IntegratingSphere] | None,
    table: dict[str, FloatArray],
    row_line: NDArray[np.int_],
    comments: tuple[str, ...],
) -> SphereVisit:
    count = len(row_line)

    def column(letter: str, default: float) -> FloatArray:
        return np.asarray(table.get(letter, np.full(count, default)))

    def single(letter: str, default: float) -> float:
        values = column(letter, default)
        if np.ptp(values) > 0.0:
            at = int(np.argmax(values != values[0]))
            reader.fail(int(row_line[at]), f"{values[at]:g} in column {letter} after"
                        f" {values[0]:g}", f"one {_COLUMNS[letter][0]} for the whole file",
                        "Split the file.")  # fmt: skip
        return float(values[0])

    reasons = []
    for letter in sorted(set(table) & set(_CONSTRAINTS)):
        reasons.append(f"column {letter} {_CONSTRAINTS[letter]} and is not used")
    value = np.stack([column(letter, math.nan) for letter in "rtu"], axis=1)
    measured = tuple(name for name, letter in zip(READINGS, "rtu", strict=True) if letter in table)
    valid = (value >= 0.0) & (value <= 1.0)
    for index, (name, letter) in enumerate(zip(READINGS, "rtu", strict=True)):
        if letter not in table:
            continue
        column_of = table[letter]
        for text, wrong in (
            ("not a number", np.isnan(column_of)),
            ("below 0", column_of < 0.0),
            ("above 1", column_of > 1.0),
        ):
            if wrong.any():
                first = int(row_line[int(np.argmax(wrong))])
                reasons.append(f"{name}: {int(wrong.sum())} {text}, masked (first in line {first})")
        value[~valid[:, index], index] = math.nan
    slide_n, slide_d = column("N", head["slide_n"]), column("D", head["slide_thickness"])
    # as in IAD: a slide of no thickness, or of the index 0 or 1, is none
    none = (slide_d == 0.0) | (slide_n <= 1.0)
    spheres = int(single("S", head["spheres"]))
    if spheres and described is None:
        reader.fail(int(row_line[0]), f"{spheres} spheres", "their description in the head")
    sphere_r, sphere_t = described if described is not None else (None, None)
    if described is not None and spheres:
        port = min(described[0].sample_port_mm, described[1].sample_port_mm)
        if port == 0.0:
            reader.fail(int(row_line[0]), "a sample port of 0 mm", "a port above 0 mm")
        wide = int(np.sum(column("B", head["beam"]) > port))
        if wide:
            reasons.append(f"the beam is wider than the sample port in {wide} rows")
    return SphereVisit(
        file=reader.path,
        wavelength_nm=column("L", math.nan),
        row_line=row_line,
        value=value,
        valid=valid,
        measured=measured,
        n=column("n", head["n"]),
        slide_n=np.where(none, 1.0, slide_n),
        thickness_mm=column("d", head["thickness"]),
        slide_thickness_mm=np.where(none, 0.0, slide_d),
        slide_depth=np.where(none, 0.0, column("E", 0.0)),
        beam_mm=column("B", head["beam"]),
        standard_r=column("R", head["standard"]),
        standard_t=column("T", 1.0),
        wall_r=column("w", sphere_r.wall_reflectance if sphere_r else 0.0),
        wall_t=column("W", sphere_t.wall_reflectance if sphere_t else 0.0),
        g=column("g", math.nan),
        spheres=spheres,
        reflection_sphere=sphere_r,
        transmission_sphere=sphere_t,
        incidence_deg=single("i", 0.0),
        unscattered_in_r=single("c", 1.0),
        unscattered_in_t=single("C", 1.0),
        reasons=tuple(reasons),
        comments=comments,
    )
