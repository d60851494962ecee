"""What `benchtwin devices`, `capture`, `calibrate` and `monitor` do."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.console import Console
from scenarios.instruments.bench_file import BenchFile, load_bench_file
from scenarios.instruments.opening import OpenedBench, open_bench
from scenarios.outputs import canonical_json, prepare_folder
from twin.errors import InputError
from twin.files import write_atomically
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from hw_adapters import Calibration, DeviceBench
    from twin.measurement import Measurement

BARS = " ▁▂▃▄▅▆▇█"
JOURNAL = "journal"


def ask_person(text: str) -> None:
    """Show a sentence and wait for Enter.

    Raises:
        InputError: nobody is there to press it.
    """
    print(f"{text} Then press Enter.", file=sys.stderr, flush=True)
    if not sys.stdin.readline():
        raise InputError(
            "nobody at the keyboard", "a person who does what is asked",
            remedy="Run the command in a terminal, or use a device that moves by itself.",
        )  # fmt: skip


def devices_answer(bench: Path | None, console: Console) -> dict[str, Any]:
    """What is connected, what could be, and what is missing; or the devices of one bench file.

    Raises:
        InputError: a bench file that cannot be used, or a device of it that is not there.
    """
    from hw_adapters.inventory import inventory

    if bench is not None:
        file = load_bench_file(bench)
        with _opened(file, bench, console) as opened:
            infos = opened.devices.devices
            return {
                "bench": str(bench),
                "devices": [
                    {
                        "kind": info.kind, "model": info.model, "serial": info.serial,
                        "seam": info.seam, "driver": info.driver,
                    }
                    for info in infos
                ],
            }  # fmt: skip
    found = inventory()
    return {
        "connected": [f"{each.device}: {name}" for each in found for name in each.connected]
        or ["no device was found"],
        "could_be": [f"{each.device} through {each.library}" for each in found if each.library]
        + [
            "virtual devices and stand-ins on the wire: nothing to connect",
            "a person who moves backgrounds, samples and lamps: nothing to install",
        ],
        "missing": [f"{each.device}: {each.missing}" for each in found if each.missing],
    }


def capture_answer(
    bench: Path, *, out: Path | None, resume: bool, threads: int | None, console: Console
) -> dict[str, Any]:
    """Capture a visit and write measurement.nc; the journal beside it keeps every shot.

    Raises:
        InputError: bench file, folder or devices cannot be used.
        CaptureStopped: a device failed; --resume goes on.
    """
    from twin.measurement import write_measurement

    file = load_bench_file(bench)
    folder = prepare_folder(out or Path(f"{bench.stem}-capture"))
    journal = folder / JOURNAL
    if (journal / "visit.json").exists() and not resume:
        raise InputError(
            "a visit that was begun", "an empty folder", file=journal,
            remedy="Go on with it by --resume, or name another folder with --out.",
        )  # fmt: skip
    with _opened(file, bench, console, threads) as opened:
        measurement = _captured(opened, file, journal, resume, console)
    path = write_measurement(measurement, folder / "measurement.nc")
    captures = measurement.captures
    return {
        "measurement": str(path),
        "shots": len(captures.shots) if captures is not None else 0,
        "origin": measurement.provenance.origin,
        "serial_numbers": list(measurement.provenance.serial_numbers),
        "notes": list(measurement.provenance.notes),
        "fingerprint": measurement.fingerprint,
    }


def _captured(
    opened: OpenedBench, file: BenchFile, journal: Path, resume: bool, console: Console
) -> Measurement:
    from hw_adapters import capture_visit

    with console.step("capture") as progress:
        return capture_visit(
            opened.devices, file.plan, journal, resume=resume, progress=progress, say=console.say
        )


def calibrate_answer(
    bench: Path, *, lamp: str, out: Path | None, threads: int | None, console: Console
) -> dict[str, Any]:
    """Calibrate the sensor of a bench file and write calibration.json.

    Raises:
        InputError: bench file, lamp, folder or devices cannot be used.
    """
    from hw_adapters import calibrate

    file = load_bench_file(bench)
    file = file.model_copy(update={"calibration": ""})
    folder = prepare_folder(out or bench.parent)

    with _opened(file, bench, console, threads) as opened:

        def hold(there: bool) -> None:
            _hold_lamp(opened, lamp, there)

        found = calibrate(opened.devices, file.plan, lamp=lamp, hold_lamp=hold)
    answer = _calibration(found)
    path = write_atomically(
        folder / "calibration.json", canonical_json(answer | _spectra(found)).encode()
    )
    return {"calibration": str(path)} | answer


def _hold_lamp(opened: OpenedBench, lamp: str, there: bool) -> None:
    if opened.state is None:
        ask_person(f"{'Hold' if there else 'Take away'} the {lamp} lamp before the sensor.")
        return
    opened.state.shine(_line_rates(opened.devices, lamp) if there else None)


def _line_rates(devices: DeviceBench, lamp: str) -> FloatArray:
    """A lamp of narrow lines as the virtual sensor sees it [electrons/s], shape (P,)."""
    from hw_adapters.calibrate import LAMP_LINES_NM

    instrument = devices.bench.instrument
    wavelength = devices.sensor.wavelength_nm
    sigma = float(np.median(instrument.fwhm_nm)) / 2.3548
    total = np.zeros(wavelength.shape)
    for line in LAMP_LINES_NM[lamp]:
        total += np.exp(-0.5 * ((wavelength - line) / sigma) ** 2)
    return np.asarray(0.5 * instrument.white_rate_electrons_per_s * total)


def _calibration(found: Calibration) -> dict[str, Any]:
    lines = found.lines
    return {
        "model": found.info.model,
        "serial": found.info.serial,
        "integration_s": found.settings.integration_s,
        "gain": found.settings.gain,
        "dark_noise_counts": found.dark_noise_counts,
        "dark_counts": float(np.median(found.dark)),
        "white_counts": float(found.white.max()),
        "linearity_of": found.linearity.of,
        "linearity_worst": found.linearity.worst,
        "lines_found": 0 if lines is None else len(lines.true_nm),
        "lines_missing_nm": [] if lines is None else list(lines.missing_nm),
        "lines_worst_nm": None if lines is None else lines.worst_nm,
        "notes": list(found.notes),
    }


def _spectra(found: Calibration) -> dict[str, Any]:
    return {
        "wavelength_nm": found.wavelength_nm,
        "dark": found.dark,
        "white": found.white,
        "linearity": {
            "setting": found.linearity.setting,
            "fill": found.linearity.fill,
            "deviation": found.linearity.deviation,
        },
        "lines": None
        if found.lines is None
        else {"true_nm": found.lines.true_nm, "seen_nm": found.lines.seen_nm},
    }


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
    file = load_bench_file(bench)
    shown, last = 0, None
    with _opened(file, bench, console, threads) as opened:
        devices, sensor = opened.devices, opened.devices.sensor
        devices.holder.place(devices.samples[0].name, False)
        devices.stage.move_to(background)
        if light != "none":
            devices.lights.set(light, 1.0)
        devices.clock.sleep(devices.lights.settle_s)
        _configure(devices, file, integration_s)
        sensor.discard()
        try:
            while frames is None or shown < frames:
                last = sensor.capture()
                shown += 1
                console.say(
                    f"{spectrum_line(last.counts, last.full_scale, width)} peak"
                    f" {last.counts.max():.0f} of {last.full_scale}"
                    + (", SATURATED" if last.saturated.any() else "")
                )
        except KeyboardInterrupt:
            console.say("stopped")
    return {
        "frames": shown,
        "sensor": sensor.info.name,
        "peak_counts": None if last is None else float(last.counts.max()),
        "peak_nm": None if last is None else float(sensor.wavelength_nm[last.counts.argmax()]),
    }


def _configure(devices: DeviceBench, file: BenchFile, integration_s: float | None) -> None:
    from hw_adapters import MultispectralSensor

    sensor, plan = devices.sensor, file.plan
    if isinstance(sensor, MultispectralSensor):
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
    return "".join(BARS[min(top, max(0, int(np.ceil(height * top))))] for height in heights)


def _opened(file: BenchFile, bench: Path, console: Console, threads: int | None = None) -> Any:
    return open_bench(file, folder=bench.parent, console=console, ask=ask_person, threads=threads)
