"""What the corrections of the described bench would report of a world, without noise.

    light of the world (either engine) -> what happens to it before the detector -> bands of the
    pixels -> counts by the world's instrument -> dark, nonlinearity and stray light undone as
    described -> ratios

The formulas are those of `twin.instrument` and `twin.measurement`, on expected values.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from twin.bench import Background
from twin.effects.readout import Readout
from twin.effects.world import (
    BEAM_REFERENCE,
    BLACK,
    BLACK_REFERENCE,
    COLLIMATED,
    LIT,
    UNDER_PANELS,
    WHITE,
    WHITE_REFERENCE,
    Rates,
    World,
)
from twin.errors import InputError
from twin.instrument import (
    Instrument,
    MultispectralChip,
    counts_of_electrons,
    electrons_of_counts,
)
from twin.materials import lamp, reflectance
from twin.spectra import FloatArray, Spectral

PAIRS = ((BLACK, WHITE_REFERENCE), (WHITE, WHITE_REFERENCE), (COLLIMATED, BEAM_REFERENCE))
FEWEST = 4
"""Wavelengths that a cubic spline takes."""
DARKEST = 1e-3
"""Share of a reading that is light at least, whatever else a world takes it for."""
SIGMA_OF_WIDTH = 1.0 / np.sqrt(8.0 * np.log(2.0))


def expected_intensities(
    world: World,
    light: FloatArray,
    wavelength_nm: FloatArray,
    readout: Readout | None = None,
) -> FloatArray:
    """Relative intensities that the described corrections report of a world's light.

    Args:
        world: the world.
        light: noiseless relative intensities of the world's bench, shape (W, S, 3), from either
            engine, at the labelled wavelengths.
        wavelength_nm: labels of the wavelengths [nm], shape (W,), increasing; their mean stands
            for that over all pixels where stray light wants it.
        readout: brightness and exposures; None plans them.

    Returns:
        Black, white and collimated, shape (W, S, 3). Where nothing happens after the light, the
        white is the described one, and pixels have no width, it is the light itself, exactly.

    Raises:
        InputError: shapes that do not fit, or light that no detector can read.
    """
    wavelength = np.asarray(wavelength_nm, dtype=np.float64)
    given = np.asarray(light, dtype=np.float64)
    if given.shape != (wavelength.size, len(world.samples), 3):
        raise InputError(
            f"light of shape {given.shape}",
            f"({wavelength.size}, {len(world.samples)}, 3): wavelengths, samples, captures",
            place="light",
        )
    if not after_light(world):
        return _banded(world, given, wavelength)
    plan = readout or Readout.plan(world.described_bench, world.described_samples, wavelength)
    rates = light_rates(world, given, wavelength, plan)
    for step in world.steps:
        rates = step(rates)
    return _ratios(world, rates, plan)


def after_light(world: World) -> bool:
    """Whether anything differs from the description after the light leaves the sample."""
    true, said = world.bench, world.described_bench
    return bool(
        world.steps
        or world.offset_counts
        or world.shift_nm
        or world.shift_after_reference_nm
        or true.instrument != said.instrument
        or true.background.white.reflectance != said.background.white.reflectance
        or true.background.white.gloss != said.background.white.gloss
    )


def light_rates(world: World, light: FloatArray, wavelength: FloatArray, plan: Readout) -> Rates:
    """Light of all captures on the pixels, wavelengths and widths of the world's instrument."""
    true, said = world.bench, world.described_bench
    rho = _to_detector(true.background.white, wavelength)
    described_rho = _to_detector(said.background.white, wavelength)
    black = _to_detector(true.background.black, wavelength)
    sources = (true.panel_spectrum, true.beam.spectrum)
    # what the lamp and its optics give, whatever white reflects it
    lit = (
        _behind(world, plan, plan.white, WHITE_REFERENCE) / described_rho,
        _behind(world, plan, plan.beam, BEAM_REFERENCE),
    )
    count = light.shape[1]
    relative = {
        WHITE_REFERENCE: np.tile(rho, (count, 1)),
        BLACK_REFERENCE: np.tile(black, (count, 1)),
        BEAM_REFERENCE: np.ones_like(plan.beam),
        **dict(zip((BLACK, WHITE, COLLIMATED), light.transpose(2, 1, 0), strict=True)),
    }
    rows = np.empty((count, len(LIT), wavelength.size))
    for capture, values in relative.items():
        beam = int(capture not in UNDER_PANELS)
        rows[:, capture] = _seen(
            world, wavelength, lit[beam], sources[beam], values,
            of_sample=capture in (BLACK, WHITE, COLLIMATED),
        )  # fmt: skip
    lamps = np.stack([lamp(source, wavelength) for source in sources])
    return Rates(wavelength, rows, plan.exposure, rho, lamps)


