"""The published table, from figures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

ROWS = (
    ("false_alarm_rate", "false alarms, no effect", "at most 5 %"),
    ("false_alarm_rate_drift", "the same, lamps that drift four times as much", "at most 5 %"),
    ("group_accuracy", "one effect: right group", "at least 95 %"),
    ("top1", "one effect: right effect first", "at least 85 %"),
    ("set_coverage", "one effect: in the 90 % set", "at least 88 %"),
    ("pair_recall", "two effects: both in the leading set", "at least 80 %"),
    ("unknown_detection", "not in the catalogue, separable: said so", "at least 90 %"),
    ("amplitude_coverage", "value within its 90 % interval", "85 to 95 %"),
)
"""Rates: key, words, what is asked for."""
NUMBERS = (
    ("set_size", "effects in the 90 % set", "at most 2"),
    ("closure_regret", "closure lost against one who knows the effect", "at most 0.1"),
    ("closure_coverage", "true closure within its 90 % interval", "0.85 to 0.95"),
    ("top1_stated", "probability that is stated for the first effect", ""),
    ("brier", "Brier score", ""),
    ("log_score", "log score [nat]", ""),
    ("abstention", "cannot tell, though visible", ""),
)


def table(figures: Mapping[str, Any]) -> str:
    """Figures of `score` as Markdown: against what is asked for, and against the baselines."""
    lines = [
        "| | asked for | found | 90 % interval | cases | chance | template | greedy |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for key, words, wanted in ROWS:
        _, cases, low, high = figures["counts"][key]
        others = [_share(figures["baselines"][m][key]) for m in ("chance", "template", "greedy")]
        cells = [
            words, wanted, _share(figures[key]),
            f"{_share(low)} to {_share(high)}" if cases else "-", str(int(cases)), *others,
        ]  # fmt: skip
        lines.append("| " + " | ".join(cells) + " |")
    for key, words, wanted in NUMBERS:
        lines.append(f"| {words} | {wanted} | {_number(figures[key])} | | | | | |")
    lines += [
        "",
        "| single effect of | cases | gap found | right effect first |",
        "|---|---|---|---|",
    ]
    for row in figures["detection"]:
        lines.append(
            f"| {row['sigma']:g} sigma | {row['cases']} | {_share(row['found'])} |"
            f" {_share(row['top1'])} |"
        )
    lines += [
        "",
        "| not in the catalogue, nearest look-alike | cases | none of these | or a look-alike |",
        "|---|---|---|---|",
    ]
    for row in figures["unknown_by_separability"]:
        end = "" if row["to"] is None else f" to {row['to']:g}"
        words = f"{row['from']:g}{end} sigma away" if end else f"{row['from']:g} sigma or more"
        lines.append(
            f"| {words} | {row['cases']} | {_share(row['none_of_these'])} |"
            f" {_share(row['or_look_alike'])} |"
        )
    return "\n".join(lines) + "\n"


def _share(value: float | None) -> str:
    return "-" if value is None else f"{100.0 * value:.0f} %"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"
