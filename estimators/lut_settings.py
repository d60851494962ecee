"""Options of the look-up-table estimator."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from typing import Literal

from estimators.draws import FEWEST
from twin.errors import InputError


@dataclass(frozen=True)
class LutSettings:
    """Options of the look-up-table estimator."""

    draws: int = 500
    """Random samples of the neighbourhood; 0 for plain interpolation without uncertainty."""
    neighbourhood: Literal["covariance", "epsilon"] = "covariance"
    """Gaussian by the captures' covariance and the map's errors, or the seed's uniform box."""
    epsilon: float = 0.02
    """Half-width of the box: absolute in I_black and I_white, relative in I_collimated."""
    combine: Literal["weighted", "pool"] = "weighted"
    """Samples weighted by their covariances, or pooled as the seed does."""
    fixed_g: float | None = None
    """Look (I_black, I_white) up at this g; the collimated capture is not used."""
    seed: int = 0
    unidentifiable_share: float = 0.5
    """A 90 % interval wider than this share of the map's range says nothing (sigma_t: ln)."""
    minimum_inside: float = 0.05
    """Least share of draws inside the map that still make an estimate."""
    lost_sigma: float = 3.0
    """Collimated light below so many standard deviations counts as lost in noise; captures that
    contradict each other by more count as contradictory."""
    threads: int = 0
    """Threads of the look-up; 0: one per core. The result does not depend on it."""

    def __post_init__(self) -> None:
        """Reject what cannot be meant.

        Raises:
            InputError: an option out of its range.
        """
        if self.draws != 0 and self.draws < 2 * FEWEST:
            raise InputError(f"{self.draws}", f"0 or at least {2 * FEWEST}", place="draws")
        if not 0.0 < self.epsilon < 1.0:
            raise InputError(f"{self.epsilon:g}", "a number above 0 and below 1", place="epsilon")
        if self.neighbourhood not in ("covariance", "epsilon"):
            raise InputError(
                f'"{self.neighbourhood}"', '"covariance" or "epsilon"', place="neighbourhood"
            )
        if self.combine not in ("weighted", "pool"):
            raise InputError(f'"{self.combine}"', '"weighted" or "pool"', place="combine")
        if not 0 <= self.seed < 2**64:
            raise InputError(f"{self.seed}", "a number from 0 to 2^64 - 1", place="seed")

    @property
    def cores(self) -> int:
        """Threads to use."""
        return self.threads or os.cpu_count() or 1

    @classmethod
    def of_the_seed(cls, **changes: object) -> LutSettings:
        """The published choices: a uniform box of 0.02, 500 samples, pooled, the median."""
        published = cls(neighbourhood="epsilon", epsilon=0.02, combine="pool")
        return replace(published, **changes)  # type: ignore[arg-type]
