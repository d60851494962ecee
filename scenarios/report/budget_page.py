"""The uncertainty budget as one offline HTML page, and as the part of a report."""

from __future__ import annotations

from importlib import resources
from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.report.budget_plot import draw_budget
from scenarios.report.content import sample_label

if TYPE_CHECKING:
    from estimators.budget import InputUncertainty, UncertaintyBudget
    from twin.measurement import Measurement

NAMES = {"albedo": "Albedo", "sigma_t_per_mm": "Extinction σt", "g": "Anisotropy g"}


def budget_page(budget: UncertaintyBudget, measurement: Measurement) -> str:
    """The page as text: the same budget gives the same text.

    Args:
        budget: what is shown.
        measurement: what it is the budget of.
    """
    from markupsafe import Markup

    from scenarios.simulate import software

    wavelength = budget.wavelength_nm
    style = resources.files("scenarios.report").joinpath("style.css").read_text("utf-8")
    return _rendered(
        "budget.html.j2",
        style=Markup(style),
        part=Markup(budget_part(budget)),
        samples="; ".join(sample_label(sample) for sample in measurement.samples),
        count=wavelength.size,
        span=f"{wavelength[0]:g} to {wavelength[-1]:g} nm",
        fingerprint=measurement.fingerprint,
        software=software(),
    )


def budget_part(budget: UncertaintyBudget) -> str:
    """Sentences, plot and table as HTML: what the page and a report have in common."""
    from markupsafe import Markup

    known = bool(np.isfinite(budget.share).any())
    return _rendered(
        "budget_part.html.j2",
        figure=Markup(draw_budget(budget)) if known else None,
        sentences=budget_sentences(budget),
        **budget_table(budget),
    )


def _rendered(name: str, **values: Any) -> str:
    import jinja2

    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True
    )
    text = resources.files("scenarios.report").joinpath(name).read_text("utf-8")
    return environment.from_string(text).render(**values)


def budget_sentences(budget: UncertaintyBudget) -> list[str]:
    """What to improve first, and whether drawing the inputs agrees with the linear budget."""
    said = []
    for name, first in budget.first.items():
        share = budget.share[budget.parameters.index(name)]
        good = np.isfinite(share).all(axis=1)
        part = float(share[good, budget.inputs.index(first)].mean())
        said.append(f"{NAMES[name]}: {first} first, {100 * part:.0f} % of the variance on average.")
    if not said:
        said.append("No parameter is identifiable at any wavelength, so there is no budget.")
    if budget.monte_carlo is not None:
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = budget.monte_carlo / budget.standard_uncertainty
        known = ratio[np.isfinite(ratio)]
        if known.size:
            said.append(
                f"{budget.draws} draws of all inputs give {float(np.median(known)):.2f} times the"
                " linear standard uncertainty (median)."
            )
    return said


def budget_table(budget: UncertaintyBudget) -> dict[str, Any]:
    """`head`, `rows` and `foot`: mean share of every input in the variance, by parameter."""
    medians = budget.to_table()
    shares = [[_percent(row.get(label)) for row in medians] for label in budget.inputs]
    stated = stated_texts(budget.stated)
    values = [
        f"{float(row['median_estimate']):.4g} ± "
        f"{float(row['median_standard_uncertainty']):.2g}{' /mm' if row['unit'] == '1/mm' else ''}"
        if row["wavelengths"]
        else "–"
        for row in medians
    ]
    return {
        "head": ["Input", "Its standard uncertainty", *(NAMES[n] for n in budget.parameters)],
        "rows": [
            [label, stated[label], *own] for label, own in zip(budget.inputs, shares, strict=True)
        ],
        "foot": [
            ["Median and standard uncertainty", "", *values],
            ["Wavelengths that determine it", "", *(str(row["wavelengths"]) for row in medians)],
        ],
    }


def _percent(share: str | float | None) -> str:
    if share is None:
        return "–"
    value = 100 * float(share)
    return f"{value:.0f} %" if value >= 1 or value == 0 else "< 1 %"


def stated_texts(stated: InputUncertainty) -> dict[str, str]:
    """The standard uncertainty of every input, in words."""
    return {
        "counts and references": "as measured",
        "thickness": f"{stated.thickness_mm:g} mm, each sample",
        "refractive index": f"{stated.n:g}",
        "black reflectance": f"{100 * stated.rho_black_relative:g} %",
        "white reflectance": f"{100 * stated.rho_white_relative:g} %",
        "aperture": f"{100 * stated.acceptance_relative:g} % of its angle",
        "engine": "as the engine states",
        "interpolation": f"{100 * stated.interpolation_relative:g} %",
    }
