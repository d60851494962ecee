"""Corrections: against hand-computed values, and their covariance against simulated visits."""

from __future__ import annotations

import numpy as np
import pytest

from tests.measurement.visits import QUIET, RHO_WHITE, WAVELENGTH_NM, readings, visit
from twin.bench import Sample
from twin.errors import InputError
from twin.instrument import (
    Spectrometer,
    count_variance,
    counts_of_electrons,
    lamp_drift,
    simulate_counts,
)
from twin.measurement import (
    Captures,
    Measurement,
    Provenance,
    RelativeRow,
    RelativeSpectra,
    Shot,
    measured_black_reflectance,
    relative_intensities,
)


def test_values_by_hand() -> None:
    result = relative_intensities(visit())
    # The first pixel: D 100, D' 150 at twice the time, W 10100, B 5100.
    expected = np.array(
        [
            [RHO_WHITE * 1000 / 10000, RHO_WHITE * 3000 / 10000, (1000 / 0.2) / (5000 / 0.1)],
            [RHO_WHITE * 2000 / 10000, RHO_WHITE * 6000 / 10000, (2000 / 0.2) / (5000 / 0.1)],
        ]
    )
    np.testing.assert_allclose(result.value[:, :, 0], expected, rtol=1e-12)
    assert result.value.shape == (2, 3, 3)
    assert result.covariance.shape == (3, 6, 6)
    assert result.valid.all()
    assert result.sample_names == ("a", "b")
    assert result.repeats == 1


def test_variance_by_hand() -> None:
    """One value of one sample: every term written out."""
    table = readings()
    result = relative_intensities(visit(table))
    counts = np.array([values[0] for _, values in table])
    dark, white, black = counts[0], counts[2], counts[5]
    v_dark, v_white, v_black = count_variance(QUIET, np.array([dark, white, black]), dark, 1)
    signal, reference = black - dark, white - dark
    by_signal, by_reference = RHO_WHITE / reference, -RHO_WHITE * signal / reference**2
    expected = (
        by_signal**2 * v_black
        + by_reference**2 * v_white
        + (by_signal + by_reference) ** 2 * v_dark  # one dark, subtracted from both
    )
    assert result.covariance[0, 0, 0] == pytest.approx(expected, rel=1e-12)
    other = RHO_WHITE * 2000 / 10000
    shared = (signal * RHO_WHITE / reference) * other * v_white / reference**2 + (
        by_signal + by_reference
    ) * (by_signal - other / reference) * v_dark
    assert result.covariance[0, 0, 3] == pytest.approx(shared, rel=1e-12)


def test_a_reference_of_the_sample_wins_over_that_of_the_visit() -> None:
    own = (Shot("white_reference", 0.1, "b"), [20100.0, 40110.0, 60120.0])
    plain, with_own = relative_intensities(visit()), relative_intensities(visit([*readings(), own]))
    np.testing.assert_array_equal(with_own.value[0], plain.value[0])
    np.testing.assert_allclose(with_own.value[1, :2], plain.value[1, :2] / 2, rtol=1e-12)
    np.testing.assert_array_equal(with_own.value[1, 2], plain.value[1, 2])


def test_a_dark_of_the_sample_wins_over_that_of_the_visit() -> None:
    own = (Shot("dark", 0.1, "b"), [300.0, 310.0, 320.0])
    plain, with_own = relative_intensities(visit()), relative_intensities(visit([*readings(), own]))
    np.testing.assert_array_equal(with_own.value[0], plain.value[0])
    change = RHO_WHITE * 200 / np.array([10000.0, 20000.0, 30000.0])
    np.testing.assert_allclose(with_own.value[1, 0], plain.value[1, 0] - change, rtol=1e-12)


def test_repeats_are_averaged_and_their_variance_falls() -> None:
    table = readings()
    twice = table + [
        (Shot(s.capture, s.integration_s, s.sample, repeat=1), values) for s, values in table
    ]
    once, averaged = relative_intensities(visit(table)), relative_intensities(visit(twice))
    np.testing.assert_allclose(averaged.value, once.value, rtol=1e-12)
    np.testing.assert_allclose(averaged.covariance, once.covariance / 2, rtol=1e-9)
    assert averaged.repeats == 2


def test_gain_scales_like_time() -> None:
    table = [
        (Shot(s.capture, s.integration_s / 2, s.sample, gain=2.0), values)
        if s.integration_s == 0.2
        else (s, values)
        for s, values in readings()
    ]
    np.testing.assert_allclose(
        relative_intensities(visit(table)).value, relative_intensities(visit()).value, rtol=1e-12
    )


