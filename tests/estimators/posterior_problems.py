"""Visits simulated with the fast engine, for tests of the posterior's statistics."""

from __future__ import annotations

import numpy as np

from estimators import BenchModel
from estimators.forward import Forward
from twin.bench import Bench, Sample
from twin.measurement.relative import RelativeIntensities
from twin.spectra import FloatArray

THICKNESS = (0.4, 0.8)


def random_of(*key: int) -> np.random.Generator:
    return np.random.Generator(np.random.Philox(key=list(key)))


def model_of(
    count: int, thickness: tuple[float, ...] = THICKNESS, names: tuple[str, ...] | None = None
) -> BenchModel:
    labels = names or tuple(f"{h:g} mm" for h in thickness)
    samples = [Sample(name=name, thickness_mm=h) for name, h in zip(labels, thickness, strict=True)]
    return BenchModel.of(Bench(), samples, np.linspace(430.0, 690.0, count))


def materials(count: int, seed: int = 0) -> FloatArray:
    """Materials that the captures determine, shape (count, 3)."""
    random = random_of(seed, 1)
    return np.stack(
        [
            1.0 - random.uniform(0.1, 0.85, count) ** 2,
            np.exp(random.uniform(np.log(0.5), np.log(5.0), count)),
            random.uniform(0.0, 0.8, count),
        ],
        axis=-1,
    )


def visit(
    model: BenchModel,
    material: FloatArray,
    *,
    noise: float = 0.01,
    floor: float = 1e-3,
    seed: int = 0,
    understated: float = 1.0,
    thickness_factor: float = 1.0,
) -> RelativeIntensities:
    """What the bench would measure; the covariance is stated too small by `understated` squared."""
    forward = Forward.of(model)
    thickness = np.array([sample.thickness_mm for sample in model.samples])
    exact = np.asarray(
        forward.forward(forward.parameters(*material.T, thickness_mm=thickness * thickness_factor))
    )
    sigma = np.maximum(noise * exact, floor)
    value = exact + sigma * random_of(seed, 2).standard_normal(exact.shape)
    if noise == 0.0:
        value = exact
    count, size = len(material), exact[0].size
    covariance = (sigma.reshape(count, size, 1) / understated) ** 2 * np.eye(size)
    return RelativeIntensities(
        sample_names=model.sample_names,
        thickness_mm=thickness,
        wavelength_nm=model.wavelength_nm,
        value=value.transpose(1, 2, 0).copy(),
        covariance=covariance,
        valid=np.ones((len(thickness), 3, count), dtype=bool),
        reasons=(),
        repeats=1,
    )
