"""The set-up: a sketch of the 45/0 bench, the light of every illuminant, the channels' sight."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from scenarios.report.figure import (
    BLUE,
    GREY,
    INK,
    ORANGE,
    figure_style,
    literal,
    new_figure,
    svg_of,
    wavelength_axis,
)
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from twin.fluorescence import FluorescenceData, FluorescenceSetup

BROAD_NM = 100.0
"""Light that is above a quarter of its maximum over more than this [nm] is drawn grey."""
MOST_NAMED = 12
"""With more curves than this names would cover the picture."""


def draw_setup(setup: FluorescenceSetup, data: FluorescenceData) -> str:
    """Sketch, calibrated illuminants and sensitivities as inline SVG."""
    system = data.system
    with figure_style():
        figure = new_figure(11.0, 3.7)
        sketch, lights, channels = figure.subplots(1, 3, width_ratios=(0.85, 1.1, 1.1))
        _sketch(sketch, setup)
        _curves(lights, system.illuminants, system.excitation_nm, system.illuminant_names)
        lights.set_title("Illuminants, as calibrated")
        lights.set_ylabel("Energy per bin, brightest 1 [–]")
        _curves(channels, system.sensitivities, system.emission_nm, system.channel_names)
        channels.set_title("Channels of the detector")
        channels.set_ylabel("Signal per energy, largest 1 [–]")
        return svg_of(
            figure, "setup",
            "The bench from the side: light at 45 degrees, detector straight above; spectra of"
            " the illuminants and sensitivities of the channels.",
        )  # fmt: skip


def _sketch(axes: Axes, setup: FluorescenceSetup) -> None:
    axes.set_title("The bench (45/0, not to scale)")
    axes.set_axis_off()
    axes.set_aspect("equal")
    axes.set_xlim(-1.3, 1.2)
    axes.set_ylim(-0.45, 1.55)
    axes.fill_between([-0.75, 0.75], -0.12, 0.0, color="#d9dee5", lw=0)
    axes.text(0.0, -0.17, "sample, or the white", ha="center", va="top", fontsize=8.5)
    axes.annotate(
        "", (0.0, 0.02), (-0.82, 0.84), arrowprops={"arrowstyle": "-|>", "color": ORANGE, "lw": 2}
    )
    axes.text(
        -0.8, 0.93, f"{len(setup.lights)} illuminants,\none at a time", ha="center", va="bottom",
        fontsize=8.5,
    )  # fmt: skip
    axes.annotate(
        "", (0.0, 1.0), (0.0, 0.02), arrowprops={"arrowstyle": "-|>", "color": BLUE, "lw": 2}
    )
    axes.text(
        0.0, 1.07, f"{setup.detector.kind},\n{len(setup.channel_names)} channels", ha="center",
        va="bottom", fontsize=8.5,
    )  # fmt: skip
    turn = np.linspace(np.pi / 2, 3 * np.pi / 4, 20)
    axes.plot(0.3 * np.cos(turn), 0.3 * np.sin(turn), color=GREY, lw=0.8)
    axes.text(-0.16, 0.36, "45°", ha="center", va="bottom", fontsize=8.5, color=GREY)


def _curves(
    axes: Axes, rows: FloatArray, wavelength_nm: FloatArray, names: tuple[str, ...]
) -> None:
    import matplotlib

    spectrum = matplotlib.colormaps["turbo"]
    span, step = float(np.ptp(wavelength_nm)), float(wavelength_nm[1] - wavelength_nm[0])
    used: list[tuple[float, float]] = []
    top = float(rows.max())
    many = len(rows) > MOST_NAMED
    for row, name in zip(rows / top, names, strict=True):
        # A floor of stray light is not where a channel sees.
        upper = row > 0.25 * row.max()
        centre = float(np.average(wavelength_nm[upper], weights=row[upper]))
        broad = step * int(upper.sum()) > BROAD_NM
        # Where narrow light lies decides its colour: what is blue is drawn blue.
        colour = spectrum(0.05 + 0.9 * (centre - float(wavelength_nm[0])) / span)
        axes.plot(
            wavelength_nm, row, color=GREY if broad else colour, lw=0.8 if many else 1.3,
            ls=(0, (5, 1.5)) if broad and not many else "-",
        )  # fmt: skip
        if not many:
            # A white LED is named on its phosphor's hill, away from the blue of the others.
            peak = int(np.where(wavelength_nm > 500.0, row, 0.0).argmax() if broad
                       else row.argmax())  # fmt: skip
            x, y = float(wavelength_nm[peak]), float(row[peak]) + 0.015
            while any(abs(x - a) < 0.2 * span and abs(y - b) < 0.055 for a, b in used):
                y += 0.055
            used.append((x, y))
            axes.text(
                x, y, literal(name.replace("_", " ")), color=INK, fontsize=7, ha="center",
                va="bottom",
            )  # fmt: skip
    axes.set_ylim(-0.02, max(1.12, *(y + 0.07 for _, y in used)) if used else 1.08)
    axes.set_yticks(np.arange(0.0, 1.01, 0.2))
    wavelength_axis(axes, wavelength_nm)
