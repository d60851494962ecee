"""The same bench twice: devices in process (seam A) and real drivers on the wire (seam B)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from hw_adapters.faults import Faults
from hw_adapters.protocols import Frame
from hw_adapters.state import BenchState
from hw_adapters.virtual import VirtualChip, VirtualLights, VirtualSpectrometer, VirtualStage
from hw_adapters.wire.bench import wire_bench
from hw_adapters.wire.usb650_layout import usb650_instrument
from twin.instrument import MultispectralChip

SAMPLES = ("thin", "thick")
LEVELS = {
    "white_reference": 1.0,
    "black_reference": 0.04,
    "beam_reference": 1.0,
    "white": 0.6,
    "black": 0.35,
    "collimated": 0.2,
}


def instrument(kind: str, **changes: Any) -> Any:
    if kind == "spectrometer":
        return usb650_instrument(serial=7, **changes)
    return MultispectralChip(serial=7, **changes)


def bench_state(kind: str, *, seed: int = 11, faults: Faults | None = None, **changes: Any) -> Any:
    spec = instrument(kind, **changes)
    nm = np.array(spec.wavelength_nm)
    shape = 0.2 + 0.8 * np.exp(-(((nm - 560.0) / 120.0) ** 2))
    rates = {}
    for number, sample in enumerate(SAMPLES):
        for capture, level in LEVELS.items():
            beam = capture in ("beam_reference", "collimated")
            full = spec.beam_rate_electrons_per_s if beam else spec.white_rate_electrons_per_s
            rates[capture, sample] = full * level * shape * (1.0 - 0.1 * number)
    return BenchState(spec, rates, samples=SAMPLES, seed=seed, faults=faults)


def visit(state: BenchState, sensor: Any, lights: Any, stage: Any) -> list[Frame]:
    """A short visit: two settings, both lamps, three backgrounds, frames thrown away."""
    spectrometer = state.instrument.kind == "spectrometer"
    settings = [(0.0127, 3), (0.04, 1)] if spectrometer else [(16.0, 99, 599, 2), (4.0, 99, 499, 1)]
    frames, number = [], 0
    for setting in settings:
        sensor.configure(*setting)
        state.announce(1 << 41, "discard")
        sensor.discard()
        for lamp, background in (
            ("", "white"),
            ("panels", "white"),
            ("panels", "black"),
            ("beam", "out"),
        ):
            stage.move_to(background)
            lights.off()
            if lamp:
                lights.set(lamp, 1.0)
            state.clock.sleep(lights.settle_s)
            for _ in range(2):
                state.announce(number, "shot")
                frames.append(sensor.capture())
                number += 1
    return frames


def in_process(state: BenchState) -> tuple[Any, Any, Any]:
    if state.instrument.kind == "spectrometer":
        sensor: Any = VirtualSpectrometer(state, model="USB650", serial="USB650-7", step_s=0.001)
    else:
        sensor = VirtualChip(state, model="AS7341", serial="7")
    return sensor, VirtualLights(state), VirtualStage(state)


def on_both(kind: str, act: Callable[..., Any], supply: str = "socket", **changes: Any) -> Any:
    """What `act(state, sensor, lights, stage)` returns on seam A and on seam B."""
    first = bench_state(kind, **changes)
    virtual = act(first, *in_process(first))
    second = bench_state(kind, **changes)
    with wire_bench(second, supply=supply) as wire:
        wired = act(second, wire.open_sensor(), wire.open_lights(), wire.open_stage())
    return virtual, wired
