"""How the estimate fits: captures beside their predictions, and what is left over."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from scenarios.report.figure import BLUE, GREY, INK, figure_style, literal, new_figure, svg_of
from scenarios.report_fluorescence.matrix_plot import scale_bar

if TYPE_CHECKING:
    from estimators.fluorescence import FluorescenceResult
    from twin.fluorescence import FluorescenceData

MOST_TICKS = 16
LARGEST_SHOWN = 5.0


def draw_fit(data: FluorescenceData, result: FluorescenceResult) -> str:
    """Predicted over captured, and residuals in standard deviations, as inline SVG."""
    import matplotlib

    system = data.system
    predicted = data.value + result.residual
    good = data.valid & np.isfinite(result.residual_normalised)
    with figure_style():
        figure = new_figure(11.0, 4.2)
        left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.35))
        low = float(np.abs(data.value[good]).max()) * 1e-4
        shown = good & (data.value > low) & (predicted > low)
        left.plot(data.value[shown], predicted[shown], ls="none", marker="o", ms=3, color=BLUE)
        both = np.concatenate([data.value[shown], predicted[shown], [data.value[good].max()]])
        ends = np.array([0.7 * both.min(), 1.3 * both.max()])
        left.plot(ends, ends, color=GREY, lw=0.8, ls=(0, (1, 2)))
        left.set_xscale("log")
        left.set_yscale("log")
        left.set_xlabel("Captured [common scale of the illuminants]")
        left.set_ylabel("Predicted by the estimate [same]")
        hidden = int((good & ~shown).sum())
        note = f" ({hidden} below the axes)" if hidden else ""
        left.set_title(f"{int(good.sum())} captures{note}")
        normal = np.where(good, result.residual_normalised, np.nan)
        mesh = right.pcolormesh(
            np.arange(normal.shape[1] + 1) - 0.5, np.arange(normal.shape[0] + 1) - 0.5,
            np.ma.masked_invalid(normal), cmap=matplotlib.colormaps["RdBu_r"].resampled(64),
            vmin=-LARGEST_SHOWN, vmax=LARGEST_SHOWN, edgecolors="white", linewidth=0.3,
        )  # fmt: skip
        scale_bar(
            figure, mesh, right, "(predicted − captured) / standard deviation [–]", pad=0.02,
            extend="both",
        )  # fmt: skip
        for axis, names, which in (
            (right.xaxis, system.channel_names, "Channel of the detector"),
            (right.yaxis, system.illuminant_names, "Illuminant"),
        ):
            every = -(-len(names) // MOST_TICKS)
            at = np.arange(0, len(names), every)
            axis.set_ticks(at, [literal(names[k].replace("_", " ")) for k in at])
            axis.set_label_text(which)
        right.tick_params(axis="x", rotation=90 if len(system.channel_names) > 10 else 0)
        right.invert_yaxis()
        right.grid(False)
        masked = int((~good).sum())
        right.set_title("Residuals" + (f", {masked} masked (blank)" if masked else ""))
        if masked:
            right.set_facecolor("#e8ebef")
        right.spines[["left", "bottom"]].set_color(INK)
        return svg_of(
            figure, "fit",
            "Captures against predictions, and residuals by illuminant and channel in standard"
            " deviations.",
        )  # fmt: skip
