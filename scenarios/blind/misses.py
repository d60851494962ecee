"""Every answer that is not the right one, and what can be said about why."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from scenarios.blind.answers import Answer, Record, answer_of, effects_of
from scenarios.blind.suite import VISIBLE


def misses(records: Sequence[Record]) -> list[dict[str, Any]]:
    """Every answer that is not the right one, with what can be said about why."""
    rows = []
    for record in records:
        answer = answer_of(record, "diagnosis")
        why = _why(record, answer)
        if why:
            rows.append(
                {
                    "number": record.number,
                    "arm": record.arm,
                    "truth": list(record.truth),
                    "visibility": round(record.visibility, 1),
                    "verdict": record.outcome["verdict"],
                    "said": list(effects_of(record)),
                    "why": why,
                }
            )
    return rows


def _why(record: Record, answer: Answer) -> str:
    """Why an answer is wrong; nothing for a right one."""
    if record.arm == "none":
        return f"false alarm, p = {record.outcome['p']:.2g}" if answer.gap else ""
    if not record.effects:
        return ""
    if record.stranger:
        if answer.unknown_or(record.label["alike"]):
            return ""
        apart = record.label["separability"]
        near = " and ".join(record.label["nearest"])
        return f"{apart:.1f} sigma from {near}, the nearest of the catalogue"
    pair = record.arm == "pair"
    if answer.both(record.truth) if pair else answer.first_in(record.truth):
        return ""
    for name, reason in record.outcome.get("left_out", ()):
        if name in record.truth:
            return f"{name} was left out: {reason}"
    if pair:
        if not record.visible_pair:
            return f"the fainter is {record.label['apart'] or 0.0:.1f} sigma beside the other"
        missing = [name for name in record.truth if not answer.holds_leading(name)]
        return f"not in the leading set: {', '.join(missing)}"
    if record.visibility < VISIBLE:
        return f"faint: {record.visibility:.1f} sigma"
    if answer.first_in(record.alike):
        return "a look-alike that these data do not tell from it"
    if not answer.gap:
        return "no gap was found"
    return "another effect was named" if answer.effects else "no effect was named"
