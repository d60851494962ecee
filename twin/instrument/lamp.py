"""The drift of a lamp over the shots of a visit: noise that is the same at every wavelength."""

from __future__ import annotations

import numpy as np

from twin.errors import InputError
from twin.instrument.spec import Instrument
from twin.instrument.streams import Stream, generator
from twin.spectra import FloatArray


def tilt_shape(instrument: Instrument) -> FloatArray:
    """Shape of the tilt: -1 at the first pixel, +1 at the last, linear in nm, shape (P,)."""
    wavelength = np.asarray(instrument.wavelength_nm, dtype=np.float64)
    if wavelength.size == 1:
        return np.zeros(1)
    span = wavelength[-1] - wavelength[0]
    return np.asarray(2.0 * (wavelength - wavelength[0]) / span - 1.0)


def lamp_drift(instrument: Instrument, shots: int, *, seed: int, lamp: int = 0) -> FloatArray:
    """Factors on the light of a sequence of shots.

    Level and tilt are random walks that start at 0 with the first shot; a flicker of the level,
    independent from shot to shot, comes on top:

        factor[k, p] = exp(flicker[k] + sum_{i=1..k} (walk[i] + tilt_walk[i] tilt[p]))

    Fewer shots give the beginning of the same sequence.

    Args:
        instrument: its `lamp_flicker`, `lamp_walk` and `lamp_tilt_walk` are the standard
            deviations; with "lamp_drift" off every factor is exactly 1.
        shots: number of shots, dark ones included.
        seed: seed of the visit.
        lamp: number of the lamp (such as 0 for the panels, 1 for the beam); lamps drift
            independently.

    Returns:
        Factors near 1, shape (shots, P).

    Raises:
        InputError: a negative number of shots, seed or lamp.
    """
    if shots < 0:
        raise InputError(f"{shots} shots", "a number of at least 0", place="shots")
    tilt = tilt_shape(instrument)
    if not instrument.has("lamp_drift"):
        return np.ones((shots, tilt.size))
    normal = generator(Stream.LAMP, seed, lamp).standard_normal((shots, 3))
    steps = normal[:, 1:] * (instrument.lamp_walk, instrument.lamp_tilt_walk)
    steps[:1] = 0.0
    walk = np.cumsum(steps, axis=0)
    flicker = normal[:, :1] * instrument.lamp_flicker
    return np.asarray(np.exp(flicker + walk[:, :1] + walk[:, 1:] * tilt))


def lamp_covariance(instrument: Instrument, first: int, second: int) -> FloatArray:
    """Covariance of the logarithms of `lamp_drift` between two shots, shape (P, P).

        flicker^2 [first == second] + min(first, second) (walk^2 + tilt_walk^2 tilt tilt^T)

    The ratio of two readings of shots a and b has the relative covariance
    C(a, a) + C(b, b) - C(a, b) - C(b, a): fully correlated over wavelength but for the tilt.
    """
    tilt = tilt_shape(instrument)
    if not instrument.has("lamp_drift"):
        return np.zeros((tilt.size, tilt.size))
    walk = instrument.lamp_walk**2 + instrument.lamp_tilt_walk**2 * np.outer(tilt, tilt)
    flicker = instrument.lamp_flicker**2 if first == second else 0.0
    return np.asarray(flicker + min(first, second) * walk)
