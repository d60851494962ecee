"""One visit to the fluorescence bench: raw counts under every illuminant."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.fluorescence.donaldson import DonaldsonMatrix
from twin.fluorescence.setup import FluorescenceSetup
from twin.measurement import Provenance
from twin.spectra import FloatArray

Kind = Literal["dark", "white", "sample"]
KINDS: tuple[str, ...] = get_args(Kind)
"""What a shot can be of."""


@dataclass(frozen=True, slots=True)
class FluorescenceShot:
    """One reading: what lay on the bench, which light was on, and the settings."""

    kind: str
    """One of `KINDS`."""
    integration_s: float
    """Integration time [s] of one exposure."""
    illuminant: str = ""
    """Name of the illuminant; "" for a dark."""
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
        """Integration time times gain [s]."""
        return self.integration_s * self.gain

    @property
    def label(self) -> str:
        """The shot as messages call it."""
        return f"{self.kind} under {self.illuminant!r}" if self.illuminant else self.kind


@dataclass(frozen=True, eq=False)
class FluorescenceVisit:
    """Raw counts of dark, white and one sample under every illuminant; kept for ever.

    Attributes:
        setup: the bench.
        shots: N of them, in the order in which they were taken.
        counts: mean over the exposures of each shot, shape (N, K); NaN is a dead channel.
        saturated: True where an exposure hit the top of the range, shape (N, K).
        sample: name of the sample.
        provenance: where it comes from; `noise` "instrument" or "repeats" says what the
            uncertainty of the counts is taken from.
        truth: of a simulated visit, the matrix that was simulated.

    Raises:
        InputError: shapes, names or numbers that cannot be.
    """

    setup: FluorescenceSetup
    shots: tuple[FluorescenceShot, ...]
    counts: FloatArray
    saturated: NDArray[np.bool_]
    sample: str = "sample"
    provenance: Provenance = field(default_factory=Provenance)
    truth: DonaldsonMatrix | None = None

    def __post_init__(self) -> None:
        shape = (len(self.shots), len(self.setup.detector.wavelength_nm))
        counts = np.array(self.counts, dtype=np.float64)
        saturated = np.array(self.saturated, dtype=bool)
        for name, array in (("counts", counts), ("saturated", saturated)):
            if array.shape != shape:
                raise InputError(
                    f"{name} of shape {array.shape}",
                    f"{shape[0]} shots of {shape[1]} channels", place=name,
                )  # fmt: skip
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        if np.any(np.isinf(counts)):
            raise InputError(
                "infinite counts", "numbers, or NaN for a dead channel", place="counts"
            )
        if not self.sample:
            raise InputError("a sample without a name", "a name", place="sample")
        known = self.setup.illuminant_names
        seen: set[tuple[str, str, int, float, float]] = set()
        for index, shot in enumerate(self.shots):
            place = f"shot {index}"
            if shot.kind not in KINDS:
                raise InputError(
                    f"a shot of {shot.kind!r}", f"one of {', '.join(KINDS)}", place=place
                )
            if (shot.kind == "dark") != (shot.illuminant == ""):
                raise InputError(
                    shot.label, "a dark without an illuminant, all else with one", place=place
                )
            if shot.illuminant and shot.illuminant not in known:
                raise InputError(
                    f"the illuminant {shot.illuminant!r}", f"one of {', '.join(known)}", place=place
                )
            good = all(np.isfinite(v) and v > 0 for v in (shot.integration_s, shot.gain))
            if not good or shot.averages < 1 or shot.repeat < 0 or not np.isfinite(shot.time_s):
                raise InputError(
                    f"{shot.label}: {shot.integration_s:g} s, gain {shot.gain:g},"
                    f" {shot.averages} averages, repeat {shot.repeat}",
                    "an integration time and gain above 0, 1 average or more, repeats 0, 1, 2 ...",
                    place=place,
                )
            key = (shot.kind, shot.illuminant, shot.repeat, shot.integration_s, shot.gain)
            if key in seen:
                raise InputError(
                    f"{shot.label}, repeat {shot.repeat} a second time",
                    "every reading once, repeats numbered 0, 1, 2 ...", place=place,
                )  # fmt: skip
            seen.add(key)

    @cached_property
    def fingerprint(self) -> str:
        """SHA-256 of everything in it, hexadecimal: equal for equal visits."""
        digest = hashlib.sha256()
        truth = self.truth
        arrays = [self.counts, self.saturated]
        if truth is not None:
            arrays += [truth.matrix, truth.emission_nm, truth.excitation_nm]
        for array in arrays:
            digest.update(f"{array.dtype}{array.shape}".encode())
            digest.update(np.ascontiguousarray(array).tobytes())
        head = [
            self.setup.model_dump(mode="json"), repr(self.shots), self.sample,
            self.provenance.model_dump(mode="json"),
            [truth.name, truth.source, truth.notes] if truth is not None else None,
        ]  # fmt: skip
        digest.update(json.dumps(head, sort_keys=True).encode())
        return digest.hexdigest()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, FluorescenceVisit) and self.fingerprint == other.fingerprint

    def __hash__(self) -> int:
        return hash(self.fingerprint)
