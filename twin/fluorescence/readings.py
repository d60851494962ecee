"""From the shots of a fluorescence visit to signals with noise, under every illuminant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.fluorescence.simulation import lamp_numbers
from twin.fluorescence.visit import FluorescenceVisit
from twin.instrument import (
    Instrument,
    MultispectralChip,
    count_variance,
    electrons_of_counts,
    saturation_counts,
)
from twin.spectra import FloatArray

BoolArray = NDArray[np.bool_]

LEAST_MODE = 1e-9
"""Modes of the lamps' drift below this relative variance are left out."""


@dataclass(frozen=True)
class Signals:
    """Signals [electrons/s] of white and sample, dark removed, shape (J, K) each.

    Attributes:
        white: mean of the white's shots.
        white_variance: its variance without the lamp's drift.
        sample: mean of the sample's shots.
        sample_variance: likewise.
        dark_variance: the part of both that is one and the same error, because white and sample
            had the same dark taken off; 0 where they had not.
        valid: neither saturated nor dead, in white and sample, (J, K).
        drift: relative errors that the lamps' drift causes in sample and white, as independent
            modes of one standard deviation each, shape (C, 2, J, K) in the order sample, white.
        reasons: what was masked, in words with counts.
    """

    white: FloatArray
    white_variance: FloatArray
    sample: FloatArray
    sample_variance: FloatArray
    dark_variance: FloatArray
    valid: BoolArray
    drift: FloatArray
    reasons: tuple[str, ...]


def signals(visit: FluorescenceVisit) -> Signals:
    """Dark-subtracted, linearised signals under every illuminant.

    Raises:
        InputError: an illuminant without white or sample, a shot without a dark of its integration
            time and gain, no usable channel, repeats asked for the noise but not there.
    """
    setup, reasons = visit.setup, []
    by_repeats = visit.provenance.noise == "repeats"
    result: dict[str, list[FloatArray]] = {"white": [], "sample": []}
    spread: dict[str, list[FloatArray]] = {"white": [], "sample": []}
    shared: list[FloatArray] = []
    valid = np.ones((len(setup.lights), len(setup.channel_names)), dtype=bool)
    chosen: dict[str, list[list[int]]] = {"white": [], "sample": []}
    for row, light in enumerate(setup.lights):
        for kind in ("white", "sample"):
            shots = [
                index
                for index, shot in enumerate(visit.shots)
                if (shot.kind, shot.illuminant) == (kind, light.name)
            ]
            if not shots:
                raise InputError(
                    f"no {kind} under {light.name!r}",
                    "white and sample under every illuminant", place="shots",
                )  # fmt: skip
            saturated = visit.saturated[shots].any(axis=0)
            dead = ~np.isfinite(visit.counts[shots]).all(axis=0)
            for bad, why in ((saturated, "saturated"), (dead, "not a number")):
                if bad.any():
                    reasons.append(
                        f"{int(bad.sum())} of {bad.size} channels masked:"
                        f" {kind} under {light.name!r} {why}"
                    )
            valid[row] &= ~(saturated | dead)
            value, variance, dark_variance = _mean(visit, shots, by_repeats)
            result[kind].append(value)
            spread[kind].append(variance)
            chosen[kind].append(shots)
        first = [visit.shots[chosen[kind][row][0]] for kind in ("white", "sample")]
        one_dark = len({(shot.integration_s, shot.gain) for shot in first}) == 1
        shared.append(dark_variance * one_dark)
    if not valid.any():
        raise InputError("no channel that is neither saturated nor dead", "one or more")
    return Signals(
        white=np.where(valid, result["white"], np.nan),
        white_variance=np.where(valid, spread["white"], np.nan),
        sample=np.where(valid, result["sample"], np.nan),
        sample_variance=np.where(valid, spread["sample"], np.nan),
        dark_variance=np.where(valid, shared, np.nan),
        valid=valid, drift=_scatter(visit, chosen) if by_repeats else _drift(visit, chosen),
        reasons=tuple(reasons),
    )  # fmt: skip


