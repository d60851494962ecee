"""The published fit, the published peer, the export and the posterior of the mixture."""

from __future__ import annotations

import numpy as np
import pytest

from estimators.fluorescence import FluorescenceStatus, fluorescence_estimator, mixture_of
from estimators.fluorescence.adam import GmmAdamEstimator
from estimators.fluorescence.background import reduce
from estimators.fluorescence.blasinski import BlasinskiSettings, cross_validated, prepare
from estimators.fluorescence.blasinski_admm import Weights, _shrink
from estimators.fluorescence.blasinski_bases import bases_of, generated_bases
from estimators.fluorescence.cells import gather
from estimators.fluorescence.mixture_posterior import MixtureDensity, relabelled
from estimators.fluorescence.posterior import BACKGROUND
from tests.fluorescence.cases import BELOW, bell, data, material, system
from twin.errors import InputError
from twin.fluorescence.donaldson import GRID_NM
from twin.fluorescence.mixture import from_mixture, gaussian_mixture


def test_adam_finds_gaussians_and_keeps_a_smooth_diagonal() -> None:
    bench = system()
    cells = gaussian_mixture([60.0], [[470.0, 560.0]], [[900.0, 700.0]])
    truth = cells + np.diag(0.4 + 0.2 * np.tanh((GRID_NM - 560.0) / 50.0))
    result = fluorescence_estimator("gmm-adam").estimate(data(truth, bench))
    error = np.sqrt(((result.matrix - truth)[BELOW] ** 2).mean())
    assert error < 0.1 * np.sqrt((truth[BELOW] ** 2).mean())
    assert np.abs(result.reflectance - np.diagonal(truth)).max() < 0.05
    assert result.mixture is not None
    assert len(result.mixture.gaussians) == 6
    assert np.allclose(from_mixture(result.mixture).matrix, result.matrix, atol=1e-6)
    assert np.isnan(result.quantile).all()
    assert result.draws is None


def test_adam_does_not_depend_on_the_scale_of_the_light() -> None:
    from dataclasses import replace

    from twin.fluorescence.system import FluorescenceSystem

    bench = system("chip")
    one = data(material(1), bench)
    bright = FluorescenceSystem(bench.illuminants * 7.0, bench.sensitivities * 3.0)
    scaled = replace(one, system=bright, value=one.value * 21.0, variance=one.variance * 441.0)
    first, second = (GmmAdamEstimator().estimate(each).matrix for each in (one, scaled))
    assert np.allclose(first, second, atol=2e-3)


def test_singular_values_are_shrunk() -> None:
    """The proximal map of the nuclear norm in closed form: diag(3, 1) less 2 is diag(1, 0)."""
    flat = np.diag([3.0, 1.0]).reshape(-1, 1)
    assert np.allclose(_shrink(flat, (2, 2), 2.0).reshape(2, 2), np.diag([1.0, 0.0]))


def test_blasinski_solves_what_lies_in_its_bases() -> None:
    """Without penalties and noise, a matrix of its own bases is recovered in photon units."""
    bench = system()
    ratio = GRID_NM[None, :] / GRID_NM[:, None]
    out, into = bell(580, 22.0), bell(480, 30.0)
    reflectance = np.stack([bell(c, 60.0) for c in (420, 480, 540, 600, 660)])
    bases = bases_of(
        reflectance,
        np.concatenate([into[None], [bell(c, 40.0) for c in range(400, 620, 20)]]),
        np.concatenate([out[None], [bell(c, 40.0) for c in range(460, 680, 20)]]),
    )
    truth = 0.05 * np.outer(out, into) * BELOW * ratio + np.diag(
        0.5 * reflectance[2] + 0.1 * reflectance[3]
    )
    given = data(truth, bench)
    weights = {"alpha": 1e-6, "beta": 1e-6, "gamma": 1e-6, "eta": 1e-5, "iterations": 2000}
    result = fluorescence_estimator("blasinski", bases=bases, rho=0.03, **weights).estimate(given)
    error = np.sqrt(((result.matrix - truth)[BELOW] ** 2).mean())
    assert error < 0.15 * np.sqrt((truth[BELOW] ** 2).mean())
    assert np.all(result.matrix[BELOW] >= 0.0)
    assert np.abs(result.reflectance - np.diagonal(truth)).max() < 0.02


def test_blasinski_minimum_beats_its_neighbours() -> None:
    """The ADMM's answer has a smaller objective than feasible points near it."""
    captures = gather([data(material(2), system("chip"))])
    program, scale = prepare(captures, None)
    value = captures.value / scale
    weights = Weights()
    reflect, core, gap = program.solve(value, weights, iterations=1500)

    def objective(w: np.ndarray, matrix: np.ndarray) -> float:
        x = np.concatenate([w, matrix.ravel()])
        smooth = sum(
            k * x @ penalty @ x
            for k, penalty in zip(
                (weights.alpha, weights.beta, weights.gamma), program.smooth, strict=True
            )
        )
        residual = program.predict(w[None], matrix[None]) - value
        nuclear = np.linalg.svd(matrix, compute_uv=False).sum()
        return float((residual**2).sum() + smooth + weights.eta * nuclear)

    best = objective(reflect[0], core[0])
    assert gap < 1e-3
    # Shrinking everything towards a feasible point keeps box and sign.
    for share in (0.9, 0.97):
        assert objective(share * reflect[0], core[0]) > best - 1e-6
        assert objective(reflect[0], share * core[0]) > best - 1e-6


