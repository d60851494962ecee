"""Options of the posterior estimator: priors, nuisances and how long to sample."""

from __future__ import annotations

from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import TYPE_CHECKING

from twin.errors import InputError

if TYPE_CHECKING:
    from estimators.protocol import BenchModel

SHARES = MappingProxyType(
    {
        "thickness_relative": "thicknesses",
        "n_sigma": "refractive index",
        "rho_black_relative": "black reflectance",
        "rho_white_relative": "white reflectance",
        "acceptance_relative": "acceptance",
        "panel_drift": "level of the panels",
        "beam_drift": "level of the beam",
    }
)
"""Options that state the standard deviation of a nuisance, and what a person calls it."""


@dataclass(frozen=True)
class PosteriorSettings:
    """Options of the posterior estimator.

    Priors: albedo uniform from 0 to 1, ln sigma_t uniform, g uniform, each independent of the
    others. A nuisance has a normal prior around what the bench description says; one whose
    standard deviation is 0 is taken as exact, and the result says so.
    """

    sigma_t_low_per_mm: float = 0.01
    """Lower end of the prior of sigma_t [1/mm]."""
    sigma_t_high_per_mm: float = 100.0
    """Upper end of the prior of sigma_t [1/mm]."""
    g_low: float = -0.2
    g_high: float = 0.99
    thickness_relative: float = 0.0
    """Relative standard deviation of every sample's thickness, independent between samples."""
    n_sigma: float = 0.0
    """Standard deviation of the sample's refractive index, common to all wavelengths."""
    rho_black_relative: float = 0.0
    """Relative standard deviation of the black reflectance, common to all wavelengths."""
    rho_white_relative: float = 0.0
    """Relative standard deviation of the white reflectance, common to all wavelengths."""
    acceptance_relative: float = 0.0
    """Relative standard deviation of the detector's half-angle of acceptance."""
    panel_drift: float = 0.0
    """Relative standard deviation of a scale common to all panel captures."""
    beam_drift: float = 0.0
    """Relative standard deviation of a scale common to all collimated captures."""
    engine_error: bool = True
    """Count the fast engine's own error as an error of every capture."""
    sample_nuisances: bool = False
    """Sample nuisances as parameters of their own, with derivatives at every draw, in place of
    integrating them out in closed form with the derivatives at the most probable material."""
    joint: bool = False
    """Smooth spectra through knots in place of every wavelength for itself."""
    knots: int = 7
    """Knots per parameter over the wavelength range of joint spectra."""
    walkers: int = 32
    effective_samples: int = 1000
    """Effective sample size to reach at every wavelength."""
    steps: int = 6000
    """Most steps of the ensemble; a chain that needs more is called not converged."""
    draws: int = 1000
    """Draws that the result keeps."""
    emulator_tolerance: float = 0.05
    """Largest error of the emulated captures in their standard deviations."""
    unidentifiable_share: float = 0.5
    """A 90 % interval wider than this share of the prior range says nothing (sigma_t: ln)."""
    lost_sigma: float = 3.0
    """Collimated light below so many standard deviations counts as lost in noise; captures that
    contradict each other by more count as contradictory."""
    seed: int = 0

    def __post_init__(self) -> None:
        """Reject what cannot be meant.

        Raises:
            InputError: an option out of its range.
        """
        low, high = self.sigma_t_low_per_mm, self.sigma_t_high_per_mm
        _need(0.0 < low < high < float("inf"), f"{low:g} to {high:g}", "0 < low < high", "sigma_t")
        _need(
            -1.0 < self.g_low < self.g_high < 1.0,
            f"{self.g_low:g} to {self.g_high:g}",
            "-1 < low < high < 1",
            "g",
        )
        for name in SHARES:
            value = getattr(self, name)
            _need(0.0 <= value <= 0.5, f"{value:g}", "a standard deviation from 0 to 0.5", name)
        whole = {"walkers": 20, "effective_samples": 50, "steps": 100, "draws": 20, "knots": 3}
        for name, least in whole.items():
            value = getattr(self, name)
            _need(value >= least, f"{value}", f"a whole number of at least {least}", name)
        _need(self.walkers % 2 == 0, f"{self.walkers}", "an even number", "walkers")
        for name in ("emulator_tolerance", "unidentifiable_share", "lost_sigma"):
            value = getattr(self, name)
            _need(value > 0.0, f"{value:g}", "a number above 0", name)
        _need(0 <= self.seed < 2**64, f"{self.seed}", "a number from 0 to 2^64 - 1", "seed")
        _need(
            not (self.joint and self.sample_nuisances),
            "both joint and sample_nuisances",
            "one of them: joint spectra integrate the shared nuisances out",
            "sample_nuisances",
        )

    def check(self, model: BenchModel) -> None:
        """Make sure that the bench lets the nuisances vary.

        Raises:
            InputError: the refractive index is uncertain and exactly 1, where the critical angle
                appears and no derivative exists.
        """
        if self.n_sigma > 0.0 and (model.n == 1.0).any():
            raise InputError(
                f"{self.n_sigma:g} with a refractive index of exactly 1",
                "0 for samples of index 1",
                place="n_sigma",
            )

    def stated(self) -> tuple[str, ...]:
        """Names of the nuisances with a standard deviation above 0."""
        return tuple(name for name in SHARES if getattr(self, name) > 0.0)

    def as_plain(self) -> dict[str, str | int | float]:
        """Every option by name, as a result stores it."""
        plain: dict[str, str | int | float] = {}
        for field in fields(self):
            value = getattr(self, field.name)
            plain[field.name] = str(value).lower() if isinstance(value, bool) else value
        return plain


def _need(fine: bool, found: str, expected: str, place: str) -> None:
    if not fine:
        raise InputError(found, expected, place=place)
