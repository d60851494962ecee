"""The posterior estimator: coverage, nuisances, honesty, the same bytes again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimators import BenchModel, Status
from estimators.posterior import PosteriorEstimator
from estimators.posterior_export import to_inference_data
from estimators.posterior_settings import PosteriorSettings
from estimators.registry import estimator
from tests.estimators.posterior_problems import materials, model_of, visit
from twin.errors import InputError

QUICK = PosteriorSettings(effective_samples=300, draws=400, walkers=20)


def _covered(result, material, coverage):
    low, high = result.interval(coverage)
    return (material >= low) & (material <= high)


@pytest.fixture(scope="module")
def coverage_runs():
    count = 64
    model, material = model_of(count), materials(count, seed=11)
    estimator_ = PosteriorEstimator(model, QUICK)
    honest = estimator_.estimate(visit(model, material, seed=11))
    fewer = model_of(24)
    control = PosteriorEstimator(fewer, QUICK).estimate(
        visit(fewer, material[:24], seed=12, understated=2.0)
    )
    return material, honest, control


@pytest.mark.parametrize("coverage", [0.5, 0.9])
def test_intervals_cover_as_often_as_they_say(coverage_runs, coverage):
    """Within 3.5 binomial standard errors of the wavelengths, parameter by parameter."""
    material, honest, _ = coverage_runs
    known = honest.identifiable & (honest.status < Status.INCONSISTENT)[:, None]
    for column in range(3):
        number = int(known[:, column].sum())
        assert number > 55
        share = _covered(honest, material, coverage)[known[:, column], column].mean()
        tolerance = 3.5 * np.sqrt(coverage * (1 - coverage) / number)
        assert abs(share - coverage) < tolerance


def test_understated_noise_is_found_out(coverage_runs):
    """The control that must fail: noise stated half as large covers far too seldom."""
    material, _, control = coverage_runs
    # where the misfit shows, the interval was widened: the others are judged, as above
    quiet = control.status < Status.INCONSISTENT
    share = _covered(control, material[:24], 0.9)[quiet].mean()
    assert share < 0.9 - 3.5 * np.sqrt(0.9 * 0.1 / quiet.sum())
    assert (control.status == Status.INCONSISTENT).mean() > 0.2


def test_statistics_say_how_it_was_sampled(coverage_runs):
    _, honest, _ = coverage_runs
    statistics = honest.statistics
    assert (statistics["converged"] == 1.0).all()
    assert (statistics["effective_sample_size"] >= 300).all()
    assert (statistics["emulator_error"] < 4 * QUICK.emulator_tolerance).all()
    assert np.all((statistics["acceptance_fraction"] > 0.1) & (honest.draws > -1.0).all())
    assert honest.draws.shape == (400, 64, 3)
    standard = np.sqrt(np.diagonal(honest.covariance, axis1=1, axis2=2))
    assert np.allclose(honest.draws.std(axis=0) / standard, 1.0, atol=0.35)
    assert any("taken as exact" in message for message in honest.messages)


@pytest.fixture(scope="module")
def four():
    model, material = model_of(4), materials(4, seed=3)
    return model, material, visit(model, material, seed=3)


def test_same_seed_same_bytes_and_another_seed_other_draws(four):
    model, _, intensities = four
    first = PosteriorEstimator(model, QUICK).estimate(intensities)
    again = PosteriorEstimator(model, QUICK).estimate(intensities)
    assert first.draws.tobytes() == again.draws.tobytes()
    assert first.quantile.tobytes() == again.quantile.tobytes()
    other = PosteriorEstimator(model, replace(QUICK, seed=1)).estimate(intensities)
    assert not np.array_equal(other.draws, first.draws)
    assert np.allclose(other.parameters, first.parameters, atol=0.5 * first.standard_error.max())


def test_a_subset_of_the_wavelengths_gives_the_same_bytes(four):
    model, _, intensities = four
    whole = PosteriorEstimator(model, QUICK).estimate(intensities)
    some = np.array([1, 3])
    small = BenchModel.of(model.bench, model.samples, model.wavelength_nm[some])
    cut = replace(
        intensities,
        wavelength_nm=intensities.wavelength_nm[some],
        value=intensities.value[..., some],
        covariance=intensities.covariance[some],
        valid=intensities.valid[..., some],
    )
    part = PosteriorEstimator(small, QUICK).estimate(cut)
    assert part.draws.tobytes() == np.ascontiguousarray(whole.draws[:, some]).tobytes()


@given(order=st.permutations([0, 1]))
@settings(deadline=None, derandomize=True, max_examples=2)
def test_the_order_of_the_samples_changes_nothing_but_noise(four, order):
    model, _, intensities = four
    usual = PosteriorEstimator(model, QUICK).estimate(intensities)
    turned = BenchModel.of(model.bench, [model.samples[s] for s in order], model.wavelength_nm)
    rows = np.concatenate([np.arange(3 * s, 3 * s + 3) for s in order])
    moved = replace(
        intensities,
        sample_names=tuple(intensities.sample_names[s] for s in order),
        thickness_mm=intensities.thickness_mm[order],
        value=intensities.value[order],
        covariance=intensities.covariance[:, rows][:, :, rows],
        valid=intensities.valid[order],
    )
    other = PosteriorEstimator(turned, QUICK).estimate(moved)
    z = (other.parameters - usual.parameters) / usual.standard_error
    # medians of two chains of 300 effective samples: 1.25 sqrt(2 / 300) each
    assert np.abs(z).max() < 4.5 * 1.25 * np.sqrt(2.0 / 300)
    assert np.allclose(other.standard_error / usual.standard_error, 1.0, atol=0.3)


UNSURE = {"thickness_relative": 0.02, "rho_white_relative": 0.005, "beam_drift": 0.003}


def test_integrated_nuisances_agree_with_sampled_ones():
    model, material = model_of(1), materials(1, seed=5)
    intensities = visit(model, material, seed=5, noise=0.005, floor=5e-4)
    closed = PosteriorEstimator(model, replace(QUICK, **UNSURE)).estimate(intensities)
    explicit = PosteriorEstimator(
        model, replace(QUICK, **UNSURE, sample_nuisances=True, effective_samples=800)
    ).estimate(intensities)
    exact = PosteriorEstimator(model, QUICK).estimate(intensities)
    assert (explicit.statistics["converged"] == 1.0).all()
    shift = np.abs(closed.parameters - explicit.parameters) / explicit.standard_error
    assert shift.max() < 0.35
    assert np.allclose(closed.standard_error / explicit.standard_error, 1.0, atol=0.2)
    # the comparison can fail: without nuisances sigma_t would be far too sure
    assert (exact.standard_error[:, 1] < 0.6 * explicit.standard_error[:, 1]).all()


def test_a_thickness_wrong_by_its_uncertainty_is_covered():
    model, material = model_of(4), materials(4, seed=9)
    intensities = visit(model, material, seed=9, noise=0.002, floor=2e-4, thickness_factor=1.02)
    unsure = replace(QUICK, thickness_relative=0.02)
    result = PosteriorEstimator(model, unsure).estimate(intensities)
    assert _covered(result, material, 0.99).all()
    confident = PosteriorEstimator(model, QUICK).estimate(intensities)
    assert not _covered(confident, material, 0.99)[:, 1].any()


def test_what_cannot_be_known_stays_wide():
    """No scattering: g has no meaning. The prior's own 90 % interval is 1.07 wide."""
    model = model_of(4)
    material = np.array([[1e-4, 1.0, 0.5], [0.0, 2.0, 0.0], [0.0, 0.05, 0.9], [0.8, 2.0, 0.5]])
    result = PosteriorEstimator(model, QUICK).estimate(visit(model, material, seed=1))
    low, high = result.interval(0.9)
    assert (high[:3, 2] - low[:3, 2] > 0.55).all()
    assert (result.status[:3] == Status.NOT_IDENTIFIABLE).all()
    assert not result.identifiable[:3, 2].any()
    assert result.identifiable[3].all()
    assert result.status[3] == Status.OK
    assert _covered(result, material, 0.99)[3].all()


