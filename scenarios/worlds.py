"""Visits to a world that is not as it was described: the sim-to-real gap, made on purpose.

The light is that of the world's bench, the counts are its instrument's, and what happens between
them happens; the measurement carries the description that a person would have written, and
nothing of the truth but the material.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from scenarios import simulate
from scenarios.simulate import Settings, Signals, check_cover, noisy_visits
from twin.errors import InputError
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from scenarios.scenario import Scenario
    from twin.effects import World
    from twin.instrument import Instrument
    from twin.measurement import Measurement
    from twin.transport import NoiselessCaptures


def simulate_world(
    scenario: Scenario,
    world: World,
    *,
    seed: int | None = None,
    paths: int | None = None,
    threads: int | None = None,
    progress: Callable[[float, float], None] | None = None,
) -> Measurement:
    """Simulate one visit to a world by the Monte Carlo and its instrument.

    In the world that the scenario describes this is `scenarios.simulate_visit`, byte for byte.

    Args:
        scenario: the description, with the true material of the samples; the measurement gets
            its bench and its samples.
        world: what is true; its samples must be those of the scenario, whatever happened to them.
        seed: of every random number; None takes the scenario's.
        paths: light paths per wavelength; None takes the scenario's.
        threads: of the Monte Carlo; the result does not depend on them.
        progress: called with (done, total).

    Raises:
        InputError: a world of other samples, a spectrum or a wavelength grid that does not serve.
    """
    scenario = scenario.settled(seed=seed, paths=paths)
    light = world_light(scenario, world, threads=threads, progress=progress)
    return next(world_visits(scenario, world, light, [scenario.simulation.seed]))


def world_light(
    scenario: Scenario,
    world: World,
    *,
    threads: int | None = None,
    progress: Callable[[float, float], None] | None = None,
) -> list[NoiselessCaptures]:
    """The light of a world by the Monte Carlo: what `world_visits` can share between seeds.

    Raises:
        InputError: as `simulate_world`.
    """
    from twin.effects import world_captures

    true = _true(scenario, world)
    check_cover(true)
    return world_captures(
        world.changed(samples=true.samples),
        true.wavelength.wavelength_nm,
        paths=scenario.simulation.paths,
        seeds=[
            simulate._sample_seed(scenario.simulation.seed, n) for n in range(len(true.samples))
        ],
        threads=threads,
        progress=progress,
    )


def world_visits(
    scenario: Scenario,
    world: World,
    light: Sequence[NoiselessCaptures],
    seeds: Iterable[int],
) -> Iterator[Measurement]:
    """Visits in the same light of a world that differ in lamps and noise, one for each seed.

    Args:
        scenario: the description.
        world: what is true.
        light: of every sample, from `world_light`.
        seeds: of lamps and noise.
    """
    true = _true(scenario, world)
    pixels = np.asarray(scenario.bench.instrument.wavelength_nm, dtype=np.float64)

    def disturb(rates: list[Signals], settings: list[Settings], fine: FloatArray) -> list[Signals]:
        return _disturbed(true, world, light, rates, settings, fine)

    seeds = list(seeds)
    for seed, visit in zip(seeds, noisy_visits(true, light, seeds, disturb=disturb), strict=True):
        captures = visit.captures
        if captures is None:
            raise InputError("a visit without counts", "counts", place="captures")
        lit = np.array([shot.capture != "dark" for shot in captures.shots])
        counts = captures.counts + world.offset_counts * lit[:, None]
        simulation = scenario.simulation.model_copy(update={"seed": seed})
        described = scenario.model_copy(update={"simulation": simulation})
        yield replace(
            visit,
            bench=scenario.bench,
            samples=scenario.samples,
            captures=replace(captures, wavelength_nm=pixels, counts=counts),
            provenance=visit.provenance.model_copy(update={"scenario": described.text}),
        )


def _true(scenario: Scenario, world: World) -> Scenario:
    """The scenario with the world's bench, the wavelengths at which it really looks, its samples.

    Raises:
        InputError: a world of other samples.
    """
    names = [sample.name for sample in scenario.samples]
    if [sample.name for sample in world.samples] != names:
        found = ", ".join(sample.name for sample in world.samples)
        raise InputError(f"a world of {found}", f"the samples {', '.join(names)}", place="world")
    samples = tuple(
        true.model_copy(update={"material": own.material})
        for true, own in zip(world.samples, scenario.samples, strict=True)
    )
    instrument = _looking(world.bench.instrument, world.shift_nm)
    bench = world.bench.model_copy(update={"instrument": instrument})
    return scenario.model_copy(update={"bench": bench, "samples": samples})


def _looking(instrument: Instrument, shift_nm: float) -> Instrument:
    """The instrument whose pixels look that much farther to the red."""
    from twin.instrument import MultispectralChip

    if shift_nm == 0.0:
        return instrument
    fields: dict[str, Any]
    if isinstance(instrument, MultispectralChip):
        fields = {
            "channels": tuple(
                channel.model_copy(update={"centre_nm": channel.centre_nm + shift_nm})
                for channel in instrument.channels
            )
        }
    else:
        fields = {"pixels_nm": tuple(each + shift_nm for each in instrument.wavelength_nm)}
    return instrument.model_copy(update=fields)


def _disturbed(
    true: Scenario,
    world: World,
    light: Sequence[NoiselessCaptures],
    rates: list[Signals],
    settings: list[Settings],
    fine: FloatArray,
) -> list[Signals]:
    """What reaches the detector: a scale that moved after the references, then the steps."""
    from twin.effects import LIT, Rates
    from twin.instrument import band_average
    from twin.materials import lamp, reflectance

    bench = true.bench
    rates = [dict(own) for own in rates]
    if world.shift_after_reference_nm:
        instrument = _looking(bench.instrument, world.shift_after_reference_nm)
        moved = true.model_copy(
            update={"bench": bench.model_copy(update={"instrument": instrument})}
        )
        check_cover(moved)
        for number, own in enumerate(rates):
            own |= _moved_signals(moved, true, number, fine, light)
    if not world.steps:
        return rates
    pixels = np.asarray(bench.instrument.wavelength_nm, dtype=np.float64)
    stack = np.array([[own[name] for name in LIT] for own in rates])
    exposure = np.array(
        [
            [each[name].integration_s * getattr(each[name].instrument, "gain", 1.0) for name in LIT]
            for each in settings
        ]
    )
    lamps = np.stack([lamp(bench.panel_spectrum, fine), lamp(bench.beam.spectrum, fine)])
    white = reflectance(bench.background.white.reflectance, fine)
    disturbed = Rates(
        pixels, stack, exposure, band_average(bench.instrument, fine, white, lamps[0]),
        band_average(bench.instrument, fine, lamps),
    )  # fmt: skip
    for step in world.steps:
        disturbed = step(disturbed)
    return [
        own | dict(zip(LIT, np.maximum(lit, 0.0), strict=True))
        for own, lit in zip(rates, disturbed.light, strict=True)
    ]


def _moved_signals(
    moved: Scenario,
    still: Scenario,
    number: int,
    fine: FloatArray,
    light: Sequence[NoiselessCaptures],
) -> Signals:
    """Signals of the captures with a sample by an instrument whose scale has moved.

    Their scale is that of the unmoved reference: `signals` makes the brightest pixel of the moved
    one collect the nominal rate.
    """
    from twin.instrument import electron_rates, fine_grid_nm
    from twin.materials import lamp, reflectance

    bench = still.bench
    other = fine_grid_nm(moved.bench.instrument)
    found = simulate._signals(moved, number, other, light)
    white = reflectance(bench.background.white.reflectance, other)
    own_white = reflectance(bench.background.white.reflectance, fine)
    kept: Signals = {}
    for names, spectra in (
        (
            ("black", "white"),
            (
                lamp(bench.panel_spectrum, other) * white,
                lamp(bench.panel_spectrum, fine) * own_white,
            ),
        ),
        (("collimated",), (lamp(bench.beam.spectrum, other), lamp(bench.beam.spectrum, fine))),
    ):
        # peaks of the two references in one unit: their ratio undoes the other normalisation
        peaks = [
            electron_rates(
                each.bench.instrument, grid, spectrum, reference=np.ones_like(spectrum),
                peak_rate_electrons_per_s=1.0,
            ).max()
            for each, grid, spectrum in ((moved, other, spectra[0]), (still, fine, spectra[1]))
        ]  # fmt: skip
        for name in names:
            kept[name] = found[name] * (peaks[0] / peaks[1])
    return kept
