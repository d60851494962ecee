"""Decoding of the tables of JCAMP-DX files, line by line.

ASCII squeezed difference form (McDonald and Wilks 1988, section 5, table VII): the first digit of
a number is replaced by a letter that also says its sign, and whether it is an ordinate (SQZ), a
difference to the ordinate before (DIF) or a count of repetitions (DUP).
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twin.errors import InputError
from twin.spectra import FloatArray

_FLOAT = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,3})?", re.ASCII)
# In packed lines an exponent has a sign and two or three digits: a bare E is the squeezed digit 5.
_PACKED = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(E[+-]\d{2,3}(?!\d))?", re.ASCII)
_SQUEEZED = re.compile(r"([@A-Ia-i%J-Rj-rS-Zs])(\d*\.?\d*)", re.ASCII)
_GAPS = " \t,;"
_SIGNED = {"@": "0", "%": "0"}
_SIGNED |= {chr(ord("A") + i): str(i + 1) for i in range(9)}
_SIGNED |= {chr(ord("a") + i): f"-{i + 1}" for i in range(9)}
_SIGNED |= {chr(ord("J") + i): str(i + 1) for i in range(9)}
_SIGNED |= {chr(ord("j") + i): f"-{i + 1}" for i in range(9)}
_SIGNED |= {chr(ord("S") + i): str(i + 1) for i in range(8)} | {"s": "9"}
_DIFFERENCES = frozenset("%JKLMNOPQRjklmnopqr")
_REPEATS = frozenset("STUVWXYZs")
_MOST_REPEATS = 10_000_000


@dataclass(frozen=True, slots=True)
class Line:
    """One line of a table: its number in the file (from 1) and its text."""

    number: int
    text: str


@dataclass(frozen=True, slots=True)
class Decoded:
    """One line of a table (X++(Y..Y))."""

    number: int
    x: float
    """Abscissa before XFACTOR."""
    x_rounding: float
    """Half of the last digit that is written of it."""
    ordinates: list[float]
    """New ordinates before YFACTOR, without the check."""
    checks: bool
    """Whether the line began with the last ordinate of the line before, as a check."""


def decoded_lines(path: Path, rows: list[Line], *, comma: bool = False) -> Iterator[Decoded]:
    """Decode the lines of a table (X++(Y..Y)).

    Args:
        path: what messages call the file.
        rows: the lines.
        comma: whether numbers have decimal commas.

    Raises:
        InputError: a character that means nothing, or a check that fails; says the line.
    """
    last: float | None = None
    differs = False
    for row in rows:
        x_text, numbers, ends_differing = _line(path, row, comma=comma)
        checks = differs and bool(numbers)
        if checks and last is not None and not math.isclose(numbers[0], last, abs_tol=1e-6):
            raise InputError(
                f"{numbers[0]:g} as the check of {last:g}",
                "the last ordinate of the line before, repeated", file=path,
                place=f"line {row.number}", remedy="The file is damaged: take it from a copy.",
            )  # fmt: skip
        differs = ends_differing
        if numbers:
            last = numbers[-1]
        _, _, fraction = x_text.lower().partition("e")[0].partition(".")
        rounding = 0.5 * 10.0 ** -len(fraction)
        yield Decoded(row.number, float(x_text), rounding, numbers[checks:], checks)


def _line(path: Path, row: Line, *, comma: bool) -> tuple[str, list[float], bool]:
    """Abscissa as text, ordinates, and whether the last of them was a difference."""
    text = row.text.replace(",", ".") if comma else row.text
    cells = text.split()
    if len(cells) > 1 and all(_FLOAT.fullmatch(cell) for cell in cells):
        return cells[0], [_finite(path, row, cell) for cell in cells[1:]], False
    text = text.strip()
    match = _PACKED.match(text)
    if match is None:
        raise _wrong(path, row, text[:20])
    x_text, at = match[0], match.end()
    numbers: list[float] = []
    step: float | None = None  # what a DUP repeats in difference form
    while at < len(text):
        if text[at] in _GAPS:
            at += 1
            continue
        match = _PACKED.match(text, at)
        if match is not None:
            numbers.append(_finite(path, row, match[0]))
            step, at = None, match.end()
            continue
        match = _SQUEEZED.match(text, at)
        if match is None:
            raise _wrong(path, row, text[at : at + 20])
        letter, at = match[1], match.end()
        value = _finite(path, row, _SIGNED[letter] + match[2])
        if letter in _REPEATS:
            numbers += _repeated(path, row, match[0], value, numbers, step)
        elif letter in _DIFFERENCES:
            if not numbers:
                raise _wrong(path, row, f"the difference {match[0]} without an ordinate before")
            step = value
            numbers.append(numbers[-1] + value)
        else:
            step = None
            numbers.append(value)
    return x_text, numbers, step is not None


def _repeated(
    path: Path, row: Line, token: str, count: float, numbers: list[float], step: float | None
) -> list[float]:
    """What a DUP stands for: the ordinate or difference before, counted with itself."""
    if not numbers or count < 1 or count != int(count) or count > _MOST_REPEATS:
        raise _wrong(path, row, f"the repetition {token}")
    last, more = numbers[-1], int(count) - 1
    return [last + (step or 0.0) * (number + 1) for number in range(more)]


def pairs(path: Path, rows: list[Line], *, comma: bool = False) -> tuple[FloatArray, FloatArray]:
    """Abscissas and ordinates of a table (XY..XY), before their factors, shape (N,) each.

    Raises:
        InputError: something that is no pair of numbers; says the line.
    """
    found: list[tuple[float, float]] = []
    for row in rows:
        for group in row.text.split(";") if ";" in row.text else [row.text]:
            if not group.strip():
                continue
            # With decimal commas only a comma before a blank separates.
            cells = re.split(r",\s+|\s+" if comma else r"[,\s]\s*", group.strip(" \t,"))
            if comma:
                cells = [cell.replace(",", ".") for cell in cells]
            if len(cells) % 2 or not all(_FLOAT.fullmatch(cell) for cell in cells):
                raise InputError(
                    f"{group.strip()[:40]!r}", "pairs of abscissa and ordinate", file=path,
                    place=f"line {row.number}",
                )  # fmt: skip
            values = [_finite(path, row, cell) for cell in cells]
            found += zip(values[::2], values[1::2], strict=True)
    if not found:
        raise InputError("a table without numbers", "one pair or more", file=path)
    table = np.array(found)
    return table[:, 0], table[:, 1]


def _finite(path: Path, row: Line, text: str) -> float:
    try:
        value = float(text)
    except ValueError as error:
        raise _wrong(path, row, text[:20]) from error
    if not math.isfinite(value):
        raise _wrong(path, row, text[:20])
    return value


def _wrong(path: Path, row: Line, found: str) -> InputError:
    return InputError(
        f"{found!r}" if " " not in found else found,
        "numbers in one of the forms of JCAMP-DX", file=path, place=f"line {row.number}",
    )  # fmt: skip
