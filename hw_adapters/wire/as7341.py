"""The AS7341 as it looks from the I2C bus: the real Adafruit driver runs above it.

`As7341` is the chip: a bank of registers, the multiplexer that connects photodiodes to six
converters, and the integration. `I2cBus` is what `board.I2C()` would be.

Source: ams-OSRAM data sheet DS000504 (AS7341, v3-00, 2020), section 10.2 (registers); which memory
cell of the multiplexer belongs to which photodiode: names `SMUX_IN` of adafruit_as7341 1.2.27.
"""

from __future__ import annotations

import errno
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from hw_adapters.errors import UnknownCommand
from hw_adapters.wire.ports import FaultHook, Sleep, no_faults

ADDRESS = 0x39
CONFIG, LED, ENABLE, ATIME = 0x70, 0x74, 0x80, 0x81
WHOAMI, ASTATUS, DATA, STATUS2 = 0x92, 0x94, 0x95, 0xA3
CFG0, CFG1, CFG6, ASTEP = 0xA9, 0xAA, 0xAF, 0xCA
CONVERTERS = 6
IDENTITY = 0x09 << 2
STEP_S = 2.78e-6
LOW_BANK = 1 << 4
POWER_ON, MEASURE, MULTIPLEX = 1 << 0, 1 << 1, 1 << 4
VALID, DIGITAL_SATURATION, ANALOG_SATURATION = 1 << 6, 1 << 4, 1 << 3
SATURATED = 1 << 7
WRITE_CHAIN = 2 << 3
GAINS = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0, 512.0)

# Memory cell of the multiplexer: photodiodes of its low and its high half byte.
_CELLS: tuple[tuple[str, str], ...] = (
    ("", "F3"), ("F1", ""), ("", ""), ("", "F8"), ("F6", ""), ("F2", "F4"), ("", "F5"),
    ("F7", ""), ("", "CLEAR"), ("", "F5"), ("F7", ""), ("", ""), ("", "F2"), ("F4", ""),
    ("F8", "F6"), ("", "F3"), ("F1", "GPIO"), ("INT", "CLEAR"), ("", "DARK"), ("NIR", "FLICKER"),
)  # fmt: skip
_DIODES = {name: sum(name in cell for cell in _CELLS) for cell in _CELLS for name in cell if name}

_READ_ONLY = frozenset({WHOAMI, ASTATUS, STATUS2, *range(DATA, DATA + 2 * CONVERTERS)})
_WRITABLE = frozenset({ENABLE, ATIME, CFG0, CFG1, CFG6, ASTEP, ASTEP + 1, CONFIG, LED})
_ENABLE_BITS = POWER_ON | MEASURE | MULTIPLEX


@dataclass(frozen=True)
class ChipPass:
    """What one of the two passes measures.

    Attributes:
        channels: photodiodes connected to the converters 0 to 5, such as ("F1", "F2", "F3", "F4",
            "CLEAR", "NIR"); "" where nothing is connected.
        gain: gain set in register CFG1.
        atime: register ATIME.
        astep: register ASTEP.
    """

    channels: tuple[str, ...]
    gain: float
    atime: int
    astep: int

    @property
    def integration_s(self) -> float:
        """Integration time [s], (ATIME + 1)(ASTEP + 1) 2.78 us."""
        return (self.atime + 1) * (self.astep + 1) * STEP_S

    @property
    def full_scale(self) -> int:
        """Highest reading [counts], min(65535, (ATIME + 1)(ASTEP + 1))."""
        return min(65535, (self.atime + 1) * (self.astep + 1))


@dataclass(frozen=True, slots=True)
class PassReading:
    """What a pass reads.

    Attributes:
        counts: six readings [counts], whole numbers from 0 to the full scale.
        analog_saturation: whether a converter got more light than it can balance.
    """

    counts: Sequence[int]
    analog_saturation: bool = False


PassSource = Callable[[ChipPass], PassReading]
"""What the chip sees in one pass."""


