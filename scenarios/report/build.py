"""One offline HTML file from a measurement and a result."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping, Sequence
from importlib import metadata, resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.outputs import prepare_file
from scenarios.report.bench_drawing import draw_bench, lengths
from scenarios.report.colour import Colours, colours_of
from scenarios.report.content import CAPTURES, Content
from scenarios.report.headline import headline
from scenarios.report.map_plot import backgrounds_of, draw_maps
from scenarios.report.plots import draw_counts, draw_lights, draw_relative
from scenarios.report.reading import content_of
from scenarios.report.result_plots import draw_beer, draw_properties, draw_residuals
from scenarios.report.solver import NOTHING_SAID, solver_parts
from scenarios.report.through_map import Map, map_for
from twin.files import write_atomically

if TYPE_CHECKING:
    from estimators import UncertaintyBudget

LIBRARIES = (
    "numpy", "scipy", "warp-lang", "jax", "colour-science", "matplotlib", "pydantic", "xarray",
)  # fmt: skip
"""Libraries whose versions a report states."""


def write_report(
    measurement: Any,
    result: Any,
    path: str | Path,
    *,
    maps: Sequence[Map] | Mapping[Any, Map] | None = None,
    budget: UncertaintyBudget | None = None,
    settings: Mapping[str, Any] | None = None,
) -> Path:
    """Write the report of a result as one HTML file that needs nothing else.

    Args:
        measurement: the visit (twin.measurement.Measurement).
        result: what the estimator found (estimators.EstimateResult).
        path: the file to write; replaced as a whole or not at all.
        maps: appearance maps, one per thickness; a sequence, or a mapping with maps as values.
        budget: uncertainty budget of the result, when there is one.
        settings: what was set, nested as it likes; "title", "command" and "versions" have their
            own places on the page.

    Returns:
        The path.

    Raises:
        InputError: the file cannot be written.
    """
    target = prepare_file(Path(path))
    found = tuple(maps.values()) if isinstance(maps, Mapping) else tuple(maps or ())
    content = content_of(measurement, result, found)
    solver = solver_parts(result, content, budget)
    html = render(content, maps=found, solver=solver, settings=settings)
    write_atomically(target, html.encode("utf-8"))
    return target


def render(
    content: Content,
    *,
    maps: Sequence[Map] = (),
    solver: Mapping[str, Any] | None = None,
    settings: Mapping[str, Any] | None = None,
) -> str:
    """The page as text: the same content gives the same text."""
    import jinja2
    from markupsafe import Markup

    folder = resources.files("scenarios.report")
    given = dict(settings or {})
    title = str(given.pop("title", "") or _title(content))
    command = str(given.pop("command", "") or "")
    versions = given.pop("versions", None)
    figures = {
        "properties": draw_properties(content),
        "map": draw_maps(content, maps),
        "residuals": draw_residuals(content),
        "beer": draw_beer(content),
        "relative": draw_relative(content),
        "counts": draw_counts(content),
        "bench": draw_bench(content.bench, content.samples),
        "lights": draw_lights(content),
    }
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True
    )
    template = environment.from_string(folder.joinpath("report.html.j2").read_text("utf-8"))
    colours = colours_of(content)
    return template.render(
        style=Markup(folder.joinpath("style.css").read_text("utf-8")),
        figures={name: Markup(svg) if svg else None for name, svg in figures.items()},
        title=title,
        command=command,
        version=_version("benchtwin"),
        headline=headline(content),
        notes=content.notes,
        solver=solver or NOTHING_SAID,
        has_truth=content.truth is not None,
        has_g=content.has_g,
        colours=colours,
        truth_colour=content.truth_intensities is not None,
        colour_note=_colour_note(content, colours),
        signed=lambda number: f"{number:+.1f}".replace("-", "−"),
        **_captions(content, maps),
        **_tables(content),
        identity_rows=_identity(content, versions),
        setting_rows=flattened(_settings(content, given)),
        bench_settings=flattened(content.bench.model_dump(mode="json")),
    )


def _title(content: Content) -> str:
    names = [sample.name for sample in content.samples]
    return names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"


def _captions(content: Content, maps: Sequence[Map]) -> dict[str, Any]:
    """Sentences under the figures that depend on what is there."""
    black, white = backgrounds_of(content)
    without = [
        f"No map of the thickness of {sample.name} ({sample.thickness_mm:g} mm) came with the"
        " result."
        for sample in content.samples
        if maps and map_for(maps, sample.thickness_mm) is None
    ]
    bands = "The dark band is one standard deviation, the pale one holds 90 %. " * (
        content.estimate.low is not None
    )
    against = (
        "The blue curve should follow the broad orange one (truth); right, the bands should hold"
        " the zero line where the estimate is right."
        if content.truth is not None
        else "Curves of different thicknesses should lie together."
    )
    options = content.options
    joint = options.get("joint") == "true" or float(options.get("smoothness_nm", 0.0)) > 0.0
    how = (
        "for all wavelengths together, as smooth spectra" if joint else "for each wavelength alone"
    )
    return {
        "properties_text": f"Estimated {how}. Method: {content.method}.",
        "properties_caption": f"{bands}{against} Dashed: each thickness alone. The albedo axis is"
        " −log10(1 − albedo), so that each further nine takes the same height. Grey: masked;"
        " vermilion: outside the map. Thin: the captures do not determine the parameter there"
        " (g where nothing scatters), and the band says how little is known.",
        "map_caption": "The curve runs from blue (short wavelengths) to red (long ones); some"
        " wavelengths are written beside it. Solid lines: constant albedo, named where they meet"
        " the opaque diagonal; dashed: constant extinction, named at the top. Drawn for the median"
        f" g and backgrounds of {100 * black:.2g} % and {100 * white:.3g} % (medians over"
        " wavelength).",
        "map_missing": without,
        "residual_caption": "Points should scatter evenly within ±2 (shaded). A trend over"
        " wavelength, or one thickness above and another below, means that the bench is not as"
        " described. Predicted minus measured, in standard deviations, the simulation's own error"
        " included; an arrow at the edge is a point beyond the axis.",
        "relative_caption": "Error bars are one standard deviation (drawn at some wavelengths"
        " only); below, the same in per cent. Masked values are left out. The gap between black"
        " and white closes as the sample becomes opaque.",
        "counts_caption": "Mean of the repeats, dark not subtracted. "
        + (
            "Nothing may touch the dashed line: saturated readings (crosses) are masked."
            if content.saturation_counts is not None
            else "Where the instrument saturates is not known."
        ),
    }


def _colour_note(content: Content, colours: Colours) -> str:
    parts = []
    if content.broad:
        parts.append("Few broad channels, joined linearly: the colours are rough.")
        if content.truth is not None:
            parts.append("The truth is averaged over the channels' bands, which are broad.")
    elif content.few:
        parts.append("Few wavelengths, joined linearly: the colours are rough.")
    shown = [
        swatch
        for row in colours.rows
        for swatch in (row.measured, row.predicted, row.truth)
        if swatch is not None
    ]
    outside = sum(not swatch.in_gamut for swatch in shown)
    if outside:
        parts.append(
            f"{outside} of {len(shown)} colours lie outside sRGB and are shown as the nearest"
            " colour that a screen can show; the numbers are not changed."
        )
    return " ".join(parts)


def _tables(content: Content) -> dict[str, Any]:
    masked = ~content.relative.valid
    residual_rows = []
    if content.residual is not None:
        for index, sample in enumerate(content.samples):
            cells = []
            for number in range(len(CAPTURES)):
                seen = content.residual[index, number]
                seen = seen[np.isfinite(seen)]
                cells.append(f"{np.sqrt(np.mean(seen**2)):.2f}" if seen.size else "–")
            residual_rows.append({"name": sample.name, "cells": cells})
    return {
        "bench_rows": lengths(content.bench, content.samples),
        "residual_rows": residual_rows,
        "masked_total": int(masked.sum()),
        "masked_of": int(masked.size),
        "masked_rows": [
            {"name": sample.name, "cells": [str(int(count)) for count in masked[index].sum(axis=1)]}
            for index, sample in enumerate(content.samples)
        ],
        "reasons": content.relative.reasons,
        "statuses": [row for row in content.statuses if row.count],
    }


def _identity(content: Content, versions: Any) -> list[tuple[str, str]]:
    rows = [
        ("Measurement", content.origin or "not recorded"),
        ("Made by", content.software or "not recorded"),
        ("Seed", content.seed or "none: a real measurement, or not recorded"),
        ("Fingerprint of the measurement (SHA-256)", content.fingerprint or "not recorded"),
        (
            "Fingerprint of the estimate's input (SHA-256)",
            content.result_fingerprint or "not recorded",
        ),
    ]
    known = (
        versions if isinstance(versions, Mapping) else {name: _version(name) for name in LIBRARIES}
    )
    known = {"benchtwin": _version("benchtwin"), "Python": platform.python_version(), **known}
    rows.append(("Versions", ", ".join(f"{name} {value}" for name, value in known.items())))
    return rows


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "(not installed)"


def _settings(content: Content, given: dict[str, Any]) -> dict[str, Any]:
    """What was given, the estimator's options and what the scenario adds (not the bench)."""
    rows = dict(given)
    if content.options:
        rows.setdefault("estimator_used", dict(content.options))
    if content.scenario and "scenario" not in rows:
        try:
            scenario = json.loads(content.scenario)
        except ValueError:
            scenario = content.scenario
        if isinstance(scenario, dict):
            known = {"bench", "title", *given}
            scenario = {key: item for key, item in scenario.items() if key not in known}
        if scenario:
            rows["scenario"] = scenario
    return rows


def flattened(value: Any, prefix: str = "") -> list[tuple[str, str]]:
    """Nested settings as rows of dotted names and texts; long lists are shortened and say so."""
    if isinstance(value, Mapping):
        rows: list[tuple[str, str]] = []
        for key, item in value.items():
            rows += flattened(item, f"{prefix}.{key}" if prefix else str(key))
        return rows or ([(prefix, "(empty)")] if prefix else [])
    if isinstance(value, (list, tuple)):
        if value and all(isinstance(item, Mapping) for item in value):
            rows = []
            for number, item in enumerate(value):
                rows += flattened(item, f"{prefix}[{number}]")
            return rows
        shown = ", ".join(_text(item) for item in value[:12])
        return [
            (prefix, f"{shown}, … ({len(value)} values)" if len(value) > 12 else shown or "none")
        ]
    return [(prefix, _text(value))]


def _text(value: Any) -> str:
    if value is None:
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
