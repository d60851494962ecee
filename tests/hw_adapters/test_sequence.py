"""The runner: the plan, the journal, faults at every stage, and going on afterwards."""

from __future__ import annotations

import re
from collections import Counter
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hw_adapters import (
    FAULTS,
    CaptureStopped,
    DeviceError,
    Faults,
    Journal,
    ManualHolder,
    ManualLights,
    ManualStage,
    RequestOutOfLimits,
    UnknownCommand,
    WrongDevice,
    capture_visit,
)
from hw_adapters.faults import BENCH_FAULTS, WIRE_ONLY
from hw_adapters.plan import SCENES
from tests.hw_adapters.small import SENSORS, bench_of, settings_of, state_of, visit_of
from twin.errors import InputError
from twin.measurement import Measurement, read_measurement, relative_intensities, write_measurement

SHORT: dict[str, Any] = {"repeats": 1, "reference_repeats": 1}
STAGES = ("warm_up", "expose white_reference", "expose collimated", *SCENES)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Measurement]:
    """An undisturbed visit with each sensor."""
    folder = tmp_path_factory.mktemp("whole")
    return {kind: visit_of(folder / kind, kind, **SHORT) for kind in SENSORS}


def test_the_visit_holds_every_capture_with_its_darks(tmp_path: Path) -> None:
    found = visit_of(tmp_path / "j")
    shots = found.captures.shots
    for name in ("thin", "thick"):
        order = [shot.capture for shot in shots if shot.sample == name]
        taken = Counter(order)
        assert {taken[capture] for capture in ("black", "white", "collimated")} == {2}
        assert taken["white_reference"] == taken["beam_reference"] == 4
        assert order[0] == "dark"
    assert [shot.capture for shot in shots[-6:]] == ["dark"] * 6
    darks = {(s.sample, s.integration_s, s.gain) for s in shots if s.capture == "dark"}
    assert {(s.sample, s.integration_s, s.gain) for s in shots} == darks
    times = [shot.time_s for shot in shots]
    assert times == sorted(times)
    assert times[0] == 0.0
    assert not found.captures.saturated.any()
    assert relative_intensities(found).value.shape == (2, 3, 96)


def test_the_exposure_fills_the_range_and_every_attempt_is_logged(tmp_path: Path) -> None:
    found = visit_of(tmp_path / "j", **SHORT)
    for shot, counts in zip(found.captures.shots, found.captures.counts, strict=True):
        if shot.capture in ("white_reference", "beam_reference") and shot.sample == "thin":
            assert counts.max() / 65_535 == pytest.approx(0.8, abs=0.02)
    events = list(Journal(tmp_path / "j").events("exposure"))
    assert [event["capture"] for event in events[:2]] == ["white_reference"] * 2
    assert {event["capture"] for event in events} == {
        "white_reference", "beam_reference", "collimated"
    }  # fmt: skip


@pytest.mark.parametrize("kind", SENSORS)
def test_same_seed_same_bytes(kind: str, whole: dict[str, Measurement], tmp_path: Path) -> None:
    again = visit_of(tmp_path / "j", kind, **SHORT)
    assert again == whole[kind]
    one = write_measurement(whole[kind], tmp_path / "one.nc").read_bytes()
    assert write_measurement(again, tmp_path / "other.nc").read_bytes() == one
    assert read_measurement(tmp_path / "other.nc") == whole[kind]
    assert visit_of(tmp_path / "k", kind, seed=8, **SHORT) != whole[kind]


# Faults ------------------------------------------------------------------------------------------


def counts_of(found: Measurement) -> np.ndarray:
    return found.captures.counts


@pytest.mark.parametrize("stage", STAGES)
@pytest.mark.parametrize("name", ["timeout", "unplugging"])
@pytest.mark.parametrize("device", ["sensor", "lights"])
def test_a_device_that_fails_loses_nothing(
    device: str, name: str, stage: str, whole: dict[str, Measurement], tmp_path: Path
) -> None:
    kind = "spectrometer"
    operation = {"sensor": f"{kind}.*", "lights": "lights.*"}[device]
    state = state_of(kind)
    state.faults.arm(name, operation=operation, stage=stage)
    bench = bench_of(state)
    idle = {"sensor": ("warm_up",), "lights": ("black_reference", "white")}
    if stage in idle[device]:
        pytest.skip("the device is not asked for anything at this stage: nothing can fail")
    with pytest.raises(CaptureStopped) as caught:
        capture_visit(bench, settings_of(**SHORT), tmp_path / "j")
    message = str(caught.value)
    failed = {"sensor": "virtual spectrometer 1", "lights": "virtual lights L1"}[device]
    assert message.startswith(failed)
    assert "--resume" in message
    assert re.search(rf"{caught.value.taken}( of \d+)? shots are kept in", message)
    assert stage.split()[-1] in message
    kept = Journal(tmp_path / "j").shots()
    assert len(kept) == caught.value.taken
    if stage not in ("warm_up", "dark") and not stage.startswith("expose"):
        assert len(kept) > 0
        assert "missing: " in message
    for number, taken in kept.items():
        np.testing.assert_array_equal(taken.frame.counts, counts_of(whole[kind])[number])
    bench.sensor.plug_in()
    bench.lights.plug_in()
    found = capture_visit(bench, settings_of(**SHORT), tmp_path / "j", resume=True)
    assert found == whole[kind]