class As7341:
    """The chip: registers, multiplexer and converters.

    A measurement begins when the bit SP_EN is set and is ready when STATUS2 says so; from then on
    the same data are read until SP_EN is set again. STATUS2 lets the integration time pass.
    """

    def __init__(
        self,
        measure: PassSource,
        *,
        sleep: Sleep | None = None,
        faults: FaultHook = no_faults,
    ) -> None:
        """A chip with power, every register at its reset value.

        Args:
            measure: what the chip sees in a pass.
            sleep: lets time [s] of the bench pass; None passes none.
            faults: asked before every operation; see `hw_adapters.wire.ports.FaultHook`.
        """
        self._measure = measure
        self._sleep = sleep
        self._faults = faults
        self.plugged = True
        self.passes: list[ChipPass] = []
        self._reset()

    def _reset(self) -> None:
        self._registers = dict.fromkeys(_WRITABLE | _READ_ONLY, 0)
        self._registers[WHOAMI] = IDENTITY
        self._registers[CFG1] = 0x09
        self._registers[ASTEP], self._registers[ASTEP + 1] = 0xE7, 0x03
        self._memory = [0] * len(_CELLS)
        self._chain = [0] * len(_CELLS)
        self._pending: ChipPass | None = None

    def unplug(self) -> None:
        """Pull the wire: from now on no address answers."""
        self.plugged = False

    def plug_in(self) -> None:
        """Connect the wire again: the chip starts from its reset values."""
        self.plugged = True
        self._reset()

    def present(self, operation: str) -> None:
        """Raise OSError, as the bus does, when the chip does not acknowledge."""
        self._act(self._faults(f"as7341.{operation}"))

    def _act(self, fault: str) -> None:
        """What can happen in any operation."""
        if fault == "unplugging":
            self.unplug()
        if not self.plugged or fault == "dropped_byte":
            raise OSError(errno.EREMOTEIO, "Remote I/O error")
        if fault == "timeout":
            raise OSError(errno.ETIMEDOUT, "Connection timed out")

    def write(self, register: int, data: bytes) -> None:
        """Write registers from `register` on.

        Raises:
            UnknownCommand: a register that cannot be written, or bits that are not known.
        """
        for offset, value in enumerate(data):
            self._write_one(register + offset, value)

    def read(self, register: int, size: int) -> bytes:
        """Read registers from `register` on.

        Raises:
            UnknownCommand: a register that is not known, or that is in the other bank.
        """
        return bytes(self._read_one(register + offset) for offset in range(size))

    def _write_one(self, register: int, value: int) -> None:
        if register < len(_CELLS):
            self._memory[register] = value
            return
        if register not in _WRITABLE:
            raise UnknownCommand("AS7341", f"a write of 0x{value:02x} to register 0x{register:02x}")
        self._in_bank(register)
        if register == ENABLE:
            self._enable(value)
            return
        if register == CFG1 and value >= len(GAINS):
            raise UnknownCommand("AS7341", f"gain {value} in register CFG1")
        self._registers[register] = value

    def _read_one(self, register: int) -> int:
        if register not in self._registers:
            raise UnknownCommand("AS7341", f"a read of register 0x{register:02x}")
        self._in_bank(register)
        if register == STATUS2:
            self._finish()
        return self._registers[register]

    def _in_bank(self, register: int) -> None:
        low = bool(self._registers[CFG0] & LOW_BANK)
        if register != CFG0 and low != (register < 0x80):
            bank = "low" if low else "high"
            raise UnknownCommand("AS7341", f"register 0x{register:02x} while the {bank} bank is on")

    def _enable(self, value: int) -> None:
        if value & ~_ENABLE_BITS:
            raise UnknownCommand("AS7341", f"ENABLE 0x{value:02x}")
        before = self._registers[ENABLE]
        if value & MULTIPLEX:
            if self._registers[CFG6] != WRITE_CHAIN or value & MEASURE:
                raise UnknownCommand("AS7341", f"ENABLE 0x{value:02x}: a multiplexer command")
            self._chain = list(self._memory)
            value &= ~MULTIPLEX  # the chip clears the bit when the chain is written
        self._registers[ENABLE] = value
        measuring = value & MEASURE and value & POWER_ON
        if measuring and not before & MEASURE:
            step = self._registers[ASTEP] | self._registers[ASTEP + 1] << 8
            gain = GAINS[self._registers[CFG1]]
            self._pending = ChipPass(self._connected(), gain, self._registers[ATIME], step)
        if not measuring:
            self._pending = None
        if not measuring or not before & MEASURE:
            self._registers[STATUS2] = 0

    def _connected(self) -> tuple[str, ...]:
        inputs: list[list[str]] = [[] for _ in range(CONVERTERS + 1)]
        for cell, value in zip(_CELLS, self._chain, strict=True):
            for name, output in zip(cell, (value & 0x0F, value >> 4), strict=True):
                if output > CONVERTERS or (output and not name):
                    raise UnknownCommand("AS7341", f"multiplexer cell with 0x{value:02x}")
                inputs[output].append(name)
        for names in inputs[1:]:
            if len(set(names)) > 1 or (names and len(names) != _DIODES[names[0]]):
                joined = " + ".join(names)
                raise UnknownCommand("AS7341", f"one converter connected to {joined}")
        return tuple(names[0] if names else "" for names in inputs[1:])

    def _finish(self) -> None:
        if self._pending is None:
            return
        fault = self._faults("as7341.frame")
        self._act(fault)
        setting, self._pending = self._pending, None
        if fault != "stale_frame":
            self._latch(setting)
            if self._sleep is not None:
                self._sleep(setting.integration_s)
        self._registers[STATUS2] |= VALID

    def _latch(self, setting: ChipPass) -> None:
        reading = self._measure(setting)
        counts = [int(value) for value in reading.counts]
        if len(counts) != CONVERTERS or not 0 <= min(counts) <= max(counts) <= 65535:
            raise ValueError(f"found readings {counts}; expected six from 0 to 65535")
        self.passes.append(setting)
        used = zip(setting.channels, counts, strict=True)
        digital = any(name and value >= setting.full_scale for name, value in used)
        self._registers[STATUS2] = (DIGITAL_SATURATION if digital else 0) | (
            ANALOG_SATURATION if reading.analog_saturation else 0
        )
        saturated = digital or reading.analog_saturation
        gain = self._registers[CFG1] & 0x0F
        self._registers[ASTATUS] = gain | (SATURATED if saturated else 0)
        for converter, value in enumerate(counts):
            self._registers[DATA + 2 * converter] = value & 0xFF
            self._registers[DATA + 2 * converter + 1] = value >> 8


