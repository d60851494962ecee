"""Lamps on a bench supply or LED driver that speaks SCPI, through pyvisa.

Commands: `*IDN?`, `CURR`, `CURR?`, `CURR? MAX`, `OUTP`, `OUTP?`, `MEAS:CURR?` with channel lists
`(@n)`, and `SYST:ERR?` after everything that sets (SCPI-1999; Keysight E36300 and its kin, and
boards that follow it).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any

from hw_adapters.drivers.library import driver_name, load
from hw_adapters.errors import (
    BadAnswer,
    DeviceError,
    DeviceLost,
    DeviceMissing,
    DeviceTimeout,
    RequestOutOfLimits,
    UnknownCommand,
    WrongDevice,
)
from hw_adapters.protocols import AppliedDrive, DeviceInfo, Seam
from twin.errors import InputError

_FAMILY = "light supply"
_DIGITS = 9
_NEAR = 0.005  # a supply may round a request by so much of the full current
_LEAST_FLOW = 0.5  # share of the set current below which a lamp is not connected


class ScpiLights:
    """Lamps by name; see `hw_adapters.protocols.LightSource`."""

    def __init__(
        self,
        session: Any,
        channels: Mapping[str, int],
        *,
        serial: str = "",
        settle_s: float = 0.5,
        streamed: bool = True,
        seam: Seam = "real",
    ) -> None:
        """An adapter above an open session of pyvisa; `open_lights` makes one.

        Args:
            session: the session, with line ends set.
            channels: name of the lamp -> channel of the supply, from 1.
            serial: serial number that it must have; "" takes any.
            settle_s: time [s] after a change until the light is steady.
            streamed: lines are told apart by their ends only (serial, socket), not by messages
                (USB, GPIB, VXI-11).
            seam: whether the device is real.

        Raises:
            WrongDevice: another serial number.
            DeviceError: it does not answer as such a supply does.
        """
        self._session = session
        self._channels = dict(channels)
        self._settle_s = settle_s
        self._streamed = streamed
        self._info = DeviceInfo("lights", _FAMILY, serial, seam, driver_name("PyVISA"))
        identity = self._ask("*IDN?").split(",")
        if len(identity) != 4:
            raise self._nonsense("*IDN?", ",".join(identity))
        _, model, found, _ = (part.strip() for part in identity)
        self._info = DeviceInfo("lights", model, found, seam, driver_name("PyVISA"))
        if serial not in ("", found):
            raise WrongDevice(self._info.name, f"the serial number {found}", serial)
        self._obey("*CLS")
        self._highest_a = {
            name: self._number(f"CURR? MAX,(@{number})") for name, number in channels.items()
        }

    @property
    def info(self) -> DeviceInfo:
        """Model, serial number and driver."""
        return self._info

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the lamps."""
        return tuple(self._channels)

    @property
    def settle_s(self) -> float:
        """Time [s] after a change until the light is steady."""
        return self._settle_s

    def set(self, name: str, drive: float) -> AppliedDrive:
        """Drive a lamp at a share of its highest current, 0 to 1, and check that it flows.

        Raises:
            UnknownCommand: no such lamp.
            RequestOutOfLimits: a drive outside 0 to 1.
            BadAnswer: the current does not flow, or is not the one that was set.
            DeviceError: it is lost or silent, or answers a command with an error.
        """
        if name not in self._channels:
            raise UnknownCommand(
                self._info.name, f"the lamp {name!r}", f"one of {', '.join(self._channels)}"
            )
        if not 0.0 <= drive <= 1.0:
            raise RequestOutOfLimits(self._info.name, f"a drive of {drive:g} for {name}", "0 to 1")
        channel, highest = self._channels[name], self._highest_a[name]
        self._obey(f"CURR {drive * highest:.{_DIGITS}g},(@{channel})")
        self._obey(f"OUTP {'ON' if drive > 0 else 'OFF'},(@{channel})")
        applied = round(self._number(f"CURR? (@{channel})") / highest, _DIGITS)
        if abs(applied - drive) > _NEAR:
            raise BadAnswer(self._info.name, f"a drive of {applied:g} for {name}", f"{drive:g}")
        flowing = self._number(f"MEAS:CURR? (@{channel})") / highest
        if flowing < _LEAST_FLOW * applied or (drive == 0 and flowing > 0.01):
            raise BadAnswer(
                self._info.name, f"{flowing:.1%} of the highest current through {name}",
                f"{applied:.1%}", f"Check the wires of {name}, then go on with --resume.",
            )  # fmt: skip
        return AppliedDrive(name, applied)

    def off(self) -> None:
        """Switch every lamp off.

        Raises:
            DeviceError: it is lost or silent, or answers with an error.
        """
        for name in self._channels:
            self.set(name, 0.0)

    def close(self) -> None:
        """Switch the lamps off and let the supply go; harmless when it is gone already."""
        with suppress(DeviceError):  # a supply that is gone cannot be switched off from here
            self.off()
        self._session.close()

    def _obey(self, command: str) -> None:
        if self._streamed:
            # In one piece: sent one by one over TCP the second line waits 40 ms for the first.
            answer = self._ask(f"{command}\nSYST:ERR?", about=command)
        else:
            with self._speaking(command):
                self._session.write(command)
            answer = self._ask("SYST:ERR?")
        if not answer.lstrip("+").startswith("0,"):
            raise UnknownCommand(
                self._info.name, f"the error {answer} in answer to {command!r}",
                "a command that it knows",
                "Check its cable, and that it takes SCPI with channel lists; then go on with"
                " --resume.",
            )  # fmt: skip

    def _ask(self, question: str, about: str = "") -> str:
        with self._speaking(about or question):
            return str(self._session.query(question)).strip()

    def _number(self, question: str) -> float:
        answer = self._ask(question)
        try:
            return float(answer)
        except ValueError as failure:
            raise self._nonsense(question, answer) from failure

    def _nonsense(self, question: str, answer: str) -> BadAnswer:
        return BadAnswer(self._info.name, f"the answer {answer!r} to {question!r}")

    @contextmanager
    def _speaking(self, command: str) -> Iterator[None]:
        """Errors of pyvisa and of the cable, in our terms."""
        errors = load("pyvisa.errors", _FAMILY)
        try:
            yield
        except InputError:
            raise
        except errors.VisaIOError as failure:
            silent = failure.error_code == load("pyvisa.constants", _FAMILY).VI_ERROR_TMO
            kind = DeviceTimeout if silent else DeviceLost
            found = f"no answer to {command!r} ({failure.abbreviation})"
            raise kind(self._info.name, found) from failure
        except OSError as failure:  # pyserial's errors are such, and those of a socket
            raise DeviceLost(
                self._info.name, f"no way to send {command!r} ({failure})"
            ) from failure
        except UnicodeDecodeError as failure:
            raise self._nonsense(command, str(failure.object)) from failure