@pytest.mark.parametrize("name", [name for name in FAULTS if name not in WIRE_ONLY])
@pytest.mark.parametrize("stage", STAGES[1:])
@pytest.mark.parametrize("kind", SENSORS)
def test_every_fault_at_every_stage_ends_in_a_whole_visit(
    kind: str, stage: str, name: str, whole: dict[str, Measurement], tmp_path: Path
) -> None:
    """A fault stops the visit or is told in its notes; what it does not alter stays as it was."""
    state = state_of(kind)
    state.faults.arm(name, operation="*.info" if name == "wrong_serial" else "*", stage=stage)
    bench, settings, folder = bench_of(state), settings_of(**SHORT), tmp_path / "j"
    message = ""
    try:
        found = capture_visit(bench, settings, folder)
    except DeviceError as error:
        message = str(error)
        assert state.faults.log
        assert bench.sensor.name in message or "virtual" in message
        kept = len(Journal(folder).shots())
        state.faults.disarm()
        for device in (bench.sensor, bench.lights, bench.stage, bench.holder):
            device.plug_in()
        found = capture_visit(bench, settings, folder, resume=True)
        assert len(found.captures.shots) >= kept
    assert {(shot.capture, shot.sample) for shot in found.captures.shots} == {
        (shot.capture, shot.sample) for shot in whole[kind].captures.shots
    }
    assert np.all(np.isfinite(counts_of(found)))
    if name not in BENCH_FAULTS:
        np.testing.assert_array_equal(counts_of(found), counts_of(whole[kind]))
    if name == "saturation" and not stage.startswith("expose") and stage not in ("dark",):
        assert "saturated" in message
        assert "Dim the lamp" in message


@pytest.mark.parametrize(
    ("name", "stage", "words"),
    [
        ("lamp_drift", "collimated", "fell by"),
        ("hot_pixel", "dark", "1 hot pixel"),
        ("light_leak", "white", "rose by"),
    ],
)
def test_faults_that_last_are_told_in_the_notes(
    name: str, stage: str, words: str, tmp_path: Path
) -> None:
    clean = visit_of(tmp_path / "clean").provenance.notes
    assert not any(words in note for note in clean)
    state = state_of()
    state.faults.arm(name, stage=stage)
    found = capture_visit(bench_of(state), settings_of(), tmp_path / "j")
    told = [note for note in found.provenance.notes if words in note]
    assert told, found.provenance.notes
    assert ":" in told[0]


def test_a_stale_reading_after_a_change_of_light_is_taken_again(tmp_path: Path) -> None:
    expected = visit_of(tmp_path / "whole", "chip", **SHORT)
    state = state_of("chip")
    # The first frame of the reading itself: the one thrown away comes before it.
    state.faults.arm("stale_frame", operation="chip.frame", stage="white", occurrence=2)
    found = capture_visit(bench_of(state), settings_of(averages=1, **SHORT), tmp_path / "j")
    assert state.faults.log
    assert len(found.captures.shots) == len(expected.captures.shots)


def test_wrong_serial_number_and_wrong_wavelengths_are_refused_at_once(tmp_path: Path) -> None:
    state = state_of()
    with pytest.raises(WrongDevice, match=r"virtual spectrometer 1.*'77'.*bench file names"):
        capture_visit(bench_of(state, serial="77"), settings_of(), tmp_path / "a")
    other = np.asarray(state.instrument.wavelength_nm) + 0.5
    with pytest.raises(WrongDevice, match="those of the calibration"):
        capture_visit(bench_of(state, calibrated_nm=other), settings_of(), tmp_path / "b")
    with pytest.raises(WrongDevice, match="those of the calibration, 3"):
        capture_visit(bench_of(state, calibrated_nm=other[:3]), settings_of(), tmp_path / "c")


