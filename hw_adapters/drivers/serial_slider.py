"""A slider that moves the backgrounds: a stepper motor under Grbl 1.1, through pyserial."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from hw_adapters.drivers.library import driver_name, load
from hw_adapters.errors import (
    BadAnswer,
    DeviceError,
    DeviceLost,
    DeviceMissing,
    DeviceTimeout,
    UnknownCommand,
)
from hw_adapters.protocols import Clock, DeviceInfo, RealClock, Seam

_MODEL = "Grbl slider"
_TOLERANCE_MM = 0.02
_POLL_S = 0.05
_STATUS = re.compile(r"<(\w+)[^|]*\|(?:M|W)Pos:(-?\d+\.\d+)")
_RESET = b"\x18"


class SerialSlider:
    """Positions by name; see `hw_adapters.protocols.BackgroundStage`."""

    def __init__(
        self,
        port: Any,
        positions_mm: Mapping[str, float],
        *,
        serial: str = "",
        clock: Clock | None = None,
        timeout_s: float = 60.0,
        seam: Seam = "real",
    ) -> None:
        """An adapter above an open port of pyserial; `open_slider` makes one. Homes the slider.

        Args:
            port: the port, with a time-out.
            positions_mm: name of the position -> where it is [mm] from the end switch.
            serial: the name you give it; Grbl has no serial number.
            clock: the bench's clock; None: the computer's.
            timeout_s: time [s] that a move may take.
            seam: whether the device is real.

        Raises:
            DeviceError: it does not answer as Grbl 1.1 does, or does not find its end switch.
        """
        self._port = port
        self._positions_mm = dict(positions_mm)
        self._clock = clock or RealClock()
        self._timeout_s = timeout_s
        self._info = DeviceInfo("stage", _MODEL, serial, seam, driver_name("pyserial"))
        self._at = ""
        self._send(_RESET)
        self._until("Grbl 1.1")
        for line in ("$H", "G21", "G90"):
            self._obey(line)

    @property
    def info(self) -> DeviceInfo:
        """Model, the name you gave it, and driver."""
        return self._info

    @property
    def positions(self) -> tuple[str, ...]:
        """Names of the positions."""
        return tuple(self._positions_mm)

    def move_to(self, position: str) -> None:
        """Move there and wait until it stands; does nothing where it is there already.

        Raises:
            UnknownCommand: no such position, or a command that Grbl refuses.
            DeviceError: it did not arrive, is lost or silent.
        """
        if position not in self._positions_mm:
            raise UnknownCommand(
                self._info.name, f"the position {position!r}",
                f"one of {', '.join(self._positions_mm)}",
            )  # fmt: skip
        if position == self._at:
            return
        target = self._positions_mm[position]
        self._at = ""  # until it has arrived nobody knows
        self._obey(f"G0 X{target:.3f}")
        for _ in range(round(self._timeout_s / _POLL_S)):
            state, at = self._status()
            if state == "Alarm":
                raise BadAnswer(
                    self._info.name, f"an alarm at {at:g} mm", f"a move to {target:g} mm",
                    "Free the slider and go on with --resume: it is then homed again.",
                )  # fmt: skip
            if state == "Idle":
                if abs(at - target) > _TOLERANCE_MM:
                    raise BadAnswer(self._info.name, f"a stop at {at:g} mm", f"{target:g} mm")
                self._at = position
                return
            self._clock.sleep(_POLL_S)
        raise DeviceTimeout(self._info.name, f"no arrival at {target:g} mm")

    def close(self) -> None:
        """Let the port go; the slider stays where it is."""
        self._port.close()

    def _status(self) -> tuple[str, float]:
        self._send(b"?")
        answer = self._read()
        found = _STATUS.match(answer)
        if found is None:
            raise BadAnswer(self._info.name, f"the status {answer!r}", "<Idle|MPos:...>")
        return found[1], float(found[2])

    def _obey(self, line: str) -> None:
        self._send(line.encode("ascii") + b"\n")
        answer = self._read()
        if answer != "ok":
            raise UnknownCommand(
                self._info.name, f"{answer!r} in answer to {line!r}", "'ok'",
                "Look the number up in Grbl's list of errors; error:15 is a position beyond its"
                " travel.",
            )  # fmt: skip

    def _until(self, beginning: str) -> None:
        for _ in range(10):
            if self._read().startswith(beginning):
                self._forget()
                return
        raise BadAnswer(self._info.name, "another banner", f"one that begins {beginning!r}")

    def _forget(self) -> None:
        # A board that restarts when its port is opened has said its banner twice.
        self._port.reset_input_buffer()

    def _send(self, data: bytes) -> None:
        try:
            self._port.write(data)
        except OSError as failure:
            raise DeviceLost(self._info.name, f"no way to send {data!r} ({failure})") from failure

    def _read(self) -> str:
        try:
            line = self._port.readline()
        except OSError as failure:
            raise DeviceLost(self._info.name, f"no way to read ({failure})") from failure
        if not line.endswith(b"\n"):
            raise DeviceTimeout(self._info.name, f"{line!r} and no line end")
        return str(line.decode("ascii", "replace").strip())


def open_slider(
    port: str,
    positions_mm: Mapping[str, float],
    *,
    serial: str = "",
    clock: Clock | None = None,
    timeout_s: float = 60.0,
    seam: Seam = "real",
) -> SerialSlider:
    """Open a slider on a serial port and home it.

    Args:
        port: "/dev/ttyUSB0", "COM3", or a URL of pyserial.
        positions_mm: name of the position -> where it is [mm] from the end switch.
        serial: the name you give it.
        clock: the bench's clock; None: the computer's.
        timeout_s: time [s] that a move may take.
        seam: whether the device is real.

    Raises:
        DeviceMissing: no library, or no such port.
        DeviceError: as `SerialSlider`.
    """
    library = load("serial", _MODEL)
    try:
        opened = library.serial_for_url(port, baudrate=115_200, timeout=timeout_s)
    except (OSError, ValueError) as failure:
        raise DeviceMissing(
            _MODEL, f"no port {port!r} ({failure})", "a port that this user may open",
            "`python -m serial.tools.list_ports` lists the ports; on Linux your user must be in"
            " the group dialout.",
        ) from failure  # fmt: skip
    try:
        return SerialSlider(
            opened, positions_mm, serial=serial, clock=clock, timeout_s=timeout_s, seam=seam
        )
    except DeviceError:
        opened.close()
        raise