def known_light(world: World, readout: Readout) -> Readout:
    """The readout of a visit to a known world, with the light behind its readings.

    Worlds are then judged in the light of that one; else every world is one that gave the readings.
    """
    return replace(
        readout,
        white=_behind(world, readout, readout.white, WHITE_REFERENCE),
        beam=_behind(world, readout, readout.beam, BEAM_REFERENCE),
        planned=True,
    )


def _behind(world: World, plan: Readout, read: FloatArray, capture: int) -> FloatArray:
    """Light behind readings (S, W) of a reference in a world: its stray light and offset are in it.

    Where a lamp is dark they are much of what is read, and their effects go with it.
    """
    if plan.planned:
        return read
    instrument = world.bench.instrument
    light = np.array(read)
    if world.offset_counts:
        for sample, seconds in enumerate(plan.integration_s[:, capture]):
            own = _at(instrument, plan.gain[sample, capture])
            counts = own.dark_level_counts + world.offset_counts
            light[sample] -= electrons_of_counts(own, counts) / seconds
    if instrument.has("stray_light"):
        stray = instrument.stray_light_fraction
        light = (light - stray * light.mean(axis=1, keepdims=True)) / (1.0 - stray)
    return np.asarray(np.maximum(light, DARKEST * read))


def _seen(
    world: World,
    wavelength: FloatArray,
    lit: FloatArray,
    source: Spectral,
    relative: FloatArray,
    *,
    of_sample: bool,
) -> FloatArray:
    """Signal lit x relative, (S, W), where and as widely as the pixels really look."""
    shift = world.shift_nm + (world.shift_after_reference_nm if of_sample else 0.0)
    variance = _variance(world, wavelength)
    if shift == 0.0 and not np.any(variance):
        return np.asarray(lit * relative)
    wider = world.bench.instrument.fwhm_nm != world.described_bench.instrument.fwhm_nm
    if wavelength.size < FEWEST and (shift or wider):
        raise InputError(
            f"{wavelength.size} wavelengths", f"{FEWEST} or more to follow a shift or a width",
            place="wavelength_nm",
        )  # fmt: skip
    looks = _looks(wavelength.tobytes(), source, shift, variance.tobytes())
    return np.asarray(lit * (relative @ looks.T))


def _banded(world: World, light: FloatArray, wavelength: FloatArray) -> FloatArray:
    """Light (W, S, 3) as relative intensities where all is as described: by the pixels' width."""
    bench = world.described_bench
    variance = _variance(world, wavelength)
    if not np.any(variance):
        return light.copy()
    rho = _to_detector(bench.background.white, wavelength)
    found = np.empty_like(light)
    for source, columns, white in (
        (bench.panel_spectrum, [0, 1], rho), (bench.beam.spectrum, [2], np.ones_like(rho)),
    ):  # fmt: skip
        looks = _looks(wavelength.tobytes(), source, 0.0, variance.tobytes())
        seen = np.einsum("vw,wsc->vsc", looks, light[..., columns])
        found[..., columns] = (white / (looks @ white))[:, None, None] * seen
    return found


