"""The report of a diagnosis as one offline HTML page."""

from __future__ import annotations

from typing import TYPE_CHECKING

from diagnosis.screening import without_broken
from diagnosis.translucent import physical
from scenarios.report.content import sample_label
from scenarios.report_diagnosis.closure_plot import draw_material, draw_waterfall
from scenarios.report_diagnosis.colour import THICKNESS_MM, ColourChange
from scenarios.report_diagnosis.evidence_plot import draw_evidence, draw_separations
from scenarios.report_diagnosis.residual_plot import draw_residual_maps, draw_signatures
from scenarios.report_diagnosis.rest_plot import draw_covariance, draw_rest
from scenarios.report_diagnosis.template import adequacy_rows, effect_tiles, filled
from scenarios.report_diagnosis.words import Named, accepted_text, round_text

if TYPE_CHECKING:
    from diagnosis.rounds import Rounds
    from twin.measurement import Measurement

THICK = (
    "Each thin row is one repeat of a capture of a sample; red is brighter than predicted, blue"
    " darker, in standard deviations once the material has taken up all it can."
)
"""What the rows of a residual map are, of the translucent bench."""


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
    from markupsafe import Markup

    found = rounds.first.diagnosis
    material = _material(measurement, rounds)
    figures = {name: Markup(svg) if svg else None for name, svg in _figures(rounds)}
    return filled(
        found,
        Named.of(rounds.first.case.suspects),
        {**figures, "material": Markup(material) if material else None},
        tiles=[*effect_tiles(found), *_colour_tiles(colour)],
        rows_are=THICK,
        invisible="Whatever a change of the material can imitate at every wavelength is"
        " invisible, whatever it is.",
        colour=colour,
        rounds=[round_text(rounds, i) for i in range(len(rounds.rounds))],
        stopped=rounds.stopped,
        accepted=[accepted_text(each) for each in rounds.accepted],
        bench_file=bench_file,
        asks_next=True,
        left_out=[[each.name, each.reason] for each in rounds.first.case.left_out],
        adequacy=adequacy_rows(rounds.last.diagnosis),
        notes=rounds.first.case.reasons,
        heading="; ".join(sample_label(sample) for sample in measurement.samples),
        origin=measurement.provenance.software or "made by hand",
        fingerprint=measurement.fingerprint,
    )


def _figures(rounds: Rounds) -> list[tuple[str, str | None]]:
    one = rounds.first
    found = one.diagnosis
    problem, _ = without_broken(one.case.problem)
    if found.null is None:
        return []
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


def _colour_tiles(colour: ColourChange | None) -> list[dict[str, str]]:
    if colour is None:
        return []
    return [
        {
            "name": "colour of the material moves by",
            "number": f"{colour.moved:.2f} ΔE00",
            "note": f"{THICKNESS_MM:g} mm over black, D65",
        }
    ]
