from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimators import BenchModel, EstimateResult, LutEstimator, LutSettings, Status
from estimators import lut_neighbourhood as neighbourhood_module
from tests.estimators.fake_map import fake_map
from tests.estimators.visits import bench_model, materials, visit
from twin.errors import InputError
from twin.spectra import FloatArray

MAPS = (fake_map(0.4), fake_map(0.8))


def model_of(count: int) -> BenchModel:
    return bench_model(count, MAPS)


def one_material(count: int, albedo: float, sigma_t: float, g: float) -> FloatArray:
    return np.tile([albedo, sigma_t, g], (count, 1))


def coverage(result: EstimateResult, truth: FloatArray, level: float) -> FloatArray:
    low, high = result.interval(level)
    held = (truth >= low) & (truth <= high)
    counts = result.identifiable & (result.status < Status.INCONSISTENT)[:, None]
    return np.array([held[counts[:, p], p].mean() for p in range(3)])


def test_plain_interpolation_recovers_the_material() -> None:
    model, truth = model_of(200), materials(200)
    result = LutEstimator(model, LutSettings(draws=0)).estimate(visit(model, truth))
    off = np.abs(result.parameters - truth) / [1.0, 5.0, 1.0]
    assert (np.median(off, axis=0) < [1e-3, 2e-3, 1e-2]).all()
    assert (result.status < Status.INCONSISTENT).mean() > 0.98
    assert np.nanmax(np.abs(result.residual)) < 5e-3


def test_intervals_cover_the_truth_as_often_as_they_say() -> None:
    count = 1500
    model, truth = model_of(count), materials(count)
    result = LutEstimator(model).estimate(visit(model, truth, noise=0.005))
    for level in (0.5, 0.9):
        # 4.5 binomial standard errors, and 2 % for the curvature that stays.
        margin = 4.5 * np.sqrt(level * (1 - level) / count) + 0.02
        assert (np.abs(coverage(result, truth, level) - level) < margin).all()
    error = np.abs(result.parameters - truth) / result.standard_error
    counts = result.identifiable & (result.status < Status.INCONSISTENT)[:, None]
    assert (error[counts] > 5).mean() < 0.005


def test_intervals_of_understated_noise_fail_the_same_check() -> None:
    count = 1500
    model, truth = model_of(count), materials(count)
    measured = visit(model, truth, noise=0.005, understated=2.0)
    result = LutEstimator(model).estimate(measured)
    level = 0.9
    margin = 4.5 * np.sqrt(level * (1 - level) / count) + 0.02
    assert (coverage(result, truth, level) < level - margin).all()


def test_pooled_draws_give_wider_intervals_than_weighted_ones() -> None:
    model, truth = model_of(100), materials(100)
    measured = visit(model, truth, noise=0.005)
    pooled = LutEstimator(model, LutSettings(combine="pool")).estimate(measured)
    weighted = LutEstimator(model).estimate(measured)
    assert np.nanmedian(pooled.standard_error[:, 1] / weighted.standard_error[:, 1]) > 1.2


def test_the_published_procedure_finds_the_material() -> None:
    model, truth = model_of(100), materials(100)
    result = LutEstimator(model, LutSettings.of_the_seed()).estimate(visit(model, truth))
    assert np.nanmedian(np.abs(result.albedo - truth[:, 0])) < 0.01
    assert np.nanmedian(np.abs(result.sigma_t_per_mm / truth[:, 1] - 1)) < 0.01
    assert result.settings["neighbourhood"] == "epsilon"


def test_a_medium_that_does_not_scatter_has_no_g() -> None:
    model = model_of(40)
    truth = one_material(40, 0.0, 1.5, 0.3)
    result = LutEstimator(model).estimate(visit(model, truth, noise=0.005))
    assert (result.status == Status.NOT_IDENTIFIABLE).all()
    assert not result.identifiable[:, 2].any()
    assert result.identifiable[:, :2].all()
    assert (np.abs(result.sigma_t_per_mm - 1.5) < 0.05).all()
    assert (result.albedo < 0.05).all()


def test_an_opaque_sample_says_that_sigma_t_has_only_a_bound() -> None:
    model = model_of(30)
    truth = one_material(30, 0.9, 30.0, 0.5)
    result = LutEstimator(model).estimate(visit(model, truth, noise=0.005))
    assert (result.status == Status.COLLIMATED_LOST).all()
    low, high = result.interval(0.95)
    assert ((low[:, 1] < 30.0) & (high[:, 1] > 30.0)).all()
    assert (result.standard_error[:, 1] > 1.0).all()


