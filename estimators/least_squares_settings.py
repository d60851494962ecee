"""Options of the least-squares estimator."""

from __future__ import annotations

import os
from dataclasses import dataclass

from twin.errors import InputError


@dataclass(frozen=True)
class LeastSquaresSettings:
    """Options of the least-squares estimator."""

    joint: bool = False
    """Fit all wavelengths together, as smooth spectra: `estimators.least_squares_joint`."""
    smoothness_nm: float = 0.0
    """Length [nm] over which a coordinate (ln sigma_s, ln sigma_a, logit of g) may bend by about
    one unit: the prior of the joint mode, which a number above 0 turns on. 0: the joint mode finds
    a length for each coordinate in the captures."""
    starts: int = 3
    """At most so many starts for every wavelength; the lowest chi-square wins."""
    steps: int = 40
    """Most Levenberg-Marquardt steps of one start."""
    g_range: tuple[float, float] = (-1.0, 1.0)
    """Open interval in which g is sought."""
    sigma_t_range_per_mm: tuple[float, float] = (1e-3, 1e3)
    """An extinction coefficient [1/mm] outside counts as at its bound."""
    unidentifiable_share: float = 0.5
    """A 90 % interval wider than this share of the range says nothing: of 1 for albedo, of
    `g_range` for g, of two decades for sigma_t."""
    lost_sigma: float = 3.0
    """Collimated light below so many standard deviations counts as lost in noise."""
    contradictory_sigma: float = 4.0
    """Captures that contradict each other by more standard deviations are not used."""
    inconsistent_probability: float = 1e-3
    """A chi-square less probable than this widens the interval by the Birge ratio."""
    threads: int = 0
    """Threads; 0: one per core. The result does not depend on it."""

    def __post_init__(self) -> None:
        """Reject what cannot be meant.

        Raises:
            InputError: an option out of its range.
        """
        low, high = (float(bound) for bound in self.g_range)
        if not -1.0 <= low < high <= 1.0:
            raise InputError(
                f"{self.g_range}", "two increasing numbers in -1 to 1", place="g_range"
            )
        object.__setattr__(self, "g_range", (low, high))
        low, high = (float(bound) for bound in self.sigma_t_range_per_mm)
        if not 0.0 < low < high < float("inf"):
            raise InputError(
                f"{self.sigma_t_range_per_mm}",
                "two increasing numbers above 0",
                place="sigma_t_range_per_mm",
            )
        object.__setattr__(self, "sigma_t_range_per_mm", (low, high))
        for name, least in (("starts", 1), ("steps", 2), ("threads", 0)):
            if getattr(self, name) < least:
                raise InputError(f"{getattr(self, name)}", f"{least} or more", place=name)
        if not 0.0 <= self.smoothness_nm < float("inf"):
            raise InputError(f"{self.smoothness_nm:g}", "0 nm or more", place="smoothness_nm")
        for name in ("unidentifiable_share", "inconsistent_probability"):
            if not 0.0 < getattr(self, name) < 1.0:
                raise InputError(
                    f"{getattr(self, name):g}", "a number above 0 and below 1", place=name
                )
        for name in ("lost_sigma", "contradictory_sigma"):
            if not 0.0 < getattr(self, name) < float("inf"):
                raise InputError(f"{getattr(self, name):g}", "a number above 0", place=name)

    @property
    def together(self) -> bool:
        """Whether all wavelengths are fitted together."""
        return self.joint or self.smoothness_nm > 0.0

    @property
    def cores(self) -> int:
        """Threads to use."""
        return self.threads or os.cpu_count() or 1
