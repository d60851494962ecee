"""Instruments on the command line: bench files, and the twin that feeds virtual devices.

`twin_light` computes the light of a scenario once; `TwinLight.state` makes the `BenchState` of it
that all virtual and wire-level devices of a bench share. `BenchFile` is what a person writes, and
`open_bench` turns it into a `DeviceBench`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from scenarios.instruments.bench_file import BenchFile, load_bench_file
    from scenarios.instruments.opening import open_bench
    from scenarios.instruments.twin_fed import TwinLight, twin_light

__all__ = ["BenchFile", "TwinLight", "load_bench_file", "open_bench", "twin_light"]

# Names load when they are first used, so that `benchtwin --help` starts at once.
_HOME = {
    "BenchFile": "scenarios.instruments.bench_file",
    "TwinLight": "scenarios.instruments.twin_fed",
    "load_bench_file": "scenarios.instruments.bench_file",
    "open_bench": "scenarios.instruments.opening",
    "twin_light": "scenarios.instruments.twin_fed",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'scenarios.instruments' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