def test_a_replaced_spectrometer_cannot_go_on_with_a_visit(
    whole: dict[str, Measurement], tmp_path: Path
) -> None:
    state = state_of()
    state.faults.arm("unplugging", stage="black")
    bench = bench_of(state)
    with pytest.raises(CaptureStopped):
        capture_visit(bench, settings_of(**SHORT), tmp_path / "j")
    for device in (bench.sensor, bench.lights, bench.stage, bench.holder):
        device.plug_in()
    state.faults.arm("wrong_serial", operation="spectrometer.info")
    with pytest.raises(WrongDevice, match=r"OTHER-1.*Connect the former one"):
        capture_visit(bench, settings_of(**SHORT), tmp_path / "j", resume=True)
    assert (
        capture_visit(bench, settings_of(**SHORT), tmp_path / "j", resume=True)
        == whole["spectrometer"]
    )


def test_an_interrupt_keeps_what_was_captured_and_switches_the_lamps_off(
    whole: dict[str, Measurement], tmp_path: Path
) -> None:
    state = state_of()

    def progress(done: float, total: float) -> None:
        if done > total / 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        capture_visit(bench_of(state), settings_of(**SHORT), tmp_path / "j", progress=progress)
    kept = Journal(tmp_path / "j").shots()
    assert 0 < len(kept) < len(whole["spectrometer"].captures.shots)
    assert state.drive("panels") == state.drive("beam") == 0.0
    found = visit_of(tmp_path / "j", resume=True, **SHORT)  # after a restart: a new bench
    assert found == whole["spectrometer"]


def test_a_damaged_shot_is_put_aside_and_taken_again(
    whole: dict[str, Measurement], tmp_path: Path
) -> None:
    visit_of(tmp_path / "j", **SHORT)
    path = tmp_path / "j" / "shots" / "000004.shot"
    data = bytearray(path.read_bytes())
    data[-200] ^= 1
    path.write_bytes(bytes(data))
    assert visit_of(tmp_path / "j", resume=True, **SHORT) == whole["spectrometer"]
    assert path.with_suffix(".damaged").read_bytes() == bytes(data)
    assert next(Journal(tmp_path / "j").events("damaged"))["file"] == "000004.shot"


def test_another_visit_does_not_mix_with_a_journal(tmp_path: Path) -> None:
    visit_of(tmp_path / "j", **SHORT)
    with pytest.raises(InputError, match="--resume"):
        visit_of(tmp_path / "j", **SHORT)
    with pytest.raises(InputError, match="settings"):
        visit_of(tmp_path / "j", resume=True, repeats=2, reference_repeats=1)
    with pytest.raises(InputError, match="seed"):
        visit_of(tmp_path / "j", seed=9, resume=True, **SHORT)
    (tmp_path / "j" / "visit.json").write_text("{}")
    with pytest.raises(InputError, match="format None"):
        visit_of(tmp_path / "j", resume=True, **SHORT)


# Exposure ----------------------------------------------------------------------------------------


def test_a_white_that_saturates_at_the_shortest_time_is_refused(tmp_path: Path) -> None:
    state = state_of(white_rate_electrons_per_s=1e9)
    with pytest.raises(CaptureStopped, match="saturates at the shortest integration time"):
        capture_visit(bench_of(state), settings_of(), tmp_path / "j")
    tried = list(Journal(tmp_path / "j").events("exposure"))
    assert tried
    assert all(event["saturated"] for event in tried)
    times = [event["integration_s"] for event in tried]
    assert times[-1] == 0.008
    assert times == sorted(times, reverse=True)


def test_exposure_outside_the_limits_is_refused_and_not_clipped(tmp_path: Path) -> None:
    """Before the lamps warm up, and so that the corrected visit goes into the same folder."""
    for exposure, words in ((1e-5, r"1e-05 s.*0\.008 to 60 s"), (61.0, "61 s.*to 60 s")):
        with pytest.raises(RequestOutOfLimits, match=words) as caught:
            visit_of(tmp_path / "j", exposure=exposure)
        assert not isinstance(caught.value, CaptureStopped)
    assert not Journal(tmp_path / "j").started
    visit_of(tmp_path / "j", exposure=0.008, **SHORT)


@pytest.mark.parametrize(
    ("kind", "changes", "words"),
    [
        ("spectrometer", {"gain": 4.0}, "a gain of 4; expected no gain at all"),
        ("chip", {"exposure": 0.1}, 'an exposure of 0.1 s; expected exposure = "auto"'),
        ("chip", {"gain": 3.0}, "a gain of 3; expected 0.5, 1, 2"),
        ("chip", {"atime": 255, "astep": 65_534}, "an integration time of 46.6"),
    ],
)
def test_settings_that_the_sensor_does_not_have_are_refused(
    kind: str, changes: dict[str, Any], words: str, tmp_path: Path
) -> None:
    with pytest.raises(RequestOutOfLimits, match=re.escape(words)):
        visit_of(tmp_path / "j", kind, **changes)


