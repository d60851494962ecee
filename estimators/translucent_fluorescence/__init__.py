"""Absorption, scattering and fluorescence of a translucent sample together, with intervals.

The translucent bench lit by a set of LEDs one after another, read by a spectrometer:
`LedMeasurement` in, `estimate` out. `design_information` says what a design can tell.
"""

from __future__ import annotations

from estimators.translucent_fluorescence.correction import Correction, correction_of
from estimators.translucent_fluorescence.data import LedMeasurement
from estimators.translucent_fluorescence.fit import (
    FluorescentEstimate,
    Prior,
    estimate,
    estimate_blind,
)
from estimators.translucent_fluorescence.information import design_information
from estimators.translucent_fluorescence.model import FluorescentForward, State

__all__ = [
    "Correction",
    "FluorescentEstimate",
    "FluorescentForward",
    "LedMeasurement",
    "Prior",
    "State",
    "correction_of",
    "design_information",
    "estimate",
    "estimate_blind",
]
