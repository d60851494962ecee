"""A candidate: parts and a protocol, from which bench, visit and price follow."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from itertools import combinations, product
from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.design.parts import KINDS, DesignPart, Parts
from scenarios.outputs import fingerprint
from twin.bench import Bench, Panel, Sample
from twin.errors import InputError
from twin.instrument import MultispectralChip
from twin.spectra import FloatArray
from twin.toml import validate

if TYPE_CHECKING:
    from scenarios.design.goal import Goal
    from scenarios.design.media import Medium
    from scenarios.scenario import Scenario, WavelengthGrid

NEEDED = {
    False: ("illuminant", "panels", "beam", "white", "black", "detector", "stage", "preparation"),
    True: ("illuminant", "detector"),
}
"""Kinds of which a bench for translucent (False) or fluorescent (True) materials has one each."""
CHIP_STEP_NM = 20.0
"""Longest step [nm] of the light transport for a chip."""


@dataclass(frozen=True)
class Candidate:
    """Parts, and what is done with them.

    Attributes:
        parts: names, one of each kind that is needed, in the order of `KINDS`.
        thickness_mm: of the samples [mm], increasing; () for fluorescent materials.
        averages: frames in a shot.
        repeats: shots of every capture and reference.
        acceptance_deg: half-angle of the view.
        polar_deg: angle of the panels.
        leds: fluorescent materials: how many illuminants are lit.
    """

    parts: tuple[str, ...]
    thickness_mm: tuple[float, ...] = ()
    averages: int = 10
    repeats: int = 3
    acceptance_deg: float = 1.0
    polar_deg: float = 45.0
    leds: int = 0

    @property
    def text(self) -> str:
        """In one line."""
        steps = [", ".join(self.parts)]
        if self.thickness_mm:
            steps.append(" + ".join(f"{mm:g}" for mm in self.thickness_mm) + " mm")
        if self.leds:
            steps.append(f"{self.leds} lights")
        steps.append(f"{self.repeats} x {self.averages} frames")
        if self.thickness_mm:
            steps.append(f"view {self.acceptance_deg:g}°, panels {self.polar_deg:g}°")
        return "; ".join(steps)

    def chosen(self, parts: Parts) -> tuple[DesignPart, ...]:
        """The parts themselves.

        Raises:
            InputError: an unknown one.
        """
        return tuple(parts.part(name) for name in self.parts)

    def price(self, parts: Parts) -> float:
        """Price [USD] of the parts and of what the samples use up.

        Raises:
            InputError: an unknown part, or one without a price.
        """
        own = self.chosen(parts)
        by_sample = sum(part.per_sample_usd for part in own)
        return sum(part.price for part in own) + by_sample * len(self.thickness_mm)

    def id(self, parts: Parts) -> str:
        """Twelve digits over all that it is made of: equal where everything is equal."""
        content = [part.model_dump(mode="json") for part in self.chosen(parts)]
        return fingerprint({"candidate": asdict(self), "parts": content})[:12]

    def tolerances(self, parts: Parts) -> dict[str, float]:
        """Standard uncertainty of every input and effect by name; of several parts, together."""
        found: dict[str, float] = {}
        for part in self.chosen(parts):
            for each in part.tolerances:
                found[each.name] = float(np.hypot(found.get(each.name, 0.0), each.scale))
        return found

    def bench(self, parts: Parts, wavelength_nm: Sequence[float]) -> Bench:
        """The bench, its spectrometer reading bins around these wavelengths [nm].

        Raises:
            InputError: parts whose figures make no bench.
        """
        own = self.chosen(parts)
        data: dict[str, Any] = {}
        for part in own:
            data = _merged(data, part.bench)
        instrument = data.setdefault("instrument", {})
        instrument.setdefault("kind", "spectrometer")
        instrument["averages"] = self.averages
        if instrument["kind"] == "spectrometer":
            instrument["pixels_nm"] = tuple(float(each) for each in wavelength_nm)
            # a bin is read as one pixel: its width is what is judged, not a fault
            instrument["off"] = ("bandwidth",)
        panel = Panel(polar_deg=self.polar_deg).model_dump(mode="python")
        data["panels"] = ({**panel, "azimuth_deg": 0.0}, {**panel, "azimuth_deg": 180.0})
        data["detector"] = {**data.get("detector", {}), "acceptance_deg": self.acceptance_deg}
        try:
            bench = validate(data, Bench)
        except InputError as error:
            raise error.at("", f"parts of {self.text}") from error
        factor = float(np.prod([part.brightness for part in own]))
        rates = {
            name: getattr(bench.instrument, name) * factor
            for name in ("white_rate_electrons_per_s", "beam_rate_electrons_per_s")
        }
        return bench.model_copy(update={"instrument": bench.instrument.model_copy(update=rates)})

    def samples(self, medium: Medium) -> tuple[Sample, ...]:
        """The samples of one material."""
        return tuple(
            Sample(name=f"{mm:g} mm", thickness_mm=mm, n=medium.n, material=medium.material)
            for mm in self.thickness_mm
        )

    def scenario(self, parts: Parts, goal: Goal, medium: Medium) -> Scenario:
        """The visit to the bench as a scenario: what `benchtwin run` simulates.

        Raises:
            InputError: parts or materials that make none.
        """
        from scenarios.scenario import Scenario

        grid = goal.wavelength
        bench = self.bench(parts, grid.wavelength_nm.tolist())
        if isinstance(bench.instrument, MultispectralChip):
            grid = chip_grid(bench.instrument)
        data = {
            "title": f"Design {self.id(parts)}: {medium.name}"[:200],
            "bench": bench,
            "samples": self.samples(medium),
            "wavelength": grid.model_dump(),
            "protocol": {"repeats": self.repeats, "reference_repeats": self.repeats},
            "estimator": {"name": "least-squares"},
        }
        return validate(data, Scenario)

    def toml(self, parts: Parts, goal: Goal) -> str:
        """A scenario file that says it again, its parts and prices as comments."""
        from twin.measurement.written import toml_text

        scenario = self.scenario(parts, goal, goal.media[0])
        table = scenario.model_dump(mode="json", exclude_none=True)
        table["bench"]["size_mm"] = table["bench"].get("size_mm") or "unbounded"
        said = [f"# {part.title}: {part.price:g} USD ({part.price_source})"
                for part in self.chosen(parts)]  # fmt: skip
        head = [f"# Design {self.id(parts)}: {self.price(parts):g} USD", *said]
        return "\n".join(head) + "\n" + toml_text(table)


def chip_grid(chip: MultispectralChip) -> WavelengthGrid:
    """Wavelengths at which the light of a chip is computed: all over what it sees."""
    from scenarios.scenario import WavelengthGrid

    low, high = chip.range_nm
    steps = math.ceil((high - low) / CHIP_STEP_NM)
    return WavelengthGrid(start_nm=low, stop_nm=high, step_nm=(high - low) / steps)


def judged_nm(bench: Bench, low_nm: float, high_nm: float) -> FloatArray:
    """Wavelengths [nm] of the detector's pixels that are judged, shape (W,)."""
    pixels = np.asarray(bench.instrument.wavelength_nm, dtype=np.float64)
    return pixels[(pixels >= low_nm - 1e-6) & (pixels <= high_nm + 1e-6)]