def test_a_visit_without_a_shot_may_be_resumed_with_other_settings(tmp_path: Path) -> None:
    bright = state_of(white_rate_electrons_per_s=1e9)
    with pytest.raises(CaptureStopped, match="saturates at the shortest"):
        capture_visit(bench_of(bright), settings_of(), tmp_path / "j")
    other = state_of()
    other.faults.arm("wrong_serial", operation="spectrometer.info")
    with pytest.raises(WrongDevice, match="Connect the former one"):
        capture_visit(bench_of(other), settings_of(), tmp_path / "j", resume=True)
    dimmed = capture_visit(bench_of(state_of()), settings_of(**SHORT), tmp_path / "j", resume=True)
    assert dimmed == visit_of(tmp_path / "k", **SHORT)


def test_a_fixed_exposure_that_saturates_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(CaptureStopped, match=r"saturated in .*; or begin a new visit with a"):
        visit_of(tmp_path / "j", exposure=5.0, **SHORT)
    assert len(Journal(tmp_path / "j").shots()) > 0


def test_the_chip_changes_its_gain_before_its_time(tmp_path: Path) -> None:
    shots = visit_of(tmp_path / "j", "chip", **SHORT).captures.shots
    assert len({shot.integration_s for shot in shots}) == 1
    assert len({shot.gain for shot in shots}) > 1
    state = state_of("chip", white_rate_electrons_per_s=9e8)
    bright = capture_visit(bench_of(state), settings_of(**SHORT), tmp_path / "k").captures.shots
    white = next(shot for shot in bright if shot.capture == "white_reference")
    assert white.gain == 0.5
    assert white.integration_s < shots[0].integration_s


def test_a_light_too_faint_is_said(tmp_path: Path) -> None:
    state = state_of(white_rate_electrons_per_s=1e3)
    found = capture_visit(bench_of(state), settings_of(**SHORT, averages=1), tmp_path / "j")
    assert any("at the longest setting" in note for note in found.provenance.notes)


# People ------------------------------------------------------------------------------------------


def test_a_person_is_asked_once_for_each_change(
    whole: dict[str, Measurement], tmp_path: Path
) -> None:
    state, asked = state_of(), []

    def ask(text: str) -> None:
        asked.append(text)
        for word, position in (("black b", "black"), ("white b", "white"), ("away", "out")):
            if word in text:
                state.move_background(position)
        for name in state.samples:
            if f"'{name}'" in text:
                state.place_sample(name, text.startswith("Lay"))

    bench = bench_of(state, stage=ManualStage(ask), holder=ManualHolder(ask, state.samples))
    found = capture_visit(bench, settings_of(**SHORT), tmp_path / "j")
    np.testing.assert_array_equal(counts_of(found), counts_of(whole["spectrometer"]))
    assert all(one != other for one, other in pairwise(asked))
    assert sum("Lay the sample 'thin'" in text for text in asked) == 2


def test_a_person_switches_the_lamps_and_may_walk_away(tmp_path: Path) -> None:
    state, asked = state_of(), []

    def ask(text: str) -> None:
        asked.append(text)
        if "beam on" in text:
            raise InputError("nobody at the keyboard", "a person")
        if text.startswith("Switch the "):
            name, drive = text.removeprefix("Switch the ").rstrip(".").split()
            state.set_lamp(name, 1.0 if drive == "on" else 0.0)

    lights = ManualLights(ask, settle_s=1.0)
    with pytest.raises(RequestOutOfLimits, match="0 or 1"):
        lights.set("panels", 0.5)
    with pytest.raises(UnknownCommand, match="'torch'"):
        lights.set("torch", 1.0)
    with pytest.raises(InputError, match="nobody at the keyboard"):
        capture_visit(bench_of(state, lights=lights), settings_of(**SHORT), tmp_path / "j")
    assert asked == ["Switch the panels on.", "Switch the beam on.", "Switch the panels off."]


def test_faults_can_be_given_to_a_visit(tmp_path: Path) -> None:
    def arm(faults: Faults) -> None:
        faults.arm("unplugging", operation="stage.*", stage="black")

    with pytest.raises(CaptureStopped, match="virtual stage S1"):
        visit_of(tmp_path / "j", arm=arm, **SHORT)
