"""A diagnosis as the page shows it: verdict, where, ranked effects as bars, how far it shrinks."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from scenarios.explore.figures import AXIS_TITLE, FONT, Figure
from scenarios.report.figure import BLUE, INK, PALE, VERMILION
from scenarios.report_diagnosis.words import percent
from twin.errors import InputError
from twin.toml import read_text

VERDICTS = {
    "no_gap": ("No gap", "good"),
    "effect": ("One effect explains the gap", "mixed"),
    "pair": ("Two effects together explain the gap", "mixed"),
    "group": ("One of a group explains the gap", "mixed"),
    "none_of_these": ("A gap, but nothing of the catalogue explains it", "poor"),
    "cannot_tell": ("These data cannot tell", "mixed"),
}
COLOURS = {"leading": VERMILION, "look-alike": BLUE, "other": "#b6bec8"}
SHOWN = 10
"""Effects of the bars; the others are counted."""


@dataclass(frozen=True)
class Effect:
    """One ranked effect: its words, probability, fitted values, and its part in the verdict."""

    name: str
    title: str
    place: str
    probability: float
    fitted: str
    part: Literal["leading", "look-alike", "other"]


@dataclass(frozen=True)
class Diagnosis:
    """What a diagnosis.json says.

    Attributes:
        verdict, tone, sentence: of the whole, with the tone that the reports' style knows.
        fingerprint: of the measurement.
        effects: ranked.
        where: blocks in which the gap shows; enters: in which it enters.
        closure: how far it shrinks, or None.
        proposals: what to measure next, with the separation it buys [sd] and its minutes.
        hidden: how many effects the data cannot judge.
    """

    verdict: str
    tone: str
    sentence: str
    fingerprint: str
    effects: tuple[Effect, ...]
    where: tuple[str, ...]
    enters: tuple[str, ...]
    closure: dict[str, Any] | None
    proposals: tuple[str, ...]
    hidden: int


def read_diagnosis(path: Path) -> Diagnosis:
    """Read the diagnosis.json that `benchtwin diagnose` wrote; its folder will do.

    Raises:
        InputError: no such file, or another one.
    """
    file = path / "diagnosis.json" if path.is_dir() else path
    try:
        facts = json.loads(read_text(file))
        if facts["verdict"] not in VERDICTS:
            raise KeyError(facts["verdict"])
        return _diagnosis(facts)
    except (json.JSONDecodeError, KeyError, TypeError, IndexError, AttributeError) as error:
        raise InputError(
            f"a file that is no diagnosis ({error})", "a diagnosis.json of benchtwin diagnose",
            file=file,
        ) from error  # fmt: skip


def _diagnosis(facts: dict[str, Any]) -> Diagnosis:
    title, tone = VERDICTS[facts["verdict"]]
    effects = [
        Effect(
            each["name"], each["title"], each["place"], float(each["probability"] or 0.0),
            "; ".join(_fitted(p) for p in each["parameters"]),
            _part(each["name"], facts),
        )
        for each in facts["effects"]
    ]  # fmt: skip
    closure = facts.get("closure")
    return Diagnosis(
        title, tone, str(facts["sentence"]), str(facts.get("measurement_fingerprint", "")),
        tuple(sorted(effects, key=lambda effect: -effect.probability)),
        tuple(
            block_of(block)
            for block in sorted(facts.get("where") or (), key=lambda b: -float(b["statistic"]))
        ),
        tuple(block_of(block) for block in facts.get("enters") or () if block["heals"]),
        closure if closure and closure.get("value") is not None else None,
        tuple(
            f"{each['name']}: {each['separation']:.1f} sd apart instead of {each['now']:.1f},"
            f" about {each['cost']:.0f} min"
            for each in facts.get("next_measurement") or ()
        ),
        len(facts.get("not_identifiable") or ()),
    )  # fmt: skip


def _part(name: str, facts: dict[str, Any]) -> Literal["leading", "look-alike", "other"]:
    if name in (facts.get("leading") or ()):
        return "leading"
    return "look-alike" if name in (facts.get("leading_set") or ()) else "other"


def _fitted(parameter: dict[str, Any]) -> str:
    unit = "" if parameter["unit"] == "1" else f" {parameter['unit']}"
    return f"{parameter['name']} {parameter['value']:+.3g} ± {parameter['sd']:.2g}{unit}"


def block_of(block: dict[str, Any]) -> str:
    """A block of captures, samples, wavelengths and repeats in words."""
    band = block.get("band_nm")
    parts = [
        " and ".join(block["captures"]) if block["captures"] else "all captures",
        f"of {', '.join(block['samples'])}" if block["samples"] else "of all samples",
        f"from {band[0]:g} to {band[1]:g} nm" if band else "",
        f"repeat {block['repeat']}" if block.get("repeat") is not None else "",
    ]
    return " ".join(part for part in parts if part)


def effects_figure(found: Diagnosis) -> Figure:
    """Probabilities of the ranked effects as bars, the most probable on top."""
    shown = found.effects[:SHOWN]
    return {
        "data": [
            {
                "type": "bar", "orientation": "h",
                "x": [100 * effect.probability for effect in shown],
                "y": [effect.name for effect in shown],
                "text": [percent(effect.probability) for effect in shown],
                "textposition": "outside", "cliponaxis": False,
                "customdata": [[effect.title, effect.fitted] for effect in shown],
                "hovertemplate": "%{customdata[0]}<br>%{customdata[1]}<extra></extra>",
                "marker": {"color": [COLOURS[effect.part] for effect in shown]},
            }
        ],
        "layout": {
            "dragmode": False,
            "font": {"family": FONT, "size": 12.5, "color": INK},
            "paper_bgcolor": "rgba(0,0,0,0)", "plot_bgcolor": "rgba(0,0,0,0)",
            "margin": {"l": 10, "r": 46, "t": 4, "b": 40}, "bargap": 0.35,
            "xaxis": {"range": [0, 100], "ticksuffix": " %", "gridcolor": PALE, "zeroline": False,
                      "fixedrange": True,
                      "title": {"text": "Probability that the effect is at work", **AXIS_TITLE}},
            "yaxis": {"autorange": "reversed", "automargin": True, "ticks": "",
                      "fixedrange": True, "ticklabelstandoff": 8},
            "showlegend": False,
        },
    }  # fmt: skip


def closure_sentence(closure: dict[str, Any]) -> str:
    """How far the gap shrinks, in words."""
    low, high = closure["interval"]
    return (
        f"{100 * closure['value']:.0f} % of the gap closes (90 % interval {100 * low:.0f} to"
        f" {100 * high:.0f} %): chi-square above noise from {closure['before']:.1f} to"
        f" {closure['after']:.1f}."
    )
