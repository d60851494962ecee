"""The searches on a made-up predictor whose best candidates are known."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from scenarios.design import Candidate, Goal, Space, load_parts, search
from scenarios.design.search import Found, cheapest_of
from twin.errors import InputError
from twin.spectra import FloatArray

GOAL = {
    "title": "a test",
    "materials": [{"name": "resin", "albedo": 0.95, "sigma_t_per_mm": 3.0, "g": 0.7}],
    "targets": {"albedo": 0.01, "g": 0.02},
    "protocol": {"thickness_mm": [0.3, 0.6], "samples": [1, 2]},
}
BETTER = {"micrometer": 0.5, "ptfe-compared": 0.6, "certified-white": 0.5, "spectrometer": 0.7}


class MadeUp:
    """Parts divide the error by known factors."""

    targets = ("albedo", "g")

    def predict(self, candidates: Sequence[Candidate]) -> FloatArray:
        rows = []
        for each in candidates:
            factor = np.prod([BETTER.get(name, 1.0) for name in each.parts])
            rows.append([0.03 * factor / len(each.thickness_mm), 0.02 * factor])
        return np.array(rows)

    def limits(self, candidate: Candidate) -> dict[str, dict[str, float]]:
        return {}


def found(**changes: object) -> Found:
    return search(Goal.model_validate({**GOAL, **changes}), load_parts(), MadeUp())


def test_all_candidates_give_the_front_and_the_cheapest():
    result = found(search="exhaustive")
    parts = load_parts()
    size = Space.of(Goal.model_validate(GOAL), parts).size
    assert len(result.candidates) == size
    assert result.complete
    front = np.array(result.front)
    assert np.all(np.diff(result.price_usd[front]) > 0)
    assert np.all(np.diff(result.score[front]) < 0)
    # no candidate is cheaper and better than one of the front
    for number in front:
        beats = (result.price_usd <= result.price_usd[number]) & (
            result.score < result.score[number]
        )
        assert not beats.any()
    good = result.score <= 1.0
    assert result.cheapest is not None
    assert result.price_usd[result.cheapest] == result.price_usd[good].min()
    assert "ptfe-compared" in result.candidates[result.cheapest].parts


def test_greedy_goes_from_the_cheapest_up_by_what_buys_most():
    result = found(search="greedy")
    scores = result.score[list(result.path)]
    assert np.all(np.diff(scores) < 0)
    cheapest = cheapest_of(Space.of(Goal.model_validate(GOAL), load_parts()), load_parts())
    assert result.candidates[result.path[0]] == cheapest
    # the second sample is 2 dollars for half the albedo's error: before any dearer part
    assert len(result.candidates[result.path[1]].thickness_mm) == 2
    assert scores[-1] == pytest.approx(found(search="exhaustive").score.min())


def test_the_bayesian_search_finds_it_and_repeats_itself():
    pytest.importorskip("optuna", reason="the extra design is not installed")
    first = found(search="bayes", trials=60, seed=3)
    again = found(search="bayes", trials=60, seed=3)
    assert first.candidates == again.candidates
    other = found(search="bayes", trials=60, seed=4)
    assert first.candidates != other.candidates
    best = found(search="exhaustive")
    assert first.cheapest is not None
    assert best.cheapest is not None
    assert first.price_usd[first.cheapest] == best.price_usd[best.cheapest]


def test_a_budget_below_the_cheapest_set_up_is_refused_with_its_price():
    with pytest.raises(InputError, match=r"expected 80 USD or more.*leds|expected \d+ USD or more"):
        found(budget_usd=20.0)


def test_a_budget_leaves_dearer_candidates_out():
    assert found(budget_usd=120.0, search="exhaustive").price_usd.max() <= 120.0
    assert found(budget_usd=120.0, search="greedy").price_usd.max() <= 120.0


def test_a_kind_without_a_part_is_refused():
    with pytest.raises(InputError, match="no part of the kind panels"):
        found(allowed=["as7341", "leds-8"])


def test_the_command_says_what_is_reachable_and_why(tmp_path: Path):
    """End to end, on few candidates: the report, the JSON file, and a scenario that loads."""
    from scenarios.commands.design import design_file
    from scenarios.console import Console
    from scenarios.scenario import load_scenario
    from scenarios.sweep import Workers

    goal = tmp_path / "goal.toml"
    seed = load_parts().assembly("seed-translucent").parts
    allowed = json.dumps([*seed, "ruler-spacers"])
    goal.write_text(
        f"""title = "too much"
allowed = {allowed}
[[materials]]
name = "resin"
albedo = 0.95
sigma_t_per_mm = 3.0
g = 0.7
[targets]
albedo = 1e-6
[protocol]
thickness_mm = [0.3, 0.9]
samples = [2]
[verification]
candidates = 0
"""
    )
    answer = design_file(
        str(goal), out=tmp_path / "out", quick=True, simulate=False, workers=Workers(),
        as_json=True, console=Console(quiet=True),
    )  # fmt: skip
    assert answer["reached"] is False
    assert "best that is reachable" in answer["verdict"]
    assert "What limits albedo" in answer["verdict"]
    assert sum(answer["limits"]["albedo"].values()) == pytest.approx(1.0, abs=0.02)
    page = (tmp_path / "out" / "report.html").read_text("utf-8")
    assert answer["answer"]["id"] in page
    assert "<script" not in page
    assert "http:" not in page
    assert "https:" not in page
    scenario = tmp_path / "out" / "candidates" / f"{answer['answer']['id']}.toml"
    assert len(load_scenario(scenario).samples) == 2
    assert (
        answer["robust"][0]["figures"]["albedo"]["with_effects"]
        >= (answer["robust"][0]["figures"]["albedo"]["predicted"])
    )


@pytest.mark.parametrize("known", [False, True])
def test_a_study_that_cannot_be_leaves_no_folder_behind(tmp_path: Path, known: bool):
    from scenarios.commands.design import design_file
    from scenarios.console import Console
    from scenarios.sweep import Workers

    goal, out = tmp_path / "goal.toml", tmp_path / "out"
    goal.write_text(
        """title = "too little"
budget_usd = 5.0
[[materials]]
name = "resin"
albedo = 0.95
sigma_t_per_mm = 3.0
g = 0.7
[targets]
albedo = 0.01
"""
    )
    if known:
        out.mkdir()
    with pytest.raises(InputError, match="5 USD"):
        design_file(
            str(goal), out=out, quick=True, simulate=False, workers=Workers(), as_json=True,
            console=Console(quiet=True),
        )  # fmt: skip
    assert out.exists() is known, "only a folder of its own is taken away"
