"""The case's light by the Monte Carlo, and what the spectrometer makes of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from scenarios.fluorescent_translucent.case import Case
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from estimators.translucent_fluorescence import LedMeasurement

DARK, REFERENCE, SAMPLES = range(3)
MOST_SHOTS = 1_000


@dataclass(frozen=True, eq=False)
class TrueCaptures:
    """Noiseless light of S samples at W wavelengths.

    Attributes:
        elastic: relative intensities black, white, collimated without emission, (S, 3, W).
        fluorescent: bispectral radiance factor per nm over black and white, (S, 2, W, W).
        elastic_se, fluorescent_se: standard errors.
    """

    elastic: FloatArray
    fluorescent: FloatArray
    elastic_se: FloatArray
    fluorescent_se: FloatArray

    def signal(self, lights: FloatArray, step_nm: FloatArray) -> FloatArray:
        """Light under every light in the light of a perfect diffuser, (L, S, 2, W)."""
        emitted = np.einsum("sboi,li->lsbo", self.fluorescent, lights * step_nm)
        return np.asarray(lights[:, None, None] * self.elastic[None, :, :2] + emitted)


def true_captures(
    case: Case,
    *,
    paths: int = 65_536,
    seed: int = 0,
    threads: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> TrueCaptures:
    """The light of the case on the whole finite bench, by the Monte Carlo.

    What the beam excites in the collimated capture is left out: about 1e-5 of the beam.

    Args:
        case: what to simulate.
        paths: for each wavelength and sample.
        seed: the same seed gives the same bytes.
        threads: None takes all processors.
        progress: called with (done, total) samples.
    """
    from twin.bispectral import trace_bispectral
    from twin.transport import captures

    elastic, fluorescent, elastic_se, fluorescent_se = [], [], [], []
    for number, sample in enumerate(case.samples):
        own = seed + 7 * number
        traced = trace_bispectral(
            case.bench, sample, case.properties, paths=paths, seed=own, threads=threads
        )
        beam = captures(
            case.bench,
            sample,
            case.wavelength_nm,
            properties=case.properties.optical(),
            paths=paths,
            seed=own,
            threads=threads,
        )
        # black and white from the engine of the elastic bench: it is the better one for them
        elastic.append(np.stack([beam.black, beam.white, beam.collimated]))
        elastic_se.append(np.stack([beam.black_se, beam.white_se, beam.collimated_se]))
        fluorescent.append(traced.fluorescent)
        fluorescent_se.append(traced.fluorescent_se)
        if progress is not None:
            progress(number + 1, len(case.samples))
    return TrueCaptures(*map(np.array, (elastic, fluorescent, elastic_se, fluorescent_se)))


def led_visit(case: Case, truth: TrueCaptures, *, seed: int = 0) -> LedMeasurement:
    """One visit under every LED: white reference, dark, and both backgrounds of every sample."""
    return _visit(case, truth, case.leds, seed)


def white_visit(case: Case, truth: TrueCaptures, *, seed: int = 0) -> LedMeasurement:
    """One visit under the bench's own broad lamp: what the seed's method measures."""
    from twin.materials import lamp

    white = lamp(case.bench.panel_spectrum, case.wavelength_nm)
    return _visit(case, truth, white[None, :], seed)


def _visit(case: Case, truth: TrueCaptures, lights: FloatArray, seed: int) -> LedMeasurement:
    from estimators.translucent_fluorescence import LedMeasurement
    from twin.materials import lamp

    bench = case.bench
    shots = _Shots(case, seed)
    spectra, signals, variances, light_variances = [], [], [], []
    signal = truth.signal(lights, case.properties.step_nm)
    rho = shots.rho_white
    # the Monte Carlo's own error of what is emitted: cells are independent over excitation
    emitted_var = np.einsum(
        "sboi,li->lsbo", truth.fluorescent_se**2, (lights * case.properties.step_nm) ** 2
    )
    for number, light in enumerate(lights):
        peak = float((light * rho).max())
        exposure, scale = shots.exposure(light * rho)
        reference, reference_var = shots.take(light * rho, exposure, scale)
        spectra.append(reference / rho / peak)
        light_variances.append(reference_var / (rho * peak) ** 2)
        own = [
            shots.take(signal[number, s, b], exposure, scale)
            for s in range(len(case.samples))
            for b in range(2)
        ]
        shape = (len(case.samples), 2, -1)
        signals.append(np.reshape([value / peak for value, _ in own], shape))
        variance = np.reshape([var / peak**2 for _, var in own], shape)
        variances.append(variance + emitted_var[number] / peak**2)
    beam = lamp(bench.beam.spectrum, case.wavelength_nm)
    exposure, scale = shots.exposure(beam)
    reference, reference_var = shots.take(beam, exposure, scale)
    collimated, collimated_var = [], []
    for s in range(len(case.samples)):
        value, var = shots.take(beam * truth.elastic[s, 2], exposure, scale)
        ratio = value / reference
        noise = (var + ratio**2 * reference_var) / reference**2
        collimated.append(ratio)
        collimated_var.append(noise + truth.elastic_se[s, 2] ** 2)
    instrument = bench.instrument
    level = float(np.hypot(instrument.lamp_flicker, instrument.lamp_walk))
    return LedMeasurement(
        case.wavelength_nm, np.array(spectra), np.array(signals), np.array(collimated),
        np.array(variances), np.array(light_variances), np.array(collimated_var), level,
        truth.elastic_se[:, :2],
    )  # fmt: skip


class _Shots:
    """Shots of one visit: counts, minus their dark, back in units of the light."""

    def __init__(self, case: Case, seed: int) -> None:
        from twin.instrument import lamp_drift
        from twin.materials import reflectance

        self.instrument = case.bench.instrument
        self.seed = seed
        self.shot = 0
        self.drift = lamp_drift(self.instrument, MOST_SHOTS, seed=seed)
        self.level = np.ones(len(case.wavelength_nm))
        self.rho_white = reflectance(case.bench.background.white.reflectance, case.wavelength_nm)

    def exposure(self, light: FloatArray) -> tuple[float, float]:
        """Integration time [s] and electrons/s per unit of light, for the brightest reference.

        The lamp is warmed up and referenced anew: its drift starts from here.
        """
        from twin.instrument import auto_exposure

        scale = self.instrument.white_rate_electrons_per_s / float(light.max())
        self.level = self.drift[self.shot]
        return auto_exposure(self.instrument, light * scale).integration_s, scale

    def take(
        self, light: FloatArray, integration_s: float, scale: float
    ) -> tuple[FloatArray, FloatArray]:
        """One shot and its dark: the light, (W,), and its variance."""
        from twin.instrument import count_variance, electrons_of_counts, simulate_counts

        instrument = self.instrument
        readings = []
        for rates, lamp in (
            (np.maximum(light, 0.0) * scale, self.drift[self.shot] / self.level),
            (np.zeros_like(light), 1.0),
        ):
            taken = simulate_counts(
                instrument, rates, integration_s, seed=self.seed, shot=self.shot, lamp=lamp
            )
            readings.append(np.asarray(taken.counts, dtype=np.float64))
            self.shot += 1
        bright, dark = readings
        variance = count_variance(instrument, bright, dark)
        variance = variance + count_variance(instrument, dark, dark)
        charge = electrons_of_counts(instrument, bright) - electrons_of_counts(instrument, dark)
        unit = scale * integration_s
        per_count = instrument.electrons_per_count
        return charge / unit, variance * (per_count / unit) ** 2
