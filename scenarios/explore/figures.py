"""Figures of the page as plain values for plotly: what a browser draws, and a test can read."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from scenarios.explore.contours import Plane
from scenarios.explore.model import Picture
from scenarios.explore.noise import CAPTURES
from scenarios.explore.source import Source
from scenarios.explore.uncertainty import WORDS
from scenarios.report.figure import BLUE, GREEN, INK, ORANGE, PURPLE, VERMILION
from twin.spectra import FloatArray

Figure = dict[str, Any]
FONT = "Source Sans 3, Segoe UI, Helvetica Neue, Helvetica, Arial, Liberation Sans, sans-serif"
ALBEDO_LINE, SIGMA_LINE, SIGMA_TEXT = "#8c949e", "#c3a98d", "#8a6d45"
AXIS_TITLE: Any = {"standoff": 6, "font": {"size": 12.5}}
GRID, AXIS = "#e8ebef", "#9aa3ae"
CAPTURE_COLOURS = dict(zip(CAPTURES, (INK, ORANGE, BLUE), strict=True))
PARAMETER_COLOURS = (PURPLE, VERMILION, GREEN)
TURBO = (
    "#30123b",
    "#434eba",
    "#4685fa",
    "#28bceb",
    "#1ae4b6",
    "#55fa76",
    "#a4fc3c",
    "#d9e436",
    "#faba39",
    "#fb7e21",
    "#e4450a",
    "#b91e02",
    "#7a0403",
)
"""Colours of wavelengths: thirteen even steps of Turbo (Mikhailov 2019), as the reports have it."""
TOP = 1.12
"""Of the appearance map's axes."""
LABEL_ROOM = 0.035
DECADES = (-5.0, 0.0)
"""Of the standard errors' axis, as logarithms; it grows when they do not suffice."""
NOTHING: list[Figure] = [{"type": "scatter", "x": [None], "y": [None], "hoverinfo": "skip"}]
GRAPH: Any = {
    "displayModeBar": False,
    "responsive": True,
    "displaylogo": False,
    "scrollZoom": False,
}
"""How a browser shows every figure: no tool bar, nothing that leads elsewhere."""


def contours_figure(plane: Plane) -> Figure:
    """The contours of the appearance map: they stay while albedo, sigma_t or noise move."""
    diagonal = np.array([[0.0, 0.0], [TOP, TOP]])
    traces = [
        _lines([*plane.of_albedo, diagonal], ALBEDO_LINE, "solid"),
        _lines([*plane.of_sigma], SIGMA_LINE, "5px,4px"),
        _labels(
            (plane.of_albedo[:, -1], [f" {a:g}" for a in plane.albedo], "middle right", "#5d6670"),
            (plane.of_sigma[:, -1], [f"{s:g}" for s in plane.sigma_t_per_mm], "top center",
             SIGMA_TEXT),
        ),
    ]  # fmt: skip
    return {"data": traces, "layout": without_axes(map_axes()["layout"])}


def map_figure(source: Source, picture: Picture) -> Figure:
    """The material's point and spectral curve on the map of the chosen sample."""
    settings, wavelength = picture.settings, source.wavelength_nm
    index, sample = settings.wavelength, settings.sample
    curve = picture.captures[:, sample, :2]
    stops = [[k / (len(TURBO) - 1), colour] for k, colour in enumerate(TURBO)]
    scale = {"cmin": float(wavelength[0]), "cmax": float(wavelength[-1]), "colorscale": stops}
    traces: list[Figure] = []
    measured = source.measured
    if measured is not None:
        x, y = rounded(measured.value[sample, :2].T)
        traces.append(
            {
                "type": "scatter", "mode": "markers", "name": "measured", "x": x, "y": y,
                "marker": {"size": 7, "symbol": "circle", "color": _list(measured.wavelength_nm),
                           **scale, "line": {"width": 0}},
                "customdata": _list(measured.wavelength_nm),
                "hovertemplate": "measured, %{customdata:.0f} nm<extra></extra>",
            }
        )  # fmt: skip
        at = int(np.argmin(np.abs(measured.wavelength_nm - wavelength[index])))
        x, y = rounded(measured.value[sample, :2, at : at + 1].T)
        traces.append(
            {
                "type": "scatter", "mode": "markers", "name": "measured here", "x": x, "y": y,
                "marker": {"size": 15, "symbol": "square-open", "color": INK,
                           "line": {"width": 2}},
                "hovertemplate": f"measured at {measured.wavelength_nm[at]:.0f} nm<extra></extra>",
            }
        )  # fmt: skip
    x, y = rounded(curve)
    small = 4 if measured is not None else 6
    traces.append(
        {
            "type": "scatter", "mode": "lines+markers", "name": "predicted", "x": x, "y": y,
            "line": {"color": "#b3bac2", "width": 1},
            "marker": {
                "size": small, "color": _list(wavelength), **scale,
                "line": {"width": 0.6 if measured is not None else 0, "color": INK},
            },
            "customdata": _list(wavelength),
            "hovertemplate": "%{customdata:.0f} nm: %{x:.4f}, %{y:.4f}<extra></extra>",
        }
    )  # fmt: skip
    traces.append(
        {
            "type": "scatter", "mode": "markers", "name": "point",
            "x": [picture.point[0]], "y": [picture.point[1]],
            "marker": {"size": 15, "color": "rgba(0,0,0,0)",
                       "line": {"width": 2.5, "color": VERMILION}},
            "hovertemplate": "%{x:.4f} over black, %{y:.4f} over white<extra></extra>",
        }
    )  # fmt: skip
    return {"data": traces, "layout": without_axes(map_axes()["layout"])}


