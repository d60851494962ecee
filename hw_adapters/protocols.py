"""The protocols of instruments, the same for the twin, for stand-ins and for real devices.

Everything is synchronous. Times are in seconds, wavelengths in nm, readings in counts. A device
raises a `DeviceError` (see `hw_adapters.errors`) where it cannot do what is asked: it never clips
a request, and `configure` returns what was really applied.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from hw_adapters.errors import RequestOutOfLimits
from twin.errors import InputError
from twin.spectra import FloatArray

Seam = Literal["virtual", "wire", "real"]
"""Where the twin takes the place of the world: in process, on the wire, or nowhere."""

DeviceKind = Literal["spectrometer", "chip", "lights", "stage", "holder"]


@dataclass(frozen=True, slots=True)
class DeviceInfo:
    """Which device it is."""

    kind: DeviceKind
    model: str
    serial: str
    seam: Seam
    driver: str = ""
    """Library that drives it, with its version."""

    @property
    def name(self) -> str:
        """Model and serial number: what messages call the device."""
        return f"{self.model} {self.serial}".strip()


@dataclass(frozen=True, slots=True)
class Limits:
    """What a sensor can be set to."""

    shortest_s: float
    """Shortest integration time [s]."""
    longest_s: float
    """Longest integration time [s]."""
    step_s: float = 0.0
    """Integration times are whole multiples of this [s]; 0: any."""
    gains: tuple[float, ...] = ()
    """Nominal gains, increasing; () for a device without."""
    most_averages: int = 100_000
    """Most frames in one capture."""

    def check(
        self, device: str, integration_s: float, averages: int = 1, gain: float | None = None
    ) -> None:
        """Refuse what lies outside the limits.

        Raises:
            RequestOutOfLimits: says which setting, and the limits.
        """
        rounding = 1e-9
        low, high = self.shortest_s * (1 - rounding), self.longest_s * (1 + rounding)
        if not low <= integration_s <= high:
            raise RequestOutOfLimits(
                device,
                f"a request for an integration time of {integration_s:g} s",
                f"{self.shortest_s:g} to {self.longest_s:g} s",
            )
        if not 1 <= averages <= self.most_averages:
            raise RequestOutOfLimits(
                device, f"a request for {averages} averages", f"1 to {self.most_averages}"
            )
        if gain is not None and gain not in self.gains:
            known = ", ".join(f"{each:g}" for each in self.gains) or "no gain at all"
            raise RequestOutOfLimits(device, f"a request for a gain of {gain:g}", known)

    def rounded(self, integration_s: float) -> float:
        """The integration time [s] that the device really takes: down to a whole step.

        At the short end up, so that a time within the limits stays within them.
        """
        if self.step_s == 0.0:
            return integration_s
        steps = int(np.floor(integration_s / self.step_s * (1 + 1e-12) + 1e-9))
        least = int(np.ceil(self.shortest_s / self.step_s - 1e-9))
        steps = max(steps, least)
        per_second = round(1.0 / self.step_s)
        # 12 / 1000 is the nearest number to 0.012; 12 * 0.001 need not be.
        if abs(per_second * self.step_s - 1.0) < 1e-12:
            return steps / per_second
        return steps * self.step_s


@dataclass(frozen=True, slots=True)
class Applied:
    """The settings a sensor really has."""

    integration_s: float
    """Integration time [s] of one frame."""
    averages: int = 1
    """Frames averaged into one capture."""
    gain: float = 1.0
    """Nominal gain; 1 for a device without."""
    atime: int | None = None
    """Register ATIME of an AS7341."""
    astep: int | None = None
    """Register ASTEP of an AS7341."""

    @property
    def key(self) -> tuple[float, float]:
        """Integration time [s] and gain: what a dark must have in common with a reading."""
        return self.integration_s, self.gain


@dataclass(frozen=True, slots=True)
class AppliedDrive:
    """What a channel of a light source really is set to."""

    channel: str
    drive: float
    """Share of the full light, 0 to 1."""


@dataclass(frozen=True, eq=False)
class Frame:
    """One reading of a sensor.

    Attributes:
        counts: mean reading [counts] of the averaged frames, float64, shape (P,).
        full_scale: highest reading [counts] at these settings.
        saturated: True where any averaged frame reached the top, shape (P,).
        applied: settings of the reading.
        time_s: start [s] on the bench's clock.
        pass_times_s: start [s] of each pass of a sensor that needs several (AS7341: two).
    """

    counts: FloatArray
    full_scale: int
    saturated: NDArray[np.bool_]
    applied: Applied
    time_s: float
    pass_times_s: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        counts = np.array(self.counts, dtype=np.float64)
        saturated = np.array(self.saturated, dtype=np.bool_)
        if counts.ndim != 1 or counts.shape != saturated.shape:
            raise InputError(
                f"counts of shape {counts.shape}, a mask of shape {saturated.shape}",
                "two arrays of one dimension and of the same length",
            )
        counts.flags.writeable = saturated.flags.writeable = False
        object.__setattr__(self, "counts", counts)
        object.__setattr__(self, "saturated", saturated)


@runtime_checkable
class Clock(Protocol):
    """The time of a bench."""

    def now_s(self) -> float:
        """Time [s] since the clock was started."""
        ...

    def sleep(self, seconds: float) -> None:
        """Let time [s] pass."""
        ...


class RealClock:
    """The time of the world, by the computer's monotonic clock.

    Args:
        now_s: time [s] that it shows at first.
    """

    def __init__(self, now_s: float = 0.0) -> None:
        self._zero = time.monotonic() - now_s

    def now_s(self) -> float:
        """Time [s] since the clock was started."""
        return time.monotonic() - self._zero

    def sleep(self, seconds: float) -> None:
        """Let time [s] pass."""
        if seconds > 0:
            time.sleep(seconds)


class VirtualClock:
    """A time that passes only when somebody sleeps: simulated hours take no time.

    Args:
        now_s: time [s] that it shows at first.
    """

    def __init__(self, now_s: float = 0.0) -> None:
        self._now = float(now_s)

    def now_s(self) -> float:
        """Time [s] since the clock was started."""
        return self._now

    def sleep(self, seconds: float) -> None:
        """Let time [s] pass, at once.

        Raises:
            InputError: a time below 0.
        """
        if not seconds >= 0:
            raise InputError(f"a sleep of {seconds:g} s", "0 s or more")
        self._now += seconds

    def set(self, now_s: float) -> None:
        """Put the clock to a time [s]: only a resumed virtual bench does this."""
        self._now = float(now_s)


class Device(Protocol):
    """What every device has."""

    @property
    def info(self) -> DeviceInfo:
        """Which device it is."""
        ...

    def close(self) -> None:
        """Let the device go; harmless when it is gone already."""
        ...


class Sensor(Device, Protocol):
    """What a spectrometer and a multispectral chip have in common."""

    @property
    def wavelength_nm(self) -> FloatArray:
        """Wavelengths [nm] of the pixels or centres of the channels, increasing, shape (P,)."""
        ...

    @property
    def limits(self) -> Limits:
        """What it can be set to."""
        ...

    def capture(self) -> Frame:
        """One reading at the settings of the last `configure`: the mean of its averages.

        Raises:
            DeviceError: the device is lost, silent, or answers nonsense.
        """
        ...

    def discard(self) -> None:
        """Take one frame and throw it away: the first after a change shows the time before it.

        Raises:
            DeviceError: as `capture`.
        """
        ...


@runtime_checkable
class Spectrometer(Sensor, Protocol):
    """A grating spectrometer with a line sensor."""

    def configure(self, integration_s: float, averages: int = 1) -> Applied:
        """Set integration time [s] and number of averages; returns what was applied.

        The time is rounded down to `limits.step_s`, and the answer says so.

        Raises:
            RequestOutOfLimits: outside the limits; the settings stay as they were.
        """
        ...


@runtime_checkable
class MultispectralSensor(Sensor, Protocol):
    """A chip with a few broad channels (AS7341), read in several passes."""

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels in the order of `wavelength_nm`, P of them."""
        ...

    def configure(self, gain: float, atime: int, astep: int, averages: int = 1) -> Applied:
        """Set gain and registers; the integration time is (atime + 1)(astep + 1) 2.78 us.

        Raises:
            RequestOutOfLimits: outside the limits; the settings stay as they were.
        """
        ...


