"""A driver of LEDs (or a bench supply with limited current) that speaks SCPI.

`ScpiSupply` is the device: lines in, lines out. `hw_adapters.wire.links` puts it behind a serial
URL or a loopback socket, where the real pyvisa-py opens it.

Commands (SCPI-1999 with channel lists; long and short forms, upper and lower case):

    *IDN?  *RST  *CLS  SYSTem:ERRor?
    [SOURce:]CURRent <A>|MINimum|MAXimum,(@n)      [SOURce:]CURRent? [MINimum|MAXimum,](@n)
    OUTPut[:STATe] ON|OFF|1|0,(@n)                 OUTPut[:STATe]? (@n)
    MEASure[:SCALar]:CURRent[:DC]? (@n)

Source: SCPI-1999, volume 1 (syntax) and volume 2 (chapters 15, 19, 21); IEEE 488.2-1992.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar

from hw_adapters.wire.ports import FaultHook, no_faults

NO_ERROR = '0,"No error"'
UNDEFINED = '-113,"Undefined header"'
MISSING = '-109,"Missing parameter"'
ILLEGAL = '-224,"Illegal parameter value"'
OUT_OF_RANGE = '-222,"Data out of range"'

RESOLUTION = 9
"""Decimals of the share of a channel's highest current that the device resolves."""

LightSink = Callable[[int, float], None]
"""(channel from 1, fraction of its highest current that flows) -> the lamp of the bench."""

_CHANNEL = re.compile(r"\(@(\d+)\)$")