class I2cBus:
    """What `busio.I2C` is to a driver, with one chip at address 0x39."""

    def __init__(self, chip: As7341) -> None:
        self._chip = chip
        self._locked = False
        self._pointer = 0

    def try_lock(self) -> bool:
        """Take the bus; False when it is taken."""
        if self._locked:
            return False
        self._locked = True
        return True

    def unlock(self) -> None:
        """Give the bus back."""
        self._locked = False

    def scan(self) -> list[int]:
        """Addresses that acknowledge."""
        return [ADDRESS] if self._chip.plugged else []

    def deinit(self) -> None:
        """Nothing is held."""

    def writeto(
        self, address: int, buffer: bytes | bytearray, *, start: int = 0, end: int | None = None
    ) -> None:
        """Write a register address and the bytes that go there; nothing at all is a probe."""
        self._acknowledged(address, "write")
        data = bytes(buffer[start:end])
        if data:
            self._pointer = data[0]
            self._chip.write(data[0], data[1:])

    def readfrom_into(
        self, address: int, buffer: bytearray, *, start: int = 0, end: int | None = None
    ) -> None:
        """Read from the register that the last write named."""
        self._acknowledged(address, "read")
        stop = len(buffer) if end is None else end
        buffer[start:stop] = self._chip.read(self._pointer, stop - start)

    def writeto_then_readfrom(
        self,
        address: int,
        buffer_out: bytes | bytearray,
        buffer_in: bytearray,
        *,
        out_start: int = 0,
        out_end: int | None = None,
        in_start: int = 0,
        in_end: int | None = None,
    ) -> None:
        """Write a register address, then read from there without letting the bus go."""
        self.writeto(address, buffer_out, start=out_start, end=out_end)
        self.readfrom_into(address, buffer_in, start=in_start, end=in_end)

    def _acknowledged(self, address: int, operation: str) -> None:
        if not self._locked:
            raise RuntimeError("the bus was used without try_lock")
        if address != ADDRESS:
            raise OSError(errno.ENXIO, f"no device at address 0x{address:02x}")
        self._chip.present(operation)