def test_cross_validation_chooses_from_the_grid() -> None:
    given = [data(material(seed), system("chip"), seed) for seed in range(2)]
    grid = np.array([1e-3, 10.0])
    chosen = cross_validated(given, BlasinskiSettings(iterations=60), grid=grid, folds=2)
    assert {chosen.alpha, chosen.beta, chosen.eta} <= set(grid.tolist())
    assert chosen.beta == chosen.gamma == 1e-3
    with pytest.raises(InputError, match="folds"):
        cross_validated(given, folds=1)


def test_bases_are_orthonormal_and_need_spectra() -> None:
    bases = generated_bases(GRID_NM, GRID_NM)
    for basis, count in ((bases.reflectance, 5), (bases.excitation, 12), (bases.emission, 12)):
        assert basis.shape == (31, count)
        assert np.allclose(basis.T @ basis, np.eye(count), atol=1e-10)
    with pytest.raises(InputError, match="reflectance"):
        bases_of(np.ones((2, 31)), np.ones((20, 31)), np.ones((20, 31)))


def test_mixture_of_an_estimate_follows_it() -> None:
    result = fluorescence_estimator("donaldson", draws=0).estimate(data(material(1), system()))
    mixture = mixture_of(result, 4)
    cells = from_mixture(mixture).fluorescence
    size = np.sqrt((result.fluorescence**2).mean())
    assert np.sqrt(((cells - result.fluorescence) ** 2).mean()) < 0.25 * size
    assert len(mixture.gaussians) == 4
    assert len(mixture.moments) == 8
    with pytest.raises(InputError, match="Gaussians"):
        mixture_of(result, 0)


def test_swapped_gaussians_are_put_back() -> None:
    """Draws whose Gaussians were swapped at random come back in one order; the control does not."""
    random = np.random.Generator(np.random.Philox(key=3))
    reference = np.array(
        [1.0, -1.0, 0.0, 0, 0, -1.0, 1.0, 0.5, 0, 0, 0, 2.0, 1.0, 0, 0, *([0.0] * 8)]
    )
    scale = np.full(reference.size, 0.1)
    draws = reference + scale * random.standard_normal((200, reference.size))
    order = np.array([random.permutation(3) for _ in draws])
    mixed = draws.copy()
    mixed[:, :15] = np.take_along_axis(
        draws[:, :15].reshape(200, 3, 5), order[:, :, None], axis=1
    ).reshape(200, 15)
    back, undone = relabelled(mixed, reference, scale, 3)
    assert np.array_equal(back, draws)
    assert np.array_equal(
        np.take_along_axis(order, undone, axis=1), np.tile(np.arange(3), (200, 1))
    )
    assert mixed[:, 1].std() > 5.0 * back[:, 1].std()


def test_density_does_not_change_when_gaussians_swap() -> None:
    captures = gather([data(material(1), system("chip"))])
    density = MixtureDensity(reduce(captures, BACKGROUND, 1000), 2, 2e-3)
    point = np.random.Generator(np.random.Philox(key=1)).standard_normal((1, density.size)) * 0.3
    other = point.copy()
    other[:, :10] = np.concatenate([point[:, 5:10], point[:, :5]], axis=1)
    one, two = density.log_probability(point)[0], density.log_probability(other)[0]
    assert one == pytest.approx(two, abs=1e-8 * abs(one))
    assert density.log_probability(point + 0.3)[0] != pytest.approx(one, rel=1e-3)


def test_posterior_of_one_gaussian() -> None:
    bench = system("chip")
    cells = gaussian_mixture([60.0], [[470.0, 560.0]], [[900.0, 700.0]])
    truth = cells + np.diag(0.4 + 0.1 * np.tanh((GRID_NM - 560.0) / 80.0))
    estimator = fluorescence_estimator(
        "fluorescence-posterior", gaussians=1, steps=1500, effective_samples=50, draws=200
    )
    result = estimator.estimate(data(truth, bench))
    assert result.draws is not None
    assert result.draws.shape == (200, 31, 31)
    assert result.mixture_draws is not None
    assert result.mixture_draws.shape == (200, 1, 5)
    low, high = np.quantile(result.mixture_draws[:, 0], [0.005, 0.995], axis=0)
    assert np.all(low[1:3] < [470.0, 560.0])
    assert np.all(high[1:3] > [470.0, 560.0])
    inside = (truth >= result.quantile[0]) & (truth <= result.quantile[-1])
    assert inside[BELOW].mean() > 0.8
    assert result.statistics["effective_sample_size"] > 10.0
    short = fluorescence_estimator(
        "fluorescence-posterior", gaussians=1, steps=20, effective_samples=1000, draws=10
    ).estimate(data(truth, bench))
    assert short.status == FluorescenceStatus.NOT_CONVERGED
    assert any("autocorrelation times" in m and "`donaldson`" in m for m in short.messages)
