"""Simulated visits of a fluorescence scenario."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from scenarios.fluorescence.scenario import FluorescenceScenario
    from twin.fluorescence import FluorescenceData, FluorescenceVisit


def simulate_visit(scenario: FluorescenceScenario, *, seed: int | None = None) -> FluorescenceVisit:
    """Simulate the visit of a scenario; `seed` replaces the scenario's.

    Raises:
        InputError: as `material_of` and `twin.fluorescence.simulate_fluorescence`.
    """
    seeds = [scenario.seed if seed is None else seed]
    return next(visits(scenario, seeds))


def visits(scenario: FluorescenceScenario, seeds: Iterable[int]) -> Iterator[FluorescenceVisit]:
    """Visits to the same sample that differ in lamps and noise, one for each seed.

    Raises:
        InputError: as `simulate_visit`.
    """
    from scenarios.fluorescence.scenario import material_of
    from scenarios.simulate import software
    from twin.fluorescence import simulate_fluorescence

    material = material_of(scenario)
    for seed in seeds:
        settled = scenario.settled(seed=seed)
        yield simulate_fluorescence(
            settled.setup,
            material,
            protocol=settled.protocol,
            seed=seed,
            scenario=settled.text,
            software=software(),
        )


def simulated_data(scenario: FluorescenceScenario, *, seed: int | None = None) -> FluorescenceData:
    """Simulate a visit and correct it: what an estimator gets, with the truth in it.

    Raises:
        InputError: as `simulate_visit`.
    """
    from twin.fluorescence import corrected

    return corrected(simulate_visit(scenario, seed=seed))