def test_black_reflectance_by_hand() -> None:
    black = measured_black_reflectance(visit())
    assert black is not None
    np.testing.assert_allclose(
        black.value, RHO_WHITE * np.array([300 / 10000, 600 / 20000, 900 / 30000]), rtol=1e-12
    )
    assert np.all(black.sigma > 0)
    assert np.all(black.sigma < 0.01)
    without = [item for item in readings() if item[0].capture != "black_reference"]
    assert measured_black_reflectance(visit(without)) is None


def test_saturated_and_dead_pixels_are_masked_and_counted() -> None:
    table = readings()
    saturated = np.zeros((len(table), 3), bool)
    saturated[5, 1] = True  # black of "a"
    table[-1][1][2] = np.nan  # collimated of "b"
    result = relative_intensities(visit(table, saturated=saturated))
    expected = np.ones((2, 3, 3), bool)
    expected[0, 0, 1] = expected[1, 2, 2] = False
    np.testing.assert_array_equal(result.valid, expected)
    np.testing.assert_array_equal(np.isfinite(result.value), expected)
    assert np.isnan(result.covariance[1, 0]).all()
    assert np.isfinite(result.covariance[1, 1:, 1:]).all()
    assert "1 of 3 pixels masked: black of 'a' saturated" in result.reasons
    assert "1 of 3 pixels masked: collimated of 'b' not a number" in result.reasons


def test_a_saturated_reference_masks_what_uses_it() -> None:
    saturated = np.zeros((len(readings()), 3), bool)
    saturated[2, 0] = True
    valid = relative_intensities(visit(saturated=saturated)).valid
    assert not valid[:, :2, 0].any()
    assert valid[:, 2].all()
    assert valid[:, :, 1:].all()


def test_one_saturated_repeat_masks_the_pixel() -> None:
    """The mean of the other repeats would be of those that happened to read low."""
    table = readings()
    table.append((Shot("black", 0.1, "a", repeat=1), list(table[5][1])))
    saturated = np.zeros((len(table), 3), bool)
    saturated[-1, 0] = True
    assert not relative_intensities(visit(table, saturated=saturated)).valid[0, 0, 0]


def test_a_pixel_without_light_is_masked_and_a_reference_without_light_refused() -> None:
    table = readings()
    table[2][1][0] = 101.0
    result = relative_intensities(visit(table))
    assert not result.valid[:, :2, 0].any()
    assert any("not clearly above the dark" in reason for reason in result.reasons)
    table[2][1][:] = [0.0, 0.0, 0.0]
    with pytest.raises(InputError, match="white_reference of the visit that is zero"):
        relative_intensities(visit(table))


@pytest.mark.parametrize(
    ("capture", "sample", "message"),
    [
        ("white_reference", "", "no white_reference for black of 'a'"),
        ("beam_reference", "", "no beam_reference for collimated of 'a'"),
        ("dark", "", "no dark for white_reference"),
        ("collimated", "b", "no capture 'collimated'"),
    ],
)
def test_something_missing(capture: str, sample: str, message: str) -> None:
    table = [t for t in readings() if (t[0].capture, t[0].sample) != (capture, sample)]
    with pytest.raises(InputError, match=message):
        relative_intensities(visit(table))


def test_a_dark_of_another_time_is_refused() -> None:
    table = [item for item in readings() if item[0] != Shot("dark", 0.2)]
    with pytest.raises(InputError, match=r"no dark for collimated of 'a' \(0.2 s\)"):
        relative_intensities(visit(table))


def test_a_capture_saturated_everywhere() -> None:
    saturated = np.zeros((len(readings()), 3), bool)
    saturated[6] = True
    with pytest.raises(InputError, match="white of 'a' saturated at every wavelength"):
        relative_intensities(visit(saturated=saturated))


def test_the_white_is_not_extrapolated() -> None:
    measurement = visit()
    table = {"wavelength_nm": [500, 700], "value": [0.9, 0.9]}
    config = measurement.bench.model_dump()
    config["background"]["white"]["reflectance"] = table
    bench = type(measurement.bench).model_validate(config)
    result = relative_intensities(
        Measurement(bench, measurement.samples, captures=measurement.captures)
    )
    assert not result.valid[:, :2, 0].any()
    assert result.valid[:, :, 1:].all()
    assert result.valid[:, 2, 0].all()
    assert any("certified reflectance" in reason for reason in result.reasons)


