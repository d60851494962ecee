"""A small fluorescent world: a triangle of absorption, a triangle of emission."""

from __future__ import annotations

import numpy as np

from twin.bench import Background, Backgrounds, Bench, Detector, Layer, Medium, Sample
from twin.bispectral import (
    FluorescentMedium,
    FluorescentProperties,
    Fluorophore,
    fluorescent_properties,
)
from twin.spectra import FloatArray, SpectralTable

WAVELENGTH = np.arange(420.0, 601.0, 20.0)
OUT, IN = 5, 1
"""Emission at 520 nm, excitation at 440 nm."""


def dye(absorption: float, quantum_yield: float = 0.8) -> Fluorophore:
    return Fluorophore(
        absorption_per_mm=SpectralTable(
            wavelength_nm=(400.0, 450.0, 540.0), value=(0.0, absorption, 0.0)
        ),
        emission=SpectralTable(wavelength_nm=(480.0, 520.0, 600.0), value=(0.0, 1.0, 0.0)),
        quantum_yield=quantum_yield,
    )


def medium(
    sigma_a: float = 0.02,
    sigma_s: float = 2.0,
    g: float = 0.0,
    absorption: float = 0.3,
    quantum_yield: float = 0.8,
    wavelength: FloatArray = WAVELENGTH,
) -> FluorescentProperties:
    total = sigma_a + sigma_s
    host = Medium(albedo=sigma_s / total if total else 0.0, sigma_t_per_mm=total, g=g)
    return fluorescent_properties(
        FluorescentMedium(host=host, fluorophores=(dye(absorption, quantum_yield),)), wavelength
    )


def open_bench(covers: tuple[Layer, ...] = (), rho: tuple[float, float] = (0.05, 0.9)) -> Bench:
    """Unbounded, with a point-like detector: what the plane-parallel route describes."""
    wide = (1e6, 1e6)
    return Bench(
        covers_above=covers,
        covers_below=covers,
        size_mm=None,
        background=Backgrounds(
            gap_mm=0.0,
            black=Background(reflectance=rho[0], shape="rectangle", size_mm=wide),
            white=Background(reflectance=rho[1], size_mm=wide),
        ),
        detector=Detector(spot_panels_mm=0.01),
    )


def sample(thickness: float = 1.0, n: float = 1.5) -> Sample:
    return Sample(name="slab", thickness_mm=thickness, n=n)
