"""Instruments on the command line: bench files, and the twin that feeds virtual devices.

`twin_light` computes the light of a scenario once; `TwinLight.state` makes the `BenchState` of it
that all virtual and wire-level devices of a bench share. `BenchFile` is what a person writes, and
`open_bench` turns it into a `DeviceBench`.
"""

from __future__ import annotations

from scenarios.instruments.bench_file import BenchFile, load_bench_file
from scenarios.instruments.opening import open_bench
from scenarios.instruments.twin_light import TwinLight, twin_light

__all__ = ["BenchFile", "TwinLight", "load_bench_file", "open_bench", "twin_light"]
