"""Spectrometers of Ocean Optics and Ocean Insight, through python-seabreeze."""

from __future__ import annotations

import errno
import functools
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Literal

import numpy as np

from hw_adapters.averaging import FrameAverager
from hw_adapters.drivers.library import driver_name, load
from hw_adapters.errors import (
    BadAnswer,
    DeviceError,
    DeviceLost,
    DeviceMissing,
    DeviceTimeout,
    WrongDevice,
)
from hw_adapters.frames import RawFrame
from hw_adapters.protocols import Applied, Clock, DeviceInfo, Frame, Limits, RealClock, Seam
from twin.errors import InputError
from twin.spectra import FloatArray

Backend = Literal["pyseabreeze", "cseabreeze"]

_MILLISECOND_MODELS = frozenset(
    {"ADC1000-USB", "HR2000", "NIRQUEST256", "NIRQUEST512", "QE65000", "USB2000", "USB650"}
)
"""Models that take whole milliseconds (seabreeze 2.11, `integration_time_base`): seabreeze cuts
the rest off without a word."""
_WINDOWS_TIMEOUT = 10060
_FAMILY = "Ocean spectrometer"
_COEFFICIENT_SLOTS = (1, 2, 3, 4)


class SeabreezeSpectrometer:
    """One opened spectrometer; see `hw_adapters.protocols.Spectrometer`.

    The first frame after a change of the integration time still has the old one: `discard` it.
    """

    def __init__(
        self,
        device: Any,
        *,
        driver_errors: tuple[type[Exception], ...],
        clock: Clock | None = None,
        seam: Seam = "real",
        coefficients: Sequence[float] | None = None,
    ) -> None:
        """An adapter above an opened `SeaBreezeDevice`; `open_spectrometer` makes one.

        Args:
            device: the device of seabreeze, opened.
            driver_errors: errors of the library other than OSError.
            clock: the bench's clock; None: the computer's.
            seam: whether the device is real.
            coefficients: wavelength polynomial [nm] by pixel number, used in place of the EEPROM's.

        Raises:
            DeviceError: the device does not say its limits or wavelengths.
        """
        self._device = device
        self._driver_errors: tuple[type[Exception], ...] = (OSError, *driver_errors)
        self._nonsense: tuple[type[Exception], ...] = (ValueError, TypeError)
        self._clock = clock or RealClock()
        self._info = DeviceInfo(
            "spectrometer", device.model, device.serial_number, seam, driver_name("seabreeze")
        )
        self._feature = device.f.spectrometer
        with self._speaking("its limits"):
            shortest, longest = self._feature.get_integration_time_micros_limits()
            self._full_scale = int(self._feature.get_maximum_intensity())
        step_us = 1000 if device.model in _MILLISECOND_MODELS else 1
        # seabreeze takes times below its upper limit, not the limit itself.
        self._limits = Limits(shortest / 1e6, (longest - step_us) / 1e6, step_us / 1e6)
        self._wavelength_nm = self._wavelengths(coefficients)
        self._averager = FrameAverager()
        self._applied: Applied | None = None

    @property
    def info(self) -> DeviceInfo:
        """Model, serial number and driver."""
        return self._info

    @property
    def wavelength_nm(self) -> FloatArray:
        """Wavelengths [nm] of the pixels, increasing, shape (P,)."""
        return self._wavelength_nm

    @property
    def limits(self) -> Limits:
        """Shortest and longest integration time, and the step between times."""
        return self._limits

    @property
    def repeated(self) -> int:
        """Frames that came twice and were read again."""
        return self._averager.repeated

    def configure(self, integration_s: float, averages: int = 1) -> Applied:
        """Set integration time [s] and averages; the time is rounded down to a whole step.

        Returns:
            What the device really has: 12.7 ms become 12 ms on a USB650.

        Raises:
            RequestOutOfLimits: outside the limits; the settings stay as they were.
            DeviceError: the device is lost or silent.
        """
        self._limits.check(self._info.name, integration_s, averages)
        time_s = self._limits.rounded(integration_s)
        if self._applied is None or self._applied.integration_s != time_s:
            self._applied = None  # what a command that fails has done nobody knows
            with self._speaking("an integration time"):
                self._feature.set_integration_time_micros(round(time_s * 1e6))
        self._applied = Applied(time_s, averages)
        self._averager.forget()
        return self._applied

    def capture(self) -> Frame:
        """The mean of the averages, counts of shape (P,).

        Raises:
            DeviceError: lost, silent, or a frame too short.
        """
        applied = self._configured()
        start = self._clock.now_s()
        mean = self._averager.mean(self._frame, applied.averages)
        return Frame(mean.counts, self._full_scale, mean.saturated, applied, start)

    def discard(self) -> None:
        """Take one frame and throw it away.

        Raises:
            DeviceError: as `capture`.
        """
        self._configured()
        self._frame()

    def close(self) -> None:
        """Let the device go; harmless when it is gone already."""
        try:
            self._device.close()
        except self._driver_errors:
            return  # unplugged: there is nothing to let go of

    def _configured(self) -> Applied:
        if self._applied is None:
            raise InputError(
                "a capture before an integration time was set", "`configure` first",
                place=self._info.name,
            )  # fmt: skip
        return self._applied

    def _frame(self) -> RawFrame:
        with self._speaking("a frame"):
            counts = np.asarray(self._feature.get_intensities(), dtype=np.float64)
        if counts.shape != self._wavelength_nm.shape:
            raise BadAnswer(
                self._info.name, f"a frame of {counts.size} pixels",
                f"{self._wavelength_nm.size} pixels",
            )  # fmt: skip
        # Some models scale their counts to the full scale, and round.
        return RawFrame(counts, counts > self._full_scale - 0.5)

    def _wavelengths(self, coefficients: Sequence[float] | None) -> FloatArray:
        if coefficients is not None:
            pixels = self._pixels()
            powers = np.arange(pixels, dtype=np.float64)[:, None] ** np.arange(len(coefficients))
            wavelength = powers @ np.asarray(coefficients, dtype=np.float64)
        else:
            try:
                with self._speaking("its wavelengths"):
                    wavelength = self._feature.get_wavelengths()
            except BadAnswer as failure:
                raise self._bad_eeprom() from failure
        wavelength = np.array(wavelength, dtype=np.float64)
        if not np.all(np.isfinite(wavelength)) or np.any(np.diff(wavelength) <= 0):
            raise BadAnswer(
                self._info.name, "wavelengths that do not increase", "wavelengths that increase",
                "Open it with coefficients=(...), from its calibration sheet.",
            )  # fmt: skip
        wavelength.flags.writeable = False
        return wavelength

    def _pixels(self) -> int:
        with self._speaking("a frame"):
            return int(np.size(self._feature.get_intensities()))

    def _bad_eeprom(self) -> BadAnswer:
        with self._speaking("its EEPROM"):
            slots = [
                self._device.f.eeprom.eeprom_read_slot(slot, strip_zero_bytes=True)
                for slot in _COEFFICIENT_SLOTS
            ]
        comma = " (with decimal commas)" if any("," in text for text in slots) else ""
        return BadAnswer(
            self._info.name, f"the wavelength coefficients {', '.join(map(repr, slots))}{comma}",
            "four numbers with decimal points",
            "Open it again; if they stay, open it with coefficients=(...), the four numbers of its"
            " calibration sheet.",
        )  # fmt: skip

    @contextmanager
    def _speaking(self, about: str) -> Iterator[None]:
        """Errors of the library and of the bus, in our terms."""
        name = self._info.name
        try:
            yield
        except InputError:
            raise
        except self._driver_errors as failure:
            raise bus_error(name, about, failure) from failure
        except self._nonsense as failure:
            raise BadAnswer(name, f"no use in the answer about {about} ({failure})") from failure


