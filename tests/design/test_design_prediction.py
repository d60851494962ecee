"""Predicted uncertainty against the simulated instrument, the budget, and closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from scenarios.design import Candidate, Goal, TranslucentPredictor, load_parts
from scenarios.design.draws import drawn
from scenarios.design.fisher import Information, predicted
from scenarios.design.modes import Modes
from scenarios.design.noise import Settings, covariance
from scenarios.design.optics import Light, Optics
from scenarios.simulate import noisy_visits
from twin.materials import reflectance
from twin.measurement import relative_intensities
from twin.transport import NoiselessCaptures

PARTS = load_parts()
GOAL = Goal.model_validate(
    {
        "title": "a test",
        "materials": [{"name": "resin", "albedo": 0.95, "sigma_t_per_mm": 3.0, "g": 0.7, "n": 1.4}],
        "targets": {"albedo": 0.01, "sigma_t_relative": 0.03, "g": 0.03},
        "protocol": {"thickness_mm": [0.3, 0.9], "samples": [1, 2], "averages": [5, 20]},
        "wavelength": {"start_nm": 440.0, "stop_nm": 680.0, "step_nm": 40.0},
    }
)
SEED = PARTS.assembly("seed-translucent").parts


def made_up(seed: int) -> tuple[Information, Light, np.ndarray, Modes]:
    """Random slopes and noise of one material, three samples, two wavelengths."""
    rng = np.random.Generator(np.random.Philox(key=seed))
    shape = (1, 3, 2)
    light = Light(np.full((*shape, 3), 0.5), np.zeros((*shape, 3, 7)))
    light.slope[..., :3] = rng.normal(size=(*shape, 3, 3))
    root = rng.normal(size=(*shape, 3, 3)) * 1e-3
    noise = root @ np.swapaxes(root, -1, -2) + 1e-6 * np.eye(3)
    modes = Modes(("n", "rho_black_relative"), ("thickness_mm",), rng.normal(size=(*shape, 3, 3)))
    material = np.tile((0.9, 2.0, 0.5), (1, 2, 1))
    found = Information.of(light, noise, modes, material, np.array([0.3, 0.6, 1.2]))
    return found, light, noise, modes


def test_the_marginal_covariance_is_that_of_generalised_least_squares():
    information, light, noise, modes = made_up(1)
    scale = np.array([2e-3, 1e-3, 3e-3])
    chosen = (0, 2)
    found = predicted([information], [chosen], [scale])
    for w in range(2):
        total = np.zeros((6, 6))
        slope = np.zeros((6, 3))
        common = np.zeros((6, 2))
        for slot, k in enumerate(chosen):
            part = slice(3 * slot, 3 * slot + 3)
            own = modes.array[0, k, w] * scale
            total[part, part] = noise[0, k, w] + np.outer(own[:, 2], own[:, 2])
            total[part, part] += np.diag(np.full(3, (1e-4 * 0.5) ** 2 + 1e-18))
            slope[part] = light.slope[0, k, w, :, :3]
            common[part] = own[:, :2]
        total += common @ common.T
        weight = slope.T @ np.linalg.inv(total)
        expected = np.linalg.inv(weight @ slope)
        assert np.allclose(found.covariance[0, 0, w], expected, rtol=1e-3)
        # and a mode moves the estimate as it moves that of generalised least squares
        moved = expected @ weight @ common
        assert np.allclose(found.gain[0, 0, w, :, :2], moved, rtol=2e-3, atol=1e-7)


def test_more_samples_and_smaller_tolerances_never_hurt():
    information = made_up(2)[0]
    scale = np.array([2e-3, 1e-3, 3e-3])
    one = predicted([information], [(0,)], [scale]).standard
    two = predicted([information], [(0, 1)], [scale]).standard
    better = predicted([information], [(0, 1)], [0.5 * scale]).standard
    assert np.all(two <= one * (1 + 1e-9))
    assert np.all(better <= two * (1 + 1e-9))
    # weights that know the tolerances are never worse than those of the noise alone
    matrix, chosen = information.matrix[0][[0, 1]], (0, 1)
    for w in range(2):
        own = np.linalg.inv(matrix[:, w, :3, :3].sum(axis=0))
        moved = [matrix[:, w, :3, 3:5].sum(axis=0) * scale[:2]]
        moved += [matrix[s, w, :3, 5:] * scale[2:] for s in chosen]
        plain = np.diag(own) + ((own @ np.concatenate(moved, axis=1)) ** 2).sum(axis=1)
        assert np.all(two[0, 0, w] ** 2 <= plain * (1 + 1e-6))


@pytest.mark.parametrize("detector", ["spectrometer", "as7341"])
def test_the_noise_is_that_of_simulated_visits(detector: str):
    own = Candidate(
        tuple(detector if name == "spectrometer" else name for name in SEED),
        (0.3, 0.9), averages=5, repeats=2,
    )  # fmt: skip
    scenario = own.scenario(PARTS, GOAL, GOAL.media[0])
    bench, light_nm = scenario.bench, scenario.wavelength.wavelength_nm
    # any smooth light will do: nothing of the optics is asked here
    value = np.stack(
        [np.array([0.30, 0.45, 0.25]) * f for f in np.linspace(0.9, 1.1, len(light_nm))]
    )
    zero = np.zeros(len(light_nm))
    rho = [
        reflectance(each.reflectance, light_nm)
        for each in (bench.background.black, bench.background.white)
    ]
    lights = [NoiselessCaptures(light_nm, *value.T, zero, zero, zero, *rho, 1.0)] * 2
    visits = noisy_visits(scenario, lights, range(6))
    seen = [relative_intensities(visit) for visit in visits]
    pixels = seen[0].wavelength_nm
    expected = np.mean([each.covariance[:, :3, :3] for each in seen], axis=0)
    here = np.stack([np.interp(pixels, light_nm, column) for column in value.T], axis=-1)
    mine = covariance(Settings.of(bench, pixels), here, averages=5, repeats=2)
    sd = np.sqrt(np.diagonal(mine, axis1=1, axis2=2))
    assert np.allclose(sd, np.sqrt(np.diagonal(expected, axis1=1, axis2=2)), rtol=0.04)
    assert np.allclose(mine[:, 0, 1] / sd[:, 0] / sd[:, 1],
                       expected[:, 0, 1] / sd[:, 0] / sd[:, 1], atol=0.05)  # fmt: skip
    # ... and more frames change it by what they should
    more = covariance(Settings.of(bench, pixels), here, averages=500, repeats=2)
    assert np.all(np.sqrt(np.diagonal(more, axis1=1, axis2=2))[:, 2] < sd[:, 2])


def test_drawn_errors_have_exactly_the_stated_second_moments():
    scales = {"n": 0.005, "rho_black_relative": 0.1, "thickness_mm": 0.01}
    draws = drawn(scales, 2, 16, seed=5)
    columns = np.array(
        [
            [
                d.shared["n"] / 0.005,
                d.shared["rho_black_relative"] / 0.1,
                *(d.own["thickness_mm"] / 0.01).tolist(),
            ]
            for d in draws
        ]
    )  # fmt: skip
    assert np.allclose(columns.T @ columns / 16, np.eye(4), atol=1e-9)
    assert drawn(scales, 2, 16, seed=5)[3].shared == draws[3].shared
    assert drawn(scales, 2, 16, seed=6)[3].shared != draws[3].shared


def test_light_and_slopes_are_those_of_the_estimators_engine():
    from estimators import BenchModel
    from estimators.forward import Forward

    bench = Candidate(SEED, (0.3,)).bench(PARTS, GOAL.wavelength.wavelength_nm.tolist())
    wavelength = GOAL.wavelength.wavelength_nm
    light = Optics(GOAL.media, (0.3,)).light(bench, wavelength)
    samples = Candidate(SEED, (0.3,)).samples(GOAL.media[0])
    forward = Forward.of(BenchModel.of(bench, samples, wavelength))
    own = (0.95, 3.0, 0.7)
    value = np.asarray(forward.forward(forward.parameters(*own)))[:, 0]
    assert np.allclose(light.value[0, 0], value, rtol=1e-9)
    # slopes by finite differences of the same engine
    for column, name in enumerate(("albedo", "sigma_t_per_mm", "g", "rho_black", "rho_white")):
        row = (0, 1, 2, 5, 6)[column]
        step = 1e-4
        if column < 3:
            ends = [forward.parameters(*(v + s * (i == column) for i, v in enumerate(own)))
                    for s in (-step, step)]  # fmt: skip
        else:
            nominal = np.asarray(getattr(forward.nominal, name))
            ends = [forward.parameters(*own, **{name: nominal + s}) for s in (-step, step)]
        low, high = (np.asarray(forward.forward(each))[:, 0] for each in ends)
        assert np.allclose(light.slope[0, 0, ..., row], (high - low) / (2 * step), atol=2e-5)


def test_figures_shares_and_what_parts_change():
    predictor = TranslucentPredictor(GOAL, PARTS)
    seed = Candidate(SEED, (0.3, 0.9))
    rough = Candidate(
        tuple("ruler-spacers" if name == "micrometer" else name for name in SEED), (0.3, 0.9)
    )
    long = Candidate(SEED, (0.3, 0.9), averages=1000)
    figures = predictor.predict([seed, rough, long])
    assert figures.shape == (3, 3)
    assert np.all(figures[1] >= figures[0] * (1 - 1e-9))
    assert figures[1, 1] > 1.05 * figures[0, 1]
    assert np.all(figures[2] <= figures[0] * (1 + 1e-9))
    shares = predictor.limits(rough)
    for own in shares.values():
        assert sum(own.values()) == pytest.approx(1.0, abs=0.02)
    assert shares["sigma_t_relative"]["thickness_mm"] > predictor.limits(seed)[
        "sigma_t_relative"]["thickness_mm"]  # fmt: skip
