"""From chains to a result: quantiles, identifiability, status and words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.draws import MEDIAN, NINETY_HIGH, NINETY_LOW
from estimators.posterior_coordinates import Coordinates
from estimators.posterior_data import Data
from estimators.posterior_engine import Engine
from estimators.posterior_local import Local
from estimators.posterior_mode import Mode
from estimators.posterior_settings import SHARES, PosteriorSettings
from estimators.protocol import BenchModel, fingerprint
from estimators.result import QUANTILE_LEVELS, EstimateResult, Status
from twin.measurement.relative import RelativeIntensities
from twin.spectra import FloatArray

AT_END = 0.02
"""Share of a stated range that counts as its end; more than `MANY` of the draws there: a bound."""
MANY = 0.05
STATISTICS = (
    "autocorrelation_time",
    "effective_sample_size",
    "acceptance_fraction",
    "emulator_error",
    "converged",
    "chi_square",
)


@dataclass(frozen=True, eq=False)
class Findings:
    """What the sampling found at U usable wavelengths.

    Attributes:
        usable: their indices, (U,).
        local: their chains.
        mode: the most probable materials.
        covariance: of the captures with everything in it, (U, M, M).
        alone: materials of every sample by itself, (S, U, 3).
        torn: where the samples contradict each other, (U,).
        messages: what is to be said of all.
    """

    usable: NDArray[np.intp]
    local: Sequence[Local]
    mode: Mode
    covariance: FloatArray
    alone: FloatArray
    torn: NDArray[np.bool_]
    messages: tuple[str, ...]


def assembled(
    model: BenchModel,
    settings: PosteriorSettings,
    intensities: RelativeIntensities,
    data: Data,
    beer: tuple[FloatArray, FloatArray],
    engine: Engine,
    coordinates: Coordinates,
    found: Findings,
) -> EstimateResult:
    """The result of all W wavelengths."""
    count, samples = model.wavelength_nm.size, len(model.sample_names)
    usable = found.usable
    quantile = np.full((QUANTILE_LEVELS.size, count, 3), np.nan)
    covariance = np.full((count, 3, 3), np.nan)
    draws = np.full((settings.draws, count, 3), np.nan)
    crowded = np.zeros((count, 3), dtype=bool)
    statistics = {name: np.full(count, np.nan) for name in STATISTICS}
    for w, one in zip(usable, found.local, strict=True):
        flat = one.x.reshape(-1, 3)
        material = coordinates.material(flat)
        quantile[:, w] = np.quantile(material, QUANTILE_LEVELS, axis=0)
        covariance[w] = np.cov(material.T)
        even = np.linspace(0, len(flat) - 1, settings.draws).round().astype(np.intp)
        draws[:, w] = material[even]
        share = coordinates.share(flat)
        crowded[w] = np.maximum((share < AT_END).mean(0), (share > 1.0 - AT_END).mean(0)) > MANY
        chain = one.chain
        values = (
            chain.autocorrelation_time,
            chain.effective_sample_size,
            chain.acceptance_fraction,
            one.emulator_error,
            float(chain.converged and not one.touched),
        )
        for name, value in zip(STATISTICS, values, strict=False):
            statistics[name][w] = value
    statistics["chi_square"][usable] = found.mode.chi_square
    estimate = quantile[MEDIAN]
    identifiable = _identifiable(quantile, coordinates, settings)
    torn = np.zeros(count, dtype=bool)
    torn[usable] = found.torn
    crowded[:, 0] = False  # 0 and 1 are what albedo can be, not what was searched
    status = data.status()
    conditions = (
        (data.noiseless, Status.NO_NOISE_STATED),
        ((crowded & identifiable).any(axis=1), Status.AT_BOUND),
        (~identifiable.all(axis=1), Status.NOT_IDENTIFIABLE),
        (torn, Status.INCONSISTENT),
        (statistics["converged"] == 0.0, Status.NOT_CONVERGED),
    )
    for where, code in conditions:
        status[where & (status < code)] = code
    identifiable[status >= Status.OUTSIDE_MAP] = False

    predicted = np.full((count, 3 * samples), np.nan)
    predicted[usable] = engine.at(estimate[usable][None])[0]
    noise = np.full_like(predicted, np.nan)
    noise[usable] = np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))
    residual = np.where(data.valid, predicted - data.value, np.nan)
    normalised = residual / noise
    alone = np.full((samples, count, 3), np.nan)
    alone[:, usable] = found.alone
    alone[data.sample_status >= Status.CONTRADICTORY] = np.nan
    return EstimateResult(
        estimator="posterior",
        wavelength_nm=model.wavelength_nm,
        albedo=estimate[:, 0].copy(),
        sigma_t_per_mm=estimate[:, 1].copy(),
        g=estimate[:, 2].copy(),
        covariance=covariance,
        quantile_level=QUANTILE_LEVELS,
        quantile=quantile,
        identifiable=identifiable,
        status=status,
        sample_names=tuple(intensities.sample_names),
        thickness_mm=np.asarray(intensities.thickness_mm, dtype=np.float64),
        sample_estimate=alone,
        sample_status=data.sample_status,
        distance=np.full((samples, count), np.nan),
        residual=residual.T.reshape(samples, 3, count),
        residual_normalised=normalised.T.reshape(samples, 3, count),
        beer_sigma_t_per_mm=beer[0],
        beer_standard_error_per_mm=beer[1],
        settings=settings.as_plain(),
        fingerprint=_fingerprint(intensities, model, settings),
        messages=(
            *intensities.reasons,
            *found.messages,
            *_words(settings, status, statistics, found.local),
        ),
        statistics=statistics,
        draws=draws,
    )


def blank(
    model: BenchModel,
    settings: PosteriorSettings,
    intensities: RelativeIntensities,
    data: Data,
    beer: tuple[FloatArray, FloatArray],
) -> EstimateResult:
    """The result where no wavelength can be used: nothing but reasons."""
    count, samples = model.wavelength_nm.size, len(model.sample_names)
    status = data.status()
    nothing = np.full(count, np.nan)
    return EstimateResult(
        estimator="posterior",
        wavelength_nm=model.wavelength_nm,
        albedo=nothing,
        sigma_t_per_mm=nothing.copy(),
        g=nothing.copy(),
        covariance=np.full((count, 3, 3), np.nan),
        quantile_level=QUANTILE_LEVELS,
        quantile=np.full((QUANTILE_LEVELS.size, count, 3), np.nan),
        identifiable=np.zeros((count, 3), dtype=bool),
        status=status,
        sample_names=tuple(intensities.sample_names),
        thickness_mm=np.asarray(intensities.thickness_mm, dtype=np.float64),
        sample_estimate=np.full((samples, count, 3), np.nan),
        sample_status=data.sample_status,
        distance=np.full((samples, count), np.nan),
        residual=np.full((samples, 3, count), np.nan),
        residual_normalised=np.full((samples, 3, count), np.nan),
        beer_sigma_t_per_mm=beer[0],
        beer_standard_error_per_mm=beer[1],
        settings=settings.as_plain(),
        fingerprint=_fingerprint(intensities, model, settings),
        messages=(*intensities.reasons, *_words(settings, status, {}, ())),
        statistics={name: nothing.copy() for name in STATISTICS},
        draws=np.full((settings.draws, count, 3), np.nan),
    )


def _fingerprint(
    intensities: RelativeIntensities, model: BenchModel, settings: PosteriorSettings
) -> str:
    bench = "" if model.bench is None else model.bench.model_dump_json()
    words = ["posterior", repr(settings.as_plain()), bench]
    return fingerprint(intensities, model.fingerprint_parts(), words)


def _identifiable(
    quantile: FloatArray, coordinates: Coordinates, settings: PosteriorSettings
) -> NDArray[np.bool_]:
    """Whether the 90 % interval is narrow against the prior's range, (W, 3)."""
    low, high = quantile[NINETY_LOW].copy(), quantile[NINETY_HIGH].copy()
    low[:, 1], high[:, 1] = np.log(low[:, 1]), np.log(high[:, 1])
    span = coordinates.high - coordinates.low
    with np.errstate(invalid="ignore"):
        return np.asarray(high - low <= settings.unidentifiable_share * span)


def _words(
    settings: PosteriorSettings,
    status: NDArray[np.int8],
    statistics: dict[str, FloatArray],
    local: Sequence[Local],
) -> tuple[str, ...]:
    """What is to be said besides the numbers."""
    said = []
    exact = [name for name in SHARES if name not in settings.stated()]
    if exact:
        named = ", ".join(SHARES[name] for name in exact)
        said.append(f"taken as exact, as no uncertainty of them was stated: {named}")
    for code in np.unique(status):
        if code != Status.OK:
            number = int((status == code).sum())
            said.append(f"{number} of {status.size} wavelengths: {Status(int(code)).text}")
    own = sum(one.exact for one in local)
    if own:
        said.append(f"{own} of {status.size} wavelengths sampled with the engine itself")
    touched = sum(one.touched for one in local)
    if touched:
        said.append(
            f"{touched} of {status.size} wavelengths: the chain reached the end of its emulator"
        )
    error = statistics.get("emulator_error")
    if error is not None:
        loose = int((error > settings.emulator_tolerance).sum())
        if loose:
            said.append(
                f"{loose} of {status.size} wavelengths: emulated captures are off by up to"
                f" {np.nanmax(error):.2g} standard deviations"
            )
    return tuple(said)
