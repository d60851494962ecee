"""Chapter 5's figures 7 to 10 again (Iser, Lachiver, Wilkie 2023), for all methods."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from scenarios.outputs import prepare_folder
from twin.errors import InputError

FLUORESCENCE_FIGURES = ("fluorescence7", "fluorescence8", "fluorescence9", "fluorescence10")
"""Names of the figures, after the seed publication's numbers."""
CHECKS = "figures_fluorescence.json"
COUNT, QUICK_COUNT = 24, 3
"""Generated materials with one fluorophore, and as many with two; the seed had 28 and 56."""
NEEDS_ALL = {"fluorescence7"}
"""Figures that show all four set-ups; the others need L1-S1 alone."""


def make_fluorescence_figures(
    out: Path,
    names: Sequence[str] = (),
    quick: bool = False,
    seed: int = 0,
    materials: Path | None = None,
    progress: Callable[[float, float], None] | None = None,
) -> list[Path]:
    """Make figures of chapter 5 and write them, with the numbers of what they show.

    Args:
        out: folder for NAME.svg, NAME.png and figures_fluorescence.json.
        names: of `FLUORESCENCE_FIGURES`; none asks for all.
        quick: few materials.
        seed: of materials and visits; the same seed gives the same bytes.
        materials: folder of .BFC files; None takes generated materials.
        progress: told (done, total).

    Returns:
        The files that were written.

    Raises:
        InputError: a name is not known, the materials cannot be read, or the folder cannot be
            written.
    """
    for name in names:
        if name not in FLUORESCENCE_FIGURES:
            raise InputError(
                f'the figure "{name}"', f"one of {', '.join(FLUORESCENCE_FIGURES)}", place="names"
            )
    if seed < 0:
        raise InputError(f"the seed {seed}", "0 or more", place="seed")
    from scenarios.figures.fluorescence_examples import draw_figure9, draw_figure10
    from scenarios.figures.fluorescence_runs import SETUPS, runs
    from scenarios.figures.fluorescence_statistics import draw_figure7, draw_figure8
    from scenarios.figures.fluorescent_materials import from_folder, generated
    from scenarios.figures.make import write_figures

    out = prepare_folder(Path(out))
    wanted = [name for name in FLUORESCENCE_FIGURES if name in names or not names]
    used = (
        generated(QUICK_COUNT if quick else COUNT, seed)
        if materials is None
        else from_folder(materials)
    )
    setups = SETUPS if NEEDS_ALL & set(wanted) else SETUPS[:1]
    found = runs(used, seed + 1, quick=quick, setups=setups, progress=progress)
    draw = (draw_figure7, draw_figure8, draw_figure9, draw_figure10)
    drawings = {
        name: partial(each, found)
        for name, each in zip(FLUORESCENCE_FIGURES, draw, strict=True)
        if name in wanted
    }
    said = {
        "quick": quick, "seed": seed, "materials": used.source,
        "weights_of_blasinski": {run.setup: run.weights for run in found},
    }  # fmt: skip
    return write_figures(out, drawings, CHECKS, said)
