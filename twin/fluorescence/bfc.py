"""Measured Donaldson matrices in the text format of the Labsphere BFC-450.

A bispectral spectrophotometer with two monochromators (S. Gonzalez, RIT thesis 2000, measured with
it). The numbers are energy radiance factors with the bin width included:

    VEC_01 <size>
    BFC-450 Matrix File
    ;comments ...
    380  780  10  49  300  10        emission first, last, step; excitation count, first, step
    r:c: 300 310 ... 780             the excitation wavelengths
    380  <49 values>                 one row for each emission wavelength; blank lines may come
    EOD
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import NoReturn

import numpy as np

from twin.errors import InputError
from twin.fluorescence.donaldson import Below, DonaldsonMatrix
from twin.spectra import FloatArray

LARGEST_BYTES = 20_000_000
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")


def read_bfc(path: str | Path, *, below: Below = "zero") -> DonaldsonMatrix:
    """Read one matrix on all its wavelengths (`.on()` cuts it to 400 to 700 nm).

    Args:
        path: the file.
        below: the noise below the diagonal: "zero" removes it, "keep" leaves it. Negative values
            elsewhere are noise too and stay; `DonaldsonMatrix.physical` removes them.

    Raises:
        InputError: not such a file, cut off, or with a number that cannot be; says the line.
    """
    path = Path(path)
    try:
        if path.stat().st_size > LARGEST_BYTES:
            raise InputError("a file above 20 MB", "a matrix file of a BFC-450", file=path)
        raw = path.read_bytes()
    except OSError as error:
        raise InputError(
            f"a file that cannot be read ({error.strerror})",
            "a matrix file of a BFC-450", file=path,
        ) from error  # fmt: skip
    return parse_bfc(raw, path, below=below)


def parse_bfc(raw: bytes, path: str | Path = "", *, below: Below = "zero") -> DonaldsonMatrix:
    """The same from bytes; `path` is for messages."""
    lines = re.split(r"\r\n|\r|\n", raw.decode("latin-1"))
    rows = [(number, text) for number, text in enumerate(lines, start=1) if text.strip()]
    reader = _Reader(str(path), rows)
    number, text = reader.next("VEC_01")
    if not text.startswith("VEC_"):
        reader.fail(number, repr(text[:20]), "VEC_01, the mark of a BFC-450 file")
    number, text = reader.next("BFC-450 Matrix File")
    if "Matrix" not in text:
        reader.fail(number, repr(text[:40]), "BFC-450 Matrix File")
    comments = []
    number, text = reader.next("comments or the line of wavelengths")
    while text.startswith(";"):
        comments.append(text[1:].strip())
        number, text = reader.next("the line of wavelengths")
    head = reader.numbers(number, text.split(), 6, "first, last, step, count, first, step")
    emission, excitation = _grids(reader, number, head)
    number, text = reader.next("the row of excitation wavelengths")
    fields = text.split()
    if not fields or not fields[0].lower().startswith("r:c"):
        reader.fail(number, repr(text[:20]), "r:c: and the excitation wavelengths")
    named = reader.numbers(number, fields[1:], excitation.size, "excitation wavelengths")
    if np.max(np.abs(named - excitation)) > 1e-3:
        at = int(np.argmax(np.abs(named - excitation)))
        reader.fail(number, f"column {named[at]:g} nm", f"{excitation[at]:g} nm, as the head says")
    matrix = np.empty((emission.size, excitation.size))
    for row, wavelength in enumerate(emission):
        number, text = reader.next(f"the row of {wavelength:g} nm")
        values = reader.numbers(number, text.split(), excitation.size + 1, "a row of the matrix")
        if abs(values[0] - wavelength) > 1e-3:
            reader.fail(number, f"a row of {values[0]:g} nm", f"the row of {wavelength:g} nm")
        matrix[row] = values[1:]
    number, text = reader.next("EOD")
    if text.strip() != "EOD":
        reader.fail(number, repr(text[:20]), "EOD, the end of the data")
    title = next((each for each in comments[1:2] if each), Path(str(path)).stem)
    return DonaldsonMatrix(
        matrix, emission, excitation, name=title, source=str(path) or "BFC-450", below=below
    )


class _Reader:
    """Lines one by one, with errors that say where."""

    def __init__(self, path: str, rows: list[tuple[int, str]]) -> None:
        self.path = path
        self.rows = rows
        self.at = 0

    def fail(self, line: int, found: str, expected: str, remedy: str = "") -> NoReturn:
        raise InputError(found, expected, file=self.path, place=f"line {line}", remedy=remedy)

    def next(self, meaning: str) -> tuple[int, str]:
        if self.at >= len(self.rows):
            last = self.rows[-1][0] if self.rows else 1
            raise InputError(
                "the end of the file", meaning, file=self.path, place=f"line {last}",
                remedy="Is the file cut off?",
            )  # fmt: skip
        self.at += 1
        return self.rows[self.at - 1]

    def numbers(self, line: int, fields: list[str], count: int, meaning: str) -> FloatArray:
        if len(fields) != count:
            self.fail(line, f"{len(fields)} numbers", f"{count}: {meaning}")
        for field in fields:
            if not _NUMBER.fullmatch(field):
                remedy = "Write a decimal point." if "," in field else ""
                self.fail(line, repr(field[:40]), f"a number: {meaning}", remedy)
        return np.array([float(field) for field in fields])


def _grids(reader: _Reader, line: int, head: FloatArray) -> tuple[FloatArray, FloatArray]:
    first, last, step, count, start, stride = head
    rows = round((last - first) / step) + 1 if step > 0 else 0
    if not (2 <= rows <= 2000 and abs(first + (rows - 1) * step - last) < 1e-3):
        reader.fail(line, f"emission {first:g} to {last:g} nm every {step:g} nm", "a grid")
    if not (count == int(count) and 2 <= count <= 2000 and stride > 0 and start > 0):
        reader.fail(line, f"{count:g} excitation wavelengths every {stride:g} nm", "a grid")
    return first + step * np.arange(rows), start + stride * np.arange(int(count))
