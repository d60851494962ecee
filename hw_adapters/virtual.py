"""Devices in process, backed by the twin (seam A): the same protocols as real devices."""

from __future__ import annotations

import numpy as np

from hw_adapters.averaging import FrameAverager
from hw_adapters.errors import DeviceLost, DeviceTimeout, RequestOutOfLimits, UnknownCommand
from hw_adapters.frames import RawFrame
from hw_adapters.protocols import Applied, AppliedDrive, DeviceInfo, DeviceKind, Frame, Limits
from hw_adapters.state import LAMPS, POSITIONS, BenchState
from twin.errors import InputError
from twin.instrument import MultispectralChip
from twin.instrument.spec import CHIP_GAINS, CHIP_STEP_S
from twin.spectra import FloatArray

CHIP_LONGEST_S = 0.95
"""Longest pass [s] of an AS7341: its driver library gives up after 1 s of waiting."""
CHIP_LEAST_STEPS = 2
"""ATIME and ASTEP must not both be 0 (data sheet, register ATIME)."""


class _Plug:
    """What all devices in process share: identity, and a cable that can be pulled.

    Args:
        state: the bench on which the device acts.
        kind: kind of device.
        model: what messages call it.
        serial: its serial number.
    """

    def __init__(self, state: BenchState, kind: DeviceKind, model: str, serial: str) -> None:
        self._state = state
        self._kind: DeviceKind = kind
        self._model, self._serial = model, serial
        self._plugged = True

    @property
    def info(self) -> DeviceInfo:
        """Which device it is."""
        # who a device is can be asked at any time, by Python itself too: nothing else fails here
        wrong = self._state.faults.hook(f"{self._kind}.info", only="wrong_serial") != ""
        serial = f"OTHER-{self._serial}" if wrong else self._serial
        return DeviceInfo(self._kind, self._model, serial, "virtual", "benchtwin")

    @property
    def name(self) -> str:
        """Model and serial number."""
        return f"{self._model} {self._serial}".strip()

    def close(self) -> None:
        """Nothing is held."""

    def plug_in(self) -> None:
        """Put the cable back: the device answers again."""
        self._plugged = True

    def _ask(self, operation: str) -> str:
        """Act out the faults that every device can have; returns the others' name or "".

        Raises:
            DeviceLost: the cable is pulled.
            DeviceTimeout: no answer.
        """
        fault = self._state.faults.hook(f"{self._kind}.{operation}")
        if fault == "unplugging":
            self._plugged = False
        if not self._plugged:
            raise DeviceLost(self.name, f"no device any more ({operation})")
        if fault == "timeout":
            self._state.clock.sleep(5.0)
            raise DeviceTimeout(self.name, f"no answer within 5 s ({operation})")
        return fault


class _Sensor(_Plug):
    """Frames from the bench, averaged; the first after a change still shows the settings before."""

    def __init__(self, state: BenchState, kind: DeviceKind, model: str, serial: str) -> None:
        super().__init__(state, kind, model, serial)
        self._wavelength = np.array(state.instrument.wavelength_nm, dtype=np.float64)
        self._wavelength.flags.writeable = False
        self._averager = FrameAverager()
        self._last: RawFrame | None = None

    @property
    def wavelength_nm(self) -> FloatArray:
        """Wavelengths [nm] of pixels or channels, increasing, shape (P,)."""
        return self._wavelength

    @property
    def repeated(self) -> int:
        """Frames that came twice and were read again."""
        return self._averager.repeated

    def _frame(self) -> RawFrame:
        """One frame with the faults of the device."""
        fault = self._ask("frame")
        if fault == "stale_frame" and self._last is not None:
            return self._last
        self._last = self._expose()
        return self._last

    def _expose(self) -> RawFrame:
        """One frame of the bench; takes the time that it takes."""
        raise UnknownCommand(self.name, "an exposure of a device that is no sensor")

    def discard(self) -> None:
        """Take one frame and throw it away.

        Raises:
            DeviceError: the device is lost or silent.
        """
        self._frame()


