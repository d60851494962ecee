"""Figures 9 and 10 of chapter 5: matrices and reflectances beside the truth (L1-S1)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.figures.fluorescence_runs import METHODS, Run, peaks, turns
from scenarios.figures.fluorescence_statistics import COLOURS, LABELS
from scenarios.report.figure import INK, literal, new_figure, wavelength_axis
from twin.fluorescence import GRID_NM

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHOWN = 5
STYLE = {"gmm-adam": "-", "blasinski": (0, (3, 1)), "donaldson": "-"}


def shown(runs: Sequence[Run]) -> list[tuple[Run, int, str]]:
    """Run, index and title of the five materials drawn (L1-S1): three simple, two double."""
    single, double = (
        next(run for run in runs if (run.setup, run.fluorophores) == ("l1-s1", count))
        for count in (1, 2)
    )
    wanted = [(single, 0), (single, 1), (double, 0), (single, 2), (double, len(double.truth) // 4)]
    return [
        (run, k % len(run.truth), f"{'one' if run is single else 'two'}, no. {k + 1}")
        for run, k in wanted
    ]  # fmt: skip


def draw_figure9(runs: Sequence[Run]) -> tuple[Figure, dict[str, Any]]:
    """Five Donaldson matrices: truth, and the estimate of every method, on one scale each.

    Returns:
        The figure, and over all materials of L1-S1: the mean number of peaks above a tenth of the
        brightest cell, of the truth and of each method, and how often it is the truth's.
    """
    chosen = shown(runs)
    figure = new_figure(9.4, 11.4)
    axes = figure.subplots(SHOWN, 1 + len(METHODS), sharex=True, sharey=True)
    below = GRID_NM[:, None] > GRID_NM[None, :]
    half = (GRID_NM[1] - GRID_NM[0]) / 2.0
    span = (GRID_NM[0] - half, GRID_NM[-1] + half)
    for row, (run, index, title) in enumerate(chosen):
        truth = run.truth[index]
        top = float(truth[below].max())
        panels = {"truth": truth, **{m: run.matrix[m][index] for m in METHODS}}
        for panel, (name, value) in zip(axes[row], panels.items(), strict=True):
            image = panel.imshow(
                np.ma.masked_where(~below, value), origin="lower", extent=(*span, *span),
                vmin=0.0, vmax=top, cmap="viridis", interpolation="nearest",
            )  # fmt: skip
            panel.grid(False)
            if row == 0:
                panel.set_title("truth" if name == "truth" else name)
            if name != "truth":
                rmse = float(np.sqrt(((value - truth)[below] ** 2).mean()))
                number = peaks(value)
                panel.text(
                    0.97, 0.05, f"RMSE {rmse:.4f}\n{number} peak{'' if number == 1 else 's'}",
                    transform=panel.transAxes, ha="right", va="bottom", fontsize=7.5, color=INK,
                )  # fmt: skip
        bar = figure.colorbar(image, ax=axes[row, -1], shrink=0.9, pad=0.03)
        bar.set_label("Φ [–]")
        axes[row, 0].set_ylabel(f"{literal(title)}\nEmission [nm]")
    for panel in axes[-1]:
        panel.set_xlabel("Excitation [nm]")
        panel.set_xticks((400, 500, 600, 700))
    axes[0, 0].set_yticks((400, 500, 600, 700))
    return figure, {"peaks": _peaks(runs)}


def _peaks(runs: Sequence[Run]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for run in runs:
        if run.setup != "l1-s1":
            continue
        right = np.array([peaks(each) for each in run.truth])
        numbers: dict[str, Any] = {"truth": float(right.mean())}
        for method in METHODS:
            count = np.array([peaks(each) for each in run.matrix[method]])
            numbers[method] = {
                "mean": float(count.mean()), "right": float((count == right).mean()),
                "more": float((count > right).mean()),
            }  # fmt: skip
        found[f"{run.fluorophores}_fluorophore{'s' if run.fluorophores > 1 else ''}"] = numbers
    return found


def draw_figure10(runs: Sequence[Run]) -> tuple[Figure, dict[str, Any]]:
    """Reflectances (diagonals) of the same five materials beside the truth.

    Returns:
        The figure, and over all materials of L1-S1 the mean number of turns (maxima and minima
        of more than 0.02) of the truth and of each method, and the share of reflectances that our
        90 % intervals hold.
    """
    chosen = shown(runs)
    figure = new_figure(11.0, 5.8)
    axes = figure.subplots(2, 3, sharey=True)
    on = np.arange(GRID_NM.size)
    for panel, (run, index, title) in zip(axes.flat, chosen, strict=False):
        low, high = run.band[:, index][:, on, on]
        panel.fill_between(
            GRID_NM, low, high, color=COLOURS["donaldson"], alpha=0.2, lw=0, label="90 % of ours"
        )
        for method in METHODS:
            panel.plot(
                GRID_NM, run.matrix[method][index][on, on], color=COLOURS[method],
                ls=STYLE[method], label=LABELS[method],
            )  # fmt: skip
        panel.plot(GRID_NM, run.truth[index][on, on], color=INK, lw=0.9, ls=(0, (1, 1.2)),
                   label="truth")  # fmt: skip
        panel.set_title(literal(title))
        panel.set_ylim(0.0, 1.02)
        wavelength_axis(panel, GRID_NM)
    for row in axes:
        row[0].set_ylabel("Reflectance [–]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    axes[1, 2].set_axis_off()
    axes[1, 2].legend(handles, labels, loc="center left")
    bends: dict[str, list[int]] = {name: [] for name in ("truth", *METHODS)}
    inside = []
    for run in runs:
        if run.setup != "l1-s1":
            continue
        right = run.truth[:, on, on]
        bends["truth"] += [turns(each) for each in right]
        for method in METHODS:
            bends[method] += [turns(each) for each in run.matrix[method][:, on, on]]
        held = (right >= run.band[0][:, on, on]) & (right <= run.band[1][:, on, on])
        inside.append(held.mean())
    return figure, {
        "turns": {name: float(np.mean(v)) for name, v in bends.items()},
        "share_in_90_percent_interval": float(np.mean(inside)),
    }
