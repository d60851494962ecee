"""How far: the waterfall of the gap, and what becomes of the material."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from diagnosis import Closure, Fit
from scenarios.report.figure import (
    BLUE,
    GREEN,
    GREY,
    INK,
    VERMILION,
    figure_style,
    literal,
    new_figure,
    svg_of,
    wavelength_axis,
)
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from diagnosis.rounds import Rounds
    from twin.measurement import Truth

TITLES = ("Albedo", "Extinction σt [1/mm]", "Anisotropy g")

Step = tuple[Sequence[str], tuple[float, float]]
"""Effects that were added, none for what was not accepted, and the excess before and after."""


def draw_waterfall(rounds: Rounds) -> str | None:
    """Excess chi-square before, what every accepted effect takes off, and what is left."""
    steps = [
        ([each.name for each in one.accepted], one.excess)
        for one in rounds.rounds
        if one.excess is not None
    ]
    return waterfall(steps, rounds.first.diagnosis.closure)


def waterfall(steps: Sequence[Step], first: Closure | None) -> str | None:
    """The same of any steps.

    Args:
        steps: one for each round.
        first: closure of the first round: it has the floors.
    """
    if first is None or not steps:
        return None
    labels, bars = ["gap before"], [(0.0, steps[0][1][0], INK)]
    for names, excess in steps:
        labels.append("+ " + ("\n+ ".join(names) or "best of the catalogue"))
        bars.append((excess[1], excess[0], GREEN if names else GREY))
    labels.append("left")
    bars.append((0.0, steps[-1][1][1], VERMILION))
    noise = float(np.sqrt(2.0 * first.noise_floor))
    with figure_style():
        figure = new_figure(8.6, 0.9 + 0.62 * len(bars))
        axis = figure.subplots()
        axis.axvspan(
            -1.645 * noise, 1.645 * noise, color="#eef0f3", label="noise floor (90 %)", zorder=0
        )
        axis.axvline(
            first.oracle_floor, color=BLUE, ls=(0, (4, 2)), lw=1.2,
            label=f"oracle floor ({first.oracle_floor:.1f})",
        )  # fmt: skip
        axis.axvline(0.0, color=INK, lw=0.8)
        span = max(abs(value) for low, high, _ in bars for value in (low, high))
        for place, (low, high, colour) in enumerate(bars):
            axis.barh(place, high - low, 0.6, low, color=colour)
            ends = place in (0, len(bars) - 1)
            text = (f"{high:.1f}" if ends else f"{low - high:+.1f}").replace("-", "−")
            axis.text(
                max(high, low, 1.645 * noise) + 0.015 * span, place, text, va="center",
                fontsize=8.5,
            )  # fmt: skip
        axis.set_yticks(range(len(labels)))
        axis.set_yticklabels([literal(label) for label in labels])
        axis.tick_params(axis="y", length=0)
        axis.invert_yaxis()
        axis.grid(axis="y", visible=False)
        room = 1.12 * max(span, 1.645 * noise)
        axis.set_xlim(min(-1.75 * noise, 1.05 * min(low for low, _, _ in bars)), room)
        axis.set_xlabel("Excess chi-square, on data that did not choose the effect")
        figure.legend(loc="outside lower right", ncols=2)
        return svg_of(figure, "closure", "How the gap closes.")


def draw_material(
    null: Fit, best: Fit, spectra: tuple[FloatArray, FloatArray], wavelength: FloatArray,
    sd: FloatArray, truth: Truth | None,
) -> str:  # fmt: skip
    """Albedo, sigma_t and g before and after, and the shift in standard errors below.

    Args:
        null: fit before.
        best: fit after.
        spectra: albedo, sigma_t [1/mm] and g of both, (W, 3) each.
        wavelength: [nm], (W,).
        sd: standard error of the coordinates before, (W, 3).
        truth: of a simulated visit.
    """
    pull = (best.material - null.material) / sd
    with figure_style():
        figure = new_figure(11.0, 4.3)
        axes = figure.subplots(2, 3, sharex=True, height_ratios=(1.8, 1.0))
        for column, title in enumerate(TITLES):
            top, bottom = axes[0, column], axes[1, column]
            if truth is not None:
                known = (truth.albedo, truth.sigma_t_per_mm, truth.g)[column][0]
                top.plot(
                    truth.wavelength_nm, known, color="#f0c987", lw=5.0, alpha=0.8, label="truth",
                    solid_capstyle="round",
                )  # fmt: skip
            top.plot(wavelength, spectra[0][:, column], color=GREY, ls=(0, (4, 2)), label="before")
            top.plot(wavelength, spectra[1][:, column], color=BLUE, label="after")
            seen = np.concatenate([spectra[0][:, column], spectra[1][:, column]])
            low, high = np.percentile(seen, [2, 98])
            room = 0.35 * (high - low) + 0.01 * abs(high)
            top.set_ylim(low - room, high + room)
            top.set_title(title)
            bottom.axhspan(-2, 2, color="#eef0f3", zorder=0)
            bottom.axhline(0.0, color=INK, lw=0.8)
            bottom.plot(wavelength, pull[:, column], color=VERMILION, marker="o", ms=2.6, lw=1.0)
            most = max(2.6, 1.1 * float(np.nanmax(np.abs(pull[:, column]))))
            bottom.set_ylim(-most, most)
            wavelength_axis(bottom, wavelength)
        axes[0, 0].legend(loc="best")
        axes[1, 0].set_ylabel("Shift [sd]")
        return svg_of(figure, "material", "Shift of the material's parameters.")
