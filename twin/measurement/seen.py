"""The truth of a simulated visit as its instrument sees it: averaged over every band."""

from __future__ import annotations

import numpy as np

from twin.errors import InputError
from twin.instrument import band_average
from twin.materials import lamp
from twin.measurement.model import Measurement, Truth
from twin.spectra import FloatArray, Spectral


def seen_truth(measurement: Measurement) -> Truth | None:
    """The truth at the wavelengths of the data, averaged over the instrument's bands.

    A pixel measures the average of the light over its band, which to first order is the light of
    the average material: an estimate is to be compared with that, not with the material at the
    band's centre. The average is weighted with the lamp: of the beam for sigma_t, of the panels
    for albedo and g. On the flank of a blue LED a band of 5 nm is seen almost 1 nm beside its
    centre, which is as much as the bend of the spectra within the band.

    Args:
        measurement: a visit.

    Returns:
        The truth at the visit's wavelengths; at the centres of the bands where the truth or
        the lamp is not known all over them; None for a visit without a truth.
    """
    truth = measurement.truth
    if truth is None:
        return None
    pixels = measurement.wavelength_nm
    instrument = measurement.bench.instrument
    whole = np.array_equal(pixels, np.asarray(instrument.wavelength_nm))

    def under(spectrum: Spectral, rows: FloatArray) -> FloatArray:
        if whole:
            try:
                light = lamp(spectrum, truth.wavelength_nm)
                return band_average(instrument, truth.wavelength_nm, rows, light)
            except InputError:
                pass  # the truth or the lamp is not known all over the bands
        return np.array([np.interp(pixels, truth.wavelength_nm, row) for row in rows])

    bench = measurement.bench
    albedo = under(bench.panel_spectrum, truth.albedo)
    sigma_t = under(bench.beam.spectrum, truth.sigma_t_per_mm)
    g = under(bench.panel_spectrum, truth.g)
    return Truth(pixels, np.clip(albedo, 0.0, 1.0), sigma_t, g)
