from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import estimators
from estimators import BenchModel, Status
from estimators.least_squares import LeastSquaresSettings
from tests.estimators.least_squares_world import (
    COUNT,
    captures,
    estimator,
    generator,
    materials,
    smooth_material,
    visit,
    with_settings,
)
from twin.errors import InputError
from twin.measurement.relative import RelativeIntensities

REPEATS = 6


def test_exact_captures_give_the_material_back() -> None:
    made, truth = estimator(), materials(COUNT)
    result = made.estimate(visit(made, truth, noise=1e-7, floor=1e-9))
    # the engine's stated error is all there is: far below it the fit must agree with itself
    assert np.all(np.abs(result.parameters - truth) < 0.2 * result.standard_error)
    assert (result.status == Status.OK).all()


def _covered(understated: float) -> tuple[np.ndarray, np.ndarray]:
    made, held, pulls = estimator(), [], []
    for seed in range(REPEATS):
        truth = materials(COUNT, seed)
        result = made.estimate(visit(made, truth, seed=seed, understated=understated))
        low, high = result.interval(0.90)
        held.append((low <= truth) & (truth <= high))
        pulls.append((result.parameters - truth) / result.standard_error)
    return np.concatenate(held), np.concatenate(pulls)


def test_intervals_cover_and_errors_are_unbiased() -> None:
    held, pulls = _covered(1.0)
    count = len(held)
    margin = 4.0 * np.sqrt(0.09 / count)
    assert np.all(np.abs(held.mean(axis=0) - 0.90) < margin), held.mean(axis=0)
    assert np.all(np.abs(pulls.mean(axis=0)) < 4.0 / np.sqrt(count)), pulls.mean(axis=0)


def test_intervals_of_an_understated_noise_do_not_cover() -> None:
    held, _ = _covered(2.0)
    # inconsistent wavelengths are widened, which cannot make good for noise understated by two
    assert np.all(held.mean(axis=0) < 0.90 - 4.0 * np.sqrt(0.09 / len(held)))


def test_chi_square_follows_its_degrees_of_freedom() -> None:
    made = estimator()
    result = made.estimate(visit(made, materials(COUNT), seed=11))
    assert (result.statistics["degrees_of_freedom"] == 3).all()
    mean = result.statistics["chi_square"].mean()
    assert abs(mean - 3.0) < 4.0 * np.sqrt(6.0 / COUNT)


def test_the_derivatives_are_those_of_finite_differences() -> None:
    made = estimator()
    engine, _ = made.engine()
    place = engine.coordinates.place(materials(COUNT))
    index = np.arange(COUNT)
    _, slope = engine.evaluate(place, index)
    step = 1e-5
    for p in range(3):
        shift = step * np.eye(3)[p]
        high = engine.evaluate(place + shift, index)[0]
        low = engine.evaluate(place - shift, index)[0]
        np.testing.assert_allclose(slope[..., p], (high - low) / (2 * step), atol=1e-7)


def test_the_quick_way_ends_where_levenberg_marquardt_does() -> None:
    from estimators.least_squares_fit import fit
    from estimators.least_squares_input import prepare

    made = estimator()
    engine, grid = made.engine()
    for truth in (materials(COUNT), smooth_material(COUNT)):
        seen = prepare(visit(made, truth), engine.forward.relative_error, made.settings)
        found = fit(engine, grid, seen.whitened, made.model.wavelength_nm, 3)
        index = np.arange(COUNT)
        exact = engine.solve(
            found.place, index, seen.whitened.data, seen.whitened.whitener, quick=False
        )
        assert exact.settled.all()
        lean = seen.whitened.whitener @ found.slope
        away = np.einsum("wmp,wp->wm", lean, exact.place - found.place)
        assert np.linalg.norm(away, axis=1).max() < 0.2  # standard deviations


def test_smooth_spectra_start_from_their_neighbours() -> None:
    made = estimator()
    result = made.estimate(visit(made, smooth_material(COUNT)))
    # one exact evaluation for most: the anchors alone ran the quick solver
    assert np.median(result.statistics["steps"]) == 1
    assert (result.statistics["starts_agreeing"] >= 1).all()


def test_the_result_does_not_depend_on_threads() -> None:
    made = estimator()
    seen = visit(made, materials(COUNT))
    single = with_settings(LeastSquaresSettings(threads=1))
    engine, grid = made.engine()
    alone = engine.with_rows(lambda rows: rows)  # a copy that is compiled already
    vars(alone)["cores"] = 1
    single._built = alone, grid
    one = single.estimate(seen)
    again = made.estimate(seen)
    assert one.fingerprint == again.fingerprint
    np.testing.assert_array_equal(one.parameters, again.parameters)
    np.testing.assert_array_equal(one.quantile, again.quantile)


