"""What `benchtwin devices`, `capture` and `calibrate` do."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.console import Console
from scenarios.instruments.bench_file import BenchFile, load_bench_file
from scenarios.instruments.opening import OpenedBench
from scenarios.instruments.session import ask_person, not_resumed, opened_bench
from scenarios.outputs import canonical_json, prepare_folder
from twin.errors import InputError
from twin.files import write_atomically
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from hw_adapters import Calibration, DeviceBench
    from twin.measurement import Measurement

JOURNAL = "journal"


def devices_answer(bench: Path | None, console: Console) -> dict[str, Any]:
    """What is connected, what could be, and what is missing; or the devices of one bench file.

    Raises:
        InputError: a bench file that cannot be used, or a device of it that is not there.
    """
    from hw_adapters.inventory import inventory

    if bench is not None:
        file = load_bench_file(bench)
        with not_resumed(), opened_bench(file, bench, console) as opened:
            infos = opened.devices.devices
            return {
                "bench": str(bench),
                "sensor": _sensor_facts(opened.devices),
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
        "could_be": [
            f"{each.device}: its driver {each.library} is installed"
            for each in found
            if each.library
        ]
        + [
            "virtual devices and stand-ins on the wire: nothing to connect",
            "a person who moves backgrounds, samples and lamps: nothing to install",
        ],
        "missing": [f"{each.device}: {each.missing}" for each in found if each.missing],
    }


def _sensor_facts(devices: DeviceBench) -> dict[str, Any]:
    """What the sensor sees, and what can be asked of it."""
    wavelength, limits = devices.sensor.wavelength_nm, devices.sensor.limits
    facts: dict[str, Any] = {
        "wavelengths": f"{wavelength.size} from {wavelength[0]:.1f} to {wavelength[-1]:.1f} nm",
        "integration": f"{limits.shortest_s:g} to {limits.longest_s:g} s",
    }
    if limits.gains:
        facts["gains"] = list(limits.gains)
    return facts


def capture_answer(
    bench: Path,
    *,
    out: Path | None,
    resume: bool,
    fault: str = "",
    threads: int | None,
    console: Console,
) -> dict[str, Any]:
    """Capture a visit and write measurement.nc; the journal beside it keeps every shot.

    Args:
        bench: the bench file.
        out: folder of the measurement and its journal.
        resume: go on with the journal that is there.
        fault: what is to go wrong on virtual and wire devices, "NAME:OPERATION:STAGE"; "" nothing.
        threads: threads of the Monte Carlo.
        console: told what happens.

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
    with (
        _faults(file, fault, journal, console) as faults,
        opened_bench(file, bench, console, threads, faults) as opened,
    ):
        measurement = _captured(opened, file, journal, resume, console)
    measurement = _with_faults(measurement, journal)
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


@contextlib.contextmanager
def _faults(file: BenchFile, fault: str, journal: Path, console: Console) -> Iterator[Any]:
    """A fault to be acted out, and its line in the journal when it was."""
    from hw_adapters import Faults, Journal

    if not fault:
        yield None
        return
    if file.is_real:
        raise InputError(
            f"the fault {fault!r} for real devices", "virtual devices or stand-ins on the wire",
            place="--fault",
        )  # fmt: skip
    name, operation, stage = (*fault.split(":", 2), "", "")[:3]
    faults = Faults()
    faults.arm(name, operation=operation or "*", stage=stage or "*")
    try:
        yield faults
    finally:
        for done in faults.log:
            Journal(journal).log("fault", name=done[0], operation=done[1], stage=done[2])
        if not faults.log:
            console.say(f"the fault {fault} was not acted out: nothing asked for it at that stage")


def _with_faults(measurement: Measurement, journal: Path) -> Measurement:
    """The measurement with a note for every fault that altered its light."""
    from hw_adapters import Journal
    from hw_adapters.faults import BENCH_FAULTS

    notes = [
        f"acted out on purpose: {event['name']} from {event['stage']} on"
        for event in Journal(journal).events("fault")
        if event["name"] in BENCH_FAULTS
    ]
    if not notes:
        return measurement
    was = measurement.provenance
    return replace(measurement, provenance=was.model_copy(update={"notes": (*was.notes, *notes)}))


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

    with not_resumed(), opened_bench(file, bench, console, threads) as opened:

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
