"""A visit to a bench with a wrong description, small enough for a test, and a small catalogue."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from scenarios.scenario import Scenario
from scenarios.worlds import simulate_world
from tests.scenarios.tiny import tiny
from twin.effects import Catalogue, World, candidate, catalogue
from twin.measurement import Measurement, write_measurement
from twin.toml import validate

MEDIUM = {
    "albedo": {"wavelength_nm": [400.0, 550.0, 700.0], "value": [0.85, 0.93, 0.97]},
    "sigma_t_per_mm": 3.0,
    "g": 0.6,
}
KEPT = ("thickness", "black_level", "aperture", "drift", "stray_light", "refractive_index")
"""Effects that need no Monte Carlo response."""


def small_catalogue() -> Catalogue:
    everything = catalogue()
    return everything.without([name for name in everything.names if name not in KEPT])


def without_the_rest() -> list[str]:
    """The same catalogue as options of the command."""
    names = [name for name in catalogue().names if name not in KEPT]
    return [part for name in names for part in ("--without", name)]


def visit(
    effect: str = "", value: float = 0.0, thickness: tuple[float, ...] = (0.4, 0.8, 1.6),
    **changes: Any,
) -> Measurement:  # fmt: skip
    """A simulated visit with an effect that its description does not have."""
    samples = [
        {"name": f"piece {number}", "thickness_mm": t, "n": 1.5, "material": MEDIUM}
        for number, t in enumerate(thickness)
    ]
    table = tiny(
        samples=samples, simulation={"paths": 4096, "quick_paths": 256, "seed": 5}, **changes
    )
    scenario = validate(table, Scenario)
    world = World.nominal(scenario.bench, scenario.samples)
    true = candidate(world, effect).apply(world, [value]) if effect else world
    return simulate_world(scenario, true)


def written(measurement: Measurement, path: Path) -> Path:
    return write_measurement(measurement, path)


def equally_thick(measurement: Measurement, thickness_mm: float) -> Measurement:
    samples = tuple(
        sample.model_copy(update={"thickness_mm": thickness_mm}) for sample in measurement.samples
    )
    return replace(measurement, samples=samples)
