"""Matplotlib figures as inline SVG: one style, no global state left, the same bytes again."""

from __future__ import annotations

import io
import re
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from twin.spectra import FloatArray

# Okabe and Ito 2008, "Color Universal Design": told apart with any common colour vision.
BLUE, ORANGE, GREEN, VERMILION = "#0072B2", "#E69F00", "#009E73", "#D55E00"
SKY, PURPLE, INK, GREY, PALE = "#56B4E9", "#B0568C", "#1c2430", "#6b7480", "#d9dee5"

SERIES = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)
"""Colours of samples (thicknesses), in order; beyond six they repeat with another marker."""
MARKERS = ("o", "s", "^", "D", "v", "P")

_STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "benchtwin report",
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titlepad": 8.0,
    "axes.labelsize": 9.0,
    "axes.labelcolor": INK,
    "axes.edgecolor": "#9aa3ae",
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.unicode_minus": True,
    "axes.xmargin": 0.01,
    "grid.color": "#e8ebef",
    "grid.linewidth": 0.7,
    "xtick.color": GREY,
    "ytick.color": GREY,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "lines.linewidth": 1.5,
    "text.color": INK,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
    "savefig.facecolor": "none",
    "path.simplify": True,
}

_LOCK = threading.RLock()


@contextmanager
def figure_style() -> Iterator[None]:
    """Use the report's style inside the block, whatever matplotlibrc says, and restore it after."""
    import matplotlib

    with _LOCK, matplotlib.rc_context(), warnings.catch_warnings():
        # Text stays text in the page: the reader's fonts draw it, whatever ours lacks.
        warnings.filterwarnings("ignore", message=r"Glyph .* missing from", category=UserWarning)
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_STYLE)
        yield


def new_figure(width_in: float, height_in: float) -> Figure:
    """An empty figure of the given size [inch] that belongs to no window."""
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    FigureCanvasSVG(figure)
    return figure


def svg_of(figure: Figure, name: str, description: str) -> str:
    """The figure as an inline `<svg>` element.

    Args:
        figure: what to draw.
        name: prefix of every id, so that several figures can live in one page.
        description: what a screen reader says.

    Returns:
        The element, without prolog, metadata or namespace addresses, sized by its viewBox.
    """
    import numpy as np
    from markupsafe import escape

    buffer = io.StringIO()
    # Ids are made from printed numbers, and importing colour-science changes how numpy prints.
    with np.printoptions(legacy=False):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    view_box = re.search(r'viewBox="([^"]+)"', text)
    body = re.sub(r"<!--.*?-->\n?", "", text[text.index(">") + 1 :], flags=re.DOTALL)

    def own_ids(tag: re.Match[str]) -> str:
        inside = re.sub(r'\bid="', f'id="{name}-', tag.group())
        inside = re.sub(r'href="#', f'href="#{name}-', inside)
        return re.sub(r"url\(#", f"url(#{name}-", inside)

    body = re.sub(r"<[^>]*>", own_ids, body)
    box = view_box.group(1) if view_box else "0 0 1 1"
    return f'<svg viewBox="{box}" role="img" aria-label="{escape(description)}">{body.strip()}'


def literal(text: str) -> str:
    """Text that matplotlib must not read as mathematics."""
    return text.replace("$", r"\$")


def wavelength_axis(axes: Axes, wavelength_nm: FloatArray) -> None:
    """Name the horizontal axis and let it span the measured range."""
    low, high = float(wavelength_nm[0]), float(wavelength_nm[-1])
    room = 0.015 * (high - low) or 1.0
    axes.set_xlim(low - room, high + room)
    axes.set_xlabel("Wavelength [nm]")


def plain_ticks(axes: Axes, which: str = "y") -> None:
    """Write the ticks of a logarithmic axis as plain numbers (0.01, 1, 100)."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axis = axes.yaxis if which == "y" else axes.xaxis
    low, high = sorted(axes.get_ylim() if which == "y" else axes.get_xlim())
    subs = (1.0,) if high / max(low, 1e-300) > 200 else (1.0, 2.0, 5.0)
    axis.set_major_locator(LogLocator(subs=subs, numticks=12))
    axis.set_major_formatter(FuncFormatter(lambda value, _position: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def series_style(index: int) -> tuple[str, str]:
    """Colour and marker of the sample with this index."""
    turn = index // len(SERIES)
    return SERIES[index % len(SERIES)], MARKERS[(index + turn) % len(MARKERS)]
