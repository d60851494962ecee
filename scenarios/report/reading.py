"""From a measurement and a result to what a report shows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios.report.content import (
    CAPTURES,
    Content,
    Counts,
    Intensities,
    Properties,
    StatusCount,
    Verdict,
)
from scenarios.report.through_map import Map, intensities_through
from twin.errors import InputError
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from estimators.result import EstimateResult
    from twin.measurement import Measurement

COVERAGE = 0.9
"""Coverage of the wide bands."""


def content_of(measurement: Measurement, result: EstimateResult, maps: Sequence[Map]) -> Content:
    """Gather what the plots need.

    Args:
        measurement: the visit.
        result: an estimate of it, at the measurement's wavelengths.
        maps: appearance maps; the intensities that belong to the truth come through them.

    Raises:
        InputError: the result belongs to other samples or wavelengths than the measurement, or
            the measurement has no usable intensities.
    """
    from twin.measurement import relative_intensities

    _check(measurement, result)
    wavelength = np.asarray(result.wavelength_nm, dtype=np.float64)
    notes: list[str] = []
    found = relative_intensities(measurement)
    relative = Intensities(found.value, found.covariance, found.valid, tuple(found.reasons))
    backgrounds = measurement.bench.background
    from twin.materials import lamp, reflectance

    rho_black = _spectrum(reflectance, backgrounds.black.reflectance, wavelength, notes)
    rho_white = _spectrum(reflectance, backgrounds.white.reflectance, wavelength, notes)
    truth = _truth(measurement, wavelength, notes)
    usable = np.array([_verdict(code) in _SHOWN for code in result.status])
    identifiable = np.asarray(result.identifiable, dtype=bool).T & usable
    return Content(
        bench=measurement.bench,
        samples=measurement.samples,
        wavelength_nm=wavelength,
        counts=_counts(measurement),
        saturation_counts=_saturation(measurement),
        relative=relative,
        estimate=_estimate(result, usable),
        identifiable=identifiable,
        each=_each(result),
        verdicts=tuple(_verdict(code) for code in result.status),
        statuses=_statuses(result),
        method=_METHODS.get(result.estimator, str(result.estimator)),
        truth=truth,
        truth_intensities=_true_intensities(measurement, truth, maps, rho_black, rho_white),
        predicted=np.where(usable, relative.value + result.residual, np.nan),
        residual=np.where(usable, result.residual_normalised, np.nan),
        beer_per_mm=np.asarray(result.beer_sigma_t_per_mm, dtype=np.float64),
        rho_black=rho_black,
        rho_black_measured=_measured_black(measurement, notes),
        rho_white=rho_white,
        lamp_panels=_spectrum(lamp, measurement.bench.panel_spectrum, wavelength, notes),
        lamp_beam=_spectrum(lamp, measurement.bench.beam.spectrum, wavelength, notes),
        fingerprint=measurement.fingerprint,
        result_fingerprint=result.fingerprint,
        seed="" if measurement.provenance.seed is None else str(measurement.provenance.seed),
        origin=_ORIGINS[measurement.provenance.origin],
        software=measurement.provenance.software,
        scenario=measurement.provenance.scenario,
        options=dict(result.settings),
        # The estimator repeats the reasons for masking; they have their own place.
        notes=(*notes, *(m for m in result.messages if m not in relative.reasons)),
    )


_SHOWN = (Verdict.GOOD, Verdict.DOUBTFUL)
_METHODS = {
    "lut": "look-up in the appearance map (lut)",
    "lut-seed": "look-up in the appearance map as in Iser et al. 2022 (lut-seed)",
    "least-squares": "least squares with the adding-doubling engine (least-squares)",
    "posterior": "draws from the posterior with the adding-doubling engine (posterior)",
    "beer": "Beer's law on the collimated capture (beer)",
    "kubelka-munk": "the closed form of Kubelka and Munk from two backgrounds (kubelka-munk)",
    "nelder-mead": "simplex search on the sum of squares (nelder-mead)",
    "powell": "direction-set search on the sum of squares (powell)",
    "adam": "gradient descent on the sum of squares (adam)",
}
_ORIGINS = {
    "simulated": "simulated on the digital twin",
    "measured": "measured with an instrument",
    "handmade": "put together by hand",
}


def _check(measurement: Measurement, result: EstimateResult) -> None:
    names = tuple(sample.name for sample in measurement.samples)
    if tuple(result.sample_names) != names:
        raise InputError(
            f"a result of the samples {', '.join(result.sample_names)}",
            f"one of {', '.join(names)}, which were measured",
        )
    if not np.array_equal(result.wavelength_nm, measurement.wavelength_nm):
        raise InputError(
            f"a result at {len(result.wavelength_nm)} wavelengths",
            f"one at the measurement's {len(measurement.wavelength_nm)} wavelengths",
        )


def _verdict(code: int) -> Verdict:
    from estimators.result import Status

    status = Status(int(code))
    if status is Status.OK:
        return Verdict.GOOD
    if status.has_value:
        return Verdict.DOUBTFUL
    if status in (Status.OUTSIDE_MAP, Status.CONTRADICTORY):
        return Verdict.OUTSIDE
    return Verdict.MASKED if status is Status.MASKED else Verdict.FAILED


def _statuses(result: EstimateResult) -> tuple[StatusCount, ...]:
    from estimators.result import Status

    rows = []
    for status in Status:
        count = int(np.sum(np.asarray(result.status) == int(status)))
        name = status.name.replace("_", " ").lower()
        rows.append(StatusCount(name, _verdict(status), status.text, count))
    return tuple(rows)


def _estimate(result: EstimateResult, usable: Any) -> Properties:
    """The combination; nothing where there is no estimate (the nearest material is not one)."""

    def shown(values: FloatArray) -> FloatArray:
        return np.where(usable, values, np.nan)

    low, high = result.interval(COVERAGE)
    return Properties(
        shown(result.parameters.T), shown(result.standard_error.T), shown(low.T), shown(high.T)
    )


def _each(result: EstimateResult) -> tuple[Properties, ...]:
    alone = []
    for values, status in zip(result.sample_estimate, result.sample_status, strict=True):
        usable = np.array([_verdict(code) in _SHOWN for code in status])
        alone.append(Properties(np.where(usable, values.T, np.nan)))
    return tuple(alone) if len(alone) > 1 else ()


def _counts(measurement: Measurement) -> tuple[Counts, ...]:
    """Mean counts by capture, sample and exposure."""
    captures = measurement.captures
    if captures is None:
        return ()
    groups: dict[tuple[str, str, float, float], list[int]] = {}
    for index, shot in enumerate(captures.shots):
        key = (shot.capture, shot.sample, shot.integration_s, shot.gain)
        groups.setdefault(key, []).append(index)
    return tuple(
        Counts(
            capture,
            sample,
            captures.counts[rows].mean(axis=0),
            len(rows),
            np.asarray(captures.saturated[rows].any(axis=0), dtype=bool),
        )
        for (capture, sample, _seconds, _gain), rows in groups.items()
    )


def _saturation(measurement: Measurement) -> float | None:
    """Counts at which the described instrument saturates; None when nobody described it."""
    if measurement.captures is None or measurement.provenance.noise == "repeats":
        return None
    instrument = measurement.bench.instrument
    well = instrument.full_well_electrons / instrument.electrons_per_count
    return float(min(instrument.full_scale_counts, instrument.dark_level_counts + well))


def _truth(measurement: Measurement, wavelength: FloatArray, notes: list[str]) -> Properties | None:
    """The true properties as the instrument sees them; NaN outside what is known."""
    from twin.measurement import seen_truth

    truth = seen_truth(measurement)
    if truth is None:
        return None
    rows = (truth.albedo, truth.sigma_t_per_mm, truth.g)
    if any(not np.array_equal(row, np.broadcast_to(row[0], row.shape)) for row in rows):
        notes.append(
            "The true properties of the samples differ; those of the first sample are drawn."
        )
    value = np.stack(
        [
            np.interp(wavelength, truth.wavelength_nm, row[0], left=np.nan, right=np.nan)
            for row in rows
        ]
    )
    return Properties(value)


def _true_intensities(
    measurement: Measurement,
    truth: Properties | None,
    maps: Sequence[Map],
    rho_black: FloatArray | None,
    rho_white: FloatArray | None,
) -> FloatArray | None:
    if truth is None or rho_black is None or rho_white is None:
        return None
    values = np.full((len(measurement.samples), len(CAPTURES), rho_black.size), np.nan)
    for index, sample in enumerate(measurement.samples):
        found = intensities_through(maps, sample.thickness_mm, truth.value, rho_black, rho_white)
        if found is not None:
            values[index] = found
    return values if np.isfinite(values).any() else None


def _spectrum(
    library: Callable[[Any, FloatArray], FloatArray],
    value: Any,
    wavelength: FloatArray,
    notes: list[str],
) -> FloatArray | None:
    """A lamp or a reflectance, or None and a note when it does not cover the wavelengths."""
    try:
        return np.asarray(library(value, wavelength), dtype=np.float64)
    except InputError as error:
        notes.append(f"A spectrum of the bench is not shown: {error}")
        return None


def _measured_black(measurement: Measurement, notes: list[str]) -> FloatArray | None:
    from twin.measurement import measured_black_reflectance

    try:
        found = measured_black_reflectance(measurement)
    except InputError as error:
        notes.append(f"The black background could not be measured: {error}")
        return None
    return None if found is None else np.asarray(found.value, dtype=np.float64)
