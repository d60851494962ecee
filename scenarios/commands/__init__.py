"""What the commands do: read, work, and write an output folder."""

from __future__ import annotations

from scenarios.commands.budget import budget_file
from scenarios.commands.spheres import spheres_file
from scenarios.commands.stress import stress_plan
from scenarios.commands.visits import compute_maps, estimate_file, run_scenario, simulate_scenario

__all__ = [
    "budget_file",
    "compute_maps",
    "estimate_file",
    "run_scenario",
    "simulate_scenario",
    "spheres_file",
    "stress_plan",
]
