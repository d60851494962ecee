"""From a measurement to an estimate: appearance maps, then the estimator by its name."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from scenarios.console import Console
from scenarios.scenario import EstimatorChoice, MapSettings

if TYPE_CHECKING:
    from estimators import EstimateResult
    from twin.appearance import AppearanceMap
    from twin.bench import Bench, Sample
    from twin.measurement import Measurement, RelativeIntensities
    from twin.spectra import FloatArray


@dataclass(frozen=True)
class Estimated:
    """An estimate with what it was made from.

    Attributes:
        intensities: relative intensities of the measurement.
        maps: one appearance map per sample.
        result: the optical properties with their uncertainty.
    """

    intensities: RelativeIntensities
    maps: tuple[AppearanceMap, ...]
    result: EstimateResult


def estimate_measurement(
    measurement: Measurement,
    estimator: str | EstimatorChoice = "lut",
    *,
    settings: MapSettings | None = None,
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
        cache: folder of the maps; None takes the user's.
        threads: threads of the Monte Carlo; the result does not depend on them.
        console: is told what happens.

    Raises:
        InputError: the measurement, the estimator's name or an option cannot be used.
    """
    from estimators import BenchModel
    from estimators import estimator as make_estimator
    from twin.measurement import relative_intensities

    console = console or Console(quiet=True)
    choice = EstimatorChoice(name=estimator) if isinstance(estimator, str) else estimator
    intensities = relative_intensities(measurement)
    wavelength = intensities.wavelength_nm
    check_estimator(choice)
    maps = appearance_maps(
        measurement.bench,
        measurement.samples,
        wavelength,
        settings or MapSettings(),
        cache=cache,
        threads=threads,
        console=console,
    )
    model = BenchModel.of(measurement.bench, measurement.samples, wavelength, maps)
    with console.step(f"estimate with {choice.name}"):
        result = make_estimator(choice.name, model, **choice.options).estimate(intensities)
    return Estimated(intensities, maps, result)


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


def appearance_maps(
    bench: Bench,
    samples: tuple[Sample, ...],
    wavelength_nm: FloatArray,
    settings: MapSettings,
    *,
    cache: Path | None,
    threads: int | None,
    console: Console,
) -> tuple[AppearanceMap, ...]:
    """One map per sample, computed or from the cache.

    Args:
        bench: around the samples.
        samples: S of them.
        wavelength_nm: wavelengths [nm], shape (W,), over which the refractive index is averaged.
        settings: grid and quality.
        cache: folder of the maps; None takes the user's.
        threads: threads of the Monte Carlo.
        console: is told what happens.
    """
    from twin.appearance import MapGrid, appearance_map
    from twin.materials import refractive_index

    grid = MapGrid.spaced(
        settings.albedo_count,
        settings.sigma_t_count,
        settings.g_count,
        sigma_range=settings.sigma_t_range_per_mm,
        g_range=settings.g_range,
        albedo_top=settings.albedo_top,
    )
    maps: dict[tuple[float, float], AppearanceMap] = {}
    keys = []
    for sample in samples:
        n = float(np.mean(refractive_index(sample.n, wavelength_nm)))
        key = (sample.thickness_mm, n)
        keys.append(key)
        if key not in maps:
            with console.step(f"appearance map of {sample.thickness_mm:g} mm") as progress:
                maps[key] = appearance_map(
                    bench,
                    *key,
                    grid=grid,
                    paths=settings.paths,
                    threads=threads,
                    folder=cache,
                    progress=progress,
                    say=console.say,
                )
    return tuple(maps[key].refined() for key in keys)
