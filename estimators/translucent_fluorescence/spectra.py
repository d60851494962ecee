"""Smooth non-negative spectra of few numbers: the exponential of a cubic spline."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.errors import InputError
from twin.spectra import FloatArray


@dataclass(frozen=True, eq=False)
class SplineBasis:
    """exp(matrix @ coefficients) inside a range, 0 outside.

    Attributes:
        matrix: (W, K), rows of 0 outside the range; inside: (W,) bool.
        knot_nm: where each coefficient acts most [nm], (K,).
    """

    matrix: FloatArray
    inside: np.ndarray
    knot_nm: FloatArray

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return len(self.knot_nm)

    def values(self, coefficients: FloatArray) -> FloatArray:
        """The spectrum, (W,)."""
        return np.where(self.inside, np.exp(self.matrix @ coefficients), 0.0)

    def fit(self, spectrum: FloatArray, floor: float) -> FloatArray:
        """Coefficients, (K,), of the spline nearest to the logarithm of a spectrum above a floor.

        Args:
            spectrum: (W,).
            floor: values below it count as it.
        """
        rows = self.inside
        target = np.log(np.maximum(spectrum[rows], floor))
        return np.asarray(np.linalg.lstsq(self.matrix[rows], target, rcond=None)[0])


def log_spline_basis(
    wavelength_nm: FloatArray, low_nm: float, high_nm: float, knot_nm: float
) -> SplineBasis:
    """Uniform cubic B-splines between two wavelengths (de Boor 1978, chapter IX).

    Args:
        wavelength_nm: (W,).
        low_nm: where the spectrum begins [nm].
        high_nm: where it ends [nm].
        knot_nm: distance of the knots [nm].

    Raises:
        InputError: a range that holds fewer than two of the wavelengths, or no distance.
    """
    wave = np.asarray(wavelength_nm, dtype=np.float64)
    inside = (wave >= low_nm - 1e-9) & (wave <= high_nm + 1e-9)
    if inside.sum() < 2 or knot_nm <= 0.0:
        raise InputError(
            f"{low_nm:g} to {high_nm:g} nm with knots every {knot_nm:g} nm",
            "a range with two wavelengths or more, and a distance above 0",
            place="spectrum",
        )
    pieces = max(1, round((high_nm - low_nm) / knot_nm))
    step = (high_nm - low_nm) / pieces
    knots: FloatArray = low_nm + step * np.arange(-1.0, pieces + 2.0)
    x = np.abs(wave[:, None] - knots) / step
    near = 2.0 / 3.0 - x**2 + 0.5 * x**3
    far = (2.0 - np.minimum(x, 2.0)) ** 3 / 6.0
    matrix = np.where(x < 1.0, near, far) * inside[:, None]
    return SplineBasis(matrix, inside, knots)