@runtime_checkable
class LightSource(Device, Protocol):
    """One or more lamps, each a channel with a name such as "panels" or "beam"."""

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels."""
        ...

    @property
    def settle_s(self) -> float:
        """Time [s] after a change until the light is steady."""
        ...

    def set(self, name: str, drive: float) -> AppliedDrive:
        """Drive a channel at a share of its full light, 0 to 1; the others stay as they are.

        Raises:
            UnknownCommand: no such channel.
            RequestOutOfLimits: a drive outside 0 to 1; it is not clipped.
        """
        ...

    def off(self) -> None:
        """Switch every channel off."""
        ...


OUT = "out"
"""The position of a stage without a background, for the beam."""


@runtime_checkable
class BackgroundStage(Device, Protocol):
    """What moves the backgrounds under the sample: a slider, or a person who is asked to."""

    @property
    def positions(self) -> tuple[str, ...]:
        """Names of the positions: "black", "white" and "out"."""
        ...

    def move_to(self, position: str) -> None:
        """Move there and stop; does nothing where it is there already.

        Raises:
            UnknownCommand: no such position.
            DeviceError: it did not arrive.
        """
        ...


@runtime_checkable
class SampleHolder(Device, Protocol):
    """What holds the samples at their height; usually a person who is asked to change them."""

    @property
    def samples(self) -> tuple[str, ...]:
        """Names of the samples that can be asked for."""
        ...

    def place(self, sample: str, present: bool) -> None:
        """Put the holder at the height of a sample, with the sample in it or taken out.

        Raises:
            UnknownCommand: no such sample.
        """
        ...
