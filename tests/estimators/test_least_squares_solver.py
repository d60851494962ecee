from __future__ import annotations

import numpy as np
import pytest

from estimators.least_squares_coordinates import Coordinates
from estimators.result import QUANTILE_LEVELS, normal_deviate
from tests.estimators.least_squares_world import generator


def test_normal_equations_solve_least_squares() -> None:
    import jax

    from estimators.least_squares_solver import normal_solution

    random = generator(1)
    matrix, vector = random.standard_normal((50, 9, 3)), random.standard_normal((50, 9))
    matrix *= np.array([1e-6, 1.0, 1e5])
    found = np.asarray(jax.vmap(normal_solution)(matrix, vector))
    expected = np.stack(
        [np.linalg.lstsq(m, v, rcond=None)[0] for m, v in zip(matrix, vector, strict=True)]
    )
    np.testing.assert_allclose(found, expected, rtol=1e-8)
    matrix[:, :, 1] = 0.0
    found = np.asarray(jax.vmap(normal_solution)(matrix, vector))
    assert np.isfinite(found).all()
    assert (found[:, 1] == 0.0).all()


@pytest.mark.parametrize("name", ["rosenbrock", "exponential"])
def test_levenberg_marquardt_solves_known_problems(name: str) -> None:
    import jax.numpy as jnp
    from jax import Array, jacfwd

    from estimators.least_squares_solver import Problem, levenberg_marquardt

    time = np.linspace(0.0, 2.0, 6)

    def model(x: Array) -> Array:
        if name == "rosenbrock":
            zero = jnp.zeros(3)
            return jnp.concatenate(
                [jnp.stack([10 * (x[1] - x[0] ** 2), 1 - x[0], x[2] - 2.0]), zero]
            )
        return x[0] * jnp.exp(-x[1] * time) + x[2]

    def evaluate(x: Array, row: Array, shared: None) -> tuple[Array, Array]:
        return model(x) + 0.0 * row, jacfwd(model)(x)

    truth = np.array([1.0, 1.0, 2.0])
    count = 32
    data = np.broadcast_to(np.asarray(model(jnp.asarray(truth))), (count, 6))
    starts = truth + generator(2).uniform(-0.7, 0.7, (count, 3))
    problem = Problem(np.zeros(count), data, np.broadcast_to(np.eye(6), (count, 6, 6)))
    solved = levenberg_marquardt(evaluate, 200, 1e-9, 1e-9)(jnp.asarray(starts), problem, None)
    assert np.asarray(solved.settled).all()
    np.testing.assert_allclose(solved.place, np.broadcast_to(truth, (count, 3)), atol=1e-6)
    assert np.asarray(solved.chi_square).max() < 1e-12


def test_coordinates_go_there_and_back() -> None:
    random = generator(3)
    coordinates = Coordinates((-0.5, 0.98))
    natural = np.stack(
        [
            random.uniform(0, 1, 100),
            np.exp(random.uniform(-5, 5, 100)),
            random.uniform(-0.5, 0.98, 100),
        ],
        axis=-1,
    )
    place = coordinates.place(natural)
    back, slope = coordinates.natural(place)
    np.testing.assert_allclose(back, natural, rtol=1e-12)
    moved = coordinates.natural(place + 1e-6)[0] - coordinates.natural(place - 1e-6)[0]
    np.testing.assert_allclose(slope, moved / 2e-6, rtol=1e-6, atol=1e-9)


def test_quantiles_are_gaussian_away_from_bounds_and_stay_inside_near_them() -> None:
    coordinates = Coordinates()
    natural = np.array([[0.5, 2.0, 0.1], [0.999, 1e-3, 0.99], [1e-4, 2.0, -0.99]])
    spread = np.array([[0.001, 0.001, 0.001], [0.01, 0.01, 0.1], [0.05, 0.1, 0.3]])
    covariance = spread[:, :, None] ** 2 * np.eye(3)
    quantile = coordinates.quantiles(coordinates.place(natural), natural, covariance)
    gaussian = natural[0] + normal_deviate(QUANTILE_LEVELS)[:, None] * spread[0]
    np.testing.assert_allclose(quantile[:, 0], gaussian, rtol=2e-4)
    assert np.all(np.diff(quantile, axis=0) >= 0.0)
    assert np.all(quantile >= coordinates.low)
    assert np.all(quantile <= coordinates.high)
    # far outside its bounds a likelihood leaves the bound and little more
    outside = coordinates.quantiles(
        coordinates.place(natural[2:]), np.array([[-5.0, 2.0, 0.0]]), covariance[2:]
    )
    assert np.isfinite(outside).all()
    assert 0.0 < outside[-1, 0, 0] < 0.01


def test_intervals_at_a_bound_cover() -> None:
    coordinates, random = Coordinates(), generator(4)
    count, spread = 4000, 0.05
    for truth in (0.0, 0.02, 0.08):
        centre = np.tile([0.5, 2.0, 0.0], (count, 1))
        centre[:, 0] = truth + spread * random.standard_normal(count)
        natural = np.clip(centre, 1e-9, None)
        natural[:, 2] = 0.0
        covariance = np.tile(np.diag([spread**2, 0.01, 0.01]), (count, 1, 1))
        quantile = coordinates.quantiles(coordinates.place(natural), centre, covariance)
        held = (quantile[2, :, 0] <= truth) & (truth <= quantile[8, :, 0])
        assert held.mean() > 0.90 - 4 * np.sqrt(0.09 / count)
