"""Reports of integrating spheres and of the fluorescence bench: the same page, other pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from diagnosis.rounds import ACCEPTED
from diagnosis.screening import without_broken
from scenarios.report_diagnosis.closure_plot import waterfall
from scenarios.report_diagnosis.evidence_plot import draw_evidence, draw_separations
from scenarios.report_diagnosis.reading_plot import draw_readings
from scenarios.report_diagnosis.residual_plot import draw_residual_maps
from scenarios.report_diagnosis.rest_plot import draw_rest
from scenarios.report_diagnosis.template import adequacy_rows, effect_tiles, filled
from scenarios.report_diagnosis.words import OF_SAMPLES, UNDER_LIGHTS, Named

if TYPE_CHECKING:
    from diagnosis import Diagnosis, Problem
    from diagnosis.fluorescence import FluorescenceCase
    from diagnosis.spheres import SphereCase
    from twin.fluorescence.donaldson import DonaldsonMatrix

FEWEST = 4
"""Wavelengths from which on residuals have an autocorrelation worth a picture."""
SPHERES = (
    "Residuals in standard deviations, once the material has taken up all it can; positive is more"
    " light than predicted. Frames have the colour of their dots."
)
LIGHTS = (
    "Each row is the white or the sample under one light, its name behind the comma; red is"
    " brighter than predicted, blue darker, in standard deviations."
)
TITLES = {
    "slides": "the slides are not as described: there, or not there",
    "slide_index": "the refractive index of the slides is another",
    "sample_index": "the refractive index of the sample is another",
    "thickness": "the sample is thicker or thinner than stated",
    "wall_reflectance": "the walls of the spheres reflect more or less than stated",
    "sample_port": "the sample ports are larger or smaller than stated",
    "sphere_correction": "the readings hold the sphere's answer to the sample, or do not",
    "standard": "the reflectance standard reflects more or less than its certificate says",
    "lost_light": "more or less light than predicted misses the ports",
    "specular_light": "part of the mirror reflection is not in M_R",
    "ballistic_light": "part of the unscattered light is not in M_T",
    "acceptance": "the collimated detector collects scattered light",
    "diluent_absorption": "all dilutions share an absorption",
    "dark_offset": "a dark signal was not subtracted, or twice",
    "concentration": "a dilution was made too strong or too weak",
}
"""Effects of `diagnosis.sphere_effects` in plain words."""


def sphere_names(names: Sequence[str]) -> Named:
    """Effects of the spheres' catalogue in plain words, by the names of candidates."""
    titles = {}
    for name in names:
        bare, _, rest = name.partition("[")
        instance = f" ({rest.rstrip(']')})" if rest else ""
        titles[name] = TITLES.get(bare, bare) + instance
    return Named(titles, {}, {})


def fluorescence_names(case: FluorescenceCase, channel_nm: Sequence[float]) -> Named:
    """Candidates of a fluorescence visit in plain words, lights and channels by what they are.

    Args:
        case: the problem.
        channel_nm: wavelengths of the detector's channels [nm], in the detector's order.
    """
    plain = Named.of(case.suspects)
    known = {
        f"illuminant {number + 1}": name
        for number, name in enumerate(case.readings.data.system.illuminant_names)
    } | {f"channel {number + 1}": f"{nm:g} nm" for number, nm in enumerate(channel_nm)}
    titles = {
        each.name: plain(each.name).replace(each.instance, f"{each.instance}: {own}")
        if (own := known.get(each.instance))
        else plain(each.name)
        for each in case.suspects
    }
    return Named(titles, plain.place, plain.nominal)


def sphere_page(
    case: SphereCase, found: Diagnosis, named: Named, *, heading: str, fingerprint: str,
    reasons: Sequence[str],
) -> str:  # fmt: skip
    """The report of readings with integrating spheres.

    Args:
        case: what was diagnosed.
        found: its diagnosis.
        named: effects in plain words.
        heading: name of the file.
        fingerprint: its SHA-256.
        reasons: what was masked and assumed.
    """
    spectrum = len(case.problem.wavelength_nm) > 1
    figures = _figures(case.problem, found, draw_residual_maps if spectrum else draw_readings)
    return _page(
        found, named, figures, SPHERES, heading, fingerprint, reasons,
        left_out=[list(each) for each in case.left_out],
        invisible="Whatever a change of the samples' albedo, extinction and anisotropy can imitate"
        " is invisible, whatever it is.",
    )  # fmt: skip