# --- covariance against simulated visits ----------------------------------------------------

NOISY = Spectrometer(pixels_nm=(450.0, 550.0, 650.0), averages=2, off=("nonuniformity",))
RATES = {
    "dark": 0.0,
    "white_reference": 4e6,
    "beam_reference": 3e6,
    "black": 1e6,
    "white": 2e6,
    "collimated": 2e5,
}
SHOTS = [
    *(Shot(c, 0.1, averages=2) for c in ("dark", "white_reference", "beam_reference")),
    *(
        Shot(c, 0.1, name, averages=2)
        for name in ("a", "b")
        for c in ("black", "white", "collimated")
    ),
]
VISITS = 1500


@pytest.fixture(scope="module")
def simulated() -> tuple[np.ndarray, np.ndarray]:
    """Values of many simulated visits (V, 6, 3), and the propagated covariance (3, 6, 6)."""
    shape = np.array([0.3, 1.0, 0.6])
    values = np.empty((VISITS, 6, 3))
    covariances = np.zeros((3, 6, 6))
    for number in range(VISITS):
        lamps = [lamp_drift(NOISY, len(SHOTS), seed=number, lamp=lamp) for lamp in (0, 1)]
        counts = np.stack(
            [
                simulate_counts(
                    NOISY,
                    RATES[shot.capture] * shape,
                    shot.integration_s,
                    seed=number,
                    shot=index,
                    lamp=lamps["beam" in shot.capture or shot.capture == "collimated"][index],
                ).counts
                for index, shot in enumerate(SHOTS)
            ]
        )
        table = [(shot, list(row)) for shot, row in zip(SHOTS, counts, strict=True)]
        result = relative_intensities(visit(table, instrument=NOISY))
        values[number] = result.value.reshape(6, 3)
        covariances += result.covariance / VISITS
    return values, covariances


def _largest_z(values: np.ndarray, covariance: np.ndarray) -> float:
    """Largest deviation of the sample covariance, in its standard errors (Gaussian values)."""
    worst = 0.0
    for pixel in range(values.shape[2]):
        found, expected = np.cov(values[:, :, pixel].T), covariance[pixel]
        diagonal = np.diag(expected)
        error = np.sqrt((np.outer(diagonal, diagonal) + expected**2) / (len(values) - 1))
        worst = max(worst, float(np.max(np.abs(found - expected) / error)))
    return worst


def test_covariance_is_that_of_simulated_visits(
    simulated: tuple[np.ndarray, np.ndarray],
) -> None:
    assert _largest_z(*simulated) < 4.5  # 63 different entries


def test_control_without_the_shared_terms_must_fail(
    simulated: tuple[np.ndarray, np.ndarray],
) -> None:
    values, covariance = simulated
    assert _largest_z(values, covariance * np.eye(6)) > 10


def test_what_wavelengths_share_is_that_of_simulated_visits(
    simulated: tuple[np.ndarray, np.ndarray],
) -> None:
    values, covariance = simulated
    shape = np.array([0.3, 1.0, 0.6])
    rates = np.array([RATES[shot.capture] * shape + 300 for shot in SHOTS])
    counts = 2396 + rates * 0.1 / NOISY.electrons_per_count
    table = [(shot, list(row)) for shot, row in zip(SHOTS, counts, strict=True)]
    common = relative_intensities(visit(table, instrument=NOISY)).common
    assert common is not None
    blind = []
    for one, other in ((0, 1), (0, 2), (1, 2)):
        off = values - values.mean(axis=0)
        found = off[:, :, one].T @ off[:, :, other] / (VISITS - 1)
        expected = np.einsum("ki,kj->ij", common[:, one], common[:, other])
        own = [np.diag(covariance[pixel]) for pixel in (one, other)]
        error = np.sqrt((np.outer(*own) + expected**2) / (VISITS - 1))
        assert np.max(np.abs(found - expected) / error) < 4.5
        blind.append(np.max(np.abs(found) / error))
    # The control: wavelengths that share nothing.
    assert max(blind) > 6


