"""What a person sets and knows before the estimate: the exposure, and the noise to expect."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from twin.errors import InputError
from twin.instrument.sensor import (
    counts_of_electrons,
    electron_budget,
    electrons_of_counts,
    saturation_counts,
)
from twin.instrument.spec import CHIP_GAINS, Instrument, MultispectralChip
from twin.spectra import FloatArray


@dataclass(frozen=True)
class Exposure:
    """Settings found by `auto_exposure`.

    Attributes:
        instrument: the instrument as it is then set (a chip may have another gain).
        integration_s: integration time [s].
        fraction: expected reading of the brightest pixel over the saturated reading.
        limited: "no", or that the "shortest" (or lowest gain) or "longest" (highest gain) setting
            was reached before the wanted fraction.
    """

    instrument: Instrument
    integration_s: float
    fraction: float
    limited: Literal["no", "shortest", "longest"]


def auto_exposure(
    instrument: Instrument,
    rate_electrons_per_s: ArrayLike,
    *,
    fraction: float = 0.8,
) -> Exposure:
    """Settings at which the brightest pixel of a reference reads a fraction of full scale.

    A spectrometer changes its integration time, a chip its gain (its time is in its registers).

    Args:
        instrument: the instrument.
        rate_electrons_per_s: signal [electrons/s] of the reference, shape (P,).
        fraction: wanted reading over the saturated reading, above 0 and below 1.

    Raises:
        InputError: a fraction out of range or below the dark level, a reference without light,
            or one that saturates at the shortest time (the lowest gain).
    """
    if not 0 < fraction < 1:
        raise InputError(f"{fraction:g}", "a fraction above 0 and below 1", place="fraction")
    budget = electron_budget(instrument, rate_electrons_per_s)
    if not np.any(np.asarray(rate_electrons_per_s, dtype=np.float64) > 0):
        raise InputError("a reference without light", "light in some pixel", place="reference")
    charge_per_s = float(budget.max())
    if isinstance(instrument, MultispectralChip):
        return _chip_exposure(instrument, charge_per_s, fraction)
    wanted = fraction * saturation_counts(instrument)
    if wanted <= instrument.dark_level_counts:
        raise InputError(
            f"{fraction:g} of full scale, {wanted:g} counts",
            f"more than the dark level of {instrument.dark_level_counts:g} counts",
            place="fraction",
        )
    ideal = float(electrons_of_counts(instrument, wanted)) / charge_per_s
    time = min(max(ideal, instrument.shortest_s), instrument.longest_s)
    reached = _fraction(instrument, charge_per_s * time)
    if reached >= 1:
        raise _saturates(instrument, f"the shortest integration time, {time:g} s")
    limited: Literal["no", "shortest", "longest"] = "no"
    if time > ideal:
        limited = "shortest"
    elif time < ideal:
        limited = "longest"
    return Exposure(instrument, time, reached, limited)


def count_variance(
    instrument: Instrument,
    counts: ArrayLike,
    dark: ArrayLike,
    averages: int | None = None,
) -> FloatArray:
    """Variance [counts^2] to expect of a reading: what a corrector weighs its data with.

        (slope^2 e + (read_noise / electrons_per_count)^2 + 1/12) / averages

    with the charge e behind max(counts - dark, 0) + max(dark - dark_level, 0) and the slope
    [counts/electron] of the sensor's curve there. The lamp's drift is not in it: that is
    correlated over wavelength (`lamp_covariance`). Contributions that are off are left out.
    Source: the photon transfer curve (Janesick 2007, "Photon Transfer", equation 3.5); 1/12 is the
    variance of rounding.

    Args:
        instrument: the instrument.
        counts: reading [counts], any shape.
        dark: dark reading [counts] at the same integration time, a shape that broadcasts.
        averages: frames averaged; None takes the instrument's.

    Returns:
        The variance, shape of counts and dark broadcast; NaN where `electrons_of_counts` is.

    Raises:
        InputError: fewer than one frame.
    """
    frames = instrument.frames if averages is None else averages
    if frames < 1:
        raise InputError(f"{frames} averages", "at least 1", place="averages")
    reading, dark_counts = np.broadcast_arrays(
        np.asarray(counts, dtype=np.float64), np.asarray(dark, dtype=np.float64)
    )
    level = instrument.dark_level_counts
    above = np.maximum(reading - dark_counts, 0.0) + np.maximum(dark_counts - level, 0.0)
    charge = electrons_of_counts(instrument, level + above)
    curve = instrument.nonlinearity if instrument.has("nonlinearity") else 0.0
    slope = 1.0 + 2.0 * curve * charge / instrument.full_well_electrons
    slope = slope / instrument.electrons_per_count
    variance = slope**2 * charge if instrument.has("shot_noise") else np.zeros_like(charge)
    if instrument.has("read_noise"):
        read = instrument.read_noise_electrons / instrument.electrons_per_count
        variance = variance + read**2
    if instrument.has("quantisation"):
        variance = variance + 1.0 / 12.0
    return np.asarray(variance / frames)


def _chip_exposure(chip: MultispectralChip, charge_per_s: float, fraction: float) -> Exposure:
    charge = charge_per_s * chip.integration_s
    settings = [chip.model_copy(update={"gain": gain}) for gain in CHIP_GAINS]
    reached = [_fraction(setting, charge) for setting in settings]
    if reached[0] >= 1:
        raise _saturates(chip, f"the lowest gain, {CHIP_GAINS[0]:g}")
    fitting = [index for index, value in enumerate(reached) if value <= fraction]
    chosen = fitting[-1] if fitting else 0
    limited: Literal["no", "shortest", "longest"] = "no"
    if not fitting:
        limited = "shortest"
    elif chosen == len(settings) - 1:
        limited = "longest"
    return Exposure(settings[chosen], chip.integration_s, reached[chosen], limited)


def _fraction(instrument: Instrument, charge: float) -> float:
    reading = float(counts_of_electrons(instrument, min(charge, instrument.full_well_electrons)))
    return reading / saturation_counts(instrument)


def _saturates(instrument: Instrument, setting: str) -> InputError:
    return InputError(
        f"a reference that saturates at {setting}",
        f"a brightest pixel below {saturation_counts(instrument):g} counts",
        place="reference",
        remedy="Dim the lamp, close the aperture, or use a less sensitive instrument.",
    )
