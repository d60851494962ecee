"""Donaldson matrices from captures under a few illuminants, with uncertainty."""

from __future__ import annotations

from estimators.fluorescence.export import mixture_of
from estimators.fluorescence.registry import fluorescence_estimator, fluorescence_names
from estimators.fluorescence.result import (
    FluorescenceEstimator,
    FluorescenceResult,
    FluorescenceStatus,
)

__all__ = [
    "FluorescenceEstimator",
    "FluorescenceResult",
    "FluorescenceStatus",
    "fluorescence_estimator",
    "fluorescence_names",
    "mixture_of",
]
