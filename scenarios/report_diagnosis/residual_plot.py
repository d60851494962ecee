"""Where the gap is: whitened residuals of every channel, and what leading effects make of them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from diagnosis import Channel, Diagnosis, Fit, Problem
from diagnosis.where import Block, shows
from scenarios.report.figure import (
    GREY,
    INK,
    SERIES,
    figure_style,
    literal,
    new_figure,
    svg_of,
)
from scenarios.report_diagnosis.words import SIGNIFICANT
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LOUDEST = 4.0
"""End of the colour scale [sd]."""
OUTLINED = 6
"""Blocks that are outlined at most."""
OVERLAID = 3
"""Effects in the overlay."""


def draw_residual_maps(problem: Problem, found: Diagnosis) -> str | None:
    """Residuals by channel and wavelength before and after, significant blocks outlined."""
    if found.null is None:
        return None
    fits = [("Before", found.null, found.where)]
    if found.best is not None:
        after = shows(problem, found.best)
        name = " and ".join(found.leading)
        fits.append((f"After adding {name}", found.best, after))
    rows = _order(problem)
    with figure_style():
        height = 1.3 + 0.16 * len(rows)
        figure = new_figure(11.0, max(height, 3.0))
        axes = figure.subplots(1, 2, sharey=True, squeeze=False)[0]
        image: Any = None
        for axis, (title, fit, blocks) in zip(axes, fits, strict=False):
            image = _map(axis, problem, fit, rows)
            _outline(axis, problem, rows, blocks)
            axis.set_title(literal(title))
        if len(fits) < len(axes):
            axes[1].set_axis_off()
            axes[1].text(
                0.5, 0.5, "nothing was added", ha="center", va="center", color=GREY,
                transform=axes[1].transAxes,
            )  # fmt: skip
        _label_rows(axes[0], problem, rows)
        bar = figure.colorbar(image, ax=list(axes), shrink=0.7, pad=0.01, extend="both")
        bar.set_label("Residual [sd]")
        as_vectors(bar)
        return svg_of(figure, "residual-maps", "Whitened residuals before and after.")


def as_vectors(bar: Any) -> None:
    """A colour bar without an embedded image, which the page's policy would not show."""
    bar.solids.set_rasterized(False)
    bar.solids.set_edgecolor("face")
    bar.outline.set_linewidth(0.0)


def _order(problem: Problem) -> list[int]:
    """Channels by capture, then sample, then repeat."""
    captures = list(dict.fromkeys(c.capture for c in problem.channels))
    samples = list(dict.fromkeys(c.sample for c in problem.channels))

    def key(index: int) -> tuple[int, int, int]:
        c = problem.channels[index]
        return captures.index(c.capture), samples.index(c.sample), c.repeat

    return sorted(range(len(problem.channels)), key=key)


def _map(axis: Axes, problem: Problem, fit: Fit, rows: list[int]) -> Any:
    seen = np.where(problem.valid, fit.residual.reshape(problem.value.shape), np.nan)
    edges = _edges(problem.wavelength_nm)
    mesh = axis.pcolormesh(
        edges, np.arange(len(rows) + 1), seen.T[rows], cmap="RdBu_r", vmin=-LOUDEST, vmax=LOUDEST,
        rasterized=False, linewidth=0.0,
    )  # fmt: skip
    axis.set_facecolor("#e8ebef")
    axis.set_ylim(len(rows), 0)
    axis.set_xlim(edges[0], edges[-1])
    axis.grid(False)
    axis.set_xlabel("Wavelength [nm]")
    before = None
    for place, row in enumerate(rows):
        block = _block(problem.channels[row])
        if before is not None and block != before:
            wide = block[0] != before[0]
            axis.axhline(place, color=INK if wide else "#ffffff", lw=1.0 if wide else 1.6)
        before = block
    return mesh


def _block(channel: Channel) -> tuple[str, str]:
    return channel.capture, channel.sample


