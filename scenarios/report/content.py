"""What a report shows, as plain arrays: made from a measurement and a result, read by the plots."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.bench import Bench, Sample
from twin.spectra import FloatArray

CAPTURES = ("black", "white", "collimated")
"""Order of the relative intensities (design: bench, captures)."""
CAPTURE_TITLES = {
    "black": "Over black",
    "white": "Over white",
    "collimated": "Collimated beam",
}
PARAMETERS = ("albedo", "sigma_t", "g")
"""Order of the estimated optical properties."""


class Verdict(Enum):
    """What became of a wavelength."""

    GOOD = "good"
    DOUBTFUL = "with a warning"
    MASKED = "masked"
    OUTSIDE = "outside the map"
    FAILED = "no solution"


def sample_label(sample: Sample) -> str:
    """The sample's name with its thickness, once."""
    thickness = f"{sample.thickness_mm:g} mm"
    return sample.name if thickness in sample.name else f"{sample.name}, {thickness}"


@dataclass(frozen=True)
class Counts:
    """Raw counts of one capture of one sample, averaged over its repeats."""

    capture: str
    sample: str
    """Sample name; "" when the capture belongs to the whole visit."""
    counts: FloatArray
    """Mean counts, shape (W,)."""
    repeats: int
    saturated: NDArray[np.bool_]
    """True where a repeat hit the top of the range, shape (W,)."""


@dataclass(frozen=True)
class Intensities:
    """Relative intensities of S samples at W wavelengths, in the order of CAPTURES."""

    value: FloatArray
    """Shape (S, 3, W)."""
    covariance: FloatArray
    """Shape (W, 3 S, 3 S), index 3 s + c; NaN where not valid."""
    valid: NDArray[np.bool_]
    """Shape (S, 3, W)."""
    reasons: tuple[str, ...]
    """What was masked and why, counted."""

    @property
    def sd(self) -> FloatArray:
        """Standard deviations, shape (S, 3, W)."""
        variance = np.diagonal(self.covariance, axis1=1, axis2=2).T
        return np.asarray(np.sqrt(variance).reshape(self.value.shape))


@dataclass(frozen=True)
class Properties:
    """Optical properties at W wavelengths: albedo, sigma_t [1/mm], g in the order of PARAMETERS."""

    value: FloatArray
    """Shape (3, W); NaN where there is none."""
    sd: FloatArray | None = None
    """Standard deviations, shape (3, W)."""
    low: FloatArray | None = None
    """Lower end of the 90 % interval, shape (3, W)."""
    high: FloatArray | None = None
    """Upper end of the 90 % interval, shape (3, W)."""


@dataclass(frozen=True)
class StatusCount:
    """How often a status occurred, and what it means."""

    name: str
    verdict: Verdict
    text: str
    count: int


@dataclass(frozen=True)
class Content:
    """All that one report shows. W wavelengths, S samples; None where a thing is not there."""

    bench: Bench
    samples: tuple[Sample, ...]
    wavelength_nm: FloatArray
    """Shape (W,), increasing."""
    counts: tuple[Counts, ...]
    saturation_counts: float | None
    relative: Intensities
    estimate: Properties
    identifiable: NDArray[np.bool_]
    """Whether the captures determine the parameter, shape (3, W)."""
    each: tuple[Properties, ...]
    """One per sample (thickness alone); empty when not available."""
    verdicts: tuple[Verdict, ...]
    """One per wavelength."""
    statuses: tuple[StatusCount, ...]
    method: str
    truth: Properties | None = None
    truth_intensities: FloatArray | None = None
    """Noiseless relative intensities, shape (S, 3, W)."""
    predicted: FloatArray | None = None
    """Relative intensities that the estimate predicts, shape (S, 3, W)."""
    residual: FloatArray | None = None
    """Whitened residuals, shape (S, 3, W); NaN where masked."""
    beer_per_mm: FloatArray | None = None
    """sigma_t from Beer's law [1/mm], shape (S, W)."""
    rho_black: FloatArray | None = None
    """Reflectance of the black background as described, shape (W,)."""
    rho_black_measured: FloatArray | None = None
    """The same from the black references, shape (W,)."""
    rho_white: FloatArray | None = None
    """Reflectance of the white background, shape (W,)."""
    lamp_panels: FloatArray | None = None
    """Relative spectral power of the panels, shape (W,)."""
    lamp_beam: FloatArray | None = None
    """Relative spectral power of the beam, shape (W,)."""
    fingerprint: str = ""
    """SHA-256 of the measurement."""
    result_fingerprint: str = ""
    """SHA-256 of what went into the estimate."""
    seed: str = ""
    origin: str = ""
    """Where the measurement comes from, in words."""
    software: str = ""
    """What made the measurement, with its version."""
    scenario: str = ""
    """The scenario of a simulated visit, as text (JSON)."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """The estimator's settings."""
    notes: tuple[str, ...] = ()
    """Things the reader should know, in sentences."""

    @property
    def few(self) -> bool:
        """Whether points should be drawn one by one."""
        return self.wavelength_nm.size <= 24

    @property
    def broad(self) -> bool:
        """Whether what stands for a wavelength is a broad channel of a multispectral chip."""
        return self.bench.instrument.kind == "chip"

    @property
    def has_g(self) -> bool:
        """Whether g was estimated (three captures) rather than assumed or absent."""
        return bool(np.isfinite(self.estimate.value[2]).any())

    def where(self, verdict: Verdict) -> NDArray[np.bool_]:
        """The wavelengths with a verdict, shape (W,)."""
        return np.array([found is verdict for found in self.verdicts], dtype=bool)
