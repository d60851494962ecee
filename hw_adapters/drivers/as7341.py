"""The chip AS7341 on an I2C bus, through adafruit-circuitpython-as7341.

The library reads eight channels in two passes of its six converters, and throws away the bits
that tell saturation; they are read here, with the same latched data.
"""

from __future__ import annotations

import errno
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from hw_adapters.averaging import FrameAverager
from hw_adapters.drivers.library import driver_name, load
from hw_adapters.errors import (
    BadAnswer,
    DeviceLost,
    DeviceMissing,
    DeviceTimeout,
)
from hw_adapters.frames import RawFrame
from hw_adapters.protocols import Applied, Clock, DeviceInfo, Frame, Limits, RealClock, Seam
from hw_adapters.virtual import (
    CHIP_LEAST_STEPS,
    CHIP_LONGEST_S,
    check_registers,
    full_scale,
)
from twin.errors import InputError
from twin.instrument import AS7341_CHANNELS
from twin.instrument.spec import CHIP_GAINS, CHIP_STEP_S
from twin.spectra import FloatArray

MODEL = "AS7341"
CHANNELS = tuple(channel.name for channel in AS7341_CHANNELS)

_ASTATUS, _STATUS2 = 0x94, 0xA3
_SATURATED, _GAIN_BITS = 0x80, 0x0F
_ANALOG_SATURATION = 0x08
_LOW, _HIGH = 0, 4  # first channel of each pass
_WIRES = "Check the four wires (3V3, GND, SCL, SDA) and its power, then go on with --resume."


class As7341Sensor:
    """One chip; see `hw_adapters.protocols.MultispectralSensor`. Channels F1 to F8."""

    def __init__(
        self,
        sensor: Any,
        *,
        clock: Clock | None = None,
        seam: Seam = "real",
        serial: str = "",
        wavelength_nm: Sequence[float] | None = None,
    ) -> None:
        """An adapter above an `adafruit_as7341.AS7341`; `open_as7341` makes one.

        Args:
            sensor: the library's sensor.
            clock: the bench's clock; None: the computer's.
            seam: whether the device is real.
            serial: the name you give it; the chip has no serial number.
            wavelength_nm: centres [nm] of F1 to F8; None: those of its data sheet.
        """
        self._sensor = sensor
        self._clock = clock or RealClock()
        self._info = DeviceInfo(
            "chip", MODEL, serial, seam, driver_name("adafruit-circuitpython-as7341")
        )
        centres = [channel.centre_nm for channel in AS7341_CHANNELS]
        self._wavelength_nm = np.array(wavelength_nm or centres, dtype=np.float64)
        if self._wavelength_nm.shape != (len(CHANNELS),) or np.any(
            np.diff(self._wavelength_nm) <= 0
        ):
            raise InputError(
                f"centres {self._wavelength_nm.tolist()} nm", "eight that increase", place=MODEL
            )
        self._wavelength_nm.flags.writeable = False
        self._limits = Limits(
            CHIP_LEAST_STEPS * CHIP_STEP_S, CHIP_LONGEST_S, CHIP_STEP_S, CHIP_GAINS
        )
        self._applied: Applied | None = None
        self._averager = FrameAverager()
        self._starts: tuple[float, ...] = ()
        self._between_passes = False

    @property
    def info(self) -> DeviceInfo:
        """Model, the name you gave it, and driver."""
        return self._info

    @property
    def channels(self) -> tuple[str, ...]:
        """F1 to F8."""
        return CHANNELS

    @property
    def wavelength_nm(self) -> FloatArray:
        """Centres [nm] of the channels, shape (8,)."""
        return self._wavelength_nm

    @property
    def limits(self) -> Limits:
        """Integration times and gains."""
        return self._limits

    def configure(self, gain: float, atime: int, astep: int, averages: int = 1) -> Applied:
        """Set gain, ATIME and ASTEP, and read all three back.

        Raises:
            RequestOutOfLimits: outside the limits; the settings stay as they were.
            BadAnswer: the chip has other settings than it was given.
            DeviceError: lost or silent.
        """
        check_registers(self._info.name, atime, astep)
        time_s = (atime + 1) * (astep + 1) * CHIP_STEP_S
        self._limits.check(self._info.name, time_s, averages, gain)
        wanted = (CHIP_GAINS.index(gain), atime, astep)
        self._applied = None  # what a command that fails has done nobody knows
        with self._speaking("its settings"):
            self._sensor.gain, self._sensor.atime, self._sensor.astep = wanted
            found = (self._sensor.gain, self._sensor.atime, self._sensor.astep)
        if found != wanted:
            raise BadAnswer(
                self._info.name, f"gain, ATIME and ASTEP of {found}", f"{wanted}, as they were set",
                _WIRES,
            )  # fmt: skip
        self._applied = Applied(time_s, averages, gain, atime, astep)
        self._averager.forget()
        return self._applied

    def capture(self) -> Frame:
        """The mean of the averages, counts of F1 to F8, each of two passes.

        Channels of a pass in which the chip reports analog saturation are all marked saturated:
        its flag does not say which of them it was.

        Raises:
            DeviceError: lost, silent, or not at the settings that it was given.
        """
        applied = self._configured()
        start = self._clock.now_s()
        mean = self._averager.mean(self._reading, applied.averages)
        return Frame(mean.counts, full_scale(applied), mean.saturated, applied, start, self._starts)

    def discard(self) -> None:
        """Take one reading of both passes and throw it away.

        Raises:
            DeviceError: as `capture`.
        """
        self._configured()
        self._reading()

    def close(self) -> None:
        """Nothing is held: the bus belongs to whoever opened it."""

    def _configured(self) -> Applied:
        if self._applied is None:
            raise InputError(
                "a capture before a gain was set", "`configure` first", place=self._info.name
            )
        return self._applied

    def _reading(self) -> RawFrame:
        """One reading of both passes, shape (8,)."""
        if self._between_passes:
            # The library measures anew only when it changes passes. After a reading that broke
            # off between the passes it would answer the next one with the old data.
            with self._speaking("a pass"):
                _ = self._sensor.channel_555nm
            self._between_passes = False
        first = self._clock.now_s()
        low = self._pass(_LOW)
        self._starts = (first, self._clock.now_s())
        high = self._pass(_HIGH)
        return RawFrame(
            np.concatenate([low.counts, high.counts]),
            np.concatenate([low.saturated, high.saturated]),
        )

    def _pass(self, first: int) -> RawFrame:
        applied = self._configured()
        self._between_passes = True
        with self._speaking("a pass"):
            # Either property connects the photodiodes of its pass and waits for new data.
            _ = self._sensor.channel_415nm if first == _LOW else self._sensor.channel_555nm
            # Reading ASTATUS latches the data that go with it (data sheet, section 10.2.7).
            status2, latched = self._registers(_STATUS2, 1)[0], self._registers(_ASTATUS, 13)
        self._between_passes = first == _LOW
        self._same_gain(applied, latched[0] & _GAIN_BITS)
        top = full_scale(applied)
        six = np.frombuffer(latched[1:], dtype="<u2")
        analog = bool(status2 & _ANALOG_SATURATION)
        # The flag without a converter at full scale is an analog saturation too.
        analog |= bool(latched[0] & _SATURATED) and not np.any(six >= top)
        counts = six[:4].astype(np.float64)
        return RawFrame(counts, (counts >= top) | analog)

    def _same_gain(self, applied: Applied, index: int) -> None:
        found = CHIP_GAINS[index] if index < len(CHIP_GAINS) else index
        if found != applied.gain:
            raise BadAnswer(
                self._info.name, f"data taken at gain {found:g}", f"gain {applied.gain:g}",
                "It has been without power: check its wires, then go on with --resume.",
            )  # fmt: skip

    def _registers(self, register: int, size: int) -> bytes:
        data = bytearray(size)
        with self._sensor.i2c_device as wire:
            wire.write_then_readinto(bytes([register]), data)
        return bytes(data)

    @contextmanager
    def _speaking(self, about: str) -> Iterator[None]:
        """Errors of the library and of the bus, in our terms."""
        name = self._info.name
        try:
            yield
        except InputError:
            raise
        except OSError as failure:
            kind = DeviceTimeout if failure.errno == errno.ETIMEDOUT else DeviceLost
            raise kind(
                name, f"no answer on the I2C bus when asked for {about} ({failure})", remedy=_WIRES
            ) from failure
        except RuntimeError as failure:
            raise DeviceTimeout(name, f"no data in time from {about} ({failure})") from failure


