"""All stand-ins of one bench around one state and one clock, with the real drivers above them."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np

from hw_adapters.bench import DeviceBench
from hw_adapters.drivers.library import load
from hw_adapters.errors import UnknownCommand
from hw_adapters.frames import RawFrame
from hw_adapters.protocols import OUT, LightSource, MultispectralSensor, Spectrometer
from hw_adapters.state import LAMPS, BenchState
from hw_adapters.virtual import VirtualHolder
from hw_adapters.wire.as7341 import As7341, ChipPass, I2cBus, PassReading
from hw_adapters.wire.links import loopback, serial_port
from hw_adapters.wire.scpi import ScpiSupply
from hw_adapters.wire.slider import GrblSlider
from hw_adapters.wire.usb650_layout import FULL_SCALE, wavelengths_nm
from twin.bench import Bench, Sample
from twin.errors import InputError
from twin.instrument import MultispectralChip, saturation_counts

if TYPE_CHECKING:
    from hw_adapters.drivers.serial_slider import SerialSlider
    from hw_adapters.wire.usb650 import Usb650

HIGHEST_A = (0.7, 0.35)
"""Highest current [A] of the panels and of the beam."""
POSITIONS_MM = {OUT: 0.0, "black": 40.0, "white": 80.0}
"""Where the backgrounds stand on the slider [mm]."""
SUPPLY_SERIAL = "TWIN0001"
_CHANNELS = {name: number for number, name in enumerate(LAMPS, start=1)}
_Device = TypeVar("_Device")
_LOW, _HIGH = ("F1", "F2", "F3", "F4"), ("F5", "F6", "F7", "F8")


@dataclass
class WireBench:
    """Stand-ins that share one bench; `wire_bench` makes one.

    Attributes:
        state: the bench, its clock and its faults.
        unit: the sensor's stand-in.
        supply: the lamps' stand-in.
        slider: the stage's stand-in.
        bus: name of the USB bus for pyusb, or the I2C bus.
        resource: VISA resource name of the supply.
        url: URL of the slider's serial port.
    """

    state: BenchState
    unit: Usb650 | As7341
    supply: ScpiSupply
    slider: GrblSlider
    bus: str | I2cBus
    resource: str
    url: str
    _opened: list[Any] = field(default_factory=list)

    def open_sensor(self) -> Spectrometer | MultispectralSensor:
        """The sensor through its real driver: seabreeze, or Adafruit's."""
        if isinstance(self.bus, I2cBus):
            from hw_adapters.drivers.as7341 import open_as7341

            serial = str(self.state.instrument.serial)
            chip = open_as7341(self.bus, clock=self.state.clock, seam="wire", serial=serial)
            return self._kept(chip)
        from hw_adapters.drivers.ocean import open_spectrometer

        return self._kept(
            open_spectrometer(clock=self.state.clock, pyusb_backend=self.bus, seam="wire")
        )

    def open_lights(self, *, timeout_s: float = 2.0) -> LightSource:
        """The lamps through pyvisa and pyvisa-py."""
        from hw_adapters.drivers.scpi import open_lights

        lights = open_lights(
            self.resource, _CHANNELS, serial=SUPPLY_SERIAL, settle_s=self.state.settle_s,
            timeout_s=timeout_s, seam="wire",
        )  # fmt: skip
        return self._kept(lights)

    def open_stage(self, *, timeout_s: float = 60.0) -> SerialSlider:
        """The backgrounds through pyserial."""
        from hw_adapters.drivers.serial_slider import open_slider

        stage = open_slider(
            self.url, POSITIONS_MM, clock=self.state.clock, timeout_s=timeout_s, seam="wire"
        )
        return self._kept(stage)

    def open_holder(self) -> VirtualHolder:
        """The samples are changed by a person: this one is as quick as the virtual one."""
        return VirtualHolder(self.state)

    def devices(
        self, bench: Bench, samples: tuple[Sample, ...], *, timeout_s: float = 2.0, **facts: Any
    ) -> DeviceBench:
        """Open every device, for `hw_adapters.capture_visit`.

        Args:
            bench: the bench's description.
            samples: the samples, with the names of the state's.
            timeout_s: time [s] to wait for an answer of the lamps.
            **facts: further fields of `DeviceBench`, such as range_nm.
        """
        return DeviceBench(
            sensor=self.open_sensor(),
            lights=self.open_lights(timeout_s=timeout_s),
            stage=self.open_stage(),
            holder=self.open_holder(),
            clock=self.state.clock,
            bench=bench,
            samples=samples,
            announce=self.state.announce,
            origin="virtual",
            seed=self.state.seed,
            **facts,
        )

    def plug_in(self) -> None:
        """Put every cable back that a fault has pulled; devices start as after power-up."""
        for device in (self.unit, self.supply, self.slider):
            if not device.plugged:
                device.plug_in()

    def close(self) -> None:
        """Close every device that was opened here and is not closed yet."""
        while self._opened:
            self._opened.pop().close()

    def _kept(self, device: _Device) -> _Device:
        self._opened.append(device)
        return device


