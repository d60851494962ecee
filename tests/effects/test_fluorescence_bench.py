"""Effects of a fluorescence bench on its arrays."""

from __future__ import annotations

import numpy as np
import pytest

from twin.effects import catalogue
from twin.effects.catalogue.fluorescence_bench import FluorescenceWorld
from twin.effects.effect import Candidate

GRID = np.arange(400.0, 701.0, 10.0)


def bands(centres: tuple[float, ...], width: float) -> np.ndarray:
    return np.exp(-(((GRID - np.array(centres)[:, None]) / width) ** 2))


WORLD = FluorescenceWorld(
    GRID, bands((430.0, 520.0, 620.0), 15.0), bands((450.0, 550.0, 650.0), 30.0)
)


def found() -> dict[str, Candidate]:
    return {each.name: each for each in catalogue().candidates(WORLD, "fluorescence")[0]}


@pytest.mark.parametrize("name", tuple(found()))
def test_nominal_is_nothing_and_the_rest_is_pure(name: str) -> None:
    own = found()[name]
    light, seen = WORLD.illuminants.copy(), WORLD.sensitivities.copy()
    assert own.apply(WORLD, own.nominal) is WORLD
    after = own.apply(WORLD, [p.prior_scale for p in own.parameters])
    assert np.array_equal(WORLD.illuminants, light)
    assert np.array_equal(WORLD.sensitivities, seen)
    assert after.applied[-1].name == name
    white = np.eye(GRID.size)
    change = np.abs(after.readings(white) - WORLD.readings(white))
    assert change.max() > 1e-4 * WORLD.readings(white).max()


def test_one_illuminant_alone_is_shifted() -> None:
    after = found()["illuminant_shift[illuminant 2]"].apply(WORLD, (10.0,))
    assert np.array_equal(after.illuminants[[0, 2]], WORLD.illuminants[[0, 2]])
    assert np.allclose(after.illuminants[1, 1:], WORLD.illuminants[1, :-1])


def test_cross_talk_keeps_a_flat_response() -> None:
    flat = FluorescenceWorld(GRID, WORLD.illuminants, np.ones((3, GRID.size)))
    after = found()["cross_talk"].apply(flat, (0.3,))
    assert np.allclose(after.sensitivities, 1.0)


def test_many_channels_are_taken_together() -> None:
    many = FluorescenceWorld(GRID, WORLD.illuminants, np.eye(GRID.size))
    names = [each.name for each in catalogue().candidates(many, "fluorescence")[0]]
    assert "sensitivity_error[all]" in names
    assert len(names) == 3 * 3 + 2