def _mean(
    visit: FluorescenceVisit, shots: list[int], by_repeats: bool
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mean signal [electrons/s] of some shots, its variance, the dark's part in that, (K,) each."""
    values, variances = [], []
    for index in shots:
        shot = visit.shots[index]
        instrument = _set(visit.setup.detector, shot.gain)
        dark, dark_variance = _dark(visit, index, instrument)
        light = electrons_of_counts(instrument, visit.counts[index])
        # The light alone: the dark's charge goes through the same curve.
        charge = light - electrons_of_counts(instrument, dark)
        slope = instrument.electrons_per_count
        noise = count_variance(instrument, visit.counts[index], dark, shot.averages)
        values.append(_without_stray(instrument, charge / shot.integration_s))
        variances.append((noise + dark_variance) * (slope / shot.integration_s) ** 2)
    mean = np.mean(values, axis=0)
    if by_repeats:
        if len(values) < 2:
            raise InputError(
                f"one {visit.shots[shots[0]].label}",
                "two repeats or more: nobody described the instrument's noise", place="shots",
            )  # fmt: skip
        # The level of the lamp is a common error (`_scatter`), so it is taken out first; the rest
        # is pooled over the channels in proportion to the signal: two repeats alone say too little.
        level = np.nansum(values, axis=1, keepdims=True)
        steady = np.array(values) * (level.mean() / level)
        scatter = np.var(steady, axis=0, ddof=1)
        level = np.maximum(np.abs(mean), 1e-3 * np.nanmax(np.abs(mean)))
        pooled = np.nanmean(scatter / level) * level
        return np.asarray(mean), np.asarray(pooled / len(values)), np.zeros(mean.shape)
    # All shots share one dark: its noise does not average away.
    shared = dark_variance * (slope / shot.integration_s) ** 2
    own = np.mean(variances, axis=0) - shared
    return np.asarray(mean), np.asarray(own / len(values) + shared), np.asarray(shared)


def _dark(
    visit: FluorescenceVisit, index: int, instrument: Instrument
) -> tuple[FloatArray, FloatArray]:
    """Mean dark counts at a shot's setting and the variance of that mean, shape (K,) each."""
    shot = visit.shots[index]
    found = [
        each
        for each, other in enumerate(visit.shots)
        if other.kind == "dark"
        and abs(other.integration_s / shot.integration_s - 1.0) < 1e-6
        and abs(other.gain / shot.gain - 1.0) < 1e-6
    ]
    if not found:
        settings = sorted({(o.integration_s, o.gain) for o in visit.shots if o.kind == "dark"})
        there = ", ".join(f"{s:g} s at gain {g:g}" for s, g in settings) or "no dark at all"
        raise InputError(
            f"no dark for {shot.label} ({shot.integration_s:g} s at gain {shot.gain:g}); there is"
            f" {there}", "a dark of the same integration time and gain", place="shots",
        )  # fmt: skip
    counts = visit.counts[found]
    mean = np.nanmean(np.where(np.isfinite(counts).any(axis=0), counts, 0.0), axis=0)
    averages = sum(visit.shots[each].averages for each in found)
    return np.asarray(mean), count_variance(instrument, mean, mean, averages)


def _set(instrument: Instrument, gain: float) -> Instrument:
    """The instrument at the gain of a shot."""
    if isinstance(instrument, MultispectralChip) and gain != instrument.gain:
        return instrument.model_copy(update={"gain": gain})
    return instrument


def _without_stray(instrument: Instrument, rate: FloatArray) -> FloatArray:
    """Undo the light that falls evenly over all pixels (its mean is left as it was)."""
    share = instrument.stray_light_fraction
    if not instrument.has("stray_light") or share == 0.0 or not np.isfinite(rate).all():
        return rate
    return np.asarray((rate - share * rate.mean()) / (1.0 - share))


def _drift(visit: FluorescenceVisit, chosen: dict[str, list[list[int]]]) -> FloatArray:
    """Modes of the lamps' drift in sample and white, shape (C, 2, J, K); see `Signals.drift`."""
    setup = visit.setup
    instrument = setup.detector
    lamps = lamp_numbers(setup)
    passes = setup.passes.astype(int)
    rounds = int(passes.max()) + 1
    count = len(setup.lights)
    if not instrument.has("lamp_drift"):
        return np.zeros((0, 2, count, passes.size))
    weight = np.zeros((2, count, rounds, len(visit.shots) * rounds))
    for part, kind in enumerate(("sample", "white")):
        for row in range(count):
            shots = np.array(chosen[kind][row])
            for which in range(rounds):
                weight[part, row, which, shots * rounds + which] = 1.0 / shots.size
    # The walk of a lamp: each step counts with the weights of all that comes after it.
    later = np.cumsum(weight[..., ::-1], axis=-1)[..., ::-1][..., 1:]
    same = (lamps[:, None] == lamps[None, :])[None, :, None, None, :, None]
    walk = np.einsum("sapn,tbqn->saptbq", later, later) * same
    flicker = np.einsum("sapn,tbqn->saptbq", weight, weight) * same
    size = 2 * count * rounds
    level = instrument.lamp_walk**2 * walk + instrument.lamp_flicker**2 * flicker
    wavelength = np.asarray(instrument.wavelength_nm)
    tilt = np.zeros(passes.size)
    if wavelength.size > 1:
        tilt = 2.0 * (wavelength - wavelength[0]) / (wavelength[-1] - wavelength[0]) - 1.0
    modes = []
    for covariance, shape in (
        (level, np.ones(passes.size)),
        (instrument.lamp_tilt_walk**2 * walk, tilt),
    ):
        variance, vectors = np.linalg.eigh(covariance.reshape(size, size))
        for each, vector in zip(variance, vectors.T, strict=True):
            if each > LEAST_MODE:
                mode = np.sqrt(each) * vector.reshape(2, count, rounds)
                modes.append(mode[:, :, passes] * shape)
    return np.array(modes).reshape(len(modes), 2, count, passes.size)


def _scatter(visit: FluorescenceVisit, chosen: dict[str, list[list[int]]]) -> FloatArray:
    """The same modes from the scatter of the repeats' totals, when nobody described the lamps."""
    count = len(visit.setup.lights)
    modes = np.zeros((2 * count, 2, count, visit.counts.shape[1]))
    for part, kind in enumerate(("sample", "white")):
        for row in range(count):
            totals = []
            for index in chosen[kind][row]:
                instrument = _set(visit.setup.detector, visit.shots[index].gain)
                dark, _ = _dark(visit, index, instrument)
                totals.append(np.nansum(visit.counts[index] - dark))
            spread = np.std(totals, ddof=1) / max(np.mean(totals), 1e-300)
            modes[part * count + row, part, row] = spread / np.sqrt(len(totals))
    return modes


def check_saturation(visit: FluorescenceVisit) -> BoolArray:
    """Readings at or above the top of the range, (N, K): for files that carry no flags."""
    return np.asarray(
        [
            counts >= saturation_counts(_set(visit.setup.detector, shot.gain))
            for shot, counts in zip(visit.shots, visit.counts, strict=True)
        ]
    )