def open_spectrometer(
    serial: str = "",
    *,
    clock: Clock | None = None,
    backend: Backend = "pyseabreeze",
    pyusb_backend: str | None = None,
    seam: Seam = "real",
    coefficients: Sequence[float] | None = None,
) -> SeabreezeSpectrometer:
    """Open the spectrometer with a serial number, or the only one that is connected.

    Devices on the network are not looked for.

    Args:
        serial: serial number; "" takes the only one.
        clock: the bench's clock; None: the computer's.
        backend: "pyseabreeze" (through libusb) or "cseabreeze" (the maker's C library).
        pyusb_backend: name of the backend of pyusb; None lets pyusb choose, stand-ins give theirs.
        seam: whether the device is real.
        coefficients: wavelength polynomial [nm], used in place of the EEPROM's.

    Raises:
        DeviceMissing: no library, no spectrometer, or none with that serial number.
        WrongDevice: several spectrometers and no serial number, or two with the same.
        DeviceError: it does not answer.
    """
    library = load(f"seabreeze.{backend}", _FAMILY)
    errors: tuple[type[Exception], ...] = (library.SeaBreezeError,)
    if backend == "pyseabreeze":
        transport = load("seabreeze.pyseabreeze.transport", _FAMILY)
        errors += (transport.USBTransportError, transport.USBTransportDeviceInUse)
    devices = _opened(_connected(library, backend, pyusb_backend), errors)
    try:
        chosen = _chosen(devices, serial)
        result = SeabreezeSpectrometer(
            chosen, driver_errors=errors, clock=clock, seam=seam, coefficients=coefficients
        )
    except InputError:
        _close(devices)
        raise
    _close([device for device in devices if device is not chosen])
    return result


