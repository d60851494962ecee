"""Visits to worlds: the described one byte for byte, others with their effect in the counts."""

from __future__ import annotations

import numpy as np
import pytest

from scenarios import simulate_visit
from scenarios.scenario import Scenario
from scenarios.worlds import simulate_world, world_light
from tests.effects.worlds import scenario
from twin.effects import World, candidate
from twin.errors import InputError
from twin.measurement import relative_intensities

PATHS = 512


@pytest.fixture(scope="module")
def said() -> Scenario:
    small = scenario(start_nm=480.0, stop_nm=560.0, step_nm=20.0)
    data = small.model_dump() | {
        "wavelength": {"start_nm": 460.0, "stop_nm": 580.0, "step_nm": 20.0}
    }
    return Scenario.model_validate(data)


def test_the_described_world_is_the_visit_byte_for_byte(said: Scenario) -> None:
    world = World.nominal(said.bench, said.samples)
    visit = simulate_visit(said, seed=3, paths=PATHS)
    assert simulate_world(said, world, seed=3, paths=PATHS) == visit


def test_a_world_has_its_effect_in_the_counts_and_not_in_the_description(said: Scenario) -> None:
    world = World.nominal(said.bench, said.samples)
    visit = simulate_world(said, world, seed=3, paths=PATHS)
    before = relative_intensities(visit).value
    for name, values in (
        ("thickness[0.6 mm]", (0.2,)), ("drift[black]", (0.05, 0.0)), ("dark_offset", (200.0,)),
        ("depth_contrast[scattering]", (0.5,)), ("wedge[0.2 mm]", (0.15,)),
    ):  # fmt: skip
        changed = candidate(world, name).apply(world, values)
        found = simulate_world(said, changed, seed=3, paths=PATHS)
        assert np.abs(relative_intensities(found).value - before).max() > 1e-3, name
        assert found.bench == said.bench
        assert found.samples == said.samples
        assert found.provenance == visit.provenance, "nothing tells what was changed"
        assert np.array_equal(found.wavelength_nm, visit.wavelength_nm)
        assert found.truth == visit.truth or np.array_equal(
            found.truth.albedo,
            visit.truth.albedo,  # type: ignore[union-attr]
        )


def test_samples_must_be_those_of_the_scenario(said: Scenario) -> None:
    other = World.nominal(said.bench, said.samples[:1])
    with pytest.raises(InputError, match="samples"):
        world_light(said, other)


def test_a_drift_is_a_factor_on_its_capture(said: Scenario) -> None:
    world = World.nominal(said.bench, said.samples)
    changed = candidate(world, "drift[black]").apply(world, (0.05, 0.0))
    pair = [
        relative_intensities(simulate_world(said, each, seed=3, paths=PATHS)).value
        for each in (world, changed)
    ]
    ratio = pair[1] / pair[0]
    assert np.allclose(ratio[:, 0], np.exp(0.05), rtol=1e-6)
    assert np.allclose(ratio[:, 1:], 1.0, rtol=1e-9)
