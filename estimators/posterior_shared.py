"""What the wavelengths of joint spectra share: splines, and errors common to all."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.errors import InputError
from twin.spectra import FloatArray


def spline_basis(wavelength_nm: FloatArray, knots: int) -> FloatArray:
    """Natural cubic splines that are 1 at one of K even knots, at (W,) [nm], shape (W, K).

    Raises:
        InputError: fewer wavelengths than knots.
    """
    from scipy.interpolate import CubicSpline

    if wavelength_nm.size < knots:
        raise InputError(
            f"{wavelength_nm.size} usable wavelengths for {knots} knots",
            "as many wavelengths as knots or more",
            place="knots",
        )
    places = np.linspace(wavelength_nm[0], wavelength_nm[-1], knots)
    return np.asarray(CubicSpline(places, np.eye(knots), bc_type="natural")(wavelength_nm))


@dataclass(frozen=True, eq=False)
class Shared:
    """Errors common to all wavelengths, integrated out: r' (1 + E E')^-1 r.

    Attributes:
        change: whitened change of the captures per standard deviation, E, (W * M, N).
        gain: N x N factor G with G' G = (1 + E' E)^-1.
    """

    change: FloatArray
    gain: FloatArray

    @classmethod
    def of(cls, change: FloatArray) -> Shared:
        """Of changes (W, M, N)."""
        flat = change.reshape(-1, change.shape[-1])
        inner = np.eye(flat.shape[1]) + flat.T @ flat
        return cls(flat, np.linalg.inv(np.linalg.cholesky(inner)))

    def chi_square(self, residual: FloatArray) -> FloatArray:
        """Of whitened residuals (K, W * M), shape (K,)."""
        along = (residual @ self.change) @ self.gain.T
        return np.asarray((residual**2).sum(axis=1) - (along**2).sum(axis=1))

    def weighed(self, columns: FloatArray) -> FloatArray:
        """(1 + E E')^-1 times columns (W * M, P)."""
        along = self.gain.T @ (self.gain @ (self.change.T @ columns))
        return np.asarray(columns - self.change @ along)