def test_a_thin_sample_stands_in_for_a_thick_one_without_light() -> None:
    model = model_of(30)
    truth = one_material(30, 0.8, 14.0, 0.4)
    measured = visit(model, truth, noise=0.005)
    result = LutEstimator(model).estimate(measured)
    assert (result.sample_status[1] == Status.COLLIMATED_LOST).all()
    assert (result.sample_status[0] < Status.COLLIMATED_LOST).all()
    assert (np.abs(result.sigma_t_per_mm - 14.0) < 5 * result.standard_error[:, 1] + 0.1).all()


def test_captures_of_no_material_are_flagged_with_their_distance() -> None:
    model = model_of(20)
    measured = visit(model, materials(20), noise=0.002)
    value = measured.value.copy()
    value[:, 1, 5] = 1.4  # more than a white background can send back
    result = LutEstimator(model).estimate(replace(measured, value=value))
    assert result.status[5] == Status.OUTSIDE_MAP
    assert (result.distance[:, 5] > 0.1).all()
    assert np.isnan(result.covariance[5]).all()
    assert not result.identifiable[5].any()
    assert np.isfinite(result.parameters[5]).all()
    assert result.distance[0, 6] < 0.05


def test_contradictory_captures_are_called_so() -> None:
    model = model_of(20)
    measured = visit(model, materials(20), noise=0.002)
    value = measured.value.copy()
    value[:, [0, 1], 3] = value[:, [1, 0], 3]
    value[:, 2, 4] = 1.2
    result = LutEstimator(model).estimate(replace(measured, value=value))
    assert result.status[[3, 4]].tolist() == [Status.CONTRADICTORY] * 2
    assert np.isnan(result.parameters[[3, 4]]).all()


def test_masked_captures_leave_no_number() -> None:
    model = model_of(20)
    measured = visit(model, materials(20), noise=0.002)
    valid, value = measured.valid.copy(), measured.value.copy()
    covariance = measured.covariance.copy()
    valid[:, 0, 7] = False
    value[:, 0, 7] = np.nan
    covariance[7, [0, 3]] = np.nan
    covariance[7, :, [0, 3]] = np.nan
    valid[0, 2, 8] = False
    changed = replace(measured, value=value, valid=valid, covariance=covariance)
    result = LutEstimator(model).estimate(changed)
    assert result.status[7] == Status.MASKED
    assert np.isnan(result.parameters[7]).all()
    assert result.sample_status[0, 8] == Status.MASKED
    assert result.status[8] < Status.OUTSIDE_MAP
    assert "nothing was masked" in result.messages


def test_a_wrong_thickness_is_seen_as_a_contradiction_between_samples() -> None:
    model = model_of(60)
    truth = materials(60)
    wrong = visit(model, truth, noise=0.002, true_thickness=(0.42, 0.8))
    right = visit(model, truth, noise=0.002)
    estimator = LutEstimator(model)
    torn = estimator.estimate(wrong).status == Status.INCONSISTENT
    assert torn.mean() > 0.8
    assert (estimator.estimate(right).status == Status.INCONSISTENT).mean() < 0.05


def test_captures_without_stated_noise_are_said_to_be() -> None:
    model = model_of(30)
    result = LutEstimator(model).estimate(visit(model, materials(30)))
    assert (result.status == Status.NO_NOISE_STATED).mean() > 0.8


def test_the_result_does_not_depend_on_blocks_and_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    model = model_of(50)
    measured = visit(model, materials(50), noise=0.01)
    whole = LutEstimator(model, LutSettings(threads=1)).estimate(measured)
    monkeypatch.setattr(neighbourhood_module, "BLOCK", 7)
    cut = LutEstimator(model, LutSettings(threads=3)).estimate(measured)
    assert np.array_equal(whole.quantile, cut.quantile, equal_nan=True)
    assert np.array_equal(whole.covariance, cut.covariance, equal_nan=True)
    assert whole.fingerprint == cut.fingerprint


def test_another_seed_moves_the_estimate_less_than_its_uncertainty() -> None:
    model = model_of(50)
    measured = visit(model, materials(50), noise=0.005)
    one = LutEstimator(model).estimate(measured)
    two = LutEstimator(model, LutSettings(seed=1)).estimate(measured)
    shift = np.abs(one.parameters - two.parameters) / one.standard_error
    assert 0.0 < np.nanmedian(shift) < 0.2
    assert one.fingerprint != two.fingerprint


