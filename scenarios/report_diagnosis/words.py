"""A diagnosis in words and numbers: what the terminal, the JSON file and the report say alike."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from diagnosis import UNKNOWN, Diagnosis, Entry, NextCapture, RankedEffect
from scenarios.report_diagnosis.colour import ColourChange

if TYPE_CHECKING:
    from diagnosis.rounds import Accepted, Rounds
    from diagnosis.where import Block
    from twin.effects import Candidate

SHOWN = 8
"""Effects in the table of the terminal."""
LEAST = 0.005
"""Probability below which an effect is not listed there, once three are."""
BLOCKS = 4
MOST_MOVED = 4
"""Parameters of the material in the sentence of how far they move."""
SIGNIFICANT = 0.05
RAREST = 1e-6
"""Probability below which tails of the noise are not known well enough for a number."""


def rare(probability: float) -> str:
    """A p-value in two digits, or that it is below what can be known of noise."""
    return f"{probability:.2g}" if probability >= RAREST else f"< {RAREST:.0e}".replace("-0", "-")


@dataclass(frozen=True)
class Named:
    """Names of candidates in plain words, and the nominal values of their parameters."""

    title: Mapping[str, str]
    place: Mapping[str, str]
    nominal: Mapping[str, tuple[float, ...]]

    @classmethod
    def of(cls, suspects: Sequence[Candidate]) -> Named:
        """From the candidates of the catalogue."""
        return cls(
            {each.name: each.title for each in suspects},
            {each.name: each.effect.place for each in suspects},
            {each.name: each.nominal for each in suspects},
        )

    def __call__(self, name: str) -> str:
        """In plain words; a name that is not known stays as it is."""
        if name == UNKNOWN:
            return "something that is not in the catalogue"
        return self.title.get(name, name)


def rounded(value: float, sd: float) -> str:
    """A value with the digits that its standard error leaves."""
    if not sd > 0:
        return f"{value:.3g}"
    digits = max(0, 1 - math.floor(math.log10(sd)))
    text = f"{value:.{digits}f}" if digits < 7 else f"{value:.2e}"
    return text.removeprefix("-") if float(text) == 0 else text


def number(value: float, sd: float) -> str:
    """A value and its standard error."""
    return f"{rounded(value, sd)} ± {rounded(sd, sd)}" if sd > 0 else f"{value:.3g}"


def unit_text(unit: str) -> str:
    """A unit behind a number; ratios have none."""
    return "" if unit in ("", "1") else f" {unit}"


def values_text(effect: RankedEffect, between: str = "") -> str:
    """Parameters of an effect, as deviations from nominal, with standard errors and units.

    Args:
        effect: with its values.
        between: words between name and value, where no heading says that it is a deviation.
    """
    return ", ".join(
        f"{p.name} {between}{number(p.value, p.sd)}{unit_text(p.unit)}" for p in effect.parameters
    )


def percent(share: float) -> str:
    """A probability."""
    if share > 0.995:
        return "> 99 %"
    return f"{100 * share:.0f} %" if share >= 0.01 else "< 1 %"


def headline(found: Diagnosis, named: Named) -> str:
    """The verdict as one sentence."""
    by_name = {effect.name: effect for effect in found.effects}
    if found.verdict == "no_gap":
        return "No gap: the bench as it is described explains the measurement."
    if found.verdict == "cannot_tell":
        return f"Cannot tell: {found.reason}."
    if found.verdict == "none_of_these":
        return f"A gap that no effect of the catalogue explains: {found.reason}."
    leading = [by_name[name] for name in found.leading if name in by_name]
    told = [f"{named(e.name)} ({values_text(e, 'off by ')})" for e in leading]
    said = "; and ".join(told)
    if found.verdict == "group":
        others = [named(name) for name in group_of(found) if name not in found.leading]
        listed = "; ".join(dict.fromkeys(others))
        return f"The gap is one of a group that these data do not tell apart: {said}; {listed}."
    if found.verdict == "pair":
        return f"Two effects make the gap: {said}."
    if not leading:
        return "One effect makes the gap."
    # The best explanation may have a second effect that the verdict is not sure of.
    order = sorted(range(len(leading)), key=lambda i: -leading[i].probability)
    first, *second = ((told[i], percent(leading[i].probability)) for i in order)
    also = "".join(f"; perhaps also, with {share}: {text}" for text, share in second)
    return f"One effect makes the gap, with {first[1]} probability: {first[0]}{also}."


def group_of(found: Diagnosis) -> tuple[str, ...]:
    """Names of the effects that the verdict is about."""
    named = [name for name in found.credible_set if name != UNKNOWN]
    return tuple(dict.fromkeys((*found.leading_set, *named)))


OF_SAMPLES, UNDER_LIGHTS = ("of", "samples"), ("under", "lights")
"""How a capture belongs to what its channel calls the sample."""


def place_text(where: Block | Entry, belongs: tuple[str, str] = OF_SAMPLES) -> str:
    """A part of the data in words."""
    word, things = belongs
    captures = " and ".join(where.captures) or "all captures"
    samples = f" {word} {' and '.join(where.samples) or f'all {things}'}"
    band = getattr(where, "band_nm", None)
    reach = f", {band[0]:.0f} to {band[1]:.0f} nm" if band else ""
    repeat = f", repeat {where.repeat}" if where.repeat is not None else ""
    return f"{captures}{samples}{reach}{repeat}"


def where_sentences(found: Diagnosis, belongs: tuple[str, str] = OF_SAMPLES) -> list[str]:
    """Where the gap shows, and where it enters."""
    loud = [block for block in found.where if block.p < SIGNIFICANT]
    said = [
        f"shows in {place_text(b, belongs)} ({b.statistic:.1f} sd above noise, p = {rare(b.p)})"
        for b in loud[:BLOCKS]
    ]
    said += [
        f"enters in {place_text(e, belongs)}: without it the rest is noise (p = {rare(e.rest)})"
        for e in [entry for entry in found.enters if entry.heals][:2]
    ]
    return said or ["shows nowhere: no block is louder than noise"]


def closure_sentences(found: Diagnosis, colour: ColourChange | None) -> list[str]:
    """How far the gap shrinks."""
    said = []
    if found.closure is not None:
        c = found.closure
        low, high = c.interval
        said.append(
            f"{100 * c.value:.0f} % of the gap closes on data that did not choose the effect"
            f" (90 % interval {100 * low:.0f} to {100 * high:.0f} %): excess chi-square"
            f" {c.before:.1f} before, {c.after:.1f} after, in {c.noise_floor:.0f} directions of"
            f" noise; one who knew the effect would have {c.oracle_floor:.1f} left"
        )
    shift = found.parameter_shift
    if shift is not None and shift.names:
        pairs = sorted(zip(shift.rms_sd, shift.names, strict=True), reverse=True)
        shown = pairs if len(pairs) <= MOST_MOVED else pairs[: MOST_MOVED - 1]
        moved = ", ".join(
            f"{name} {shift.rms_sd[i]:.1f}"
            for i, name in enumerate(shift.names)
            if any(name == kept for _, kept in shown)
        )
        if len(shown) < len(pairs):
            moved += f", {len(pairs) - len(shown)} more at most {pairs[len(shown)][0]:.1f}"
        said.append(f"the material's estimate moves by (root mean square, in sd): {moved}")
    if colour is not None:
        said += colour.sentences()
    return said or ["nothing was added, so nothing shrinks"]


def next_sentences(found: Diagnosis) -> list[str]:
    """What to measure next."""
    said = []
    for n in found.next_measurement[:3]:
        enough = "enough" if n.enough else "not enough"
        said.append(
            f"{n.name} (about {n.cost:.0f} min): separation {n.now:.1f} to {n.separation:.1f} sd,"
            f" {enough} (3.3 are needed)"
        )
    if not said and found.verdict == "none_of_these":
        said.append(
            "repeat the captures in which the gap shows, and the references: an effect outside the"
            " catalogue is there again, a slip is not"
        )
    return said


def terminal(rounds: Rounds, named: Named, colour: ColourChange | None) -> dict[str, Any]:
    """What the command prints."""
    found = rounds.first.diagnosis
    answer: dict[str, Any] = {"verdict": headline(found, named)}
    if found.effects and found.verdict != "no_gap":
        answer["effects"] = effect_rows(found, named)
    if found.prior_dependent:
        answer["depends_on_the_prior"] = found.prior_dependent
    if found.null is not None:
        answer["where"] = where_sentences(found)
    if found.closure is not None:
        answer["how_far"] = closure_sentences(found, colour)
    if len(rounds.rounds) > 1:
        answer["rounds"] = [round_text(rounds, i) for i in range(len(rounds.rounds))]
    if proposals := next_sentences(found):
        answer["next"] = proposals
    hidden = [n.name for n in found.not_identifiable]
    left_out = [f"{each.name}: {each.reason}" for each in rounds.first.case.left_out]
    if hidden:
        answer["not_identifiable"] = f"{len(hidden)} effects cannot be seen in these data: " + (
            ", ".join(hidden)
        )
    if left_out:
        answer["left_out"] = left_out
    return answer


def effect_rows(found: Diagnosis, named: Named) -> list[str]:
    """The table of ranked effects as lines."""
    kept = [
        e for i, e in enumerate(found.effects[:SHOWN]) if i < 3 or e.probability >= LEAST
    ]  # fmt: skip
    width = max(len(e.name) for e in kept)
    return [
        f"{percent(e.probability):>6}  {e.name:<{width}}  {values_text(e)}  ({named(e.name)})"
        for e in kept
    ]


def accepted_text(each: Accepted) -> str:
    """One accepted effect."""
    values = ", ".join(
        number(v, u) for v, u in zip(each.values, each.uncertainty, strict=True)
    )  # fmt: skip
    alike = f"; not told from {', '.join(each.look_alikes)}" if each.look_alikes else ""
    return f"{each.name} = {values}{alike}"


def round_text(rounds: Rounds, index: int) -> str:
    """One round as a line."""
    one = rounds.rounds[index]
    verdict = one.diagnosis.verdict.replace("_", " ")
    added = "; ".join(accepted_text(each) for each in one.accepted) or "nothing accepted"
    left = "" if one.excess is None else f", excess {one.excess[0]:.1f} to {one.excess[1]:.1f}"
    return f"{index + 1}: {verdict}{left}; {added}"


def as_json(rounds: Rounds, named: Named, colour: ColourChange | None) -> dict[str, Any]:
    """The JSON file: the keys of `Diagnosis.as_json` and what the command knows beside them."""
    found = rounds.first.diagnosis
    answer: dict[str, Any] = {**found.as_json()}
    for effect in answer["effects"]:
        effect["title"] = named(effect["name"])
        effect["place"] = named.place.get(effect["name"], "")
        for parameter, nominal in zip(
            effect["parameters"], named.nominal.get(effect["name"], ()), strict=False
        ):
            parameter["nominal"] = nominal
    known = {entry["name"] for entry in answer["not_identifiable"]}
    answer["not_identifiable"] += [
        {"name": each.name, "reason": each.reason, "strength": None}
        for each in rounds.first.case.left_out
        if each.name not in known
    ]
    answer["sentence"] = headline(found, named)
    answer["rounds"] = [
        {
            "verdict": one.diagnosis.verdict,
            "p": one.diagnosis.p,
            "chi_square": one.chi_square[0],
            "degrees_of_freedom": one.chi_square[1],
            "excess": None if one.excess is None else list(one.excess),
            "accepted": [vars(each) for each in one.accepted],
        }
        for one in rounds.rounds
    ]
    answer["stopped"] = rounds.stopped
    answer["colour"] = None if colour is None else colour.as_json()
    answer["notes"] = list(rounds.first.case.reasons)
    return answer


def proposal_rows(proposals: Sequence[NextCapture]) -> list[list[str]]:
    """Rows of the report's table of next measurements."""
    return [
        [n.name, f"{n.cost:.0f} min", f"{n.now:.1f}", f"{n.separation:.1f}",
         "yes" if n.enough else "no"]
        for n in proposals
    ]  # fmt: skip