class VirtualSpectrometer(_Sensor):
    """A spectrometer that looks at the virtual bench.

    It exposes without pause, as a USB spectrometer does: after a change of the integration time
    the first frame is still one of the old time.

    Args:
        state: the bench; its instrument is a spectrometer.
        model: what messages call it.
        serial: its serial number; None takes the instrument's.
        step_s: step [s] of the integration time, 0 for any (USB650: 0.001).

    Raises:
        InputError: the bench's instrument is a chip.
    """

    def __init__(
        self,
        state: BenchState,
        *,
        model: str = "virtual spectrometer",
        serial: str | None = None,
        step_s: float = 0.0,
    ) -> None:
        instrument = state.instrument
        if isinstance(instrument, MultispectralChip):
            raise InputError("a chip on the bench", "a spectrometer", place="instrument.kind")
        super().__init__(
            state, "spectrometer", model, str(instrument.serial) if serial is None else serial
        )
        self._limits = Limits(instrument.shortest_s, instrument.longest_s, step_s)
        self._full_scale = instrument.full_scale_counts
        self._applied = Applied(self._limits.rounded(max(0.1, instrument.shortest_s)))
        self._exposing_s = self._applied.integration_s

    @property
    def limits(self) -> Limits:
        """What it can be set to."""
        return self._limits

    def configure(self, integration_s: float, averages: int = 1) -> Applied:
        """Set integration time [s] and averages; returns what was applied.

        Raises:
            RequestOutOfLimits: outside the limits; the settings stay as they were.
            DeviceError: the device is lost or silent.
        """
        self._limits.check(self.name, integration_s, averages)
        self._ask("configure")
        self._applied = Applied(self._limits.rounded(integration_s), averages)
        self._averager.forget()
        return self._applied

    def capture(self) -> Frame:
        """One reading: the mean of the frames asked for.

        Raises:
            DeviceError: the device is lost or silent.
        """
        start = self._state.clock.now_s()
        mean = self._averager.mean(self._frame, self._applied.averages)
        return Frame(mean.counts, self._full_scale, mean.saturated, self._applied, start)

    def _expose(self) -> RawFrame:
        exposing, self._exposing_s = self._exposing_s, self._applied.integration_s
        frame = self._state.frame(exposing)
        self._state.clock.sleep(exposing)
        return frame


class VirtualChip(_Sensor):
    """An AS7341 that looks at the virtual bench, in two passes of six converters.

    Args:
        state: the bench; its instrument is a chip.
        model: what messages call it.
        serial: its serial number; None takes the instrument's.

    Raises:
        InputError: the bench's instrument is a spectrometer.
    """

    def __init__(
        self, state: BenchState, *, model: str = "virtual AS7341", serial: str | None = None
    ) -> None:
        chip = state.instrument
        if not isinstance(chip, MultispectralChip):
            raise InputError("a spectrometer on the bench", "a chip", place="instrument.kind")
        super().__init__(state, "chip", model, str(chip.serial) if serial is None else serial)
        self._channels = tuple(channel.name for channel in chip.channels)
        self._limits = Limits(
            CHIP_LEAST_STEPS * CHIP_STEP_S, CHIP_LONGEST_S, CHIP_STEP_S, CHIP_GAINS
        )
        self._applied = Applied(chip.integration_s, 1, chip.gain, chip.atime, chip.astep)
        self._passes: tuple[float, ...] = ()

    @property
    def limits(self) -> Limits:
        """What it can be set to."""
        return self._limits

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels in the order of `wavelength_nm`, P of them."""
        return self._channels

    def configure(self, gain: float, atime: int, astep: int, averages: int = 1) -> Applied:
        """Set gain and registers; returns what was applied.

        Raises:
            RequestOutOfLimits: outside the limits; the settings stay as they were.
            DeviceError: the device is lost or silent.
        """
        check_registers(self.name, atime, astep)
        time_s = (atime + 1) * (astep + 1) * CHIP_STEP_S
        self._limits.check(self.name, time_s, averages, gain)
        self._ask("configure")
        self._applied = Applied(time_s, averages, gain, atime, astep)
        self._averager.forget()
        return self._applied

    def capture(self) -> Frame:
        """One reading: the mean of the frames asked for, each of two passes.

        Raises:
            DeviceError: the device is lost or silent.
        """
        start = self._state.clock.now_s()
        mean = self._averager.mean(self._frame, self._applied.averages)
        return Frame(
            mean.counts, full_scale(self._applied), mean.saturated, self._applied, start,
            self._passes,
        )  # fmt: skip

    def _expose(self) -> RawFrame:
        now = self._applied
        frame = self._state.frame(gain=now.gain, atime=now.atime, astep=now.astep)
        first = self._state.clock.now_s()
        self._state.clock.sleep(now.integration_s)
        self._passes = (first, self._state.clock.now_s())
        self._state.clock.sleep(now.integration_s)
        return frame


def check_registers(device: str, atime: int, astep: int) -> None:
    """Refuse values that the registers of an AS7341 do not hold.

    Raises:
        RequestOutOfLimits: says which.
    """
    for name, value, most in (("atime", atime, 255), ("astep", astep, 65_534)):
        if not 0 <= value <= most:
            raise RequestOutOfLimits(device, f"a request for {name} {value}", f"0 to {most}")


def full_scale(applied: Applied) -> int:
    """Highest reading [counts] of an AS7341: min(65535, (ATIME + 1)(ASTEP + 1))."""
    return min(65_535, round(applied.integration_s / CHIP_STEP_S))


class VirtualLights(_Plug):
    """The panels and the beam of the virtual bench.

    Args:
        state: the bench.
        model: what messages call them.
        serial: their serial number.
    """

    def __init__(
        self, state: BenchState, *, model: str = "virtual lights", serial: str = "L1"
    ) -> None:
        super().__init__(state, "lights", model, serial)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the lamps."""
        return LAMPS

    @property
    def settle_s(self) -> float:
        """Time [s] after a change until the light is steady."""
        return self._state.settle_s

    def set(self, name: str, drive: float) -> AppliedDrive:
        """Drive a lamp at a share of its full light, 0 to 1.

        Raises:
            UnknownCommand: no such lamp.
            RequestOutOfLimits: a drive outside 0 to 1.
            DeviceError: the device is lost or silent.
        """
        if name not in LAMPS:
            raise UnknownCommand(self.name, f"the channel {name!r}", f"one of {', '.join(LAMPS)}")
        if not 0.0 <= drive <= 1.0:
            raise RequestOutOfLimits(self.name, f"a drive of {drive:g} for {name}", "0 to 1")
        self._ask("set")
        self._state.set_lamp(name, drive)
        return AppliedDrive(name, drive)

    def off(self) -> None:
        """Switch both lamps off.

        Raises:
            DeviceError: the device is lost or silent.
        """
        self._ask("off")
        self._state.lamps_off()


