"""The look-up at the border of its map, where half of the neighbourhood or more lies outside."""

from __future__ import annotations

import numpy as np
import pytest

from estimators import LutEstimator
from estimators import lut_neighbourhood as neighbourhood_module
from estimators.draws import MEDIAN
from estimators.lut_border import Likelihood, inside_map, widened
from estimators.lut_plain import Table
from estimators.map_grid import MapNodes
from estimators.result import QUANTILE_LEVELS
from tests.estimators.fake_map import fake_map
from tests.estimators.visits import bench_model, generator, visit

MAPS = (fake_map(0.4), fake_map(0.8))
COUNT = 240


def near_the_border() -> np.ndarray:
    """Weak scatterers whose g, up to the map's greatest, is known to 0.05 or so, (COUNT, 3)."""
    random = generator(3, 1)
    return np.stack(
        [
            random.uniform(0.1, 0.35, COUNT),
            np.exp(random.uniform(np.log(0.4), np.log(1.2), COUNT)),
            random.uniform(0.8, 0.945, COUNT),
        ],
        axis=-1,
    )


def far_and_held() -> tuple[float, float]:
    """Shares of points more than 5 stated errors off, and of 90 % intervals that hold."""
    truth, model = near_the_border(), bench_model(COUNT, MAPS)
    result = LutEstimator(model).estimate(visit(model, truth, noise=0.01, seed=1))
    claimed = result.identifiable & np.isfinite(result.parameters)
    off = np.abs(result.parameters - truth)
    far = (claimed & (off > 5.0 * result.standard_error)).any(axis=1)
    low, high = result.interval(0.9)
    return float(far.mean()), float(((low <= truth) & (truth <= high))[claimed].mean())


def test_no_confident_wrong_answer_at_the_border() -> None:
    far, held = far_and_held()
    assert far <= 0.005
    # 700 values; a uniform prior over the map covers at least as often as it says near its border.
    assert 0.87 < held < 0.97


def test_draws_put_on_the_border_fail_that_check(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(neighbourhood_module, "CUT_OFF", 2.0)
    far, _ = far_and_held()
    assert far > 0.02


def likelihood(truth: np.ndarray, sigma: float, fixed_g: float | None = None) -> Likelihood:
    """Exact captures of a material, with relative errors."""
    tables, powers, data = [], [], []
    for source in MAPS:
        grid = MapNodes.of(source, fixed_g=fixed_g)
        power = grid.power(np.array([0.03]), np.array([0.99]))
        triple = grid.captures(grid.places(truth[None]), power)[0]
        if fixed_g is None:
            triple[2] = np.exp(triple[2])
        tables.append(Table(grid, power, (0.03, 0.99)))
        powers.append(power[0])
        data.append(triple)
    flat = np.concatenate(data)
    return Likelihood.of(tables, powers, flat, np.diag((sigma * flat + 1e-4) ** 2), fixed_g)


def test_draws_are_those_of_the_likelihood() -> None:
    truth = np.array([0.3, 0.8, 0.93])
    own = likelihood(truth, 0.01)
    found = inside_map(own, truth[None], 4000, generator(1, 8))
    assert not found.torn
    low, high = own.box
    assert ((found.draws >= low) & (found.draws <= high)).all()
    # Against a fine grid of the whole neighbourhood.
    spread = found.draws.std(axis=0)
    ends = [np.clip(truth + side * 6.0 * spread, low, high) for side in (-1.0, 1.0)]
    axes = [np.linspace(a, b, 41) for a, b in zip(*ends, strict=True)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    weight = np.exp(-0.5 * np.sum(own.rest(nodes) ** 2, axis=1))
    weight /= weight.sum()
    mean = weight @ nodes
    deviation = np.sqrt(weight @ (nodes - mean) ** 2)
    # About 500 effective draws.
    assert np.all(np.abs(found.draws.mean(axis=0) - mean) < 0.25 * deviation)
    assert np.all(np.abs(spread / deviation - 1.0) < 0.2)


def test_intervals_reach_the_border_that_the_captures_allow() -> None:
    truth = np.array([0.3, 0.8, 0.95])
    found = inside_map(likelihood(truth, 0.01), truth[None], 500, generator(2, 8))
    assert np.isfinite(found.clipped[:, 2]).all()
    assert np.isnan(found.clipped[:, 1]).all()
    drawn = np.quantile(found.draws, QUANTILE_LEVELS, axis=0)
    wide = widened(drawn, found.clipped)
    assert wide[-1, 2] == pytest.approx(0.95, abs=1e-9)
    assert drawn[-1, 2] < 0.95
    assert wide[MEDIAN, 2] == drawn[MEDIAN, 2]
    assert (wide[:MEDIAN] <= drawn[:MEDIAN]).all()


def test_a_given_g_stays() -> None:
    truth = np.array([0.3, 0.8, 0.5])
    found = inside_map(likelihood(truth, 0.01, fixed_g=0.5), truth[None], 200, generator(3, 8))
    assert (found.draws[:, 2] == 0.5).all()
    assert np.abs(np.median(found.draws[:, 1]) / 0.8 - 1.0) < 0.3
