"""A simulated visit: light transport, lamps, instrument, every shot of the protocol."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from scenarios.light_between import NAMES as SAMPLE_LIGHT
from scenarios.light_between import LightBetween
from twin.errors import InputError
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from scenarios.console import Progress
    from scenarios.scenario import Protocol, Scenario
    from twin.instrument import Exposure, Instrument
    from twin.measurement import Measurement, Shot, Truth
    from twin.transport import NoiselessCaptures

PANELS, BEAM = 0, 1
"""The two lamps, as `twin.instrument.lamp_drift` numbers them."""

LAMP_OF = {
    "dark": PANELS,
    "white_reference": PANELS,
    "black_reference": PANELS,
    "black": PANELS,
    "white": PANELS,
    "beam_reference": BEAM,
    "collimated": BEAM,
}
"""The lamp that shines in each capture; a dark has none, whatever its number."""

Settings = dict[str, "Exposure"]
"""Exposure of every capture of one sample but its darks."""

Signals = dict[str, FloatArray]
"""Signal [electrons/s] of every capture of one sample, shape (P,) each."""


@dataclass(frozen=True)
class _Planned:
    """One shot of the protocol before it is taken."""

    capture: str
    sample: int
    exposure: Exposure


def simulate_visit(
    scenario: Scenario,
    *,
    seed: int | None = None,
    paths: int | None = None,
    threads: int | None = None,
    progress: Callable[[float, float], None] | None = None,
) -> Measurement:
    """Simulate one visit: noisy counts of every shot of the scenario's protocol.

    Light transport runs at the wavelengths of `scenario.wavelength`. Its relative intensities,
    and nothing else, are interpolated (`scenarios.light_between`) to the finer wavelengths at
    which the instrument's bands want the light; lamps and backgrounds are evaluated there. The
    signals, in the light of a perfect diffuser in the background plane:

        white reference: lamp F rho_w      black reference: lamp F rho_b      beam reference: beam
        black, white:    lamp F I          collimated:      beam I_c

    with the irradiance factor F of each sample's background plane.

    Args:
        scenario: what to simulate.
        seed: seed of every random number; None takes the scenario's.
        paths: light paths per wavelength; None takes the scenario's.
        threads: threads of the Monte Carlo; the result does not depend on them.
        progress: called with (done, total).

    Returns:
        The measurement, with the truth on the instrument's fine wavelengths; `provenance.scenario`
        holds the scenario with this seed and number of paths.

    Raises:
        InputError: a spectrum or the wavelength grid does not serve the instrument.
    """
    scenario = scenario.settled(seed=seed, paths=paths)
    check_cover(scenario)
    noiseless = _transport(scenario, threads, progress)
    return next(noisy_visits(scenario, noiseless, [scenario.simulation.seed]))


def noisy_visits(
    scenario: Scenario,
    noiseless: Sequence[NoiselessCaptures],
    seeds: Iterable[int],
    *,
    disturb: Callable[[list[Signals], list[Settings], FloatArray], list[Signals]] | None = None,
) -> Iterator[Measurement]:
    """Visits in the same light that differ in lamps and noise: `simulate_visit` from the light on.

    Args:
        scenario: what is measured; its own seed is not used.
        noiseless: captures of every sample by the light transport.
        seeds: of lamps and noise, one for each visit.
        disturb: what happens to the signals before the detector, given the exposures and the
            wavelengths of the light; None: nothing.

    Yields:
        One measurement for each seed.
    """
    from twin.instrument import fine_grid_nm
    from twin.measurement import Captures, Measurement, Provenance

    instrument = scenario.bench.instrument
    fine = fine_grid_nm(instrument)
    rates = [_signals(scenario, number, fine, noiseless) for number in range(len(noiseless))]
    settings = [_settings(scenario, rates[0], own) for own in rates]
    if disturb is not None:
        rates = disturb(rates, settings, fine)
    plan = list(_plan(scenario.protocol, settings))
    pixels = np.asarray(instrument.wavelength_nm, dtype=np.float64)
    light_se, truth = _light_se(scenario, noiseless, fine, pixels), _truth(scenario, fine)
    for seed in seeds:
        simulation = scenario.simulation.model_copy(update={"seed": seed})
        seeded = scenario.model_copy(update={"simulation": simulation})
        shots, counts, saturated = _shots(seeded, plan, rates)
        yield Measurement(
            bench=scenario.bench,
            samples=scenario.samples,
            captures=Captures(tuple(shots), pixels, counts, saturated, light_se=light_se),
            provenance=Provenance(
                origin="simulated",
                seed=seed,
                serial_numbers=(str(instrument.serial),),
                software=software(),
                scenario=seeded.text,
                notes=_notes(scenario, settings),
            ),
            truth=truth,
        )


def software() -> str:
    """Name and version of this program."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return f"benchtwin {version('benchtwin')}"
    except PackageNotFoundError:
        return "benchtwin (not installed)"


