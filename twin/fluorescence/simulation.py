"""A simulated visit to the fluorescence bench: lights, sample, instrument, every shot."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.fluorescence.donaldson import DonaldsonMatrix
from twin.fluorescence.fluorophores import example
from twin.fluorescence.illuminants import Filtered, Monochromatic, binned_light
from twin.fluorescence.setup import FluorescenceProtocol, FluorescenceSetup, detector_response
from twin.fluorescence.visit import FluorescenceShot, FluorescenceVisit
from twin.instrument import (
    Exposure,
    Instrument,
    auto_exposure,
    electron_rates,
    lamp_drift,
    simulate_counts,
)
from twin.materials import reflectance
from twin.measurement import Provenance
from twin.spectra import FloatArray

PANEL, XENON = 1000, 1001
"""Numbers of the lamps that several illuminants share; an LED has its place in the set."""


@dataclass(frozen=True)
class _Planned:
    kind: str
    illuminant: int
    exposure: Exposure


def simulate_fluorescence(
    setup: FluorescenceSetup,
    material: DonaldsonMatrix,
    *,
    protocol: FluorescenceProtocol | None = None,
    seed: int = 1,
    scenario: str = "",
    software: str = "",
) -> FluorescenceVisit:
    """Simulate one visit: noisy counts of dark, white and sample under every illuminant.

    The light of each illuminant on the bins of the matrix, times the matrix (or the white), goes
    through `twin.instrument` shot by shot, with a drift of its own for every lamp. One common
    scale: the brightest white brings the detector's `white_rate_electrons_per_s`.

    Args:
        setup: the bench.
        material: the sample; cut to the wavelengths of the set-up. Noise below the diagonal and
            negative cells of a measured matrix cannot be lit: they are set to 0 and counted in
            the truth's notes.
        protocol: shots and settings; None takes the defaults.
        seed: seed of every random number.
        scenario: kept in the provenance.
        software: name and version of the program, likewise.

    Raises:
        InputError: a material without the wavelengths of the set-up, an illuminant without light
            there, a white that saturates at the shortest setting.
    """
    protocol = FluorescenceProtocol() if protocol is None else protocol
    truth = material.on(setup.emission_nm, setup.excitation_nm).physical()
    rates = _rates(setup, truth, protocol)
    settings = [
        _exposure(setup.detector, np.maximum(*pair), protocol)
        for pair in zip(rates["white"], rates["sample"], strict=True)
    ]
    plan = list(_plan(protocol, settings))
    shots, counts, saturated = _shots(setup, protocol, plan, rates, seed)
    notes = [
        f"white under {light.name!r} reaches {setting.fraction:.2f} of full scale at the"
        f" {setting.limited} setting, not {protocol.fill:g}"
        for light, setting in zip(setup.lights, settings, strict=True)
        if setting.limited != "no"
    ]
    return FluorescenceVisit(
        setup,
        tuple(shots),
        counts,
        saturated,
        sample=material.name or "sample",
        provenance=Provenance(
            origin="simulated", seed=seed, serial_numbers=(str(setup.detector.serial),),
            software=software, scenario=scenario, notes=tuple(notes),
        ),
        truth=truth,
    )  # fmt: skip


def lamp_numbers(setup: FluorescenceSetup) -> NDArray[np.int_]:
    """Which lamp each illuminant is, (J,): filters share the panel, a monochromator its lamp."""
    numbers = []
    for index, each in enumerate(setup.lights):
        if isinstance(each, Filtered):
            numbers.append(PANEL)
        elif isinstance(each, Monochromatic):
            numbers.append(XENON)
        else:
            numbers.append(index)
    return np.array(numbers)


def _rates(
    setup: FluorescenceSetup, truth: DonaldsonMatrix, protocol: FluorescenceProtocol
) -> dict[str, FloatArray]:
    """Signal [electrons/s] of white and sample under every illuminant, shape (J, K) each."""
    emission, excitation = setup.emission_nm, setup.excitation_nm
    light = binned_light(setup.lights, excitation, drive=protocol.drive, warmer_k=protocol.warmer_k)
    later = binned_light(
        setup.lights, excitation, drive=protocol.drive,
        warmer_k=protocol.warmer_k + protocol.warming_k,
    )  # fmt: skip
    if setup.white_material is None:
        same = np.abs(emission[:, None] - excitation[None, :]) < 1e-6
        white = DonaldsonMatrix(
            same * reflectance(setup.white, emission)[:, None], emission, excitation
        )
    else:
        white = example(setup.white_material, emission, excitation)
    spectra = {"white": white.reflected(light), "sample": truth.reflected(later)}
    seen = spectra["white"] @ detector_response(setup.detector, emission).T
    if seen.max() <= 0.0:
        raise InputError(
            "no light of any illuminant in any channel", "illuminants that the detector sees",
            place="lights",
        )  # fmt: skip
    brightest = spectra["white"][int(np.argmax(seen.max(axis=1)))]
    return {
        kind: electron_rates(
            setup.detector, emission, value, reference=brightest,
            peak_rate_electrons_per_s=setup.detector.white_rate_electrons_per_s,
        )
        for kind, value in spectra.items()
    }  # fmt: skip


def _exposure(
    instrument: Instrument, brighter: FloatArray, protocol: FluorescenceProtocol
) -> Exposure:
    if protocol.exposure != "auto":
        return Exposure(instrument, protocol.exposure, float("nan"), "no")
    return auto_exposure(instrument, brighter, fraction=protocol.fill)


def _gain(exposure: Exposure) -> float:
    return float(getattr(exposure.instrument, "gain", 1.0))


def _plan(protocol: FluorescenceProtocol, settings: list[Exposure]) -> Iterator[_Planned]:
    """Darks at every setting; the white under all illuminants; the sample; the white again."""
    distinct = {(each.integration_s, _gain(each)): each for each in settings}
    for exposure in distinct.values():
        for _ in range(protocol.white_repeats):
            yield _Planned("dark", -1, exposure)
    rounds = [("white", protocol.white_repeats), ("sample", protocol.repeats)]
    if protocol.references == "first_and_last":
        rounds.append(rounds[0])
    for kind, repeats in rounds:
        for number, exposure in enumerate(settings):
            for _ in range(repeats):
                yield _Planned(kind, number, exposure)


def _shots(
    setup: FluorescenceSetup,
    protocol: FluorescenceProtocol,
    plan: list[_Planned],
    rates: dict[str, FloatArray],
    seed: int,
) -> tuple[list[FluorescenceShot], FloatArray, NDArray[np.bool_]]:
    """The readings: shots, counts and saturation flags, shape (N, K) each."""
    passes = setup.passes.astype(int)
    rounds = int(passes.max()) + 1
    lamps = lamp_numbers(setup)
    # A chip with two passes sees the lamp at two moments of one shot.
    drift = {
        int(lamp): lamp_drift(setup.detector, len(plan) * rounds, seed=seed, lamp=int(lamp))
        for lamp in np.unique(lamps)
    }
    channel = np.arange(passes.size)
    zeros = np.zeros(passes.size)
    taken: Counter[tuple[str, int, float, float]] = Counter()
    shots, counts, saturated, time = [], [], [], 0.0
    before: tuple[str, int] | None = None
    for number, planned in enumerate(plan):
        exposure = planned.exposure
        dark = planned.illuminant < 0
        lamp = (
            np.ones(passes.size)
            if dark
            else drift[int(lamps[planned.illuminant])][number * rounds + passes, channel]
        )
        reading = simulate_counts(
            exposure.instrument,
            zeros if dark else rates[planned.kind][planned.illuminant],
            exposure.integration_s, seed=seed, shot=number, lamp=lamp,
        )  # fmt: skip
        if before is not None and before[0] != planned.kind:
            time += protocol.swap_s
        elif before is not None and before[1] != planned.illuminant:
            time += protocol.switch_s
        before = (planned.kind, planned.illuminant)
        key = (planned.kind, planned.illuminant, exposure.integration_s, _gain(exposure))
        shots.append(
            FluorescenceShot(
                kind=planned.kind,
                integration_s=exposure.integration_s,
                illuminant="" if dark else setup.lights[planned.illuminant].name,
                repeat=taken[key],
                averages=exposure.instrument.frames,
                time_s=round(time, 6),
                gain=_gain(exposure),
            )
        )
        taken[key] += 1
        counts.append(reading.counts)
        saturated.append(reading.saturated)
        time += exposure.integration_s * exposure.instrument.frames * rounds
    return shots, np.array(counts), np.array(saturated)
