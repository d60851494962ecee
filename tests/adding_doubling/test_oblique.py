"""A beam that opens or leans: closed forms for clear samples, the Monte Carlo for turbid ones."""

from __future__ import annotations

import math

import numpy as np
import pytest

from twin.adding_doubling import ObliqueBeam, captures_model
from twin.bench import Bench, Sample
from twin.effects import World, candidate, world_captures
from twin.effects.fast import FastLight
from twin.materials import OpticalProperties
from twin.transport.geometry import accepted_cosine, beam_reference_share

WAVELENGTH = np.array([500.0, 550.0, 600.0])
MATERIAL = np.array([[0.9, 3.0, 0.75], [0.6, 2.0, 0.85], [0.95, 1.2, 0.9]])
SAMPLES = (Sample(name="s", thickness_mm=0.4, n=1.5), Sample(name="t", thickness_mm=0.9, n=1.5))
NAMES = ("black", "white", "collimated")


def bare() -> Bench:
    return Bench().model_copy(update={"covers_above": (), "covers_below": ()})


def beam(bench: Bench, divergence: float, tilt: float) -> Bench:
    own = {**bench.beam.model_dump(), "divergence_deg": divergence, "tilt_deg": tilt}
    return Bench.model_validate({**bench.model_dump(), "beam": own})


def fresnel(cosine: float, n: float) -> float:
    inside = math.sqrt(1.0 - (1.0 - cosine**2) / n**2)
    s = (cosine - n * inside) / (cosine + n * inside)
    p = (inside - n * cosine) / (inside + n * cosine)
    return 0.5 * (s * s + p * p)


def test_a_clear_sample_takes_the_longer_way() -> None:
    bench, cosine, sigma = bare(), math.cos(math.radians(8.0)), np.array([0.5, 2.0, 4.0])
    own = captures_model(
        bench, SAMPLES, WAVELENGTH, beam=ObliqueBeam(cosine, np.array([1.0, 1.0]), 0.0, 8.0)
    )
    found = np.asarray(own.forward(own.parameters(0.0, sigma, 0.0)))[..., 2]
    inside, r = math.sqrt(1.0 - (1.0 - cosine**2) / 2.25), fresnel(cosine, 1.5)
    for number, sample in enumerate(SAMPLES):
        fade = np.exp(-sigma * sample.thickness_mm / inside)
        expected = (1.0 - r) ** 2 * fade / (1.0 - r**2 * fade**2)
        assert np.allclose(found[:, number], expected, rtol=1e-6)


def test_an_upright_beam_is_the_one_without() -> None:
    upright = ObliqueBeam(1.0, np.ones(2), 0.0, 0.0)
    one, other = (
        captures_model(Bench(), SAMPLES, WAVELENGTH, beam=each) for each in (None, upright)
    )
    seen = [np.asarray(each.forward(each.parameters(*MATERIAL.T))) for each in (one, other)]
    assert np.allclose(*seen, rtol=2e-6)


@pytest.mark.parametrize(("divergence", "tilt"), [(0.5, 0.0), (3.0, 0.0), (0.0, 0.8), (0.6, 0.7)])
def test_directions_that_are_accepted(divergence: float, tilt: float) -> None:
    """By random directions, even in the solid angle of their projection."""
    random = np.random.Generator(np.random.Philox(key=3))
    bench = beam(Bench(), divergence, tilt)
    sine = math.sin(math.radians(divergence)) * np.sqrt(random.random(400_000))
    azimuth, lean = 2.0 * math.pi * random.random(400_000), math.radians(tilt)
    up = math.cos(lean) * np.sqrt(1.0 - sine**2) - math.sin(lean) * sine * np.cos(azimuth)
    kept = up >= math.cos(math.radians(bench.detector.acceptance_deg)) - 1e-12
    assert np.mean(kept) == pytest.approx(beam_reference_share(bench, 0.1), abs=4e-3)
    expected = float(np.mean(1.0 - up[kept] ** 2))
    assert 1.0 - accepted_cosine(bench) ** 2 == pytest.approx(expected, rel=1e-2)


@pytest.mark.parametrize(("name", "value"), [("beam_divergence", 5.0), ("beam_tilt", 0.9)])
def test_collimated_light_agrees_with_the_monte_carlo(name: str, value: float) -> None:
    world = World.nominal(Bench(), SAMPLES)
    moved = candidate(world, name).apply(world, (value,))
    fast = FastLight(WAVELENGTH)
    found = (fast.captures(moved, MATERIAL) / fast.captures(world, MATERIAL) - 1.0)[..., 2]
    medium = OpticalProperties(WAVELENGTH, *MATERIAL.T, None)
    light = [
        world_captures(each, WAVELENGTH, properties=medium, paths=1 << 15, seeds=[7, 8])
        for each in (world, moved)
    ]
    value_, error = (
        np.stack([[getattr(own, f"collimated{end}") for own in each] for each in light])
        for end in ("", "_se")
    )
    change = (value_[1] / value_[0] - 1.0).T
    noise = np.hypot(*(error / value_)).T
    # what leaves the detector's spot is left out: a tenth of the change
    allowed = 4.0 * noise + 0.1 * np.abs(change) + 1e-5
    assert np.all(np.abs(found - change) < allowed)
    if name == "beam_divergence":
        together = 4.0 * np.sqrt(np.sum(noise**2)) / noise.size + 0.1 * change.mean()
        assert abs(found.mean() - change.mean()) < together
        assert change.mean() > 2.0 * together, "no change must not explain it"
