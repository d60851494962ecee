"""Benches without edges and media that the tests of adding-doubling share."""

from __future__ import annotations

import numpy as np

from twin.bench import Background, Backgrounds, Bench, Detector
from twin.materials import OpticalProperties
from twin.spectra import FloatArray

WIDE = (1.0e6, 1.0e6)


def unbounded(covered: bool = True, rho_black: float = 0.05, rho_white: float = 0.98) -> Bench:
    """The usual bench without edges; every scattered ray of the beam reaches the detector."""
    bench = Bench(
        size_mm=None,
        background=Backgrounds(
            black=Background(reflectance=rho_black, shape="disc", size_mm=WIDE),
            white=Background(reflectance=rho_white, size_mm=WIDE),
        ),
        detector=Detector(spot_beam_mm=1.0e6),
    )
    return bench if covered else bench.model_copy(update={"covers_above": (), "covers_below": ()})


def medium(albedo: list[float], sigma_t: list[float], g: list[float]) -> OpticalProperties:
    """A medium at as many made-up wavelengths as there are values."""
    wavelength: FloatArray = np.linspace(500.0, 600.0, len(albedo))
    return OpticalProperties(wavelength, np.array(albedo), np.array(sigma_t), np.array(g), None)
