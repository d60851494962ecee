"""The differentiable captures: closed forms, derivatives, relations, and the Monte Carlo."""

from __future__ import annotations

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import jax
import numpy as np
import pytest

from tests.adding_doubling.benches import medium, unbounded
from twin import adding_doubling, transport
from twin.adding_doubling import captures, captures_model, make_streams
from twin.adding_doubling.panels import panel_light
from twin.bench import Bench, Detector, Layer, Medium, Sample
from twin.errors import InputError
from twin.transport.geometry import reference_factor

NAMES = ("albedo", "sigma_t_per_mm", "g", "n", "thickness_mm", "rho_black", "rho_white")
SAMPLES = [Sample(name=f"{t}", thickness_mm=t) for t in (0.4, 1.6)]
PROPERTIES = medium([0.9, 0.99, 0.5, 0.999], [2.0, 5.0, 1.0, 4.0], [0.4, 0.8, 0.8, 0.05])


@pytest.fixture(scope="module")
def model() -> adding_doubling.CapturesModel:
    return captures_model(Bench(), SAMPLES, PROPERTIES.wavelength_nm)


@pytest.fixture(scope="module")
def parameters(model: adding_doubling.CapturesModel) -> adding_doubling.Parameters:
    values = model.parameters(PROPERTIES.albedo, PROPERTIES.sigma_t_per_mm, PROPERTIES.g)
    return adding_doubling.Parameters(*(jax.numpy.asarray(value) for value in values))


def test_importing_twin_does_not_import_jax() -> None:
    code = "import sys, twin; sys.exit('jax' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
    assert jax.numpy.asarray(1.0).dtype == np.float64


def test_jacobian_is_the_slope_of_forward(model, parameters) -> None:  # type: ignore[no-untyped-def]
    value, jacobian = model.forward_and_jacobian(parameters, NAMES)
    assert np.allclose(value, model.forward(parameters), rtol=1e-12)
    for column, name in enumerate(NAMES):
        step = 2e-6
        sides = [
            model.forward(parameters._replace(**{name: getattr(parameters, name) + sign * step}))
            for sign in (1.0, -1.0)
        ]
        slope = np.asarray(sides[0] - sides[1]) / (2 * step)
        assert np.allclose(jacobian[..., column], slope, rtol=2e-5, atol=2e-8), name


def test_reverse_mode_is_forward_mode(model, parameters) -> None:  # type: ignore[no-untyped-def]
    weight = jax.numpy.arange(24.0).reshape(4, 2, 3)

    def total(albedo, g):  # type: ignore[no-untyped-def]
        return (model.forward(parameters._replace(albedo=albedo, g=g)) * weight).sum()

    by_albedo, by_g = jax.grad(total, argnums=(0, 1))(parameters.albedo, parameters.g)
    _, jacobian = model.forward_and_jacobian(parameters, ("albedo", "g"))
    assert np.allclose(by_albedo, (jacobian[..., 0] * weight).sum(axis=(1, 2)), rtol=1e-8)
    assert np.allclose(by_g, (jacobian[..., 1] * weight).sum(axis=(1, 2)), rtol=1e-8)


def test_many_threads_do_not_lock_each_other(model, parameters) -> None:  # type: ignore[no-untyped-def]
    """See docs/decisions/0003: batched LAPACK calls at once waited for ever."""

    def task(_: int) -> float:
        return float(model.forward_and_jacobian(parameters, NAMES)[1].sum())

    with ThreadPoolExecutor(6) as pool:
        results = list(pool.map(task, range(48)))
    assert len(set(results)) == 1
    assert np.isfinite(results[0])


def test_nothing_compiles_again_for_other_numbers(model, parameters) -> None:  # type: ignore[no-untyped-def]
    """Neither for another material nor for another bench of the same make."""
    from twin.adding_doubling.program import compiled_forward

    model.forward(parameters)
    before = compiled_forward._cache_size()
    for factor in (0.5, 0.7, 0.9):
        model.forward(parameters._replace(albedo=factor * parameters.albedo))
    other = Bench(detector=Detector(acceptance_deg=2.0))
    thicker = [Sample(name=f"{i}", thickness_mm=1.0 + i) for i in range(len(model.nominal[4]))]
    captures_model(other, thicker, model.wavelength_nm).forward(parameters)
    assert compiled_forward._cache_size() == before


def test_without_medium_beer_fresnel_and_background_remain() -> None:
    bench = unbounded(covered=False)
    clear = medium([0.0, 0.0], [0.3, 0.0], [0.0, 0.0])
    sample = Sample(name="clear", thickness_mm=1.0, n=1.0)
    got = captures(bench, sample, clear.wavelength_nm, properties=clear)
    # matched to air: the panels' light crosses twice, once at its angle, once along the normal
    light = panel_light(bench)
    raised = reference_factor(bench, 0.0) / reference_factor(bench, -1.5)
    inward = np.array([light.share @ np.exp(-s / light.cosine) for s in (0.3, 0.0)])
    expected = raised * inward * np.exp(-clear.sigma_t_per_mm)
    # the background is lit as an unbounded plane; the mean over the cone costs 2e-5
    assert np.allclose(got.white, 0.98 * expected, rtol=5e-5)
    assert np.allclose(got.black, 0.05 * expected, rtol=5e-5)
    assert not np.allclose(got.white, 0.98 * expected * (1.0 + 1e-4), rtol=5e-5)
    assert np.allclose(got.collimated, np.exp(-clear.sigma_t_per_mm), rtol=1e-9)


