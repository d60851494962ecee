"""Designs: inside their ranges, covering them, the same for the same seed."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from scenarios.stress.design import coordinates, design_of
from tests.stress.tiny import tiny_plan


def shares(plan) -> np.ndarray:
    """The points in the scales of the design, 0 to 1, shape (N, 3)."""
    ranges = np.array([plan.materials.albedo, plan.materials.sigma_t_per_mm, plan.materials.g]).T
    low, high = coordinates(ranges)
    return (coordinates(design_of(plan).material) - low) / (high - low)


@given(
    points=st.integers(2, 200),
    each=st.integers(1, 20),
    visit=st.integers(2, 40),
    seed=st.integers(0, 2**63 - 1),
)
def test_any_random_design_has_its_points_inside_its_ranges(points, each, visit, seed):
    plan = tiny_plan(points=points, albedos_per_medium=each, points_per_visit=visit, seed=seed)
    design = design_of(plan)
    share = shares(plan)
    assert len(design) == points
    assert share.min() > -1e-9
    assert share.max() < 1 + 1e-9
    sizes = np.bincount(design.visit)
    assert sizes.min() >= 2
    assert (np.diff(design.visit) >= 0).all()
    again = design_of(plan)
    assert again.material.tobytes() == design.material.tobytes()


def test_a_random_design_covers_every_part_of_every_range():
    plan = tiny_plan(points=256, albedos_per_medium=8)
    counts = [np.histogram(column, bins=8, range=(0, 1))[0] for column in shares(plan).T]
    # 32 points are expected in each eighth; independent draws would leave 20 or fewer in places.
    assert min(count.min() for count in counts) >= 24
    assert max(count.max() for count in counts) <= 40


def test_independent_draws_fail_that_check():
    random = np.random.Generator(np.random.Philox(key=[1, 2]))
    media = np.repeat(random.random((32, 2)), 8, axis=0)
    counts = [np.histogram(column, bins=8, range=(0, 1))[0] for column in media.T]
    assert min(count.min() for count in counts) < 24


def test_albedos_of_one_medium_lie_in_different_strata():
    plan = tiny_plan(points=64, albedos_per_medium=8, points_per_visit=64)
    share = shares(plan)
    media = {}
    for albedo, *medium in share:
        media.setdefault(tuple(np.round(medium, 9)), []).append(int(albedo * 8))
    assert len(media) == 8
    assert all(sorted(strata) == list(range(8)) for strata in media.values())


def test_seeds_differ():
    one, other = (design_of(tiny_plan(seed=seed)).material for seed in (1, 2))
    assert not np.isclose(one, other).any()


def test_a_grid_is_the_product_of_its_axes():
    materials = {
        "albedo": [0.0, 0.99],
        "sigma_t_per_mm": [1.0, 4.0],
        "g": [0.0, 0.8],
        "grid": [3, 2, 2],
    }
    design = design_of(tiny_plan(materials=materials, points_per_visit=6))
    assert len(design) == 12
    albedo, sigma_t, g = (sorted(set(np.round(column, 9))) for column in design.material.T)
    assert albedo == [0.0, 0.9, 0.99]
    assert sigma_t == [1.0, 4.0]
    assert g == [0.0, 0.8]
    assert len(np.unique(np.round(design.material, 9), axis=0)) == 12


def test_no_parameter_goes_with_the_wavelength():
    plan = tiny_plan(points=200, albedos_per_medium=8, points_per_visit=200)
    share = shares(plan)
    ramp = np.linspace(-1, 1, len(share))
    correlation = [np.corrcoef(ramp, column)[0, 1] for column in share.T]
    assert np.abs(correlation).max() < 0.25
