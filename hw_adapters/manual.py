"""Devices that are a person: asked in words to move a background or to change a sample."""

from __future__ import annotations

from collections.abc import Callable

from hw_adapters.errors import RequestOutOfLimits, UnknownCommand
from hw_adapters.protocols import OUT, AppliedDrive, DeviceInfo, DeviceKind

Ask = Callable[[str], None]
"""Shows a sentence and returns when the person has done what it says."""

BACKGROUND_TEXTS = {
    "black": "Put the black background under the sample.",
    "white": "Put the white background under the sample.",
    OUT: "Take the background away, so that the beam comes through from below.",
}


class _Person:
    """Args: ask: shows a sentence and waits."""

    def __init__(self, ask: Ask, kind: DeviceKind, model: str) -> None:
        self._ask, self._kind, self._model = ask, kind, model

    @property
    def info(self) -> DeviceInfo:
        """A person has no serial number."""
        return DeviceInfo(self._kind, self._model, "", "real", "by hand")

    def close(self) -> None:
        """Nothing is held."""


class ManualStage(_Person):
    """A person who changes the background.

    Args:
        ask: shows a sentence and returns when it is done.
    """

    def __init__(self, ask: Ask) -> None:
        super().__init__(ask, "stage", "background by hand")
        self._position = ""

    @property
    def positions(self) -> tuple[str, ...]:
        """Names of the positions."""
        return tuple(BACKGROUND_TEXTS)

    def move_to(self, position: str) -> None:
        """Ask for a background, unless it is there already.

        Raises:
            UnknownCommand: no such position.
        """
        if position not in BACKGROUND_TEXTS:
            raise UnknownCommand(
                self.info.name, f"the position {position!r}", f"one of {', '.join(self.positions)}"
            )
        if position != self._position:
            self._ask(BACKGROUND_TEXTS[position])
            self._position = position


class ManualHolder(_Person):
    """A person who changes the sample.

    Args:
        ask: shows a sentence and returns when it is done.
        samples: names of the samples.
    """

    def __init__(self, ask: Ask, samples: tuple[str, ...]) -> None:
        super().__init__(ask, "holder", "sample by hand")
        self._samples = samples
        self._now: tuple[str, bool] | None = None

    @property
    def samples(self) -> tuple[str, ...]:
        """Names of the samples."""
        return self._samples

    def place(self, sample: str, present: bool) -> None:
        """Ask for a sample, or for its removal, unless that is so already.

        Raises:
            UnknownCommand: no such sample.
        """
        if sample not in self._samples:
            raise UnknownCommand(
                self.info.name, f"the sample {sample!r}", f"one of {', '.join(self._samples)}"
            )
        if self._now != (sample, present):
            if present:
                self._ask(f"Lay the sample {sample!r} in the holder.")
            else:
                self._ask(f"Leave the holder empty, at the height of the sample {sample!r}.")
            self._now = (sample, present)


class ManualLights(_Person):
    """A person who switches the lamps: on (1) and off (0), nothing between.

    Args:
        ask: shows a sentence and returns when it is done.
        settle_s: time [s] the lamps need after a change.
    """

    def __init__(self, ask: Ask, *, settle_s: float = 5.0) -> None:
        super().__init__(ask, "lights", "lamps by hand")
        self._settle_s = settle_s
        self._on = dict.fromkeys(("panels", "beam"), 0.0)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the lamps."""
        return tuple(self._on)

    @property
    def settle_s(self) -> float:
        """Time [s] after a change until the light is steady."""
        return self._settle_s

    def set(self, name: str, drive: float) -> AppliedDrive:
        """Ask for a lamp to be switched, unless it is so already.

        Raises:
            UnknownCommand: no such lamp.
            RequestOutOfLimits: a drive that is neither 0 nor 1.
        """
        if name not in self._on:
            raise UnknownCommand(
                self.info.name, f"the channel {name!r}", f"one of {', '.join(self._on)}"
            )
        if drive not in (0.0, 1.0):
            raise RequestOutOfLimits(self.info.name, f"a drive of {drive:g} for {name}", "0 or 1")
        if drive != self._on[name]:
            self._ask(f"Switch the {name} {'on' if drive else 'off'}.")
            self._on[name] = drive
        return AppliedDrive(name, drive)

    def off(self) -> None:
        """Ask for every lamp that is on to be switched off."""
        for name in self._on:
            self.set(name, 0.0)
