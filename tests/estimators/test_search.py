from __future__ import annotations

from itertools import permutations, product

import numpy as np
import pytest

from estimators.map_grid import MapNodes
from estimators.search import Found, search
from tests.estimators.fake_map import captures, fake_map
from tests.estimators.visits import generator, materials
from twin.spectra import FloatArray

RHO = (np.array([0.05]), np.array([0.99]))


def found(grid: MapNodes, triple: FloatArray, threads: int = 1) -> Found:
    row = np.zeros(len(triple), dtype=np.int32)
    return search(
        grid, triple, row, grid.power(*RHO), (0.05, 0.99), np.ones((1, 3)), threads=threads
    )


def triples(material: FloatArray, thickness: float = 0.8) -> FloatArray:
    value = captures(
        material[:, 0],
        material[:, 1],
        material[:, 2],
        thickness,
        np.full(1, 0.05),
        np.full(1, 0.99),
    ).T
    return np.column_stack([value[:, :2], np.log(value[:, 2])])


def elements(grid: MapNodes) -> FloatArray:
    """Captures at the four corners of every Kuhn tetrahedron, shape (T, 4, 3)."""
    cube = grid._triple(np.arange(grid.third.size), grid.power(*RHO)).reshape(*grid.shape, 3)
    corners = []
    for cell in product(*(range(size - 1) for size in grid.shape)):
        for order in permutations(range(3)):
            place = list(cell)
            four = [cube[tuple(place)]]
            for axis in order:
                place[axis] += 1
                four.append(cube[tuple(place)])
            corners.append(four)
    return np.array(corners)


def test_every_element_is_found_again() -> None:
    grid = MapNodes.of(fake_map(0.8, shape=(20, 30, 8)))
    corners = elements(grid)
    edges = corners[:, 1:] - corners[:, :1]
    sizes = np.prod(np.linalg.norm(edges, axis=2), axis=1)
    # Where nothing scatters the elements are squeezed flat, and some of them folded over.
    solid = np.abs(np.linalg.det(edges)) > 1e-6 * sizes
    share = generator(3).dirichlet(np.ones(4), len(corners))
    inside = np.einsum("tc,tcx->tx", share, corners)
    answer = found(grid, inside)
    assert answer.inside[solid].mean() > 0.99
    assert np.linalg.norm(answer.rest, axis=1).max() < 2e-3
    power = np.repeat(grid.power(*RHO), len(inside), axis=0)
    shown = grid.captures(answer.place, power)
    np.testing.assert_allclose(shown + answer.rest, inside, atol=1e-7)


def test_inside_and_outside_agree_with_a_search_through_all_elements() -> None:
    grid = MapNodes.of(fake_map(0.8, shape=(6, 7, 4)))
    corners = elements(grid)
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    target = low + (high - low) * generator(4).uniform(0, 1, (400, 3))
    edges = (corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1)
    solid = np.abs(np.linalg.det(edges)) > 0
    inverse = np.linalg.inv(edges[solid])
    share = np.einsum("tij,qtj->qti", inverse, target[:, None] - corners[None, solid, 0])
    held = ((share >= 0).all(axis=2) & (share.sum(axis=2) <= 1)).any(axis=1)
    answer = found(grid, target)
    assert 20 < held.sum() < 380
    assert (answer.inside == held).all()


def test_the_distance_of_a_point_outside_is_that_of_the_nearest_element() -> None:
    grid = MapNodes.of(fake_map(0.8, shape=(8, 10, 4)))
    random = generator(5)
    corners = elements(grid)
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    target = low + (high - low) * random.uniform(-0.1, 1.1, (200, 3))
    answer = found(grid, target)
    outside = ~answer.inside
    # Points strewn over the elements: none may be much nearer than the nearest one reported.
    share = random.dirichlet(np.ones(4) * 0.5, (60, len(corners)))
    cloud = np.einsum("ktc,tcx->ktx", share, corners).reshape(-1, 3)
    reported = np.linalg.norm(answer.rest[outside], axis=1)
    nearest = np.array([np.linalg.norm(cloud - t, axis=1).min() for t in target[outside]])
    assert outside.sum() > 30
    assert np.mean(reported <= 1.02 * nearest + 1e-6) > 0.97
    power = np.repeat(grid.power(*RHO), len(target), axis=0)
    shown = grid.captures(answer.place, power)
    np.testing.assert_allclose(shown + answer.rest, target, atol=1e-8)


def test_nodes_are_found_where_they_are() -> None:
    grid = MapNodes.of(fake_map(0.8, shape=(12, 14, 6)))
    node = np.array([[4, 5, 2], [8, 3, 4], [10, 9, 1]])
    power = np.repeat(grid.power(*RHO), 3, axis=0)
    answer = found(grid, grid.captures(node.astype(float), power))
    np.testing.assert_allclose(answer.place, node, atol=1e-6)


def test_the_answer_does_not_depend_on_threads() -> None:
    grid = MapNodes.of(fake_map(0.8))
    triple = triples(materials(6000))
    one, four = found(grid, triple, threads=1), found(grid, triple, threads=4)
    assert all(np.array_equal(a, b) for a, b in zip(one, four, strict=True))


def test_a_finer_map_interpolates_better() -> None:
    material = materials(300)
    errors = []
    for shape in ((12, 16, 5), (24, 32, 10), (48, 64, 20)):
        grid = MapNodes.of(fake_map(0.8, shape=shape))
        estimate = grid.parameters(found(grid, triples(material)).place)
        errors.append(np.median(np.abs(estimate - material), axis=0))
    # Second order: twice as many nodes, a quarter of the error.
    assert (errors[1] < 0.4 * errors[0]).all()
    assert (errors[2] < 0.4 * errors[1]).all()


def test_the_stated_bending_matches_the_error_of_interpolation() -> None:
    grid = MapNodes.of(fake_map(0.8, shape=(20, 30, 6)))
    material = materials(2000)
    place = grid.places(material)
    missed = grid.captures(place, np.repeat(grid.power(*RHO), 2000, axis=0)) - triples(material)
    stated = grid.errors(place, 0.05, 0.99)
    ratio = np.sqrt((missed**2).mean(axis=0) / (stated**2).mean(axis=0))
    assert (ratio[:2] > 0.4).all()
    assert (ratio < 1.5).all()


def test_parameters_and_places_are_inverse() -> None:
    grid = MapNodes.of(fake_map(0.8, shape=(9, 8, 5)))
    place = generator(6).uniform(0, 1, (500, 3)) * (np.array(grid.shape) - 1)
    np.testing.assert_allclose(grid.places(grid.parameters(place)), place, atol=1e-9)
    assert np.isnan(grid.places(np.array([[0.5, 1e3, 0.0]]))).any()


def test_the_two_dimensional_map_stays_in_its_plane() -> None:
    grid = MapNodes.of(fake_map(0.8), fixed_g=0.3)
    material = materials(200)
    material[:, 2] = 0.3
    triple = triples(material)
    triple[:, 2] = 0.3
    answer = found(grid, triple)
    estimate = grid.parameters(answer.place[answer.inside])
    assert answer.inside.mean() > 0.95
    np.testing.assert_allclose(estimate[:, 2], 0.3, atol=1e-9)
    assert np.median(np.abs(estimate[:, 0] - material[answer.inside, 0])) < 0.005


@pytest.mark.parametrize("g", [-0.9, 0.99])
def test_a_fixed_g_outside_the_map_is_refused(g: float) -> None:
    with pytest.raises(ValueError, match="inside the map"):
        MapNodes.of(fake_map(0.8, shape=(4, 4, 3)), fixed_g=g)