def _bad(change: Callable[[RelativeIntensities], None]) -> RelativeIntensities:
    made = estimator()
    seen = visit(made, smooth_material(COUNT))
    seen = replace(
        seen,
        value=seen.value.copy(),
        covariance=seen.covariance.copy(),
        valid=seen.valid.copy(),
    )
    change(seen)
    return seen


def test_masked_captures_are_left_out() -> None:
    def mask(seen: RelativeIntensities) -> None:
        seen.value[0, 0, 5] = np.nan
        seen.valid[0, 0, 5] = False
        seen.covariance[5, 0, :] = seen.covariance[5, :, 0] = np.nan
        seen.valid[:, :, 9] = False

    result = estimator().estimate(_bad(mask))
    truth = smooth_material(COUNT)
    assert result.status[5] == Status.OK
    assert result.statistics["degrees_of_freedom"][5] == 2
    assert np.all(np.abs(result.parameters[5] - truth[5]) < 5 * result.standard_error[5])
    assert result.status[9] == Status.MASKED
    assert np.isnan(result.parameters[9]).all()
    assert not result.identifiable[9].any()
    assert np.isnan(result.residual[0, 0, 5])


def test_fewer_captures_than_unknowns_are_said() -> None:
    def mask(seen: RelativeIntensities) -> None:
        seen.valid[:, :2, 20] = False

    result = estimator().estimate(_bad(mask))
    assert result.status[20] == Status.NOT_IDENTIFIABLE
    assert result.identifiable[20].tolist()[::2] == [False, False]
    assert any("2 usable captures for 3 unknowns" in text for text in result.messages)
    low, high = result.interval(0.9)
    assert high[20, 2] - low[20, 2] > 1.0


def test_contradictions_are_said() -> None:
    def contradict(seen: RelativeIntensities) -> None:
        seen.value[:, 0, 3], seen.value[:, 1, 3] = 0.8, 0.4
        seen.value[:, 2, 7] = 1.2
        seen.value[1, 2, 11] = 1.2

    result = estimator().estimate(_bad(contradict))
    assert result.status[[3, 7]].tolist() == [Status.CONTRADICTORY] * 2
    assert np.isnan(result.parameters[[3, 7]]).all()
    assert result.sample_status[:, 11].tolist() == [Status.OK, Status.CONTRADICTORY]
    truth = smooth_material(COUNT)[11]
    assert np.all(np.abs(result.parameters[11] - truth) < 5 * result.standard_error[11])
    assert any("darker over white" in text for text in result.messages)


def test_zero_noise_is_said() -> None:
    def quiet(seen: RelativeIntensities) -> None:
        seen.covariance[4] = 0.0

    result = estimator().estimate(_bad(quiet))
    # the noise that is there, but not stated, may show as an improbable chi-square as well
    assert result.status[4] in (Status.NO_NOISE_STATED, Status.INCONSISTENT)
    silent = replace(
        visit(estimator(), smooth_material(COUNT), noise=1e-9, floor=1e-12),
        covariance=np.zeros((COUNT, 6, 6)),
    )
    assert (estimator().estimate(silent).status == Status.NO_NOISE_STATED).all()


def test_an_improbable_chi_square_widens_the_interval() -> None:
    def shift(seen: RelativeIntensities) -> None:
        seen.value[1, 1, 30] *= 1.15

    plain = estimator().estimate(_bad(lambda seen: None))
    result = estimator().estimate(_bad(shift))
    assert result.status[30] == Status.INCONSISTENT
    ratio = np.sqrt(result.statistics["chi_square"][30] / 3.0)
    assert ratio > 2.0
    assert result.standard_error[30, 0] > 0.5 * ratio * plain.standard_error[30, 0]


def test_where_nothing_is_known_nothing_is_claimed() -> None:
    made = estimator()
    truth = smooth_material(COUNT)
    truth[:30] = [0.9, 80.0, 0.5]  # opaque: only similar media can be told apart
    truth[30:60] = [1e-6, 2.0, 0.5]  # no scattering: g has no meaning
    result = made.estimate(visit(made, truth, noise=0.005))
    opaque, clear = slice(0, 30), slice(30, 60)
    assert not result.identifiable[clear, 2].any()
    # cautious: sigma_t is let go where it leans on a g that has no meaning
    assert result.identifiable[clear, 1].mean() > 0.5
    assert np.all(np.abs(result.parameters - truth)[clear, 1] < 5 * result.standard_error[clear, 1])
    assert (result.status[clear] >= Status.AT_BOUND).all()
    assert (result.status[opaque] == Status.COLLIMATED_LOST).mean() > 0.5
    wrong = np.abs(result.parameters - truth) > 5 * result.standard_error
    assert (wrong & result.identifiable).mean() <= 0.01
    low, high = result.interval(0.9)
    assert np.all((low >= [0, 0, -1]) & (high[:, [0, 2]] <= 1).all(axis=1)[:, None])
    assert np.mean(low[clear, 0] <= 1e-6) > 0.8
    assert any("g is not identifiable" in text for text in result.messages)


