"""One visit to the bench as one immutable object: raw counts, or relative intensities."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from twin.bench import Bench, Sample
from twin.errors import InputError
from twin.spectra import FloatArray, Part

BoolArray = NDArray[np.bool_]

SampleCapture = Literal["black", "white", "collimated"]
ReferenceCapture = Literal["dark", "white_reference", "black_reference", "beam_reference"]
SAMPLE_CAPTURES: tuple[str, ...] = get_args(SampleCapture)
"""Captures with a sample, in the order of every array with a capture axis."""
REFERENCE_CAPTURES: tuple[str, ...] = get_args(ReferenceCapture)
"""Captures without a sample, or in which the sample does not matter."""
CAPTURES: tuple[str, ...] = (*REFERENCE_CAPTURES, *SAMPLE_CAPTURES)

WAVELENGTH_RANGE_NM = (150.0, 5000.0)
"""Wavelengths [nm] outside which a unit has been mistaken."""


@dataclass(frozen=True, slots=True)
class Shot:
    """One reading of the instrument: what was on the bench, and the settings."""

    capture: str
    """One of `CAPTURES`."""
    integration_s: float
    """Integration time [s] of one exposure."""
    sample: str = ""
    """Name of the sample; "" for a reference or dark that serves the whole visit."""
    repeat: int = 0
    """0, 1, 2 ... for readings of the same thing."""
    averages: int = 1
    """Exposures averaged into the counts."""
    time_s: float = 0.0
    """Start [s] since the beginning of the visit."""
    gain: float = 1.0
    """Amplification; counts are proportional to integration_s * gain."""

    @property
    def exposure(self) -> float:
        """Integration time times gain [s]: what the counts are proportional to."""
        return self.integration_s * self.gain


@dataclass(frozen=True, eq=False)
class Captures:
    """Raw counts of a visit.

    Attributes:
        shots: N of them.
        wavelength_nm: wavelengths [nm] of the pixels or channels, increasing, shape (W,).
        counts: counts averaged over each shot's exposures, shape (N, W); NaN is a dead pixel.
        saturated: True where an exposure hit the top of the range, shape (N, W).
        light_se: of a simulated visit, the Monte Carlo's own standard error of the relative
            intensities (black, white, collimated) of each sample, shape (S, 3, W); it is the same
            in every repeat, so repeats cannot show it. None for a real visit.

    Raises:
        InputError: shapes, names or numbers that cannot be.
    """

    shots: tuple[Shot, ...]
    wavelength_nm: FloatArray
    counts: FloatArray
    saturated: BoolArray
    light_se: FloatArray | None = None

    def __post_init__(self) -> None:
        wavelength = _wavelengths(self.wavelength_nm)
        if self.light_se is not None:
            error = np.asarray(self.light_se, dtype=np.float64)
            expected = (len(error), len(SAMPLE_CAPTURES), wavelength.size)
            error = _shaped("light_se", error, expected)
            if not np.all(error >= 0.0):
                raise InputError("light_se below 0 or no number", "standard errors of 0 or more")
            _set(self, "light_se", error)
        shape = (len(self.shots), wavelength.size)
        _set(self, "wavelength_nm", wavelength)
        _set(self, "counts", _shaped("counts", self.counts, shape))
        saturated = np.array(self.saturated, dtype=bool)
        if saturated.shape != shape:
            raise InputError(f"saturated of shape {saturated.shape}", f"shape {shape}")
        _set(self, "saturated", saturated)
        seen: set[tuple[str, str, int, float, float]] = set()
        for index, shot in enumerate(self.shots):
            check_shot(shot, f"shot {index}")
            key = (shot.capture, shot.sample, shot.repeat, shot.integration_s, shot.gain)
            if key in seen:
                raise InputError(
                    f"{label(shot.capture, shot.sample)}, repeat {shot.repeat} a second time",
                    "every reading once, repeats numbered 0, 1, 2 ...",
                    place=f"shot {index}",
                )
            seen.add(key)


@dataclass(frozen=True, slots=True)
class RelativeRow:
    """Which spectrum one row of relative intensities is."""

    sample: str
    capture: str
    """One of `SAMPLE_CAPTURES`."""
    repeat: int = 0


@dataclass(frozen=True, eq=False)
class RelativeSpectra:
    """Relative intensities that came ready-made.

    Attributes:
        rows: N of them.
        wavelength_nm: wavelengths [nm], increasing, shape (W,).
        value: relative intensities, shape (N, W); NaN is a missing value.
        sigma: their standard errors, shape (N, W); NaN where unknown.

    Raises:
        InputError: shapes, names or numbers that cannot be.
    """

    rows: tuple[RelativeRow, ...]
    wavelength_nm: FloatArray
    value: FloatArray
    sigma: FloatArray

    def __post_init__(self) -> None:
        wavelength = _wavelengths(self.wavelength_nm)
        shape = (len(self.rows), wavelength.size)
        _set(self, "wavelength_nm", wavelength)
        _set(self, "value", _shaped("value", self.value, shape))
        sigma = _shaped("sigma", self.sigma, shape)
        if np.any(sigma <= 0):
            raise InputError(f"sigma {sigma[sigma <= 0][0]:g}", "standard errors above 0")
        _set(self, "sigma", sigma)
        for index, row in enumerate(self.rows):
            if row.capture not in SAMPLE_CAPTURES:
                raise InputError(
                    f"capture {row.capture!r}", f"one of {names(SAMPLE_CAPTURES)}", place=f"{index}"
                )
            if not row.sample or row.repeat < 0:
                raise InputError(
                    f"sample {row.sample!r}, repeat {row.repeat}",
                    "the name of a sample and a repeat of 0 or more",
                    place=f"row {index}",
                )
        if len(set(self.rows)) != len(self.rows):
            raise InputError("a spectrum twice", "every sample, capture and repeat once")


@dataclass(frozen=True, eq=False)
class Truth:
    """The true properties of simulated samples, in the order of the measurement's samples.

    Attributes:
        wavelength_nm: wavelengths [nm], increasing, shape (T,); need not be the instrument's.
        albedo: single-scattering albedo, shape (S, T).
        sigma_t_per_mm: extinction coefficient [1/mm], shape (S, T).
        g: anisotropy factor, shape (S, T).

    Raises:
        InputError: shapes or numbers that cannot be.
    """

    wavelength_nm: FloatArray
    albedo: FloatArray
    sigma_t_per_mm: FloatArray
    g: FloatArray

    def __post_init__(self) -> None:
        wavelength = _wavelengths(self.wavelength_nm)
        _set(self, "wavelength_nm", wavelength)
        shape = (len(self.albedo), wavelength.size)
        bounds = {"albedo": (0.0, 1.0), "sigma_t_per_mm": (0.0, np.inf), "g": (-1.0, 1.0)}
        for name, (low, high) in bounds.items():
            value = _shaped(name, getattr(self, name), shape)
            if not np.all((value >= low) & (value <= high)):
                raise InputError(f"{name} outside {low:g} to {high:g}", "a physical value")
            _set(self, name, value)


class Provenance(Part):
    """Where a measurement comes from."""

    origin: Literal["simulated", "measured", "handmade"] = "measured"
    seed: int | None = None
    """Seed of a simulated visit."""
    serial_numbers: tuple[str, ...] = ()
    """Serial numbers of the instruments of a real visit."""
    software: str = ""
    """Name and version of the program that made it."""
    scenario: str = ""
    """The resolved scenario, as text."""
    noise: Literal["instrument", "repeats"] = "instrument"
    """What the uncertainty of counts is taken from: the described instrument, or the scatter of
    repeats when nobody described the instrument."""
    notes: tuple[str, ...] = ()
    """What a reader assumed or left out; shown with every result."""


@dataclass(frozen=True, eq=False)
class Measurement:
    """One visit to the bench: all captures of all samples, real, simulated or made by hand.

    Exactly one of `captures` (raw counts, kept for ever) and `relative` is there.

    Raises:
        InputError: both or neither of them, or a sample that is unknown or named twice.
    """

    bench: Bench
    samples: tuple[Sample, ...]
    captures: Captures | None = None
    relative: RelativeSpectra | None = None
    provenance: Provenance = field(default_factory=Provenance)
    truth: Truth | None = None

    def __post_init__(self) -> None:
        if (self.captures is None) == (self.relative is None):
            found = "both" if self.captures is not None else "neither"
            raise InputError(found, "either captures (counts) or relative intensities")
        known = [sample.name for sample in self.samples]
        if not known:
            raise InputError("no sample", "one sample or more")
        for name in known:
            if known.count(name) > 1:
                raise InputError(f"two samples named {name!r}", "every name once")
        used = self.captures.shots if self.captures is not None else self._relative_rows
        for item in used:
            if item.sample and item.sample not in known:
                raise InputError(
                    f"sample {item.sample!r}", f"one of {names(known)}", place=item.capture
                )
        light_se = self.captures.light_se if self.captures is not None else None
        if light_se is not None and len(light_se) != len(known):
            raise InputError(f"light_se of {len(light_se)} samples", f"that of all {len(known)}")
        if self.truth is not None and len(self.truth.albedo) != len(known):
            raise InputError(
                f"the truth of {len(self.truth.albedo)} samples", f"that of all {len(known)}"
            )

    @property
    def _relative_rows(self) -> tuple[RelativeRow, ...]:
        return self.relative.rows if self.relative is not None else ()

    @property
    def wavelength_nm(self) -> FloatArray:
        """Wavelengths [nm] of the data, shape (W,)."""
        data = self.captures if self.captures is not None else self.relative
        return data.wavelength_nm if data is not None else np.empty(0)

    @cached_property
    def fingerprint(self) -> str:
        """SHA-256 of everything in it, hexadecimal: equal for equal measurements."""
        digest = hashlib.sha256()
        for part in (self.captures, self.relative, self.truth):
            digest.update(type(part).__name__.encode())
            for name, value in sorted(vars(part).items()) if part is not None else ():
                if isinstance(value, np.ndarray):
                    digest.update(f"{name}{value.dtype}{value.shape}".encode())
                    digest.update(np.ascontiguousarray(value).tobytes())
                else:
                    digest.update(repr(value).encode())
        head: list[Any] = [self.bench.model_dump(mode="json")]
        head += [sample.model_dump(mode="json") for sample in self.samples]
        head.append(self.provenance.model_dump(mode="json"))
        digest.update(json.dumps(head, sort_keys=True).encode())
        return digest.hexdigest()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Measurement) and self.fingerprint == other.fingerprint

    def __hash__(self) -> int:
        return hash(self.fingerprint)


def names(items: tuple[str, ...] | list[str]) -> str:
    """Names as a person lists them."""
    return ", ".join(items)


def label(capture: str, sample: str) -> str:
    """A capture as messages call it."""
    return f"{capture} of {sample!r}" if sample else f"{capture} of the visit"


def check_shot(shot: Shot, place: str) -> None:
    """Raise InputError unless a shot's names and numbers can be."""
    if shot.capture not in CAPTURES:
        raise InputError(f"capture {shot.capture!r}", f"one of {names(CAPTURES)}", place=place)
    if shot.capture in SAMPLE_CAPTURES and not shot.sample:
        raise InputError(
            f"capture {shot.capture!r} without a sample", "the name of its sample", place=place
        )
    bad: list[tuple[str, float, str]] = []
    for name in ("integration_s", "gain"):
        value = getattr(shot, name)
        if not (np.isfinite(value) and value > 0):
            bad.append((name, value, "a number above 0"))
    if shot.averages < 1:
        bad.append(("averages", shot.averages, "a whole number of 1 or more"))
    if shot.repeat < 0:
        bad.append(("repeat", shot.repeat, "a whole number of 0 or more"))
    if not np.isfinite(shot.time_s):
        bad.append(("time_s", shot.time_s, "a number"))
    for name, value, expected in bad:
        raise InputError(f"{name} {value:g}", expected, place=place)