@lru_cache(maxsize=256)
def _looks(wavelength_nm: bytes, source: Spectral, shift_nm: float, variance: bytes) -> FloatArray:
    """What pixels see of lit x relative over the lamp's light at their labels, (W, W).

    The relative part follows a cubic spline and the lamp its own spectrum, which is known between
    the wavelengths. A Gaussian band of variance v is a mean of three places, exact to the fifth
    order (Gauss-Hermite: Abramowitz and Stegun 1964, 25.4.46); below 0 it takes off as much.
    """
    wavelength, own = np.frombuffer(wavelength_nm), np.frombuffer(variance)
    if wavelength.size < FEWEST:
        return np.eye(wavelength.size)
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(wavelength, np.eye(wavelength.size), axis=0)
    here = lamp(source, wavelength)

    def at(place: FloatArray) -> FloatArray:
        return np.asarray((lamp(source, place) / here)[:, None] * spline(place))

    place, away = wavelength + shift_nm, np.sqrt(3.0 * np.abs(own))
    found = at(place)
    if np.any(own):
        beside = 0.5 * (at(place - away) + at(place + away))
        found = found + np.sign(own)[:, None] * (beside - found) / 3.0
    found.flags.writeable = False
    return found


def _variance(world: World, wavelength: FloatArray) -> FloatArray:
    """Of the bands of a spectrometer's pixels at wavelengths [nm^2], (W,).

    Of a chip what is beyond the described one: its bands are too wide and too far apart for a
    spline between them, and what it is fitted with has them in it.
    """
    true, said = world.bench.instrument, world.described_bench.instrument
    if not true.has("bandwidth"):
        return np.zeros(wavelength.size)
    own = (np.asarray(true.fwhm_nm) * SIGMA_OF_WIDTH) ** 2
    if isinstance(true, MultispectralChip):
        own = own - (np.asarray(said.fwhm_nm) * SIGMA_OF_WIDTH) ** 2
    return np.asarray(np.interp(wavelength, np.asarray(true.wavelength_nm), own))


def _ratios(world: World, rates: Rates, plan: Readout) -> FloatArray:
    """Counts of the world's instrument, corrected as described, over their references."""
    true, said = world.bench.instrument, world.described_bench.instrument
    linear = np.empty_like(rates.light)
    # a fit may ask for a detector that cannot be: what is no number is refused below
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        for capture in range(len(LIT)):
            for sample, light in enumerate(rates.light[:, capture]):
                seconds, gain = plan.integration_s[sample, capture], plan.gain[sample, capture]
                own, described = _at(true, gain), _at(said, gain)
                stray = own.stray_light_fraction if own.has("stray_light") else 0.0
                warm = own.dark_current_electrons_per_s if own.has("dark_current") else 0.0
                budget = (1.0 - stray) * light + stray * light.mean() + warm
                counts = counts_of_electrons(own, budget * seconds) + world.offset_counts
                dark = counts_of_electrons(own, warm * seconds)
                charge = electrons_of_counts(described, counts) - electrons_of_counts(
                    described, dark
                )
                undone = described.stray_light_fraction if described.has("stray_light") else 0.0
                linear[sample, capture] = (charge - undone * charge.mean()) / seconds
    if not np.all(np.isfinite(linear)):
        raise InputError(
            "counts that no charge gives", "a curve of the detector that can be undone"
        )
    white = _to_detector(world.described_bench.background.white, rates.wavelength_nm)
    scale = (white, white, np.ones_like(white))
    columns = [
        factor * linear[:, top] / linear[:, bottom]
        for factor, (top, bottom) in zip(scale, PAIRS, strict=True)
    ]
    return np.asarray(np.stack(columns, axis=-1).transpose(1, 0, 2))


def _to_detector(background: Background, wavelength_nm: FloatArray) -> FloatArray:
    """What a bare background shows the detector, (W,): its mirror part goes past."""
    return reflectance(background.reflectance, wavelength_nm) * (1.0 - background.gloss)


def _at(instrument: Instrument, gain: float) -> Instrument:
    if isinstance(instrument, MultispectralChip) and instrument.gain != gain:
        return instrument.model_copy(update={"gain": float(gain)})
    return instrument
