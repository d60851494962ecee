"""What went in: lamps, backgrounds, raw counts and relative intensities."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.report.content import CAPTURE_TITLES, CAPTURES, Content, Counts, sample_label
from scenarios.report.figure import (
    BLUE,
    GREY,
    INK,
    ORANGE,
    VERMILION,
    figure_style,
    literal,
    new_figure,
    plain_ticks,
    series_style,
    svg_of,
    wavelength_axis,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ERROR_BARS = 30
"""At most about this many error bars along one curve."""
_COUNT_ORDER = (
    "white_reference", "black_reference", "beam_reference", "dark", "white", "black", "collimated",
)  # fmt: skip


def draw_lights(content: Content) -> str | None:
    """Lamp spectra and background reflectances, or None when neither is known."""
    lamps = [
        (values, name, colour, style)
        for values, name, colour, style in (
            (content.lamp_panels, "panels", BLUE, "-"),
            (content.lamp_beam, "beam", VERMILION, "--"),
        )
        if values is not None
    ]
    backgrounds = [
        (content.rho_white, "White background", ORANGE),
        (content.rho_black, "Black background", INK),
    ]
    if not lamps and all(values is None for values, _name, _colour in backgrounds):
        return None
    with figure_style():
        figure = new_figure(11.0, 2.9)
        axes = figure.subplots(1, 3)
        for power, name, colour, style in lamps:
            axes[0].plot(content.wavelength_nm, power, color=colour, ls=style, label=name)
        axes[0].set_title("Lamps")
        axes[0].set_ylabel("Relative power per nm [–]")
        axes[0].set_ylim(bottom=0)
        if lamps:
            axes[0].legend(loc="best")
        for axis, (values, name, colour) in zip(axes[1:], backgrounds, strict=True):
            axis.set_title(name)
            axis.set_ylabel("Reflectance [%]")
            if values is None:
                _say(axis, "not known")
                continue
            axis.plot(content.wavelength_nm, 100 * values, color=colour, label="described")
            measured = content.rho_black_measured
            if name.startswith("Black") and measured is not None:
                axis.plot(
                    content.wavelength_nm, 100 * measured, color=VERMILION, ls=(0, (4, 2)), lw=1.1,
                    label="measured",
                )  # fmt: skip
                axis.legend(loc="best")
            low, high = 100 * float(np.min(values)), 100 * float(np.max(values))
            room = max(0.15 * (high - low), 0.02 * high, 0.05)
            axis.set_ylim(max(0.0, low - room), max(high, min(high + room, 100.0)) + 0.1 * room)
        for axis in axes:
            wavelength_axis(axis, content.wavelength_nm)
        return svg_of(figure, "lights", "Spectra of the lamps and reflectances of the backgrounds.")


def draw_counts(content: Content) -> str | None:
    """Raw counts of each capture with the saturation line, or None when there are none."""
    kinds = [
        kind for kind in _COUNT_ORDER if any(entry.capture == kind for entry in content.counts)
    ]
    if not kinds:
        return None
    columns = min(4, len(kinds))
    rows = -(-len(kinds) // columns)
    order = {sample.name: number for number, sample in enumerate(content.samples)}
    with figure_style():
        figure = new_figure(11.0, 0.5 + 2.35 * rows)
        axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
        for spare in axes.flat[len(kinds) :]:
            spare.set_visible(False)
        for axis, kind in zip(axes.flat, kinds, strict=False):
            for entry in content.counts:
                if entry.capture == kind:
                    _one_count(axis, content, entry, order)
            axis.set_title(kind.replace("_", " ").capitalize())
            if content.saturation_counts is not None:
                axis.axhline(content.saturation_counts, color=VERMILION, lw=1, ls=(0, (5, 3)))
            axis.set_ylim(bottom=0)
        axes[0, 0].set_ylim(0, _top_count(content))
        if content.saturation_counts is not None:
            axes[0, 0].annotate(
                f"saturation {content.saturation_counts:,.0f}",
                (content.wavelength_nm[-1], content.saturation_counts), (0, -3),
                textcoords="offset points", ha="right", va="top", fontsize=7.5, color=VERMILION,
            )  # fmt: skip
        for axis in axes[:, 0]:
            axis.set_ylabel("Counts per shot")
        for number, axis in enumerate(axes.flat[: len(kinds)]):
            if number + columns >= len(kinds):
                axis.tick_params(labelbottom=True)
                wavelength_axis(axis, content.wavelength_nm)
        sample_legend(figure, content)
        return svg_of(figure, "counts", "Raw counts of every capture against wavelength.")


def _top_count(content: Content) -> float:
    highest = max(float(np.nanmax(entry.counts)) for entry in content.counts)
    return 1.08 * max(highest, content.saturation_counts or 0.0)


def _one_count(axis: Axes, content: Content, entry: Counts, order: dict[str, int]) -> None:
    sample, counts = entry.sample, entry.counts
    colour, marker = (GREY, "o") if sample not in order else series_style(order[sample])
    style: dict[str, Any] = {"marker": marker, "ms": 4} if content.few else {}
    ls = "-" if order.get(sample, 0) == 0 else (0, (4, 2))
    axis.plot(content.wavelength_nm, counts, color=colour, ls=ls, lw=1.2, **style)
    if entry.saturated.any():
        axis.plot(
            content.wavelength_nm[entry.saturated], counts[entry.saturated], "x", ms=4,
            color=VERMILION,
        )  # fmt: skip


def draw_relative(content: Content) -> str:
    """Relative intensities with error bars (above) and their relative uncertainty (below)."""
    wavelength = content.wavelength_nm
    with figure_style():
        figure = new_figure(11.0, 5.0)
        axes = figure.subplots(2, 3, sharex=True, height_ratios=(2.0, 1.0))
        sd = content.relative.sd
        for number, capture in enumerate(CAPTURES):
            top, bottom = axes[0, number], axes[1, number]
            for index in range(len(content.samples)):
                colour, marker = series_style(index)
                seen = content.relative.valid[index, number]
                value = np.where(seen, content.relative.value[index, number], np.nan)
                if not np.isfinite(value).any():
                    continue
                ls = "-" if index == 0 else (0, (4, 2))
                top.plot(wavelength, value, color=colour, lw=1.2, ls=ls)
                step = max(1, wavelength.size // ERROR_BARS)
                some = slice(index % step, None, step)
                top.errorbar(
                    wavelength[some], value[some], sd[index, number][some], fmt=marker,
                    ms=3.6 if content.few else 2.4, color=colour, elinewidth=1.0, capsize=1.8, lw=0,
                )  # fmt: skip
                share = 100 * sd[index, number] / np.abs(np.where(value == 0, np.nan, value))
                bottom.plot(
                    wavelength, share, color=colour, lw=1.1, ls=ls,
                    marker=marker if content.few else "",
                )  # fmt: skip
            _finish_relative(top, bottom, content, capture)
        axes[0, 0].set_ylabel("Relative intensity [–]")
        axes[1, 0].set_ylabel("1σ [% of value]")
        sample_legend(figure, content)
        return svg_of(figure, "relative", "Relative intensities of each thickness with error bars.")


def _finish_relative(top: Axes, bottom: Axes, content: Content, capture: str) -> None:
    top.set_title(CAPTURE_TITLES[capture])
    values = [np.asarray(line.get_ydata(), dtype=np.float64) for line in top.get_lines()]
    positive = (
        np.concatenate([v[np.isfinite(v) & (v > 0)] for v in values]) if values else np.empty(0)
    )
    if capture == "collimated" and positive.size and positive.max() > 20 * positive.min():
        top.set_yscale("log")
        top.set_ylim(positive.min() / 1.6, positive.max() * 1.6)
        plain_ticks(top)
    elif positive.size:
        top.set_ylim(0, 1.08 * float(positive.max()))
    else:
        _say(top, "nothing measured")
    shares = [np.asarray(line.get_ydata(), dtype=np.float64) for line in bottom.get_lines()]
    seen = np.concatenate([v[np.isfinite(v) & (v > 0)] for v in shares]) if shares else np.empty(0)
    if seen.size and seen.max() > 12 * seen.min():
        bottom.set_yscale("log")
        plain_ticks(bottom)
    elif seen.size:
        bottom.set_ylim(0, 1.15 * float(seen.max()))
    wavelength_axis(bottom, content.wavelength_nm)


def sample_legend(figure: Figure, content: Content) -> None:
    """One legend below the figure: sample names with thicknesses."""
    from matplotlib.lines import Line2D

    handles = []
    for index, sample in enumerate(content.samples):
        colour, marker = series_style(index)
        handles.append(
            Line2D([], [], color=colour, marker=marker, ms=4, ls="-" if index == 0 else (0, (4, 2)),
                   label=literal(sample_label(sample)))
        )  # fmt: skip
    figure.legend(handles=handles, loc="outside lower center", ncols=min(4, len(handles)))


def _say(axis: Axes, text: str) -> None:
    """Words instead of an empty frame."""
    axis.text(0.5, 0.5, text, transform=axis.transAxes, ha="center", va="center", color=GREY)
