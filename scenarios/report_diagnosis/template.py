"""The page's template with everything in its place, whatever was measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import resources
from typing import TYPE_CHECKING

from diagnosis import TOLD_APART
from scenarios.report_diagnosis.colour import THICKNESS_MM, ColourChange
from scenarios.report_diagnosis.words import (
    OF_SAMPLES,
    SIGNIFICANT,
    Named,
    closure_sentences,
    headline,
    number,
    percent,
    place_text,
    proposal_rows,
    rare,
    rounded,
    unit_text,
    where_sentences,
)

if TYPE_CHECKING:
    from diagnosis import Diagnosis

TONES = {
    "no_gap": "good", "effect": "mixed", "pair": "mixed", "group": "mixed",
    "none_of_these": "poor", "cannot_tell": "poor",
}  # fmt: skip
ROWS = 10
DRAWINGS = (
    "maps", "signatures", "evidence", "separations", "closure", "matrix", "material", "rest",
    "covariance",
)  # fmt: skip


def filled(
    found: Diagnosis,
    named: Named,
    figures: Mapping[str, str | None],
    *,
    tiles: Sequence[Mapping[str, str]],
    rows_are: str,
    invisible: str,
    heading: str,
    origin: str,
    fingerprint: str,
    notes: Sequence[str],
    left_out: Sequence[Sequence[str]],
    adequacy: Sequence[Sequence[str]],
    shift: Sequence[Sequence[str]] = (),
    colour: ColourChange | None = None,
    rounds: Sequence[str] = (),
    stopped: str = "",
    accepted: Sequence[str] = (),
    bench_file: str = "",
    asks_next: bool = False,
    belongs: tuple[str, str] = OF_SAMPLES,
) -> str:
    """The template with everything in its place, of any kind of measurement.

    Args:
        found: the diagnosis.
        named: effects in plain words.
        figures: drawings by name; None where there is nothing to draw; what a kind of measurement
            does not have is left out.
        tiles: name, number and note of each.
        rows_are: what a row of the residual map is.
        invisible: what no such measurement can show.
        heading: what was measured.
        origin: who or which file it is from.
        fingerprint: SHA-256 of the measurement.
        notes: what was masked and assumed.
        left_out: entries of the catalogue, and why.
        adequacy: rows of what remains.
        shift: rows of how far the material's estimate moves.
        colour: what the gap does to colour.
        rounds: one line each, where there may be several.
        stopped: why there was no further one.
        accepted: what was taken into the description.
        bench_file: name of the file that holds it.
        asks_next: whether what to measure next is a question here.
        belongs: how a capture belongs to what its channel calls the sample.
    """
    import jinja2
    from markupsafe import Markup

    from scenarios.simulate import software

    style = resources.files("scenarios.report").joinpath("style.css").read_text("utf-8")
    text = resources.files("scenarios.report_diagnosis").joinpath("page.html.j2")
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True
    )
    return environment.from_string(text.read_text("utf-8")).render(
        style=Markup(style),
        tone=TONES[found.verdict],
        verdict=headline(found, named),
        sentences=_sentences(found),
        tiles=tiles,
        figures={**dict.fromkeys(DRAWINGS), **figures},
        overlay="signatures" in figures,
        rows_are=rows_are,
        effects=_effect_rows(found, named),
        groups=[", ".join(group) for group in found.groups],
        where=where_sentences(found, belongs),
        blocks=[
            [place_text(b, belongs), f"{b.statistic:.1f}", rare(b.p)]
            for b in found.where
            if b.p < SIGNIFICANT
        ][:ROWS],
        entries=[
            [
                place_text(e, belongs),
                f"{100 * e.healed:.0f} %",
                rare(e.rest),
                "yes" if e.heals else "no",
            ]
            for e in found.enters[:ROWS]
        ],
        closure=closure_sentences(found, colour),
        shift=shift,
        rounds=rounds,
        stopped=stopped,
        accepted=accepted,
        bench_file=bench_file,
        colour=colour,
        slab_mm=f"{THICKNESS_MM:g}",
        asks_next=asks_next,
        proposals=proposal_rows(found.next_measurement),
        told_apart=f"{TOLD_APART:.1f}",
        hidden=[[n.name, named(n.name), n.reason] for n in found.not_identifiable],
        left_out=left_out,
        invisible=invisible,
        adequacy=adequacy,
        notes=notes,
        heading=heading,
        origin=origin,
        fingerprint=fingerprint,
        software=software(),
    )


def _sentences(found: Diagnosis) -> list[str]:
    said = []
    if found.verdict not in ("cannot_tell", "none_of_these", "effect", "pair") and found.reason:
        said.append(found.reason[:1].upper() + found.reason[1:] + ".")
    # Without a gap the reason has said so already.
    if found.p == found.p and found.verdict != "no_gap":
        said.append(f"Data like these occur without any gap with probability {rare(found.p)}.")
    if found.verdict not in ("no_gap",) and found.unknown_probability == found.unknown_probability:
        said.append(
            f"Something outside the catalogue: {percent(found.unknown_probability)}; no effect at"
            f" all: {percent(found.no_gap_probability)}."
        )
    if found.prior_dependent:
        said.append(f"The verdict depends on the prior of the spectra: {found.prior_dependent}.")
    return said


def effect_tiles(found: Diagnosis) -> list[dict[str, str]]:
    """The leading effect's first value, and the closure."""
    tiles = []
    if found.effects and found.verdict != "no_gap":
        leader = found.effects[0]
        value = leader.parameters[0]
        tiles.append(
            {
                "name": f"{leader.name}: {value.name}",
                "number": f"{number(value.value, value.sd)}{unit_text(value.unit)}",
                "note": f"from nominal; moves the data by {leader.strength:.1f} sd",
            }
        )
    if found.closure is not None:
        low, high = found.closure.interval
        tiles.append(
            {
                "name": "closure",
                "number": f"{100 * found.closure.value:.0f} %",
                "note": f"90 %: {100 * low:.0f} to {100 * high:.0f} %, on held-out data",
            }
        )
    return tiles


def _effect_rows(found: Diagnosis, named: Named) -> list[list[str]]:
    rows = []
    for effect in found.effects[:ROWS]:
        values = "; ".join(
            f"{p.name} {number(p.value, p.sd)}{unit_text(p.unit)}"
            f" ({rounded(p.interval[0], p.sd)} to {rounded(p.interval[1], p.sd)})"
            for p in effect.parameters
        )
        how = "refit" if effect.refitted else "linear"
        if effect.disagreement > 0.2:
            how += f", {100 * effect.disagreement:.0f} % from the linear value"
        rows.append(
            [percent(effect.probability), effect.name, named(effect.name), values,
             f"{effect.strength:.1f}", how]
        )  # fmt: skip
    return rows


def adequacy_rows(found: Diagnosis) -> list[list[str]]:
    """Every look at what remains: its name, statistic, degrees of freedom and p."""
    rest = found.adequacy
    if rest is None:
        return []
    rows = [
        [name, f"{statistic:.1f}", str(freedom), rare(p)]
        for name, statistic, freedom, p in rest.tests
    ]
    return [*rows, ["all looks together", "", "", rare(rest.p)]]
