"""The checker as a picture, a page and tables."""

from __future__ import annotations

import html
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.predict.checker import Checker, PatchResult
from twin.files import write_atomically

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMNS = 5
PICTURE, PAGE, TABLE = "checker", "checker.html", "checker.csv"
TABLE_HEADER = (
    "patch,cyan,magenta,yellow,black,white,wavelength_nm,predicted,lower_90,upper_90,"
    "simulated,standard_error"
)


def write_checker(checker: Checker, folder: Path) -> list[Path]:
    """Write checker.svg, checker.png, checker.html and checker.csv, each whole or not at all.

    Raises:
        InputError: the folder cannot be written.
    """
    from scenarios.figures.drawing import file_bytes, style

    with style():
        pictures = file_bytes(checker_figure(checker))
    files = {f"{PICTURE}.{kind}": data for kind, data in pictures.items()}
    files[PAGE] = page(checker, pictures["svg"].decode()).encode()
    files[TABLE] = table(checker).encode()
    return [write_atomically(folder / name, data) for name, data in files.items()]


def checker_facts(checker: Checker) -> dict[str, Any]:
    """The result as plain values."""
    away = [result.difference.ciede2000 for result in checker.patches]
    return {
        "thickness_mm": checker.slab.thickness_mm,
        "illuminant": checker.illuminant,
        "quick": checker.quick,
        "estimator": next(iter(checker.estimates.values())).estimator,
        "patches": [_patch_facts(result) for result in checker.patches],
        "median_ciede2000": float(np.median(away)),
        "max_ciede2000": float(np.max(away)),
        "explained_share": float(
            np.mean([r.difference.ciede2000 <= r.explained for r in checker.patches])
        ),
        "covered_share": float(np.mean([r.covered for r in checker.patches])),
        "notes": list(dict.fromkeys(notes for r in checker.patches for notes in _notes(r))),
    }


def _patch_facts(result: PatchResult) -> dict[str, Any]:
    return {
        "patch": result.patch.name,
        "recipe": result.patch.recipe,
        "ciede2000": result.difference.ciede2000,
        "interval_90": list(result.difference.interval),
        "explained_up_to": result.explained,
        "reflectance_covered": result.covered,
        "predicted": result.predicted_colour.swatch.hexadecimal,
        "simulated": result.simulated_colour.swatch.hexadecimal,
    }


def _notes(result: PatchResult) -> tuple[str, ...]:
    """Notes, those of an ink alone under its name as those of mixtures are."""
    pure = max(result.patch.fractions) == 1
    own = result.predicted.notes
    named = tuple(f"{result.patch.name}: {note}" for note in own) if pure else own
    return (*named, *result.predicted_colour.notes)


def checker_figure(checker: Checker) -> Figure:
    """Every patch: predicted and simulated colour side by side, and both spectra below."""
    from matplotlib.figure import Figure

    rows = math.ceil(len(checker.patches) / COLUMNS)
    figure = Figure(figsize=(2.15 * COLUMNS, 2.35 * rows + 0.75))
    top = 1 - 0.62 / (2.35 * rows + 0.75)
    grid = figure.add_gridspec(
        rows, COLUMNS, left=0.06, right=0.99, bottom=0.42 / (2.35 * rows + 0.75), top=top,
        hspace=0.3, wspace=0.2,
    )  # fmt: skip
    for number, result in enumerate(checker.patches):
        cell = grid[number // COLUMNS, number % COLUMNS].subgridspec(
            2, 1, height_ratios=(1, 1.5), hspace=0.08
        )
        axes = figure.add_subplot(cell[1])
        _draw_swatches(figure.add_subplot(cell[0]), result)
        _draw_spectra(axes, result)
        axes.tick_params(labelbottom=number + COLUMNS >= len(checker.patches))
        axes.tick_params(labelleft=number % COLUMNS == 0)
        if number % COLUMNS == 0:
            axes.set_ylabel("radiance factor")
        if number + COLUMNS >= len(checker.patches):
            axes.set_xlabel("wavelength [nm]")
    figure.text(
        0.06, 1 - 0.2 / (2.35 * rows + 0.75),
        f"Colour checker, {checker.slab.thickness_mm:g} mm: predicted from 0.4 and 0.8 mm (left,"
        " line, 90 % band) and simulated measurement (right, dots)",
        weight="bold", size=10.5, va="center",
    )  # fmt: skip
    return figure