def test_control_without_the_lamp_must_fail(simulated: tuple[np.ndarray, np.ndarray]) -> None:
    values, _ = simulated
    steady = NOISY.model_copy(update={"off": ("nonuniformity", "lamp_drift")})
    shape = np.array([0.3, 1.0, 0.6])
    table = [
        (s, list(2396 + (RATES[s.capture] * shape + 300) * 0.1 / NOISY.electrons_per_count))
        for s in SHOTS
    ]
    result = relative_intensities(visit(table, instrument=steady))
    assert _largest_z(values, result.covariance) > 7


def test_noise_from_repeats_agrees_with_the_sensor() -> None:
    """Nobody described the instrument: photon transfer finds its noise from the scatter."""
    wavelength = np.linspace(400, 700, 200)
    sensor = Spectrometer(pixels_nm=tuple(wavelength), off=("lamp_drift", "nonuniformity"))
    shots = [Shot(s.capture, 0.1, s.sample, r, averages=10) for r in range(4) for s in SHOTS]
    lit = 0.01 + 0.99 * np.exp(-(((wavelength - 550) / 60) ** 2))  # two decades of signal
    counts = np.stack(
        [
            simulate_counts(sensor, RATES[shot.capture] * lit, 0.1, seed=3, shot=index).counts
            for index, shot in enumerate(shots)
        ]
    )
    captures = Captures(tuple(shots), wavelength, counts, np.zeros(counts.shape, bool))
    samples = tuple(Sample(name=name, thickness_mm=1.0) for name in ("a", "b"))
    bench = visit(instrument=sensor).bench
    sigma = {
        noise: relative_intensities(
            Measurement(bench, samples, captures, provenance=Provenance(noise=noise))
        ).sigma
        for noise in ("instrument", "repeats")
    }
    # 9 groups of 200 pixels with 3 degrees of freedom tell a variance to 2 %, a sigma to 1 %; where
    # the reference is dim, read noise alone counts, which a few of them tell.
    np.testing.assert_allclose(sigma["repeats"], sigma["instrument"], rtol=0.05)


def test_identical_repeats_say_nothing_about_noise() -> None:
    table = readings()
    table += [(Shot(s.capture, s.integration_s, s.sample, 1), values) for s, values in table]
    with pytest.raises(InputError, match="repeats that are all identical"):
        relative_intensities(visit(table, provenance=Provenance(noise="repeats")))


def test_a_wrong_description_is_noticed() -> None:
    noise = np.random.Generator(np.random.Philox(key=5)).standard_normal((2, 11, 3))
    table = [
        (Shot(s.capture, s.integration_s, s.sample, r), list(np.array(v) + 200 * noise[r, i]))
        for r in range(2)
        for i, (s, v) in enumerate(readings())
    ]
    reasons = relative_intensities(visit(table)).reasons
    assert any("times as much as the described instrument" in reason for reason in reasons)
    calm = relative_intensities(visit()).reasons
    assert not any("times as much" in reason for reason in calm)


def test_linearised_counts_have_no_bias() -> None:
    """Expected counts of a bent sensor: the true ratio comes back unless refused."""
    sensor = Spectrometer(
        pixels_nm=tuple(WAVELENGTH_NM), off=("lamp_drift", "stray_light"), nonlinearity=-0.03
    )
    light = np.array([2e6, 5e6, 8e6])
    share = {"white_reference": 1.0, "beam_reference": 0.5, "black": 0.1, "white": 0.4}
    table = [
        (
            shot,
            list(
                counts_of_electrons(
                    sensor,
                    0.1 * (300 + light * share.get(shot.capture, 0.02 * (shot.sample != ""))),
                )
            ),
        )
        for shot in SHOTS
    ]
    measurement = visit(table, instrument=sensor)
    true = np.array([0.1 * RHO_WHITE, 0.4 * RHO_WHITE, 0.02 / 0.5])[:, None] * np.ones(3)
    straight = relative_intensities(measurement)
    plain = relative_intensities(measurement, linearise=False)
    np.testing.assert_allclose(straight.value[0], true, rtol=1e-9)
    assert np.max(np.abs(plain.value[0] / true - 1)) > 0.005
    np.testing.assert_allclose(straight.sigma, plain.sigma, rtol=0.05)
    assert any("linearised" in reason for reason in straight.reasons)


