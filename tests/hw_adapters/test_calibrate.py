"""Calibration: wavelengths against lines, linearity, gains."""

from __future__ import annotations

import numpy as np
import pytest

from hw_adapters import calibrate
from hw_adapters.calibrate import LAMP_LINES_NM, check_lines
from tests.hw_adapters.small import bench_of, settings_of, state_of
from twin.errors import InputError

PIXELS = np.linspace(400.0, 800.0, 1600)


def spectrum(shift_nm: float, lines: tuple[float, ...]) -> np.ndarray:
    return sum(3000 * np.exp(-0.5 * ((PIXELS - shift_nm - line) / 0.8) ** 2) for line in lines)


@pytest.mark.parametrize("shift_nm", [0.0, 0.7, -1.2])
@pytest.mark.parametrize("lamp", LAMP_LINES_NM)
def test_a_shift_of_the_wavelengths_is_found(lamp: str, shift_nm: float) -> None:
    found = check_lines(PIXELS, spectrum(shift_nm, LAMP_LINES_NM[lamp]), LAMP_LINES_NM[lamp])
    assert found.true_nm.size >= 3
    assert found.missing_nm == ()
    np.testing.assert_allclose(found.seen_nm - found.true_nm, shift_nm, atol=0.05)


def test_lines_that_are_not_there_are_missing() -> None:
    lines = LAMP_LINES_NM["neon"]
    noise = np.random.Generator(np.random.Philox(key=3)).normal(0, 2.0, PIXELS.size)
    found = check_lines(PIXELS, noise, lines)
    assert found.true_nm.size == 0
    assert set(found.missing_nm) <= set(lines)
    assert len(found.missing_nm) > 3
    assert np.isnan(found.worst_nm)


def test_the_curve_of_the_sensor_is_seen() -> None:
    straight = calibrate(bench_of(state_of(nonlinearity=0.0)), settings_of())
    bent = calibrate(bench_of(state_of(nonlinearity=-0.08)), settings_of())
    assert straight.linearity.worst < 0.01 < 0.02 < bent.linearity.worst
    assert straight.notes == ()
    assert "instrument.nonlinearity" in bent.notes[0]
    assert "virtual spectrometer 1" in bent.notes[0]
    assert straight.white.max() / 65_535 == pytest.approx(0.8, abs=0.02)
    assert straight.dark_noise_counts == pytest.approx(np.hypot(31 / 22, 0.5), rel=0.25)


def test_noise_is_not_taken_for_a_curve() -> None:
    noisy = state_of(nonlinearity=0.0, read_noise_electrons=4000.0)
    found = calibrate(bench_of(noisy), settings_of())
    # At 5 % of the exposure a pixel's signal is 2000 counts, its noise 130; some 50 pixels are lit.
    assert found.linearity.worst < 0.03


def test_the_error_of_a_gain_step_is_seen() -> None:
    dim = {"white_rate_electrons_per_s": 2e6, "nonlinearity": 0.0}
    good = calibrate(bench_of(state_of("chip", **dim)), settings_of())
    state = state_of("chip", **dim)
    state.faults.arm("gain_step_error")
    wrong = calibrate(bench_of(state), settings_of())
    assert good.linearity.of == "gain"
    assert good.linearity.worst < 0.02 < wrong.linearity.worst
    assert any("gain at" in note for note in wrong.notes)


def test_a_lamp_held_before_the_sensor() -> None:
    state = state_of()
    wavelength = np.asarray(state.instrument.wavelength_nm)
    held = []

    def hold(there: bool) -> None:
        held.append(there)
        lines = [1e6 * np.exp(-0.5 * ((wavelength - x) / 1.5) ** 2) for x in LAMP_LINES_NM["neon"]]
        state.shine(sum(lines) if there else None)

    found = calibrate(bench_of(state), settings_of(), lamp="neon", hold_lamp=hold)
    assert held == [True, False]
    assert found.lines.true_nm.size >= 2
    assert found.lines.worst_nm < 0.5
    assert state.drive("panels") == 0.0


def test_what_cannot_be_calibrated_is_refused() -> None:
    with pytest.raises(InputError, match="one of mercury-argon"):
        calibrate(bench_of(state_of()), settings_of(), lamp="candle")
    with pytest.raises(InputError, match="resolves no lines"):
        calibrate(bench_of(state_of("chip")), settings_of(), lamp="neon")
    with pytest.raises(InputError, match="at least 2"):
        calibrate(bench_of(state_of()), settings_of(), frames=1)
