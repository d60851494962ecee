"""Instruments: from spectra to counts.

Description of an instrument -> `electron_rates` of the light -> `auto_exposure` on a reference ->
`simulate_counts` shot by shot, with `lamp_drift` over the shots. `count_variance` and
`lamp_covariance` are the noise model for whoever corrects the counts.
"""

from __future__ import annotations

from twin.instrument.exposure import Exposure, auto_exposure, count_variance
from twin.instrument.lamp import lamp_covariance, lamp_drift
from twin.instrument.optics import band_average, electron_rates, fine_grid_nm, response_matrix
from twin.instrument.sensor import (
    Counts,
    counts_of_electrons,
    electrons_of_counts,
    expected_electrons,
    fixed_pattern,
    saturation_counts,
    simulate_counts,
)
from twin.instrument.spec import (
    AS7341_CHANNELS,
    Channel,
    Contribution,
    Instrument,
    MultispectralChip,
    Spectrometer,
)

__all__ = [
    "AS7341_CHANNELS",
    "Channel",
    "Contribution",
    "Counts",
    "Exposure",
    "Instrument",
    "MultispectralChip",
    "Spectrometer",
    "auto_exposure",
    "band_average",
    "count_variance",
    "counts_of_electrons",
    "electron_rates",
    "electrons_of_counts",
    "expected_electrons",
    "fine_grid_nm",
    "fixed_pattern",
    "lamp_covariance",
    "lamp_drift",
    "response_matrix",
    "saturation_counts",
    "simulate_counts",
]
