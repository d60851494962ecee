"""In process, on the wire, and simulated at once: the same counts from the same seed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hw_adapters import Applied, Journal, PlanSettings, capture_visit
from scenarios import Scenario, simulate_visit
from scenarios.console import Console
from scenarios.instruments import BenchFile, open_bench, twin_light
from scenarios.instruments.opening import scenario_of
from tests.scenarios.tiny import tiny, write
from twin.measurement import Measurement

CHIP = {
    "bench": {"instrument": {"kind": "chip"}},
    "wavelength": {"start_nm": 380.0, "stop_nm": 780.0, "step_nm": 50.0},
}


def nobody(text: str) -> None:
    raise AssertionError(f"a person was asked: {text}")


def plan_of(scenario: Scenario) -> PlanSettings:
    """The plan that the scenario's protocol is."""
    protocol = scenario.protocol
    return PlanSettings(
        repeats=protocol.repeats,
        reference_repeats=protocol.reference_repeats,
        references=protocol.references,
        last_darks=False,
        order=protocol.order,
        averages=scenario.bench.instrument.frames,
        warm_up_s=0.0,
        pause_s=protocol.pause_s,
    )


def captured(
    path: Path, simulated: Measurement, folder: Path, kinds: dict[str, Any]
) -> Measurement:
    """A capture at the exposures of a simulated visit."""
    file = BenchFile(
        scenario=str(path),
        **{name: {"kind": kind} for name, kind in kinds.items()},
    )
    scenario = scenario_of(file, folder)
    exposures: dict[str, dict[str, Applied]] = {}
    chip = scenario.bench.instrument
    for shot in simulated.captures.shots:
        if shot.capture != "dark":
            exposures.setdefault(shot.sample, {})[shot.capture] = Applied(
                shot.integration_s, shot.averages, shot.gain,
                getattr(chip, "atime", None), getattr(chip, "astep", None),
            )  # fmt: skip
    Journal(folder / "journal").write_exposures(exposures)
    with open_bench(
        file, folder=folder, console=Console(quiet=True), ask=nobody, light=twin_light(scenario)
    ) as opened:
        return capture_visit(opened.devices, plan_of(scenario), folder / "journal")


@pytest.mark.parametrize("changes", [{}, CHIP], ids=["spectrometer", "chip"])
def test_a_captured_visit_has_the_counts_of_the_simulated_one(
    changes: dict[str, Any], tmp_path: Path
) -> None:
    path = write(tmp_path / "tiny.toml", tiny(**changes))
    scenario = scenario_of(BenchFile(scenario=str(path)), tmp_path)
    simulated = simulate_visit(scenario)
    found = captured(path, simulated, tmp_path, {"sensor": "virtual"})
    np.testing.assert_array_equal(found.captures.counts, simulated.captures.counts)
    np.testing.assert_array_equal(found.captures.saturated, simulated.captures.saturated)
    np.testing.assert_array_equal(found.captures.light_se, simulated.captures.light_se)
    assert [
        (s.capture, s.sample, s.repeat, s.integration_s, s.gain, s.averages)
        for s in found.captures.shots
    ] == [
        (s.capture, s.sample, s.repeat, s.integration_s, s.gain, s.averages)
        for s in simulated.captures.shots
    ]
    other = simulate_visit(scenario, seed=6)
    assert not np.array_equal(found.captures.counts, other.captures.counts)


@pytest.mark.parametrize("model", ["ocean", "as7341"])
def test_a_visit_on_the_wire_equals_the_one_in_process(model: str, tmp_path: Path) -> None:
    for library in ("seabreeze", "usb", "adafruit_as7341", "serial", "pyvisa_py"):
        pytest.importorskip(library, reason=f"{library} is not installed (extra instruments)")
    grid = {"start_nm": 500.0, "stop_nm": 600.0, "step_nm": 50.0}
    path = write(
        tmp_path / "tiny.toml", tiny(**CHIP if model == "as7341" else {"wavelength": grid})
    )
    plan = {"repeats": 1, "reference_repeats": 1, "averages": 2}
    found = {}
    light = None
    for kind in ("virtual", "wire"):
        entry = {"kind": kind}
        file = BenchFile.model_validate(
            {
                "scenario": str(path), "plan": plan, "lights": entry, "stage": entry,
                "sensor": entry | {"model": model},
            }
        )  # fmt: skip
        from scenarios.instruments.opening import light_of

        console = Console(quiet=True)
        light = light or light_of(file, scenario_of(file, tmp_path), console=console)
        with open_bench(file, folder=tmp_path, console=console, ask=nobody, light=light) as opened:
            found[kind] = capture_visit(opened.devices, file.plan, tmp_path / kind)
    virtual, wire = found["virtual"], found["wire"]
    np.testing.assert_array_equal(wire.captures.counts, virtual.captures.counts)
    np.testing.assert_array_equal(wire.captures.saturated, virtual.captures.saturated)
    assert wire.captures.shots == virtual.captures.shots
    assert wire.bench == virtual.bench
    assert any("(wire)" in note for note in wire.provenance.notes)
