"""The report of a diagnosis as one offline HTML page."""

from __future__ import annotations

from importlib import resources
from typing import TYPE_CHECKING

from diagnosis import TOLD_APART
from diagnosis.screening import without_broken
from diagnosis.translucent import physical
from scenarios.report.content import sample_label
from scenarios.report_diagnosis.closure_plot import draw_material, draw_waterfall
from scenarios.report_diagnosis.colour import THICKNESS_MM, ColourChange
from scenarios.report_diagnosis.evidence_plot import draw_evidence, draw_separations
from scenarios.report_diagnosis.residual_plot import draw_residual_maps, draw_signatures
from scenarios.report_diagnosis.rest_plot import draw_covariance, draw_rest
from scenarios.report_diagnosis.words import (
    SIGNIFICANT,
    Named,
    accepted_text,
    closure_sentences,
    headline,
    number,
    percent,
    place_text,
    proposal_rows,
    round_text,
    rounded,
    unit_text,
    where_sentences,
)

if TYPE_CHECKING:
    from diagnosis import Diagnosis
    from diagnosis.rounds import Rounds
    from twin.measurement import Measurement

TONES = {
    "no_gap": "good", "effect": "mixed", "pair": "mixed", "group": "mixed",
    "none_of_these": "poor", "cannot_tell": "poor",
}  # fmt: skip
ROWS = 10


def diagnosis_page(
    measurement: Measurement, rounds: Rounds, colour: ColourChange | None, *, bench_file: str = ""
) -> str:
    """The page as text: the same diagnosis gives the same text.

    Args:
        measurement: what was diagnosed.
        rounds: every round of it.
        colour: what the gap does to colour, when that is known.
        bench_file: name of the file that holds the accepted effects.
    """
    import jinja2
    from markupsafe import Markup

    from scenarios.simulate import software

    found = rounds.first.diagnosis
    named = Named.of(rounds.first.case.suspects)
    figures = {name: Markup(svg) if svg else None for name, svg in _figures(rounds)}
    style = resources.files("scenarios.report").joinpath("style.css").read_text("utf-8")
    text = resources.files("scenarios.report_diagnosis").joinpath("page.html.j2")
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True
    )
    material = _material(measurement, rounds)
    return environment.from_string(text.read_text("utf-8")).render(
        style=Markup(style),
        tone=TONES[found.verdict],
        verdict=headline(found, named),
        sentences=_sentences(found),
        tiles=_tiles(rounds, colour),
        figures={**figures, "material": Markup(material) if material else None},
        effects=_effect_rows(found, named),
        groups=[", ".join(group) for group in found.groups],
        where=where_sentences(found),
        blocks=[
            [place_text(b), f"{b.statistic:.1f}", f"{b.p:.2g}"]
            for b in found.where
            if b.p < SIGNIFICANT
        ][:ROWS],
        entries=[
            [place_text(e), f"{100 * e.healed:.0f} %", f"{e.rest:.2g}", "yes" if e.heals else "no"]
            for e in found.enters[:ROWS]
        ],
        closure=closure_sentences(rounds, colour),
        rounds=[round_text(rounds, i) for i in range(len(rounds.rounds))],
        stopped=rounds.stopped,
        accepted=[accepted_text(each) for each in rounds.accepted],
        bench_file=bench_file,
        colour=colour,
        slab_mm=f"{THICKNESS_MM:g}",
        proposals=proposal_rows(found.next_measurement),
        told_apart=f"{TOLD_APART:.1f}",
        hidden=[[n.name, named(n.name), n.reason] for n in found.not_identifiable],
        left_out=[[each.name, each.reason] for each in rounds.first.case.left_out],
        adequacy=_adequacy(rounds),
        notes=rounds.first.case.reasons,
        samples="; ".join(sample_label(sample) for sample in measurement.samples),
        origin=measurement.provenance.software or "made by hand",
        fingerprint=measurement.fingerprint,
        software=software(),
    )


def _figures(rounds: Rounds) -> list[tuple[str, str | None]]:
    one = rounds.first
    found = one.diagnosis
    problem, _ = without_broken(one.case.problem)
    if found.null is None:
        names = ("maps", "signatures", "evidence", "separations", "closure", "rest", "covariance")
        return [(name, None) for name in names]
    engine_modes = 2 * 3 * len({c.sample for c in problem.channels})
    last = rounds.last
    rest = (last.diagnosis.best if last.accepted else None) or last.diagnosis.null or found.null
    name = "with " + ", ".join(a.name for a in rounds.accepted) if rounds.accepted else "no effect"
    return [
        ("maps", draw_residual_maps(problem, found)),
        ("signatures", draw_signatures(problem, found)),
        ("evidence", draw_evidence(problem, found)),
        ("separations", draw_separations(found)),
        ("closure", draw_waterfall(rounds)),
        ("rest", draw_rest(problem, rest, name)),
        ("covariance", draw_covariance(problem, min(engine_modes, len(problem.common)))),
    ]


def _material(measurement: Measurement, rounds: Rounds) -> str | None:
    found = rounds.first.diagnosis
    last = rounds.last
    best = last.diagnosis.best if last.accepted else last.diagnosis.null
    if found.null is None or best is None or not rounds.accepted:
        return None
    pair = (physical(found.null.material), physical(best.material))
    return draw_material(
        found.null, best, pair, rounds.first.case.problem.wavelength_nm,
        found.null.reduction.material_sd(), measurement.truth,
    )  # fmt: skip


def _sentences(found: Diagnosis) -> list[str]:
    said = []
    if found.verdict not in ("cannot_tell", "none_of_these", "effect", "pair") and found.reason:
        said.append(found.reason[:1].upper() + found.reason[1:] + ".")
    if found.p == found.p:
        said.append(f"Data like these occur without any gap with probability {found.p:.2g}.")
    if found.verdict not in ("no_gap",) and found.unknown_probability == found.unknown_probability:
        said.append(
            f"Something outside the catalogue: {percent(found.unknown_probability)}; no effect at"
            f" all: {percent(found.no_gap_probability)}."
        )
    if found.prior_dependent:
        said.append(f"The verdict depends on the prior of the spectra: {found.prior_dependent}.")
    return said


def _tiles(rounds: Rounds, colour: ColourChange | None) -> list[dict[str, str]]:
    found = rounds.first.diagnosis
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
    if colour is not None:
        tiles.append(
            {
                "name": "colour of the material moves by",
                "number": f"{colour.moved:.2f} ΔE00",
                "note": f"{THICKNESS_MM:g} mm over black, D65",
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


def _adequacy(rounds: Rounds) -> list[list[str]]:
    rest = rounds.last.diagnosis.adequacy
    if rest is None:
        return []
    rows = [
        [name, f"{statistic:.1f}", str(freedom), f"{p:.2g}"]
        for name, statistic, freedom, p in rest.tests
    ]
    return [*rows, ["all looks together", "", "", f"{rest.p:.2g}"]]
