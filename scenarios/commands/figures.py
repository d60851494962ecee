"""`benchtwin figures`: the seed's figures again, of one chapter or by name."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from scenarios.console import Console
from twin.errors import InputError


def figures_of(
    out: Path,
    names: Sequence[str],
    *,
    chapter: int | None,
    materials: Path | None,
    quick: bool,
    seed: int,
    threads: int | None,
    console: Console,
) -> dict[str, Any]:
    """Make figures of chapter 4 or 5; returns the files that were written.

    Args:
        out: folder of the pictures.
        names: only these; none asks for all of the chapter.
        chapter: 4 or 5; None takes that of the first name, and 4 without names.
        materials: folder of .BFC files, chapter 5 only.
        quick: coarsely.
        seed: of every random number.
        threads: for the light paths of chapter 4.
        console: is told what happens.

    Raises:
        InputError: another chapter, a name of the other chapter, materials for chapter 4.
    """
    from scenarios.figures import FLUORESCENCE_FIGURES, make_figures, make_fluorescence_figures

    if chapter is None:
        chapter = 5 if names and names[0] in FLUORESCENCE_FIGURES else 4
    if chapter not in (4, 5):
        raise InputError(f"chapter {chapter}", "4 or 5", place="--chapter")
    if materials is not None and chapter == 4:
        raise InputError(
            "materials for chapter 4", "--chapter 5, or no --materials", place="--materials"
        )
    with console.step("figures") as progress:
        if chapter == 4:
            files = make_figures(out, names, quick, seed, threads, progress)
        else:
            files = make_fluorescence_figures(out, names, quick, seed, materials, progress)
    return {"files": [str(path) for path in files]}
