"""What a chip's bands do to light, and the material that an estimate makes of it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

from scenarios.design import Candidate, Goal, TranslucentPredictor, load_parts
from scenarios.design.apparent import (
    Table,
    Tables,
    apparent,
    coordinates,
    material_at,
    weights,
)
from scenarios.design.bands import View
from scenarios.design.media import Medium
from scenarios.design.optics import Optics, intensities, solved
from twin.bench import Bench
from twin.instrument import response_matrix
from twin.materials import lamp, reflectance
from twin.spectra import FloatArray

PARTS = load_parts()
SEED = PARTS.assembly("seed-translucent").parts
THICK = (0.3, 0.6)
CENTRES = np.array([515.0, 590.0])


def chip_bench(**changes: object) -> Bench:
    """The seed's bench with a chip."""
    own = tuple("as7341" if name == "spectrometer" else name for name in SEED)
    return Candidate(own, THICK).bench(PARTS, []).model_copy(update=changes)


@pytest.fixture(scope="module")
def steep() -> tuple[Bench, View, Optics, Table]:
    bench = chip_bench()
    view = View.of(bench, CENTRES)
    optics = Optics((Medium("polyjet_white", 1.5, None),), THICK)
    return bench, view, optics, Tables(optics).of(0, bench, view)


def brute_force(bench: Bench, medium: Medium, mm: float) -> FloatArray:
    """Captures (W, 3) averaged over the bands, light solved every 4 nm."""
    chip = bench.instrument
    fine = np.linspace(380.0, 780.0, 101)
    parts, _ = solved(bench, medium, mm, fine)
    both = (bench.background.black, bench.background.white)
    light = intensities(parts, [reflectance(each.reflectance, fine) for each in both])
    rows = response_matrix(chip, fine)[np.searchsorted(chip.wavelength_nm, CENTRES)]
    seen = []
    for column, spectrum in enumerate((bench.panel_spectrum,) * 2 + (bench.beam.spectrum,)):
        own = rows * lamp(spectrum, fine)
        seen.append(own @ light[:, column] / own.sum(axis=1))
    return np.stack(seen, axis=-1)


def test_light_in_bands_is_the_average_over_wavelength(
    steep: tuple[Bench, View, Optics, Table],
) -> None:
    bench, view, optics, table = steep
    seen = view.light(optics, bench).value[0]
    at_mean = table.light(coordinates(table.mean))[0]
    for k, mm in enumerate(THICK):
        exact = brute_force(bench, optics.media[0], mm)
        np.testing.assert_allclose(seen[k], exact, rtol=0.005)
        # Control: the average material passes far less, as light goes where extinction is low.
        assert np.all(at_mean[k, :, 2] < 0.97 * exact[:, 2])
    assert at_mean[1, 0, 2] < 0.8 * seen[1, 0, 2]


def test_slopes_in_bands_are_those_of_the_average(steep: tuple[Bench, View, Optics, Table]) -> None:
    bench, view, optics, _ = steep
    found, step = view.light(optics, bench), 1e-4
    medium = optics.media[0]
    solved_at = [
        solved(bench, medium, THICK[1], view.solved_nm, more_mm=own)[0] for own in (-step, step)
    ]
    both = (bench.background.black, bench.background.white)
    rho = [reflectance(each.reflectance, view.solved_nm) for each in both]
    low, high = (view.value(intensities(parts, rho)) for parts in solved_at)
    np.testing.assert_allclose(
        found.slope[0, 1, ..., 4], (high - low) / (2 * step), rtol=1e-3, atol=1e-6
    )


def test_bands_do_nothing_to_what_is_the_same_at_all_wavelengths() -> None:
    flat = Medium("flat", 1.5, (0.9, 3.0, 0.5))
    bench = chip_bench(panel_spectrum=1.0)
    bench = bench.model_copy(update={"beam": bench.beam.model_copy(update={"spectrum": 1.0})})
    view, optics = View.of(bench, CENTRES), Optics((flat,), THICK)
    np.testing.assert_allclose(view.mean(flat), flat.at(CENTRES), rtol=1e-12)
    seen = view.light(optics, bench).value[0]
    # only the black, whose reflectance is not the same everywhere, is averaged at all
    at_centre = optics.light(bench, CENTRES).value[0]
    np.testing.assert_allclose(seen[..., 1:], at_centre[..., 1:], rtol=1e-3)
    np.testing.assert_allclose(seen[..., 0], at_centre[..., 0], rtol=0.01)
    table = Tables(optics).of(0, bench, view)
    exact = table.light(coordinates(table.mean))[0]
    shift, _ = apparent(table, [0, 1], exact, np.tile(np.eye(6) * 1e3, (2, 1, 1)))
    np.testing.assert_allclose(shift, 0.0, atol=1e-9)


