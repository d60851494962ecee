"""Which row of which visit is which sample at which wavelength, and where a fit starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from diagnosis.sphere_twin import READINGS, SphereTwin
from twin.errors import InputError
from twin.measurement.rxt import SphereVisit
from twin.spectra import FloatArray
from twin.spheres import SphereModel

if TYPE_CHECKING:
    from estimators.sphere import SphereSettings

FIRST_DILUENT = 0.02
"""Absorption [1/mm] of the diluent that a fit starts from."""


def places(visits: Sequence[SphereVisit], rows_are_samples: bool) -> tuple[np.ndarray, np.ndarray]:
    """Visit and row of each wavelength of each sample, (W, S) each.

    Raises:
        InputError: no visit, or visits of different rows.
    """
    if not visits:
        raise InputError("no measurement", "at least one", place="visits")
    if rows_are_samples:
        row = np.arange(visits[0].rows)[None, :]
        return np.zeros_like(row), row
    first = visits[0]
    for other in visits[1:]:
        if not np.array_equal(first.wavelength_nm, other.wavelength_nm, equal_nan=True):
            raise InputError(
                f"other wavelengths than in {first.file}", "the same rows in every file",
                file=other.file,
            )  # fmt: skip
    row = np.repeat(np.arange(first.rows)[:, None], len(visits), axis=1)
    return np.broadcast_to(np.arange(len(visits)), row.shape).copy(), row


def check(
    visits: Sequence[SphereVisit], dilutions: bool, concentration: Sequence[float] | None,
    fillings: Sequence[int] | None, count: int,
) -> None:  # fmt: skip
    """Refuse what does not belong together.

    Raises:
        InputError: it does not.
    """
    for name, given in (("concentration", concentration), ("fillings", fillings)):
        if given is None:
            continue
        if not dilutions:
            raise InputError(f"{name} of what are no dilutions", "dilutions too", place=name)
        if len(given) != count:
            raise InputError(f"{len(given)} numbers", f"one for each of {count}", place=name)
    if concentration is not None and not all(np.isfinite(c) and c > 0 for c in concentration):
        raise InputError("a concentration that is not above 0", "numbers above 0",
                         place="concentration")  # fmt: skip
    # NaN, of rows without wavelength, is not above 0
    if dilutions and len(visits) == 1 and np.ptp(visits[0].wavelength_nm) > 0.0:
        raise InputError(
            "rows of several wavelengths", "rows without wavelength, one for each dilution",
            file=visits[0].file, remedy="Give one file for each dilution.",
        )  # fmt: skip


def data(
    visits: Sequence[SphereVisit], place: tuple[np.ndarray, np.ndarray], captures: Sequence[str]
) -> tuple[FloatArray, np.ndarray]:
    """Readings and their validity, (W, S C) each."""
    columns = [READINGS.index(capture) for capture in captures]
    value = np.empty((*place[0].shape, len(columns)))
    valid = np.empty(value.shape, dtype=bool)
    for number, visit in enumerate(visits):
        inside = place[0] == number
        value[inside] = visit.value[place[1][inside]][:, columns]
        valid[inside] = visit.valid[place[1][inside]][:, columns]
    return value.reshape(len(value), -1), valid.reshape(len(valid), -1)


def labels(
    visits: Sequence[SphereVisit], rows_are_samples: bool, concentration: Sequence[float] | None
) -> tuple[tuple[str, ...], tuple[int, ...]]:
    """Name and repeat of every sample."""
    if concentration is not None:
        names = [f"dilution {value:g}" for value in concentration]
    elif rows_are_samples:
        names = [f"row {row + 1}" for row in range(visits[0].rows)]
    else:
        names = [Path(visit.file).stem or "sample" for visit in visits]
    return tuple(names), tuple(names[:s].count(name) for s, name in enumerate(names))


def numbers(concentration: Sequence[float]) -> list[int]:
    """Equal numbers for equal concentrations."""
    known = sorted(set(concentration))
    return [known.index(value) for value in concentration]


def start(visits: Sequence[SphereVisit], settings: SphereSettings, twin: SphereTwin) -> FloatArray:
    """Coordinates of a first fit, from the estimator row by row, (W, P)."""
    from estimators.sphere import SphereEstimator

    # a start needs no settled search
    plain = replace(settings, lost_light=False, max_steps=15)
    estimates = [SphereEstimator(plain).estimate(visit) for visit in visits]

    def at(name: str, otherwise: float) -> FloatArray:
        found = np.stack([getattr(e, name) for e in estimates])[twin.visit, twin.row]
        known = np.isfinite(found)
        middle = np.median(found[known]) if known.any() else otherwise
        return np.where(known, found, middle)

    albedo, sigma, g = at("albedo", 0.5), at("sigma_t_per_mm", 1.0), at("g", 0.0)
    middle = np.clip(np.median(albedo, axis=1), 1e-4, 1.0 - 1e-5)
    columns = [np.log(middle) - np.log1p(-middle)]
    if twin.held_g is None:
        columns.append(np.arctanh(np.clip(np.median(g, axis=1), -0.95, 0.95)))
    if twin.diluent:
        columns.append(np.full(len(albedo), np.log(FIRST_DILUENT)))
    if twin.concentration is not None:
        columns.append(np.median(np.log(sigma / twin.concentration), axis=1))
    else:
        columns += list(np.log(sigma).T)
    return np.stack(columns, axis=1)


def twin_models(visits: Sequence[SphereVisit], settings: SphereSettings) -> tuple[SphereModel, ...]:
    """Models of visits with the settings of the sphere estimator.

    Raises:
        InputError: what the settings and a file say cannot be.
    """
    found = []
    for visit in visits:
        model = SphereModel.of(
            visit,
            method=settings.method,
            incidence_deg=settings.incidence_deg,
            unscattered_in_r=settings.unscattered_in_r,
            unscattered_in_t=settings.unscattered_in_t,
            lost_light=settings.lost_light,
        )
        if model.loss_geometry is not None:
            # the other method may need what this one does not
            model = replace(model, loss_geometry=replace(model.loss_geometry, diffuse=True))
        found.append(model)
    return tuple(found)
