"""Uncertainty budget of a least-squares estimate in the terms of the GUM: what to improve first.

Every input has a stated standard uncertainty (`InputUncertainty`); its share of the variance of
albedo, sigma_t and g follows by linear propagation, and `monte_carlo=True` checks the sum by
drawing all inputs and estimating again. Sources: JCGM 100:2008 (GUM), 5.1; JCGM 101:2008
(Supplement 1), 7.
"""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from estimators.result import PARAMETERS
from twin.errors import InputError
from twin.measurement.relative import RelativeIntensities
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from estimators.least_squares import LeastSquaresEstimator

INPUTS = (
    "counts and references",
    "thickness",
    "refractive index",
    "black reflectance",
    "white reflectance",
    "aperture",
    "engine",
    "interpolation",
)
"""Inputs in the order of every axis of that length. Counts and references come with one
covariance, in which they cannot be told apart any more."""
UNITS = {"albedo": "1", "sigma_t_per_mm": "1/mm", "g": "1"}
CSV_HEADER = ("wavelength_nm", "parameter", "input", "standard_uncertainty", "variance_share")


@dataclass(frozen=True, kw_only=True)
class InputUncertainty:
    """Standard uncertainties of the inputs (type B; JCGM 100:2008, 4.3). 0: known exactly.

    The defaults are those of an affordable bench; state your own where a certificate says more.
    Noise of counts and references is not stated here: it is part of the intensities.
    """

    thickness_mm: float = 0.01
    """Of every sample by itself [mm]: a micrometer gauge of 0.01 mm scale, read to a division."""
    n: float = 0.005
    """Of the samples' refractive index, alike at all wavelengths: spread between published
    values of one polymer."""
    rho_black_relative: float = 0.10
    """Of the black background: spread of flocked papers, of which no certificate exists."""
    rho_white_relative: float = 0.005
    """Of the white standard: a usual calibration certificate (1 % at k = 2). It is reference and
    background at once: it scales I_black and I_white, and the light behind the sample."""
    acceptance_relative: float = 0.05
    """Of the detector's acceptance angle: iris and focal length to a few percent each."""
    interpolation_relative: float = 0.0
    """Of every capture: error of tables between engine and estimate. Least squares evaluates its
    engine directly; 0 unless you put a table in between."""

    def __post_init__(self) -> None:
        """Reject what is no uncertainty.

        Raises:
            InputError: a negative number or none.
        """
        for name, value in vars(self).items():
            if not 0.0 <= value < float("inf"):
                raise InputError(f"{value}", "a standard uncertainty of 0 or more", place=name)


