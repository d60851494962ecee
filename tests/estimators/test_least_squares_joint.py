"""The joint mode of least squares: its matrices, its smoothness, and errors common to a visit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimators.least_squares import LeastSquaresSettings
from estimators.least_squares_banded import Normal, bend, bending
from estimators.least_squares_joint import from_material, to_material
from estimators.least_squares_smoothness import evidence
from estimators.result import EstimateResult
from tests.estimators.least_squares_world import (
    COUNT,
    estimator,
    generator,
    smooth_material,
    visit,
    with_settings,
)
from twin.errors import InputError
from twin.measurement.relative import RelativeIntensities
from twin.spectra import FloatArray

SMALL, CAPTURES, MODES = 7, 6, 2
JOINT = LeastSquaresSettings(joint=True)


def problem(key: int) -> tuple[FloatArray, FloatArray, FloatArray, Normal]:
    """Random whitened slopes (W, M, 3), modes (W, M, K), residuals (W, M), and their equations."""
    random = generator(key, 5)
    lean = random.standard_normal((SMALL, CAPTURES, 3))
    common = random.standard_normal((SMALL, CAPTURES, MODES))
    rest = random.standard_normal((SMALL, CAPTURES))
    place = random.standard_normal((SMALL, 3))
    return lean, common, rest, Normal.of(lean, common, rest, place, np.zeros(MODES))


def dense(lean: FloatArray, common: FloatArray) -> FloatArray:
    """Derivatives of all whitened captures by all unknowns, (W * M, 3 W + K)."""
    whole = np.zeros((SMALL, CAPTURES, 3 * SMALL + MODES))
    for w in range(SMALL):
        whole[w, :, 3 * w : 3 * w + 3] = lean[w]
    whole[:, :, 3 * SMALL :] = common
    return whole.reshape(SMALL * CAPTURES, -1)


def dense_prior(shape: FloatArray, length: FloatArray) -> FloatArray:
    matrix = np.zeros((3 * SMALL + MODES, 3 * SMALL + MODES))
    for offset in range(3):
        for w in range(SMALL - offset):
            for p in range(3):
                row, column = 3 * w + p, 3 * (w + offset) + p
                matrix[row, column] = matrix[column, row] = shape[offset, w] * length[p] ** 3
    matrix[3 * SMALL :, 3 * SMALL :] = np.eye(MODES)
    return matrix


WAVELENGTH = np.array([400.0, 410.0, 425.0, 430.0, 440.0, 452.0, 460.0])
LENGTHS = np.array([8.0, 15.0, 30.0])


def test_the_banded_equations_are_those_of_dense_matrices() -> None:
    lean, common, rest, normal = problem(1)
    shape = bending(WAVELENGTH, 1.0)
    solved = normal.solved(shape[..., None] * LENGTHS**3)
    slope, prior = dense(lean, common), dense_prior(shape, LENGTHS)
    precision = slope.T @ slope + prior
    at = np.concatenate([normal.place.ravel(), np.zeros(MODES)])
    step = -np.linalg.solve(precision, slope.T @ rest.ravel() + prior @ at)
    found = np.concatenate([solved.step[0].ravel(), solved.step[1]])
    # A ridge of 1e-6 keeps what nobody knows finite.
    np.testing.assert_allclose(found, step, atol=1e-5)
    inverse = np.linalg.inv(precision)
    for w in range(SMALL):
        own = slice(3 * w, 3 * w + 3)
        np.testing.assert_allclose(solved.blocks[w], inverse[own, own], rtol=1e-4, atol=1e-8)
    assert solved.log_determinant == pytest.approx(np.linalg.slogdet(precision)[1], rel=1e-5)


def test_the_evidence_is_that_of_captures_drawn_from_the_prior() -> None:
    """Differences of it, against the normal density of the captures with all unknowns in it."""
    lean, common, rest, normal = problem(2)
    shape, slope = bending(WAVELENGTH, 1.0), dense(lean, common)
    # The captures that the place 0 leaves; straight lines get a very wide prior instead of none.
    off = rest.ravel() - slope[:, : 3 * SMALL] @ normal.place.ravel()
    found, expected = [], []
    for length in (LENGTHS, LENGTHS * [2.0, 0.7, 1.3]):
        found.append(evidence(normal, shape, np.log(length)))
        prior = dense_prior(shape, length) + 1e-7 * np.eye(3 * SMALL + MODES)
        covariance = slope @ np.linalg.inv(prior) @ slope.T + np.eye(len(slope))
        sign, log_determinant = np.linalg.slogdet(covariance)
        assert sign > 0
        expected.append(-log_determinant - off @ np.linalg.solve(covariance, off))
    assert found[1] - found[0] == pytest.approx(expected[1] - expected[0], rel=1e-3, abs=1e-2)


def test_bending_costs_nothing_on_a_line() -> None:
    prior = bending(WAVELENGTH, 20.0)[..., None] * np.ones(3)
    line = (0.3 + 0.01 * WAVELENGTH)[:, None] * np.ones(3)
    curve = np.sin(WAVELENGTH / 10.0)[:, None] * np.ones(3)
    assert abs(np.sum(line * bend(prior, line))) < 1e-8 * np.sum(curve * bend(prior, curve))


def test_smoother_spectra_get_longer_lengths() -> None:
    joint, made = with_settings(JOINT), estimator()
    wiggly = smooth_material(COUNT)
    wiggly[:, 0] += 0.05 * np.sin(np.linspace(0.0, 40.0, COUNT))
    found = [
        joint.estimate(visit(made, truth, noise=0.01)).statistics
        for truth in (smooth_material(COUNT), wiggly)
    ]
    length = [float(each["smoothness_absorption_nm"][0]) for each in found]
    assert length[0] > 2.0 * length[1]
    assert found[0]["degrees_of_freedom"].min() > 3.0


def test_lengths_from_the_captures_are_nearer_and_cover() -> None:
    made, truth, joint = estimator(), smooth_material(COUNT), with_settings(JOINT)
    errors, held = [], []
    for seed in range(5):
        seen = visit(made, truth, noise=0.02, seed=seed)
        alone, together = made.estimate(seen), joint.estimate(seen)
        errors.append([(alone.parameters - truth) ** 2, (together.parameters - truth) ** 2])
        low, high = together.interval(0.90)
        held.append((low <= truth) & (truth <= high))
    single, smooth = np.sqrt(np.mean(errors, axis=(0, 2)))
    assert np.all(smooth < 0.5 * single)
    # Neighbours share their errors: about one wavelength in twenty is independent.
    assert abs(np.mean(held) - 0.90) < 4.0 * np.sqrt(0.09 / (0.05 * np.size(held)))


def test_scattering_and_absorption_turn_into_the_material_and_back() -> None:
    place = generator(4, 6).uniform(-6.0, 6.0, (20, 3))
    material, turn = to_material(place)
    np.testing.assert_allclose(from_material(material), place, atol=1e-9)
    step = 1e-6
    for p in range(3):
        moved = place.copy()
        moved[:, p] += step
        slope = (to_material(moved)[0] - material) / step
        np.testing.assert_allclose(slope, turn[:, :, p], atol=1e-5)


def drifted(seed: int) -> RelativeIntensities:
    """A visit with little noise, whose collimated captures share 2 % in each sample."""
    seen = visit(estimator(), smooth_material(COUNT), noise=0.002, seed=seed)
    common = np.zeros((2, COUNT, 6))
    common[0, :, 2], common[1, :, 5] = 0.02 * seen.value[0, 2], 0.02 * seen.value[1, 2]
    size = generator(seed, 9).standard_normal(2)
    value = seen.value + np.einsum("k,kwm->mw", size, common).reshape(2, 3, COUNT)
    covariance = seen.covariance + np.einsum("kwi,kwj->wij", common, common)
    return replace(seen, value=value, covariance=covariance, common=common)


def z_of_sigma_t(result: EstimateResult) -> float:
    truth = smooth_material(COUNT)[:, 1]
    return float(np.mean((result.sigma_t_per_mm - truth) / result.standard_error[:, 1]))


def test_what_a_visit_shares_is_not_averaged_away() -> None:
    joint = with_settings(JOINT)
    known, hidden = [], []
    for seed in range(8):
        seen = drifted(seed)
        known.append(z_of_sigma_t(joint.estimate(seen)))
        hidden.append(z_of_sigma_t(joint.estimate(replace(seen, common=None))))
    # Mean z of 8 visits: the root mean square is 1 within 0.75 (chi-square, 8, at 1 in 1000).
    assert np.sqrt(np.mean(np.square(known))) < 1.8
    # The control: the same errors taken for errors of each wavelength.
    assert np.sqrt(np.mean(np.square(hidden))) > 2.0


def test_common_errors_that_cannot_be_are_refused() -> None:
    seen, joint = drifted(0), with_settings(JOINT)
    assert seen.common is not None
    with pytest.raises(InputError, match="exceed the covariance"):
        joint.estimate(replace(seen, common=3.0 * seen.common))
    with pytest.raises(InputError, match=r"shape \(K, 96, 6\)"):
        joint.estimate(replace(seen, common=seen.common[:, :5]))
