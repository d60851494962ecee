"""From the light on the pixels to the counts of one shot, and back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from twin.errors import InputError
from twin.instrument.spec import Instrument
from twin.instrument.streams import Stream, generator
from twin.spectra import FloatArray

# Frames drawn at once; bounds the memory and changes no number.
_CHUNK_FRAMES = 64
# Above this a float64 no longer holds every whole number of electrons.
_MOST_ELECTRONS = 2.0**53


@dataclass(frozen=True)
class Counts:
    """What an instrument returns for one shot: the mean of its frames.

    Attributes:
        counts: mean reading [counts] of the frames, shape (P,).
        saturated: True where any frame reached full scale or full well, shape (P,).
        floored: True where any frame fell below 0 counts and was read as 0, shape (P,).
        frames: number of frames averaged.
        integration_s: integration time [s] of one frame.
        full_scale_counts: highest reading [counts].
    """

    counts: FloatArray
    saturated: NDArray[np.bool_]
    floored: NDArray[np.bool_]
    frames: int
    integration_s: float
    full_scale_counts: int


def fixed_pattern(instrument: Instrument) -> FloatArray:
    """Sensitivity of every pixel relative to the mean, drawn from the serial number, shape (P,).

    Log-normal with mean 1 and the relative standard deviation `photo_response_nonuniformity`;
    exactly 1 with "nonuniformity" off. The same for all shots and seeds.
    """
    pixels = len(instrument.wavelength_nm)
    spread = instrument.photo_response_nonuniformity
    if not instrument.has("nonuniformity") or spread == 0:
        return np.ones(pixels)
    variance = np.log1p(spread**2)
    normal = generator(Stream.PATTERN, instrument.serial).standard_normal(pixels)
    return np.asarray(np.exp(np.sqrt(variance) * normal - variance / 2))


def electron_budget(instrument: Instrument, rate_electrons_per_s: ArrayLike) -> FloatArray:
    """Charge [electrons/s] that every pixel gathers, dark current included, shape (P,).

        (1 - f) rate + f mean(rate), times the fixed pattern, plus the dark current

    with the stray-light fraction f.

    Args:
        instrument: the instrument.
        rate_electrons_per_s: signal [electrons/s] of every pixel, shape (P,), as
            `twin.instrument.optics.electron_rates` gives it.

    Raises:
        InputError: the wrong number of pixels, or a rate that is negative or not finite.
    """
    rate = np.asarray(rate_electrons_per_s, dtype=np.float64)
    pixels = len(instrument.wavelength_nm)
    if rate.shape != (pixels,):
        raise InputError(f"rates of shape {rate.shape}", f"one for each of {pixels} pixels")
    if not np.all(np.isfinite(rate)) or rate.min() < 0:
        raise InputError(
            f"rates from {rate.min():g} to {rate.max():g} electrons/s", "finite rates of at least 0"
        )
    if instrument.has("stray_light"):
        stray = instrument.stray_light_fraction
        rate = (1.0 - stray) * rate + stray * rate.mean()
    dark = instrument.dark_current_electrons_per_s if instrument.has("dark_current") else 0.0
    return rate * fixed_pattern(instrument) + dark


def expected_electrons(
    instrument: Instrument,
    rate_electrons_per_s: ArrayLike,
    integration_s: float,
    *,
    lamp: ArrayLike = 1.0,
) -> FloatArray:
    """Mean charge [electrons] of one frame, shape (P,): the mean of the Poisson distribution.

    Args:
        instrument: the instrument.
        rate_electrons_per_s: signal [electrons/s] of every pixel, shape (P,).
        integration_s: integration time [s], within the instrument's limits.
        lamp: factor on the light, scalar or shape (P,), such as one row of `lamp_drift`.

    Raises:
        InputError: as `electron_budget`; an integration time outside the limits.
    """
    shortest, longest = instrument.shortest_s, instrument.longest_s
    if not shortest * (1 - 1e-9) <= integration_s <= longest * (1 + 1e-9):
        raise InputError(
            f"an integration time of {integration_s:g} s",
            f"{shortest:g} s" if shortest == longest else f"{shortest:g} to {longest:g} s",
            place="integration_s",
        )
    lit = np.asarray(rate_electrons_per_s, dtype=np.float64) * np.asarray(lamp, dtype=np.float64)
    return electron_budget(instrument, lit) * integration_s


def counts_of_electrons(instrument: Instrument, electrons: ArrayLike) -> FloatArray:
    """Reading [counts] of a charge, without noise, limits and rounding; any shape.

    dark_level + e (1 + nonlinearity e / full_well) / electrons_per_count
    """
    charge = np.asarray(electrons, dtype=np.float64)
    curve = instrument.nonlinearity if instrument.has("nonlinearity") else 0.0
    bent = charge * (1.0 + curve * charge / instrument.full_well_electrons)
    return np.asarray(instrument.dark_level_counts + bent / instrument.electrons_per_count)


def electrons_of_counts(instrument: Instrument, counts: ArrayLike) -> FloatArray:
    """Charge [electrons] behind a reading; the inverse of `counts_of_electrons`, any shape.

    NaN where no charge gives that reading (above the top of a curve that bends down, which lies
    beyond full well).
    """
    reading = np.asarray(counts, dtype=np.float64) - instrument.dark_level_counts
    bent = reading * instrument.electrons_per_count
    curve = instrument.nonlinearity if instrument.has("nonlinearity") else 0.0
    root = 1.0 + 4.0 * curve * bent / instrument.full_well_electrons
    safe = np.where(root >= 0, root, 1.0)
    return np.where(root >= 0, 2.0 * bent / (1.0 + np.sqrt(safe)), np.nan)


def saturation_counts(instrument: Instrument) -> float:
    """Reading [counts] at which a pixel is full: full scale, or full well where that is lower."""
    full_well = float(counts_of_electrons(instrument, instrument.full_well_electrons))
    return min(float(instrument.full_scale_counts), full_well)


def simulate_counts(
    instrument: Instrument,
    rate_electrons_per_s: ArrayLike,
    integration_s: float,
    *,
    seed: int,
    shot: int,
    lamp: ArrayLike = 1.0,
) -> Counts:
    """One shot: the mean of `instrument.frames` frames, each with its own noise and rounding.

    The random numbers depend on (seed, shot) alone, not on the order of the shots.

    Args:
        instrument: the instrument.
        rate_electrons_per_s: signal [electrons/s] of every pixel, shape (P,); zeros for a dark.
        integration_s: integration time [s] of a frame.
        seed: seed of the visit.
        shot: number of the shot within the visit.
        lamp: factor on the light, scalar or shape (P,), such as one row of `lamp_drift`.

    Raises:
        InputError: as `expected_electrons`; a charge beyond 2**53 electrons; a key out of range.
    """
    mean = expected_electrons(instrument, rate_electrons_per_s, integration_s, lamp=lamp)
    if mean.max() > _MOST_ELECTRONS:
        raise InputError(f"a charge of {mean.max():g} electrons", "at most 2**53 electrons")
    photons = generator(Stream.SHOT_NOISE, seed, shot)
    reader = generator(Stream.READ_NOISE, seed, shot)
    read_noise = instrument.read_noise_electrons / instrument.electrons_per_count
    total = np.zeros_like(mean)
    saturated = np.zeros(mean.shape, dtype=np.bool_)
    floored = np.zeros(mean.shape, dtype=np.bool_)
    left = instrument.frames
    while left:
        block = (min(left, _CHUNK_FRAMES), mean.size)
        left -= block[0]
        if instrument.has("shot_noise"):
            charge = photons.poisson(mean, block).astype(np.float64)
        else:
            charge = np.broadcast_to(mean, block)
        if instrument.has("saturation"):
            saturated |= (charge >= instrument.full_well_electrons).any(axis=0)
            charge = np.minimum(charge, instrument.full_well_electrons)
        reading = counts_of_electrons(instrument, charge)
        if instrument.has("read_noise"):
            reading = reading + read_noise * reader.standard_normal(block)
        if instrument.has("quantisation"):
            reading = np.floor(reading + 0.5)
        if instrument.has("saturation"):
            saturated |= (reading >= instrument.full_scale_counts).any(axis=0)
            floored |= (reading < 0).any(axis=0)
            reading = np.clip(reading, 0, instrument.full_scale_counts)
        total += reading.sum(axis=0)
    return Counts(
        counts=total / instrument.frames,
        saturated=saturated,
        floored=floored,
        frames=instrument.frames,
        integration_s=float(integration_s),
        full_scale_counts=instrument.full_scale_counts,
    )
