"""The measured captures themselves in the appearance maps, and back from the estimate."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.lut_settings import LutSettings
from estimators.map_grid import MapNodes
from estimators.result import Status
from estimators.screening import Screened
from estimators.search import search
from twin.spectra import FloatArray


class Table(NamedTuple):
    """One sample's map at the wavelengths' backgrounds."""

    grid: MapNodes
    power: FloatArray
    rho: tuple[float, float]


class Plain(NamedTuple):
    """Plain look-up of all samples (S, W)."""

    triple: FloatArray
    """(I_black, I_white, third), shape (S, W, 3); NaN where not usable."""
    place: FloatArray
    status: NDArray[np.int8]
    distance: FloatArray
    scale: FloatArray
    """Standard deviation of the triple, map errors included, shape (S, W, 3)."""
    misfit: FloatArray
    """Squared distance to the map in standard deviations, shape (S, W); NaN where masked."""


def look_up_measured(
    tables: list[Table],
    screened: Screened,
    options: LutSettings,
) -> Plain:
    """Look up the measured captures themselves, and say what cannot be.

    Args:
        tables: one per sample.
        screened: what was measured and can be used.
        options: of the estimator.
    """
    samples, _, count = screened.value.shape
    needs = 2 if options.fixed_g is not None else 3
    usable = np.asarray(screened.usable[:, :needs].all(axis=1))
    contradictory = screened.status == Status.CONTRADICTORY
    triple = np.full((samples, count, 3), np.nan)
    place = np.full((samples, count, 3), np.nan)
    scale = np.ones((samples, count, 3))
    distance = np.full((samples, count), np.nan)
    misfit = np.full((samples, count), np.nan)
    status = np.full((samples, count), Status.MASKED, dtype=np.int8)
    limit = options.lost_sigma
    for s, table in enumerate(tables):
        black, white, through = screened.value[s]
        noise = screened.sigma[s]
        wrong = usable[s] & contradictory[s]
        with np.errstate(invalid="ignore", divide="ignore"):
            if needs == 3:
                lost = usable[s] & ~wrong & ((through <= limit * noise[2]) | (through <= 0))
                third, third_se = np.log(through), noise[2] / through
            else:
                lost = np.zeros(count, dtype=bool)
                third = np.full(count, float(options.fixed_g or 0.0))
                third_se = np.zeros(count)
        status[s, usable[s]] = Status.OK
        status[s, wrong], status[s, lost] = Status.CONTRADICTORY, Status.COLLIMATED_LOST
        # What is lost in noise is looked up at the bound that the noise leaves.
        floor = float(table.grid.third.min())
        bound = np.log(np.maximum(np.maximum(through, 0) + 2 * noise[2], np.exp(floor)))
        third = np.where(lost, bound, third)
        third_se = np.where(lost, 1.0, third_se)
        seek = np.flatnonzero(usable[s] & ~wrong)
        triple[s, seek] = np.stack([black, white, third], axis=-1)[seek]
        noisy = np.stack([noise[0], noise[1], third_se], axis=-1)
        # The search needs a metric before it knows the map's errors: noise, or 1e-4.
        metric = np.where(np.isfinite(noisy), np.maximum(noisy, 1e-4), 1e-4)
        found = search(
            table.grid,
            triple[s, seek],
            seek.astype(np.int32),
            table.power,
            table.rho,
            metric,
            threads=options.cores,
        )
        place[s, seek] = found.place
        errors = table.grid.errors(found.place, *table.rho)
        scale[s, seek] = np.hypot(noisy[seek], errors)
        safe = np.maximum(scale[s, seek], 1e-12)
        misfit[s, seek] = np.sum((found.rest / safe) ** 2, axis=1)
        # A point is on the map when it is as near as the map itself is certain.
        near_enough = (np.abs(found.rest) <= errors + 1e-9).all(axis=1)
        on_map = found.inside | near_enough
        distance[s, seek] = np.where(on_map, 0.0, np.linalg.norm(found.rest, axis=1))
        away = seek[~on_map]
        status[s, away] = np.where(
            status[s, away] == Status.OK, Status.OUTSIDE_MAP, status[s, away]
        )
    return Plain(triple, place, status, distance, scale, misfit)


def residuals(
    tables: list[Table],
    screened: Screened,
    estimate: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Predicted minus measured captures, plain and in standard deviations, both (S, 3, W)."""
    samples, count = len(tables), len(estimate)
    residual = np.full((samples, 3, count), np.nan)
    normalised = np.full((samples, 3, count), np.nan)
    for s, table in enumerate(tables):
        place = table.grid.places(estimate)
        triple = table.grid.captures(place, table.power)
        errors = table.grid.errors(np.nan_to_num(place), *table.rho)
        if table.grid.fixed_g:
            triple[:, 2] = np.nan
        else:
            triple[:, 2] = np.exp(triple[:, 2])
            errors[:, 2] *= triple[:, 2]
        difference = triple.T - screened.value[s]
        residual[s] = np.where(screened.usable[s], difference, np.nan)
        with np.errstate(invalid="ignore", divide="ignore"):
            total = np.hypot(screened.sigma[s], errors.T)
            normalised[s] = np.where(total > 0, residual[s] / total, np.nan)
    return residual, normalised
