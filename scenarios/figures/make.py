"""Simulate what the asked figures need, once, and write them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, cast

from scenarios.outputs import canonical_json, prepare_folder
from twin.errors import InputError
from twin.files import write_atomically

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from scenarios.figures.points import Blocks, Point

FIGURES = ("figure2", "figure4", "figure5", "figure6")
"""Names of the figures, after the seed publication's numbers."""
CHECKS = "figures.json"


class _Module(Protocol):
    """A module that makes one figure."""

    def points(self, quick: bool) -> tuple[Point, ...]: ...

    def draw(
        self, results: Mapping[Point, Blocks], quick: bool
    ) -> tuple[Figure, dict[str, Any]]: ...


def make_figures(
    out: Path,
    names: Sequence[str] = (),
    quick: bool = False,
    seed: int = 0,
    threads: int | None = None,
    progress: Callable[[float, float], None] | None = None,
) -> list[Path]:
    """Make figures of the appearance map and write them, with the checks of what they show.

    Args:
        out: folder for NAME.svg, NAME.png and figures.json (the checks of these figures).
        names: of `FIGURES`; none asks for all.
        quick: a coarse grid and few paths.
        seed: of every random number; the same seed gives the same bytes.
        threads: threads; the result does not depend on it.
        progress: told (done, total) while light is traced.

    Returns:
        The files that were written.

    Raises:
        InputError: a name is not known, or the folder cannot be written.
    """
    for name in names:
        if name not in FIGURES:
            raise InputError(f'the figure "{name}"', f"one of {', '.join(FIGURES)}", place="names")
    if seed < 0:
        raise InputError(f"the seed {seed}", "0 or more", place="seed")
    from scenarios.figures.points import simulate

    out = prepare_folder(Path(out))
    wanted = [name for name in FIGURES if name in names or not names]
    modules = {name: cast(_Module, import_module(f"scenarios.figures.{name}")) for name in wanted}
    points = [point for module in modules.values() for point in module.points(quick)]
    results = simulate(points, seed, threads, progress)
    drawings = {name: partial(each.draw, results, quick) for name, each in modules.items()}
    return write_figures(out, drawings, CHECKS, {"quick": quick, "seed": seed})


def write_figures(
    out: Path,
    drawings: Mapping[str, Callable[[], tuple[Figure, dict[str, Any]]]],
    checks_file: str,
    said: Mapping[str, Any],
) -> list[Path]:
    """Draw figures and write them with the numbers of what they show; nothing if one fails.

    Args:
        out: folder for NAME.svg, NAME.png and the numbers.
        drawings: what makes each figure and its numbers, by name.
        checks_file: name of the file of the numbers.
        said: what stands in it beside those of the figures.

    Returns:
        The files that were written.

    Raises:
        InputError: the folder cannot be written.
    """
    from scenarios.figures.drawing import file_bytes, style

    files: dict[str, bytes] = {}
    checks = dict(said)
    for name, draw in drawings.items():
        with style():
            figure, checks[name] = draw()
            files |= {f"{name}.{kind}": data for kind, data in file_bytes(figure).items()}
    files[checks_file] = (canonical_json(_rounded(checks)) + "\n").encode()
    for name, data in files.items():
        write_atomically(out / name, data)
    return [out / name for name in files]


def _rounded(value: Any) -> Any:
    """Floats with five significant digits: more are noise, and fewer change between machines."""
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_rounded(item) for item in value]
    if isinstance(value, float):
        return float(f"{value:.5g}")
    return value