def map_axes() -> Figure:
    """The axes of the appearance map: a figure of its own, under the one that moves."""
    layout = layout_of("I over black [–]", "I over white [–]")
    layout["margin"] = {"l": 48, "r": 6, "t": 6, "b": 40}
    for axis in ("xaxis", "yaxis"):
        layout[axis] |= {"range": [-0.03, TOP], "showgrid": False, "dtick": 0.2}
    layout["yaxis"] |= {"scaleanchor": "x", "constrain": "domain", "constraintoward": "top"}
    layout["xaxis"] |= {"constrain": "domain", "constraintoward": "center"}
    return {"data": NOTHING, "layout": layout}


def without_axes(layout: Figure) -> Figure:
    """The same layout with axes that are there and not drawn: drawing them takes half the time."""
    return {
        name: {**value, "visible": False} if "axis" in name else value
        for name, value in layout.items()
    }


def spectra_figure(source: Source, picture: Picture) -> Figure:
    """Above the captures of the chosen sample over wavelength, below the standard errors."""
    layout = without_axes(spectra_axes(source, picture)["layout"])
    at = float(source.wavelength_nm[picture.settings.wavelength])
    layout["shapes"] = [
        {
            "type": "line", "x0": at, "x1": at, "y0": 0, "y1": 1, "yref": "paper",
            "line": {"color": VERMILION, "width": 1.2, "dash": "dot"},
        }
    ]  # fmt: skip
    errors = relative_errors(picture)
    traces = [*_capture_traces(source, picture), *_error_traces(source, picture, errors)]
    return {"data": traces, "layout": layout}


def spectra_axes(source: Source, picture: Picture) -> Figure:
    """The axes of the spectra; they change only when errors leave the usual decades."""
    layout = layout_of("Wavelength [nm]", "Relative intensity [–]")
    low, high = float(source.wavelength_nm[0]), float(source.wavelength_nm[-1])
    room = 0.02 * (high - low) or 1.0
    layout["xaxis"] |= {"range": [low - room, high + room], "anchor": "y2"}
    layout["yaxis"] |= {"range": [-0.03, TOP], "dtick": 0.2, "domain": [0.5, 1.0]}
    errors = np.log10(np.maximum(relative_errors(picture), 1e-12))
    least = min(DECADES[0], float(np.floor(errors.min())))
    most = max(DECADES[1], float(np.ceil(errors.max())))
    layout["yaxis2"] = layout["yaxis"] | {
        "type": "log", "range": [least - 0.1, most + 0.1], "dtick": 1, "domain": [0.0, 0.46],
        "exponentformat": "power", "title": {**AXIS_TITLE, "text": "Standard error [–]"},
    }  # fmt: skip
    return {"data": [*NOTHING, {**NOTHING[0], "yaxis": "y2"}], "layout": layout}


def _capture_traces(source: Source, picture: Picture) -> list[Figure]:
    sample, traces = picture.settings.sample, []
    for number, name in enumerate(CAPTURES):
        colour = CAPTURE_COLOURS[name]
        traces.append(
            {
                "type": "scatter", "mode": "lines", "x": _list(source.wavelength_nm),
                "y": _list(picture.captures[:, sample, number]), "name": name,
                "line": {"color": colour, "width": 2},
                "hovertemplate": f"{name} %{{x:.0f}} nm: %{{y:.4f}}<extra></extra>",
            }
        )  # fmt: skip
        if source.measured is not None:
            traces.append(
                {
                    "type": "scatter", "mode": "markers", "name": f"{name} measured",
                    "x": _list(source.measured.wavelength_nm),
                    "y": _list(source.measured.value[sample, number]),
                    "marker": {"size": 3.5, "color": colour, "opacity": 0.55},
                    "hovertemplate": f"{name}, measured %{{x:.0f}} nm: %{{y:.4f}}<extra></extra>",
                }
            )  # fmt: skip
    return traces


