"""Parts, prices, goals and candidates: the seed's table, and wrong input."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scenarios.design import Candidate, Goal, Space, builtin_goals, load_goal, load_parts
from scenarios.scenario import load_scenario
from twin.errors import InputError

TABLE_1 = {"l1-s1": 2004, "l1-s2": 29, "l2-s1": 2165, "l2-s2": 190, "reference": 20500}
SEED = load_parts().assembly("seed-translucent").parts
GOAL = {
    "title": "a test",
    "materials": [{"name": "resin", "albedo": 0.95, "sigma_t_per_mm": 3.0, "g": 0.7, "n": 1.4}],
    "targets": {"albedo": 0.01},
}
PART = """[[parts]]
name = "own-chip"
kind = "detector"
title = "A chip of mine"
price_usd = 12
source = "my bench"
bench = { instrument = { kind = "chip" } }
"""


def written(tmp_path: Path, text: str, name: str = "goal.toml") -> Path:
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(("name", "price"), TABLE_1.items())
def test_the_seeds_set_ups_cost_what_its_table_says(name: str, price: float):
    parts = load_parts()
    assert parts.price(parts.assembly(name).parts) == price


def test_every_price_says_when_and_by_whom():
    for part in load_parts().by_name.values():
        assert part.priced_on is not None
        assert part.price_source.startswith(("estimate", "Iser, Lachiver and Wilkie 2023"))


def test_parts_of_ones_own_join_and_replace(tmp_path: Path):
    dearer = PART.replace("own-chip", "as7341").replace("12", "30")
    parts = load_parts(written(tmp_path, PART + dearer, "parts.toml"))
    assert parts.price(["own-chip", "as7341"]) == 42
    assert "own-chip" not in load_parts().by_name


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (PART.replace("price_usd = 12\n", ""), "own-chip.*without a price"),
        (PART.replace('kind = "detector"', 'kind = "detectr"'), "detectr"),
        (PART + 'tolerances = [{ effect = "gremlins", scale = 1.0, source = "?" }]', "gremlins"),
        (PART + 'tolerances = [{ scale = 1.0, source = "?" }]', "an input or an effect"),
        (PART + PART, "twice"),
    ],
)
def test_wrong_parts_are_refused_in_one_message(tmp_path: Path, text: str, message: str):
    with pytest.raises(InputError, match=message):
        load_parts(written(tmp_path, text, "parts.toml"))


def goal_text(**changes: str) -> str:
    head = {"title": '"t"', **changes}
    lines = [f"{key} = {value}" for key, value in head.items()]
    return "\n".join([*lines, '[[materials]]\nname = "polyjet_white"', "[targets]\nalbedo = 0.01"])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"budget_usd": "0"}, "a budget of 0 USD"),
        ({"allowed": '["as7342"]'}, "Did you mean `as7341`"),
        ({"compare": '["l1-s3"]'}, "Did you mean `l1-s"),
        ({"budgt_usd": "5"}, "Did you mean `budget_usd`"),
        ({"parts": '"none.toml"'}, "no such file"),
    ],
)
def test_wrong_goals_are_refused_in_one_message(
    tmp_path: Path, changes: dict[str, str], message: str
):
    with pytest.raises(InputError, match=message):
        load_goal(written(tmp_path, goal_text(**changes)))


def test_unknown_goals_and_materials_are_refused(tmp_path: Path):
    with pytest.raises(InputError, match="Did you mean `resin`"):
        load_goal("resn")
    text = goal_text().replace("polyjet_white", "polyjet_whit")
    with pytest.raises(InputError, match="polyjet_whit"):
        load_goal(written(tmp_path, text))


@pytest.mark.parametrize("name", builtin_goals())
def test_built_in_goals_load(name: str):
    goal, parts = load_goal(name)
    assert Space.of(goal, parts).size > 1


def test_a_range_of_materials_is_spread_over_it():
    ranges = {"name": "r", "albedo": (0.8, 0.9), "sigma_t_per_mm": (1.0, 4.0), "g": (0.0, 0.5)}
    goal = Goal.model_validate({**GOAL, "materials": [{**ranges, "count": 8}]})
    values = np.array([medium.values for medium in goal.media])
    assert values.shape == (8, 3)
    assert np.all(values > [0.8, 1.0, 0.0])
    assert np.all(values < [0.9, 4.0, 0.5])
    assert len(np.unique(values[:, 0])) == 8


def test_a_candidate_is_told_again_by_its_scenario_file(tmp_path: Path):
    goal, parts = Goal.model_validate(GOAL), load_parts()
    own = Candidate(SEED, (0.3, 0.9), averages=40, acceptance_deg=2.0)
    scenario = load_scenario(written(tmp_path, own.toml(parts, goal)))
    assert scenario.bench == own.bench(parts, goal.wavelength.wavelength_nm.tolist())
    assert [sample.thickness_mm for sample in scenario.samples] == [0.3, 0.9]
    assert own.price(parts) == parts.price(SEED) + 2 * 2


def test_the_id_changes_with_everything_that_decides(tmp_path: Path):
    parts = load_parts()
    dearer = load_parts(
        written(
            tmp_path,
            '[[parts]]\nname = "as7341"\nkind = "detector"\ntitle = "t"\nprice_usd = 26\n'
            'source = "s"\n',
            "p.toml",
        )
    )
    chip = tuple("as7341" if name == "spectrometer" else name for name in SEED)
    ids = {
        Candidate(SEED, (0.3, 0.9)).id(parts),
        Candidate(SEED, (0.3, 0.8)).id(parts),
        Candidate(SEED, (0.3, 0.9), averages=11).id(parts),
        Candidate(chip, (0.3, 0.9)).id(parts),
        Candidate(chip, (0.3, 0.9)).id(dearer),
    }
    assert len(ids) == 5
    assert Candidate(SEED, (0.3, 0.9)).id(parts) == Candidate(SEED, (0.3, 0.9)).id(load_parts())


def test_tolerances_of_several_parts_add_as_squares(tmp_path: Path):
    text = PART + 'tolerances = [{ input = "n", scale = 0.012, source = "?" }]'
    parts = load_parts(written(tmp_path, text, "parts.toml"))
    own = tuple("own-chip" if name == "spectrometer" else name for name in SEED)
    assert Candidate(own, (0.3,)).tolerances(parts)["n"] == pytest.approx(np.hypot(0.012, 0.005))