def open_lights(
    resource: str,
    channels: Mapping[str, int],
    *,
    serial: str = "",
    settle_s: float = 0.5,
    timeout_s: float = 2.0,
    seam: Seam = "real",
) -> ScpiLights:
    """Open a supply by its VISA resource name.

    Args:
        resource: "TCPIP0::192.168.1.5::5025::SOCKET", "ASRL/dev/ttyUSB0::INSTR", "USB0::..." or
            one with a URL of pyserial, "ASRLsocket://...::INSTR".
        channels: name of the lamp -> channel of the supply, from 1.
        serial: serial number that it must have; "" takes any.
        settle_s: time [s] after a change until the light is steady.
        seam: whether the device is real.
        timeout_s: time [s] to wait for an answer.

    Raises:
        DeviceMissing: no library, or nothing at that resource name.
        DeviceError: as `ScpiLights`.
    """
    visa = load("pyvisa", _FAMILY)
    load("pyvisa_py", _FAMILY)
    try:
        session = visa.ResourceManager("@py").open_resource(
            resource,
            read_termination="\n",
            write_termination="\n",
            timeout=round(1000 * timeout_s),
        )
    except Exception as failure:  # pyvisa-py raises bare ones where a network is silent
        raise DeviceMissing(
            _FAMILY, f"nothing at {resource!r} ({failure})", "a supply that is switched on",
            "Check the name: `pyvisa-info` and `benchtwin devices` list what is there.",
        ) from failure  # fmt: skip
    try:
        streamed = resource.upper().startswith("ASRL") or resource.upper().endswith("::SOCKET")
        return ScpiLights(
            session, channels, serial=serial, settle_s=settle_s, streamed=streamed, seam=seam
        )
    except InputError:
        session.close()
        raise
