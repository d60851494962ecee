"""Predicted accuracy of fluorescence set-ups: closed form, invariances, and against simulation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimators.fluorescence.donaldson import SMOOTHER
from scenarios.design.fluorescent import predict_fluorescence, predict_light_subsets, typical
from scenarios.design.fluorescent_channels import pools, subset_pool, white_rates
from scenarios.design.fluorescent_compare import compared, table1
from scenarios.design.fluorescent_linear import LinearEstimates
from scenarios.design.fluorescent_parts import SEED_LIGHTS, assembled
from scenarios.design.fluorescent_population import fluorescent_population
from scenarios.design.fluorescent_prior import Population, linearised_population
from scenarios.design.fluorescent_search import SEED_DESIGNS, FluorescentDesign, varied_designs
from twin.errors import InputError
from twin.fluorescence import FluorescenceProtocol, named_setup

PROTOCOL = FluorescenceProtocol()


@pytest.fixture(scope="module")
def population() -> Population:
    return linearised_population(fluorescent_population(4))


def test_population_is_reproducible_and_grows() -> None:
    few, more = fluorescent_population(2, seed=5), fluorescent_population(3, seed=5)
    for one, other in zip(few, more, strict=False):
        assert one.matrix.tobytes() == other.matrix.tobytes()
        assert one.name == other.name
    assert more[0].matrix.tobytes() != fluorescent_population(1, seed=6)[0].matrix.tobytes()
    assert " + " not in few[0].name
    assert " + " in few[1].name
    for each in more:
        assert each.matrix.min() >= 0.0
        assert each.matrix.diagonal().max() <= 1.0


def test_products_explain_one_dye_and_need_two_for_two(population: Population) -> None:
    for number, priors in enumerate(population.priors):
        left = []
        for each in priors:
            # The expansion point: products at their fitted parameters are mean + J t0.
            value = _at_expansion(population, each.jacobian, each.mean)
            left.append(np.sqrt(((value - population.truth[number, :465]) ** 2).mean()))
        assert left[-1] < 5e-4
        if number % 2:
            assert len(priors) == 2
            assert left[0] > 2.0 * left[1]


def _at_expansion(population, jacobian, mean):  # type: ignore[no-untyped-def]
    """Cells at t0: the linearised products nearest to any truth's fit lie on mean + J t."""
    truths = population.truth[:, :465]
    best = None
    for truth in truths:
        t, *_ = np.linalg.lstsq(
            np.vstack([jacobian, 1e-3 * np.eye(jacobian.shape[1])]),
            np.concatenate([truth - mean[:465], np.zeros(jacobian.shape[1])]), rcond=None,
        )  # fmt: skip
        value = mean[:465] + jacobian @ t
        error = np.sqrt(((value - truth) ** 2).mean())
        if best is None or error < best[0]:
            best = (error, value)
    assert best is not None
    return best[1]


def test_estimate_is_the_posterior_mean_where_no_bound_acts(population: Population) -> None:
    """Against the textbook formula in the space of all captures, without any reduction."""
    size, count = population.truth.shape[1], population.size
    mean = np.full(size, 0.4)
    mean[:count] = 0.05
    smooth = 1e-3 * population.smooth
    random = np.random.Generator(np.random.Philox(key=3))
    truth = mean + 1e-3 * random.standard_normal((4, size))
    plain = replace(
        population, truth=truth, mean=mean, smooth=smooth, priors=((), (), (), ()),
        roughness=(7e-4,),
    )  # fmt: skip
    setup = assembled(SEED_LIGHTS["L1"][:3], "S2")
    # The directions of the pool come from the population's priors: kept whole here.
    pool = subset_pool(setup, [(0, 1, 2), (0, 2)], PROTOCOL, population, 2, 0.0)
    found = LinearEstimates.of(pool, plain).estimates(pool.members)
    for answers, lights in zip(found, pool.members, strict=True):
        rows = np.flatnonzero(np.isin(pool.light, lights))
        design, noise = pool.design[rows], pool.noise.mean(axis=0)[np.ix_(rows, rows)]
        prior = smooth.copy()
        # the estimator takes less roughness than the evidence of no product chooses
        prior[np.arange(count), np.arange(count)] += (SMOOTHER * 7e-4) ** 2
        gain = prior @ design.T @ np.linalg.inv(design @ prior @ design.T + noise)
        for b in range(4):
            captures = design @ (truth[b] - mean) + pool.draws[b][:, rows]
            expected = mean + captures @ gain.T
            np.testing.assert_allclose(answers[b], expected, atol=2e-7)
    # Control: with noise ten times larger the formula is another.
    wrong = prior @ design.T @ np.linalg.inv(design @ prior @ design.T + 1e4 * noise)
    assert np.abs(mean + captures @ wrong.T - expected).max() > 1e-5


