"""Captures brought from the indices of a wavelength to those of the map."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimators import BenchModel
from estimators.lut_index import DOUBT, at_the_map, brought
from estimators.screening import Screened, screen
from scenarios import load_scenario
from tests.estimators.fake_map import fake_map
from twin.adding_doubling import captures_model
from twin.appearance import AppearanceMap
from twin.bench import Bench, Sample
from twin.materials import optical_properties
from twin.measurement.relative import RelativeIntensities
from twin.optics import stack_transmittance
from twin.spectra import FloatArray

WAVELENGTH = np.array([410.0, 480.0, 620.0, 690.0])
MAP_N = 1.3353


def flat(bench: Bench, nominal_nm: float = 550.0) -> Bench:
    """The bench with covers that refract all wavelengths alike."""
    from twin.materials import refractive_index

    def still(covers: tuple) -> tuple:  # type: ignore[type-arg]
        where = np.array([nominal_nm])
        return tuple(
            c.model_copy(update={"n": float(refractive_index(c.n, where)[0])}) for c in covers
        )

    changes = {"covers_above": still(bench.covers_above), "covers_below": still(bench.covers_below)}
    return bench.model_copy(update=changes)


def engine(bench: Bench, samples: tuple[Sample, ...]) -> FloatArray:
    """Captures (S, 3, W) of the ink."""
    found = optical_properties("demo_ink", WAVELENGTH)
    model = captures_model(bench, samples, WAVELENGTH)
    parameters = model.parameters(found.albedo, found.sigma_t_per_mm, found.g)
    return np.array(model.forward(parameters)).transpose(1, 2, 0)


@pytest.fixture(scope="module")
def world() -> tuple[BenchModel, BenchModel, FloatArray, FloatArray, Screened]:
    scenario = load_scenario("default")
    still = tuple(s.model_copy(update={"n": MAP_N}) for s in scenario.samples)
    model = BenchModel.of(scenario.bench, scenario.samples, WAVELENGTH)
    mapped = BenchModel.of(flat(scenario.bench), still, WAVELENGTH)
    seen = engine(scenario.bench, scenario.samples)
    wanted = engine(flat(scenario.bench), still)
    thickness = np.array([s.thickness_mm for s in scenario.samples])
    # That engine's beam has some scattered light in it; Beer's law has none.
    depth = truth()[:, :, 1] * thickness[:, None]
    for s in range(2):
        seen[s, 2] = stack_transmittance(np.exp(-depth[s]), model.windows(s))
        wanted[s, 2] = stack_transmittance(np.exp(-depth[s]), mapped.windows(s))
    covariance = np.tile(1e-12 * np.eye(6), (WAVELENGTH.size, 1, 1))
    intensities = RelativeIntensities(
        model.sample_names, thickness, WAVELENGTH, seen, covariance,
        np.ones(seen.shape, dtype=bool), (), 1,
    )  # fmt: skip
    return model, mapped, thickness, wanted, screen(model, intensities)


def truth() -> FloatArray:
    found = optical_properties("demo_ink", WAVELENGTH)
    one = np.stack([found.albedo, found.sigma_t_per_mm, found.g], axis=-1)
    return np.stack([one, one])


def test_the_collimated_capture_is_brought_exactly(world) -> None:  # type: ignore[no-untyped-def]
    model, mapped, thickness, wanted, screened = world
    found = brought(model, mapped, thickness, truth(), screened)
    before = np.abs(screened.value[:, 2] / wanted[:, 2] - 1.0)
    assert before.max() > 1e-4
    np.testing.assert_allclose(found.value[:, 2], wanted[:, 2], rtol=1e-9)


def test_black_and_white_come_nearer_and_the_doubt_covers_the_rest(world) -> None:  # type: ignore[no-untyped-def]
    model, mapped, thickness, wanted, screened = world
    found = brought(model, mapped, thickness, truth(), screened)
    before = screened.value[:, :2] - wanted[:, :2]
    after = found.value[:, :2] - wanted[:, :2]
    assert np.sqrt(np.mean(after**2)) < 0.5 * np.sqrt(np.mean(before**2))
    # As far as two streams are wrong by at most twice the doubt.
    moved = np.abs(found.value[:, :2] - screened.value[:, :2])
    assert np.sqrt(np.mean(after**2)) < 2.0 * DOUBT * np.sqrt(np.mean(moved**2))


def test_without_an_estimate_nothing_moves(world) -> None:  # type: ignore[no-untyped-def]
    model, mapped, thickness, _, screened = world
    found = brought(model, mapped, thickness, np.full((2, WAVELENGTH.size, 3), np.nan), screened)
    np.testing.assert_array_equal(found.value, screened.value)
    np.testing.assert_array_equal(found.covariance, screened.covariance)


def test_the_bench_of_the_map_has_one_index_for_all_wavelengths(world) -> None:  # type: ignore[no-untyped-def]
    model, expected, _, _, _ = world
    node = np.zeros((2, 2, 2))
    own = AppearanceMap(
        np.array([0.0, 0.9]), np.array([0.5, 2.0]), np.array([0.0, 0.5]), 0.4, MAP_N,
        np.zeros(1), node[..., None], node[..., None], node, node, node, node, "",
    )  # fmt: skip
    found = at_the_map(model, (own, replace(own, thickness_mm=0.8)))
    assert found is not None
    np.testing.assert_allclose(found.n, expected.n)
    np.testing.assert_allclose(found.covers_above, expected.covers_above)
    np.testing.assert_allclose(found.covers_below, expected.covers_below)


def test_maps_that_are_no_appearance_maps_are_left_alone(world) -> None:  # type: ignore[no-untyped-def]
    assert at_the_map(world[0], (fake_map(0.4), fake_map(0.8))) is None
