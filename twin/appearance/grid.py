"""Where an appearance map is computed."""

from __future__ import annotations

import numpy as np
from pydantic import field_validator

from twin.spectra import Part


class MapGrid(Part):
    """Where the map is computed; every axis increases."""

    albedo: tuple[float, ...]
    """Single-scattering albedos, 0 to 1."""
    sigma_t_per_mm: tuple[float, ...]
    """Extinction coefficients [1/mm], above 0."""
    g: tuple[float, ...]
    """Anisotropy factors, inside -1 to 1."""

    @field_validator("albedo", "sigma_t_per_mm", "g")
    @classmethod
    def _increasing(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if len(value) < 2 or np.any(np.diff(value) <= 0):
            raise ValueError("found values that do not increase; expected two or more that do")
        return value

    @field_validator("albedo")
    @classmethod
    def _albedo(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if value[0] < 0.0 or value[-1] > 1.0:
            raise ValueError(f"found albedos {value[0]:g} to {value[-1]:g}; expected 0 to 1")
        return value

    @field_validator("sigma_t_per_mm")
    @classmethod
    def _sigma(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if value[0] <= 0.0:
            raise ValueError(f"found sigma_t {value[0]:g} per mm; expected values above 0")
        return value

    @field_validator("g")
    @classmethod
    def _g(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if value[0] <= -1.0 or value[-1] >= 1.0:
            raise ValueError(f"found g {value[0]:g} to {value[-1]:g}; expected inside -1 to 1")
        return value

    @classmethod
    def spaced(
        cls,
        albedos: int = 40,
        sigmas: int = 60,
        gs: int = 10,
        *,
        sigma_range: tuple[float, float] = (0.05, 50.0),
        g_range: tuple[float, float] = (0.0, 0.9),
        albedo_top: float = 0.9999,
    ) -> MapGrid:
        """Albedos from 0, even in log(1 - albedo); extinction even in log; g even in -log(1 - g).

        Finer towards albedo 1, as in Iser et al. 2022, section 4.3.
        """
        albedo = 1.0 - np.geomspace(1.0, 1.0 - albedo_top, albedos)
        sigma = np.geomspace(*sigma_range, sigmas)
        # similar media share (1 - g) sigma_s, so g wants the same kind of steps as sigma_t
        steps = -np.log1p(-np.array(g_range))
        return cls(
            albedo=tuple(albedo.tolist()),
            sigma_t_per_mm=tuple(sigma.tolist()),
            g=tuple((-np.expm1(-np.linspace(float(steps[0]), float(steps[1]), gs))).tolist()),
        )
