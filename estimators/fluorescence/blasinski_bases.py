"""Bases of the estimator `blasinski`: leading directions of peak-normalised spectra.

Source: Blasinski, Farrell, Wandell 2020, "Simultaneous surface reflectance and fluorescence
spectra estimation" (IEEE TIP 29): uncentred principal components of reflectances, excitation and
emission spectra. The published bases come from measured collections, which are not ours to ship;
`bases_of` makes them of any collection, `generated_bases` of spectra that are drawn here: smooth
random reflectances (a Gaussian process through a logistic function) and log-normal peaks in random
places with a shoulder.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from estimators.fluorescence.background_prior import matern52
from estimators.fluorescence.products import log_peak
from twin.errors import InputError
from twin.spectra import FloatArray

REFLECTANCE, EXCITATION, EMISSION = 5, 12, 12
"""Numbers of vectors in the published bases."""
GENERATED = 600


@dataclass(frozen=True, eq=False)
class Bases:
    """Orthonormal columns.

    Attributes:
        reflectance: (D, 5); excitation: (Wi, 12); emission: (Wo, 12).
    """

    reflectance: FloatArray
    excitation: FloatArray
    emission: FloatArray


def bases_of(reflectance: FloatArray, excitation: FloatArray, emission: FloatArray) -> Bases:
    """Bases of collections of spectra, shapes (N, D), (N, Wi), (N, Wo), in photon units.

    Raises:
        InputError: fewer spectra than vectors, or values that are not finite.
    """
    return Bases(
        _leading(reflectance, REFLECTANCE, "reflectance"),
        _leading(excitation, EXCITATION, "excitation"),
        _leading(emission, EMISSION, "emission"),
    )


def generated_bases(emission_nm: FloatArray, excitation_nm: FloatArray) -> Bases:
    """Bases of spectra that are drawn here, on the wavelengths [nm] of a matrix."""
    return _generated(tuple(emission_nm.tolist()), tuple(excitation_nm.tolist()))


@lru_cache(maxsize=8)
def _generated(emission: tuple[float, ...], excitation: tuple[float, ...]) -> Bases:
    random = np.random.Generator(np.random.Philox(key=4))
    out, into = np.array(emission), np.array(excitation)
    common = out[np.abs(out[:, None] - into).min(axis=1) < 1e-6]
    factor = np.linalg.cholesky(
        matern52(common[:, None] - common, 120.0) + 1e-9 * np.eye(common.size)
    )
    level = random.normal(-0.5, 1.0, (GENERATED, 1))
    reflectance = 1.0 / (1.0 + np.exp(-(level + 1.2 * random.standard_normal(
        (GENERATED, common.size)) @ factor.T)))  # fmt: skip
    peak = random.uniform(400.0, 690.0, GENERATED)
    shift = random.lognormal(np.log(35.0), 0.6, GENERATED)

    def peaks(grid: FloatArray, centre: FloatArray, width: float, skew: float) -> FloatArray:
        first = np.column_stack([
            centre, random.normal(np.log(width), 0.3, GENERATED),
            random.normal(skew, 0.2, GENERATED),
        ])  # fmt: skip
        second = first + np.array([random.choice([-40.0, 40.0]), 0.0, 0.0])
        share = random.uniform(0.0, 0.6, (GENERATED, 1))
        return np.exp(log_peak(grid, first)) + share * np.exp(log_peak(grid, second))

    return bases_of(
        reflectance,
        peaks(into, peak - shift, 70.0, -0.2) + 1e-6,
        peaks(out, peak, 55.0, 0.2) + 1e-6,
    )


def _leading(spectra: FloatArray, count: int, name: str) -> FloatArray:
    given = np.asarray(spectra, dtype=np.float64)
    if given.ndim != 2 or len(given) < count or not np.all(np.isfinite(given)):
        raise InputError(
            f"{name} spectra of shape {given.shape}",
            f"{count} or more finite spectra, one a row", place=name,
        )  # fmt: skip
    top = given.max(axis=1, keepdims=True)
    if not np.all(top > 0.0):
        raise InputError(f"a {name} spectrum without a peak", "values above 0", place=name)
    _, _, rows = np.linalg.svd(given / top, full_matrices=False)
    return np.ascontiguousarray(rows[:count].T)