def test_tables_are_the_engine_and_their_slopes_its_slopes(
    steep: tuple[Bench, View, Optics, Table],
) -> None:
    bench, _, optics, table = steep
    place = coordinates(table.mean) - np.array([0.6, 0.7, 0.5])
    value, slope = table.light(place)
    for k, mm in enumerate(THICK):
        parts, _ = solved(bench, optics.media[0], mm, CENTRES, values=material_at(place))
        np.testing.assert_allclose(value[k], intensities(parts, list(table.rho)), rtol=3e-3)
    for axis in range(3):
        step = 1e-5 * np.eye(3)[axis]
        high, low = (table.light(place + s * step)[0] for s in (1, -1))
        np.testing.assert_allclose(slope[..., axis], (high - low) / 2e-5, rtol=1e-5, atol=1e-9)


def test_apparent_material_is_what_a_fit_with_the_engine_finds(
    steep: tuple[Bench, View, Optics, Table],
) -> None:
    bench, view, optics, table = steep
    seen = view.light(optics, bench).value[0]
    sd = np.hypot(0.01 * seen, 5e-4)
    weight = np.array([np.diag(1.0 / sd[:, w].ravel()) for w in range(2)])
    shift, slope = apparent(table, [0, 1], seen, weight)
    for w in range(2):

        def left(place: FloatArray, w: int = w) -> FloatArray:
            rows = []
            for k, mm in enumerate(THICK):
                parts, _ = solved(bench, optics.media[0], mm, CENTRES[w : w + 1],
                                  values=material_at(place[None]))  # fmt: skip
                light = intensities(parts, list(table.rho[:, w : w + 1]))[0]
                rows.append((light - seen[k, w]) / sd[k, w])
            return np.concatenate(rows)

        exact = least_squares(left, coordinates(table.mean)[w], diff_step=1e-3).x
        np.testing.assert_allclose(
            shift[w], material_at(exact) - table.mean[w], rtol=0.04, atol=2e-5
        )
    # it is thinner than the average, as light passes where extinction is low
    assert np.all(shift[:, 1] < -0.02 * table.mean[:, 1])
    # Control: one linear step from the average material ends elsewhere.
    value, by_place = table.light(coordinates(table.mean))
    lean = by_place[:, 0].reshape(6, 3) / sd[:, 0].reshape(6, 1)
    step = np.linalg.lstsq(lean, ((seen - value) / sd)[:, 0].ravel(), rcond=None)[0]
    linear = step[1] * table.mean[0, 1]
    assert abs(linear - shift[0, 1]) > 0.1 * abs(shift[0, 1])
    assert slope.shape == (2, 2, 3, 3)


def test_weights_whiten_noise_and_tolerances() -> None:
    rng = np.random.Generator(np.random.Philox(key=3))
    value, moved = rng.uniform(0.1, 1.0, (2, 4, 3)), 0.01 * rng.standard_normal((2, 4, 3, 3))
    noise = np.tile(1e-4 * np.eye(3), (2, 4, 1, 1))
    weight = weights(value, noise, moved, 2)
    for w in range(4):
        total = np.kron(np.eye(2), 1e-4 * np.eye(3))
        total += np.diag((1e-4 * value[:, w].ravel()) ** 2 + 1e-18)
        for column in range(2):
            own = moved[:, w, :, column].ravel()
            total += np.outer(own, own)
        for s in range(2):
            own = np.zeros(6)
            own[3 * s : 3 * s + 3] = moved[s, w, :, 2]
            total += np.outer(own, own)
        np.testing.assert_allclose(weight[w] @ total @ weight[w].T, np.eye(6), atol=1e-9)


def test_a_chip_is_predicted_with_its_bands_and_a_spectrometer_without() -> None:
    goal = Goal.model_validate(
        {
            "title": "a test",
            "materials": [{"name": "polyjet_white"},
                          {"name": "flat", "albedo": 0.95, "sigma_t_per_mm": 3.0, "g": 0.7}],
            "targets": {"sigma_t_relative": 0.03},
            "protocol": {"thickness_mm": THICK, "samples": [2]},
            "wavelength": {"start_nm": 500.0, "stop_nm": 680.0, "step_nm": 60.0},
        }
    )  # fmt: skip
    predictor = TranslucentPredictor(goal, PARTS)
    plain = Candidate(SEED, THICK)
    chip = Candidate(tuple("as7341" if name == "spectrometer" else name for name in SEED), THICK)
    assert not predictor.of([plain]).bias.any()
    found = predictor.of([chip])
    assert np.all(found.bias[0, 0, :, 1] < 0.0)
    assert not found.bias[0, 1].any()
    np.testing.assert_allclose(found.error, np.hypot(found.standard, found.bias))
    assert predictor.limits(chip)["sigma_t_relative"]["width of the bands"] > 0.3
    assert "width of the bands" not in predictor.limits(plain)["sigma_t_relative"]