def check_cover(scenario: Scenario) -> None:
    """Check that light transport is computed wherever the instrument sees light.

    Raises:
        InputError: the wavelength grid is narrower.
    """
    from twin.instrument import fine_grid_nm

    grid, fine = scenario.wavelength, fine_grid_nm(scenario.bench.instrument)
    if grid.start_nm > fine[0] + 1e-6 or grid.stop_nm < fine[-1] - 1e-6:
        raise InputError(
            f"{grid.start_nm:g} to {grid.stop_nm:g} nm",
            f"a grid that covers {fine[0]:g} to {fine[-1]:g} nm, which the instrument sees",
            place="wavelength",
            remedy="Widen the grid, or narrow the instrument's range.",
        )


def _transport(
    scenario: Scenario, threads: int | None, progress: Progress | None
) -> list[NoiselessCaptures]:
    from twin.transport import captures

    count = len(scenario.samples)
    results = []
    for number, sample in enumerate(scenario.samples):

        def part(done: float, total: float, /, before: int = number) -> None:
            if progress is not None:
                progress(before + done / total, count)

        results.append(
            captures(
                scenario.bench,
                sample,
                scenario.wavelength.wavelength_nm,
                paths=scenario.simulation.paths,
                seed=_sample_seed(scenario.simulation.seed, number),
                threads=threads,
                progress=part,
            )
        )
    return results


def _sample_seed(seed: int, number: int) -> int:
    """The Monte Carlo's seed for one sample: samples are independent of each other."""
    key = np.array([seed, number], dtype=np.uint64)
    return int(np.random.Generator(np.random.Philox(key=key)).integers(1 << 63))


def _signals(
    scenario: Scenario, number: int, fine: FloatArray, noiseless: Sequence[NoiselessCaptures]
) -> dict[str, FloatArray]:
    """Signal [electrons/s] of every capture of one sample, shape (P,) each."""
    from twin.instrument import electron_rates
    from twin.materials import lamp, reflectance

    bench, instrument, mine = scenario.bench, scenario.bench.instrument, noiseless[number]
    panels, beam = lamp(bench.panel_spectrum, fine), lamp(bench.beam.spectrum, fine)
    # The mirror part of a glossy background sends the panels' light past the detector.
    rho = {
        f"{name}_reference": reflectance(own.reflectance, fine) * (1.0 - own.gloss)
        for name, own in (("black", bench.background.black), ("white", bench.background.white))
    }
    between = LightBetween(bench, scenario.samples[number], mine)
    seen = dict(zip(SAMPLE_LIGHT, between.intensities(fine), strict=True))
    # The instrument's rate is that of the first sample's white; other planes get more or less.
    height = mine.white_reference_factor / noiseless[0].white_reference_factor
    lit = panels * height
    under_panels = {name: lit * value for name, value in rho.items()}
    under_panels |= {name: lit * seen[name] for name in ("black", "white")}
    under_beam = {"beam_reference": beam, "collimated": beam * seen["collimated"]}

    rates = {"dark": np.zeros(len(instrument.wavelength_nm))}
    for spectra, reference, peak in (
        (under_panels, panels * rho["white_reference"], instrument.white_rate_electrons_per_s),
        (under_beam, beam, instrument.beam_rate_electrons_per_s),
    ):
        values = electron_rates(
            instrument,
            fine,
            np.array(list(spectra.values())),
            reference=reference,
            peak_rate_electrons_per_s=peak,
        )
        rates |= dict(zip(spectra, values, strict=True))
    return rates


def _settings(
    scenario: Scenario, first: dict[str, FloatArray], own: dict[str, FloatArray]
) -> Settings:
    """Exposures of one sample: references set them, for all samples those of the first."""
    from twin.instrument import Exposure, auto_exposure

    protocol, instrument = scenario.protocol, scenario.bench.instrument
    if protocol.exposure != "auto":
        fixed = Exposure(instrument, protocol.exposure, float("nan"), "no")
        return {name: fixed for name in LAMP_OF if name != "dark"}
    by_lamp = {
        PANELS: auto_exposure(instrument, first["white_reference"], fraction=protocol.fill),
        BEAM: auto_exposure(instrument, first["beam_reference"], fraction=protocol.fill),
    }
    settings = {name: by_lamp[lamp] for name, lamp in LAMP_OF.items() if name != "dark"}
    if own["collimated"].any():
        settings["collimated"] = _longer(
            by_lamp[BEAM],
            auto_exposure(instrument, own["collimated"], fraction=protocol.fill),
            protocol.collimated_longest_s,
        )
    return settings


