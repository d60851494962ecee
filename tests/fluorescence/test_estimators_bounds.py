"""What a matrix can be: estimates and intervals inside the bounds that still fit the captures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from estimators.fluorescence import FluorescenceStatus, fluorescence_estimator
from estimators.fluorescence.cells import gather
from estimators.fluorescence.donaldson import DonaldsonEstimator, DonaldsonSettings
from estimators.fluorescence.nonnegative import back_on_captures, nearest
from estimators.fluorescence.quick import DonaldsonQuickEstimator, DonaldsonQuickSettings
from tests.fluorescence.cases import BELOW, data, material, system
from twin.errors import InputError
from twin.fluorescence.system import FluorescenceData, FluorescenceSystem
from twin.spectra import FloatArray


def misfit(one: FluorescenceData, matrix: FloatArray) -> float:
    captures = gather([one])
    left = captures.value[0] - np.tensordot(captures.design, matrix, 2)
    return float(left @ np.linalg.solve(captures.covariance[0], left) / left.size)


@pytest.mark.parametrize("seed", range(5))
def test_nearest_is_the_bounded_least_squares_solution(seed: int) -> None:
    random = np.random.Generator(np.random.Philox(key=seed))
    size = 40
    root = random.standard_normal((size, size)) / np.sqrt(size) + np.eye(size)
    mode = random.standard_normal(size)
    upper = np.where(np.arange(size) < 30, np.inf, 0.5)
    found, at_bound, done = nearest(mode, root @ root.T, np.zeros(size), upper)
    inverse = np.linalg.inv(root)
    other = lsq_linear(inverse, inverse @ mode, (0.0, upper), method="bvls").x
    assert done
    assert np.allclose(found, other, atol=1e-5)
    assert np.all(at_bound == ((found <= 0.0) | (found >= upper)))
    clipped = np.clip(mode, 0.0, upper)
    assert np.sum((inverse @ (found - mode)) ** 2) < np.sum((inverse @ (clipped - mode)) ** 2)


def test_draws_return_to_their_captures() -> None:
    random = np.random.Generator(np.random.Philox(key=3))
    design = np.abs(random.standard_normal((6, 40)))
    draws = 0.5 + random.standard_normal((50, 40))
    move = np.linalg.solve(design @ design.T, design)
    cut = back_on_captures(draws, design, move, 40)
    target = draws @ design.T
    clipped = np.maximum(draws, 0.0)
    assert cut.min() >= 0.0
    before = np.sqrt(((clipped @ design.T - target) ** 2).mean())
    assert np.sqrt(((cut @ design.T - target) ** 2).mean()) < 0.3 * before


@pytest.mark.parametrize("channels", ["spectrometer", "chip"])
def test_the_reported_matrix_fits_the_captures(channels: str) -> None:
    """And setting negative cells of the free mode to 0, as the control, does not."""
    bench = system(channels)
    given = [data(material(seed), bench, seed) for seed in range(6)]
    results = DonaldsonEstimator(DonaldsonSettings(products=0, draws=0)).estimate_batch(given)
    assert max(misfit(one, r.matrix) for one, r in zip(given, results, strict=True)) < 1.5
    quick = DonaldsonQuickSettings(rounds=1)
    rough = DonaldsonQuickEstimator(quick).estimate_batch(given)
    assert max(misfit(one, r.matrix) for one, r in zip(given, rough, strict=True)) > 1.5


def test_undetermined_cells_keep_zero_and_are_wide() -> None:
    """Without light below 470 nm, what is excited there may be nothing, or much."""
    full = system()
    half = FluorescenceSystem(full.illuminants[2:7], full.sensitivities)
    for seed in (3, 5):
        result = DonaldsonEstimator().estimate(data(material(seed), half))
        hidden = result.undetermined & BELOW
        inside = (material(seed) >= result.quantile[0] - 1e-9) & (
            material(seed) <= result.quantile[-1] + 1e-9
        )
        assert hidden.sum() > 20
        assert np.mean(result.quantile[0][hidden] <= 1e-9) > 0.6
        assert inside[hidden].mean() > 0.8


def test_interval_is_ninety_percent_also_where_it_begins_at_a_bound() -> None:
    """A tenth of the draws is outside; between the quantiles, the control, only a twentieth."""
    result = DonaldsonEstimator().estimate(data(material(3), system("chip"), 3))
    assert result.draws is not None
    low, high = result.interval
    outside = ((result.draws < low - 1e-12) | (result.draws > high + 1e-12)).mean(axis=0)
    at_zero = BELOW & (result.quantile[0] <= 0.0) & (np.mean(result.draws > 0.0, axis=0) > 0.15)
    assert at_zero.sum() > 50
    assert np.all(low[at_zero] == 0.0)
    assert np.abs(outside[at_zero] - 0.1).max() < 0.011
    assert np.abs(outside[BELOW & (result.quantile[0] > 0.0)] - 0.1).max() < 0.011
    beyond = (result.draws > result.quantile[-1] + 1e-12).mean(axis=0)
    assert beyond[at_zero].max() < 0.06
    quick = DonaldsonQuickEstimator().estimate(data(material(3), system(), 3))
    assert np.array_equal(quick.interval, quick.quantile[[0, -1]])


def test_strong_cells_are_covered_with_few_lights() -> None:
    """Four of eight lights, none violet; without what may be misshapen, the control, less."""
    from estimators.fluorescence import donaldson

    full = system()
    few = FluorescenceSystem(full.illuminants[[1, 3, 4, 6]], full.sensitivities)
    given = [data(material(seed), few, seed) for seed in range(10)]
    truth = np.array([material(seed) for seed in range(10)])
    shares = []
    kept = donaldson.misshapen
    for bent in (kept, lambda reduced, prior, *rest: np.zeros_like(prior.local)):
        donaldson.misshapen = bent  # type: ignore[assignment]
        try:
            results = DonaldsonEstimator().estimate_batch(given)
        finally:
            donaldson.misshapen = kept
        interval = np.array([r.interval for r in results])
        inside = (truth >= interval[:, 0] - 1e-9) & (truth <= interval[:, 1] + 1e-9)
        shares.append(inside[BELOW & (truth > 0.01)].mean())
    assert shares[0] > 0.85
    assert shares[1] < shares[0] - 0.02


def test_quick_is_the_linear_estimate_about() -> None:
    bench = system()
    given = [data(material(seed), bench, seed) for seed in range(8)]
    truth = np.array([material(seed) for seed in range(8)])
    estimator = fluorescence_estimator("donaldson-quick")
    linear = fluorescence_estimator("donaldson-linear", draws=0)
    error = {}
    for one in (estimator, linear):
        matrix = np.array([r.matrix for r in one.estimate_batch(given)])
        error[one.name] = np.median(np.sqrt(((matrix - truth)[:, BELOW] ** 2).mean(axis=1)))
    assert error["donaldson-quick"] < 1.5 * error["donaldson"]
    again = estimator.estimate(given[3])
    assert np.array_equal(again.matrix, estimator.estimate(given[3]).matrix)
    assert np.all(again.quantile[0] <= again.matrix)
    assert np.all(again.matrix[BELOW] >= 0.0)
    chip = estimator.estimate(data(material(1), system("chip")))
    assert chip.residual.shape == (8, 8)
    assert chip.status in (FluorescenceStatus.OK, FluorescenceStatus.INCONSISTENT)
    with pytest.raises(InputError, match="rounds"):
        fluorescence_estimator("donaldson-quick", rounds=0)


def test_quick_with_a_kept_gain_says_so_and_checks_as_without_one() -> None:
    """What an estimator remembers is part of what went in; and it refuses the same captures."""
    bench = system()
    one, other = (data(material(seed), bench, seed) for seed in (1, 2))
    fresh, used = DonaldsonQuickEstimator(), DonaldsonQuickEstimator()
    alone, _ = fresh.estimate(other), used.estimate(one)
    after = used.estimate(other)
    assert not np.array_equal(after.matrix, alone.matrix)
    assert after.fingerprint != alone.fingerprint
    assert after.fingerprint == used.estimate(other).fingerprint
    with pytest.raises(InputError, match="all zero"):
        used.estimate(replace(other, value=np.zeros_like(other.value)))
    silent = replace(other, variance=np.zeros_like(other.variance), common=other.common[:0])
    assert fresh.estimate(silent).status is FluorescenceStatus.NO_NOISE_STATED


def test_without_draws_nothing_is_said_about_intervals() -> None:
    given = data(material(3), system(), 3)
    result = DonaldsonEstimator(DonaldsonSettings(products=0, draws=0)).estimate(given)
    assert result.fluorescence.max() > 0.01
    assert result.status is not FluorescenceStatus.NO_FLUORESCENCE_SEEN