def _edges(wavelength: FloatArray) -> FloatArray:
    if len(wavelength) < 2:
        return np.array([wavelength[0] - 0.5, wavelength[0] + 0.5])
    middle = 0.5 * (wavelength[1:] + wavelength[:-1])
    return np.concatenate(
        [[2 * wavelength[0] - middle[0]], middle, [2 * wavelength[-1] - middle[-1]]]
    )


def _label_rows(axis: Axes, problem: Problem, rows: list[int]) -> None:
    """One label in the middle of the repeats of every capture and sample."""
    places: dict[tuple[str, str], list[int]] = {}
    for place, row in enumerate(rows):
        places.setdefault(_block(problem.channels[row]), []).append(place)
    axis.set_yticks([float(np.mean(p)) + 0.5 for p in places.values()])
    axis.set_yticklabels([literal(f"{capture}, {sample}") for capture, sample in places])
    axis.tick_params(axis="y", length=0)


def _outline(axis: Axes, problem: Problem, rows: list[int], blocks: tuple[Block, ...]) -> None:
    """Frames around significant blocks, the most significant thickest."""
    from matplotlib.patches import Rectangle

    edges = _edges(problem.wavelength_nm)
    loud = [block for block in blocks if block.p < SIGNIFICANT][:OUTLINED]
    for number, block in enumerate(loud):
        inside = np.ones(len(problem.wavelength_nm), dtype=bool)
        if block.band_nm is not None:
            low, high = block.band_nm
            inside = (problem.wavelength_nm >= low) & (problem.wavelength_nm <= high)
        columns = np.flatnonzero(inside)
        left, right = edges[columns[0]], edges[columns[-1] + 1]
        own = [place for place, row in enumerate(rows) if holds(block, problem.channels[row])]
        for start, stop in runs(own):
            axis.add_patch(
                Rectangle(
                    (left, start + 0.08), right - left, stop - start - 0.16, fill=False,
                    edgecolor=INK, linewidth=2.0 if number == 0 else 1.0,
                    linestyle="-" if number == 0 else (0, (3, 2)), zorder=5,
                )
            )  # fmt: skip


def holds(block: Block, channel: Channel) -> bool:
    """Whether a channel belongs to a block, at its wavelengths."""
    return (
        (not block.captures or channel.capture in block.captures)
        and (not block.samples or channel.sample in block.samples)
        and (block.repeat is None or channel.repeat == block.repeat)
    )


def runs(places: list[int]) -> list[tuple[int, int]]:
    """Neighbouring places as half-open ranges."""
    runs: list[tuple[int, int]] = []
    for place in places:
        if runs and runs[-1][1] == place:
            runs[-1] = (runs[-1][0], place + 1)
        else:
            runs.append((place, place + 1))
    return runs


def draw_signatures(problem: Problem, found: Diagnosis) -> str | None:
    """Measured less predicted in per cent, and what the leading effects would make of it."""
    null = found.null
    if null is None or found.posterior is None:
        return None
    lines = _overlaid(problem, found)
    captures = list(dict.fromkeys(c.capture for c in problem.channels))
    samples = list(dict.fromkeys(c.sample for c in problem.channels))
    with figure_style():
        figure = new_figure(11.0, 1.0 + 1.75 * len(captures))
        axes = figure.subplots(len(captures), len(samples), sharex=True, squeeze=False)
        for row, capture in enumerate(captures):
            reach = 0.5
            for column, sample in enumerate(samples):
                axis = axes[row, column]
                own = [
                    i for i, c in enumerate(problem.channels) if _block(c) == (capture, sample)
                ]  # fmt: skip
                if not own:
                    axis.set_axis_off()
                    continue
                reach = max(reach, _signature_panel(axis, problem, null, own, lines))
                if row == 0:
                    axis.set_title(literal(sample))
                if column == 0:
                    axis.set_ylabel(f"{capture} [%]")
            for axis in axes[row]:
                axis.set_ylim(-reach, reach)
        for axis in axes[-1]:
            axis.set_xlabel("Wavelength [nm]")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(
            handles, labels, loc="outside lower center", ncols=2, frameon=False
        )  # fmt: skip
        return svg_of(figure, "signatures", "Signatures of the leading effects on the residual.")


