"""Repeats kept apart: their mean and covariance against the averaged ones, and their scatter."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from scenarios.scenario import Scenario
from scenarios.simulate import noisy_visits
from tests.measurement.visits import readings, visit
from tests.scenarios.tiny import tiny
from twin.errors import InputError
from twin.measurement import (
    SAMPLE_CAPTURES,
    Measurement,
    Observations,
    RelativeRow,
    RelativeSpectra,
    Shot,
    observations,
    relative_intensities,
)
from twin.transport import captures

SEEDS = range(40)


@functools.cache
def visits() -> tuple[Measurement, ...]:
    """Visits in the same light that differ in lamps and noise."""
    scenario = Scenario.model_validate(tiny(protocol={"repeats": 3, "reference_repeats": 2}))
    light = [
        captures(scenario.bench, sample, scenario.wavelength.wavelength_nm, paths=4096, seed=3)
        for sample in scenario.samples
    ]
    return tuple(noisy_visits(scenario, light, SEEDS))


def averaging(found: Observations, order: list[tuple[str, str]]) -> np.ndarray:
    """The matrix (3S, M) that takes means over repeats."""
    rows = np.array([[(r.sample, r.capture) == kind for r in found.rows] for kind in order], float)
    return rows / rows.sum(axis=1, keepdims=True)


def test_rows_come_by_repeat_then_sample_then_capture() -> None:
    found = observations(visits()[0])
    assert len(found.rows) == 18
    assert found.rows[0] == RelativeRow("thin", "black", 0)
    assert found.rows[5] == RelativeRow("thick", "collimated", 0)
    assert found.rows[6] == RelativeRow("thin", "black", 1)


def test_the_mean_of_the_repeats_is_the_averaged_visit() -> None:
    measurement = visits()[0]
    found, mean = observations(measurement), relative_intensities(measurement)
    order = [(name, kind) for name in mean.sample_names for kind in SAMPLE_CAPTURES]
    average = averaging(found, order)
    np.testing.assert_allclose(
        found.value @ average.T, mean.value.reshape(6, -1).T, rtol=1e-6, atol=1e-9
    )
    whole = found.independent + np.einsum("kwm,kwn->wmn", found.common, found.common)
    np.testing.assert_allclose(average @ whole @ average.T, mean.covariance, rtol=5e-3, atol=1e-12)


def chi_square(understated: float = 1.0) -> float:
    """Mean square of whitened deviations of 40 visits from their mean, by degree of freedom."""
    every = [observations(one) for one in visits()]
    value = np.array([one.value for one in every])
    first = every[0]
    # The light's own error is common to all visits: it is not in their scatter.
    light = visits()[0].captures.light_se
    place = np.tile(np.arange(6), 3)
    own = light.reshape(6, -1)[place].T
    covariance = first.independent - np.where(
        place[:, None] == place, own[:, :, None] * own[:, None, :], 0.0
    )
    size = value[0].size
    whole = np.zeros((size, size))
    for w in range(value.shape[1]):
        block = slice(w * 18, (w + 1) * 18)
        whole[block, block] = covariance[w] / understated**2
    flat = first.common.reshape(len(first.common), -1) / understated
    factor = np.linalg.cholesky(whole + flat.T @ flat)
    off = (value - value.mean(axis=0)).reshape(len(value), -1)
    z = np.linalg.solve(factor, off.T)
    return float(np.mean(z**2) * len(value) / (len(value) - 1))


def test_visits_scatter_as_the_covariance_says() -> None:
    # 39 visits of 18 x 9 values: a standard error of 1.8 % if they are independent.
    assert chi_square() == pytest.approx(1.0, abs=0.09)


def test_understated_noise_is_found() -> None:
    assert chi_square(understated=1.3) > 1.4


def test_lamps_make_wavelengths_covary() -> None:
    found = observations(visits()[0])
    level = found.common[:, :, 0]
    shared = level.T @ level
    spread = np.sqrt(np.diagonal(shared))
    assert np.all(shared > 0.9 * np.outer(spread, spread))
    # The walk of the level between the first white reference and the first capture, at least.
    walk = visits()[0].bench.instrument.lamp_walk
    assert np.all(spread > walk * found.value[:, 0])


def test_a_masked_value_stands_alone() -> None:
    table = [
        *readings(("a",)),
        (Shot("black", 0.1, "a", repeat=1), [1100.0, 2110.0, 3120.0]),
    ]
    mask = np.zeros((len(table), 3), bool)
    mask[-1, 1] = True
    found = observations(visit(table, samples=("a",), saturated=mask))
    assert [r.repeat for r in found.rows] == [0, 0, 0, 1]
    assert not found.valid[1, 3]
    assert found.valid.sum() == 11
    assert found.independent[1, 3].tolist() == [0.0, 0.0, 0.0, 1.0]
    assert np.all(found.common[:, 1, 3] == 0.0)


def ready_made(repeats: int, sigma: float) -> Measurement:
    """Relative intensities of one sample."""
    rows = [
        RelativeRow("a", kind, repeat)
        for kind in ("black", "white", "collimated")
        for repeat in range(repeats)
    ]
    wavelength = np.linspace(400.0, 700.0, 12)
    rng = np.random.Generator(np.random.Philox(key=5))
    value = 0.3 + 0.01 * rng.normal(size=(len(rows), 12))
    whole = visit(samples=("a",))
    spectra = RelativeSpectra(tuple(rows), wavelength, value, np.full(value.shape, sigma))
    return Measurement(bench=whole.bench, samples=whole.samples, relative=spectra)


def test_relative_intensities_by_hand_keep_their_sigma() -> None:
    found = observations(ready_made(2, 0.02))
    np.testing.assert_allclose(np.diagonal(found.independent[4]), 0.02**2)
    assert found.common.shape == (0, 12, 6)


def test_unknown_sigma_is_taken_from_the_scatter_or_refused() -> None:
    found = observations(ready_made(5, np.nan))
    assert 0.005 < np.sqrt(found.independent[6, 0, 0]) < 0.02
    assert "scatter of 5 repeats" in found.reasons[0]
    with pytest.raises(InputError, match="without repeats"):
        observations(ready_made(1, np.nan))
