"""Where the search for a material behind readings with spheres begins."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from twin.spectra import FloatArray
from twin.spheres import Lost, SampleLight, SphereModel, Surfaces, sphere_readings

GRID_ALBEDO = np.array(
    [1e-4, 0.01, 0.1, 0.3, 0.5, 0.7, 0.85, 0.93, 0.97, 0.99, 0.996, 0.999, 0.9999]
)
GRID_DEPTH = np.geomspace(0.01, 400.0, 16)
GRID_G = np.array([-0.5, 0.0, 0.4, 0.7, 0.85, 0.95])


def start_places(
    model: SphereModel, value: FloatArray, sigma: FloatArray, g: FloatArray,
    held: NDArray[np.bool_],
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """The two best places of a coarse grid for every row, shape (W, 3) each."""
    anisotropies = np.unique(g) if held.all() else np.union1d(GRID_G, np.unique(g[held]))
    if anisotropies.size > 8:
        anisotropies = np.quantile(anisotropies, np.linspace(0.0, 1.0, 8))
    grid = np.stack(
        np.meshgrid(GRID_ALBEDO, GRID_DEPTH, anisotropies, indexing="ij"), axis=-1
    ).reshape(-1, 3)
    middle = int(np.argsort(model.n)[model.rows // 2])
    points = grid.copy()
    points[:, 1] /= model.thickness_mm[middle]
    # what slabs do changes little with n: one set serves all rows
    _, _, light = model.at_rows(points, np.full(len(grid), middle))
    seen = SampleLight(*light.T[:, None, :])
    surfaces = Surfaces(
        *(v[:, None] for v in (model.wall_r, model.wall_t, model.standard_r, model.standard_t))
    )
    reading_r, reading_t = sphere_readings(model.setup, seen, Lost(), surfaces)
    whole = np.stack(np.broadcast_arrays(reading_r, reading_t, light[None, :, 5]), axis=-1)
    # far away only the order of magnitude of M_U can guide
    with np.errstate(invalid="ignore", divide="ignore"):
        far = (whole[..., :2] - value[:, None, :2]) / np.maximum(sigma[:, None, :2], 0.02)
        deep = (np.log(whole[..., 2] + 1e-6) - np.log(value[:, None, 2] + 1e-6)) / 0.3
    distance = np.nansum(far**2, axis=-1) + np.nan_to_num(deep**2)
    apart = np.abs(grid[None, :, 2] - g[:, None])
    distance = np.where(held[:, None] & (apart > apart.min(axis=1)[:, None] + 1e-12), np.inf,
                        distance)  # fmt: skip
    order = np.argsort(distance, axis=1)[:, :2]
    places = []
    for rank in range(2):
        place = grid[order[:, rank]].copy()
        place[:, 1] /= model.thickness_mm
        place[:, 2] = np.where(held, g, place[:, 2])
        places.append(place)
    return places[0], places[1]
