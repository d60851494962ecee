"""Scores of answers made by hand, where every figure can be counted on fingers."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scenarios.blind.answers import Record, answer_of
from scenarios.blind.closures import regret, true_closure
from scenarios.blind.score import figures_of, interval, score
from scenarios.blind.seal import outcomes_digest
from scenarios.blind.suite import OPENED, OUTCOMES, OUTCOMES_FILE, SUITE, Suite
from scenarios.blind.table import table

NAMES = ["gap", "gloss", "drift[black]", "thickness[0.4 mm]"]


def _label(arm: str, *effects: tuple[str, float], **more: Any) -> dict[str, Any]:
    return {
        "arm": arm, "drift": 1.0, "without": [], "response": [], "separability": None,
        "nearest": [], "alike": [], "apart": 9.0,
        "effects": [
            {"name": name, "away": [0.5], "visibility": seen, "alike": [name]}
            for name, seen in effects
        ],
    } | more  # fmt: skip


def _outcome(verdict: str, *effects: tuple[str, float], **more: Any) -> dict[str, Any]:
    listed = [
        {"name": name, "probability": p, "parameters": [{"interval": [0.4, 0.6]}]}
        for name, p in effects
    ]
    return {
        "verdict": verdict, "p": 0.001, "no_gap_probability": 0.0, "unknown_probability": 0.0,
        "effects": listed, "probability": dict(effects), "candidates": NAMES,
        "credible_set": [name for name, _ in effects], "closure": None, "oracles": [],
        "judged": None, "leading_set": [name for name, _ in effects],
        "baselines": {
            "template": {"gap": True, "effects": ["gloss", "gap"], "unknown": False},
            "greedy": {"gap": True, "effects": ["gap"], "unknown": False,
                       "values": {"gap": [[0.5], [0.01]]}},
        },
    } | more  # fmt: skip


def _records() -> list[Record]:
    return [
        Record(0, _label("none"), _outcome("no_gap")),
        Record(1, _label("none", drift=4.0), _outcome("effect", ("gap", 0.9))),
        Record(2, _label("single", ("gap", 8.0)), _outcome("effect", ("gap", 0.9))),
        Record(3, _label("single", ("gloss", 8.0)),
               _outcome("group", ("gap", 0.6), ("gloss", 0.4))),
        Record(4, _label("single", ("gap", 2.0)), _outcome("no_gap")),
        Record(5, _label("pair", ("gap", 8.0), ("gloss", 9.0)),
               _outcome("pair", ("gap", 1.0), ("gloss", 0.9))),
        Record(6, _label("outside", ("stain", 9.0), separability=6.0), _outcome("none_of_these")),
        Record(7, _label("removed", ("gap", 9.0), separability=5.5, alike=["gloss"]),
               _outcome("effect", ("gloss", 0.9))),
        Record(8, _label("outside", ("stain", 9.0), separability=2.0),
               _outcome("effect", ("gap", 0.9))),
    ]  # fmt: skip


def test_every_line_is_counted() -> None:
    figures = figures_of(_records())
    assert figures["false_alarm_rate"] == 0.5
    assert figures["false_alarm_rate_usual"] == 0.0
    assert figures["false_alarm_rate_drift"] == 1.0
    assert figures["top1"] == 0.5
    assert figures["top1_stated"] == pytest.approx((0.9 + 0.6) / 2)
    assert figures["group_accuracy"] == 0.5
    assert figures["set_coverage"] == 1.0
    assert figures["set_size"] == 1.5
    assert figures["pair_recall"] == 1.0
    assert figures["unknown_detection"] == 1.0  # the inseparable one is not asked for
    assert figures["amplitude_coverage"] == 1.0
    assert figures["counts"]["top1"][:2] == [1.0, 2]
    strata = {row["from"]: row for row in figures["unknown_by_separability"]}
    assert strata[0.0]["none_of_these"] == 0.0
    assert strata[3.29]["or_look_alike"] is None
    assert strata[5.0]["none_of_these"] == 0.5
    assert strata[5.0]["or_look_alike"] == 1.0
    assert sum(row["cases"] for row in figures["detection"]) == 3


def test_baselines_are_judged_on_the_same_measurements() -> None:
    figures = figures_of(_records())
    template, greedy = (figures["baselines"][name] for name in ("template", "greedy"))
    assert template["false_alarm_rate"] == 1.0
    assert template["top1"] == 0.5
    assert template["pair_recall"] == 1.0
    assert greedy["pair_recall"] == 0.0
    assert greedy["amplitude_coverage"] == 1.0
    chance = figures["baselines"]["chance"]
    assert chance["false_alarm_rate"] == 0.5
    assert chance["top1"] == pytest.approx(0.5 / 4)
    assert chance["pair_recall"] == pytest.approx(0.5 / 6)
    assert figures["beats_baselines"] is True


def test_a_worse_answer_does_not_beat_the_baselines() -> None:
    records = [
        Record(2, _label("single", ("gap", 8.0)), _outcome("effect", ("gloss", 0.9))),
    ]
    assert figures_of(records)["beats_baselines"] is False


def test_misses_are_listed_with_a_reason() -> None:
    found = {row["number"]: row["why"] for row in figures_of(_records())["misses"]}
    assert set(found) == {1, 3, 4, 8}
    assert found[1].startswith("false alarm")
    assert found[4].startswith("faint")


def test_a_miss_of_an_effect_that_was_left_out_says_why() -> None:
    why = [["gap", "its response is not known well enough"]]
    single = _outcome("effect", ("gloss", 0.9), left_out=why)
    pair = _outcome("effect", ("gloss", 0.9), left_out=why)
    both = _label("pair", ("gap", 8.0), ("gloss", 9.0))
    records = [Record(0, _label("single", ("gap", 8.0)), single), Record(1, both, pair)]
    found = [row["why"] for row in figures_of(records)["misses"]]
    assert found == ["gap was left out: its response is not known well enough"] * 2
    other = Record(0, _label("single", ("drift[black]", 8.0)), single)
    assert [row["why"] for row in figures_of([other])["misses"]] == ["another effect was named"]


def _opened(folder: Path, suite: Suite, labels: dict[int, dict[str, Any]]) -> Path:
    """A suite as it is after the opening, where nothing found a gap."""
    (folder / OUTCOMES).mkdir(parents=True)
    (folder / SUITE).write_text(suite.text)
    outcomes = {str(number): _outcome("no_gap") for number in labels}
    (folder / OUTCOMES / OUTCOMES_FILE).write_text(json.dumps(outcomes))
    opened = {"labels": {str(number): label for number, label in labels.items()}, "broken": [],
              "outcomes": outcomes_digest(folder)}  # fmt: skip
    (folder / OPENED).write_text(json.dumps(opened))
    return folder


def test_suites_are_scored_together_though_materials_could_not_be_made(tmp_path: Path) -> None:
    """Numbers stay apart: the first of two materials is missing in the first suite."""
    one = Suite(materials=2, arms=("none", "single"))
    other = Suite(materials=1, first=2, arms=("single", "none"))
    loud = _label("single", ("gap", 8.0))
    first = _opened(tmp_path / "one", one, {2: _label("none"), 3: loud})
    second = _opened(tmp_path / "other", other, {0: loud, 1: _label("none")})
    figures = score(first, second)
    assert figures["measurements"] == 4
    assert figures["counts"]["top1"][:2] == [0.0, 2]
    assert [row["number"] for row in figures["misses"]] == [3, 4]


def test_look_alikes_count_for_the_group_and_not_for_the_effect() -> None:
    label = _label("single", ("gloss", 8.0))
    label["effects"][0]["alike"] = ["gloss", "gap"]
    figures = figures_of([Record(0, label, _outcome("effect", ("gap", 0.9)))])
    assert figures["group_accuracy"] == 1.0
    assert figures["top1"] == 0.0


def test_true_closure_of_the_right_and_of_the_wrong_effect() -> None:
    # two wavelengths, one channel: the world moves (3, 4), judged in both directions
    judged = {
        "along": np.eye(2).reshape(2, 2, 1).tolist(), "oracle_floor": 1.0,
        "moved": [[3.0], [4.0]], "gram": [[25.0]],
        "inner": np.array([[3.0], [4.0]]).reshape(1, 2, 1).tolist(),
        "value": [0.0], "explained": [[0.0], [0.0]],
    }  # fmt: skip
    label = _label("single", ("gap", 5.0), response=[[[3.0]], [[4.0]]])
    right = Record(0, label, _outcome("effect", ("gap", 1.0), judged=judged))
    assert true_closure(right) == pytest.approx(1.0 - 1.0 / 25.0)
    wrong = dict(judged, moved=[[4.0], [-3.0]],
                 inner=np.array([[4.0], [-3.0]]).reshape(1, 2, 1).tolist())  # fmt: skip
    other = Record(0, label, _outcome("effect", ("gap", 1.0), judged=wrong))
    assert true_closure(other) == pytest.approx(-1.0 / 25.0)


def test_true_closure_knows_that_effects_are_curved() -> None:
    """An effect of (v, v^2), at v = 2: the fit is right, though its slopes point elsewhere."""
    judged = {
        "along": np.eye(2).reshape(2, 2, 1).tolist(), "oracle_floor": 1.0,
        "moved": [[1.0], [4.0]], "gram": [[17.0]],
        "inner": np.array([[1.0], [4.0]]).reshape(1, 2, 1).tolist(),
        "value": [2.0], "explained": [[2.0], [4.0]],
    }  # fmt: skip
    label = _label("single", ("gap", 5.0), response=[[[2.0]], [[4.0]]])
    found = Record(0, label, _outcome("effect", ("gap", 1.0), judged=judged))
    assert true_closure(found) == pytest.approx(1.0 - 1.0 / (4.0 * 17.0))
    straight = dict(judged, value=[0.0], explained=[[0.0], [0.0]])
    other = Record(0, label, _outcome("effect", ("gap", 1.0), judged=straight))
    assert true_closure(other) < true_closure(found) - 0.05, "by the slopes alone a part is open"


def test_regret_is_against_one_who_knows() -> None:
    closure = {"value": 0.7, "interval": [0.5, 0.9], "before": 50.0, "oracle_floor": 2.0}
    known = [{"effects": ["gap"], "value": 0.95}]
    outcome = _outcome("effect", ("gap", 1.0), closure=closure, oracles=known)
    assert regret(Record(0, _label("single", ("gap", 9.0)), outcome)) == pytest.approx(0.25)
    missed = _outcome("effect", ("gap", 1.0), closure=closure)
    assert regret(Record(0, _label("single", ("gap", 9.0)), missed)) == pytest.approx(0.26)


def test_interval_of_a_rate() -> None:
    low, high = interval([1.0] * 95 + [0.0] * 5)
    assert 0.89 < low < 0.93
    assert 0.96 < high < 0.98
    assert interval([]) == (0.0, 1.0)


def test_the_table_has_every_line() -> None:
    text = table(figures_of(_records()))
    assert "| one effect: right group | at least 95 % | 50 % |" in text
    assert text.count("\n| ") > 20


def test_a_failed_diagnosis_is_counted_and_not_dropped() -> None:
    figures = figures_of([*_records(), Record(9, _label("none"), {"failed": "why"})])
    assert (figures["measurements"], figures["failed"]) == (10, 1)


def test_no_verdict_names_no_effect() -> None:
    record = Record(0, _label("single", ("gap", 8.0)), _outcome("cannot_tell", ("gap", 0.4)))
    assert answer_of(record, "diagnosis").first_in(["gap"]) == 0.0
