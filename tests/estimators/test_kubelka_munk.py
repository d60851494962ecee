from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimators import BenchModel, Status
from estimators.kubelka_munk import VALID, KubelkaMunkEstimator, KubelkaMunkSettings
from estimators.kubelka_munk_theory import (
    Fluxes,
    coefficients,
    faces_of,
    layer_fluxes,
    layer_reflectance,
)
from scenarios.strategies import Noise, Problem
from tests.strategies.worlds import two_fluxes
from twin.bench import Bench
from twin.errors import InputError

BARE = Bench(covers_above=(), covers_below=())


def one(value: float) -> np.ndarray:
    return np.array([value])


@given(st.floats(0.0, 3.0), st.floats(0.01, 3.0), st.floats(0.0, 0.3), st.floats(0.6, 1.0))
def test_two_backgrounds_give_the_fluxes_back(k: float, s: float, black: float, white: float):
    ground = np.array([[black], [white]])
    seen = layer_reflectance(Fluxes(one(k), one(s)), ground)
    back = layer_fluxes(seen, ground)
    if seen[1, 0] - seen[0, 0] > 1e-5:  # opaque ones keep their secret
        np.testing.assert_allclose([back.absorbed[0], back.scattered[0]], [k, s], atol=1e-5)


def test_limits_of_the_layer() -> None:
    ground = one(0.7)
    clear = layer_reflectance(Fluxes(one(0.4), one(0.0)), ground)
    np.testing.assert_allclose(clear, 0.7 * np.exp(-0.8), rtol=1e-12)
    # Kubelka (1948), eq. (25): without absorption 1 - R = (1 - Rg) / (1 + (1 - Rg) S X).
    pure = layer_reflectance(Fluxes(one(0.0), one(2.0)), ground)
    np.testing.assert_allclose(1.0 - pure, 0.3 / (1.0 + 0.3 * 2.0), rtol=1e-6)
    # Kubelka & Munk (1931): R_inf = 1 + K/S - sqrt((K/S)^2 + 2 K/S), on itself at any thickness.
    infinite = 1.0 + 0.25 - np.sqrt(0.25**2 + 0.5)
    for thick in (0.1, 1.0, 50.0):
        layer = layer_reflectance(Fluxes(one(0.25 * thick), one(thick)), one(infinite))
        np.testing.assert_allclose(layer, infinite, rtol=1e-12)


def test_diffuse_reflectances_of_a_face_are_the_published_ones() -> None:
    model = Problem.of([(0.5, 1.0, 0.0)], bench=BARE, n=1.5).measured(two_fluxes).model
    faces = faces_of(model, 0)
    assert faces.below_outside[0] == pytest.approx(0.0918, abs=1e-4)  # Walsh (1926)
    assert faces.below_inside[0] == pytest.approx(0.5964, abs=1e-4)  # Judd (1942)
    assert faces.enter[0] == pytest.approx(1.0 - 0.0502, abs=1e-4)  # Fresnel at 45 degrees
    assert faces.leave[0] == pytest.approx(0.96 / 2.25, abs=1e-6)


def test_relations_to_the_radiative_transfer_coefficients() -> None:
    k, s = coefficients(np.array([[0.9, 2.0, 0.5]]))
    assert k[0] == pytest.approx(2.0 * 0.2)
    assert s[0] == pytest.approx(0.75 * 1.8 * 0.5 - 0.25 * 0.2)


@pytest.mark.parametrize("saunderson", [True, False])
def test_exact_where_its_assumptions_hold(saunderson: bool) -> None:
    def naked(model: BenchModel, material: np.ndarray) -> np.ndarray:
        estimator = KubelkaMunkEstimator(model, KubelkaMunkSettings(saunderson=False))
        thickness = np.array([sample.thickness_mm for sample in model.samples])
        numbers = range(len(model.samples))
        return estimator._predicted(
            material,
            thickness,
            [model.windows(s) for s in numbers],
            [estimator._faces(s) for s in numbers],
        )

    material = np.array([(0.9, 2.0, 0.5), (0.6, 1.0, 0.0), (0.98, 4.0, 0.8)])
    world = two_fluxes if saunderson else naked
    visit = Problem.of(material, noise=Noise(relative=0.0, floor=1e-9)).measured(world)
    settings = KubelkaMunkSettings(saunderson=saunderson)
    result = KubelkaMunkEstimator(visit.model, settings).estimate(visit.intensities)
    np.testing.assert_allclose(result.parameters, material, atol=1e-5)
    assert (result.status == Status.OK).all()
    assert VALID in result.messages
    wrong = KubelkaMunkEstimator(
        visit.model, KubelkaMunkSettings(saunderson=not saunderson)
    ).estimate(visit.intensities)
    assert not np.allclose(wrong.parameters[:, 0], material[:, 0], atol=1e-2)


def test_samples_that_disagree_widen_the_interval() -> None:
    visit = Problem.of([(0.8, 1.0, 0.3)] * 4, noise=Noise(relative=0.003)).measured(two_fluxes)
    sound = KubelkaMunkEstimator(visit.model).estimate(visit.intensities)
    value = visit.intensities.value.copy()
    value[0, 2] *= 0.8
    torn = KubelkaMunkEstimator(visit.model).estimate(replace(visit.intensities, value=value))
    assert (torn.status == Status.INCONSISTENT).all()
    assert (torn.standard_error[:, 1] > 3.0 * sound.standard_error[:, 1]).all()


def test_an_impossible_albedo_is_not_called_identifiable() -> None:
    problem = Problem.of([(0.99, 2.0, 0.3)] * 2, thickness_mm=[0.5], noise=Noise(relative=0.003))
    visit = problem.measured(two_fluxes)
    value = visit.intensities.value.copy()
    value[:, :2] *= 1.2
    result = KubelkaMunkEstimator(visit.model).estimate(replace(visit.intensities, value=value))
    assert (result.albedo > 1.0).all()
    assert not result.identifiable[:, 0].any()
    assert (result.status != Status.OK).all()
    assert any("no material has" in message for message in result.messages)


def test_an_option_out_of_range_is_refused() -> None:
    with pytest.raises(InputError, match="lost_sigma"):
        KubelkaMunkSettings(lost_sigma=0.0)
