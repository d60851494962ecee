"""Faults by name: one place where they are armed, for devices in process and on the wire.

A device asks `Faults.hook(operation)` before every operation (such as "usb650.frame"), and acts
out the fault that is named in answer. A fault of the bench itself (light, sensor) becomes
active at its moment and lasts until it is disarmed; `BenchState` asks `Faults.active`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from types import MappingProxyType

from twin.errors import InputError
from twin.toml import near_misses

DEVICE_FAULTS = MappingProxyType(
    {
        "stale_frame": "a frame is sent a second time",
        "timeout": "no answer in time",
        "unplugging": "the cable is pulled",
        "dropped_byte": "a byte is lost on the wire",
        "decimal_comma": "the EEPROM writes numbers with a comma",
        "wrong_serial": "another device of the same model is connected",
    }
)
"""Faults that a device acts out when it is asked for something, with what happens."""

BENCH_FAULTS = MappingProxyType(
    {
        "saturation": "50 times the light",
        "hot_pixel": "one pixel gathers charge in the dark",
        "lamp_drift": "the lamps fall by 5 %",
        "gain_step_error": "gains above 16 are 7 % too low",
        "light_leak": "stray room light reaches the sensor, darks included",
    }
)
"""Faults of light and sensor that last, with what happens."""

FAULTS: tuple[str, ...] = (*DEVICE_FAULTS, *BENCH_FAULTS)
"""Names of all faults."""

WIRE_ONLY: tuple[str, ...] = ("dropped_byte", "decimal_comma")
"""Faults that need a wire: devices in process cannot have them."""


@dataclass
class _Armed:
    name: str
    operation: str
    stage: str
    left: int
    lasting: bool
    fired: int = field(default=0)


class Faults:
    """What is to go wrong, and when.

    Attributes:
        stage: step of the sequence that runs; the runner says it ("expose", "dark",
            "white_reference" ... "collimated").
        log: (fault, operation, stage) of every fault that was acted out.
    """

    def __init__(self) -> None:
        self.stage = ""
        self.log: list[tuple[str, str, str]] = []
        self._armed: list[_Armed] = []

    def arm(
        self,
        name: str,
        *,
        operation: str = "*",
        stage: str = "*",
        occurrence: int = 1,
        lasting: bool | None = None,
    ) -> None:
        """Let something go wrong at a chosen moment.

        Args:
            name: one of `FAULTS`.
            operation: pattern of the operation, such as "*.frame"; bench faults come with
                "bench.frame".
            stage: pattern of the sequence's step, such as "black".
            occurrence: at which operation that fits it happens, 1 for the first.
            lasting: it goes on until `disarm`; None: as its kind does.

        Raises:
            InputError: no such fault, or an occurrence below 1.
        """
        if name not in FAULTS:
            raise InputError(
                f"the fault {name!r}", f"one of {', '.join(FAULTS)}",
                remedy=near_misses(name, FAULTS),
            )  # fmt: skip
        if occurrence < 1:
            raise InputError(f"occurrence {occurrence}", "1 or more")
        if name in BENCH_FAULTS and operation == "*":
            operation = "bench.frame"
        lasts = name in BENCH_FAULTS if lasting is None else lasting
        self._armed.append(_Armed(name, operation, stage, occurrence, lasts))

    def disarm(self, name: str = "") -> None:
        """Repair one fault, or all of them."""
        self._armed = [each for each in self._armed if name and each.name != name]

    def hook(self, operation: str, only: str = "") -> str:
        """The fault that a device is to act out in this operation, or "".

        Args:
            operation: what the device is asked for.
            only: the one fault that can show in it; others wait for an operation that fails.
        """
        return next(iter(self._fire(operation, DEVICE_FAULTS, only)), "")

    def active(self, operation: str = "bench.frame") -> frozenset[str]:
        """The faults of the bench that are active in this operation."""
        return frozenset(self._fire(operation, BENCH_FAULTS))

    def _fire(self, operation: str, kinds: object, only: str = "") -> list[str]:
        found = []
        known = DEVICE_FAULTS if kinds is DEVICE_FAULTS else BENCH_FAULTS
        for armed in self._armed:
            if armed.name not in known or (only and armed.name != only):
                continue
            if armed.fired and armed.lasting:
                fits = fnmatchcase(operation, armed.operation)
            elif armed.fired:
                continue
            else:
                fits = fnmatchcase(operation, armed.operation) and fnmatchcase(
                    self.stage, armed.stage
                )
                armed.left -= fits
                fits = fits and armed.left == 0
            if fits:
                armed.fired += 1
                found.append(armed.name)
                if armed.fired == 1:
                    self.log.append((armed.name, operation, self.stage))
        return found
