"""Colours of a Donaldson matrix under light of one wavelength, and their differences.

The light is equal energy at every wavelength, such that a perfect diffuser at 555 nm has Y = 100;
the eye is adapted to the equal-energy white of Y = 100. CIE 1931 observer, L*a*b*, CIEDE2000.
The seed (Iser et al. 2023, figure 8) does not state its scale; this one is fixed, so that the dim
reflection of violet light counts as little as it is seen.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from twin.spectra import FloatArray


@lru_cache(maxsize=8)
def _matching(emission_nm: tuple[float, ...]) -> FloatArray:
    """Colour matching functions at wavelengths [nm], largest y 1, shape (Wo, 3)."""
    import colour

    table = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    values = np.asarray(table.values, dtype=np.float64)
    grid = np.asarray(table.wavelengths, dtype=np.float64)
    found = np.stack([np.interp(emission_nm, grid, column) for column in values.T], axis=1)
    return found / float(values[:, 1].max())


def monochromatic_lab(matrix: FloatArray, emission_nm: FloatArray) -> FloatArray:
    """L*a*b* under every excitation wavelength, (..., Wi, 3), of matrices (..., Wo, Wi)."""
    xyz = np.einsum("...oi,oc->...ic", matrix, _matching(tuple(np.asarray(emission_nm).tolist())))
    return lab_of(xyz)


def lab_of(relative_xyz: FloatArray) -> FloatArray:
    """L*a*b* of tristimulus values over those of the white, (..., 3) (CIE 015:2018, 8.2.1)."""
    cut = (6.0 / 29.0) ** 3
    low = relative_xyz / (3 * (6 / 29) ** 2) + 4 / 29
    f = np.where(relative_xyz > cut, np.cbrt(np.maximum(relative_xyz, cut)), low)
    x, y, z = f[..., 0], f[..., 1], f[..., 2]
    return np.stack([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)], axis=-1)


def ciede2000(one: FloatArray, other: FloatArray) -> FloatArray:
    """CIEDE2000 between L*a*b* (..., 3) that broadcast, (...)."""
    import colour

    first, second = np.broadcast_arrays(one, other)
    return np.asarray(colour.delta_E(first, second, method="CIE 2000"), dtype=np.float64)


def monochromatic_difference(
    one: FloatArray, other: FloatArray, emission_nm: FloatArray
) -> FloatArray:
    """CIEDE2000 under every excitation wavelength, (..., Wi), between matrices (..., Wo, Wi)."""
    return ciede2000(monochromatic_lab(one, emission_nm), monochromatic_lab(other, emission_nm))
