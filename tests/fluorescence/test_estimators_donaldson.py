"""The estimator of Donaldson matrices: accuracy, coverage with a control, flags, bad input."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimators.fluorescence import FluorescenceStatus, fluorescence_estimator, fluorescence_names
from estimators.fluorescence.background import BackgroundPrior, kernels
from estimators.fluorescence.cells import Captures, gather
from estimators.fluorescence.donaldson import DonaldsonEstimator, DonaldsonSettings
from estimators.fluorescence.products import Products, ShapePrior, log_peak
from tests.fluorescence.cases import BELOW, bell, data, material, system
from twin.errors import InputError
from twin.fluorescence.donaldson import GRID_NM, DonaldsonMatrix
from twin.fluorescence.system import FluorescenceData, FluorescenceSystem


@pytest.mark.parametrize("channels", ["spectrometer", "chip"])
def test_matrix_is_recovered_and_covered(channels: str) -> None:
    bench = system(channels)
    truth = np.array([material(seed) for seed in range(12)])
    results = DonaldsonEstimator().estimate_batch(
        [data(matrix, bench, seed) for seed, matrix in enumerate(truth)]
    )
    estimate = np.array([result.matrix for result in results])
    error = np.sqrt(((estimate - truth)[:, BELOW] ** 2).mean(axis=1))
    floor = np.sqrt((truth[:, BELOW] ** 2).mean(axis=1))
    assert np.median(error / floor) < 0.2
    assert np.all(estimate[:, ~BELOW & ~np.eye(31, dtype=bool)] == 0.0)
    quantile = np.array([result.quantile for result in results])
    inside = (truth >= quantile[:, 0] - 1e-9) & (truth <= quantile[:, -1] + 1e-9)
    assert inside[:, BELOW].mean() >= 0.85
    assert np.einsum("bii->bi", inside).mean() >= 0.80


def test_reflectances_of_the_prior_are_covered_and_the_control_is_not() -> None:
    """Drawn from the prior: 90 % intervals cover 90 %; with the noise understated by two, less.

    Understated noise is noticed, and the interval widened: the control takes that back.
    """
    bench = system()
    # Narrow enough that no reflectance drawn from it leaves 0 to 1, where intervals end.
    prior = BackgroundPrior(reflectance=((0.1, 50.0),), roughness=(3e-4,))
    settings = DonaldsonSettings(products=0, directions=10_000, background=prior)
    captures = gather([data(material(1), bench)])
    drawn = kernels(captures.cells, prior).draws(40, 5)
    shares = {}
    for understated in (1.0, 2.0):
        given, truth = [], []
        for seed in range(40):
            reflectance = prior.reflectance_mean + drawn.diagonal[seed]
            clean = bench.captures(np.diag(reflectance))
            random = np.random.Generator(np.random.Philox(key=seed))
            given.append(
                FluorescenceData(
                    bench,
                    clean + 0.03 * random.standard_normal(clean.shape),
                    np.full(clean.shape, (0.03 / understated) ** 2),
                    np.zeros((0, *clean.shape)),
                    np.ones(clean.shape, dtype=bool),
                )
            )
            truth.append(reflectance)
        results = DonaldsonEstimator(settings).estimate_batch(given)
        band = np.array([result.reflectance_band for result in results])
        if understated == 2.0:
            assert all(r.status == FluorescenceStatus.INCONSISTENT for r in results)
            middle = np.array([result.reflectance for result in results])[:, None]
            excess = [r.statistics["chi_square"] / r.statistics["directions"] for r in results]
            band = middle + (band - middle) / np.sqrt(excess)[:, None, None]
        target = np.array(truth)
        shares[understated] = ((target >= band[:, 0]) & (target <= band[:, 1])).mean()
    # 40 materials of about 12 independent places each: a standard error of 0.015.
    assert shares[1.0] == pytest.approx(0.9, abs=0.05)
    assert shares[2.0] < 0.85


def test_dark_region_is_flagged_and_wide() -> None:
    full = system()
    half = FluorescenceSystem(full.illuminants[2:7], full.sensitivities)
    seen, blind = (
        DonaldsonEstimator().estimate(data(material(3), bench)) for bench in (full, half)
    )
    violet = blind.undetermined & (blind.excitation_nm[None, :] <= 430.0)
    assert blind.status == FluorescenceStatus.UNDETERMINED_CELLS
    assert violet.sum() > 20
    assert not seen.undetermined[violet].all()
    assert any("undetermined" in message for message in blind.messages)
    inside = violet & BELOW
    width = (blind.quantile[-1] - blind.quantile[0])[inside]
    assert np.median(width) > 0.01
    assert np.median(width) > 3.0 * np.median((seen.quantile[-1] - seen.quantile[0])[inside])


def test_same_seed_same_numbers_and_batch_equals_single() -> None:
    bench = system("chip")
    several = [data(material(seed), bench, seed) for seed in range(3)]
    estimator = DonaldsonEstimator()
    one, again = estimator.estimate(several[0]), estimator.estimate(several[0])
    assert np.array_equal(one.matrix, again.matrix)
    assert np.array_equal(one.quantile, again.quantile)
    assert one.fingerprint == again.fingerprint
    together = estimator.estimate_batch(several)[0]
    assert np.allclose(one.matrix, together.matrix, atol=2e-3)
    assert one.fingerprint != estimator.estimate(several[1]).fingerprint


def test_masked_captures_are_left_out() -> None:
    bench = system()
    whole = data(material(2), bench)
    valid = whole.valid.copy()
    valid[1, 5:9] = False
    value = np.where(valid, whole.value, np.nan)
    masked = replace(whole, value=value, valid=valid, reasons=("4 captures saturated",))
    result = DonaldsonEstimator().estimate(masked)
    assert result.status == FluorescenceStatus.MASKED
    assert "4 captures saturated" in result.messages
    assert np.isnan(result.residual[1, 5:9]).all()
    assert np.isfinite(result.residual[0]).all()
    truth = material(2)
    assert np.sqrt(((result.matrix - truth)[BELOW] ** 2).mean()) < 2e-3


def test_noise_of_zero_is_replaced_and_said() -> None:
    bench = system()
    silent = replace(data(material(1), bench), variance=np.zeros((8, 31)))
    assert DonaldsonEstimator().estimate(silent).status == FluorescenceStatus.NO_NOISE_STATED


def test_without_fluorescence_none_is_claimed() -> None:
    bench = system()
    plain = np.diag(0.4 + 0.2 * np.tanh((GRID_NM - 550.0) / 40.0))
    result = DonaldsonEstimator().estimate(data(plain, bench))
    assert result.fluorescence.max() < 2e-3
    assert np.all(result.quantile[0][BELOW] < 1e-3)


def test_bad_input_is_refused() -> None:
    bench = system()
    good = data(material(1), bench)
    with pytest.raises(InputError, match="no number"):
        replace(good, value=np.full((8, 31), np.nan))
    with pytest.raises(InputError, match="negative"):
        replace(good, variance=-np.ones((8, 31)))
    with pytest.raises(InputError, match="all zero"):
        DonaldsonEstimator().estimate(replace(good, value=np.zeros((8, 31))))
    apart = FluorescenceSystem(bell(680, 3.0)[None] * (GRID_NM > 650), np.eye(31)[:3])
    alone = replace(
        good, system=apart, value=np.ones((1, 3)), variance=np.ones((1, 3)),
        common=np.zeros((0, 1, 3)), valid=np.ones((1, 3), dtype=bool),
    )  # fmt: skip
    with pytest.raises(InputError, match="in common"):
        DonaldsonEstimator().estimate(alone)
    with pytest.raises(InputError, match="products"):
        DonaldsonSettings(products=9)
    with pytest.raises(InputError, match="Did you mean"):
        fluorescence_estimator("donaldsen")
    with pytest.raises(InputError, match="unknown option"):
        fluorescence_estimator("donaldson", colour="red")
    assert "gmm-adam" in fluorescence_names()


def test_log_peak_is_half_at_half_width() -> None:
    """Siano and Metzler 1969: without skew a Gaussian of the stated full width."""
    grid = np.array([500.0, 530.0, 470.0])
    value = np.exp(log_peak(grid, np.array([[500.0, np.log(60.0), 0.0]])))[0]
    assert value == pytest.approx([1.0, 0.5, 0.5], abs=2e-3)


def test_jacobian_of_the_products() -> None:
    bench = system("chip")
    captures: Captures = gather([data(material(1), bench)])
    model = Products(captures.design * BELOW, captures.cells, ShapePrior())
    random = np.random.Generator(np.random.Philox(key=2))
    point = 0.3 * random.standard_normal((1, 2, model.size))
    value, jacobian = model.values_and_jacobian(point)
    assert np.allclose(value, model.values(point), rtol=1e-10)
    for index in range(0, 2 * model.size, 5):
        step = np.zeros(2 * model.size)
        step[index] = 1e-5
        step = step.reshape(1, 2, -1)
        slope = (model.values(point + step) - model.values(point - step)) / 2e-5
        assert np.allclose(jacobian[0, :, index], slope[0], rtol=2e-2, atol=2e-3)


def test_result_gives_a_donaldson_matrix_and_colours() -> None:
    from estimators.fluorescence.colour import monochromatic_difference

    result = DonaldsonEstimator().estimate(data(material(4), system("chip")))
    assert isinstance(result.donaldson, DonaldsonMatrix)
    spectra = result.reflected(np.ones(31))
    band = result.quantiles_of(spectra)
    truth = material(4) @ np.ones(31)
    assert np.mean((truth >= band[0]) & (truth <= band[-1])) > 0.7
    difference = monochromatic_difference(result.matrix, material(4), GRID_NM)
    assert difference.shape == (31,)
    assert np.median(difference) < 3.0
    same = monochromatic_difference(result.matrix, result.matrix, GRID_NM)
    assert np.all(same < 1e-9)