def _error_traces(source: Source, picture: Picture, errors: FloatArray) -> list[Figure]:
    traces: list[Figure] = []
    for number, word in enumerate((WORDS[0], f"{WORDS[1]}, relative", WORDS[2])):
        colour = PARAMETER_COLOURS[number]
        known = picture.uncertainty.determined[:, number]
        traces.append(
            {
                "type": "scatter", "mode": "lines", "x": _list(source.wavelength_nm),
                "y": _list(errors[:, number]), "yaxis": "y2", "name": word,
                "line": {"color": colour, "width": 2},
                "hovertemplate": f"{word} %{{x:.0f}} nm: %{{y:.2g}}<extra></extra>",
            }
        )  # fmt: skip
        if known.all():
            continue
        traces.append(
            {
                "type": "scatter", "mode": "markers", "yaxis": "y2",
                "x": _list(source.wavelength_nm[~known]), "y": _list(errors[~known, number]),
                "name": f"{word} not determined",
                "marker": {"size": 7, "symbol": "x", "color": colour},
                "hovertemplate": f"{word} is not determined at %{{x:.0f}} nm<extra></extra>",
            }
        )  # fmt: skip
    return traces


def relative_errors(picture: Picture) -> FloatArray:
    """Standard errors of albedo, sigma_t (relative) and g, shape (W, 3)."""
    found = picture.uncertainty.standard_error.copy()
    found[:, 1] /= picture.spectrum.sigma_t_per_mm
    return found


def with_error(value: float, error: float, digits: int = 2) -> str:
    """A value with its standard error, both to so many digits of the error: "0.3530 ± 0.0012"."""
    if not np.isfinite(error) or error <= 0:
        return f"{value:.4g}"
    places = min(max(digits - 1 - int(np.floor(np.log10(error))), 0), 7)
    return f"{value:.{places}f} ± {error:.{places}f}"


def _list(values: FloatArray, digits: int = 5) -> list[float | None]:
    """Plain values to `digits` significant digits; None where there is no number."""
    return [float(f"{v:.{digits}g}") if np.isfinite(v) else None for v in np.ravel(values)]


def rounded(points: FloatArray) -> tuple[list[float | None], list[float | None]]:
    """Points (P, 2) as two lists."""
    return _list(points[:, 0]), _list(points[:, 1])


def _lines(lines: Sequence[FloatArray], colour: str, dash: str) -> Figure:
    """Lines (P, 2) as one trace with gaps: one trace is redrawn faster than many."""
    x: list[float | None] = []
    y: list[float | None] = []
    for line in lines:
        for target, values in zip((x, y), rounded(line), strict=True):
            target += [*values, None]
    return _line(x, y, colour, 1.1, dash)


def _line(
    x: Iterable[Any], y: Iterable[Any], colour: str, width: float, dash: str = "solid"
) -> Figure:
    return {
        "type": "scatter", "mode": "lines", "x": list(x), "y": list(y), "hoverinfo": "skip",
        "showlegend": False, "line": {"color": colour, "width": width, "dash": dash},
    }  # fmt: skip


def _labels(*groups: tuple[FloatArray, list[str], str, str]) -> Figure:
    """Texts at the ends of contours; in a group those that would overlap are left out.

    Args:
        *groups: places (P, 2), texts, where to write them, colour.
    """
    x: list[float | None] = []
    y: list[float | None] = []
    text: list[str] = []
    where: list[str] = []
    colours: list[str] = []
    for points, texts, side, colour in groups:
        kept: list[int] = []
        for index in range(len(texts)):
            if all(np.hypot(*(points[index] - points[k])) >= LABEL_ROOM for k in kept):
                kept.append(index)
        for target, values in zip((x, y), rounded(points[kept].reshape(-1, 2)), strict=True):
            target += values
        text += [texts[k] for k in kept]
        where += [side] * len(kept)
        colours += [colour] * len(kept)
    return {
        "type": "scatter", "mode": "text", "x": x, "y": y, "text": text, "textposition": where,
        "textfont": {"size": 10, "color": colours}, "hoverinfo": "skip", "showlegend": False,
        "cliponaxis": False,
    }  # fmt: skip


def layout_of(across: str, up: str) -> Figure:
    """The look of every figure, with the titles of its axes."""
    axis = {
        "gridcolor": GRID, "linecolor": AXIS, "showline": True, "zeroline": False,
        "fixedrange": True, "ticks": "outside", "ticklen": 4, "tickcolor": AXIS,
        "tickfont": {"size": 11},
    }  # fmt: skip
    return {
        "font": {"family": FONT, "size": 12, "color": INK},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "margin": {"l": 54, "r": 10, "t": 8, "b": 38},
        "xaxis": {**axis, "title": {**AXIS_TITLE, "text": across}},
        "yaxis": {**axis, "title": {**AXIS_TITLE, "text": up}},
        "hovermode": "closest",
        "showlegend": False,
        "dragmode": False,
    }
