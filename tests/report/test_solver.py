"""What a report shows of the solver: statistics, corner plots, the budget."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from estimators import EstimateResult, InputUncertainty, UncertaintyBudget
from estimators.budget import INPUTS
from scenarios.report import write_report
from scenarios.report.budget_page import budget_page, budget_sentences, budget_table
from scenarios.report.reading import content_of
from scenarios.report.solver import corner_places, statistic_rows, statistic_sentence
from tests.report.fake import estimate, generator, visit

MEASUREMENT = visit()


def posterior() -> EstimateResult:
    """The made-up estimate with draws around it; the error of sigma_t grows with wavelength."""
    result = estimate(MEASUREMENT)
    count = result.wavelength_nm.size
    wider = np.stack([np.ones(count), np.linspace(1, 3, count), np.ones(count)], axis=-1)
    noise = generator(5).standard_normal((200, count, 3)) * result.standard_error * wider
    statistics = {
        "chi_square": np.full(count, 2.0),
        "degrees_of_freedom": np.full(count, 4.0),
        "converged": np.where(np.arange(count) < 3, 0.0, 1.0),
    }
    return replace(
        result,
        estimator="posterior",
        draws=np.clip(result.parameters + noise, 0.0, None),
        statistics=statistics,
    )


def budget(scale: float = 1.0, monte_carlo: bool = False) -> UncertaintyBudget:
    """Thickness to blame for sigma_t, counts for the rest; g unknown at the first wavelength."""
    wavelength = np.array([450.0, 550.0, 650.0])
    variance = np.full((3, 3, len(INPUTS)), 1e-8)
    variance[0, :, 0] = variance[2, :, 0] = variance[1, :, 1] = 1e-4
    variance[2, 0] = np.nan
    made = UncertaintyBudget(
        wavelength_nm=wavelength,
        parameters=("albedo", "sigma_t_per_mm", "g"),
        inputs=INPUTS,
        estimate=np.full((3, 3), 0.5),
        variance=variance,
        stated=InputUncertainty(),
    )
    if not monte_carlo:
        return made
    return replace(made, monte_carlo=scale * made.standard_uncertainty, draws=50)


def test_statistics_are_told_with_their_meaning():
    rows = {row.name: row for row in statistic_rows(posterior())}
    assert rows["chi square"].median == "2"
    assert rows["converged"].low == "0"
    assert all(row.meaning for row in rows.values())
    said = statistic_sentence(posterior())
    assert "0.50 times its degrees of freedom" in said
    assert f"converged at {MEASUREMENT.wavelength_nm.size - 3} of" in said


def test_without_statistics_nothing_is_said():
    result = estimate(MEASUREMENT)
    assert statistic_rows(result) == ()
    assert statistic_sentence(result) == ""


def test_corner_plots_stand_where_sigma_t_is_least_and_most_certain():
    result = posterior()
    content = content_of(MEASUREMENT, result, ())
    places = corner_places(result, content)
    spread = np.std(result.draws[:, :, 1], axis=0) / result.sigma_t_per_mm
    assert set(places) == {int(spread.argmin()), int(spread.argmax())}
    few = replace(result, draws=result.draws[:10])
    assert corner_places(few, content) == ()
    assert corner_places(estimate(MEASUREMENT), content) == ()


def test_the_report_shows_all_of_it_without_pictures(tmp_path: Path):
    path = write_report(
        MEASUREMENT, posterior(), tmp_path / "report.html", budget=budget(monte_carlo=True)
    )
    page = path.read_text(encoding="utf-8")
    assert 'href="#solver"' in page
    assert 'href="#budget"' in page
    assert page.count("Posterior of albedo") == 2
    assert "<image" not in page  # the page's own policy would not show one
    assert "http" not in page.replace("http-equiv", "")
    again = write_report(
        MEASUREMENT, posterior(), tmp_path / "again.html", budget=budget(monte_carlo=True)
    )
    assert again.read_bytes() == path.read_bytes()


def test_the_budget_says_what_to_improve_first():
    said = " ".join(budget_sentences(budget(1.5, monte_carlo=True)))
    assert "Extinction σt: thickness first, 100 %" in said
    assert "Albedo: counts and references first" in said
    assert "50 draws of all inputs give 1.50 times" in said
    table = budget_table(budget())
    assert [row[0] for row in table["rows"]] == list(INPUTS)
    assert table["rows"][1] == ["thickness", "0.01 mm, each sample", "< 1 %", "100 %", "< 1 %"]
    assert table["foot"][1][2:] == ["3", "3", "2"]


@pytest.mark.parametrize("known", [True, False])
def test_a_budget_of_nothing_is_said_too(known: bool):
    made = budget()
    if not known:
        made = replace(made, variance=np.full_like(made.variance, np.nan))
    page = budget_page(made, MEASUREMENT)
    assert ("<svg" in page) is known
    assert ("there is no budget" in page) is not known