def _merged(data: Mapping[str, Any], other: Mapping[str, Any]) -> dict[str, Any]:
    """Nested tables, the later one winning."""
    merged = dict(data)
    for key, value in other.items():
        known = merged.get(key)
        both = isinstance(known, Mapping) and isinstance(value, Mapping)
        merged[key] = _merged(known, value) if both else value  # type: ignore[arg-type]
    return merged


@dataclass(frozen=True)
class Space:
    """All candidates of a goal, numbered.

    Attributes:
        axes: name and choices of every decision; "part KIND" are parts.
    """

    axes: tuple[tuple[str, tuple[Any, ...]], ...]

    @classmethod
    def of(cls, goal: Goal, parts: Parts) -> Space:
        """The space of a goal.

        Raises:
            InputError: a kind of which no part is allowed.
        """
        usable = parts.allowed(goal.allowed)
        fluorescent = goal.targets.fluorescent
        axes: list[tuple[str, tuple[Any, ...]]] = []
        for kind in (kind for kind in KINDS if kind in NEEDED[fluorescent]):
            own = [part for part in usable.of_kind(kind) if _serves(part, fluorescent)]
            if not own:
                every = [part.name for part in parts.of_kind(kind) if _serves(part, fluorescent)]
                raise InputError(
                    f"no part of the kind {kind}", f"one or more of {', '.join(every)}",
                    place="allowed",
                )  # fmt: skip
            axes.append((f"part {kind}", tuple(part.name for part in own)))
        ranges = goal.protocol
        axes += [("averages", ranges.averages), ("repeats", ranges.repeats)]
        if fluorescent:
            axes.append(("leds", ranges.leds))
        else:
            sets = [s for count in ranges.samples for s in combinations(ranges.thickness_mm, count)]
            axes += [
                ("thickness_mm", tuple(sets)),
                ("acceptance_deg", ranges.acceptance_deg),
                ("polar_deg", ranges.polar_deg),
            ]
        return cls(tuple(axes))

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """Number of choices of every decision."""
        return tuple(len(choices) for _, choices in self.axes)

    @property
    def size(self) -> int:
        """Number of candidates."""
        return int(np.prod(self.shape, dtype=object))

    def at(self, place: Sequence[int]) -> Candidate:
        """The candidate of one choice each."""
        chosen = {name: choices[i] for (name, choices), i in zip(self.axes, place, strict=True)}
        parts = tuple(value for name, value in chosen.items() if name.startswith("part "))
        rest = {name: value for name, value in chosen.items() if not name.startswith("part ")}
        return Candidate(parts, **rest)

    def __iter__(self) -> Iterator[Candidate]:
        """Every candidate, in order."""
        for place in product(*(range(count) for count in self.shape)):
            yield self.at(place)


def _serves(part: DesignPart, fluorescent: bool) -> bool:
    """Whether an illuminant or detector can be used for these materials."""
    if part.kind not in ("illuminant", "detector"):
        return True
    return bool(part.fluorescence if fluorescent else part.bench)
