"""The capture plan: which shot is taken when, with which light, background and sample."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

from pydantic import Field, field_validator

from hw_adapters.protocols import OUT, Applied
from hw_adapters.state import BEAM, PANELS
from twin.spectra import Part

Capture = Literal["black", "white", "collimated"]


@dataclass(frozen=True, slots=True)
class Scene:
    """What stands and shines on the bench during a capture."""

    lamp: str
    """"panels", "beam", or "" for none."""
    background: str
    """"black", "white", "out", or "" for any: it stays where it is."""
    present: bool
    """Whether the sample is in the holder."""


SCENES: Mapping[str, Scene] = MappingProxyType(
    {
        "dark": Scene("", "", False),
        "white_reference": Scene(PANELS, "white", False),
        "black_reference": Scene(PANELS, "black", False),
        "beam_reference": Scene(BEAM, OUT, False),
        "black": Scene(PANELS, "black", True),
        "white": Scene(PANELS, "white", True),
        "collimated": Scene(BEAM, OUT, True),
    }
)
"""The scene of every capture (bench.md, Captures)."""


class PlanSettings(Part):
    """What a person chooses about a visit."""

    repeats: int = Field(default=3, ge=1, le=1000)
    """How often each capture of a sample is taken."""
    reference_repeats: int = Field(default=3, ge=1, le=1000)
    """How often each reference and dark is taken each time."""
    references: Literal["first", "first_and_last"] = "first_and_last"
    """References before each sample, or before and after it (then lamp drift averages out)."""
    last_darks: bool = True
    """Darks once more at the end of the visit, at every setting used."""
    order: tuple[Capture, ...] = ("black", "white", "collimated")
    """Captures of a sample in the order in which they are taken."""
    averages: int = Field(default=10, ge=1, le=100_000)
    """Frames averaged into one shot."""
    exposure: float | Literal["auto"] = "auto"
    """Integration time [s] of every capture, or "auto"."""
    fill: float = Field(default=0.8, gt=0, lt=1)
    """Share of full scale that the automatic exposure aims at."""
    collimated_longest_s: float = Field(default=10.0, gt=0)
    """With automatic exposure the collimated capture may take up to this time [s]."""
    warm_up_s: float = Field(default=600.0, ge=0)
    """Time [s] both lamps burn before anything is captured."""
    pause_s: float = Field(default=0.0, ge=0)
    """Time [s] between two shots."""
    discard: int = Field(default=1, ge=0, le=100)
    """Frames thrown away after each change of settings, light, background or sample."""
    drift_limit: float = Field(default=0.01, gt=0, lt=1)
    """Relative drift of a reference, from first to last, above which the measurement says so."""
    gain: float | None = None
    """Gain of a chip at first; None takes 16."""
    atime: int = Field(default=99, ge=0, le=255)
    """Register ATIME of a chip."""
    astep: int = Field(default=999, ge=0, le=65_534)
    """Register ASTEP of a chip."""

    @field_validator("exposure")
    @classmethod
    def _positive(cls, value: float | str) -> float | str:
        if not isinstance(value, str) and value <= 0:
            raise ValueError(f'found {value:g}; expected seconds above 0, or "auto"')
        return value

    @field_validator("order")
    @classmethod
    def _each_once(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        if not value or len(set(value)) != len(value):
            raise ValueError(f"found {', '.join(value) or 'nothing'}; expected captures, each once")
        return value


Exposures = Mapping[str, Applied]
"""Settings of every capture of one sample but its darks."""


@dataclass(frozen=True, slots=True)
class PlannedShot:
    """One shot of the plan before it is taken."""

    number: int
    """0, 1, 2 ... within the visit; the noise of a virtual bench depends on it."""
    capture: str
    sample: str
    repeat: int
    settings: Applied

    @property
    def label(self) -> str:
        """The shot as messages call it."""
        at = f" at {self.settings.integration_s:g} s" if self.capture == "dark" else ""
        at += f" and gain {self.settings.gain:g}" if at and self.settings.gain != 1.0 else ""
        return f"{self.capture} of {self.sample!r}{at}, repeat {self.repeat}"


def capture_plan(
    exposures: Mapping[str, Exposures], settings: PlanSettings
) -> tuple[PlannedShot, ...]:
    """Every shot in the order in which it is taken.

    Sample by sample: darks at every setting used; references; each capture with its repeats;
    references again. At the end, darks at every setting of the last sample. Darks and references
    belong to the sample: they are taken with the holder at its height.

    Args:
        exposures: sample -> capture -> settings, samples in the order in which they are measured.
        settings: repeats, order and references.
    """
    taken: Counter[tuple[str, str, tuple[float, float]]] = Counter()
    plan: list[PlannedShot] = []
    for capture, sample, applied in _steps(exposures, settings):
        key = (capture, sample, applied.key)
        plan.append(PlannedShot(len(plan), capture, sample, taken[key], applied))
        taken[key] += 1
    return tuple(plan)


def _steps(
    exposures: Mapping[str, Exposures], settings: PlanSettings
) -> Iterator[tuple[str, str, Applied]]:
    sample = ""
    for sample, own in exposures.items():
        yield from _darks(sample, own, settings)
        yield from _references(sample, own, settings)
        for capture in settings.order:
            for _ in range(settings.repeats):
                yield capture, sample, own[capture]
        if settings.references == "first_and_last":
            yield from _references(sample, own, settings)
    if settings.last_darks and sample:
        yield from _darks(sample, exposures[sample], settings)


def _darks(
    sample: str, own: Exposures, settings: PlanSettings
) -> Iterator[tuple[str, str, Applied]]:
    for applied in {each.key: each for each in own.values()}.values():
        for _ in range(settings.reference_repeats):
            yield "dark", sample, applied


def _references(
    sample: str, own: Exposures, settings: PlanSettings
) -> Iterator[tuple[str, str, Applied]]:
    for capture in ("white_reference", "black_reference", "beam_reference"):
        for _ in range(settings.reference_repeats):
            yield capture, sample, own[capture]
