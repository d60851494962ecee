"""An answer (nested plain values) as lines a person reads."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any


def sentences(answer: Mapping[str, Any], indent: str = "") -> Iterator[str]:
    """Lines of text: keys aligned, what is nested indented under its key."""
    keys = [key if "." in key else key.replace("_", " ") for key in answer]  # "." : a file
    width = max((len(key) for key in keys), default=0)
    for key, value in zip(keys, answer.values(), strict=True):
        if isinstance(value, Mapping):
            yield f"{indent}{key}" if value else f"{indent}{key:<{width}}  -"
            yield from sentences(value, indent + "  ")
        elif _is_table(value):
            yield f"{indent}{key}"
            for row in value:
                yield f"{indent}  {_text(row)}"
        else:
            yield f"{indent}{key:<{width}}  {_text(value)}"


def _is_table(value: Any) -> bool:
    """Whether a list takes a line for each item: it holds tables, or sentences."""
    if not isinstance(value, Sequence) or isinstance(value, str):
        return False
    return any(isinstance(item, Mapping) or " " in str(item) for item in value)


def _row(row: Mapping[str, Any]) -> str:
    return ", ".join(f"{key.replace('_', ' ')} {_text(value)}" for key, value in row.items())


def _text(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, Mapping):
        return _row(value)
    if isinstance(value, Sequence) and not isinstance(value, str):
        return ", ".join(_text(item) for item in value) or "-"
    return str(value) or "-"
