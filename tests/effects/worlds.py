"""Worlds that the tests of effects share: few wavelengths, so that one program serves all."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from scenarios.scenario import Scenario
from twin.bench import Bench, Medium, Sample
from twin.effects import Candidate, EffectEngine, World, catalogue
from twin.spectra import SpectralTable

WAVELENGTH = np.linspace(440.0, 680.0, 7)
QUIET = (
    "shot_noise", "read_noise", "quantisation", "nonuniformity", "lamp_drift", "averages",
    "saturation",
)  # fmt: skip


def smooth_medium() -> Medium:
    """Spectra without kinks, so that a spline between 10 nm follows them."""
    grid = np.arange(380.0, 741.0, 1.0)

    def table(value: np.ndarray) -> SpectralTable:
        return SpectralTable(wavelength_nm=tuple(grid.tolist()), value=tuple(value.tolist()))

    phase = (grid - 380.0) / 120.0
    return Medium(
        albedo=table(0.93 + 0.04 * np.sin(phase)), sigma_t_per_mm=table(3.0 - 0.3 * phase), g=0.6
    )


def scenario(*off: str, **instrument: float) -> Scenario:
    """Two thicknesses under a quiet spectrometer."""
    described = {
        "kind": "spectrometer", "start_nm": 420.0, "stop_nm": 680.0, "step_nm": 10.0,
        "bandwidth_nm": 5.0, "off": (*QUIET, *off),
    }  # fmt: skip
    samples = tuple(
        Sample(name=f"{t} mm", thickness_mm=t, n=1.4, material=smooth_medium()) for t in (0.2, 0.6)
    )
    return Scenario(
        title="effects",
        bench=Bench.model_validate({"instrument": described | instrument}),
        samples=samples,
        wavelength={"start_nm": 400.0, "stop_nm": 700.0, "step_nm": 5.0},
        protocol={"repeats": 1, "reference_repeats": 1},
    )


def material(count: int = len(WAVELENGTH)) -> np.ndarray:
    """Albedo, sigma_t [1/mm] and g, shape (W, 3)."""
    x = np.linspace(0.0, 1.0, count)
    return np.stack([0.9 + 0.08 * x, 4.0 - 1.5 * x, 0.75 - 0.1 * x], axis=-1)


def samples(*thickness_mm: float, n: float = 1.4) -> tuple[Sample, ...]:
    return tuple(Sample(name=f"s{t:g}", thickness_mm=t, n=n) for t in thickness_mm)


@lru_cache
def world() -> World:
    return World.nominal(Bench(), samples(0.3, 0.6))


@lru_cache
def sharp() -> World:
    """The same with pixels that have no width."""
    return World.nominal(
        Bench.model_validate({"instrument": {"kind": "spectrometer", "off": ("bandwidth",)}}),
        samples(0.3, 0.6),
    )


@lru_cache
def engine() -> EffectEngine:
    return EffectEngine(world(), WAVELENGTH, least_paths=1024)


def candidates() -> dict[str, Candidate]:
    """Every candidate of a translucent visit by name."""
    return {each.name: each for each in catalogue().candidates(world())[0]}


def typical(candidate: Candidate, scales: float = 1.0) -> tuple[float, ...]:
    """Values one prior scale (or more) away, where the sign allows."""
    return tuple(
        p.nominal + (-scales if p.sign == "negative" else scales) * p.prior_scale
        for p in candidate.parameters
    )