def fluorescence_page(
    case: FluorescenceCase, found: Diagnosis, named: Named, without: DonaldsonMatrix, *,
    heading: str, fingerprint: str, reasons: Sequence[str],
) -> str:  # fmt: skip
    """The report of a visit to the fluorescence bench.

    Args:
        case: what was diagnosed, linearised about the leading effects.
        found: its diagnosis.
        named: effects in plain words.
        without: the matrix estimated without effects.
        heading: what was measured.
        fingerprint: SHA-256 of the visit.
        reasons: what was masked and assumed.
    """
    figures = _figures(case.problem, found, draw_residual_maps)
    if found.best is not None and found.best.hypothesis:
        after = case.matrix(found.best.values)
        figures["matrix"] = draw_matrix_change(without, after, " and ".join(found.leading))
    return _page(
        found, named, figures, LIGHTS, heading, fingerprint, reasons,
        left_out=[[each.name, each.reason] for each in case.left_out],
        invisible="Whatever a change of the matrix, of a light's level or of a channel's gain can"
        " imitate is invisible, whatever it is.",
        belongs=UNDER_LIGHTS,
    )  # fmt: skip


def _page(
    found: Diagnosis, named: Named, figures: Mapping[str, str | None], rows_are: str,
    heading: str, fingerprint: str, reasons: Sequence[str], *,
    left_out: Sequence[Sequence[str]], invisible: str, belongs: tuple[str, str] = OF_SAMPLES,
) -> str:  # fmt: skip
    moved = found.parameter_shift
    rows = [] if moved is None else [
        [name, f"{rms:.1f}"] for name, rms in zip(moved.names, moved.rms_sd, strict=True)
    ]  # fmt: skip
    return filled(
        found,
        named,
        {name: Markup(svg) if svg else None for name, svg in figures.items()},
        tiles=effect_tiles(found),
        rows_are=rows_are,
        invisible=invisible,
        heading=heading,
        origin=heading,
        fingerprint=fingerprint,
        notes=list(dict.fromkeys(reasons)),
        left_out=left_out,
        adequacy=adequacy_rows(found),
        shift=rows,
        belongs=belongs,
    )


def _figures(problem: Problem, found: Diagnosis, draw_maps: Any) -> dict[str, str | None]:
    if found.null is None:
        return {}
    problem, _ = without_broken(problem)
    added = found.verdict in ACCEPTED
    steps = []
    if found.closure is not None:
        names = found.leading if added else ()
        steps = [(names, (found.closure.before, found.closure.after))]
    rest = None
    if len(problem.wavelength_nm) >= FEWEST:
        name = "with " + " and ".join(found.leading) if found.best is not None else "no effect"
        rest = draw_rest(problem, found.best or found.null, name)
    return {
        "maps": draw_maps(problem, found),
        "evidence": draw_evidence(problem, found),
        "separations": draw_separations(found),
        "closure": waterfall(steps, found.closure),
        "rest": rest,
    }


def draw_matrix_change(before: DonaldsonMatrix, after: DonaldsonMatrix, names: str) -> str:
    """The Donaldson matrix estimated without and with effects, and the change.

    Args:
        before: estimated without effects.
        after: with them, on the same wavelengths.
        names: of the effects.
    """
    from scenarios.report.figure import figure_style, literal, new_figure, svg_of
    from scenarios.report_fluorescence.matrix_plot import picture, scale_bar

    emission, excitation = before.emission_nm, before.excitation_nm
    # A gap can bend the matrix a hundredfold: what is to be read is the one with the effects.
    top = max(float(after.fluorescence.max()), 1e-6)
    change = after.matrix - before.matrix
    panels = (
        ("Without effects", before.matrix, "viridis", 0.0, top),
        (f"With {names}", after.matrix, "viridis", 0.0, top),
        ("Change", change, "RdBu_r", -top, top),
    )
    with figure_style():
        figure = new_figure(11.0, 3.6)
        for axis, (title, value, colours, low, high) in zip(
            figure.subplots(1, 3), panels, strict=True
        ):
            mesh = picture(axis, value, emission, excitation, colours, low, high)
            scale_bar(figure, mesh, axis, "Φ per bin [–]", shrink=0.6, pad=0.02, extend="both")
            axis.set_title(literal(title), fontsize=8.5)
        return svg_of(figure, "matrix", "The matrix without and with the leading effects.")
