"""Scenarios of the fluorescence bench: set-ups with their prices, and their simulation."""

from __future__ import annotations

from scenarios.fluorescence.scenario import (
    FluorescenceScenario,
    builtin_names,
    is_fluorescence_scenario,
    load_scenario,
    material_of,
)
from scenarios.fluorescence.simulate import simulate_visit, simulated_data, visits

__all__ = [
    "FluorescenceScenario",
    "builtin_names",
    "is_fluorescence_scenario",
    "load_scenario",
    "material_of",
    "simulate_visit",
    "simulated_data",
    "visits",
]
