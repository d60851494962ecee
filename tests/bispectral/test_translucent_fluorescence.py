"""Recovery of host and fluorescence together, on light of the fast route and of the Monte Carlo."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from estimators.translucent_fluorescence import (
    FluorescentForward,
    LedMeasurement,
    Prior,
    design_information,
    estimate,
    estimate_blind,
)
from estimators.translucent_fluorescence.fit import start
from scenarios.fluorescent_translucent import Case, TrueCaptures, errors_of, led_visit, white_visit
from twin.bispectral import donaldson
from twin.errors import InputError


@cache
def case() -> Case:
    return Case()


@cache
def model() -> FluorescentForward:
    return FluorescentForward.of(case().bench, case().samples, case().wavelength_nm)


@cache
def light() -> TrueCaptures:
    """The fast route's own light: it tests the solver, not the engine."""
    own = case()
    found = donaldson(own.bench, own.samples, own.properties)
    emitted = found.fluorescent[:, :2]
    return TrueCaptures(
        found.elastic, emitted, np.zeros_like(found.elastic), np.zeros_like(emitted)
    )


@cache
def visit() -> LedMeasurement:
    return led_visit(case(), light(), seed=1)


def test_slopes_are_those_of_the_prediction() -> None:
    own = model()
    state = start(own, Prior())
    _, slope = own.jacobian(state, visit().lights)
    # one coordinate of every kind
    for column in (12, 13, 14, 3 * 16 + 3, 3 * 16 + own.excitation.size + 4):
        step = np.zeros(own.coordinates)
        step[column] = 1e-5
        up, down = (
            own.predict(state.moved(state.vector + sign * step), visit().lights)
            for sign in (1.0, -1.0)
        )
        expected = (up - down) / 2e-5
        assert np.allclose(slope[:, column], expected, rtol=1e-4, atol=1e-7 * slope.max())


def test_host_and_fluorescence_are_recovered_with_intervals() -> None:
    found = estimate(visit(), case().bench, case().samples, model=model(), engine=1e-4)
    errors = errors_of(case(), found)
    assert found.converged
    assert errors.sigma_a < 0.02
    assert errors.sigma_s_prime < 0.01
    assert errors.fluorescence < 0.03
    assert errors.coverage > 0.7
    assert np.all(np.diff(found.interval("sigma_a"), axis=0) > 0.0)


def test_the_blind_fit_is_far_off_where_the_dye_emits() -> None:
    blind = estimate_blind(
        white_visit(case(), light(), seed=1), case().bench, case().samples, model=model()
    )
    errors = errors_of(case(), blind)
    assert errors.sigma_a_largest > 0.5
    assert errors.fluorescence == pytest.approx(1.0)
    assert blind.chi_square > 3.0 * blind.degrees


def test_one_white_light_leaves_fluorescence_unknown() -> None:
    own, state = model(), start(model(), Prior())
    many = design_information(own, state, visit())
    white = white_visit(case(), light(), seed=1)
    one = design_information(own, state, white)
    assert one.log_integrated > 3.0 * many.log_integrated
    assert one.blind_directions > many.blind_directions
    assert many.log_sigma_a < one.log_sigma_a


def test_shapes_that_do_not_belong_together_are_refused() -> None:
    with pytest.raises(InputError):
        replace(visit(), lights=visit().lights[:2])
    with pytest.raises(InputError):
        replace(visit(), collimated_variance=0.0 * visit().collimated_variance)
    with pytest.raises(InputError):
        estimate(visit(), case().bench, case().samples[:1], model=model())
    found = estimate_blind(visit(), case().bench, case().samples, model=model())
    with pytest.raises(InputError):
        found.interval("hue")
