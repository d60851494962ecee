"""What happens after the light: the closed form against counts, taken and corrected."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from scenarios.scenario import Scenario
from scenarios.worlds import world_visits
from tests.effects.worlds import scenario
from twin.adding_doubling import captures
from twin.bench import Bench, Sample
from twin.effects import Readout, World, candidate, catalogue, expected_intensities, known_light
from twin.errors import InputError
from twin.measurement import Measurement, relative_intensities
from twin.transport import NoiselessCaptures

SIGNAL = (
    "drift[black]", "drift[panels]", "drift[collimated]", "reference_plane", "ambient_light",
    "roughness", "fluorescence", "dark_offset", "stray_light", "nonlinearity", "gain_step",
    "wavelength_shift[all]", "wavelength_shift[after the references]", "white_ageing",
    "gloss[white]",
)  # fmt: skip
SAID = scenario("bandwidth")


@lru_cache
def plane(bench: Bench, sample: Sample, wavelength_nm: tuple[float, ...]) -> NoiselessCaptures:
    """Noiseless light by the fast engine."""
    return captures(bench, sample, np.array(wavelength_nm))


def at_pixels(described: Scenario, changed: World) -> np.ndarray:
    """Light of a world at the labels of the pixels, (W, S, 3)."""
    pixels = described.bench.instrument.wavelength_nm
    rows = [plane(changed.bench, sample, pixels) for sample in changed.samples]
    names = ("black", "white", "collimated")
    return np.stack([np.stack([getattr(r, n) for n in names], axis=-1) for r in rows], axis=1)


def visit(described: Scenario, changed: World) -> Measurement:
    grid = tuple(described.wavelength.wavelength_nm.tolist())
    light = [plane(changed.bench, sample, grid) for sample in changed.samples]
    return next(world_visits(described, changed, light, [1]))


def reported(measurement: Measurement) -> np.ndarray:
    return relative_intensities(measurement).value.transpose(2, 0, 1)


@lru_cache
def nominal() -> tuple[World, Measurement, np.ndarray]:
    world = World.nominal(SAID.bench, SAID.samples)
    measurement = visit(SAID, world)
    return world, measurement, reported(measurement)


def test_every_signal_effect_is_tested() -> None:
    world = nominal()[0]
    found = catalogue().candidates(world)[0]
    families = {each.effect.name for each in found if each.engine == "signal"}
    assert families <= {name.partition("[")[0] for name in (*SIGNAL, "bandwidth")}


@pytest.mark.parametrize("name", SIGNAL)
def test_closed_form_agrees_with_counts(name: str) -> None:
    world, measurement, before = nominal()
    own = candidate(world, name)
    changed = own.apply(world, [p.nominal + 2.0 * p.prior_scale for p in own.parameters])
    pixels = np.asarray(SAID.bench.instrument.wavelength_nm)
    seen = reported(visit(SAID, changed))
    base = at_pixels(SAID, changed)
    known = known_light(world, Readout.of(measurement))
    found = expected_intensities(changed, base, pixels, known)
    # a shift leaves the outermost label without neighbours on one side
    seen, before, found, base = (each[1:-1] for each in (seen, before, found, base))
    size = np.abs(seen - before).max()
    assert size > 1e-4, "the effect is too small to test"
    # first order in the noise-free reference counts, that carry stray light and the lamp's band
    assert np.abs(found - seen).max() < max(1e-4, 5e-3 * size)
    assert np.abs(base - seen).max() > 0.5 * size, "without the closed form the test must fail"


@pytest.mark.parametrize(("name", "value"), [("stray_light", 0.02), ("dark_offset", -150.0)])
def test_readings_of_the_references_hold_the_effect_too(name: str, value: float) -> None:
    """A person has the readings of the bench as it is, its stray light and its offset in them."""
    world = nominal()[0]
    changed = candidate(world, name).apply(world, (value,))
    pixels = np.asarray(SAID.bench.instrument.wavelength_nm)
    taken = visit(SAID, changed)
    readout = Readout.of(taken)
    light = at_pixels(SAID, world)
    found = expected_intensities(changed, light, pixels, readout)
    size = np.abs(reported(taken) - light).max()
    assert size > 1e-3
    assert np.abs(found - reported(taken)).max() < 0.01 * size
    as_light = expected_intensities(changed, light, pixels, replace(readout, planned=True))
    assert np.abs(as_light - reported(taken)).max() > 0.03 * size, "readings are no light"


def test_a_described_gloss_is_in_the_correction() -> None:
    """The bare white shows less than its certificate says, and the corrections know."""
    _, measurement, before = nominal()
    background = SAID.bench.background
    white = background.white.model_copy(update={"gloss": 0.2})
    bench = SAID.bench.model_copy(
        update={"background": background.model_copy(update={"white": white})}
    )
    glossy = relative_intensities(replace(measurement, bench=bench))
    seen = glossy.value.transpose(2, 0, 1)
    assert np.allclose(seen[..., :2], 0.8 * before[..., :2])
    assert np.array_equal(seen[..., 2], before[..., 2])


def test_wider_bands_blur_lamp_and_sample() -> None:
    described = scenario(step_nm=5.0)
    world = World.nominal(described.bench, described.samples)
    changed = candidate(world, "bandwidth").apply(world, (6.0,))
    pixels = np.asarray(described.bench.instrument.wavelength_nm)
    seen = [reported(visit(described, each)) for each in (world, changed)]
    sharp = scenario("bandwidth", step_nm=5.0)
    light = reported(visit(sharp, World.nominal(sharp.bench, sharp.samples)))
    readout = Readout.of(visit(described, world))
    inside = slice(4, -4)
    size = np.abs(seen[1] - seen[0])[inside].max()
    assert size > 1e-5
    for own, true in zip((world, changed), seen, strict=True):
        found = expected_intensities(own, light, pixels, readout)
        assert np.abs(found - true)[inside].max() < 0.1 * size
    assert np.abs(light - seen[0])[inside].max() > 0.25 * size, "without the bands it must fail"


def test_planned_readout_is_that_of_an_automatic_visit() -> None:
    _, measurement, _ = nominal()
    pixels = np.asarray(SAID.bench.instrument.wavelength_nm)
    taken = Readout.of(measurement)
    planned = Readout.plan(
        SAID.bench, SAID.samples, pixels, collimated_s=taken.integration_s[:, -1]
    )
    assert np.allclose(planned.integration_s[:, :3], taken.integration_s[:, :3], rtol=2e-3)
    assert np.allclose(planned.white[0], taken.white[0], rtol=5e-3)
    assert not taken.planned
    assert planned.planned


def test_shapes_and_few_wavelengths_are_answered() -> None:
    world = nominal()[0]
    with pytest.raises(InputError, match="wavelengths, samples, captures"):
        expected_intensities(world, np.ones((3, 2)), np.arange(3.0) + 500.0)
    shifted = candidate(world, "wavelength_shift[all]").apply(world, (0.5,))
    with pytest.raises(InputError, match="4 or more"):
        expected_intensities(shifted, np.ones((2, 2, 3)), np.array([500.0, 510.0]))