def test_faults_of_the_data_are_said(four):
    model, material, _ = four
    intensities = visit(model, material, seed=3)
    value, valid = intensities.value.copy(), intensities.valid.copy()
    covariance = intensities.covariance.copy()
    value[:, 0, 0] += 0.5  # black above white
    valid[:, :, 1] = False
    value[:, :, 1] = np.nan
    covariance[1] = np.nan
    value[:, 2, 2] = 0.0  # the collimated light lost
    covariance[3] = 0.0
    broken = replace(intensities, value=value, valid=valid, covariance=covariance)
    result = PosteriorEstimator(model, QUICK).estimate(broken)
    assert result.status[0] == Status.CONTRADICTORY
    assert result.status[1] == Status.MASKED
    assert result.status[2] >= Status.COLLIMATED_LOST
    assert result.status[3] in (Status.NO_NOISE_STATED, Status.INCONSISTENT)
    assert np.isnan(result.parameters[:2]).all()
    assert np.isfinite(result.parameters[2:]).all()
    for code in result.status:
        assert any(Status(code).text in message for message in result.messages)
    nothing = replace(broken, valid=np.zeros_like(valid))
    blank = PosteriorEstimator(model, QUICK).estimate(nothing)
    assert (blank.status == Status.MASKED).all()


def test_contradicting_samples_widen_the_interval(four):
    model, _, intensities = four
    value = intensities.value.copy()
    value[1, 2] *= 1.2
    torn = PosteriorEstimator(model, QUICK).estimate(replace(intensities, value=value))
    usual = PosteriorEstimator(model, QUICK).estimate(intensities)
    assert (torn.status == Status.INCONSISTENT).any()
    some = torn.status == Status.INCONSISTENT
    assert (torn.standard_error[some, 0] > 1.5 * usual.standard_error[some, 0]).all()


