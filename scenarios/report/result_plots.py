"""What came out: optical properties, residuals, the check with Beer's law."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.report.content import CAPTURE_TITLES, CAPTURES, Content, Verdict, sample_label
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
from scenarios.report.plots import sample_legend

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from twin.spectra import FloatArray

NINES = (0.0, 0.5, 0.8, 0.9, 0.95, 0.98, 0.99, 0.995, 0.998, 0.999, 0.9995, 0.9998, 0.9999, 0.99998)
MOST_NINES = 5.0
"""The albedo axis ends at 1 - 1e-5."""
LARGEST_RESIDUAL = 12.0
"""The residual axis ends here [sd]; what lies beyond is drawn as an arrow at the edge."""
_TITLES = ("Single-scattering albedo", "Extinction coefficient", "Anisotropy factor g")
_UNITS = ("Albedo [–], axis by nines", "σt [1/mm]", "g [–]")
_ERROR_UNITS = ("1 − albedo: error [%]", "σt: error [%]", "g: error [–]")
_SD_UNITS = ("1 − albedo: 1σ [%]", "σt: 1σ [%]", "g: 1σ [–]")


def nines(albedo: FloatArray) -> FloatArray:
    """-log10(1 - albedo), the albedo axis: 0.9 is 1, 0.99 is 2; ends at MOST_NINES."""
    return np.asarray(-np.log10(np.maximum(1.0 - np.asarray(albedo), 10.0**-MOST_NINES)))


def draw_properties(content: Content) -> str:
    """Albedo, sigma_t and g with bands, each thickness dashed, the combination solid."""
    with figure_style():
        figure = new_figure(11.0, 8.6)
        axes = figure.subplots(3, 2, sharex=True, width_ratios=(1.75, 1.0))
        for row in range(3):
            _values(axes[row, 0], content, row)
            _deviation(axes[row, 1], content, row)
            axes[row, 0].set_title(_TITLES[row])
        axes[0, 1].set_title("Estimate minus truth" if content.truth else "Uncertainty")
        for axis in axes[2]:
            wavelength_axis(axis, content.wavelength_nm)
        _property_legend(figure, content)
        return svg_of(
            figure, "properties", "Estimated albedo, extinction and g with their uncertainty."
        )


def _values(axis: Axes, content: Content, row: int) -> None:
    wavelength, estimate = content.wavelength_nm, content.estimate
    convert = nines if row == 0 else np.asarray
    lines: list[FloatArray] = []
    if content.truth is not None:
        true = convert(content.truth.value[row])
        axis.plot(wavelength, true, color=ORANGE, lw=5, alpha=0.55, solid_capstyle="butt")
        lines.append(true)
    if estimate.low is not None and estimate.high is not None:
        axis.fill_between(
            wavelength, convert(estimate.low[row]), convert(estimate.high[row]), color=BLUE,
            alpha=0.13, lw=0,
        )  # fmt: skip
    if estimate.sd is not None:
        low = convert(estimate.value[row] - estimate.sd[row])
        high = convert(estimate.value[row] + estimate.sd[row])
        axis.fill_between(wavelength, low, high, color=BLUE, alpha=0.28, lw=0)
    for index, alone in enumerate(content.each):
        colour, marker = series_style(index + 1)
        axis.plot(
            wavelength, convert(alone.value[row]), color=colour, lw=1.0, ls=(0, (4, 2)),
            marker=marker if content.few else "", ms=3,
        )  # fmt: skip
    value = convert(estimate.value[row])
    axis.plot(wavelength, value, color=BLUE, lw=0.8, alpha=0.5)
    known = np.where(content.identifiable[row], value, np.nan)
    axis.plot(wavelength, known, color=BLUE, lw=1.8, marker="o" if content.few else "", ms=4)
    lines.append(value)
    _unusable_bands(axis, content)
    axis.set_ylabel(_UNITS[row])
    _scale(axis, lines, row)


def _scale(axis: Axes, lines: list[FloatArray], row: int) -> None:
    """Limits from combination and truth; bands and single thicknesses may be wild."""
    values = np.concatenate([line[np.isfinite(line)] for line in lines])
    if values.size == 0:
        axis.text(0.5, 0.5, "not estimated", transform=axis.transAxes, ha="center", color=GREY)
        return
    low, high = np.quantile(values, (0.005, 0.995))
    if row == 1 and low > 0 and high > 12 * low:
        axis.set_yscale("log")
        axis.set_ylim(low / 1.5, high * 1.5)
        plain_ticks(axis)
        return
    room = max(0.18 * (high - low), (0.15, 0.05 * abs(high), 0.04)[row])
    axis.set_ylim(max(0.0, low - room) if row < 2 else max(-1.0, low - room), high + room)
    if row == 0:
        bottom, top = axis.get_ylim()
        shown = [albedo for albedo in NINES if bottom <= nines(np.array(albedo)) <= top]
        if len(shown) >= 2:
            axis.set_yticks([float(nines(np.array(a))) for a in shown], [f"{a:g}" for a in shown])
        else:
            from matplotlib.ticker import FuncFormatter

            axis.yaxis.set_major_formatter(FuncFormatter(lambda y, _at: f"{1 - 10**-y:.4g}"))


def _deviation(axis: Axes, content: Content, row: int) -> None:
    """Estimate minus truth with its bands; without a truth the standard deviation alone."""
    wavelength, estimate = content.wavelength_nm, content.estimate
    base = (1 - estimate.value[0], estimate.value[1], np.full(wavelength.shape, 0.01))[row]
    unit = 100 / np.where(np.abs(base) > 0, np.abs(base), np.nan)
    if content.truth is None:
        axis.set_ylabel(_SD_UNITS[row])
        if estimate.sd is not None and np.isfinite(estimate.sd[row]).any():
            axis.plot(
                wavelength, estimate.sd[row] * (unit if row < 2 else 1.0), color=BLUE,
                marker="o" if content.few else "", ms=4,
            )  # fmt: skip
            axis.set_ylim(bottom=0)
        return
    truth = content.truth.value[row]
    base = (1 - truth, truth, np.ones_like(truth))[row]
    unit = (100.0 if row < 2 else 1.0) / np.where(np.abs(base) > 1e-9, np.abs(base), np.nan)
    sign = -1.0 if row == 0 else 1.0
    error = sign * (estimate.value[row] - truth) * unit
    axis.axhline(0, color=ORANGE, lw=3, alpha=0.6)
    if estimate.low is not None and estimate.high is not None:
        low, high = (sign * (end[row] - truth) * unit for end in (estimate.low, estimate.high))
        axis.fill_between(wavelength, low, high, color=BLUE, alpha=0.13, lw=0)
    if estimate.sd is not None:
        sd = estimate.sd[row] * unit
        axis.fill_between(wavelength, error - sd, error + sd, color=BLUE, alpha=0.28, lw=0)
    axis.plot(wavelength, error, color=BLUE, lw=1.2, marker="o" if content.few else "", ms=4)
    _unusable_bands(axis, content)
    axis.set_ylabel(_ERROR_UNITS[row])
    finite = np.abs(error[np.isfinite(error)])
    if finite.size:
        reach = 1.6 * float(np.quantile(finite, 0.97)) + 1e-9
        axis.set_ylim(-reach, reach)


def _unusable_bands(axis: Axes, content: Content) -> None:
    """Grey stripes where a wavelength is masked, vermilion where it lies outside the map."""
    wavelength = content.wavelength_nm
    edges = np.concatenate(
        [[wavelength[0]], (wavelength[1:] + wavelength[:-1]) / 2, [wavelength[-1]]]
    )
    for verdict, colour in ((Verdict.MASKED, GREY), (Verdict.OUTSIDE, VERMILION)):
        flags = np.concatenate([[False], content.where(verdict), [False]]).astype(int)
        change = np.diff(flags)
        for start, stop in zip(np.flatnonzero(change > 0), np.flatnonzero(change < 0), strict=True):
            axis.axvspan(edges[start], edges[stop], color=colour, alpha=0.14, lw=0)


def _property_legend(figure: Any, content: Content) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [Line2D([], [], color=BLUE, lw=1.8, label="all thicknesses combined")]
    if content.estimate.sd is not None:
        handles.append(Patch(color=BLUE, alpha=0.35, label="± 1σ"))
    if content.estimate.low is not None:
        handles.append(Patch(color=BLUE, alpha=0.13, label="90 % interval"))
    for index, sample in enumerate(content.samples[: len(content.each)]):
        handles.append(
            Line2D([], [], color=series_style(index + 1)[0], lw=1.0, ls=(0, (4, 2)),
                   label=literal(f"{sample_label(sample)}, alone"))
        )  # fmt: skip
    if content.truth is not None:
        handles.append(Line2D([], [], color=ORANGE, lw=5, alpha=0.55, label="truth"))
    for verdict, colour in ((Verdict.MASKED, GREY), (Verdict.OUTSIDE, VERMILION)):
        if content.where(verdict).any():
            handles.append(Patch(color=colour, alpha=0.2, label=verdict.value))
    figure.legend(handles=handles, loc="outside lower center", ncols=4)


def draw_residuals(content: Content) -> str | None:
    """Whitened residuals by capture and thickness, or None when there are none."""
    if content.residual is None or not np.isfinite(content.residual).any():
        return None
    wavelength = content.wavelength_nm
    with figure_style():
        figure = new_figure(11.0, 2.9)
        axes = figure.subplots(1, 3, sharey=True)
        reach = min(LARGEST_RESIDUAL, max(3.5, 1.15 * float(np.nanmax(np.abs(content.residual)))))
        for number, capture in enumerate(CAPTURES):
            axis = axes[number]
            axis.axhspan(-2, 2, color=BLUE, alpha=0.06, lw=0)
            axis.axhline(0, color=GREY, lw=0.8)
            for index in range(len(content.samples)):
                colour, marker = series_style(index)
                values = content.residual[index, number]
                beyond = np.abs(values) > reach
                axis.plot(
                    wavelength, np.where(beyond, np.nan, values), marker=marker, ls="",
                    color=colour, ms=5 if content.few else 2.6, alpha=0.8, mew=0,
                )  # fmt: skip
                for sign, arrow in ((1, "^"), (-1, "v")):
                    out = beyond & (np.sign(values) == sign)
                    axis.plot(
                        wavelength[out], np.full(int(out.sum()), 0.95 * sign * reach), arrow,
                        color=colour, ms=5,
                    )  # fmt: skip
            axis.set_title(CAPTURE_TITLES[capture])
            wavelength_axis(axis, content.wavelength_nm)
        axes[0].set_ylim(-reach, reach)
        axes[0].set_ylabel("Residual [σ]")
        sample_legend(figure, content)
        return svg_of(figure, "residuals", "Whitened residuals by capture and thickness.")


def draw_beer(content: Content) -> str | None:
    """sigma_t from Beer's law beside the estimate and their ratio, or None when there is none."""
    if content.beer_per_mm is None or not np.isfinite(content.beer_per_mm).any():
        return None
    wavelength, sigma = content.wavelength_nm, content.estimate.value[1]
    with figure_style():
        figure = new_figure(11.0, 3.3)
        left, right = figure.subplots(1, 2, width_ratios=(1.5, 1.0))
        left.plot(wavelength, sigma, color=BLUE, lw=1.8, label="estimate")
        shown = [sigma]
        many = content.beer_per_mm.shape[0] > 1
        for index, beer in enumerate(content.beer_per_mm):
            colour, marker = series_style(index + 1)
            name = (
                f"Beer's law, {content.samples[index].thickness_mm:g} mm" if many else "Beer's law"
            )
            style = {"marker": marker, "ms": 3.5} if content.few else {}
            left.plot(wavelength, beer, color=colour, ls=(0, (4, 2)), lw=1.2, label=name, **style)
            right.plot(wavelength, beer / sigma, color=colour, ls=(0, (4, 2)), lw=1.2, **style)
            shown.append(beer)
        values = np.concatenate([v[np.isfinite(v) & (v > 0)] for v in shown])
        if values.size and values.max() > 12 * values.min():
            left.set_yscale("log")
            plain_ticks(left)
        right.axhline(1, color=INK, lw=0.8)
        left.set_title("Extinction coefficient, two ways")
        right.set_title("Beer's law / estimate")
        left.set_ylabel("σt [1/mm]")
        right.set_ylabel("Ratio [–]")
        left.legend(loc="best")
        for axis in (left, right):
            wavelength_axis(axis, content.wavelength_nm)
        return svg_of(figure, "beer", "Extinction from Beer's law beside the estimate.")
