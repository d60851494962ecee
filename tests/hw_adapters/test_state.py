"""The virtual bench: situations, frames, lamps, faults of light and sensor."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest

from hw_adapters import (
    DeviceError,
    Faults,
    RequestOutOfLimits,
    UnknownCommand,
    VirtualChip,
    VirtualClock,
    VirtualSpectrometer,
)
from hw_adapters.faults import BENCH_FAULTS, DEVICE_FAULTS
from hw_adapters.plan import SCENES
from hw_adapters.state import SCRATCH, BenchState
from tests.hw_adapters.small import SENSORS, instrument_of, rates_of, state_of
from twin.errors import InputError
from twin.instrument import Contribution, lamp_drift, simulate_counts


def show(state: BenchState, capture: str, sample: str = "thin") -> None:
    scene = SCENES[capture]
    state.place_sample(sample, scene.present)
    state.move_background(scene.background or "out")
    state.lamps_off()
    if scene.lamp:
        state.set_lamp(scene.lamp, 1.0)
    state.clock.sleep(state.settle_s)


def mean_of(state: BenchState, time_s: float, frames: int, **chip: int | float) -> np.ndarray:
    taken = [state.frame(time_s, **chip) for _ in range(frames)]
    return sum((each.counts for each in taken), np.zeros_like(taken[0].counts)) / frames


@pytest.mark.parametrize("off", [(), *[(name,) for name in get_args(Contribution)]])
@pytest.mark.parametrize("kind", SENSORS)
def test_the_mean_of_the_frames_is_simulate_counts_bit_for_bit(kind: str, off: tuple) -> None:
    if off == ("averages",):
        pytest.skip("without averages simulate_counts takes one frame; a device takes what it says")
    state = state_of(kind, off=off)
    instrument = instrument_of(kind, off=off)
    for capture in SCENES:
        show(state, capture)
        state.announce(5)
        time_s = getattr(instrument, "integration_s", 0.2)
        dark = np.zeros(len(instrument.wavelength_nm))
        lamp = 1 if SCENES[capture].lamp == "beam" else 0
        expected = simulate_counts(
            instrument, rates_of(instrument).get((capture, "thin"), dark),
            time_s, seed=7, shot=5, lamp=lamp_drift(instrument, 6, seed=7, lamp=lamp)[5],
        )  # fmt: skip
        frames = [state.frame(time_s) for _ in range(3)]
        np.testing.assert_array_equal(np.mean([f.counts for f in frames], axis=0), expected.counts)
        np.testing.assert_array_equal(
            np.any([f.saturated for f in frames], axis=0), expected.saturated
        )


def test_that_comparison_can_fail() -> None:
    one, other = state_of(), state_of(seed=8)
    for state in (one, other):
        show(state, "white")
        state.announce(5)
    assert not np.array_equal(one.frame(0.2).counts, other.frame(0.2).counts)
    one.announce(5)
    first = one.frame(0.2).counts
    one.announce(6)
    assert not np.array_equal(first, one.frame(0.2).counts)
    one.announce(5)
    np.testing.assert_array_equal(first, one.frame(0.2).counts)


def test_every_capture_is_a_situation_and_others_are_refused() -> None:
    state = state_of()
    for capture in SCENES:
        show(state, capture, "thick")
        assert state.situation == (capture, "thick")
    state.move_background("white")  # the beam with the white: no capture
    with pytest.raises(DeviceError, match=r"beam lit, background 'white'.*Move the stage"):
        state.frame(0.1)
    state.set_lamp("panels", 1.0)
    with pytest.raises(DeviceError, match="panels and beam lit"):
        _ = state.situation


def test_requests_that_cannot_be_are_refused_and_change_nothing() -> None:
    state = state_of()
    state.set_lamp("panels", 0.5)
    for drive in (-0.1, 1.1, float("nan")):
        with pytest.raises(RequestOutOfLimits, match="0 to 1"):
            state.set_lamp("panels", drive)
    assert state.drive("panels") == 0.5
    with pytest.raises(UnknownCommand, match="'torch'"):
        state.set_lamp("torch", 1.0)
    with pytest.raises(UnknownCommand, match="'grey'"):
        state.move_background("grey")
    with pytest.raises(UnknownCommand, match="'nobody'"):
        state.place_sample("nobody", True)
    with pytest.raises(InputError, match="0 s or more"):
        VirtualClock().sleep(-1.0)


def test_a_lamp_needs_its_time_and_half_the_drive_is_half_the_light() -> None:
    off = tuple(name for name in get_args(Contribution) if name != "saturation")
    state = state_of(off=off)
    show(state, "white_reference")
    level = state.instrument.dark_level_counts
    steady = state.frame(0.05).counts - level
    state.lamps_off()
    state.clock.sleep(1.0)
    state.set_lamp("panels", 1.0)
    early = state.frame(0.05).counts - level
    np.testing.assert_allclose(early / steady, 0.95, rtol=1e-12)
    state.set_lamp("panels", 0.5)
    state.clock.sleep(1.0)
    np.testing.assert_allclose((state.frame(0.05).counts - level) / steady, 0.5, rtol=1e-12)


def test_wrong_rates_are_refused() -> None:
    instrument = instrument_of("spectrometer")
    with pytest.raises(InputError, match="96 pixels"):
        BenchState(instrument, {("white", "a"): np.ones(3)}, samples=("a",))
    with pytest.raises(InputError, match="'b'"):
        BenchState(instrument, {("white", "b"): np.ones(96)}, samples=("a",))
    with pytest.raises(InputError, match="one sample"):
        BenchState(instrument, {}, samples=())


def test_a_wire_gets_whole_counts_or_a_refusal() -> None:
    state = state_of()
    assert np.issubdtype(state.whole_counts(0.1).dtype, np.integer)
    with pytest.raises(InputError, match="quantisation"):
        state_of(off=("quantisation",)).whole_counts(0.1)


# Faults ------------------------------------------------------------------------------------------


def test_faults_happen_at_their_moment_and_once() -> None:
    faults = Faults()
    faults.arm("timeout", operation="*.frame", stage="black", occurrence=2)
    faults.stage = "white"
    assert faults.hook("usb650.frame") == ""
    faults.stage = "black"
    asked = [faults.hook(name) for name in ("a.write", "a.frame", "a.frame", "a.frame")]
    assert asked == ["", "", "timeout", ""]
    assert faults.log == [("timeout", "a.frame", "black")]


def test_faults_of_the_bench_last_until_they_are_repaired() -> None:
    faults = Faults()
    faults.arm("light_leak", stage="black")
    assert faults.active() == frozenset()
    faults.stage = "black"
    assert faults.active() == {"light_leak"}
    faults.stage = "white"
    assert faults.active() == {"light_leak"}
    assert faults.hook("x.frame") == ""
    faults.disarm("light_leak")
    assert faults.active() == frozenset()


def test_unknown_faults_are_refused() -> None:
    with pytest.raises(InputError, match="Did you mean `timeout`"):
        Faults().arm("timeuot")
    with pytest.raises(InputError, match="1 or more"):
        Faults().arm("timeout", occurrence=0)
    assert not set(DEVICE_FAULTS) & set(BENCH_FAULTS)


EFFECTS = {
    "saturation": lambda before, after: after.max() == 65_535,
    "hot_pixel": lambda before, after: np.sum(np.abs(after - before) > 5000) == 1,
    "lamp_drift": lambda before, after: (
        np.all(after < before) and after.mean() > 0.9 * before.mean()
    ),
    "light_leak": lambda before, after: np.all(after > before),
}


@pytest.mark.parametrize("name", EFFECTS)
def test_faults_of_the_bench_change_the_counts(name: str) -> None:
    quiet = ("shot_noise", "read_noise", "lamp_drift")
    state = state_of(off=quiet)
    show(state, "white_reference")
    before = state.frame(0.2).counts
    state.faults.arm(name)
    assert EFFECTS[name](before, state.frame(0.2).counts)
    state.faults.disarm()
    np.testing.assert_array_equal(state.frame(0.2).counts, before)


def test_the_error_of_a_gain_step() -> None:
    state = state_of("chip", off=("shot_noise", "read_noise", "lamp_drift", "quantisation"))
    show(state, "black_reference")
    low, high = state.frame(gain=16.0).counts, state.frame(gain=64.0).counts
    state.faults.arm("gain_step_error")
    np.testing.assert_array_equal(state.frame(gain=16.0).counts, low)
    wrong = state.frame(gain=64.0).counts
    level = state.instrument.dark_level_counts
    # The curve of the converter bends a little between the two readings.
    np.testing.assert_allclose((wrong - level) / (high - level), 0.93, rtol=1e-3)


# Sensors in process ------------------------------------------------------------------------------


def test_the_first_frame_after_a_change_is_stale() -> None:
    state = state_of()
    show(state, "white_reference")
    sensor = VirtualSpectrometer(state)
    sensor.configure(0.02)
    sensor.discard()
    state.announce(SCRATCH)
    short = sensor.capture().counts
    sensor.configure(0.1)
    stale = sensor.capture().counts
    fresh = sensor.capture().counts
    assert abs(stale.mean() - short.mean()) < 50
    assert fresh.mean() - short.mean() > 5000


def test_a_frame_that_comes_twice_is_read_again() -> None:
    state = state_of()
    sensor = VirtualSpectrometer(state)
    sensor.configure(0.05, 4)
    sensor.discard()
    state.announce(3)
    expected = sensor.capture().counts
    state.faults.arm("stale_frame", operation="*.frame", occurrence=2)
    state.announce(3)
    np.testing.assert_array_equal(sensor.capture().counts, expected)
    assert sensor.repeated == 1


def test_the_chip_reads_in_two_passes() -> None:
    state = state_of("chip")
    sensor = VirtualChip(state)
    applied = sensor.configure(16.0, 99, 599, 2)
    frame = sensor.capture()
    first, second = frame.pass_times_s
    assert second - first == pytest.approx(applied.integration_s)
    assert frame.full_scale == 60_000
    assert state.clock.now_s() == pytest.approx(4 * applied.integration_s)


def test_a_sensor_of_the_other_kind_is_refused() -> None:
    with pytest.raises(InputError, match="a chip on the bench"):
        VirtualSpectrometer(state_of("chip"))
    with pytest.raises(InputError, match="a spectrometer on the bench"):
        VirtualChip(state_of())
