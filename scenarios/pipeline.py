"""From a measurement to an estimate: appearance maps, then the estimator by its name."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.console import Console
from scenarios.maps import appearance_maps
from scenarios.scenario import EstimatorChoice, MapSettings
from twin.errors import InputError

if TYPE_CHECKING:
    from estimators import BenchModel, EstimateResult, InputUncertainty, UncertaintyBudget
    from twin.appearance import AppearanceMap
    from twin.measurement import Measurement, RelativeIntensities


@dataclass(frozen=True)
class Estimated:
    """An estimate with what it was made from.

    Attributes:
        intensities: relative intensities of the measurement.
        maps: one appearance map per sample.
        result: the optical properties with their uncertainty.
        budget: which input is to blame for the uncertainty; None: it was not asked for.
    """

    intensities: RelativeIntensities
    maps: tuple[AppearanceMap, ...]
    result: EstimateResult
    budget: UncertaintyBudget | None = None


BUDGETED = "least-squares"
"""The estimator whose uncertainty can be budgeted."""


def estimate_measurement(
    measurement: Measurement,
    estimator: str | EstimatorChoice = "lut",
    *,
    settings: MapSettings | None = None,
    budget: bool = False,
    cache: Path | None = None,
    threads: int | None = None,
    console: Console | None = None,
) -> Estimated:
    """Estimate the optical properties behind one visit.

    The map of a sample is computed at the mean of its refractive index over the measured
    wavelengths, or read from the cache.

    Args:
        measurement: counts or relative intensities.
        estimator: name in the registry, with options when it is an `EstimatorChoice`.
        settings: grid and quality of the appearance maps.
        budget: also make the uncertainty budget, with the default uncertainties of the inputs.
        cache: folder of the maps; None takes the user's.
        threads: threads of the Monte Carlo; the result does not depend on them.
        console: is told what happens.

    Raises:
        InputError: the measurement, the estimator's name or an option cannot be used, or a
            budget of an estimator other than least squares.
    """
    from estimators import estimator as make_estimator

    console = console or Console(quiet=True)
    choice = EstimatorChoice(name=estimator) if isinstance(estimator, str) else estimator
    check_estimator(choice)
    if budget:
        check_budget(choice)
    seen = _seen(measurement, settings, cache=cache, threads=threads, console=console)
    made = make_estimator(choice.name, seen.model, **choice.options)
    with console.step(f"estimate with {choice.name}"):
        result = made.estimate(seen.intensities)
    found = _budget(made, seen, None, console=console) if budget else None
    return Estimated(seen.intensities, seen.maps, result, found)


def budget_of(
    measurement: Measurement,
    estimator: EstimatorChoice,
    uncertainties: InputUncertainty | None = None,
    *,
    settings: MapSettings | None = None,
    draws: int = 0,
    seed: int = 0,
    cache: Path | None = None,
    threads: int | None = None,
    console: Console | None = None,
) -> UncertaintyBudget:
    """Uncertainty budget of the least-squares estimate behind one visit.

    Args:
        measurement: counts or relative intensities.
        estimator: least squares with its options.
        uncertainties: of the inputs; None takes the defaults.
        settings: grid and quality of the appearance maps.
        draws: of the check by Monte Carlo; 0: no check.
        seed: of these draws.
        cache: folder of the maps; None takes the user's.
        threads: threads of the Monte Carlo of the maps; the result does not depend on them.
        console: is told what happens.

    Raises:
        InputError: the measurement, an option, the number of draws or another estimator cannot
            be used.
    """
    from estimators import estimator as make_estimator

    console = console or Console(quiet=True)
    check_estimator(estimator)
    check_budget(estimator)
    seen = _seen(measurement, settings, cache=cache, threads=threads, console=console)
    made = make_estimator(estimator.name, seen.model, **estimator.options)
    return _budget(made, seen, uncertainties, draws=draws, seed=seed, console=console)


@dataclass(frozen=True)
class _Seen:
    """What every estimator starts from."""

    intensities: RelativeIntensities
    maps: tuple[AppearanceMap, ...]
    model: BenchModel


def _seen(
    measurement: Measurement,
    settings: MapSettings | None,
    *,
    cache: Path | None,
    threads: int | None,
    console: Console,
) -> _Seen:
    from estimators import BenchModel
    from twin.measurement import relative_intensities

    intensities = relative_intensities(measurement)
    maps = appearance_maps(
        measurement.bench,
        measurement.samples,
        intensities.wavelength_nm,
        settings or MapSettings(),
        cache=cache,
        threads=threads,
        console=console,
    )
    model = BenchModel.of(measurement.bench, measurement.samples, intensities.wavelength_nm, maps)
    return _Seen(intensities, maps, model)


def _budget(
    made: Any,
    seen: _Seen,
    uncertainties: InputUncertainty | None,
    *,
    draws: int = 0,
    seed: int = 0,
    console: Console,
) -> UncertaintyBudget:
    from estimators import uncertainty_budget

    with console.step("uncertainty budget"):
        return uncertainty_budget(
            made, seen.intensities, uncertainties, monte_carlo=draws > 0, draws=draws, seed=seed
        )


def check_budget(choice: EstimatorChoice) -> None:
    """Make sure that the estimator is one whose uncertainty can be budgeted.

    Raises:
        InputError: it is not.
    """
    if choice.name != BUDGETED:
        raise InputError(
            f"an uncertainty budget of {choice.name}",
            f"one of {BUDGETED}",
            remedy=f"Add --estimator {BUDGETED}.",
        )


def check_estimator(choice: EstimatorChoice) -> None:
    """Find a wrong name or option now, not after minutes of light transport.

    The estimator is made for a bench without samples, which needs no appearance map.

    Raises:
        InputError: an unknown name or option, or an option out of range.
    """
    from estimators import BenchModel
    from estimators import estimator as make_estimator

    one = np.array([550.0])
    empty = BenchModel(
        sample_names=(),
        wavelength_nm=one,
        n=np.empty((0, 1)),
        rho_black=np.zeros(1),
        rho_white=np.ones(1),
    )
    make_estimator(choice.name, empty, **choice.options)