@contextmanager
def wire_bench(
    state: BenchState, *, supply: Literal["socket", "serial"] = "socket", serial: str = ""
) -> Iterator[WireBench]:
    """Connect stand-ins to a bench; every cable is pulled and every thread joined at the end.

    Args:
        state: the bench; its instrument decides which sensor there is.
        supply: how the supply of the lamps is connected.
        serial: serial number of the spectrometer; "" takes "USB650-" and the instrument's.

    Raises:
        InputError: an instrument that the stand-in cannot be.
    """
    hook = state.faults.hook
    lamps = ScpiSupply(
        lambda channel, drive: state.set_lamp(LAMPS[channel - 1], drive),
        highest_a=HIGHEST_A, serial=SUPPLY_SERIAL, faults=hook,
    )  # fmt: skip
    slider = GrblSlider(
        lambda position_mm: state.move_background(_background(position_mm)),
        sleep=state.clock.sleep, faults=hook,
    )  # fmt: skip
    cable = loopback(lamps) if supply == "socket" else serial_port(lamps)
    with contextlib.ExitStack() as stack:
        resource = stack.enter_context(cable)
        resource = resource if supply == "socket" else f"ASRL{resource}::INSTR"
        url = stack.enter_context(serial_port(slider))
        unit, bus = stack.enter_context(_sensor(state, serial))
        bench = WireBench(state, unit, lamps, slider, bus, resource, url)
        stack.callback(bench.close)
        yield bench


@contextmanager
def _sensor(state: BenchState, serial: str) -> Iterator[tuple[Usb650 | As7341, str | I2cBus]]:
    instrument, hook = state.instrument, state.faults.hook
    if not instrument.has("quantisation"):
        raise InputError(
            'an instrument with "quantisation" off', "whole counts, which a wire carries",
            place="instrument.off",
        )  # fmt: skip
    if isinstance(instrument, MultispectralChip):
        if tuple(channel.name for channel in instrument.channels) != _LOW + _HIGH:
            raise InputError("other channels", "F1 to F8 of the AS7341", place="instrument")
        chip = As7341(two_passes(state), sleep=state.clock.sleep, faults=hook)
        yield chip, I2cBus(chip)
        return
    load("usb.core", "USB650")
    from hw_adapters.wire.usb650 import Usb650, plugged_in

    top = saturation_counts(instrument)
    same = np.array_equal(np.array(instrument.wavelength_nm), wavelengths_nm())
    if not same or top != FULL_SCALE:
        pixels = len(instrument.wavelength_nm)
        raise InputError(
            f"{pixels} pixels, saturated at {top:g} counts",
            f"the {wavelengths_nm().size} pixels of the USB650, saturated at {FULL_SCALE} counts",
            place="instrument",
            remedy="hw_adapters.wire.usb650_layout.usb650_instrument() describes it.",
        )
    unit = Usb650(
        state.whole_counts, serial=serial or f"USB650-{instrument.serial}"[:14],
        sleep=state.clock.sleep, faults=hook,
    )  # fmt: skip
    with plugged_in(unit) as bus:
        yield unit, bus


def two_passes(state: BenchState) -> Callable[[ChipPass], PassReading]:
    """What a chip reads of a bench: one frame for both passes, as `VirtualChip` takes it.

    The first pass (F1 to F4) takes a new frame of the bench; the second (F5 to F8) gives the rest
    of it. CLEAR and NIR, which the twin's chip does not have, read 0.
    """
    kept: dict[str, RawFrame] = {}

    def measure(setting: ChipPass) -> PassReading:
        four = setting.channels[:4]
        if four not in (_LOW, _HIGH):
            raise UnknownCommand("AS7341", f"a pass of {', '.join(setting.channels)}")
        if four == _LOW or "frame" not in kept:
            kept["frame"] = state.frame(gain=setting.gain, atime=setting.atime, astep=setting.astep)
        part = slice(0, 4) if four == _LOW else slice(4, 8)
        counts, saturated = kept["frame"].counts[part], kept["frame"].saturated[part]
        analog = bool(np.any(saturated & (counts < setting.full_scale)))
        whole: Sequence[int] = [int(value) for value in counts] + [0, 0]
        return PassReading(whole, analog)

    return measure


def _background(position_mm: float) -> str:
    for name, place_mm in POSITIONS_MM.items():
        if abs(position_mm - place_mm) < 0.05:
            return name
    places = ", ".join(f"{name} at {place:g} mm" for name, place in POSITIONS_MM.items())
    raise UnknownCommand("Grbl slider", f"a move to {position_mm:g} mm", places)
