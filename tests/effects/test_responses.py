"""Responses of the Monte Carlo on the lattice against independent Monte Carlo runs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.effects.worlds import WAVELENGTH, candidates, world
from twin.effects import EffectEngine
from twin.effects.lattice import Lattice, corners, material_at
from twin.materials import OpticalProperties
from twin.transport import response

FLAT = np.tile((0.95, 4.0, 0.7), (len(WAVELENGTH), 1))
AT = 3
"""Number of the wavelength at which an independent run is made."""
PATHS = 4096
EFFECTS = {"gap": 2.0, "lateral_loss": 0.1, "beam_divergence": 2.0}
CLEAR, BETWEEN = np.tile((0.9, 1.3, 0.5), (len(WAVELENGTH), 1)), 0.17
"""Light walks far in it; an inverse extent between those at which the response is taken."""


@pytest.fixture(scope="module")
def engine(tmp_path_factory: pytest.TempPathFactory) -> EffectEngine:
    return EffectEngine(
        world(), WAVELENGTH, least_paths=PATHS, folder=tmp_path_factory.mktemp("effects")
    )


def independent(
    name: str, value: float, sample: int, material: np.ndarray = FLAT
) -> tuple[np.ndarray, np.ndarray]:
    """The same change by `twin.transport.response` with other random numbers, (3,) each."""
    changed = candidates()[name].apply(world(), (value,))
    at = WAVELENGTH[[AT]]
    medium = OpticalProperties(at, *(material[[AT], column] for column in range(3)), None)
    found, error = response(
        world().bench, changed.bench, world().samples[sample], at, properties=medium,
        paths=4 * PATHS, seed=77,
    )  # fmt: skip
    return found[0], error[0]


@pytest.mark.parametrize("name", tuple(EFFECTS))
def test_fast_response_agrees_with_the_monte_carlo(name: str, engine: EffectEngine) -> None:
    own, value = candidates()[name], EFFECTS[name]
    fast = engine.response(own, FLAT, (value,))[AT, 1]
    own_error = engine.signature_error(own, FLAT)[0, AT, 1] * value
    truth, error = independent(name, value, 1)
    noise = np.hypot(own_error, error)
    # between the lattice's nodes and away from the parabola's: a twentieth of the effect
    bound = 4.0 * noise + 0.12 * np.abs(truth).max() + 1e-6
    assert np.all(np.abs(fast - truth) < bound), (fast, truth, noise)
    if name == "beam_divergence":
        return  # seen within the acceptance alone: too faint here for a control
    largest = np.argmax(np.abs(truth))
    assert abs(truth[largest]) > 6.0 * error[largest], "the effect must stand out"
    assert abs(2.0 * fast[largest] - truth[largest]) > bound[largest], "twice of it must fail"


def test_a_response_need_not_follow_the_square(engine: EffectEngine) -> None:
    own = candidates()["lateral_loss"]
    fast = engine.response(own, CLEAR, (BETWEEN,))[AT, 1]
    truth, error = independent("lateral_loss", BETWEEN, 1, CLEAR)
    bound = 4.0 * error + 0.12 * np.abs(truth).max()
    assert np.all(np.abs(fast - truth) < bound), (fast, truth, error)
    scale = own.parameters[0].prior_scale
    square = engine.response(own, CLEAR, (scale,))[AT, 1] * (BETWEEN / scale) ** 2
    assert np.any(np.abs(square - truth) > bound), "a square must fail"


def test_responses_to_an_even_parameter_join_smoothly(engine: EffectEngine) -> None:
    own = candidates()["lateral_loss"]
    scale, step = own.parameters[0].prior_scale, 1e-4

    def at(x: float) -> np.ndarray:
        return engine.response(own, FLAT, (x * scale,))[AT, 1, :2]

    assert np.abs(at(step)).max() < 1e-6, "no slope at nominal"
    below, above = (at(2.0) - at(2.0 - step)) / step, (at(2.0 + step) - at(2.0)) / step
    assert np.allclose(below, above, rtol=0.02)
    assert np.allclose(at(4.0) - at(3.0), at(3.0) - at(2.0)), "straight on, beyond the last"


def test_what_an_effect_leaves_alone_does_not_change(engine: EffectEngine) -> None:
    gap = engine.response(candidates()["gap"], FLAT, (1.0,))
    assert np.all(gap[..., 2] == 0.0), "the beam meets no background"
    glossy = candidates()["gloss[white]"].apply(world(), (0.2,))
    gloss = engine.light(glossy, FLAT) - engine.light(world(), FLAT)
    assert np.all(gloss[..., 0] == 0.0), "no white lies below the black capture"
    beam = engine.response(candidates()["beam_divergence"], FLAT, (3.0,))
    assert np.all(beam[..., :2] == 0.0), "the beam is off under the panels"


def test_responses_are_kept(tmp_path: Path) -> None:
    one = EffectEngine(world(), WAVELENGTH, least_paths=512, folder=tmp_path)
    first = one.signature(candidates()["gap"], FLAT)
    files = {path: path.stat().st_mtime_ns for path in tmp_path.glob("*.npz")}
    assert files
    again = EffectEngine(world(), WAVELENGTH, least_paths=512, folder=tmp_path)
    assert np.array_equal(again.signature(candidates()["gap"], FLAT), first)
    assert {path: path.stat().st_mtime_ns for path in tmp_path.glob("*.npz")} == files


def test_another_material_in_the_same_cells_needs_no_trace(tmp_path: Path) -> None:
    one = EffectEngine(world(), WAVELENGTH, least_paths=512, folder=tmp_path)
    one.signature(candidates()["gap"], FLAT)
    count = len(list(tmp_path.glob("*.npz")))
    other = FLAT * (0.9, 1.02, 1.01)
    assert np.isfinite(one.signature(candidates()["gap"], other)).all()
    assert len(list(tmp_path.glob("*.npz"))) == count


def test_lattice_interpolates_partition_of_unity() -> None:
    for free in (True, False):
        around = corners(FLAT, free)
        assert len(around) == (4 if free else 8)
        assert np.allclose(sum(weight for _, weight in around), 1.0)
        logs = sum(
            weight * np.log([material_at(node)[0] for node in nodes]) for nodes, weight in around
        )
        assert np.allclose(logs, np.log(4.0))


def test_layers_alike_are_one_layer(tmp_path: Path) -> None:
    """Depth contrast 0 in two layers, traced as such, is the homogeneous sample within noise."""
    from twin.effects.world import Sublayer

    halves = world().changed(sublayers=(Sublayer(0.5), Sublayer(0.5)))
    lattice = Lattice(world(), 560.0, paths=PATHS, folder=tmp_path)
    node = (3, 2, 3)
    found = lattice.nodes(halves, 1, {node})[node]
    rho = np.array([0.02]), np.array([0.98])
    change = found.at(np.array([0.9]), *rho)[0]
    assert np.all(np.abs(change) < 4.0 * found.error[0] + 1e-6)
    contrast = replace(halves, sublayers=(Sublayer(0.5, 1.5, 0.2), Sublayer(0.5, 0.5, 1.8)))
    other = lattice.nodes(contrast, 1, {node})[node]
    assert np.any(np.abs(other.at(np.array([0.9]), *rho)[0]) > 6.0 * other.error[0])
