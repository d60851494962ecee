"""Strict reading of the CSV tables that a person makes: every mistake has a line and a column."""

from __future__ import annotations

import csv
import io
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from twin.errors import InputError
from twin.toml import near_misses, read_text

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_WHOLE = re.compile(r"\d{1,9}", re.ASCII)
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+([eE][+-]?\d+)?", re.ASCII)
_NOT_A_NUMBER = ("nan", "inf", "-inf", "infinity", "n/a", "na", "null", "none", "-")
MISSING = "missing"
"""What stands in place of a reading of a dead pixel."""
_COMMA_REMEDY = "Write numbers with a decimal point, not a decimal comma."


@dataclass(frozen=True)
class Column:
    """One column of a table: how its cells are read, and what an empty or missing one means."""

    name: str
    kind: Literal["text", "number", "whole", "reading"]
    """A reading is a number, or the word `missing` where there is none."""
    default: Any = None
    required: bool = False


@dataclass(frozen=True)
class Row:
    """One row: its line in the file (from 1) and its values by column name."""

    line: int
    values: dict[str, Any]


def read_table(path: Path, columns: tuple[Column, ...]) -> list[Row]:
    """Rows of a CSV file whose first line names the columns, in any order.

    Comma, semicolon or tab may separate cells (whichever the first line holds most of); UTF-8, a
    byte-order mark and Excel's "sep=" line are understood; blank lines are skipped.

    Raises:
        InputError: anything else, with file, line and column.
    """
    text = read_text(path)
    skipped = 0
    if text[:4].lower() == "sep=":
        skipped, text = 1, text.partition("\n")[2]
    first = text.partition("\n")[0]
    separator = max(",;\t", key=first.count)
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True)
    rows: list[Row] = []
    header: list[Column | None] = []
    try:
        for cells in reader:
            line = reader.line_num + skipped
            cells = [cell.strip() for cell in cells]
            if not any(cells):
                continue
            if not header:
                header = _header(path, line, cells, columns)
                continue
            rows.append(_row(path, line, cells, header, columns))
    except csv.Error as error:
        raise InputError(
            f"a line that cannot be split into cells ({error})",
            "cells separated by commas",
            file=path,
            place=f"line {reader.line_num + skipped}",
        ) from error
    if not header:
        raise InputError("an empty file", f"a first line {_names(columns)}", file=path)
    if not rows:
        raise InputError("a table without rows", "one row or more", file=path)
    return rows


def _names(columns: tuple[Column, ...]) -> str:
    return ",".join(column.name for column in columns)


def _header(
    path: Path, line: int, cells: list[str], columns: tuple[Column, ...]
) -> list[Column | None]:
    known = {column.name: column for column in columns}
    while cells and not cells[-1]:
        cells.pop()
    for index, cell in enumerate(cells):
        place = f"line {line}, column {index + 1}"
        if cell not in known:
            raise InputError(
                f"the unknown column {cell!r}",
                f"some of {', '.join(known)}",
                file=path,
                place=place,
                remedy=near_misses(cell, list(known)),
            )
        if cell in cells[:index]:
            raise InputError(f"column {cell!r} twice", "every column once", file=path, place=place)
    for column in columns:
        if column.required and column.name not in cells:
            raise InputError(
                f"no column {column.name!r} (only {', '.join(cells)})",
                "it to be there",
                file=path,
                place=f"line {line}",
            )
    return [known[cell] for cell in cells]


def _row(
    path: Path,
    line: int,
    cells: list[str],
    header: list[Column | None],
    columns: tuple[Column, ...],
) -> Row:
    while len(cells) > len(header) and not cells[-1]:
        cells.pop()
    if len(cells) != len(header):
        more = len(cells) > len(header)
        raise InputError(
            f"{len(cells)} cells",
            f"{len(header)}, one for each column",
            file=path,
            place=f"line {line}",
            remedy=_COMMA_REMEDY if more else "Is the file truncated?",
        )
    values = {column.name: column.default for column in columns}
    for cell, column in zip(cells, header, strict=True):
        if column is None:
            continue
        if cell:
            values[column.name] = _value(path, line, cell, column)
        elif column.required:
            raise _wrong(path, line, column, "an empty cell", "a value")
    return Row(line, values)


def _value(path: Path, line: int, cell: str, column: Column) -> Any:
    if column.kind == "text":
        if not cell.isprintable():
            raise _wrong(path, line, column, f"{_short(cell)}", "a text that can be printed")
        return cell
    if column.kind == "reading" and cell == MISSING:
        return math.nan
    whole = column.kind == "whole"
    expected = "a whole number of 0 or more" if whole else "a number"
    if _DECIMAL_COMMA.fullmatch(cell):
        raise _wrong(path, line, column, f"{_short(cell)}", f"{expected} like 1.5", _COMMA_REMEDY)
    if cell.lower() in _NOT_A_NUMBER or cell.startswith("#"):
        raise _wrong(path, line, column, f"{_short(cell)}", expected)
    if not (_WHOLE if whole else _NUMBER).fullmatch(cell):
        raise _wrong(path, line, column, f"{_short(cell)}", expected)
    value = int(cell) if whole else float(cell)
    if not math.isfinite(value):
        raise _wrong(path, line, column, f"{_short(cell)}", "a finite number")
    return value


def _short(cell: str) -> str:
    text = ascii(cell) if not cell.isprintable() else repr(cell)
    return text if len(text) <= 40 else text[:37] + "..."


def _wrong(
    path: Path, line: int, column: Column, found: str, expected: str, remedy: str = ""
) -> InputError:
    place = f"line {line}, column {column.name}"
    return InputError(found, expected, file=path, place=place, remedy=remedy)
