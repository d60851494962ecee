"""`benchtwin monitor`: the live spectrum in the terminal."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.console import Console
from scenarios.instruments.bench_file import BenchFile, load_bench_file
from scenarios.instruments.session import not_resumed, opened_bench
from twin.errors import InputError
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from hw_adapters import DeviceBench

BARS = " ▁▂▃▄▅▆▇█"


def monitor_answer(
    bench: Path,
    *,
    light: str,
    background: str,
    integration_s: float | None,
    frames: int | None,
    width: int,
    threads: int | None,
    console: Console,
) -> dict[str, Any]:
    """Show the live spectrum on standard error until Ctrl-C, or for a number of frames.

    Raises:
        InputError: bench file or devices cannot be used, or a light or background that is none.
    """
    from hw_adapters.assemble import pixels_inside
    from hw_adapters.state import LAMPS

    file = load_bench_file(bench)
    for found, known, place in (
        (light, (*LAMPS, "none"), "--light"),
        (background, ("white", "black", "out"), "--background"),
    ):
        if found not in known:
            raise InputError(f"{found!r}", f"one of {', '.join(known)}", place=place)
    shown, last = 0, None
    with not_resumed(), opened_bench(file, bench, console, threads) as opened:
        devices, sensor = opened.devices, opened.devices.sensor
        inside = pixels_inside(sensor.wavelength_nm, devices.range_nm)
        wavelength = sensor.wavelength_nm[inside]
        devices.holder.place(devices.samples[0].name, False)
        devices.stage.move_to(background)
        if light != "none":
            devices.lights.set(light, 1.0)
        devices.clock.sleep(devices.lights.settle_s)
        _configure(devices, file, integration_s)
        sensor.discard()
        console.say(f"{sensor.info.name}: {light} on {background}; Ctrl-C stops")
        console.say(axis_line(wavelength, width))
        try:
            while frames is None or shown < frames:
                frame = sensor.capture()
                last = frame.counts[inside]
                shown += 1
                bars = spectrum_line(last, frame.full_scale, width)
                top = f"{bars} peak {last.max():.0f} of {frame.full_scale}"
                top += f" at {wavelength[last.argmax()]:.0f} nm"
                console.say(top + (", SATURATED" if frame.saturated.any() else ""))
        except KeyboardInterrupt:
            console.say("stopped")
    return {
        "frames": shown,
        "sensor": sensor.info.name,
        "peak_counts": None if last is None else round(float(last.max())),
        "peak_nm": None if last is None else round(float(wavelength[last.argmax()]), 1),
    }


def _configure(devices: DeviceBench, file: BenchFile, integration_s: float | None) -> None:
    from hw_adapters import MultispectralSensor

    sensor, plan = devices.sensor, file.plan
    if isinstance(sensor, MultispectralSensor):
        if integration_s is not None:
            raise InputError(
                f"{integration_s:g} s for a chip", "`gain`, `atime` and `astep` in [plan]",
                place="--integration",
            )  # fmt: skip
        sensor.configure(plan.gain or 16.0, plan.atime, plan.astep)
    else:
        sensor.configure(
            max(0.1, sensor.limits.shortest_s) if integration_s is None else integration_s
        )


def spectrum_line(counts: FloatArray, full_scale: int, width: int) -> str:
    """A spectrum as one line of bars: the brightest pixel of each of at most `width` parts."""
    parts = np.array_split(counts, min(width, counts.size))
    heights = [float(part.max()) / full_scale for part in parts]
    top = len(BARS) - 1
    bars = [BARS[min(top, max(0, int(np.ceil(height * top))))] for height in heights]
    wide = _bar_width(counts.size, width)
    return "".join(bars) if wide == 1 else " ".join(bar * (wide - 1) for bar in bars)


def axis_line(wavelength_nm: FloatArray, width: int) -> str:
    """What stands above the bars [nm]: both ends, or every channel of a chip."""
    wide = _bar_width(wavelength_nm.size, width)
    if wide > 1:
        return " ".join(f"{value:<{wide - 1}.0f}" for value in wavelength_nm) + " nm"
    first, last = f"{wavelength_nm[0]:.0f}", f"{wavelength_nm[-1]:.0f} nm"
    return first + last.rjust(min(width, wavelength_nm.size) - len(first))


def _bar_width(bars: int, width: int) -> int:
    """Characters of one bar with the gap behind it: 1, or 4 where a number fits above each."""
    return 4 if 4 * bars <= width else 1