def _ends_together(result):
    """Correlation of ln sigma_t at the first and the last wavelength."""
    return np.corrcoef(np.log(result.draws[:, [0, -1], 1]).T)[0, 1]


def test_joint_spectra_are_surer_and_cover():
    count = 12
    model = model_of(count)
    share = np.linspace(0.0, 1.0, count)
    material = np.stack([0.9 - 0.2 * share, 2.0 - share, 0.7 - 0.2 * share], axis=-1)
    intensities = visit(model, material, seed=4)
    single = PosteriorEstimator(model, QUICK).estimate(intensities)
    joint = PosteriorEstimator(model, replace(QUICK, joint=True, knots=4)).estimate(intensities)
    assert (joint.statistics["converged"] == 1.0).all()
    assert (joint.status == Status.OK).all()
    assert (joint.standard_error < 0.9 * single.standard_error).mean() > 0.9
    z = (joint.parameters - material) / joint.standard_error
    assert np.abs(z).max() < 4.0
    unsure = replace(QUICK, joint=True, knots=4, thickness_relative=0.02)
    wide = PosteriorEstimator(model, unsure).estimate(intensities)
    # a thickness common to all wavelengths does not average out
    assert (wide.standard_error[:, 1] > 0.009 * wide.sigma_t_per_mm).all()
    assert _ends_together(wide) > 0.6
    assert abs(_ends_together(joint)) < 0.4


def test_the_tree_is_read_by_arviz(four):
    arviz_base = pytest.importorskip("arviz_base", reason="ArviZ is not installed")
    model, _, intensities = four
    result = PosteriorEstimator(model, QUICK).estimate(intensities)
    tree = arviz_base.convert_to_datatree(to_inference_data(result, intensities))
    assert set(tree.children) >= {"posterior", "sample_stats", "observed_data", "constant_data"}
    assert dict(tree["posterior"].sizes) == {"chain": 4, "draw": 100, "wavelength_nm": 4}
    table = arviz_base.extract(tree, var_names=["g"])
    assert np.isclose(float(table.mean()), float(result.draws[..., 2].mean()))
    with pytest.raises(InputError):
        to_inference_data(replace(result, draws=None), intensities)


def test_the_corner_plot_shows_every_pair(four):
    from scenarios.report.corner_plot import corner_figure, draw_corner

    model, material, intensities = four
    result = PosteriorEstimator(model, QUICK).estimate(intensities)
    figure = corner_figure(result, 2, truth=material[2])
    assert len(figure.axes) == 9
    assert draw_corner(result, 2).startswith("<svg")
    with pytest.raises(InputError):
        corner_figure(result, 4)


def test_it_is_in_the_registry_and_cheap_without_samples():
    model = replace(model_of(3), samples=(), bench=None)
    made = estimator("posterior", model, seed=5)
    assert made.name == "posterior"
    with pytest.raises(InputError):
        estimator("posterior", model, walker=5)