def _draw_swatches(axes: Axes, result: PatchResult) -> None:
    pair = (result.predicted_colour.swatch, result.simulated_colour.swatch)
    for place, swatch in enumerate(pair):
        axes.axvspan(place / 2, (place + 1) / 2, color=swatch.hexadecimal, linewidth=0)
        if not swatch.in_gamut:
            ink = "black" if swatch.lab[0] > 50 else "white"
            where = 0.02 if place == 0 else 0.98
            axes.text(
                where, 0.06, "clipped", size=6, color=ink, ha="left" if place == 0 else "right"
            )
    axes.set(xlim=(0, 1), ylim=(0, 1), xticks=[], yticks=[])
    for spine in axes.spines.values():
        spine.set_visible(False)
    axes.set_title(
        f"{result.patch.name}  ΔE {result.difference.ciede2000:.1f}", size=8.5, pad=12, loc="left"
    )
    axes.text(0, 1.03, result.patch.recipe, size=6.5, transform=axes.transAxes, va="bottom")


def _draw_spectra(axes: Axes, result: PatchResult) -> None:
    from scenarios.report.figure import BLUE, INK

    predicted, simulated = result.predicted, result.simulated
    low, high = predicted.interval(0.9)
    wavelength = predicted.wavelength_nm
    axes.fill_between(wavelength, low, high, color=BLUE, alpha=0.25, linewidth=0)
    axes.plot(wavelength, predicted.reflectance, color=BLUE, linewidth=1.1)
    axes.plot(wavelength, simulated.reflectance, ".", color=INK, markersize=2.6)
    axes.set(ylim=(0, 1), yticks=[0, 0.5, 1])


def page(checker: Checker, svg: str) -> str:
    """One offline page: the picture, a table of differences, and what to know about it."""
    facts = checker_facts(checker)
    head = (
        "patch", "C M Y K W [%]", "predicted", "simulated", "ΔE00", "90 % interval",
        "explained up to", "spectrum inside 90 %",
    )  # fmt: skip
    lines = []
    for row in facts["patches"]:
        low, high = row["interval_90"]
        cells = [
            html.escape(row["patch"]), html.escape(row["recipe"]), _chip(row["predicted"]),
            _chip(row["simulated"]), f"{row['ciede2000']:.2f}", f"{low:.2f} to {high:.2f}",
            f"{row['explained_up_to']:.2f}", f"{100 * row['reflectance_covered']:.0f} %",
        ]  # fmt: skip
        lines.append("<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>")
    title = f"Colour checker, {checker.slab.thickness_mm:g} mm, {checker.illuminant}"
    notes = "".join(f"<li>{html.escape(note)}</li>" for note in facts["notes"])
    picture = svg[svg.index("<svg") :]
    return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{html.escape(title)}</title>
<style>
body {{ font: 15px/1.45 system-ui, sans-serif; color: #1c2430; max-width: 1080px;
  margin: 2em auto; padding: 0 1em; }}
svg {{ width: 100%; height: auto; }}
table {{ border-collapse: collapse; }}
td, th {{ padding: 0.2em 0.8em; text-align: left; border-bottom: 1px solid #d9dee5; }}
i.chip {{ display: inline-block; width: 1.1em; height: 1.1em; vertical-align: -0.2em;
  margin-right: 0.4em; }}
</style></head><body>
<h1>{html.escape(title)}</h1>
<p>Five PolyJet inks were measured at 0.4 and 0.8 mm on the virtual bench and estimated by
{html.escape(facts["estimator"])}. Their mixtures were predicted by adding-doubling and compared
with the Monte Carlo of the true inks, in 45:0. Median CIEDE2000 {facts["median_ciede2000"]:.2f},
greatest {facts["max_ciede2000"]:.2f}; {100 * facts["explained_share"]:.0f} % of the patches
differ by no more than the stated uncertainty explains in nine of ten cases.</p>
{picture}
<table><tr>{"".join(f"<th>{name}</th>" for name in head)}</tr>
{chr(10).join(lines)}
</table>
<ul>{notes}</ul>
</body></html>
"""


def _chip(colour: str) -> str:
    return f'<i class="chip" style="background:{colour}"></i>{colour}'


def table(checker: Checker) -> str:
    """Both spectra of every patch as CSV; an unknown value is an empty cell."""
    rows = [TABLE_HEADER]
    for result in checker.patches:
        low, high = result.predicted.interval(0.9)
        columns = (
            result.predicted.wavelength_nm, result.predicted.reflectance, low, high,
            result.simulated.reflectance, result.simulated.standard_error,
        )  # fmt: skip
        recipe = [f"{share:g}" for share in result.patch.fractions]
        for values in zip(*columns, strict=True):
            cells = ["" if not math.isfinite(v) else repr(float(v)) for v in values]
            rows.append(",".join([result.patch.name, *recipe, *cells]))
    return "\n".join([*rows, ""])