def _longer(reference: Exposure, own: Exposure, longest_s: float) -> Exposure:
    """The exposure of the collimated capture: its own, not over the limit, if that is more."""
    time = max(min(own.integration_s, longest_s), reference.integration_s)
    limited = replace(own, integration_s=time)
    gained = time * _gain(own.instrument) / (reference.integration_s * _gain(reference.instrument))
    return limited if gained > 1 else reference


def _gain(instrument: Instrument) -> float:
    """A chip's gain; a spectrometer has none."""
    return float(getattr(instrument, "gain", 1.0))


def _notes(scenario: Scenario, settings: list[Settings]) -> tuple[str, ...]:
    """What the automatic exposure could not reach."""
    notes = []
    for capture in ("white_reference", "beam_reference"):
        exposure = settings[0][capture]
        if exposure.limited != "no":
            notes.append(
                f"{capture} reaches {exposure.fraction:.2f} of full scale at the {exposure.limited}"
                f" setting, not {scenario.protocol.fill:g}"
            )
    return tuple(notes)


def _plan(protocol: Protocol, settings: list[Settings]) -> Iterator[_Planned]:
    """Every shot in the order in which it is taken.

    Per sample: darks at every setting; references; each capture with its repeats; references
    again. Darks and references belong to the sample: they are taken with the holder at its height.
    """
    for sample, exposures in enumerate(settings):
        distinct = {(e.integration_s, _gain(e.instrument)): e for e in exposures.values()}
        for exposure in distinct.values():
            for _ in range(protocol.reference_repeats):
                yield _Planned("dark", sample, exposure)
        yield from _references(protocol, sample, exposures)
        for capture in protocol.order:
            for _ in range(protocol.repeats):
                yield _Planned(capture, sample, exposures[capture])
        if protocol.references == "first_and_last":
            yield from _references(protocol, sample, exposures)


def _references(protocol: Protocol, sample: int, exposures: Settings) -> Iterator[_Planned]:
    for capture in ("white_reference", "black_reference", "beam_reference"):
        for _ in range(protocol.reference_repeats):
            yield _Planned(capture, sample, exposures[capture])


def _shots(
    scenario: Scenario,
    plan: list[_Planned],
    rates: list[dict[str, FloatArray]],
) -> tuple[list[Shot], FloatArray, NDArray[np.bool_]]:
    """The readings: shots (N of them), counts and saturation flags, shape (N, P) each."""
    from twin.instrument import lamp_drift, simulate_counts
    from twin.measurement import Shot

    seed = scenario.simulation.seed
    drift = [
        lamp_drift(scenario.bench.instrument, len(plan), seed=seed, lamp=lamp)
        for lamp in (PANELS, BEAM)
    ]
    taken: Counter[tuple[str, int, float, float]] = Counter()
    shots: list[Shot] = []
    counts, saturated, time = [], [], 0.0
    for number, planned in enumerate(plan):
        exposure = planned.exposure
        instrument, gain = exposure.instrument, _gain(exposure.instrument)
        reading = simulate_counts(
            instrument,
            rates[planned.sample][planned.capture],
            exposure.integration_s,
            seed=seed,
            shot=number,
            lamp=drift[LAMP_OF[planned.capture]][number],
        )
        key = (planned.capture, planned.sample, exposure.integration_s, gain)
        shots.append(
            Shot(
                capture=planned.capture,
                integration_s=exposure.integration_s,
                sample=scenario.samples[planned.sample].name,
                repeat=taken[key],
                averages=instrument.frames,
                time_s=round(time, 6),
                gain=gain,
            )
        )
        taken[key] += 1
        counts.append(reading.counts)
        saturated.append(reading.saturated)
        time += exposure.integration_s * instrument.frames + scenario.protocol.pause_s
    return shots, np.array(counts), np.array(saturated)


def _light_se(
    scenario: Scenario,
    noiseless: Sequence[NoiselessCaptures],
    fine: FloatArray,
    pixels: FloatArray,
) -> FloatArray:
    """Standard errors of the light between the transport's wavelengths, shape (S, 3, P).

    Nothing is interpolated, and no error of it added, where the instrument sees the transport's
    own wavelengths alone.
    """
    rows = []
    for sample, each in zip(scenario.samples, noiseless, strict=True):
        if np.isin(fine, each.wavelength_nm).all():
            own = [getattr(each, f"{name}_se") for name in SAMPLE_LIGHT]
            rows.append(np.array([np.interp(pixels, each.wavelength_nm, error) for error in own]))
        else:
            rows.append(LightBetween(scenario.bench, sample, each).standard_error(pixels))
    return np.array(rows)


def _truth(scenario: Scenario, fine: FloatArray) -> Truth:
    from twin.materials import optical_properties
    from twin.measurement import Truth

    found = [optical_properties(sample.material or "", fine) for sample in scenario.samples]
    return Truth(
        fine,
        np.array([each.albedo for each in found]),
        np.array([each.sigma_t_per_mm for each in found]),
        np.array([each.g for each in found]),
    )
