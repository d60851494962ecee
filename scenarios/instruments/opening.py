"""From a bench file to opened devices, and away again."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from scenarios.instruments.bench_file import BenchFile
from twin.errors import InputError
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from hw_adapters import BenchState, DeviceBench, Faults
    from scenarios.console import Console
    from scenarios.instruments.twin_fed import TwinLight
    from scenarios.scenario import Scenario
    from twin.bench import Bench

Ask = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class OpenedBench:
    """Opened devices.

    Attributes:
        devices: the bench.
        state: the virtual bench behind it; None for a real one.
        file: what was opened.
    """

    devices: DeviceBench
    state: BenchState | None
    file: BenchFile


@contextlib.contextmanager
def open_bench(
    file: BenchFile,
    *,
    folder: Path,
    console: Console,
    ask: Ask,
    faults: Faults | None = None,
    light: TwinLight | None = None,
    threads: int | None = None,
) -> Iterator[OpenedBench]:
    """Open every device of a bench file; at the end lamps are off and devices closed.

    Args:
        file: the bench file.
        folder: folder of the file: scenario and calibration are looked for there.
        console: told what happens.
        ask: asks a person to do something, and waits.
        faults: what is to go wrong on virtual and wire devices.
        light: the light of the scenario, when it is known already.
        threads: threads of the Monte Carlo.

    Raises:
        InputError: scenario, calibration or device cannot be used.
    """
    scenario = scenario_of(file, folder)
    calibrated, serial = _calibration(file, folder)
    serial = file.sensor.serial or serial
    if file.is_real:
        with _real(file, scenario, ask, calibrated, serial) as devices:
            _check(file, devices)
            yield OpenedBench(devices, None, file)
        return
    if light is None:
        light = light_of(file, scenario, console=console, threads=threads)
    state = light.state(faults=faults)
    with _twin(file, light, state, calibrated, serial) as devices:
        _check(file, devices)
        yield OpenedBench(devices, state, file)


def _check(file: BenchFile, devices: DeviceBench) -> None:
    """Refuse other devices than the bench file names."""
    from hw_adapters.errors import WrongDevice
    from hw_adapters.visit import check_sensor

    check_sensor(devices, devices.sensor.info)
    for wanted, info in (
        (file.lights.serial, devices.lights.info), (file.stage.serial, devices.stage.info),
    ):  # fmt: skip
        if wanted and info.serial != wanted:
            raise WrongDevice(
                info.name, f"the serial number {info.serial!r}",
                f"{wanted!r}, which the bench file names",
            )  # fmt: skip


def scenario_of(file: BenchFile, folder: Path) -> Scenario:
    """The scenario of a bench file, settled with its seed.

    Raises:
        InputError: no such scenario.
    """
    from scenarios.scenario import builtin_names, load_scenario

    name = file.scenario
    scenario = load_scenario(name if name in builtin_names() else folder / name)
    return scenario.settled(seed=file.seed, quick=file.quick)


def light_of(
    file: BenchFile, scenario: Scenario, *, console: Console, threads: int | None = None
) -> TwinLight:
    """The twin's light on the sensor of a bench file; its Monte Carlo takes a while.

    Raises:
        InputError: the scenario's wavelengths or spectra do not serve the sensor.
    """
    from scenarios.instruments.twin_fed import twin_light
    from twin.instrument import Instrument, MultispectralChip

    own = scenario.bench.instrument
    instrument: Instrument | None = None
    if file.sensor.model == "as7341" and not isinstance(own, MultispectralChip):
        instrument = MultispectralChip(serial=own.serial)
    elif file.sensor.model == "ocean":
        from hw_adapters.wire.usb650_layout import usb650_instrument

        instrument = usb650_instrument(serial=own.serial)
    with console.step("light transport of the twin") as progress:
        return twin_light(scenario, instrument=instrument, threads=threads, progress=progress)


@contextlib.contextmanager
def _twin(
    file: BenchFile,
    light: TwinLight,
    state: BenchState,
    calibrated: FloatArray | None,
    serial: str,
) -> Iterator[DeviceBench]:
    from hw_adapters import DeviceBench, VirtualHolder, VirtualLights, VirtualStage

    scenario = light.scenario
    with contextlib.ExitStack() as stack:
        wire: Any = None
        if "wire" in (file.sensor.kind, file.lights.kind, file.stage.kind):
            from hw_adapters.wire.bench import wire_bench

            wire = stack.enter_context(wire_bench(state))
        on_wire = file.sensor.kind == "wire"
        sensor: Any = wire.open_sensor() if on_wire else _virtual_sensor(file, state)
        instrument = scenario.bench.instrument.model_copy(update={"averages": file.plan.averages})
        inside = light.range_nm
        if file.range_nm is not None:
            inside = (max(inside[0], file.range_nm[0]), min(inside[1], file.range_nm[1]))
        seen = np.asarray(state.instrument.wavelength_nm)[light.inside]
        kept = (seen >= inside[0]) & (seen <= inside[1])
        bench = DeviceBench(
            sensor=sensor,
            lights=wire.open_lights() if file.lights.kind == "wire" else VirtualLights(state),
            stage=wire.open_stage() if file.stage.kind == "wire" else VirtualStage(state),
            holder=VirtualHolder(state),
            clock=state.clock,
            bench=scenario.bench.model_copy(update={"instrument": instrument}),
            samples=scenario.samples,
            announce=state.announce,
            origin="virtual",
            seed=state.seed,
            range_nm=None if light.inside.all() and file.range_nm is None else inside,
            calibrated_nm=calibrated,
            serial=serial,
            scenario=scenario.text,
            light_se=light.light_se[..., kept],
            truth=light.truth,
        )
        yield bench  # what was opened on the wire is closed with the wire


def _virtual_sensor(file: BenchFile, state: BenchState) -> Any:
    from hw_adapters import VirtualChip, VirtualSpectrometer
    from twin.instrument import MultispectralChip

    serial = state.instrument.serial
    if isinstance(state.instrument, MultispectralChip):
        return VirtualChip(state, model="AS7341", serial=str(serial))
    if file.sensor.model == "ocean":
        return VirtualSpectrometer(state, model="USB650", serial=f"USB650-{serial}", step_s=0.001)
    return VirtualSpectrometer(state)


@contextlib.contextmanager
def _real(
    file: BenchFile, scenario: Scenario, ask: Ask, calibrated: FloatArray | None, serial: str
) -> Iterator[DeviceBench]:
    from hw_adapters import DeviceBench, ManualHolder, ManualLights, ManualStage, RealClock

    # The scenario's material is what virtual samples are made of; of real ones nobody knows it.
    samples = file.samples or tuple(
        sample.model_copy(update={"material": None}) for sample in scenario.samples
    )
    clock = RealClock()
    with contextlib.ExitStack() as stack:

        def kept(device: Any) -> Any:
            stack.callback(device.close)
            return device

        sensor: Any
        if file.sensor.model == "as7341":
            from hw_adapters.drivers.as7341 import open_as7341

            sensor = kept(open_as7341(clock=clock, serial=file.sensor.serial))
        else:
            from hw_adapters.drivers.ocean import open_spectrometer

            sensor = kept(
                open_spectrometer(
                    file.sensor.serial, clock=clock, coefficients=file.sensor.coefficients
                )
            )
        lights: Any
        if file.lights.model == "manual":
            lights = ManualLights(ask, settle_s=file.lights.settle_s)
        else:
            from hw_adapters.drivers.scpi import open_lights

            lights = kept(
                open_lights(
                    file.lights.address,
                    {"panels": file.lights.panels, "beam": file.lights.beam},
                    serial=file.lights.serial,
                    settle_s=file.lights.settle_s,
                )
            )
        stage: Any = ManualStage(ask)
        if file.stage.model == "slider":
            from hw_adapters.drivers.serial_slider import open_slider

            places = {
                "out": file.stage.out_mm,
                "black": file.stage.black_mm,
                "white": file.stage.white_mm,
            }
            stage = kept(
                open_slider(file.stage.address, places, serial=file.stage.serial, clock=clock)
            )
        described, noise = _described(file, scenario, sensor.info.model)
        bench = DeviceBench(
            sensor=sensor,
            lights=lights,
            stage=stage,
            holder=ManualHolder(ask, tuple(sample.name for sample in samples)),
            clock=clock,
            bench=described,
            samples=samples,
            noise=noise,
            range_nm=file.range_nm,
            calibrated_nm=calibrated,
            serial=serial,
        )
        yield bench
        lights.off()


def _described(
    file: BenchFile, scenario: Scenario, model: str
) -> tuple[Bench, Literal["instrument", "repeats"]]:
    """The bench with an instrument of the sensor's kind, and where its noise is taken from.

    The scenario's instrument is that of the twin: its noise and nonlinearity are not those of the
    device. Only an instrument in the bench file itself describes it.
    """
    from twin.instrument import Instrument, MultispectralChip, Spectrometer

    bench = file.bench or scenario.bench
    if file.bench is not None and "instrument" in file.bench.model_fields_set:
        return bench, "instrument"
    kind = MultispectralChip if file.sensor.model == "as7341" else Spectrometer
    instrument: Instrument = bench.instrument
    if model == "USB650":
        from hw_adapters.wire.usb650_layout import usb650_instrument

        instrument = usb650_instrument()
    elif not isinstance(instrument, kind):
        instrument = kind()
    instrument = instrument.model_copy(update={"averages": file.plan.averages})
    return bench.model_copy(update={"instrument": instrument}), "repeats"


def _calibration(file: BenchFile, folder: Path) -> tuple[FloatArray | None, str]:
    """Wavelengths [nm] and serial number that the calibration was made for."""
    if not file.calibration:
        return None, ""
    path = folder / file.calibration
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        return np.array(data["wavelength_nm"], dtype=np.float64), str(data["serial"])
    except FileNotFoundError as error:
        raise InputError(
            "no such file", "a calibration", file=path,
            remedy="Make it with benchtwin calibrate, or leave `calibration` out.",
        ) from error  # fmt: skip
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"a file that cannot be used ({error})", "a calibration of benchtwin", file=path
        ) from error
