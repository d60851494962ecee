"""Benches, materials and captures for the tests of the fluorescence estimators."""

from __future__ import annotations

import numpy as np

from twin.fluorescence.donaldson import GRID_NM
from twin.fluorescence.system import FluorescenceData, FluorescenceSystem
from twin.spectra import FloatArray

BELOW = np.tril(np.ones((31, 31), dtype=bool), -1)


def bell(centre: float, width: float) -> FloatArray:
    return np.asarray(np.exp(-0.5 * ((GRID_NM - centre) / width) ** 2))


def system(channels: str = "spectrometer") -> FluorescenceSystem:
    narrow = [bell(c, 9.0) for c in (405, 455, 480, 520, 560, 595, 630)]
    broad = [0.6 * bell(450, 12.0) + 0.7 * bell(560, 60.0)]
    if channels == "spectrometer":
        sight = np.eye(31)
    else:
        sight = np.stack([bell(c, 12.0) for c in (415, 445, 480, 515, 555, 590, 630, 680)])
    return FluorescenceSystem(np.stack(narrow + broad), sight)


def material(seed: int) -> FloatArray:
    """A random material: one or two dyes and a smooth reflectance."""
    random = np.random.Generator(np.random.Philox(key=seed))
    matrix = np.zeros((31, 31))
    for _ in range(1 + seed % 2):
        emission = random.uniform(500.0, 620.0)
        into = bell(emission - random.uniform(25.0, 80.0), random.uniform(20.0, 40.0))
        out = bell(emission, random.uniform(15.0, 30.0))
        matrix += random.uniform(0.02, 0.1) * np.outer(out, into) * BELOW
    level, slope = random.uniform(0.3, 0.6), random.uniform(-0.2, 0.2)
    reflectance = level + slope * np.tanh((GRID_NM - random.uniform(450, 650)) / 40.0)
    return np.asarray(matrix + np.diag(reflectance))


def data(
    matrix: FloatArray, bench: FluorescenceSystem, seed: int = 1, understated: float = 1.0
) -> FluorescenceData:
    clean = bench.captures(matrix)
    sigma = np.sqrt((2e-3 * clean) ** 2 + (2e-4 * clean.max()) ** 2)
    noise = np.random.Generator(np.random.Philox(key=seed)).standard_normal(clean.shape)
    return FluorescenceData(
        bench, clean + sigma * noise, (sigma / understated) ** 2,
        np.zeros((0, *clean.shape)), np.ones(clean.shape, dtype=bool),
    )  # fmt: skip