def test_described_stray_light_is_taken_away() -> None:
    """Counts with a share of the mean light in every pixel: the true ratios come back."""
    off = ("lamp_drift", "nonlinearity")
    share, light = 0.02, np.array([100.0, 2000.0, 8000.0])
    fraction = {"white_reference": 1.0, "beam_reference": 0.5, "black": 0.1, "white": 0.4}
    spectral = {"black": np.array([3.0, 1.0, 0.2])}
    table = []
    for shot in SHOTS:
        own = light * fraction.get(shot.capture, 0.02 * (shot.sample != ""))
        own = own * spectral.get(shot.capture, 1.0)
        table.append((shot, list(500.0 + (1 - share) * own + share * own.mean())))
    true = 0.1 * RHO_WHITE * spectral["black"]
    for described, agrees in ((share, True), (0.0, False)):
        sensor = Spectrometer(
            pixels_nm=tuple(WAVELENGTH_NM), off=off, stray_light_fraction=described
        )
        dark = [(s, c if s.capture != "dark" else [500.0] * 3) for s, c in table]
        found = relative_intensities(visit(dark, instrument=sensor)).value[0, 0]
        assert np.allclose(found, true, rtol=1e-9) is agrees


# --- relative intensities that came ready-made ----------------------------------------------


def _relative(value: np.ndarray, sigma: np.ndarray, repeats: int = 1) -> Measurement:
    rows = tuple(
        RelativeRow("a", capture, repeat)
        for capture in ("black", "white", "collimated")
        for repeat in range(repeats)
    )
    return Measurement(
        bench=visit().bench,
        samples=(Sample(name="a", thickness_mm=1.0),),
        relative=RelativeSpectra(rows, WAVELENGTH_NM, value, sigma),
    )


def test_sigma_becomes_a_diagonal_covariance() -> None:
    value = np.arange(9.0).reshape(3, 3) / 10
    sigma = (1 + np.arange(9.0).reshape(3, 3)) / 1000
    result = relative_intensities(_relative(value, sigma))
    np.testing.assert_array_equal(result.value[0], value)
    np.testing.assert_allclose(result.sigma[0], sigma)
    np.testing.assert_array_equal(result.covariance[0], np.diag(sigma[:, 0] ** 2))


def test_what_no_sample_has_is_masked_and_counted() -> None:
    value = np.full((3, 3), 0.5)
    value[0, 1], value[2, 2] = 45.0, -0.9
    result = relative_intensities(_relative(value, np.full((3, 3), 0.01)))
    masked = [(0, 1), (2, 2)]
    assert [tuple(at) for at in np.argwhere(~result.valid[0])] == masked
    assert np.isnan(result.value[0][~result.valid[0]]).all()
    assert np.isnan(result.covariance[1, 0]).all()
    assert any("1 of 3 pixels masked: black" in reason for reason in result.reasons)
    assert any("1 of 3 pixels masked: collimated" in reason for reason in result.reasons)


def test_noise_alone_masks_nothing() -> None:
    value = np.full((3, 3), 0.5)
    value[0, 1] = -0.9
    assert relative_intensities(_relative(value, np.full((3, 3), 0.3))).valid.all()


def test_a_sample_without_any_light_is_refused() -> None:
    with pytest.raises(InputError, match="zero at every wavelength") as error:
        relative_intensities(_relative(np.zeros((3, 3)), np.full((3, 3), 0.01)))
    assert "sample" in error.value.place


def test_sigma_from_repeats() -> None:
    noise = np.random.Generator(np.random.Philox(key=6)).standard_normal((150, 3))
    repeated = relative_intensities(
        _relative(0.5 + 0.01 * noise, np.full((150, 3), np.nan), repeats=50)
    )
    assert repeated.repeats == 50
    # 3 pixels with 49 degrees of freedom each: 6 % standard error, pooled over the window.
    np.testing.assert_allclose(repeated.sigma, 0.01 / np.sqrt(50), rtol=0.25)
    with pytest.raises(InputError, match="without sigma and without repeats"):
        relative_intensities(_relative(np.full((3, 3), 0.5), np.full((3, 3), np.nan)))
    with pytest.raises(InputError, match="identical"):
        relative_intensities(_relative(np.full((6, 3), 0.5), np.full((6, 3), np.nan), repeats=2))


def test_a_missing_value_is_masked() -> None:
    value = np.full((3, 3), 0.5)
    value[1, 2] = np.nan
    result = relative_intensities(_relative(value, np.full((3, 3), 0.01)))
    assert not result.valid[0, 1, 2]
    assert result.valid.sum() == 8
    assert np.isnan(result.covariance[2, 1]).all()
    assert "1 of 3 pixels masked: white of 'a' not a number" in result.reasons