def open_as7341(
    bus: Any = None,
    *,
    clock: Clock | None = None,
    seam: Seam = "real",
    serial: str = "",
    wavelength_nm: Sequence[float] | None = None,
) -> As7341Sensor:
    """Open the chip on an I2C bus.

    Args:
        bus: what `board.I2C()` returns, or a stand-in; None asks Blinka for the board's own bus
            (a single-board computer; with an FT232H or MCP2221 set `BLINKA_FT232H=1` or
            `BLINKA_MCP2221=1` in the environment first).
        clock: the bench's clock; None: the computer's.
        seam: whether the device is real.
        serial: the name you give it.
        wavelength_nm: centres [nm] of F1 to F8; None: those of its data sheet.

    Raises:
        DeviceMissing: no library, no I2C bus, or no chip at address 0x39.
    """
    library = load("adafruit_as7341", MODEL)
    bus = _board_bus() if bus is None else bus
    try:
        sensor = library.AS7341(bus)
    except (ValueError, RuntimeError, OSError) as failure:
        raise DeviceMissing(
            MODEL, f"no chip at address 0x39 of the I2C bus ({failure})", "one that answers", _WIRES
        ) from failure
    return As7341Sensor(sensor, clock=clock, seam=seam, serial=serial, wavelength_nm=wavelength_nm)


def _board_bus() -> Any:
    try:
        return load("board", MODEL).I2C()
    # Blinka raises NotImplementedError from `import board` on a computer that it does not know.
    except (NotImplementedError, RuntimeError, AttributeError, OSError) as failure:
        raise DeviceMissing(
            MODEL, f"no I2C bus on this computer ({failure})", "one that Blinka knows",
            "On a Raspberry Pi switch I2C on; with an FT232H or MCP2221 set BLINKA_FT232H=1 or"
            " BLINKA_MCP2221=1 in the environment.",
        ) from failure  # fmt: skip