def _overlaid(problem: Problem, found: Diagnosis) -> list[tuple[str, FloatArray]]:
    """Change of the prediction by the leading explanation and by other single effects.

    The material has followed; effects that were not refitted are taken as linear.
    """
    if found.null is None or found.posterior is None:
        return []
    posterior, null = found.posterior, found.null
    singles = [i for i in np.argsort(-posterior.log_weight) if len(posterior.tested[i]) == 1]
    chosen = [posterior.best] if posterior.best in posterior.fits else []
    chosen += [posterior.tested[i] for i in singles if posterior.tested[i] not in chosen]
    lines = []
    for hypothesis in chosen[:OVERLAID]:
        name = " and ".join(problem.candidates[i].name for i in hypothesis)
        if hypothesis in posterior.fits:
            change = posterior.fits[hypothesis].predicted - null.predicted
        else:
            change = _linear_change(problem, null, hypothesis)
        lines.append((name, change))
    return lines


def _linear_change(problem: Problem, null: Fit, hypothesis: tuple[int, ...]) -> FloatArray:
    own = [column for i in hypothesis for column in problem.columns[i]]
    raw = problem.signatures[own]
    columns = null.reduction(np.moveaxis(raw, 0, -1))
    value = np.linalg.lstsq(columns, null.residual, rcond=None)[0]
    lower = np.concatenate([problem.candidates[i].bounds[0] for i in hypothesis])
    upper = np.concatenate([problem.candidates[i].bounds[1] for i in hypothesis])
    change = np.tensordot(np.clip(value, lower, upper), raw, 1)
    followed = np.einsum("wmp,wp->wm", null.jacobian, null.reduction.material_step(-change))
    return np.asarray(change + followed)


def mean_residual(
    problem: Problem, predicted: FloatArray, own: list[int]
) -> tuple[FloatArray, FloatArray]:
    """Measured less predicted, mean of some channels, and its standard error, (W,) each.

    The error holds what is common to all wavelengths as well: it moves a whole curve.

    Args:
        problem: the data.
        predicted: of all channels, (W, M).
        own: indices of the channels.
    """
    valid = problem.valid[:, own]
    count = np.maximum(valid.sum(axis=1), 1)
    left = np.where(valid, problem.value[:, own] - predicted[:, own], 0.0).sum(axis=1) / count
    both = valid[:, :, None] & valid[:, None, :]
    apart = np.where(both, problem.independent[:, own][:, :, own], 0.0).sum(axis=(1, 2))
    common = np.where(valid, problem.common[:, :, own], 0.0).sum(axis=2)
    return left, np.sqrt(apart + np.sum(common**2, axis=0)) / count


def _signature_panel(
    axis: Axes, problem: Problem, null: Fit, own: list[int], lines: list[tuple[str, FloatArray]]
) -> float:
    """Draws one panel; returns the half height that shows nearly all of it [%]."""
    wavelength = problem.wavelength_nm
    scale = 100.0 / np.maximum(null.predicted[:, own].mean(axis=1), 1e-6)
    left, sd = mean_residual(problem, null.predicted, own)
    good = problem.valid[:, own].any(axis=1)
    axis.axhline(0.0, color=GREY, lw=0.8)
    axis.errorbar(
        wavelength[good], (left * scale)[good], (sd * scale)[good], fmt="o", ms=2.6, lw=0.8,
        color=INK, label="measured less predicted, without effects",
    )  # fmt: skip
    for number, (name, change) in enumerate(lines):
        axis.plot(
            wavelength, change[:, own].mean(axis=1) * scale, color=SERIES[number],
            lw=2.0 if number == 0 else 1.2, ls="-" if number == 0 else (0, (4, 2)),
            label=literal(name),
        )  # fmt: skip
    seen = (np.abs(left) + sd) * scale
    curves = [np.abs(change[:, own].mean(axis=1)) * scale for _, change in lines]
    # One dark wavelength must not flatten all the others.
    return 1.15 * max(float(np.percentile(row, 92)) for row in (seen[good], *curves))