@functools.cache
def _c_library(library: Any) -> Any:
    # One for as long as the program runs: its devices do not outlive it.
    return library.SeaBreezeAPI()


def _connected(library: Any, backend: Backend, pyusb_backend: str | None) -> list[Any]:
    if backend == "cseabreeze":
        return list(_c_library(library).list_devices())
    # Not SeaBreezeAPI.list_devices(), which also sends multicast on the network and waits for it.
    transport = load("seabreeze.pyseabreeze.transport", _FAMILY).USBTransport
    try:
        handles = list(transport.list_devices(pyusb_backend=pyusb_backend))
    except RuntimeError as failure:
        raise DeviceMissing(
            _FAMILY, f"no way to the USB bus ({failure})", "libusb on this computer",
            "Install libusb (Debian: apt-get install libusb-1.0-0; macOS: brew install libusb;"
            " Windows: see the page of seabreeze), then run `seabreeze_os_setup`.",
        ) from failure  # fmt: skip
    return [library.SeaBreezeDevice(handle) for handle in handles]


def _opened(devices: list[Any], errors: tuple[type[Exception], ...]) -> list[Any]:
    opened: list[Any] = []
    lost: tuple[type[Exception], ...] = (OSError, *errors)
    for device in devices:
        try:
            if not device.is_open:
                device.open()
        except lost as failure:
            _close(opened)
            raise DeviceLost(
                device.model, f"no answer when it is opened ({failure})", "a device that answers",
                "Close the program that uses it, plug it in again, and run"
                " `seabreeze_os_setup` once so that you may use it.",
            ) from failure  # fmt: skip
        opened.append(device)
    return opened


def _chosen(devices: list[Any], serial: str) -> Any:
    serials = [device.serial_number for device in devices]
    there = ", ".join(f"{device.model} {device.serial_number}" for device in devices) or "none"
    fitting = [device for device in devices if serial in ("", device.serial_number)]
    if not fitting:
        wanted = f"the spectrometer {serial}" if serial else "a spectrometer"
        kind = WrongDevice if devices else DeviceMissing
        raise kind(_FAMILY, f"these on the USB bus: {there}", f"{wanted}, connected")
    if len(fitting) > 1:
        twice = len(set(serials)) < len(serials)
        raise WrongDevice(
            _FAMILY, f"several on the USB bus: {there}",
            "one" if not serial else f"one with the serial number {serial}",
            "Unplug all but one." if twice else "Name one by its serial number.",
        )  # fmt: skip
    return fitting[0]


def _close(devices: list[Any]) -> None:
    for device in devices:
        device.close()


def bus_error(name: str, about: str, failure: Exception) -> DeviceError:
    """What an error of the USB bus means: silence, a device that is gone, or nonsense."""
    number = getattr(failure, "errno", None)
    if number in (errno.ETIMEDOUT, _WINDOWS_TIMEOUT):
        return DeviceTimeout(name, f"no answer in time about {about}")
    if number is None:
        return BadAnswer(name, f"no use in the answer about {about} ({failure})")
    return DeviceLost(name, f"no device when asked for {about} ({failure})")