def test_all_lights_of_a_set_up_are_the_set_up(population: Population) -> None:
    setup = named_setup("l1-s2")
    whole = predict_fluorescence([setup], population)
    subsets = predict_light_subsets(setup, [range(8), (7, 6, 5, 4, 3, 2, 1, 0)], population)
    np.testing.assert_allclose(subsets.lower[0], whole.lower[0], rtol=1e-6)
    np.testing.assert_allclose(subsets.lower[1], whole.lower[0], rtol=1e-6)


def test_more_lights_help_and_no_fluorescence_is_the_worst(population: Population) -> None:
    setup = named_setup("l1-s2")
    nested = [(7,), (6, 7), (3, 6, 7), (0, 3, 6, 7), tuple(range(8))]
    found = predict_light_subsets(setup, nested, population)
    assert np.all(np.diff(found.rmse_lower) < 0.0)
    assert found.rmse_lower[-1] < 0.4 * typical(population.floor)
    # A light that excites nothing says nothing of fluorescence: what is predicted is not far from
    # predicting none.
    red = predict_light_subsets(setup, [(5,)], population)
    assert 0.5 < red.rmse_lower[0] / typical(population.floor) < 2.0


def test_noise_makes_it_worse(population: Population) -> None:
    setup = named_setup("l1-s2")
    loud = setup.detector.model_copy(update={"read_noise_electrons": 30_000.0})
    noisy = setup.model_copy(update={"detector": loud})
    short = FluorescenceProtocol(repeats=1, white_repeats=1)
    found = predict_fluorescence([setup, noisy], population, [PROTOCOL, short])
    assert found.rmse_diagonal[1] > 1.3 * found.rmse_diagonal[0]


def test_a_light_keeps_its_brightness_and_its_noise_in_every_choice(
    population: Population,
) -> None:
    names = SEED_LIGHTS["L1"]
    all_rates = dict(zip(names, white_rates(assembled(names, "S2")), strict=True))
    few = names[2:5]
    for name, rate in zip(few, white_rates(assembled(few, "S2")), strict=True):
        assert rate == pytest.approx(all_rates[name], rel=1e-9)
    one, other = (
        pools([assembled(few, "S2"), assembled(names[4:], "S2")][:count], [PROTOCOL] * count,
              population, 1)[0]
        for count in (1, 2)
    )  # fmt: skip
    assert len(np.unique(other.light)) == 6  # amber is in both and in the pool once
    assert len(np.unique(one.light)) == 3


def test_prediction_and_simulation_agree_and_a_wrong_prediction_does_not() -> None:
    good = SEED_DESIGNS["L1-S2"]
    poor = FluorescentDesign(good.lights[2:5], "S2")
    found = compared([good, poor], materials=4, population_seed=9)
    ratio, error = found.ratio(), found.ratio_error()
    assert np.all(np.abs(np.log(ratio)) < 0.15 + 2.5 * error)
    assert found.rank_correlation() == pytest.approx(1.0)
    crossed = typical(found.predicted.lower[1]) / typical(found.simulated.lower[0])
    assert abs(np.log(crossed)) > 0.15 + 2.5 * error.max()
    relative, spread = found.simulated_against(0)
    assert (relative[0], spread[0]) == (1.0, 0.0)
    assert relative[1] > 1.0
    with pytest.raises(InputError, match="L1-S1"):
        table1(found)


def test_bad_input(population: Population) -> None:
    setup = named_setup("l1-s2")
    with pytest.raises(InputError, match="0 set-ups"):
        predict_fluorescence([], population)
    with pytest.raises(InputError, match="2 protocols"):
        predict_fluorescence([setup], population, [PROTOCOL, PROTOCOL])
    with pytest.raises(InputError, match="wavelengths of the population"):
        predict_fluorescence([named_setup("l1-s2", excitation_from_nm=380.0)], population)
    with pytest.raises(InputError, match="0 to 7"):
        predict_light_subsets(setup, [(8,)], population)
    with pytest.raises(InputError, match="no material"):
        linearised_population([])
    with pytest.raises(InputError, match="1 materials"):
        predict_fluorescence([setup], linearised_population(fluorescent_population(1)))


def test_varied_designs_are_distinct_and_none_of_the_seed() -> None:
    found = varied_designs(20, seed=2)
    assert len(set(found)) == 20
    assert not set(found) & set(SEED_DESIGNS.values())


def test_fitted_products_start_at_the_truth_and_settle(population: Population) -> None:
    setup = named_setup("l1-s2")
    few, most, more = (
        predict_fluorescence([setup], population, draws=1, steps=steps) for steps in (1, 15, 40)
    )
    # One damped step from the truth stays near it, and would promise too much.
    assert few.rmse_lower[0] < 0.8 * most.rmse_lower[0]
    np.testing.assert_allclose(more.lower, most.lower, rtol=0.05)