def _wavelengths(value: FloatArray) -> FloatArray:
    wavelength = np.array(value, dtype=np.float64)
    if wavelength.ndim != 1 or wavelength.size == 0:
        raise InputError(f"wavelengths of shape {wavelength.shape}", "one or more in a row")
    if not np.all(np.isfinite(wavelength)):
        raise InputError("a wavelength that is not a number", "numbers [nm]")
    low, high = WAVELENGTH_RANGE_NM
    outside = (wavelength < low) | (wavelength > high)
    if np.any(outside):
        raise InputError(
            f"a wavelength of {wavelength[outside][0]:g} nm", f"{low:g} to {high:g} nm (nanometres)"
        )
    falls = np.diff(wavelength) <= 0
    if np.any(falls):
        index = int(np.argmax(falls))
        raise InputError(
            f"{wavelength[index + 1]:g} nm after {wavelength[index]:g} nm",
            "wavelengths that increase",
        )
    return wavelength


def _shaped(name: str, value: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    array = np.array(value, dtype=np.float64)
    if array.shape != shape:
        raise InputError(f"{name} of shape {array.shape}", f"shape {shape}")
    return array


def _set(target: object, name: str, array: NDArray[Any]) -> None:
    """Put a private, read-only array into a frozen dataclass."""
    array.flags.writeable = False
    object.__setattr__(target, name, array)
