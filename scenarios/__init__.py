"""What a person runs: scenario files, simulated visits, estimates, reports, the command line.

A scenario says everything about one visit to the bench; `simulate_visit` makes its counts and
`estimate_measurement` turns counts into optical properties. Names load when they are first used,
so that `benchtwin --help` starts at once.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from scenarios.pipeline import Estimated, estimate_measurement
    from scenarios.report import write_report
    from scenarios.scenario import Scenario, builtin_names, load_scenario
    from scenarios.simulate import simulate_visit

__all__ = [
    "Estimated",
    "Scenario",
    "builtin_names",
    "estimate_measurement",
    "load_scenario",
    "simulate_visit",
    "write_report",
]

_HOME = {
    "Estimated": "scenarios.pipeline",
    "Scenario": "scenarios.scenario",
    "builtin_names": "scenarios.scenario",
    "estimate_measurement": "scenarios.pipeline",
    "load_scenario": "scenarios.scenario",
    "simulate_visit": "scenarios.simulate",
    "write_report": "scenarios.report",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'scenarios' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
