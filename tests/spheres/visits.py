"""Visits with spheres that a known material would give."""

from __future__ import annotations

import numpy as np

from twin.measurement.rxt import SphereVisit, parse_rxt
from twin.spectra import FloatArray
from twin.spheres import SphereModel

HEAD = """IAD1
{n}      # sample
{slide_n}
{thickness}  # [mm]
{slide}
{beam}
0.98
{spheres}
# reflection
200 25 12 5 0.97
# transmission
200 25 {third} 5 0.96
"""


def text(
    rows: FloatArray,
    letters: str = "rtu",
    *,
    spheres: int = 1,
    third: float = 12.0,
    slide: float = 0.0,
    slide_n: float = 1.5,
    n: float = 1.4,
    thickness: float = 2.0,
    beam: float = 5.0,
) -> bytes:
    """A file with the given columns."""
    head = HEAD.format(
        n=n, slide_n=slide_n, thickness=thickness, slide=slide, beam=beam, spheres=spheres,
        third=third,
    )  # fmt: skip
    lines = [" ".join(f"{cell:.12g}" for cell in row) for row in np.atleast_2d(rows)]
    return (head + " ".join(letters) + "\n" + "\n".join(lines) + "\n").encode()


def empty_visit(count: int, **how: float) -> SphereVisit:
    """A visit of so many rows without meaning, for its geometry."""
    return parse_rxt(text(np.full((count, 3), 0.1), **how))  # type: ignore[arg-type]


def visit_of(
    albedo: FloatArray,
    sigma_t_per_mm: FloatArray,
    g: FloatArray,
    *,
    letters: str = "rtu",
    log2_paths: int = 12,
    model_options: dict[str, object] | None = None,
    noise: FloatArray | None = None,
    **how: float,
) -> SphereVisit:
    """The visit that materials (W,) would give; noise (W, 3) is added."""
    options = model_options or {}
    geometry = empty_visit(len(albedo), **how)
    model = SphereModel.of(geometry, **options)  # type: ignore[arg-type]
    fixed = np.asarray(g) if len(set(np.asarray(g).tolist())) == 1 else None
    table = model.loss_table(fixed, log2_paths=log2_paths)
    readings, _ = model.readings(albedo, sigma_t_per_mm, g, table)
    if noise is not None:
        readings = readings + noise
    columns = {"r": 0, "t": 1, "u": 2}
    return parse_rxt(text(readings[:, [columns[k] for k in letters]], letters, **how))  # type: ignore[arg-type]
