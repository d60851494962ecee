"""A slider of a stepper motor under Grbl 1.1, the firmware of most small motor boards.

`GrblSlider` is the device; `hw_adapters.wire.links.serial_port` puts it behind a serial URL.

Commands: soft reset (0x18), status (`?`), unlock by homing (`$H`), `G21`, `G90`, and
`G0 X<mm>` or `G1 X<mm> F<mm/min>`. Anything else is answered by `error:20`, as Grbl does.

Source: Grbl 1.1 interface, the pages "Grbl v1.1 Interface" and "Grbl v1.1 Commands" of its
documentation, and the table of its error codes.
"""

from __future__ import annotations

import re
from collections.abc import Callable

from hw_adapters.wire.ports import FaultHook, Sleep, no_faults

BANNER = "Grbl 1.1h ['$' for help]"
LOCKED, UNSUPPORTED, TRAVEL = "error:9", "error:20", "error:15"
RESET, STATUS = 0x18, ord("?")

_MOVE = re.compile(r"G(?:0|1)\s*X(-?\d+(?:\.\d+)?)(?:\s*F\d+(?:\.\d+)?)?$")

PositionSink = Callable[[float], None]
"""Told the position [mm] when the slider has moved."""


class GrblSlider:
    """The device: locked until it has been homed, then absolute positions within its travel."""

    def __init__(
        self,
        sink: PositionSink,
        *,
        travel_mm: float = 200.0,
        move_s: float = 2.0,
        sleep: Sleep | None = None,
        faults: FaultHook = no_faults,
    ) -> None:
        """A slider that has just been switched on.

        Args:
            sink: told the position [mm] after every move.
            travel_mm: greatest position [mm]; the smallest is 0.
            move_s: time [s] of a move.
            sleep: lets time [s] of the bench pass; None passes none.
            faults: asked before every line; see `hw_adapters.wire.ports.FaultHook`.
        """
        self._sink = sink
        self._travel_mm = travel_mm
        self._move_s = move_s
        self._sleep = sleep
        self._faults = faults
        self._homed = False
        self.position_mm = 0.0
        self.plugged = True
        self.refused: list[str] = []
        """Lines that were answered by an error."""
        self.immediate: dict[int, Callable[[], str]] = {RESET: self.start, STATUS: self.status}

    def start(self) -> str:
        """The banner after a reset; a reset locks the slider until it is homed."""
        self._homed = False
        return BANNER

    def plug_in(self) -> None:
        """Connect it again: it is locked until it is homed."""
        self.plugged = True
        self._homed = False

    def status(self) -> str:
        """The answer to `?`."""
        state = "Idle" if self._homed else "Alarm"
        return f"<{state}|MPos:{self.position_mm:.3f},0.000,0.000|FS:0,0>"

    def line(self, text: str) -> str | None:
        """Take one line and return `ok` or an error; None where a fault swallows the answer.

        Raises:
            OSError: the device is unplugged.
        """
        fault = self._faults("slider.line")
        if fault == "unplugging":
            self.plugged = False
        if not self.plugged:
            raise OSError("the device is unplugged")
        if fault == "timeout":
            return None
        answer = self._obey(text.strip().upper())
        if answer != "ok":
            self.refused.append(text.strip())
        return answer

    def _obey(self, command: str) -> str:
        if command == "$H":
            self._homed = True
            return self._move(0.0)
        if command in ("G21", "G90", ""):
            return "ok"
        found = _MOVE.match(command)
        if found is None:
            return UNSUPPORTED
        if not self._homed:
            return LOCKED
        return self._move(float(found[1]))

    def _move(self, position_mm: float) -> str:
        if not 0 <= position_mm <= self._travel_mm:
            return TRAVEL
        if self._sleep is not None and position_mm != self.position_mm:
            self._sleep(self._move_s)
        self.position_mm = position_mm
        self._sink(position_mm)
        return "ok"