def test_a_fixed_g_uses_two_captures() -> None:
    model = model_of(80)
    truth = materials(80)
    truth[:, 2] = 0.4
    measured = visit(model, truth, noise=0.003)
    valid = measured.valid.copy()
    valid[:, 2] = False
    settings = LutSettings(fixed_g=0.4)
    result = LutEstimator(model, settings).estimate(replace(measured, valid=valid))
    good = result.identifiable[:, 0]
    assert good.mean() > 0.8
    assert np.median(np.abs(result.albedo - truth[:, 0])[good]) < 0.01
    np.testing.assert_allclose(result.g[good], 0.4, atol=1e-9)
    assert np.isnan(result.residual[:, 2]).all()


def test_beers_law_stands_beside_the_estimate() -> None:
    model = model_of(50)
    truth = materials(50)
    result = LutEstimator(model).estimate(visit(model, truth, noise=0.003))
    off = (result.beer_sigma_t_per_mm - truth[:, 1]) / result.beer_standard_error_per_mm
    assert np.median(np.abs(off)) < 2.0


def test_a_single_sample_is_enough() -> None:
    model = bench_model(60, (MAPS[1],), (0.8,))
    truth = materials(60)
    result = LutEstimator(model).estimate(visit(model, truth, noise=0.003))
    good = result.identifiable.all(axis=1)
    assert good.mean() > 0.7
    assert (np.abs(result.sigma_t_per_mm / truth[:, 1] - 1)[good] < 0.05).all()


def test_a_map_of_another_thickness_is_refused() -> None:
    model = bench_model(5, (MAPS[1], MAPS[0]))
    measured = replace(visit(model, materials(5)), thickness_mm=np.array([0.4, 0.8]))
    with pytest.raises(InputError, match=r"0\.8 mm"):
        LutEstimator(model).estimate(measured)


def test_missing_maps_are_refused() -> None:
    with pytest.raises(InputError, match="one appearance map per sample"):
        LutEstimator(bench_model(5, ()))


def test_other_wavelengths_are_refused() -> None:
    model = model_of(5)
    measured = visit(model, materials(5))
    with pytest.raises(InputError, match="wavelengths"):
        LutEstimator(model).estimate(replace(measured, wavelength_nm=model.wavelength_nm + 1))
    broken = model.wavelength_nm.copy()
    broken[2] = np.nan
    with pytest.raises(InputError, match="finite"):
        LutEstimator(model).estimate(replace(measured, wavelength_nm=broken))


@pytest.mark.parametrize(
    "changes", [{"draws": 5}, {"epsilon": 0.0}, {"neighbourhood": "ball"}, {"combine": "mean"}]
)
def test_impossible_settings_are_refused(changes: dict[str, object]) -> None:
    with pytest.raises(InputError, match="expected"):
        LutSettings(**changes)  # type: ignore[arg-type]


def test_without_the_beams_light_an_opaque_sample_tells_the_reduced_albedo_alone() -> None:
    model = model_of(20)
    truth = one_material(20, 0.53, 80.0, -0.2)
    result = LutEstimator(model).estimate(visit(model, truth, noise=0.005))
    assert (result.status == Status.COLLIMATED_LOST).all()
    assert not result.identifiable[:, 1].any()
    low, high = result.interval(0.95)
    assert ((low[:, 0] < 0.53) & (high[:, 0] > 0.53)).all()
    assert (high[:, 0] - low[:, 0] > 0.3).all()
    # More samples without light do not make up for it.
    alone = bench_model(20, MAPS[:1], (0.4,))
    single = LutEstimator(alone).estimate(visit(alone, truth, noise=0.005))
    ratio = result.standard_error[:, 0] / single.standard_error[:, 0]
    assert np.median(ratio) > 0.85


def test_captures_whose_noise_is_not_a_number_are_masked() -> None:
    model = model_of(10)
    measured = visit(model, materials(10), noise=0.005)
    covariance = measured.covariance.copy()
    covariance[4] = np.nan
    result = LutEstimator(model).estimate(replace(measured, covariance=covariance))
    assert result.status[4] == Status.MASKED
    assert np.isnan(result.parameters[4]).all()
    assert not result.identifiable[4].any()
    assert any(message.startswith("1 of 10 wavelengths masked") for message in result.messages)


def test_a_sample_that_contradicts_itself_is_said_to_be_left_out() -> None:
    model = model_of(10)
    measured = visit(model, materials(10), noise=0.005)
    value = measured.value.copy()
    value[1, 2, 3] = 1.4
    result = LutEstimator(model).estimate(replace(measured, value=value))
    assert result.sample_status[:, 3].tolist() == [Status.OK, Status.CONTRADICTORY]
    assert result.status[3] == Status.INCONSISTENT
    assert any(message.startswith("'0.8 mm' left out at 1 of 10") for message in result.messages)