class ScpiSupply:
    """The device: channels with a set current and a switch, and a queue of errors."""

    def __init__(
        self,
        sink: LightSink,
        *,
        highest_a: Sequence[float] = (1.0, 1.0),
        serial: str = "TWIN0001",
        faults: FaultHook = no_faults,
    ) -> None:
        """A supply with every output off.

        Args:
            sink: told the fraction of the highest current whenever it changes.
            highest_a: highest current [A] of each channel.
            serial: serial number in the answer to `*IDN?`.
            faults: asked before every line, as "scpi.info" (`*IDN?`), "scpi.ask" or "scpi.set"; see
                `hw_adapters.wire.ports.FaultHook`.
        """
        self._sink = sink
        self._highest_a = tuple(highest_a)
        self._serial = serial
        self._faults = faults
        self._set_a = [0.0] * len(self._highest_a)
        self._on = [False] * len(self._highest_a)
        self._errors: deque[str] = deque()
        self.plugged = True
        self.refused: list[str] = []
        """Lines that were answered by an error."""

    def line(self, text: str) -> str | None:
        """Take one line and return the answer, or None where there is none.

        An unknown line has no answer; it waits in the queue of errors, as on a real device.

        Raises:
            OSError: the device is unplugged.
        """
        header, _, argument = text.strip().partition(" ")
        fault = self._faults("scpi." + _operation(header))
        if fault == "unplugging":
            self.plugged = False
        if not self.plugged:
            raise OSError("the device is unplugged")
        if fault == "timeout":
            return None
        asked = header.endswith("?")
        if fault == "dropped_byte" and not asked:
            header = header[1:]
        answer = self._answer(_short(header), argument.strip().upper(), fault)
        if answer is not None and answer.startswith("!"):
            self.refused.append(text.strip())
            self._errors.append(answer[1:])
            return None
        return answer[1:] if answer is not None and fault == "dropped_byte" else answer

    immediate: ClassVar[Mapping[int, Callable[[], str]]] = {}
    """No byte is answered without a line end."""

    def start(self) -> None:
        """A connection was opened: nothing is said."""

    def plug_in(self) -> None:
        """Connect it again: it starts with every output off."""
        self.plugged = True
        self._all_off()

    def _answer(self, header: str, argument: str, fault: str) -> str | None:
        if header == "*IDN?":
            return self._identity(fault)
        if header in ("*RST", "*CLS"):
            if header == "*RST":
                self._all_off()
            self._errors.clear()
            return None
        if header == "SYST:ERR?":
            return self._errors.popleft() if self._errors else NO_ERROR
        commands = {
            "CURR": self._set_current,
            "CURR?": self._current,
            "OUTP": self._switch,
            "OUTP?": self._output,
            "MEAS:CURR?": self._measured,
        }
        if header not in commands:
            return "!" + UNDEFINED
        found = _CHANNEL.search(argument)
        if found is None:
            return "!" + MISSING
        channel = int(found[1]) - 1
        if not 0 <= channel < len(self._highest_a):
            return "!" + OUT_OF_RANGE
        return commands[header](channel, argument[: found.start()].rstrip(", "))

    def _identity(self, fault: str) -> str:
        serial = "OTHER" if fault == "wrong_serial" else self._serial
        return f"benchtwin,LED-SUPPLY,{serial},1.0"

    def _all_off(self) -> None:
        for channel in range(len(self._highest_a)):
            self._set_a[channel], self._on[channel] = 0.0, False
            self._tell(channel)

    def _set_current(self, channel: int, value: str) -> str | None:
        limit = _limit(value)
        try:
            amperes = self._highest_a[channel] * limit if limit is not None else float(value)
        except ValueError:
            return "!" + ILLEGAL
        if not 0 <= amperes <= self._highest_a[channel]:
            return "!" + OUT_OF_RANGE
        self._set_a[channel] = amperes
        self._tell(channel)
        return None

    def _current(self, channel: int, value: str) -> str:
        if not value:
            return f"{self._set_a[channel]:.9E}"
        limit = _limit(value)
        return "!" + ILLEGAL if limit is None else f"{self._highest_a[channel] * limit:.9E}"

    def _switch(self, channel: int, value: str) -> str | None:
        if value not in ("ON", "OFF", "1", "0"):
            return "!" + ILLEGAL
        self._on[channel] = value in ("ON", "1")
        self._tell(channel)
        return None

    def _output(self, channel: int, value: str) -> str:
        return "!" + ILLEGAL if value else str(int(self._on[channel]))

    def _measured(self, channel: int, value: str) -> str:
        flowing = self._set_a[channel] if self._on[channel] else 0.0
        return "!" + ILLEGAL if value else f"{flowing:.9E}"

    def _tell(self, channel: int) -> None:
        flowing = self._set_a[channel] if self._on[channel] else 0.0
        self._sink(channel + 1, round(flowing / self._highest_a[channel], RESOLUTION))


def _operation(header: str) -> str:
    if _short(header) == "*IDN?":
        return "info"
    return "ask" if header.endswith("?") else "set"


def _limit(value: str) -> float | None:
    if value in ("MIN", "MINIMUM"):
        return 0.0
    return 1.0 if value in ("MAX", "MAXIMUM") else None


_LONG = {
    "SYSTEM": "SYST", "ERROR": "ERR", "CURRENT": "CURR", "OUTPUT": "OUTP", "MEASURE": "MEAS",
    "SOURCE": "SOUR", "STATE": "STAT", "SCALAR": "SCAL",
}  # fmt: skip


def _short(header: str) -> str:
    # Optional nodes are left out, long forms become short ones: one spelling for each command.
    question = "?" if header.endswith("?") else ""
    nodes = [_LONG.get(node, node) for node in header.upper().rstrip("?").lstrip(":").split(":")]
    if nodes[0] == "SOUR" and len(nodes) > 1:
        nodes = nodes[1:]
    if nodes[:2] == ["OUTP", "STAT"]:
        nodes = ["OUTP", *nodes[2:]]
    if nodes[0] == "MEAS":
        nodes = [node for node in nodes if node not in ("SCAL", "DC")]
    if nodes == ["SYST", "ERR", "NEXT"]:
        nodes = nodes[:2]
    return ":".join(nodes) + question
