"""Curves of a fluorescence estimate: diagonal, yield, reflected spectra, colour difference."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from scenarios.report.figure import (
    BLUE,
    INK,
    ORANGE,
    VERMILION,
    figure_style,
    new_figure,
    svg_of,
    wavelength_axis,
)
from scenarios.report_fluorescence.colour import Appearance
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from estimators.fluorescence import FluorescenceResult

TRUTH = {"color": INK, "lw": 1.1, "ls": (0, (4, 2)), "label": "truth"}
_BAND = 0.22


def draw_diagonal(result: FluorescenceResult, truth: FloatArray | None) -> str:
    """Reflectance and total fluorescence per excitation with 90 % bands, as inline SVG."""
    on = result.is_diagonal
    where = result.emission_nm[np.nonzero(on)[0]]
    below = result.is_fluorescence
    with figure_style():
        figure = new_figure(11.0, 3.9)
        left, right = figure.subplots(1, 2)
        low, high = result.reflectance_band
        if np.isfinite(low).all():
            left.fill_between(where, low, high, color=BLUE, alpha=_BAND, lw=0, label="90 % band")
        left.plot(where, result.reflectance, color=BLUE, marker="o", ms=3, label="estimate")
        if truth is not None:
            left.plot(where, truth[on], **TRUTH)
        left.set_title("Reflectance (the diagonal)")
        left.set_ylabel("Reflectance [–]")
        left.set_ylim(0.0, max(1.0, 1.05 * float(result.reflectance.max())))
        wavelength_axis(left, where)
        left.legend(loc="lower right")
        total = np.where(below, result.matrix, 0.0).sum(axis=0)
        if result.draws is not None:
            sums = np.where(below, result.draws, 0.0).sum(axis=1)
            low, high = np.quantile(sums, [0.05, 0.95], axis=0)
            right.fill_between(
                result.excitation_nm, low, high, color=VERMILION, alpha=_BAND, lw=0,
                label="90 % band",
            )  # fmt: skip
        right.plot(result.excitation_nm, total, color=VERMILION, marker="o", ms=3, label="estimate")
        if truth is not None:
            right.plot(result.excitation_nm, np.where(below, truth, 0.0).sum(axis=0), **TRUTH)
        blind = result.undetermined.any(axis=0)
        if blind.any():
            right.plot(
                result.excitation_nm[blind], total[blind], ls="none", marker="x", ms=7,
                color=INK, label="with undetermined cells",
            )  # fmt: skip
        right.set_title("Fluorescence by excitation (column sums)")
        right.set_ylabel("Emitted energy / incident energy [–]")
        right.set_ylim(bottom=0.0)
        wavelength_axis(right, result.excitation_nm)
        right.set_xlabel("Excitation wavelength [nm]")
        right.legend(loc="upper right")
        return svg_of(
            figure, "diagonal",
            "Reflectance over wavelength, and emitted energy per excitation wavelength, each with"
            " its 90 % band and the truth where it is known.",
        )  # fmt: skip


def draw_reflected(
    looks: Sequence[Appearance], emission_nm: FloatArray, excitation_nm: FloatArray
) -> str:
    """Spectra that the sample sends back under every light, with 90 % bands, as inline SVG."""
    columns = 4
    rows = -(-len(looks) // columns)
    with figure_style():
        figure = new_figure(11.0, 2.75 * rows)
        axes = figure.subplots(rows, columns, squeeze=False)
        for spare in axes.flat[len(looks) :]:
            spare.set_visible(False)
        for number, (panel, look) in enumerate(zip(axes.flat, looks, strict=False)):
            if look.band is not None:
                panel.fill_between(
                    emission_nm, look.band[0], look.band[1], color=BLUE, alpha=_BAND, lw=0,
                    label="90 % band",
                )  # fmt: skip
            panel.plot(emission_nm, look.spectrum, color=BLUE, label="estimate")
            if look.truth_spectrum is not None:
                panel.plot(emission_nm, look.truth_spectrum, **TRUTH)
            narrow = look.light.wavelength_nm
            panel.set_title(f"under {look.light.name}")
            if narrow is None:
                panel.plot(
                    excitation_nm, look.light.energy, color=ORANGE, lw=0.8, label="the light"
                )
                panel.set_ylim(bottom=0.0)
            else:
                panel.set_yscale("log")
                panel.set_ylim(1e-5, 1.5)
            wavelength_axis(panel, emission_nm)
            if number % columns == 0:
                panel.set_ylabel("Energy per bin [–]")
        handles, labels = axes.flat[0].get_legend_handles_labels()
        where = axes.flat[len(looks)] if len(looks) < axes.size else axes.flat[0]
        if len(looks) < axes.size:
            where.set_visible(True)
            where.set_axis_off()
            where.legend(handles, labels, loc="center left")
        else:
            where.legend(handles, labels)
        return svg_of(
            figure, "reflected",
            "Reflected and emitted spectra under D65, A, FL4 and light of one wavelength.",
        )  # fmt: skip


def draw_differences(result: FluorescenceResult, truth: FloatArray | None) -> str | None:
    """CIEDE2000 over the wavelength of monochromatic light, as inline SVG; None without any."""
    from estimators.fluorescence.colour import monochromatic_difference

    if truth is None and result.draws is None:
        return None
    wavelength = result.excitation_nm
    with figure_style():
        figure = new_figure(11.0, 3.3)
        axes = figure.subplots()
        if result.draws is not None:
            spread = monochromatic_difference(result.draws, result.matrix, result.emission_nm)
            middle, high = np.quantile(spread, [0.5, 0.9], axis=0)
            axes.fill_between(
                wavelength, 0.0, high, color=BLUE, alpha=_BAND, lw=0,
                label="draws from the estimate: 90 % are below",
            )  # fmt: skip
            axes.plot(wavelength, middle, color=BLUE, lw=1.0, label="draws: median")
        if truth is not None:
            found = monochromatic_difference(result.matrix, truth, result.emission_nm)
            axes.plot(
                wavelength, found, color=VERMILION, marker="o", ms=3,
                label=f"estimate from truth (median {np.median(found):.2f})",
            )  # fmt: skip
        axes.axhline(1.0, color=INK, lw=0.7, ls=(0, (1, 2)))
        axes.annotate(
            "just noticeable", (float(wavelength[-1]), 1.0), (0, 12), textcoords="offset points",
            ha="right", va="bottom", fontsize=8.5,
        )  # fmt: skip
        axes.set_ylim(0.0, max(1.5, axes.get_ylim()[1]))
        axes.set_ylabel("CIEDE2000 [–]")
        wavelength_axis(axes, wavelength)
        axes.set_xlabel("Wavelength of the light [nm]")
        axes.legend(loc="upper right")
        return svg_of(
            figure, "differences",
            "Colour difference under light of one wavelength, over that wavelength.",
        )  # fmt: skip
