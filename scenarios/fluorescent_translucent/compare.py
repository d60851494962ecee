"""With and without the fluorescence in the model: errors of what is recovered."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from scenarios.fluorescent_translucent.case import Case
from scenarios.fluorescent_translucent.simulate import (
    TrueCaptures,
    led_visit,
    true_captures,
    white_visit,
)

if TYPE_CHECKING:
    from estimators.translucent_fluorescence import FluorescentEstimate


@dataclass(frozen=True)
class Errors:
    """Relative errors of one estimate: medians over wavelength, largest, and coverage.

    Attributes:
        sigma_a, sigma_s_prime: median over wavelength of the relative error's size.
        sigma_a_largest, sigma_s_prime_largest: the largest.
        fluorescence: of the integrated fluorescence; 1 when none is seen.
        coverage: share of the 90 % intervals of sigma_a, sigma_s' and the integrated
            fluorescence that hold the truth.
    """

    sigma_a: float
    sigma_s_prime: float
    sigma_a_largest: float
    sigma_s_prime_largest: float
    fluorescence: float
    coverage: float


def errors_of(case: Case, found: FluorescentEstimate) -> Errors:
    """Errors of an estimate against the case's medium; sigma_a with the fluorophore."""
    own = case.properties
    absorption = own.absorption_per_mm + own.fluorophore_per_mm
    reduced = own.scattering_per_mm * (1.0 - own.g)
    integrated = float(own.step_nm @ own.source @ own.step_nm)
    a = np.abs(found.sigma_a_per_mm / absorption - 1.0)
    s = np.abs(found.sigma_s_prime_per_mm / reduced - 1.0)
    inside = []
    truths = (("sigma_a", absorption), ("sigma_s_prime", reduced), ("integrated", integrated))
    for name, truth in truths:
        low, high = found.interval(name)
        inside.append(np.atleast_1d((low <= truth) & (truth <= high)))
    return Errors(
        float(np.median(a)), float(np.median(s)), float(a.max()), float(s.max()),
        abs(found.integrated / integrated - 1.0), float(np.mean(np.concatenate(inside))),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Comparison:
    """Both answers to one case."""

    with_fluorescence: FluorescentEstimate
    without: FluorescentEstimate
    errors_with: Errors
    errors_without: Errors


def compare(
    case: Case,
    *,
    truth: TrueCaptures | None = None,
    paths: int = 65_536,
    correction_paths: int = 16_384,
    seed: int = 0,
    threads: int | None = None,
) -> Comparison:
    """Simulate the case; estimate it under the LEDs, and blindly under the bench's own lamp.

    Args:
        case: the case.
        truth: of `true_captures`; None: computed here.
        paths: of the truth.
        correction_paths: of the estimator's own Monte Carlo, which uses other random numbers.
        seed: of everything.
        threads: None takes all processors.
    """
    from estimators.translucent_fluorescence import FluorescentForward, estimate, estimate_blind

    light = truth or true_captures(case, paths=paths, seed=seed, threads=threads)
    bench, samples = case.bench, case.samples
    model = FluorescentForward.of(bench, samples, case.wavelength_nm)
    found = estimate(
        led_visit(case, light, seed=seed), bench, samples, model=model, paths=correction_paths,
        seed=seed + 500_000, threads=threads,
    )  # fmt: skip
    blind = estimate_blind(white_visit(case, light, seed=seed), bench, samples, model=model)
    return Comparison(found, blind, errors_of(case, found), errors_of(case, blind))
