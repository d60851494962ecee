"""Captures brought to the refractive indices of the map: an appearance map has but one.

Sample and covers refract more in the blue than in the red; a map is computed at one index of
each. That moves the transmittance of the faces by some 0.05 %, which an averaged collimated
capture shows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from estimators.map_grid import Map
from estimators.protocol import BenchModel
from estimators.screening import Screened
from estimators.two_streams import two_streams
from twin.spectra import FloatArray

DOUBT = 0.3
"""Share of the change of black and white that two streams may miss."""


def at_the_map(model: BenchModel, maps: Sequence[Map]) -> BenchModel | None:
    """The bench with the refractive indices of its maps, or None where they are unknown."""
    from twin.appearance import AppearanceMap
    from twin.appearance.compute import NOMINAL_NM
    from twin.materials import refractive_index

    if model.bench is None:
        return None
    known = [each for each in maps if isinstance(each, AppearanceMap)]
    if len(known) < len(maps):
        return None
    nominal, like = np.array([NOMINAL_NM]), np.ones_like(model.wavelength_nm)
    return replace(
        model,
        n=np.stack([each.n * like for each in known]),
        covers_above=tuple(refractive_index(c.n, nominal) * like for c in model.bench.covers_above),
        covers_below=tuple(refractive_index(c.n, nominal) * like for c in model.bench.covers_below),
    )


def brought(
    model: BenchModel,
    mapped: BenchModel,
    thickness_mm: FloatArray,
    parameters: FloatArray,
    screened: Screened,
) -> Screened:
    """What a bench with the map's refractive indices would have measured.

    Args:
        model: the bench.
        mapped: the bench with the indices of the map.
        thickness_mm: of S samples [mm].
        parameters: a first estimate of every sample, shape (S, W, 3); NaN where there is none.
        screened: what was measured.

    Returns:
        The same with captures and covariance multiplied, and a doubt added to the covariance.
    """
    factor = np.ones(screened.value.shape)
    for s, own in enumerate(parameters):
        known = np.isfinite(own).all(axis=1)
        material = np.where(known[:, None], own, [0.5, 1.0, 0.0])
        here, there = (
            two_streams(each, s, float(thickness_mm[s]), material) for each in (model, mapped)
        )
        usable = known & (here > 0.0) & (there > 0.0)
        factor[s] = np.where(usable, there / np.where(usable, here, 1.0), 1.0)
    rows = 3 * len(parameters)
    flat = factor.reshape(rows, -1).T
    covariance = screened.covariance * flat[:, :, None] * flat[:, None, :]
    doubt = DOUBT * (factor - 1.0) * screened.value
    doubt[:, 2] = 0.0
    index = np.arange(rows)
    covariance[:, index, index] += doubt.reshape(rows, -1).T ** 2
    return replace(screened, value=screened.value * factor, covariance=covariance)
