"""Counting right and wrong answers of a suite whose seals were opened."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from scenarios.blind.answers import METHODS, Answer, Record, answer_of
from scenarios.blind.baselines import QUANTILE
from scenarios.blind.closures import regret, true_closure
from scenarios.blind.misses import misses
from scenarios.blind.seal import open_seals, outcomes_digest
from scenarios.blind.suite import LEVELS, OPENED, OUTCOMES, OUTCOMES_FILE, VISIBLE, read_suite
from scenarios.outputs import canonical_json
from twin.errors import InputError
from twin.files import write_atomically

STRATA = (0.0, 3.29, 5.0, 10.0, np.inf)
"""Ends of the classes of separability; below the second nobody can tell."""
LEAST_PROBABILITY = 1e-4
"""Of the log score."""
SCORE = "score.json"


def score(*folders: Path) -> dict[str, Any]:
    """Score one suite, or several together; each must have been opened.

    Args:
        folders: of suites. The figures are written into the first as score.json.

    Raises:
        InputError: a suite that is sealed, or whose outcomes changed after the opening.
    """
    records: list[Record] = []
    broken = before = 0
    for folder in folders:
        if not (folder / OPENED).exists():
            raise InputError(
                "a suite under seal", "one that was opened", file=folder,
                remedy="Open it, once: benchtwin blind open FOLDER.",
            )  # fmt: skip
        opened = open_seals(folder)
        if opened["outcomes"] != outcomes_digest(folder):
            raise InputError(
                "outcomes that changed after the seals were opened", "those of the opening",
                file=folder / OUTCOMES,
            )  # fmt: skip
        broken += len(opened["broken"])
        outcomes = json.loads((folder / OUTCOMES / OUTCOMES_FILE).read_text(encoding="utf-8"))
        for number, label in opened["labels"].items():
            if int(number) not in opened["broken"] and number in outcomes:
                records.append(Record(before + int(number), label, outcomes[number]))
        # of all that the suite has room for: numbers of what could not be made are left free
        suite = read_suite(folder)
        before += suite.materials * len(suite.arms)
    figures = figures_of(records) | {"broken_seals": broken}
    write_atomically(folders[0] / SCORE, (canonical_json(figures) + "\n").encode())
    return figures


def figures_of(records: Sequence[Record]) -> dict[str, Any]:
    """All figures of records; a rate without a case is None, `counts` holds how many there were."""
    failed = [r for r in records if "failed" in r.outcome]
    good = [r for r in records if "failed" not in r.outcome]
    counts: dict[str, list[float]] = {}
    figures: dict[str, Any] = {"measurements": len(records), "failed": len(failed)}
    for name, cases in lines(good, "diagnosis").items():
        figures[name] = _mean(cases)
        counts[name] = [sum(cases), len(cases), *interval(cases)]
    figures["baselines"] = {
        method: {name: _mean(cases) for name, cases in lines(good, method).items()}
        for method in METHODS[1:]
    }
    figures["counts"] = counts
    visible = visible_singles(good)
    figures["set_size"] = _mean(
        [len(r.outcome["credible_set"]) for r in visible if r.outcome["verdict"] != "no_gap"]
    )
    figures |= _probabilities(visible) | _closures(good)
    figures["abstention"] = _mean([r.outcome["verdict"] == "cannot_tell" for r in visible])
    figures["detection"] = _detection(good)
    figures["unknown_by_separability"] = _strata(good)
    figures["ambiguous"] = _ambiguous(good)
    figures["beats_baselines"] = _beats(figures)
    figures["misses"] = misses(good)
    return figures


def lines(records: Sequence[Record], method: str) -> dict[str, list[float]]:
    """The cases of every line that all methods are compared on, 1 for right (or alarm) each."""
    answers = [(r, answer_of(r, method)) for r in records]
    none = [(r, a) for r, a in answers if r.arm == "none"]
    single = [(r, answer_of(r, method)) for r in visible_singles(records)]
    pairs = [(r, a) for r, a in answers if r.arm == "pair" and r.visible_pair]
    unknown = [(r, a) for r, a in answers if _separable(r)]
    return {
        "false_alarm_rate": [a.gap for _, a in none],
        "false_alarm_rate_usual": [a.gap for r, a in none if r.label["drift"] == 1.0],
        "false_alarm_rate_drift": [a.gap for r, a in none if r.label["drift"] != 1.0],
        "group_accuracy": [a.first_in(r.alike) for r, a in single],
        "top1": [a.first_in(r.truth) for r, a in single],
        "set_coverage": [a.holds(r.truth[0]) for r, a in single],
        "pair_recall": [a.both(r.truth) for r, a in pairs],
        "pair_recall_alike": [a.both_alike([e["alike"] for e in r.effects]) for r, a in pairs],
        "unknown_detection": [a.unknown_or(r.label["alike"]) for r, a in unknown],
        "amplitude_coverage": [hit for r, a in single for hit in _amplitudes(r, a)],
    }


def visible_singles(records: Iterable[Record]) -> list[Record]:
    """Singles that must be named."""
    return [r for r in records if r.arm == "single" and r.visibility >= VISIBLE]


def _separable(record: Record) -> bool:
    return record.stranger and record.label["separability"] >= VISIBLE


def _amplitudes(record: Record, answer: Answer) -> list[float]:
    """Whether each value of the effect lies in its interval, where the effect was named."""
    found = answer.intervals.get(record.truth[0])
    if found is None or not answer.first_in(record.truth):
        return []
    away = record.effects[0]["away"]
    return [float(low <= true <= high) for true, (low, high) in zip(away, found, strict=True)]


def _probabilities(visible: Sequence[Record]) -> dict[str, float | None]:
    """Brier and log score of the probabilities of all effects and the unknown.

    And the mean probability of the leading effect: as often it should be the right one.
    """
    brier, log, leader = [], [], []
    for record in visible:
        share = dict(record.outcome["probability"])
        none = record.outcome["no_gap_probability"] or 0.0
        share["none of these"] = record.outcome["unknown_probability"] or 0.0
        if record.outcome["verdict"] != "no_gap":
            share = {name: value * (1.0 - none) for name, value in share.items()}
        named = [value for name, value in share.items() if name != "none of these"]
        leader.append(max(named, default=0.0))
        truth = record.truth[0]
        share.setdefault(truth, 0.0)
        brier.append(sum((value - (name == truth)) ** 2 for name, value in share.items()))
        log.append(-float(np.log(max(share[truth], LEAST_PROBABILITY))))
    return {"brier": _mean(brier), "log_score": _mean(log), "top1_stated": _mean(leader)}


def _closures(records: Sequence[Record]) -> dict[str, Any]:
    named = [
        r for r in records
        if r.arm in ("single", "pair") and r.effects and r.visibility >= VISIBLE
        and r.outcome.get("closure")
    ]  # fmt: skip
    regrets = [value for r in named if (value := regret(r)) is not None]
    covered = []
    for record in named:
        true = true_closure(record)
        low, high = record.outcome["closure"]["interval"]
        if true is not None and low is not None:
            covered.append(float(low <= true <= high))
    return {
        "closure_regret": _mean(regrets),
        "closure_regret_cases": len(regrets),
        "closure_coverage": _mean(covered),
        "closure_coverage_cases": len(covered),
    }


def _detection(records: Sequence[Record]) -> list[dict[str, Any]]:
    """How often a gap is found, by how loud the single effect is."""
    ends = [*np.sqrt(np.array(LEVELS[:-1]) * np.array(LEVELS[1:])), np.inf]
    rows = []
    for level, low, high in zip(LEVELS, [0.0, *ends[:-1]], ends, strict=True):
        own = [r for r in records if r.arm == "single" and low <= r.visibility < high]
        found = [float(r.outcome["verdict"] != "no_gap") for r in own]
        right = [answer_of(r, "diagnosis").first_in(r.truth) for r in own]
        rows.append(
            {"sigma": level, "cases": len(own), "found": _mean(found), "top1": _mean(right)}
        )
    return rows


def _strata(records: Sequence[Record]) -> list[dict[str, Any]]:
    rows = []
    for low, high in pairwise(STRATA):
        own = [r for r in records if r.stranger and low <= r.label["separability"] < high]
        answers = [(r, answer_of(r, "diagnosis")) for r in own]
        rows.append(
            {
                "from": low,
                "to": None if np.isinf(high) else high,
                "cases": len(own),
                "none_of_these": _mean([float(a.unknown) for _, a in answers]),
                "or_look_alike": _mean([a.unknown_or(r.label["alike"]) for r, a in answers]),
            }
        )
    return rows


def _ambiguous(records: Sequence[Record]) -> dict[str, Any]:
    own = [
        r for r in records
        if r.arm == "ambiguous" and len(r.alike) > 1 and r.visibility >= VISIBLE
    ]  # fmt: skip
    answers = [(r, answer_of(r, "diagnosis")) for r in own]
    return {
        "cases": len(own),
        "set_coverage": _mean([a.holds(r.truth[0]) for r, a in answers]),
        "group_accuracy": _mean([a.first_in(r.alike) for r, a in answers]),
        "sure_and_wrong": _mean(
            [
                float(a.gap and not a.holds(r.truth[0]) and len(r.outcome["credible_set"]) == 1)
                for r, a in answers
            ]
        ),
    }


def _beats(figures: dict[str, Any]) -> bool | None:
    """Whether the diagnosis is at least as good as every baseline on every line with cases."""
    told = False
    for name in ("false_alarm_rate", "group_accuracy", "top1", "set_coverage", "pair_recall",
                 "unknown_detection"):  # fmt: skip
        own = figures[name]
        if own is None:
            continue
        told = True
        for other in figures["baselines"].values():
            theirs = other[name]
            if theirs is None:
                continue
            if (own > theirs) if name == "false_alarm_rate" else (own < theirs):
                return False
    return True if told else None


def interval(cases: Sequence[float]) -> tuple[float, float]:
    """Wilson's (1927) 90 % interval of a rate."""
    count = len(cases)
    if not count:
        return 0.0, 1.0
    z, rate = QUANTILE, float(np.mean(cases))
    middle = (rate + z**2 / (2 * count)) / (1 + z**2 / count)
    half = z * np.sqrt(rate * (1 - rate) / count + z**2 / (4 * count**2)) / (1 + z**2 / count)
    return float(middle - half), float(middle + half)


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if len(values) else None