class VirtualStage(_Plug):
    """The slider with the backgrounds of the virtual bench.

    Args:
        state: the bench.
        move_s: time [s] of a move.
        model: what messages call it.
        serial: its serial number.
    """

    def __init__(
        self,
        state: BenchState,
        *,
        move_s: float = 2.0,
        model: str = "virtual stage",
        serial: str = "S1",
    ) -> None:
        super().__init__(state, "stage", model, serial)
        self._move_s = move_s

    @property
    def positions(self) -> tuple[str, ...]:
        """Names of the positions."""
        return POSITIONS

    def move_to(self, position: str) -> None:
        """Move there, if it is not there already.

        Raises:
            UnknownCommand: no such position.
            DeviceError: the device is lost or silent.
        """
        if position not in POSITIONS:
            raise UnknownCommand(
                self.name, f"the position {position!r}", f"one of {', '.join(POSITIONS)}"
            )
        self._ask("move")
        if position != self._state.background:
            self._state.clock.sleep(self._move_s)
            self._state.move_background(position)


class VirtualHolder(_Plug):
    """What holds the samples of the virtual bench.

    Args:
        state: the bench.
        change_s: time [s] of a change.
        model: what messages call it.
        serial: its serial number.
    """

    def __init__(
        self,
        state: BenchState,
        *,
        change_s: float = 5.0,
        model: str = "virtual holder",
        serial: str = "H1",
    ) -> None:
        super().__init__(state, "holder", model, serial)
        self._change_s = change_s

    @property
    def samples(self) -> tuple[str, ...]:
        """Names of the samples."""
        return self._state.samples

    def place(self, sample: str, present: bool) -> None:
        """Put the holder at a sample's height, with the sample in it or taken out.

        Raises:
            UnknownCommand: no such sample.
            DeviceError: the device is lost or silent.
        """
        if sample not in self.samples:
            raise UnknownCommand(
                self.name, f"the sample {sample!r}", f"one of {', '.join(self.samples)}"
            )
        self._ask("place")
        self._state.clock.sleep(self._change_s)
        self._state.place_sample(sample, present)
