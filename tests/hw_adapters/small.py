"""A bench small enough for tests: rates typed in, no Monte Carlo."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from hw_adapters import (
    BenchState,
    DeviceBench,
    Faults,
    PlanSettings,
    VirtualChip,
    VirtualHolder,
    VirtualLights,
    VirtualSpectrometer,
    VirtualStage,
    capture_visit,
)
from twin.bench import Bench, Sample
from twin.instrument import MultispectralChip, Spectrometer
from twin.measurement import Measurement

SAMPLES = ("thin", "thick")
PIXELS = 96
SENSORS = ("spectrometer", "chip")
BRIGHTNESS = {
    "white_reference": 1.0, "black_reference": 0.03, "beam_reference": 0.8,
    "black": 0.4, "white": 0.6, "collimated": 0.1,
}  # fmt: skip


def instrument_of(kind: str, **changes: Any) -> Spectrometer | MultispectralChip:
    if kind == "chip":
        return MultispectralChip(averages=3, **changes)
    table = {"start_nm": 450.0, "stop_nm": 640.0, "step_nm": 2.0, "averages": 3} | changes
    return Spectrometer(**table)


def rates_of(instrument: Spectrometer | MultispectralChip) -> dict[tuple[str, str], np.ndarray]:
    """Rates [electrons/s] of every capture, a little different for each sample."""
    wavelength = np.asarray(instrument.wavelength_nm)
    shape = 0.4 + 0.6 * np.exp(-(((wavelength - 560) / 80) ** 2))
    return {
        (capture, sample): instrument.white_rate_electrons_per_s
        * value
        * shape
        / (1 + 0.3 * number)
        for capture, value in BRIGHTNESS.items()
        for number, sample in enumerate(SAMPLES)
    }


def state_of(kind: str = "spectrometer", seed: int = 7, **changes: Any) -> BenchState:
    instrument = instrument_of(kind, **changes)
    return BenchState(instrument, rates_of(instrument), samples=SAMPLES, seed=seed, faults=Faults())


def bench_of(state: BenchState, **changes: Any) -> DeviceBench:
    """Devices in process around a state."""
    chip = isinstance(state.instrument, MultispectralChip)
    table: dict[str, Any] = {
        "sensor": VirtualChip(state) if chip else VirtualSpectrometer(state),
        "lights": VirtualLights(state),
        "stage": VirtualStage(state),
        "holder": VirtualHolder(state),
        "clock": state.clock,
        "bench": Bench(instrument=state.instrument.model_copy(update={"averages": 3})),
        "samples": tuple(
            Sample(name=name, thickness_mm=0.4 * (number + 1))
            for number, name in enumerate(SAMPLES)
        ),
        "announce": state.announce,
        "origin": "virtual",
        "seed": state.seed,
    }
    return DeviceBench(**(table | changes))


def settings_of(**changes: Any) -> PlanSettings:
    table: dict[str, Any] = {
        "repeats": 2, "reference_repeats": 2, "averages": 3, "warm_up_s": 60.0,
    }  # fmt: skip
    return PlanSettings(**(table | changes))


def visit_of(
    folder: Path,
    kind: str = "spectrometer",
    *,
    arm: Callable[[Faults], None] = lambda faults: None,
    seed: int = 7,
    resume: bool = False,
    **changes: Any,
) -> Measurement:
    """A whole visit with devices in process."""
    state = state_of(kind, seed)
    arm(state.faults)
    return capture_visit(bench_of(state), settings_of(**changes), folder, resume=resume)
