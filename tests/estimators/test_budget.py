from __future__ import annotations

import csv
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from estimators.budget import INPUTS, InputUncertainty, UncertaintyBudget, uncertainty_budget
from tests.estimators.least_squares_world import COUNT, estimator, smooth_material, visit
from twin.errors import InputError

NOTHING = InputUncertainty(
    thickness_mm=0.0,
    n=0.0,
    rho_black_relative=0.0,
    rho_white_relative=0.0,
    acceptance_relative=0.0,
)


@cache
def default_budget() -> UncertaintyBudget:
    made = estimator()
    seen = visit(made, smooth_material(COUNT), noise=0.005)
    return uncertainty_budget(made, seen, monte_carlo=True, draws=150)


def test_shares_add_to_one_and_none_is_negative() -> None:
    budget = default_budget()
    assert budget.share.shape == (3, COUNT, len(INPUTS))
    np.testing.assert_allclose(budget.share.sum(axis=2), 1.0, rtol=1e-12)
    assert np.all(budget.share >= 0.0)
    assert set(budget.first.values()) <= set(INPUTS)
    assert (budget.share[..., INPUTS.index("interpolation")] == 0.0).all()


def test_linear_propagation_agrees_with_monte_carlo() -> None:
    budget = default_budget()
    assert budget.monte_carlo is not None
    ratio = budget.monte_carlo / budget.standard_uncertainty
    # a standard deviation of 150 draws is uncertain by 6 %; inputs are shared by wavelengths
    assert np.all(np.abs(ratio - 1.0) < 0.30)
    assert np.all(np.abs(np.median(ratio, axis=1) - 1.0) < 0.20)
    # a budget that forgets an input would have been found out
    forgotten = np.sqrt(budget.variance[1].sum(axis=1) - budget.variance[1, :, 1])
    assert abs(np.median(budget.monte_carlo[1] / forgotten) - 1.0) > 0.20


@pytest.mark.parametrize("name", sorted(vars(NOTHING)))
def test_an_input_without_uncertainty_has_no_share_and_one_with_it_has(name: str) -> None:
    made = estimator()
    seen = visit(made, smooth_material(COUNT), noise=0.005)
    quiet = uncertainty_budget(made, seen, NOTHING)
    loud = uncertainty_budget(made, seen, replace(NOTHING, **{name: 0.02}))
    assert (quiet.share[..., 1:6] == 0.0).all()
    assert quiet.first == dict.fromkeys(quiet.parameters, "counts and references")
    place = {
        "thickness_mm": 1,
        "n": 2,
        "rho_black_relative": 3,
        "rho_white_relative": 4,
        "acceptance_relative": 5,
        "interpolation_relative": 7,
    }[name]
    assert np.all(loud.variance[..., place] > 0.0)
    others = np.delete(loud.variance, place, axis=2)
    np.testing.assert_array_equal(others, np.delete(quiet.variance, place, axis=2))


def test_the_least_squares_covariance_is_that_of_its_own_inputs() -> None:
    made = estimator()
    seen = visit(made, smooth_material(COUNT), noise=0.005)
    budget = uncertainty_budget(made, seen, NOTHING)
    result = made.estimate(seen)
    plain = result.statistics["chi_square"] < 10.0
    np.testing.assert_allclose(
        budget.standard_uncertainty.T[plain], result.standard_error[plain], rtol=1e-3
    )


def test_thickness_of_a_clear_sample_is_relative_one_to_one() -> None:
    made = estimator()
    truth = np.tile([1e-4, 2.0, 0.3], (COUNT, 1))
    seen = visit(made, truth, noise=1e-4, floor=1e-5)
    valid = seen.valid.copy()
    valid[1] = False
    budget = uncertainty_budget(made, replace(seen, valid=valid), NOTHING)
    thick = uncertainty_budget(
        made, replace(seen, valid=valid), replace(NOTHING, thickness_mm=0.004)
    )
    good = np.isfinite(thick.estimate[1])
    assert good.mean() > 0.5
    relative = np.sqrt(thick.variance[1, good, 1]) / thick.estimate[1, good]
    np.testing.assert_allclose(relative, 0.004 / 0.4, rtol=0.01)
    assert np.all(budget.variance[1, good, 1] == 0.0)


def test_the_table_and_the_file_say_the_same(tmp_path: Path) -> None:
    budget = default_budget()
    rows = budget.to_table()
    assert [row["parameter"] for row in rows] == list(budget.parameters)
    for row in rows:
        assert abs(sum(float(row[name]) for name in INPUTS) - 1.0) < 1e-9
    path = budget.write_csv(tmp_path / "budget.csv")
    with path.open(encoding="utf-8", newline="") as file:
        table = list(csv.DictReader(file))
    assert len(table) == COUNT * 3 * (len(INPUTS) + 1)
    first = table[1]
    assert (first["parameter"], first["input"]) == ("albedo", "thickness")
    np.testing.assert_allclose(float(first["variance_share"]), budget.share[0, 0, 1], rtol=1e-5)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["budget.csv"]


def test_wrong_uncertainties_are_refused() -> None:
    with pytest.raises(InputError, match="standard uncertainty"):
        InputUncertainty(n=-0.1)
    with pytest.raises(InputError, match="draws"):
        uncertainty_budget(
            estimator(), visit(estimator(), smooth_material(COUNT)), monte_carlo=True, draws=3
        )


def test_what_is_not_identifiable_has_no_budget() -> None:
    made = estimator()
    truth = smooth_material(COUNT)
    truth[:10] = [1e-6, 2.0, 0.5]
    budget = uncertainty_budget(made, visit(made, truth, noise=0.005), NOTHING)
    assert np.isnan(budget.variance[2, :10]).all()
    assert np.isfinite(budget.variance[2, 10:]).all()


def test_the_plot_names_what_matters_and_is_the_same_again() -> None:
    from scenarios.report.budget_plot import draw_budget

    budget = default_budget()
    picture = draw_budget(budget)
    assert picture == draw_budget(budget)
    assert picture.startswith("<svg")
    for name in set(budget.first.values()):
        assert f">{name}<" in picture
    assert ">interpolation<" not in picture
    few = replace(
        budget,
        wavelength_nm=budget.wavelength_nm[:3],
        estimate=budget.estimate[:, :3],
        variance=budget.variance[:, :3],
        monte_carlo=None,
    )
    assert draw_budget(few) != picture
