"""An answer (nested plain values) as lines a person reads."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any


def sentences(answer: Mapping[str, Any], indent: str = "") -> Iterator[str]:
    """Lines of text: keys aligned, what is nested indented under its key."""
    keys = [key.replace("_", " ") for key in answer]
    width = max((len(key) for key in keys), default=0)
    for key, value in zip(keys, answer.values(), strict=True):
        if isinstance(value, Mapping):
            yield f"{indent}{key}" if value else f"{indent}{key:<{width}}  -"
            yield from sentences(value, indent + "  ")
        elif _is_table(value):
            yield f"{indent}{key}"
            for row in value:
                yield f"{indent}  {_row(row)}"
        else:
            yield f"{indent}{key:<{width}}  {_text(value)}"


def _is_table(value: Any) -> bool:
    return isinstance(value, Sequence) and bool(value) and isinstance(value[0], Mapping)


def _row(row: Mapping[str, Any]) -> str:
    return ", ".join(f"{key.replace('_', ' ')} {_text(value)}" for key, value in row.items())


def _text(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return ", ".join(_text(item) for item in value) or "-"
    return str(value)
