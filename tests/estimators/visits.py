"""Relative intensities of the fake map's world, exact or noisy."""

from __future__ import annotations

import numpy as np

from estimators import BenchModel
from tests.estimators.fake_map import FakeMap, captures, fake_map
from twin.measurement.relative import RelativeIntensities
from twin.spectra import FloatArray

THICKNESS = (0.4, 0.8)


def generator(key: int, stream: int = 0) -> np.random.Generator:
    return np.random.Generator(np.random.Philox(key=[key, stream]))


def bench_model(
    count: int, maps: tuple[FakeMap, ...] | None = None, thickness: tuple[float, ...] = THICKNESS
) -> BenchModel:
    """A bench whose black background rises in the red, like flocked paper."""
    return BenchModel(
        sample_names=tuple(f"{h:g} mm" for h in thickness),
        wavelength_nm=np.linspace(400.0, 750.0, count),
        n=np.full((len(thickness), count), 1.5),
        rho_black=np.linspace(0.02, 0.2, count),
        rho_white=np.full(count, 0.99),
        maps=tuple(fake_map(h) for h in thickness) if maps is None else maps,
    )


def materials(count: int, seed: int = 0) -> FloatArray:
    """Materials that the captures determine, shape (count, 3)."""
    random = generator(seed, 1)
    return np.stack(
        [
            1.0 - random.uniform(0.05, 0.85, count) ** 2,
            np.exp(random.uniform(np.log(0.4), np.log(6.0), count)),
            random.uniform(-0.2, 0.85, count),
        ],
        axis=-1,
    )


def visit(
    model: BenchModel,
    material: FloatArray,
    *,
    noise: float = 0.0,
    seed: int = 0,
    understated: float = 1.0,
    true_thickness: tuple[float, ...] | None = None,
) -> RelativeIntensities:
    """What the bench would measure, with relative noise of at least 1e-4."""
    thickness = tuple(source.thickness_mm for source in model.maps)
    exact = np.stack(
        [
            captures(
                material[:, 0], material[:, 1], material[:, 2], h, model.rho_black, model.rho_white
            )
            for h in true_thickness or thickness
        ]
    )
    samples, _, count = exact.shape
    sigma = np.maximum(noise * exact, 1e-4) if noise else np.zeros_like(exact)
    value = exact + sigma * generator(seed, 2).standard_normal(exact.shape)
    covariance = np.zeros((count, 3 * samples, 3 * samples))
    diagonal = np.arange(3 * samples)
    covariance[:, diagonal, diagonal] = (sigma / understated).reshape(3 * samples, count).T ** 2
    return RelativeIntensities(
        sample_names=model.sample_names,
        thickness_mm=np.array(thickness),
        wavelength_nm=model.wavelength_nm,
        value=value,
        covariance=covariance,
        valid=np.ones(exact.shape, dtype=bool),
        reasons=("nothing was masked",),
        repeats=1,
    )
