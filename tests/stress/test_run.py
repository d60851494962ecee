"""Running a plan: what is finished is kept, and the end is the same to the byte."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from estimators import registry
from scenarios.stress.parts import Case
from scenarios.stress.run import CHUNKS, run_plan
from scenarios.stress.tables import TIMING, write_outcome
from tests.stress.tiny import tiny_plan
from twin.errors import InputError

PLAN = tiny_plan(estimators=[{"name": "beer"}, {"name": "toy"}], noise=[1.0, 3.0])
PARTS = 8  # two visits, two noise levels, two estimators


@pytest.fixture(autouse=True)
def _toy(monkeypatch: pytest.MonkeyPatch):
    entry = registry._Entry("tests.stress.tiny", "Toy", "ToySettings")
    monkeypatch.setitem(registry._OURS, "toy", entry)


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


def files(folder: Path) -> dict[str, bytes]:
    """Contents of an output folder, but for the times."""
    return {
        path.name: path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and "seconds" not in path.name and path.name != TIMING
    }


class Killed(Exception):
    """What stops a run in the tests."""


def test_a_killed_run_goes_on_and_ends_with_the_same_bytes(tmp_path: Path, cache: Path):
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    write_outcome(run_plan(PLAN, whole, cache=cache, threads=1), whole, "tiny")
    stored: list[Path] = []

    def kill(path: Path) -> None:
        stored.append(path)
        if len(stored) == 3:
            raise Killed

    with pytest.raises(Killed):
        run_plan(PLAN, broken, cache=tmp_path / "cache", threads=2, stored=kill)
    assert len(list((broken / CHUNKS).glob("*.part"))) == 3
    resumed: list[Path] = []
    outcome = run_plan(PLAN, broken, cache=tmp_path / "cache", threads=2, stored=resumed.append)
    write_outcome(outcome, broken, "tiny")
    assert len(resumed) == PARTS - 3
    assert not set(resumed) & set(stored)
    assert files(broken) == files(whole)
    # The check can fail: another seed ends with other bytes.
    other = tmp_path / "other"
    changed = PLAN.model_copy(update={"seed": 2})
    write_outcome(run_plan(changed, other, cache=cache), other, "tiny")
    assert files(other)["points.csv"] != files(whole)["points.csv"]


def test_a_damaged_part_is_computed_again(tmp_path: Path, cache: Path):
    first: list[Path] = []
    run_plan(PLAN, tmp_path, cache=cache, stored=first.append)
    before = first[0].read_bytes()
    first[0].write_bytes(before[:-7])
    again: list[Path] = []
    run_plan(PLAN, tmp_path, cache=cache, stored=again.append)
    assert again == [first[0]]
    assert first[0].read_bytes() == before


def test_an_estimator_that_raises_is_a_failure_and_the_others_go_on(tmp_path: Path, cache: Path):
    toys = [{"name": "toy", "label": "broken", "options": {"raises": True}}, {"name": "beer"}]
    plan = tiny_plan(estimators=toys, noise=[1.0])
    outcome = run_plan(plan, tmp_path, cache=cache)
    assert outcome.raised == ("broken: ZeroDivisionError: the toy is broken",)
    broken, beer = (outcome.answers[Case("bench", 1.0, name)] for name in ("broken", "beer"))
    assert not broken.answered.any()
    assert beer.answered.all()
    summary = write_outcome(outcome, tmp_path, "tiny")
    assert [row["estimator"] for row in summary["worlds"][0]["ranking"]] == ["beer", "broken"]


def test_answers_belong_to_their_points(tmp_path: Path, cache: Path):
    outcome = run_plan(PLAN, tmp_path, cache=cache)
    answers = outcome.answers[Case("bench", 1.0, "beer")]
    truth = outcome.design.material
    assert np.abs(answers.value[:, 1] / truth[:, 1] - 1).max() < 0.3
    # Shuffled points would not fit.
    assert np.abs(np.roll(answers.value[:, 1], 1) / truth[:, 1] - 1).max() > 0.3


def test_an_unknown_estimator_stops_before_any_work(tmp_path: Path):
    plan = tiny_plan(estimators=[{"name": "nobody"}])
    with pytest.raises(InputError, match="nobody"):
        run_plan(plan, tmp_path / "out")
    assert not (tmp_path / "out").exists()