def test_opaque_samples_do_not_show_the_background() -> None:
    thick = medium([0.9, 0.5], [60.0, 40.0], [0.3, 0.8])
    sample = Sample(name="opaque", thickness_mm=2.0)
    got = captures(Bench(), sample, thick.wavelength_nm, properties=thick)
    assert np.allclose(got.black, got.white, rtol=1e-9)
    thin = captures(
        Bench(), Sample(name="thin", thickness_mm=0.1), thick.wavelength_nm, properties=thick
    )
    assert np.all(thin.white > thin.black * 1.01)


def test_corners_of_the_parameters_stay_finite() -> None:
    corners = np.array(
        [
            (a, s, g)
            for a in (0.0, 1e-6, 0.5, 1.0)
            for s in (0.0, 1e-6, 5.0, 1e4)
            for g in (-0.9, 0.0, 0.98)
        ]
    )
    model = captures_model(Bench(), SAMPLES, np.linspace(400.0, 700.0, len(corners)))
    value, jacobian = model.forward_and_jacobian(model.parameters(*corners.T))
    assert np.all(np.isfinite(value))
    assert np.all(np.isfinite(jacobian))
    assert np.all(np.asarray(value) > -1e-12)
    assert np.all(np.asarray(value[..., 1]) > np.asarray(value[..., 0]) - 1e-9)


def test_dependence_on_the_background_is_the_closed_form(model, parameters) -> None:  # type: ignore[no-untyped-def]
    """R + T1 rho T2 / (1 - rho R'): three values give all others."""

    def black(rho: float) -> np.ndarray:
        moved = parameters._replace(rho_black=np.full(4, rho))
        return np.asarray(model.forward(moved))[..., 0]

    r, a, b = black(0.0), black(0.5) - black(0.0), black(1.0) - black(0.0)
    inner = (2 * a - b) / (a - b)
    outer = 2 * a * (1 - inner / 2)
    assert np.allclose(black(0.8) - r, 0.8 * outer / (1 - 0.8 * inner), rtol=1e-9)


def test_more_streams_change_little(model, parameters) -> None:  # type: ignore[no-untyped-def]
    fine = captures_model(
        Bench(), SAMPLES, PROPERTIES.wavelength_nm, streams=make_streams(20, 16)
    ).forward(parameters)
    coarse = captures_model(
        Bench(), SAMPLES, PROPERTIES.wavelength_nm, streams=make_streams(5, 4, orders=8)
    ).forward(parameters)
    assert np.allclose(model.forward(parameters), fine, rtol=1e-3, atol=1e-4)
    assert not np.allclose(coarse, fine, rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize(("covered", "n"), [(True, 1.5), (False, 1.0)])
def test_monte_carlo_agrees(covered: bool, n: float) -> None:
    bench, sample = unbounded(covered), Sample(name="medium", thickness_mm=1.0, n=n)
    wavelength = PROPERTIES.wavelength_nm
    exact = captures(bench, sample, wavelength, properties=PROPERTIES)
    traced = transport.captures(
        bench, sample, wavelength, properties=PROPERTIES, paths=32_768, seed=11
    )
    for capture in ("black", "white", "collimated"):
        error = np.hypot(getattr(traced, f"{capture}_se"), 1e-5 * getattr(exact, capture))
        z = (getattr(traced, capture) - getattr(exact, capture)) / error
        assert np.abs(z).max() < 4.5, capture
    # the check can fail: 3 % more scatterer is seen
    more = medium(
        list(PROPERTIES.albedo), list(1.03 * PROPERTIES.sigma_t_per_mm), list(PROPERTIES.g)
    )
    moved = captures(bench, sample, wavelength, properties=more)
    assert np.abs((traced.collimated - moved.collimated) / traced.collimated_se).max() > 10


def test_captures_match_the_interface_and_say_what_is_missing(model) -> None:  # type: ignore[no-untyped-def]
    got = captures(
        Bench(), SAMPLES[0], PROPERTIES.wavelength_nm, properties=PROPERTIES, derivatives=True
    )
    assert isinstance(got, transport.NoiselessCaptures)
    assert got.derivatives is not None
    assert got.derivatives.shape == (3, 3, 4)
    assert not np.any(got.black_se)
    said = " ".join(model.not_represented)
    assert "sides" in said
    assert "spots" in said


def test_what_cannot_be_is_said() -> None:
    cloudy = Layer(thickness_mm=0.1, medium=Medium(albedo=0.5, sigma_t_per_mm=1.0))
    bench = Bench(covers_above=(cloudy,))
    with pytest.raises(InputError, match="scatters"):
        captures_model(bench, SAMPLES, [550.0])
    with pytest.raises(InputError, match="several refractive indices"):
        captures_model(Bench(), [SAMPLES[0], Sample(name="b", thickness_mm=1.0, n=1.4)], [550.0])
    with pytest.raises(InputError, match="no material"):
        captures(Bench(), SAMPLES[0], np.array([550.0]))
    with pytest.raises(InputError, match="trapped"):
        captures_model(Bench(), SAMPLES, [550.0], streams=make_streams(12, 0))
