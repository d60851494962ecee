"""A stress plan that runs in seconds, and estimators for the tests."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from estimators import BeerEstimator, BeerSettings, BenchModel, EstimateResult
from estimators.result import gaussian_quantiles
from scenarios.stress.plan import StressPlan
from scenarios.stress.score import COVERAGES, Answers
from twin.measurement.relative import RelativeIntensities
from twin.toml import validate


def tiny(**changes: Any) -> dict[str, Any]:
    """A plan as a table; changes replace top-level keys."""
    table: dict[str, Any] = {
        "title": "Small enough for a test",
        "estimators": [{"name": "beer"}],
        "points": 12,
        "albedos_per_medium": 3,
        "points_per_visit": 6,
        "thickness_mm": [0.4],
        "light": {"relative_error": 0.05, "most_paths": 4096},
        "map": {"albedo_count": 4, "sigma_t_count": 4, "g_count": 2, "paths": 64},
        "protocol": {"repeats": 1, "reference_repeats": 1},
    }
    return table | changes


def tiny_plan(**changes: Any) -> StressPlan:
    return validate(tiny(**changes), StressPlan)


def write(path: Path, table: dict[str, Any]) -> Path:
    path.write_text(tomli_w.dumps(table), encoding="utf-8")
    return path


@dataclass(frozen=True)
class ToySettings:
    """Options of the toy."""

    raises: bool = False
    share: float = 1.0
    """Factor on the errors that it states."""


class Toy:
    """Beer's sigma_t, as sure as it is told to be, or an exception."""

    name = "toy"

    def __init__(self, model: BenchModel, settings: ToySettings) -> None:
        self.model, self.settings = model, settings

    def estimate(self, intensities: RelativeIntensities) -> EstimateResult:
        if self.settings.raises:
            raise ZeroDivisionError("the toy is broken")
        result = BeerEstimator(self.model, BeerSettings()).estimate(intensities)
        covariance = result.covariance * self.settings.share**2
        quantile = result.quantile.copy()
        quantile[..., 1] = gaussian_quantiles(
            result.sigma_t_per_mm, result.standard_error[:, 1] * self.settings.share
        )
        return replace(result, covariance=covariance, quantile=quantile)


def normal_answers(
    truth: np.ndarray, sigma: np.ndarray, *, bias: float = 0.0, stated: float = 1.0, seed: int = 1
) -> Answers:
    """Estimates with normal errors: `sigma` wide, `bias` (in sigma) off, stated as `stated` sigma.

    Shapes: truth (N, 3), sigma (3,).
    """
    random = np.random.Generator(np.random.Philox(key=[seed, 7]))
    value = truth + sigma * (bias + random.standard_normal(truth.shape))
    # Normal deviates of (1 + coverage) / 2.
    deviate = np.array([0.6744897501960817, 1.6448536269514722, 1.959963984540054])
    assert len(deviate) == len(COVERAGES)
    half = stated * sigma * deviate[:, None, None]
    return Answers(
        value=value,
        sigma=np.broadcast_to(stated * sigma, truth.shape).copy(),
        interval=np.stack([value - half, value + half], axis=1),
        identifiable=np.ones(truth.shape, dtype=bool),
        status=np.zeros(len(truth), dtype=np.int64),
    )


def some_truth(count: int) -> np.ndarray:
    """Shape (N, 3)."""
    random = np.random.Generator(np.random.Philox(key=[3, 9]))
    low, high = np.array([0.2, 0.5, 0.0]), np.array([0.95, 8.0, 0.8])
    return low + (high - low) * random.random((count, 3))
