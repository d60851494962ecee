"""The stack of sample and covers, drawn to scale: spot above, background or beam below."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from scenarios.report.figure import BLUE, GREY, INK, PALE, VERMILION, literal
from twin.bench import Bench

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_GLASS, _SAMPLE = "#cfe6f5", "#f0c9a4"


def draw_stack(axes: Axes, bench: Bench, thickness: Sequence[float], *, beam: bool) -> None:
    """The stack to scale, cut off at the sides, with the spot and what is below it."""
    from matplotlib.patches import Rectangle

    spot = bench.detector.spot_beam_mm if beam else bench.detector.spot_panels_mm
    layers = [
        *((layer.thickness_mm, "cover", layer.n) for layer in bench.covers_above),
        (thickness[0], "sample", None),
        *((layer.thickness_mm, "cover", layer.n) for layer in bench.covers_below),
    ]
    height = sum(layer[0] for layer in layers)
    gap = bench.background.gap_mm
    widest = max(bench.detector.spot_beam_mm, bench.detector.spot_panels_mm, bench.beam.diameter_mm)
    half = max(0.62 * widest, 1.1 * (height + gap))
    slab = max(0.16 * half, 0.1)
    labels: list[tuple[float, str]] = []
    z = 0.0
    for extent, kind, n in layers:
        colour = _SAMPLE if kind == "sample" else _GLASS
        axes.add_patch(
            Rectangle(
                (-half, z - extent), 2 * half, extent, facecolor=colour, edgecolor=INK, lw=0.6
            )
        )
        if kind == "sample":
            others = ", ".join(f"{t:g}" for t in thickness[1:5])
            text = f"sample {extent:g} mm" + (f" (also {others})" if others else "")
        else:
            text = f"cover {extent:g} mm" + (
                f", n {n:g}" if isinstance(n, float) else f", {n}"[:22]
            )
        labels.append((z - extent / 2, literal(text)))
        z -= extent
    if beam:
        _beam_below(axes, bench, z, gap + slab)
        labels.append((z - gap - slab / 2, "no background"))
    else:
        labels.append((z - gap / 2, f"air gap {gap:g} mm"))
        _background_below(axes, bench, half, z - gap, slab)
        sizes = " / ".join(
            f"{kind} {'⌀ ' if part.shape == 'disc' else ''}{part.size_mm[0]:g}"
            for kind, part in (("white", bench.background.white), ("black", bench.background.black))
        )
        labels.append((z - gap - slab / 2, f"background:\n{sizes} mm"))
    rise = 0.55 * half
    _spot_above(axes, spot, rise)
    _stacked_labels(axes, labels, half, low=z - gap - slab, line=0.155 * half)
    axes.set_xlim(-half, half * 1.85)
    axes.set_ylim(z - gap - slab * 1.5, rise * 1.12)
    ruler(axes, "x [mm]", "z [mm]")
    axes.set_xticks([tick for tick in axes.get_xticks() if abs(tick) <= half])
    axes.set_title("Close up, beam lit" if beam else "Close up, panels lit")


def _spot_above(axes: Axes, spot: float, rise: float) -> None:
    """The measured spot on top of the stack and the light that leaves it."""
    axes.plot([-spot / 2, spot / 2], [0, 0], color=BLUE, lw=4, solid_capstyle="butt")
    for x in np.linspace(-spot / 2, spot / 2, 5):
        axes.annotate(
            "", (x, 0.6 * rise), (x, 0.04 * rise),
            arrowprops={"arrowstyle": "-|>", "color": BLUE, "lw": 0.8, "mutation_scale": 7},
        )  # fmt: skip
    axes.annotate(
        f"measured spot ⌀ {spot:g} mm", (0, 0.68 * rise), ha="center", va="bottom", color=BLUE
    )


def _beam_below(axes: Axes, bench: Bench, z: float, depth: float) -> None:
    """The collimated beam that reaches the stack from below."""
    from matplotlib.patches import Rectangle

    width = bench.beam.diameter_mm
    axes.add_patch(
        Rectangle((-width / 2, z - depth), width, depth, color=VERMILION, alpha=0.3, lw=0)
    )
    for x in np.linspace(-width / 3, width / 3, 3):
        axes.annotate(
            "", (x, z), (x, z - depth),
            arrowprops={"arrowstyle": "-|>", "color": VERMILION, "lw": 0.8, "mutation_scale": 7},
        )  # fmt: skip
    divergence = bench.beam.divergence_deg
    text = f"beam ⌀ {width:g} mm" + (f", ±{divergence:g}°" if divergence else "")
    axes.annotate(
        text, (-width / 2, z - depth / 2), (-6, 0), textcoords="offset points", ha="right",
        va="center", color=VERMILION,
    )  # fmt: skip


def _background_below(axes: Axes, bench: Bench, half: float, z: float, slab: float) -> None:
    """White on the left and black on the right half: either one lies there, not both."""
    from matplotlib.patches import Rectangle

    for part, colour, side in (
        (bench.background.white, "white", -1),
        (bench.background.black, "#30363d", 1),
    ):
        width = min(half, part.size_mm[0] / 2)
        axes.add_patch(
            Rectangle(
                (min(0.0, side * width), z - slab), width, slab, facecolor=colour, edgecolor=INK,
                lw=0.8,
            )
        )  # fmt: skip
        axes.text(
            side * width / 2, z - slab / 2, "white or" if side < 0 else "black", ha="center",
            va="center", color=INK if side < 0 else "white", fontsize=8,
        )  # fmt: skip


def _stacked_labels(
    axes: Axes, labels: Sequence[tuple[float, str]], half: float, *, low: float, line: float
) -> None:
    """Labels on the right with leaders, moved apart so that thin layers stay readable."""
    spacing = [line * (1 + text.count("\n")) for _z, text in labels]
    place = [z for z, _text in labels]
    for index in range(1, len(place)):
        need = (spacing[index - 1] + spacing[index]) / 2
        place[index] = min(place[index], place[index - 1] - need)
    shift = max(0.0, (low + 0.5 * line) - place[-1])
    place = [z + shift * (1 if shift else 0) for z in place]
    for (z, text), at in zip(labels, place, strict=True):
        axes.plot([half, half * 1.06, half * 1.11], [z, at, at], color=GREY, lw=0.7, clip_on=False)
        axes.text(half * 1.13, at, text, va="center", fontsize=8.5)


def ruler(axes: Axes, x_label: str, y_label: str) -> None:
    """Equal scales on both axes, with quiet tick marks."""
    axes.set_aspect("equal")
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    axes.grid(False)
    axes.set_facecolor("none")
    for spine in axes.spines.values():
        spine.set_color(PALE)
