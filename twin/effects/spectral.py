"""Changing a spectrum that a person wrote as a number, a name or a table."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from twin.materials import reflectance, refractive_index
from twin.materials.library import Kind, entry
from twin.spectra import FloatArray, Spectral, SpectralTable

STEP_NM = 2.0
WIDEST_NM = (300.0, 1100.0)
"""Wavelengths over which a number becomes a table."""

Curve = Callable[[FloatArray, FloatArray], FloatArray]
"""(wavelength [nm], value) -> changed value, shape (W,) each."""

_LOOK_UP = {"reflectance": reflectance, "refractive_index": refractive_index}


def shifted(value: Spectral, kind: Kind, by: float) -> Spectral:
    """A spectrum with the same added at every wavelength; a number stays a number."""
    if isinstance(value, float | int):
        return float(value) + by
    return curved(value, kind, lambda _, old: old + by)


def scaled(value: Spectral, kind: Kind, factor: float) -> Spectral:
    """A spectrum times a factor; a number stays a number."""
    if isinstance(value, float | int):
        return float(value) * factor
    return curved(value, kind, lambda _, old: old * factor)


def curved(value: Spectral, kind: Kind, curve: Curve) -> SpectralTable:
    """A spectrum changed by a curve, as a table every 2 nm (and at a table's own nodes).

    Raises:
        InputError: an unknown name.
    """
    low, high = WIDEST_NM
    nodes = np.empty(0)
    if isinstance(value, SpectralTable):
        nodes = np.asarray(value.wavelength_nm)
        low, high = nodes[0], nodes[-1]
    elif isinstance(value, str):
        known = getattr(entry(kind, value), "range_nm", WIDEST_NM)
        low, high = max(low, known[0]), min(high, known[1])
    grid = np.unique([low, high, *np.arange(low, high, STEP_NM), *nodes])
    changed = curve(grid, _LOOK_UP[kind](value, grid))
    return SpectralTable(wavelength_nm=tuple(grid.tolist()), value=tuple(changed.tolist()))
