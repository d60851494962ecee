"""Plans: what a wrong file is answered with, and what options change."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from scenarios.stress.plan import builtin_plans, load_plan
from tests.stress.tiny import tiny, tiny_plan, write
from twin.errors import InputError

CHIP = {"chip": {"instrument": {"kind": "chip"}}}


@pytest.mark.parametrize(
    ("changes", "place", "words"),
    [
        ({"pointz": 5}, "pointz", "Did you mean `points`?"),
        ({"points": 1}, "points", "greater than or equal to 2"),
        ({"materials": {"albedo": [0.5, 1.0]}}, "materials.albedo", "to below 1"),
        ({"materials": {"sigma_t_per_mm": [3.0, 1.0]}}, "materials.sigma_t_per_mm", "increase"),
        ({"materials": {"g": [0.0, float("nan")]}}, "materials.g[1]", "finite"),
        ({"materials": {"grid": [1, 1, 1]}}, "materials.grid", "two points or more"),
        ({"noise": [0.0]}, "noise", "factors"),
        ({"noise": [1.0, 1.0]}, "noise", "different"),
        ({"thickness_mm": [-0.4]}, "thickness_mm", "above 0 mm"),
        ({"estimators": []}, "estimators", "one or more"),
        ({"estimators": ["lut", "lut"]}, "estimators", "a label of its own"),
        ({"estimators": [{"name": "lut", "option": {}}]}, "estimators[0].option", "options"),
        ({"benches": {}}, "", "one or more"),
        ({"benches": CHIP}, "", "spectrometer"),
        ({"benches": {"b": "missing.toml"}}, "", "no such file"),
        ({"light": {"relative_error": 0}}, "light.relative_error", "greater than 0"),
    ],
)
def test_a_wrong_plan_gets_one_clear_error(
    tmp_path: Path, changes: dict[str, Any], place: str, words: str
):
    path = write(tmp_path / "plan.toml", tiny(**changes))
    with pytest.raises(InputError) as caught:
        load_plan(path)
    error = caught.value
    assert error.place == place
    assert str(tmp_path) in error.file
    assert words in str(error)


def test_what_is_not_toml_or_not_there_is_said(tmp_path: Path):
    broken = tmp_path / "plan.toml"
    broken.write_text("title = \n", encoding="utf-8")
    with pytest.raises(InputError, match="line 1"):
        load_plan(broken)
    with pytest.raises(InputError, match="no such file"):
        load_plan(tmp_path / "none.toml")
    with pytest.raises(InputError, match="Did you mean `default`"):
        load_plan("defualt")


@pytest.mark.parametrize("name", builtin_plans())
def test_built_in_plans_can_be_read(name: str):
    plan = load_plan(name)
    assert plan.estimators
    assert plan.settled() == plan


def test_options_replace_what_the_plan_says(tmp_path: Path):
    table = tiny(estimators=[{"name": "lut", "label": "few", "options": {"draws": 60}}, "beer"])
    plan = load_plan(write(tmp_path / "plan.toml", table))
    settled = plan.settled(seed=9, points=20, estimators=["few", "kubelka"])
    assert (settled.seed, settled.points) == (9, 20)
    assert [each.title for each in settled.estimators] == ["few", "kubelka"]
    assert settled.estimators[0].options == {"draws": 60}
    quick = tiny_plan(points=5000).settled(quick=True)
    assert quick.points == 64
    assert quick.light.relative_error == 0.003


def test_a_bench_file_beside_the_plan_is_read(tmp_path: Path):
    (tmp_path / "bare.toml").write_text("covers_above = []\n", encoding="utf-8")
    plan = load_plan(write(tmp_path / "plan.toml", tiny(benches={"bare": "bare.toml"})))
    assert plan.benches["bare"].covers_above == ()


def test_points_for_a_grid_are_refused():
    plan = tiny_plan(materials={"grid": [2, 2, 2]})
    with pytest.raises(InputError, match="random design only"):
        plan.settled(points=9)
