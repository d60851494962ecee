"""A computed appearance map, and a finer one made from it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from twin.appearance.smoothing import interpolated, refined_axis
from twin.spectra import FloatArray


@dataclass(frozen=True)
class AppearanceMap:
    """A computed map.

    Attributes:
        albedo (A,), sigma_t_per_mm (S,) [1/mm], g (G,): the grid.
        thickness_mm: of the sample [mm]; n: its refractive index.
        exponent: powers of the background's reflectance, (B,).
        black_series, white_series: coefficients of rho**exponent, (A, S, G, B).
        collimated: (A, S, G).
        black_se, white_se, collimated_se: standard errors at the bench's own backgrounds at
            550 nm, (A, S, G).
        key: content key of everything that the map depends on.
        factors: logarithms of what multiplies the parts of the plane-parallel bench,
            (5, A, S, G), see `twin.appearance.factors`; None where that engine cannot stand in.
    """

    albedo: FloatArray
    sigma_t_per_mm: FloatArray
    g: FloatArray
    thickness_mm: float
    n: float
    exponent: FloatArray
    black_series: FloatArray
    white_series: FloatArray
    collimated: FloatArray
    black_se: FloatArray
    white_se: FloatArray
    collimated_se: FloatArray
    key: str = ""
    factors: FloatArray | None = None

    @cached_property
    def shape(self) -> tuple[int, int, int]:
        """(A, S, G)."""
        return len(self.albedo), len(self.sigma_t_per_mm), len(self.g)

    def intensities(self, rho_black: float, rho_white: float) -> FloatArray:
        """I_black, I_white, I_collimated at the grid, (A, S, G, 3), for two reflectances."""
        return np.stack(
            [
                self.black_series @ float(rho_black) ** self.exponent,
                self.white_series @ float(rho_white) ** self.exponent,
                self.collimated,
            ],
            axis=-1,
        )

    def refined(self, sigma_t: int = 2, g: int = 3) -> AppearanceMap:
        """The same map on a finer grid, by cubic interpolation, for linear look-up.

        Curves are interpolated over ln sigma_t and -ln(1 - g) as logarithms where they are
        positive; powers of the reflectance that carry no light (below 1e-7) are dropped.

        Args:
            sigma_t: parts into which each step of sigma_t is divided.
            g: parts into which each step of g is divided.
        """
        total = np.abs(self.black_series).max(axis=(0, 1, 2)) + np.abs(self.white_series).max(
            axis=(0, 1, 2)
        )
        used = total > 1e-7
        sigma_axis = refined_axis(np.log(self.sigma_t_per_mm), sigma_t)
        g_axis = refined_axis(-np.log1p(-self.g), g)

        def finer(values: FloatArray) -> FloatArray:
            along_sigma = interpolated(np.log(self.sigma_t_per_mm), sigma_axis, values, 1)
            return interpolated(-np.log1p(-self.g), g_axis, along_sigma, 2)

        # unscattered light falls by orders of magnitude between nodes: it is taken off first
        clear = np.exp(np.minimum(self.sigma_t_per_mm * self.thickness_mm, 500.0))[:, None]
        clear_finer = np.exp(np.minimum(np.exp(sigma_axis) * self.thickness_mm, 500.0))[:, None]
        return replace(
            self,
            sigma_t_per_mm=np.exp(sigma_axis),
            g=-np.expm1(-g_axis),
            exponent=self.exponent[used],
            black_series=finer(self.black_series[..., used]),
            white_series=finer(self.white_series[..., used]),
            collimated=finer(self.collimated * clear) / clear_finer,
            black_se=finer(self.black_se),
            white_se=finer(self.white_se),
            collimated_se=finer(self.collimated_se),
            factors=None if self.factors is None else _finer_factors(self.factors, finer),
        )


def _finer_factors(factors: FloatArray, finer: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """Factors on the finer grid; as they are logarithms of either sign, shifted to be smooth."""
    return np.stack([np.log(finer(np.exp(row))) for row in factors])
