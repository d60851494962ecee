"""The mean of the fit and of the network: its ends, its bounds, its residual, its intervals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimators.fluorescence import fluorescence_estimator
from estimators.fluorescence.both import DonaldsonBothEstimator, DonaldsonBothSettings
from estimators.fluorescence.donaldson import DonaldsonEstimator
from estimators.fluorescence.learned import DonaldsonLearnedEstimator
from tests.fluorescence.cases import BELOW, material, system
from tests.fluorescence.test_estimators_learned import SMALL, data
from twin.errors import InputError

BENCH = system("chip")


@pytest.fixture(scope="module")
def learned() -> DonaldsonLearnedEstimator:
    """A small network for the chip, made from ten samples."""
    estimator = DonaldsonLearnedEstimator(SMALL)
    estimator.estimate_batch([data(material(seed), BENCH, seed) for seed in range(10)])
    return estimator


def test_its_ends_are_the_fit_and_the_network(learned: DonaldsonLearnedEstimator) -> None:
    one = data(material(40), BENCH, 40)
    fitted, network = DonaldsonEstimator().estimate(one), learned.estimate(one)
    found = {
        share: DonaldsonBothEstimator(DonaldsonBothSettings(share=share), learned).estimate(one)
        for share in (0.0, 0.3, 1.0)
    }
    assert np.array_equal(found[0.0].matrix, fitted.matrix)
    assert np.array_equal(found[0.0].interval, fitted.interval)
    assert np.allclose(found[0.0].residual, fitted.residual, atol=1e-12)
    assert np.allclose(found[0.0].residual_normalised, fitted.residual_normalised, rtol=1e-6)
    assert np.allclose(found[1.0].matrix, network.matrix, atol=1e-12)
    between = 0.7 * fitted.matrix + 0.3 * network.matrix
    assert np.allclose(found[0.3].matrix, between, atol=1e-12)
    assert len({each.fingerprint for each in (*found.values(), fitted, network)}) == 5


def test_it_is_nearer_the_truth_and_its_intervals_cover(learned: DonaldsonLearnedEstimator) -> None:
    """Nearer than the two are in the mean; a fifth as wide, the control, intervals cover less."""
    seeds = range(50, 66)
    given = [data(material(seed), BENCH, seed) for seed in seeds]
    truth = np.array([material(seed) for seed in seeds])
    both = DonaldsonBothEstimator(learned=learned)
    error, results = {}, both.estimate_batch(given)
    for name, found in (
        ("both", results), ("fit", DonaldsonEstimator().estimate_batch(given)),
        ("network", learned.estimate_batch(given)),
    ):  # fmt: skip
        matrix = np.array([each.matrix for each in found])
        error[name] = np.sqrt(((matrix - truth)[:, BELOW] ** 2).mean(axis=1))
    mean = 0.7 * error["fit"] + 0.3 * error["network"]
    assert np.all(error["both"] <= mean + 1e-12)
    assert np.exp(np.log(error["both"] / mean).mean()) < 0.97
    interval = np.array([each.interval for each in results])
    matrix = np.array([each.matrix for each in results])
    fifth = matrix[:, None] + 0.2 * (interval - matrix[:, None])
    strong = BELOW & (truth > 0.003)
    inside, narrow = (
        ((truth >= edge[:, 0] - 1e-9) & (truth <= edge[:, 1] + 1e-9))[strong].mean()
        for edge in (interval, fifth)
    )
    assert inside > 0.8
    assert narrow < inside - 0.1


def test_bounds_hold_and_what_is_zero_stays_zero(learned: DonaldsonLearnedEstimator) -> None:
    one = data(material(41), BENCH, 41)
    fitted = DonaldsonEstimator().estimate(one)
    found = DonaldsonBothEstimator(DonaldsonBothSettings(share=1.0), learned).estimate(one)
    assert found.draws is not None
    assert fitted.draws is not None
    assert found.draws.min() >= 0.0
    assert found.draws[:, found.is_diagonal].max() <= 1.0
    assert np.all(found.draws[fitted.draws == 0.0] == 0.0)
    assert np.any((fitted.draws == 0.0)[:, BELOW])
    assert np.all(found.matrix[~(BELOW | found.is_diagonal)] == 0.0)


def test_reports_go_to_the_network_and_masked_captures_stay_masked(
    learned: DonaldsonLearnedEstimator,
) -> None:
    both = fluorescence_estimator("donaldson-both", share=0.5)
    told: list[float] = []
    both.report = lambda done, total: told.append(done / total)  # type: ignore[attr-defined]
    both._learned.report(1.0, 2.0)  # type: ignore[attr-defined]
    assert told == [0.5]
    one = data(material(42), BENCH, 42)
    valid = one.valid.copy()
    valid[2, 3] = False
    masked = replace(one, valid=valid)
    settings = replace(SMALL, materials=600, epochs=1, width=16, layers=1)
    found = DonaldsonBothEstimator(learned=DonaldsonLearnedEstimator(settings)).estimate(masked)
    assert np.isnan(found.residual[2, 3])
    assert np.isfinite(found.residual).sum() == valid.sum()
    for share in (-0.1, 1.1, True, float("nan")):
        with pytest.raises(InputError, match="share"):
            fluorescence_estimator("donaldson-both", share=share)
