"""The measured curve on the appearance map: I_black across, I_white up (Iser 2022, Fig. 2)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.report.content import Content, Verdict, sample_label
from scenarios.report.figure import GREY, INK, figure_style, literal, new_figure, svg_of
from scenarios.report.through_map import Map, intensities_of, map_for
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ALBEDOS = (0.5, 0.8, 0.9, 0.95, 0.98, 0.99, 0.995, 0.999)
SIGMAS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
"""Contours looked for [1/mm]; drawn when the map's grid covers them."""
_ALBEDO_LINE, _SIGMA_LINE = "#7a828c", "#b9a58f"


def draw_maps(content: Content, maps: Sequence[Map]) -> str | None:
    """One map per thickness with the measured spectral curve on it, as inline SVG.

    Args:
        content: measured intensities and the estimate (for the median g).
        maps: appearance maps; samples without one are left out.

    Returns:
        An `<svg>` element, or None when no sample has a map.
    """
    pairs = [
        (index, found)
        for index, sample in enumerate(content.samples)
        if (found := map_for(maps, sample.thickness_mm)) is not None
    ]
    if not pairs:
        return None
    columns = min(2, len(pairs))
    rows = -(-len(pairs) // columns)
    with figure_style():
        figure = new_figure(11.0 if columns == 2 else 7.2, 5.45 * rows)
        axes = figure.subplots(rows, columns, squeeze=False)
        for spare in axes.flat[len(pairs) :]:
            spare.set_visible(False)
        mappable = None
        for panel, (index, found) in zip(axes.flat, pairs, strict=False):
            mappable = _one(panel, content, index, found)
        if mappable is not None:
            _wavelength_bar(figure, mappable, axes)
        return svg_of(
            figure,
            "map",
            "The measured spectral curve over contours of constant albedo and extinction.",
        )


def median_g(content: Content, found: Map) -> float:
    """Median of the estimated g, inside the map's grid; the grid's middle when g is not known."""
    values = content.estimate.value[2]
    values = values[np.isfinite(values) & content.identifiable[2]]
    centre = float(np.median(values)) if values.size else float(np.median(found.g))
    return float(np.clip(centre, found.g[0], found.g[-1]))


def slice_at_g(found: Map, g: float, rho_black: float, rho_white: float) -> FloatArray:
    """Intensities of the map at one g, linear between the grid's two neighbours, (A, S, 3)."""
    grid = intensities_of(found, rho_black, rho_white)
    if found.g.size == 1:
        return np.asarray(grid[:, :, 0], dtype=np.float64)
    upper = int(np.clip(np.searchsorted(found.g, g), 1, found.g.size - 1))
    share = (g - found.g[upper - 1]) / (found.g[upper] - found.g[upper - 1])
    return np.asarray(
        (1 - share) * grid[:, :, upper - 1] + share * grid[:, :, upper], dtype=np.float64
    )


def backgrounds_of(content: Content) -> tuple[float, float]:
    """Median reflectances of the two backgrounds; 0.02 and 0.99 when they are not known."""
    black = 0.02 if content.rho_black is None else float(np.median(content.rho_black))
    white = 0.99 if content.rho_white is None else float(np.median(content.rho_white))
    return black, white


def _one(axes: Axes, content: Content, index: int, found: Map) -> Any:
    """Contours and curve of one sample; gives the points for the colour bar."""
    g = median_g(content, found)
    plane = slice_at_g(found, g, *backgrounds_of(content))
    _contours(axes, found, plane)
    value, valid = content.relative.value[index], content.relative.valid[index]
    seen = valid[0] & valid[1] & np.isfinite(value[0]) & np.isfinite(value[1])
    axes.plot(
        np.where(seen, value[0], np.nan), np.where(seen, value[1], np.nan), color=INK, lw=0.6,
        alpha=0.5,
    )  # fmt: skip
    wavelength = content.wavelength_nm
    points = axes.scatter(
        value[0][seen], value[1][seen], c=wavelength[seen], cmap="turbo", zorder=4, lw=0.4,
        s=42 if content.few else 14, edgecolors=INK if content.few else "none",
        vmin=float(wavelength[0]), vmax=float(wavelength[-1]),
    )  # fmt: skip
    outside = seen & content.where(Verdict.OUTSIDE)
    if outside.any():
        axes.scatter(
            value[0][outside], value[1][outside], marker="o", s=46, facecolors="none",
            edgecolors=INK, lw=0.9, zorder=5, label="outside the map",
        )  # fmt: skip
        axes.legend(loc="lower right")
    _name_wavelengths(axes, wavelength, value, seen)
    top = 1.1 * max(1.0, float(np.nanmax(plane[..., 1])), *_peak(value[1][seen]))
    axes.set_xlim(-0.03, top)
    axes.set_ylim(-0.03, top)
    axes.set_aspect("equal")
    axes.set_xticks(np.arange(0.0, top, 0.2))
    axes.plot([0, top], [0, top], color=GREY, lw=0.9, ls=(0, (1, 2)))
    axes.grid(False)
    axes.set_xlabel("I over black [–]")
    axes.set_ylabel("I over white [–]")
    sample = content.samples[index]
    axes.set_title(literal(f"{sample_label(sample)} (g = {g:.2f}, n = {found.n:.4g})"))
    return points


def _peak(values: FloatArray) -> list[float]:
    return [float(values.max())] if values.size else []


def _name_wavelengths(axes: Axes, wavelength: FloatArray, value: FloatArray, seen: Any) -> None:
    """Write a few wavelengths beside the curve, so that colour is not the only key to it."""
    where = np.flatnonzero(seen)
    if where.size == 0:
        return
    wanted = np.linspace(wavelength[where[0]], wavelength[where[-1]], 5)
    if wavelength[where[-1]] - wavelength[where[0]] >= 200:
        wanted = np.arange(
            100 * np.ceil(wavelength[where[0]] / 100), wavelength[where[-1]] + 1, 100
        )
    last = np.array([-9.0, -9.0])
    for target in wanted:
        at = where[int(np.argmin(np.abs(wavelength[where] - target)))]
        here = value[:2, at]
        if np.hypot(*(here - last)) < 0.06:
            continue
        last = here
        axes.annotate(
            f"{wavelength[at]:.0f}", (value[0, at], value[1, at]), (-9, 7),
            textcoords="offset points", ha="right", fontsize=8, color=INK, zorder=6,
            arrowprops={"arrowstyle": "-", "lw": 0.5, "color": GREY, "shrinkB": 1},
            bbox={"facecolor": "white", "alpha": 0.75, "lw": 0, "pad": 0.6},
        )  # fmt: skip


def _contours(axes: Axes, found: Map, plane: FloatArray) -> None:
    """Lines of constant albedo (solid) and constant sigma_t (dashed), interpolated on the grid."""
    albedo, sigma = found.albedo, found.sigma_t_per_mm
    for wanted in ALBEDOS:
        if albedo[0] <= wanted <= albedo[-1]:
            line = _between(albedo, plane, wanted, axis=0)
            axes.plot(line[:, 0], line[:, 1], color=_ALBEDO_LINE, lw=0.8)
            _at_end(axes, line, f"{wanted:g}", _ALBEDO_LINE)
    written = -np.inf
    for wanted in SIGMAS:
        if sigma[0] <= wanted <= sigma[-1]:
            line = _between(sigma, plane, wanted, axis=1)
            axes.plot(line[:, 0], line[:, 1], color=_SIGMA_LINE, lw=0.9, ls=(0, (4, 2)))
            top = line[-1, :2]
            if top[0] - written < 0.035:
                continue
            written = float(top[0])
            axes.annotate(
                f"{wanted:g}/mm", tuple(top), (1, 3), textcoords="offset points", ha="left",
                va="bottom", rotation=50, rotation_mode="anchor", fontsize=7, color="#8a6d45",
            )  # fmt: skip


def _at_end(axes: Axes, line: FloatArray, text: str, colour: str) -> None:
    """Name an albedo contour where it meets the diagonal."""
    axes.annotate(
        text,
        tuple(line[-1, :2]),
        (5, -5),
        textcoords="offset points",
        fontsize=7,
        color=colour,
        va="center",
    )


def _between(grid: FloatArray, plane: FloatArray, wanted: float, axis: int) -> FloatArray:
    """The line of the plane (A, S, 3) at one grid coordinate, linear between two neighbours."""
    upper = int(np.clip(np.searchsorted(grid, wanted), 1, grid.size - 1))
    share = (wanted - grid[upper - 1]) / (grid[upper] - grid[upper - 1])
    low, high = np.take(plane, upper - 1, axis=axis), np.take(plane, upper, axis=axis)
    return np.asarray((1 - share) * low + share * high, dtype=np.float64)


def _wavelength_bar(figure: Figure, mappable: Any, axes: Any) -> None:
    bar = figure.colorbar(mappable, ax=axes, shrink=0.7, aspect=34, pad=0.02)
    bar.set_label("Wavelength [nm]")
    if bar.solids is not None:  # vectors with covered seams, not an embedded picture
        bar.solids.set_rasterized(False)
        bar.solids.set_edgecolor("face")
    bar.outline.set_linewidth(0)