@dataclass(frozen=True, eq=False, kw_only=True)
class UncertaintyBudget:
    """Variance of every parameter by input (P parameters, W wavelengths, I inputs).

    Attributes:
        wavelength_nm: [nm], (W,).
        parameters: names, P of them.
        inputs: names, I of them.
        estimate: (P, W); NaN where there is none.
        variance: by linear propagation, (P, W, I).
        stated: the standard uncertainties that went in.
        monte_carlo: standard uncertainty of all inputs together by drawing them and estimating
            again, (P, W); None when that was not asked for.
        draws: how many.
    """

    wavelength_nm: FloatArray
    parameters: tuple[str, ...]
    inputs: tuple[str, ...]
    estimate: FloatArray
    variance: FloatArray
    stated: InputUncertainty
    monte_carlo: FloatArray | None = None
    draws: int = 0

    @property
    def standard_uncertainty(self) -> FloatArray:
        """Of every parameter, all inputs together, (P, W)."""
        return np.asarray(np.sqrt(self.variance.sum(axis=2)))

    @property
    def share(self) -> FloatArray:
        """Of every input in the variance, (P, W, I); adds up to 1."""
        total = self.variance.sum(axis=2, keepdims=True)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(np.where(total > 0.0, self.variance / total, np.nan))

    @property
    def first(self) -> dict[str, str]:
        """Input with the largest mean share by parameter: what to improve first."""
        found = {}
        for name, share in zip(self.parameters, self.share, strict=True):
            good = np.isfinite(share).all(axis=1)
            if good.any():
                found[name] = self.inputs[int(share[good].mean(axis=0).argmax())]
        return found

    def to_table(self) -> list[dict[str, str | float]]:
        """One row per parameter: median estimate and uncertainty, mean share of every input."""
        rows: list[dict[str, str | float]] = []
        for p, name in enumerate(self.parameters):
            good = np.isfinite(self.share[p]).all(axis=1)
            if not good.any():
                rows.append({"parameter": name, "unit": UNITS[name], "wavelengths": 0})
                continue
            row: dict[str, str | float] = {
                "parameter": name,
                "unit": UNITS[name],
                "wavelengths": int(good.sum()),
                "median_estimate": float(np.median(self.estimate[p, good])),
                "median_standard_uncertainty": float(np.median(self.standard_uncertainty[p, good])),
            }
            mean = self.share[p, good].mean(axis=0)
            row |= {name: float(part) for name, part in zip(self.inputs, mean, strict=True)}
            rows.append(row)
        return rows

    def write_csv(self, path: Path) -> Path:
        """A tidy table by wavelength, parameter and input, "all" for the sum; written atomically.

        Raises:
            InputError: the folder does not exist or cannot be written.
        """
        from twin.files import write_atomically

        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(CSV_HEADER)
        share, total = self.share, self.standard_uncertainty
        for w, wavelength in enumerate(self.wavelength_nm):
            for p, name in enumerate(self.parameters):
                parts = zip(self.inputs, np.sqrt(self.variance[p, w]), share[p, w], strict=True)
                for label, value, part in (*parts, ("all", total[p, w], 1.0)):
                    known = np.isfinite(value)
                    numbers = (f"{value:.6g}", f"{part:.6g}") if known else ("", "")
                    writer.writerow([f"{wavelength:.10g}", name, label, *numbers])
        return write_atomically(path, text.getvalue().encode())


def uncertainty_budget(
    estimator: LeastSquaresEstimator,
    intensities: RelativeIntensities,
    uncertainties: InputUncertainty | None = None,
    *,
    monte_carlo: bool = False,
    draws: int = 200,
    seed: int = 0,
) -> UncertaintyBudget:
    """The budget of a least-squares estimate, every wavelength by itself.

    A parameter has no budget (NaN) where it is not identifiable: linear propagation would mean
    nothing there. Correlation between inputs is not known and taken as zero, but for the white
    standard, see `InputUncertainty`.

    Args:
        estimator: of the bench; its `smoothness_nm` is not used.
        intensities: of the visit.
        uncertainties: of the inputs; None takes the defaults.
        monte_carlo: also draw the inputs and estimate again (JCGM 101). The aperture enters the
            draws to first order.
        draws: of Monte Carlo.
        seed: of Monte Carlo; the same seed gives the same numbers.

    Raises:
        InputError: as `LeastSquaresEstimator.estimate`; fewer than 20 draws.
    """
    from estimators.budget_propagation import drawn, prepared, propagated

    if monte_carlo and draws < 20:
        raise InputError(f"{draws}", "20 draws or more", place="draws")
    stated = uncertainties or InputUncertainty()
    work = prepared(estimator, intensities, stated)
    variance = propagated(work)
    spread = drawn(work, draws, seed) if monte_carlo else None
    blank = ~work.known.T
    variance[blank] = np.nan
    estimate = np.where(blank, np.nan, work.line.natural.T)
    if spread is not None:
        spread[blank] = np.nan
    return UncertaintyBudget(
        wavelength_nm=estimator.model.wavelength_nm,
        parameters=PARAMETERS,
        inputs=INPUTS,
        estimate=estimate,
        variance=variance,
        stated=stated,
        monte_carlo=spread,
        draws=draws if monte_carlo else 0,
    )
