"""`benchtwin spheres`: optical properties from readings with integrating spheres."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from scenarios.commands.common import digests
from scenarios.console import Console
from scenarios.outputs import prepare_folder


def spheres_file(
    path: Path,
    settings: dict[str, Any],
    *,
    out: Path | None = None,
    reference: Path | None = None,
    console: Console,
) -> dict[str, Any]:
    """Estimate the material behind an `.rxt` file.

    Args:
        path: the file.
        settings: fields of `estimators.SphereSettings` that differ from its defaults.
        out: folder of the results.
        reference: result of the program iad to draw beside this one.
        console: is told what happens.

    Returns:
        The summary that is also written.

    Raises:
        InputError: the file, a setting or the output folder cannot be used.
    """
    from estimators import SphereSettings
    from scenarios.spheres import estimate_rxt, read_iad_result, summary, write_outputs

    chosen = SphereSettings(**settings)
    beside = read_iad_result(reference) if reference is not None else None
    folder = out or Path(f"benchtwin-{path.resolve().stem}-spheres")
    with console.step("estimate from integrating spheres"):
        estimate = estimate_rxt(path, settings=chosen)
    written = write_outputs(estimate, prepare_folder(folder), path.stem, beside)
    files = digests(folder, [file.name for file in written])
    return {"command": "spheres", "folder": str(folder), **summary(estimate), "files": files}
