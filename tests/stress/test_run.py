"""Running a plan: what is finished is kept, and the end is the same to the byte."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from estimators import registry
from scenarios.stress.parts import Case
from scenarios.stress.plan import StressPlan
from scenarios.stress.run import SWEEP, run_plan
from scenarios.stress.tables import TIMING, points_csv, write_outcome
from scenarios.sweep import Ledger, Workers
from scenarios.sweep.run import LEDGER
from scenarios.sweep.task import Answer
from tests.stress.tiny import tiny_plan
from twin.errors import InputError

PLAN = tiny_plan(estimators=[{"name": "beer"}, {"name": "toy"}], noise=[1.0, 3.0])
PARTS = 8  # two visits, two noise levels, two estimators
LIT = 2  # two visits of one sample


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
        for path in sorted(folder.iterdir())
        if path.is_file() and path.name != TIMING
    }


def written(plan: StressPlan, folder: Path, **options: Any) -> dict[str, bytes]:
    """A plan is run and its files are written."""
    write_outcome(run_plan(plan, folder, **options), folder, "tiny")
    return files(folder)


class Killed(BaseException):
    """What stops a run in the tests."""


@pytest.fixture
def answered(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Keys of the answers in the order in which they are kept."""
    kept: list[str] = []
    own = Ledger.write

    def write(self: Ledger, key: str, point: str, answer: Answer) -> None:
        own(self, key, point, answer)
        if '"estimator"' in point:
            kept.append(key)

    monkeypatch.setattr(Ledger, "write", write)
    return kept


def test_a_killed_run_goes_on_and_ends_with_the_same_bytes(
    tmp_path: Path, cache: Path, monkeypatch: pytest.MonkeyPatch
):
    whole = written(PLAN, tmp_path / "whole", cache=cache, threads=1)
    broken = tmp_path / "broken"
    own, kept = Ledger.write, []

    def kill(self: Ledger, key: str, point: str, answer: Answer) -> None:
        own(self, key, point, answer)
        kept.append(key)
        if len(kept) == LIT + 3:
            raise Killed

    monkeypatch.setattr(Ledger, "write", kill)
    with pytest.raises(Killed):
        run_plan(PLAN, broken, cache=tmp_path / "cache", threads=2)
    with Ledger(broken / SWEEP / LEDGER) as ledger:
        assert ledger.done(kept) == set(kept)
    assert written(PLAN, broken, cache=tmp_path / "cache", threads=2) == whole
    # Nothing was lost and nothing was done twice.
    assert len(set(kept)) == len(kept) == LIT + PARTS
    # The check can fail: another seed ends with other bytes.
    changed = PLAN.model_copy(update={"seed": 2})
    other = run_plan(changed, tmp_path / "other", cache=cache)
    assert points_csv(other).encode() != whole["points.csv"]


def test_what_is_there_is_not_done_again(tmp_path: Path, cache: Path, answered: list[str]):
    few = PLAN.model_copy(update={"estimators": PLAN.estimators[:1]})
    run_plan(few, tmp_path, cache=cache)
    assert len(answered) == PARTS // 2
    run_plan(PLAN, tmp_path, cache=cache)
    assert len(set(answered)) == len(answered) == PARTS


def test_workers_give_the_same_bytes(tmp_path: Path, cache: Path):
    plan = PLAN.model_copy(update={"estimators": PLAN.estimators[:1], "noise": (1.0,)})
    two = Workers(engine="joblib", count=2)
    alone = run_plan(plan, tmp_path / "alone", cache=cache)
    # Maps by workers are tested with the maps; the light is traced anew.
    shutil.copytree(cache, tmp_path / "cache", ignore=shutil.ignore_patterns("*.light"))
    together = run_plan(plan, tmp_path / "two", cache=tmp_path / "cache", workers=two)
    assert points_csv(together) == points_csv(alone)


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


def test_a_visit_that_cannot_be_simulated_is_no_estimators_fault(
    tmp_path: Path, cache: Path, monkeypatch: pytest.MonkeyPatch
):
    where = {"place": ""}

    def dark(*_: object, **__: object) -> None:
        raise InputError("a lamp too bright", "one that the instrument can read", **where)

    monkeypatch.setattr("scenarios.stress.task.take", dark)
    for place in ("", "bench.toml: instrument"):
        where["place"] = place
        said = ": ".join(part for part in ("a simulated visit", place) if part)
        with pytest.raises(InputError, match="a lamp too bright; expected one that") as caught:
            run_plan(tiny_plan(seed=5), tmp_path, cache=cache)
        assert caught.value.place == said


def test_what_is_no_input_error_is_an_error_of_ours(
    tmp_path: Path, cache: Path, monkeypatch: pytest.MonkeyPatch
):
    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("a mistake of ours")

    monkeypatch.setattr("scenarios.stress.task.take", broken)
    with pytest.raises(RuntimeError, match="a mistake of ours"):
        run_plan(tiny_plan(seed=5), tmp_path, cache=cache)
