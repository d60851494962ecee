"""The plane-parallel part of a map, and the factors that carry the finite bench to any medium."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from estimators.forward import Forward
from estimators.protocol import BenchModel
from twin import Bench, MapGrid, OpticalProperties, Sample, appearance_map
from twin.adding_doubling import captures_model, make_streams
from twin.appearance import FiniteFactors
from twin.appearance.plane import PlaneParts, plane_parts, representable
from twin.appearance.smoothing import smoothed_ratio
from twin.bench import Layer, Medium
from twin.transport import captures

BARE = Bench(covers_above=(), covers_below=())
SIGMA_T = np.geomspace(0.1, 30.0, 9)
GRID = MapGrid.spaced(12, 16, 4, sigma_range=(0.3, 10.0), g_range=(0.0, 0.8))


@pytest.mark.parametrize("g", [0.3, 0.8])
@pytest.mark.parametrize("n", [1.0, 1.5])
def test_interpolation_over_the_albedo_is_exact(n: float, g: float) -> None:
    albedo = np.array([0.0, 0.02, 0.3, 0.77, 0.97, 0.9999])
    found = plane_parts(BARE, 0.5, n, albedo, SIGMA_T, g)
    points = len(albedo) * len(SIGMA_T)
    streams = {1.0: (30, 0) if g > 0.65 else (18, 0), 1.5: (20, 16) if g > 0.65 else (12, 8)}[n]
    model = captures_model(
        BARE,
        [Sample(name="s", thickness_mm=0.5, n=n)],
        np.full(points, 550.0),
        streams=make_streams(*streams),
    )
    own = model.parts(
        model.parameters(np.repeat(albedo, len(SIGMA_T)), np.tile(SIGMA_T, len(albedo)), g)
    )
    for name in ("direct", "once", "returned", "scattered"):
        exact = np.asarray(getattr(own, name))[:, 0].reshape(len(albedo), -1)
        value = getattr(found, name)
        lit = exact > 1e-8
        np.testing.assert_allclose(value[lit], exact[lit], rtol=2e-4)
        assert np.abs(value[~lit]).max(initial=0.0) < 1e-6


def test_the_series_over_bounces_sums_to_the_closed_form() -> None:
    one = np.ones((1, 1))
    parts = PlaneParts(0.1 * one, 0.5 * one, 0.4 * one, 0.0 * one, 0.0)
    bounce = np.arange(65)
    series = parts.bounced(np.arange(65.0), bounce)
    for rho in (0.02, 0.99):
        closed = 0.1 + rho * 0.5 / (1.0 - rho * 0.4)
        assert np.isclose((series @ rho ** np.arange(65.0))[0, 0], closed, rtol=1e-12)


def test_a_scattering_cover_is_left_to_the_monte_carlo_alone() -> None:
    medium = Medium(albedo=0.5, sigma_t_per_mm=1.0)
    milky = Bench(covers_above=(Layer(thickness_mm=0.2, medium=medium),))
    assert representable(Bench())
    assert not representable(milky)


def test_smoothing_a_multiple_of_a_known_curve_is_linear_and_exact() -> None:
    x = 0.1 * np.arange(30.0)
    scale = np.exp(-(x**2))[None, :, None]
    differences = (0.3 - 0.1 * x + 0.05 * x**2)[None, :, None] * scale
    np.testing.assert_allclose(smoothed_ratio(differences, scale, 0.1), differences, atol=1e-12)
    noise = np.random.Generator(np.random.Philox(key=3)).normal(size=differences.shape) * scale
    after = smoothed_ratio(noise, scale, 0.1) / scale
    assert np.std(after) < 0.7 * np.std(noise / scale)


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory):
    return appearance_map(
        Bench(), 0.5, 1.5, grid=GRID, paths=4096, folder=Path(tmp_path_factory.mktemp("maps"))
    )


def forward_at(known, albedo, sigma_t, g, rho=(0.02, 0.985), maps=True) -> np.ndarray:
    sample = Sample(name="s", thickness_mm=0.5, n=1.5)
    wavelength = np.linspace(500.0, 600.0, len(albedo))
    engine = Forward.of(BenchModel.of(Bench(), [sample], wavelength, [known] if maps else []))
    assert engine.corrected is maps
    one = np.ones(len(albedo))
    parameters = engine.parameters(
        albedo, sigma_t, g, rho_black=rho[0] * one, rho_white=rho[1] * one
    )
    return np.asarray(engine.forward(parameters))[:, 0]


def test_the_corrected_engine_is_the_map_at_its_nodes(known) -> None:
    albedo, sigma_t, g = (
        grid.ravel()
        for grid in np.meshgrid(known.albedo[1:], known.sigma_t_per_mm, known.g, indexing="ij")
    )
    table = known.intensities(0.02, 0.985)[1:].reshape(-1, 3)
    lit = table > 1e-4
    corrected = forward_at(known, albedo, sigma_t, g)
    np.testing.assert_allclose(corrected[lit], table[lit], rtol=2e-3)
    plain = forward_at(known, albedo, sigma_t, g, maps=False)
    assert np.abs(plain[lit] / table[lit] - 1.0).max() > 0.03  # the control: no correction


def test_the_corrected_engine_agrees_with_the_monte_carlo_between_the_nodes(known) -> None:
    albedo, sigma_t, g = (
        np.array([0.99, 0.97, 0.6]),
        np.array([0.4, 2.3, 5.1]),
        np.array([0.2, 0.5, 0.7]),
    )
    wavelength = np.linspace(500.0, 600.0, 3)
    medium = OpticalProperties(wavelength, albedo, sigma_t, g, None)
    sample = Sample(name="s", thickness_mm=0.5, n=1.5)
    truth = captures(Bench(), sample, wavelength, properties=medium, paths=1 << 16, seed=6)
    worst = {}
    for maps in (True, False):
        value = np.stack(
            [
                forward_at(known, albedo, sigma_t, g, (rho_black, rho_white), maps)[w]
                for w, (rho_black, rho_white) in enumerate(
                    zip(truth.rho_black, truth.rho_white, strict=True)
                )
            ]
        )
        own = np.stack([truth.black, truth.white, truth.collimated], axis=1)
        error = np.stack([truth.black_se, truth.white_se, truth.collimated_se], axis=1)
        worst[maps] = np.abs((value - own) / np.hypot(error, 2e-3 * own)).max()
    assert worst[True] < 4.0
    assert worst[False] > 5.0


def test_factors_stay_at_the_border_beyond_the_grid(known) -> None:
    factors = FiniteFactors.of(known)
    inside = np.asarray(factors.at(np.array([0.9]), np.array([10.0]), np.array([0.5])))
    beyond = np.asarray(factors.at(np.array([0.9]), np.array([100.0]), np.array([0.5])))
    np.testing.assert_allclose(inside, beyond)


def test_the_slopes_of_the_corrected_engine_are_its_slopes(known) -> None:
    sample = Sample(name="s", thickness_mm=0.5, n=1.5)
    engine = Forward.of(BenchModel.of(Bench(), [sample], np.array([500.0, 600.0]), [known]))
    at = engine.parameters(np.array([0.8, 0.95]), np.array([1.0, 4.0]), np.array([0.3, 0.6]))
    names = ("albedo", "sigma_t_per_mm", "g", "thickness_mm", "rho_white")
    _, slopes = engine.forward_and_jacobian(at, names)
    for column, name in enumerate(names):
        own = np.asarray(getattr(at, name))
        step = 1e-5 * own
        up, down = (
            np.asarray(engine.forward(at._replace(**{name: own + sign * step}))) for sign in (1, -1)
        )
        width = 2.0 * (step if name == "thickness_mm" else step[:, None])
        np.testing.assert_allclose(
            np.asarray(slopes)[..., column], (up - down) / width[..., None], rtol=2e-3, atol=1e-6
        )
