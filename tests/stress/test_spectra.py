"""Designs of smooth spectra: inside their ranges, smooth, one in every visit, drift and all."""

from __future__ import annotations

import numpy as np
import pytest

from scenarios.stress import design_of
from scenarios.stress.simulate import samples_of, take, visit_bench, visit_wavelengths
from tests.stress.tiny import tiny_plan
from twin.errors import InputError
from twin.transport import NoiselessCaptures

COUNT = 16


def spectra_plan(**changes):
    table = {"materials": {"spectra": True}, "points": 4 * COUNT, "points_per_visit": COUNT}
    return tiny_plan(**(table | changes))


def roughness(spectrum: np.ndarray) -> np.ndarray:
    """Second differences over the whole change of ln sigma_t, logit albedo and ln(1 - g), (3,)."""
    albedo, sigma_t, g = spectrum.T
    rows = np.stack([np.log(albedo / (1 - albedo)), np.log(sigma_t), np.log(1 - g)])
    return np.abs(np.diff(rows, 2)).max(axis=1) / (np.ptp(rows, axis=1) + 1e-3)


def test_spectra_stay_inside_their_ranges_and_are_smooth() -> None:
    plan = spectra_plan(points=20 * COUNT)
    design = design_of(plan)
    ranges = (plan.materials.albedo, plan.materials.sigma_t_per_mm, plan.materials.g)
    for column, (low, high) in zip(design.material.T, ranges, strict=True):
        assert low <= column.min() < column.max() <= high
    assert (np.bincount(design.visit) == COUNT).all()
    rough = [roughness(design.material[design.visit == v]) for v in range(design.visits)]
    assert np.median(rough) < 0.2
    assert np.max(rough) < 1.0
    # The control: the same materials in another order.
    order = np.random.Generator(np.random.Philox(key=[1, 2])).permutation(COUNT)
    shuffled = [roughness(design.material[design.visit == v][order]) for v in range(design.visits)]
    assert np.median(shuffled) > 0.5


def test_spectra_spread_over_the_map_and_follow_the_seed() -> None:
    plan = spectra_plan(points=20 * COUNT)
    albedo, sigma_t, g = design_of(plan).material.T
    assert albedo.min() < 0.4
    assert albedo.max() > 0.98
    assert sigma_t.min() < 0.6
    assert sigma_t.max() > 7.0
    assert g.min() < 0.2
    assert g.max() > 0.8
    assert design_of(plan).material.tobytes() == design_of(plan).material.tobytes()
    other = design_of(spectra_plan(points=20 * COUNT, seed=2)).material
    assert not np.isclose(other, design_of(plan).material).any()


@pytest.mark.parametrize(("points", "sizes"), [(40, [16, 16, 8]), (33, [16, 17]), (7, [7])])
def test_every_point_has_a_visit_of_two_wavelengths_or_more(points, sizes) -> None:
    design = design_of(spectra_plan(points=points))
    assert np.bincount(design.visit).tolist() == sizes


def test_ranges_without_room_and_a_grid_of_spectra_are_refused() -> None:
    narrow = {"spectra": True, "albedo": [0.5, 0.5001], "sigma_t_per_mm": [1.0, 1.001]}
    with pytest.raises(InputError, match="no smooth spectrum"):
        design_of(spectra_plan(materials=narrow))
    with pytest.raises(InputError, match="either a grid or spectra"):
        spectra_plan(materials={"spectra": True, "grid": [2, 2, 2]})


def drift_correlation(spectra: bool) -> float:
    """How well errors of neighbouring wavelengths go together, lamps drifting much."""
    plan = spectra_plan(materials={"spectra": spectra}, points=COUNT)
    bench = plan.benches["bench"]
    instrument = bench.instrument.model_copy(update={"lamp_walk": 0.01, "lamp_tilt_walk": 0.0})
    bench = visit_bench(bench.model_copy(update={"instrument": instrument}), COUNT)
    wavelength = visit_wavelengths(bench)
    flat, nothing = np.full(COUNT, 0.4), np.zeros(COUNT)
    rho = (np.full(COUNT, 0.05), np.full(COUNT, 0.99))
    light = [
        NoiselessCaptures(
            wavelength_nm=wavelength,
            black=flat,
            white=flat + 0.2,
            collimated=flat,
            black_se=nothing,
            white_se=nothing,
            collimated_se=nothing,
            rho_black=rho[0],
            rho_white=rho[1],
            white_reference_factor=1.0,
        )
        for _ in samples_of(plan)
    ]
    material = np.tile([0.9, 2.0, 0.5], (COUNT, 1))
    pairs = []
    for seed in range(12):
        taken = take(plan, bench, material, light, seed=seed).intensities
        if spectra:
            assert taken.common is not None
            held = np.einsum("kwi,kwi->wi", taken.common, taken.common)
            share = held / np.diagonal(taken.covariance, axis1=1, axis2=2)
            assert np.median(share) > 0.9
            assert share.max() <= 1.0 + 1e-9
        else:
            assert taken.common is None
        error = taken.value[0, 2, 4:12] / 0.4 - 1.0  # where the lamps are bright
        pairs.append((error[:-1], error[1:]))
    first, second = np.concatenate(pairs, axis=1)
    return float(np.corrcoef(first, second)[0, 1])


def test_the_wavelengths_of_a_spectrum_share_the_lamps_drift() -> None:
    assert drift_correlation(spectra=True) > 0.9
    assert abs(drift_correlation(spectra=False)) < 0.35