def test_correlated_captures_are_whitened() -> None:
    made, truth = estimator(), materials(COUNT, 3)
    exact = captures(made, truth)
    random = generator(5, 2)
    shared = 0.02 * random.standard_normal(COUNT)
    noise = 0.002 * random.standard_normal(exact.shape)
    flat = exact.reshape(6, COUNT).T
    panels = flat * np.array([1, 1, 0, 1, 1, 0])
    covariance = 0.02**2 * panels[:, :, None] * panels[:, None, :]
    covariance += (0.002 * flat[:, :, None]) ** 2 * np.eye(6)
    value = exact * (1 + noise)
    value[:, :2] += shared * exact[:, :2]
    seen = replace(visit(made, truth), value=value, covariance=covariance)
    result = made.estimate(seen)
    mean = result.statistics["chi_square"].mean()
    assert abs(mean - 3.0) < 4.0 * np.sqrt(6.0 / COUNT)
    blind = np.zeros_like(covariance)
    index = np.arange(6)
    blind[:, index, index] = covariance[:, index, index]
    wrong = made.estimate(replace(seen, covariance=blind))
    assert wrong.statistics["chi_square"].mean() < 2.0


def test_the_joint_mode_is_nearer_and_knows_it() -> None:
    made, truth = estimator(), smooth_material(COUNT)
    joint = with_settings(LeastSquaresSettings(smoothness_nm=40.0))
    errors, held = [], []
    for seed in range(4):
        seen = visit(made, truth, noise=0.02, seed=seed)
        alone, together = made.estimate(seen), joint.estimate(seen)
        errors.append([(alone.parameters - truth) ** 2, (together.parameters - truth) ** 2])
        low, high = together.interval(0.90)
        held.append((low <= truth) & (truth <= high))
        assert np.median(together.standard_error / alone.standard_error) < 0.9
    single, smooth = np.sqrt(np.mean(errors, axis=(0, 2)))
    assert np.all(smooth < 0.8 * single)
    # neighbours share their errors: about a tenth of the wavelengths are independent
    assert abs(np.mean(held) - 0.90) < 4.0 * np.sqrt(0.09 / (0.1 * np.size(held)))


def test_the_smoothness_prior_does_not_depend_on_the_grid() -> None:
    from estimators.least_squares_banded import bend, bending

    costs = []
    for count in (101, 401):
        wavelength = np.linspace(400.0, 700.0, count)
        wavelength[1:-1] += 0.2 * np.sin(np.arange(1, count - 1)) * 300.0 / count
        x = np.sin(wavelength / 40.0)[:, None] * np.ones(3)
        costs.append(float(np.sum(x * bend(bending(wavelength, 30.0)[..., None], x))))
        line = (1.0 + 0.01 * wavelength)[:, None] * np.ones(3)
        assert (
            np.abs(np.sum(line * bend(bending(wavelength, 30.0)[..., None], line)))
            < 1e-6 * costs[-1]
        )
    square = 150.0 - 10.0 * (np.sin(35.0) - np.sin(20.0))  # of the sine, over 300 nm
    integral = 3 * 30.0**3 / 40.0**4 * square
    np.testing.assert_allclose(costs, integral, rtol=0.05)


def test_a_factory_needs_no_samples_and_wrong_options_are_refused() -> None:
    empty = BenchModel(
        sample_names=(),
        wavelength_nm=np.array([550.0]),
        n=np.empty((0, 1)),
        rho_black=np.zeros(1),
        rho_white=np.ones(1),
    )
    made = estimators.estimator("least-squares", empty, g_range=[-0.5, 0.98])
    assert made.name == "least-squares"
    for options in (
        {"starts": 0},
        {"g_range": (0.5, 0.2)},
        {"smoothness_nm": -1.0},
        {"unidentifiable_share": 2.0},
        {"sigma_t_range_per_mm": (0.0, 1.0)},
    ):
        with pytest.raises(InputError):
            LeastSquaresSettings(**options)  # type: ignore[arg-type]


def test_a_covariance_that_is_none_is_refused() -> None:
    def spoil(seen: RelativeIntensities) -> None:
        seen.covariance[2, 0, 1] = seen.covariance[2, 1, 0] = 10.0

    with pytest.raises(InputError, match="positive semidefinite"):
        estimator().estimate(_bad(spoil))
