"""Visits simulated by the fast engine itself, with noise: the world least squares assumes."""

from __future__ import annotations

from functools import cache

import numpy as np

from estimators import BenchModel
from estimators.least_squares import LeastSquaresEstimator, LeastSquaresSettings
from twin.bench import Bench, Sample
from twin.measurement.relative import RelativeIntensities
from twin.spectra import FloatArray

COUNT = 96
THICKNESS = (0.4, 0.8)


def generator(key: int, stream: int = 0) -> np.random.Generator:
    return np.random.Generator(np.random.Philox(key=[key, stream]))


@cache
def bench_model(count: int = COUNT, thickness: tuple[float, ...] = THICKNESS) -> BenchModel:
    samples = [Sample(name=f"{h:g} mm", thickness_mm=h, n=1.5) for h in thickness]
    return BenchModel.of(Bench(), samples, np.linspace(420.0, 700.0, count))


@cache
def estimator(
    count: int = COUNT, thickness: tuple[float, ...] = THICKNESS
) -> LeastSquaresEstimator:
    """One estimator of a bench: its engine is compiled once."""
    return LeastSquaresEstimator(bench_model(count, thickness))


def with_settings(settings: LeastSquaresSettings, count: int = COUNT) -> LeastSquaresEstimator:
    """Other options on the same compiled engine, which must not depend on them."""
    made = LeastSquaresEstimator(bench_model(count), settings)
    made._built = estimator(count).engine()
    return made


def materials(count: int, seed: int = 0) -> FloatArray:
    """Materials that two samples determine, in no order, shape (count, 3)."""
    random = generator(seed, 1)
    return np.stack(
        [
            random.uniform(0.5, 0.97, count),
            np.exp(random.uniform(np.log(1.0), np.log(4.0), count)),
            random.uniform(0.1, 0.75, count),
        ],
        axis=-1,
    )


def smooth_material(count: int) -> FloatArray:
    u = np.linspace(0.0, 1.0, count)
    return np.stack([0.8 + 0.1 * np.sin(4 * u), 2.0 + np.cos(3 * u), 0.6 + 0.1 * u], axis=-1)


def captures(made: LeastSquaresEstimator, material: FloatArray) -> FloatArray:
    """Exact captures, shape (S, 3, W)."""
    engine, _ = made.engine()
    value, _ = engine.evaluate(engine.coordinates.place(material), np.arange(len(material)))
    return value.T.reshape(-1, 3, len(material)).copy()


def visit(
    made: LeastSquaresEstimator,
    material: FloatArray,
    *,
    noise: float = 0.01,
    floor: float = 1e-4,
    seed: int = 0,
    understated: float = 1.0,
) -> RelativeIntensities:
    """What the bench would measure, with relative noise and a floor."""
    exact = captures(made, material)
    samples, _, count = exact.shape
    sigma = np.hypot(noise * exact, floor)
    value = exact + sigma * generator(seed, 2).standard_normal(exact.shape)
    covariance = np.zeros((count, 3 * samples, 3 * samples))
    diagonal = np.arange(3 * samples)
    covariance[:, diagonal, diagonal] = (sigma / understated).reshape(3 * samples, count).T ** 2
    return RelativeIntensities(
        sample_names=made.model.sample_names,
        thickness_mm=np.array([sample.thickness_mm for sample in made.model.samples]),
        wavelength_nm=made.model.wavelength_nm,
        value=value,
        covariance=covariance,
        valid=np.ones(exact.shape, dtype=bool),
        reasons=("nothing was masked",),
        repeats=1,
    )
