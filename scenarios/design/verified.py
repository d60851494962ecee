"""What simulated visits say of a candidate: actual errors beside the predicted ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from scenarios.design.candidate import Candidate
from twin.spectra import FloatArray

PARAMETERS = ("albedo", "sigma_t_per_mm", "g")
AGREES = (0.85, 1.15)
"""Ratios of actual to predicted errors within which both agree."""
CLEAR = 2.0
"""Standard errors beyond which a simulated figure is above its target."""


def meets(value: float, error: float, target: float) -> str:
    """Whether a simulated figure meets its target: "yes", "no", or "open", above but not clearly.

    Args:
        value: the figure, in the target's unit.
        error: its standard error.
        target: the largest that is good enough.
    """
    if value <= target:
        return "yes"
    return "no" if value - CLEAR * error > target else "open"


@dataclass(frozen=True, eq=False)
class Verified:
    """One candidate, simulated: M materials, V visits, W wavelengths.

    Attributes:
        candidate: what was simulated.
        predicted: standard uncertainty, the Monte Carlo's own error included, (M, W, 3).
        error: estimate minus truth, (M, V, W, 3); NaN where there is no estimate.
        width: standard uncertainty that the estimate states, (M, V, W, 3).
        failure: why there is nothing, or "".
        own: predicted error for a bench of light instead of paths, (M, W, 3).
        bands: predicted error by the width of a chip's bands, which an estimate does not state,
            (M, W, 3); None: none.
        figures: simulated figures by target with their standard errors, the Monte Carlo's share
            taken out; none of "de2000".
    """

    candidate: Candidate
    predicted: FloatArray
    error: FloatArray
    width: FloatArray
    failure: str = ""
    own: FloatArray | None = None
    bands: FloatArray | None = None
    figures: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def expected(self) -> FloatArray:
        """Predicted error: standard uncertainty and what the bands do, (M, W, 3)."""
        return self.predicted if self.bands is None else np.hypot(self.predicted, self.bands)

    @property
    def ratio_error(self) -> FloatArray:
        """Standard error of `ratio`: jackknife over visits and over wavelengths, added, (3,).

        Visits share nothing but the Monte Carlo's light and maps; the lamps' drift and the errors
        of parts are common to the wavelengths of one visit.
        """
        square = (self.error / self.expected[:, None]) ** 2
        total = np.zeros(3)
        for axis in (1, 2):
            count = square.shape[axis]
            each = np.nanmean(square, axis=tuple(k for k in (0, 1, 2) if k != axis))
            total += np.nanvar(each, axis=0, ddof=1) / max(count, 1) if count > 1 else 0.0
        return np.asarray(np.sqrt(total) / (2.0 * self.ratio))

    @property
    def actual(self) -> FloatArray:
        """Actual errors without the Monte Carlo's share, root mean square, (3,).

        What is predicted for the bench itself, times `ratio`.
        """
        own = self.expected if self.own is None else self.own
        return np.asarray(self.ratio * np.sqrt(np.nanmean(own**2, axis=(0, 1))))

    @property
    def ratio(self) -> FloatArray:
        """Root mean square of actual errors in predicted ones, (3,)."""
        pull = self.error / self.expected[:, None]
        return np.asarray(np.sqrt(np.nanmean(pull**2, axis=(0, 1, 2))))

    @property
    def bias(self) -> FloatArray:
        """What of the ratio all visits share, root mean square over materials and wavelengths."""
        mean = np.nanmean(self.error, axis=1) / self.expected
        return np.asarray(np.sqrt(np.nanmean(mean**2, axis=(0, 1))))

    @property
    def width_ratio(self) -> FloatArray:
        """Median of stated over predicted uncertainty, (3,)."""
        return np.asarray(np.nanmedian(self.width / self.predicted[:, None], axis=(0, 1, 2)))

    @property
    def agrees(self) -> bool:
        """Whether actual errors are the predicted ones, within `AGREES`, of every parameter."""
        return bool(np.all((self.ratio >= AGREES[0]) & (self.ratio <= AGREES[1])))

    def figure(self, column: int, scale: FloatArray) -> tuple[float, float]:
        """Actual error as targets count it, of the worst material, and its standard error.

        Root mean square over visits and wavelengths, the Monte Carlo's share taken out.

        Args:
            column: of the parameter, as in `PARAMETERS`.
            scale: what errors are relative to, (M, W).
        """
        own = self.expected if self.own is None else self.own
        real = self.error * (own / self.expected)[:, None]
        by_visit = np.nanmean((real[..., column] / scale[:, None]) ** 2, axis=-1)
        mean = np.nanmean(by_visit, axis=-1)
        worst = int(np.argmax(mean))
        value = float(np.sqrt(mean[worst]))
        spread = np.nanstd(by_visit[worst], ddof=1) / np.sqrt(by_visit.shape[1])
        return value, float(spread / (2.0 * value))
