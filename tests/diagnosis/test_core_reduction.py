"""The reduced space is exact: compared with dense generalised least squares."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diagnosis import Candidate, Channel, Problem, Reduction, Smoothness
from diagnosis.reduction import material_modes
from twin.errors import InputError

W, M, P, K = 6, 5, 2, 3


def small(seed=1, masked=(), **changes):
    generator = np.random.Generator(np.random.Philox(key=[seed, 0]))
    root = generator.standard_normal((W, M, M)) * 0.3 + np.eye(M)
    valid = np.ones((W, M), dtype=bool)
    for place in masked:
        valid[place] = False
    value = generator.standard_normal((W, M))
    value[~valid] = np.nan
    slope = generator.standard_normal((W, M, P))
    problem = Problem(
        wavelength_nm=np.linspace(400, 700, W),
        channels=tuple(Channel("c", f"s{i}") for i in range(M)),
        value=value, valid=valid, independent=root @ np.swapaxes(root, 1, 2),
        common=2.0 * generator.standard_normal((K, W, M)), material=np.zeros((W, P)),
        forward=lambda m, e: np.einsum("wmp,wp->wm", slope, m),
        jacobian=lambda m, e: slope,
        signatures=generator.standard_normal((2, W, M)),
        candidates=(Candidate("a"), Candidate("b")),
    )  # fmt: skip
    return replace(problem, **changes), slope


def dense(problem, slope, prior=None):
    """Covariance and material columns of the valid data, as whole matrices."""
    size = W * M
    covariance = np.zeros((size, size))
    columns = np.zeros((size, W * P))
    for w in range(W):
        rows = slice(w * M, (w + 1) * M)
        covariance[rows, rows] = problem.independent[w]
        columns[rows, w * P : (w + 1) * P] = slope[w]
    flat = problem.common.reshape(K, size)
    covariance += flat.T @ flat
    if prior is not None:
        apart = problem.wavelength_nm[:, None] - problem.wavelength_nm[None, :]
        between = np.exp(-0.5 * (apart / prior.length_nm) ** 2) + 900.0
        for p in range(P):
            own = columns[:, p::P]
            kernel = prior.sd[p] ** 2 * between + prior.nugget[p] ** 2 * np.eye(W)
            covariance += own @ kernel @ own.T
        columns = np.zeros((size, 0))
    keep = problem.valid.ravel()
    return covariance[np.ix_(keep, keep)], columns[keep], keep


def gls_inner(covariance, columns, first, second):
    """first' Q second with Q the projector of generalised least squares."""
    inverse = np.linalg.inv(covariance)
    if columns.shape[1]:
        middle = np.linalg.inv(columns.T @ inverse @ columns)
        inverse = inverse - inverse @ columns @ middle @ columns.T @ inverse
    return first.T @ inverse @ second


@pytest.mark.parametrize("masked", [(), ((0, 1), (3, 4), (3, 2))])
def test_inner_products_are_those_of_dense_least_squares(masked):
    problem, slope = small(masked=masked)
    covariance, columns, keep = dense(problem, slope)
    reduction = Reduction.of(problem, slope)
    data = np.moveaxis(problem.signatures, 0, -1)
    flat = data.reshape(W * M, -1)[keep]
    value = problem.value.ravel()[keep]
    reduced, residual = reduction(data), reduction(problem.value)
    np.testing.assert_allclose(
        reduced.T @ residual, gls_inner(covariance, columns, flat, value), rtol=1e-9
    )
    np.testing.assert_allclose(
        residual @ residual, gls_inner(covariance, columns, value, value), rtol=1e-9
    )
    assert reduction.freedom == keep.sum() - W * P


def test_without_common_modes_the_inner_products_differ():
    problem, slope = small()
    covariance, columns, keep = dense(problem, slope)
    value = problem.value.ravel()[keep]
    white = Reduction.of(replace(problem, common=np.zeros((0, W, M))), slope)(problem.value)
    assert abs(white @ white / gls_inner(covariance, columns, value, value) - 1) > 0.01


def test_smooth_material_is_the_dense_gaussian_process():
    prior = Smoothness(80.0, (0.5, 0.3), (0.05, 0.02))
    problem, slope = small()
    covariance, columns, keep = dense(problem, slope, prior)
    reduced = Reduction.of(problem, slope, prior=prior)(problem.value)
    value = problem.value.ravel()[keep]
    expected = gls_inner(covariance, columns, value, value)
    np.testing.assert_allclose(reduced @ reduced, expected, rtol=1e-3)
    assert material_modes(problem.wavelength_nm, slope, prior).shape[:2] == (W, M)


def test_material_step_is_generalised_least_squares():
    problem, slope = small()
    slope = 100.0 * slope  # the ridge of a step is then nothing
    covariance, columns, _ = dense(problem, slope)
    inverse = np.linalg.inv(covariance)
    expected = np.linalg.solve(
        columns.T @ inverse @ columns, columns.T @ inverse @ problem.value.ravel()
    )
    step = Reduction.of(problem, slope).material_step(problem.value)
    np.testing.assert_allclose(step.ravel(), expected, atol=1e-6)
    sd = Reduction.of(replace(problem, common=np.zeros((0, W, M))), slope).material_sd()
    white = np.linalg.inv(np.linalg.inv(problem.independent[2])[None] * 1.0)[0]
    cov = np.linalg.inv(slope[2].T @ np.linalg.inv(white) @ slope[2])
    np.testing.assert_allclose(sd[2], np.sqrt(np.diag(cov)), rtol=1e-3)


def test_misfit_with_the_material_held_is_the_dense_chi_square():
    problem, slope = small()
    covariance, _, _ = dense(problem, slope)
    value = problem.value.ravel()
    expected = value @ np.linalg.solve(covariance, value)
    assert Reduction.of(problem, slope).misfit(problem.value) == pytest.approx(expected)


def test_simulated_residuals_live_on_the_complement_with_unit_noise():
    problem, slope = small(masked=((2, 2),))
    reduction = Reduction.of(problem, slope)
    drawn = reduction.simulate(np.random.Generator(np.random.Philox(key=3)), 4000)
    energy = np.sum(drawn**2, axis=0)
    # mean of chi-square, standard error sqrt(2 k / draws): five of them
    tolerance = 5 * np.sqrt(2 * reduction.freedom / 4000)
    assert abs(energy.mean() - reduction.freedom) < tolerance
    assert np.abs(drawn.reshape(W, M, -1)[2, 2]).max() < 1e-12


def test_a_covariance_that_is_not_positive_definite_is_refused():
    problem, slope = small(independent=np.ones((W, M, M)))
    with pytest.raises(InputError, match="positive definite"):
        Reduction.of(problem, slope)


def test_shapes_that_do_not_belong_together_are_refused():
    with pytest.raises(InputError, match="shape"):
        small(signatures=np.zeros((3, W, M)))
    with pytest.raises(InputError, match="no numbers"):
        small(value=np.full((W, M), np.nan))
    with pytest.raises(InputError, match="prior"):
        Candidate("a", prior_scale=(0.0,))
