"""What a picture changes on the page: figures, readings, tiles, swatches."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from dash import html
from markupsafe import escape

from scenarios.explore.figures import (
    CAPTURE_COLOURS,
    PARAMETER_COLOURS,
    TURBO,
    contours_figure,
    map_axes,
    map_figure,
    spectra_axes,
    spectra_figure,
    with_error,
)
from scenarios.explore.noise import CAPTURES
from scenarios.explore.uncertainty import PARAMETERS

if TYPE_CHECKING:
    from scenarios.explore.model import Explorer, Picture
    from scenarios.explore.source import Source

Part = Any
"""Something that dash can show."""


def figures_of(explorer: Explorer, picture: Picture) -> dict[str, Part]:
    """The figures of one picture by the name of the graph that shows them."""
    source = explorer.source
    return {
        "map-axes": map_axes(),
        "map-contours": contours_figure(explorer.plane(picture.settings)),
        "map": map_figure(source, picture),
        "spectra": spectra_figure(source, picture),
        "spectra-axes": spectra_axes(source, picture),
    }


def map_title(explorer: Explorer, picture: Picture) -> list[Part]:
    """What the map shows, with the keys of its contours."""
    settings = picture.settings
    low, high = explorer.source.wavelength_nm[[0, -1]]
    return [
        f"Appearance map at {explorer.source.wavelength_nm[settings.wavelength]:.0f} nm",
        html.Span(
            f"{settings.thickness_mm:.3g} mm, g = {settings.g:.2f}, n = {settings.n:.3f}",
            className="aside",
        ),
        html.Span(
            [
                html.I(className="solid"),
                "albedo",
                html.I(className="dashed"),
                "σt [1/mm]",
                html.I(
                    className="colours",
                    style={"background": f"linear-gradient(90deg, {', '.join(TURBO)})"},
                ),
                f"{low:.0f} to {high:.0f} nm",
            ],
            className="key",
        ),
    ]


def readings(picture: Picture) -> list[Part]:
    """The captures of the chosen sample and wavelength, with their standard errors."""
    settings = picture.settings
    values, sigma = (
        array[settings.wavelength, settings.sample] for array in (picture.captures, picture.sigma)
    )
    return [
        html.Div(
            [
                html.I(style={"background": CAPTURE_COLOURS[name]}),
                name,
                html.B(with_error(float(value), float(error))),
            ]
        )
        for name, value, error in zip(CAPTURES, values, sigma, strict=True)
    ]


def tiles(source: Source, picture: Picture) -> list[Part]:
    """Albedo, sigma_t and g with their standard errors, and what is not identifiable."""
    settings, found = picture.settings, picture.uncertainty
    index = settings.wavelength
    boxes = []
    for number, (name, title, unit) in enumerate(
        zip(PARAMETERS, ("Albedo", "σt [1/mm]", "g"), ("albedo", "per_mm", "g"), strict=True)
    ):
        value = float(getattr(picture.spectrum, name)[index])
        error = float(found.standard_error[index, number])
        known = bool(found.determined[index, number])
        relative = f"{100 * error / abs(value):.2g} %" if value else "–"
        boxes.append(
            html.Div(
                [
                    html.Div(
                        [html.I(style={"background": PARAMETER_COLOURS[number]}), title],
                        className="name",
                    ),
                    html.Div(
                        with_error(value, error) if known else f"{value:.3g}",
                        className="number", id=f"tile-{unit}",
                    ),
                    html.Div(
                        f"standard error {relative}" if known else "not determined",
                        className="note" if known else "note vague",
                    ),
                    *_estimated(source, index, number),
                ],
                className="tile",
            )
        )  # fmt: skip
    whose = "all samples" if settings.all_samples else "this sample alone"
    tone = "good" if bool(found.determined[index].all()) else "mixed"
    words = html.Div(
        [html.P(sentence) for sentence in found.sentences(index)]
        + [
            html.P(
                f"From {whose}, noise and the fast engine's error alone: thickness, index,"
                " backgrounds and aperture count as known.",
                className="soft",
            )
        ],
        className=f"verdict {tone}",
        id="words",
    )
    return [html.Div(boxes, className="boxes"), words]


def _estimated(source: Source, index: int, number: int) -> list[Part]:
    """What the loaded estimate says there, whatever the sliders say."""
    if source.result is None:
        return []
    at = int(np.argmin(np.abs(source.result.wavelength_nm - source.wavelength_nm[index])))
    value, error = (
        float(array[at, number])
        for array in (source.result.parameters, source.result.standard_error)
    )
    said = with_error(value, error) if math.isfinite(value) else "no value"
    return [html.Div(f"estimate {said}", className="note")]


def swatches(picture: Picture) -> list[Part]:
    """Colours over black, over white, and thick."""
    if picture.swatches is None:
        return [html.P("These wavelengths carry no colour: 430 to 670 nm are needed.")]
    fields = []
    for label, swatch in zip(("over black", "over white", "opaque"), picture.swatches, strict=True):
        lightness, a, b = swatch.lab
        note = "" if swatch.in_gamut else ", outside sRGB"
        fields.append(
            html.Div(
                [
                    html.Div(className="field", style={"background": swatch.hexadecimal}),
                    html.Div(
                        [html.B(label), f"L* {lightness:.1f}  a* {a:.1f}  b* {b:.1f}{note}"],
                        className="label",
                    ),
                ],
                className="swatch",
            )
        )
    return fields


def pieces(explorer: Explorer, picture: Picture) -> dict[str, str]:
    """The page's texts of one picture: HTML by the id of the element that holds it."""
    return {
        "map-title": html_of(map_title(explorer, picture)),
        "tiles": html_of(tiles(explorer.source, picture)),
        "readings": html_of(readings(picture)),
        "swatches": html_of(swatches(picture)),
    }


def html_of(part: Part) -> str:
    """Plain elements of dash as text; what people wrote is escaped."""
    if isinstance(part, list | tuple):
        return "".join(html_of(each) for each in part)
    if part is None or isinstance(part, str | int | float):
        return "" if part is None else str(escape(part))
    tag = type(part).__name__.lower()
    attributes = ""
    if name := getattr(part, "className", None):
        attributes += f' class="{escape(name)}"'
    if name := getattr(part, "id", None):
        attributes += f' id="{escape(name)}"'
    if style := getattr(part, "style", None):
        attributes += f' style="{escape("; ".join(f"{k}: {v}" for k, v in style.items()))}"'
    return f"<{tag}{attributes}>{html_of(getattr(part, 'children', None))}</{tag}>"
