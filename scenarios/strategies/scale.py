"""All lengths of a bench times a factor."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from twin.bench import Bench


def scaled_bench(bench: Bench, factor: float) -> Bench:
    """The same bench with every length times a factor and every sigma_t divided by it.

    Lengths are known by their names: they end in `_mm`.
    """
    return Bench.model_validate(_scaled(bench.model_dump(), factor))


def _scaled(value: Any, factor: float) -> Any:
    if isinstance(value, Mapping):
        return {
            key: _times(inner, factor)
            if key.endswith("_mm") and not key.endswith("_per_mm")
            else _times(inner, 1.0 / factor)
            if key == "sigma_t_per_mm"
            else _scaled(inner, factor)
            for key, inner in value.items()
        }
    if isinstance(value, list | tuple):
        return tuple(_scaled(inner, factor) for inner in value)
    return value


def _times(value: Any, factor: float) -> Any:
    """A number, a pair of numbers or a spectral table times a factor; None stays."""
    if isinstance(value, Mapping):
        return {**value, "value": _times(value["value"], factor)}
    if isinstance(value, list | tuple):
        return tuple(_times(inner, factor) for inner in value)
    return value * factor if isinstance(value, float | int) else value
