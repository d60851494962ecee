"""The truth of a simulated visit as its instrument sees it: averaged over every band."""

from __future__ import annotations

import numpy as np

from twin.errors import InputError
from twin.instrument import band_average
from twin.measurement.model import Measurement, Truth


def seen_truth(measurement: Measurement) -> Truth | None:
    """The truth at the wavelengths of the data, averaged over the instrument's bands.

    A pixel measures the average of the light over its band, which to first order is the light of
    the average material: an estimate is to be compared with that, not with the material at the
    band's centre. Between two bends of the spectra both are the same. The average is one of
    constant light; a lamp that changes within a band moves it by a second-order amount.

    Args:
        measurement: a visit.

    Returns:
        The truth at the visit's wavelengths; at the centres of the bands where the truth is not
        known all over them; None for a visit without a truth.
    """
    truth = measurement.truth
    if truth is None:
        return None
    pixels = measurement.wavelength_nm
    instrument = measurement.bench.instrument
    rows = np.concatenate([truth.albedo, truth.sigma_t_per_mm, truth.g])
    at_centre = np.array([np.interp(pixels, truth.wavelength_nm, row) for row in rows])
    seen = at_centre
    if np.array_equal(pixels, np.asarray(instrument.wavelength_nm)):
        try:
            seen = band_average(instrument, truth.wavelength_nm, rows)
        except InputError:
            seen = at_centre
    albedo, sigma_t, g = np.split(seen, 3)
    return Truth(pixels, np.clip(albedo, 0.0, 1.0), sigma_t, g)
