"""Covariance of the captures of one sample by the instrument model, for a protocol.

Shot noise, dark current, read-out and rounding of every capture, reference and dark, and the drift
of the lamps between them: what `twin.measurement.relative_intensities` propagates of a simulated
visit, without simulating it. Sources: Janesick 2007, "Photon Transfer", equation 3.5;
`twin.instrument.lamp_covariance`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.bench import Bench
from twin.instrument import (
    Instrument,
    auto_exposure,
    band_average,
    electron_rates,
    fine_grid_nm,
)
from twin.materials import lamp, reflectance
from twin.spectra import FloatArray

FILL = 0.8
LONGEST_COLLIMATED_S = 10.0
"""As `scenarios.scenario.Protocol` has them."""
PAUSE_S = 5.0


@dataclass(frozen=True, eq=False)
class Settings:
    """Brightness of the references and exposures, W judged pixels.

    Attributes:
        white: signal of the white reference [electrons/s], (W,).
        rho_white: reflectance of the white in the pixels' bands, (W,).
        beam: signal of the beam reference [electrons/s], (W,).
        seconds: exposure of white and beam references [s], (2,).
        gain: of both, (2,).
        tilt: shape of the lamps' tilt, (W,).
        instrument: of the bench.
    """

    white: FloatArray
    rho_white: FloatArray
    beam: FloatArray
    seconds: tuple[float, float]
    gain: tuple[float, float]
    tilt: FloatArray
    instrument: Instrument

    @classmethod
    def of(cls, bench: Bench, wavelength_nm: FloatArray) -> Settings:
        """As the automatic exposure sets the references of a bench.

        Raises:
            InputError: a lamp that is too bright or dark, or does not cover the pixels.
        """
        instrument = bench.instrument
        pixels = np.asarray(instrument.wavelength_nm)
        judged = np.searchsorted(pixels, wavelength_nm)
        fine = fine_grid_nm(instrument)
        panels, beam = lamp(bench.panel_spectrum, fine), lamp(bench.beam.spectrum, fine)
        rho = reflectance(bench.background.white.reflectance, fine)
        rates, settings = [], []
        for light, peak in (
            (panels * rho, instrument.white_rate_electrons_per_s),
            (beam, instrument.beam_rate_electrons_per_s),
        ):
            rate = electron_rates(
                instrument, fine, light, reference=light, peak_rate_electrons_per_s=peak
            )
            rates.append(rate[judged])
            settings.append(auto_exposure(instrument, rate, fraction=FILL))
        seen = rho if len(fine) == len(pixels) else band_average(instrument, fine, rho, panels)
        span = max(float(pixels[-1] - pixels[0]), 1e-9)
        return cls(
            rates[0], seen[judged], rates[1],
            (settings[0].integration_s, settings[1].integration_s),
            (_gain(settings[0].instrument), _gain(settings[1].instrument)),
            2.0 * (np.asarray(wavelength_nm) - pixels[0]) / span - 1.0,
            instrument,
        )  # fmt: skip

    def collimated(self, light: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Exposure [s] and gain of collimated captures of relative intensity (..., W), (...) each.

        They may take longer than the beam reference, as `scenarios.simulate` has it.
        """
        rate = self.beam * light
        instrument = self.instrument
        dark = instrument.dark_current_electrons_per_s if instrument.has("dark_current") else 0.0
        reference = float((self.beam + dark).max())
        gained = reference / np.maximum((rate + dark).max(axis=-1), 1e-30)
        if instrument.kind == "chip":
            # gains come in powers of two
            steps = np.floor(np.log2(np.maximum(gained, 1.0)))
            gain = np.minimum(self.gain[1] * 2.0**steps, 512.0)
            return np.full(gain.shape, self.seconds[1]), gain
        limit = max(min(LONGEST_COLLIMATED_S, instrument.longest_s), self.seconds[1])
        seconds = np.clip(self.seconds[1] * gained, self.seconds[1], limit)
        return seconds, np.ones(seconds.shape)


def _gain(instrument: Instrument) -> float:
    return float(getattr(instrument, "gain", 1.0))


def covariance(settings: Settings, light: FloatArray, *, averages: int, repeats: int) -> FloatArray:
    """Covariance of black, white and collimated of one sample, shape (..., W, 3, 3).

    References are taken before and after the captures, each time `repeats` times, darks once.

    Args:
        settings: of the references.
        light: relative intensities, shape (..., W, 3).
        averages: frames of a shot.
        repeats: shots of every capture, reference and dark.
    """
    instrument = settings.instrument
    noise = np.zeros((*light.shape, 3))
    seconds = settings.seconds
    long, gain = settings.collimated(light[..., 2])
    read = instrument.read_noise_electrons**2 if instrument.has("read_noise") else 0.0
    warm = instrument.dark_current_electrons_per_s if instrument.has("dark_current") else 0.0

    def variance(rate: FloatArray, time: FloatArray, gained: FloatArray, shots: int) -> FloatArray:
        """Of the mean signal [electrons^2/s^2]."""
        count = _per_count(instrument, gained)
        rounding = count**2 / 12.0 if instrument.has("quantisation") else np.zeros_like(count)
        charge = (np.maximum(rate, 0.0) + warm) * time if instrument.has("shot_noise") else 0.0
        return np.asarray((charge + read + rounding) / time**2 / (averages * shots))

    def exposure(lamp_number: int) -> tuple[FloatArray, FloatArray]:
        return np.array(seconds[lamp_number]), np.array(settings.gain[lamp_number])

    nothing = np.zeros_like(settings.white)
    diffuser = settings.white / settings.rho_white
    under_white = variance(settings.white, *exposure(0), 2 * repeats)
    dark = variance(nothing, *exposure(0), repeats)
    scale = 1.0 / diffuser
    for row in (0, 1):
        own = variance(diffuser * light[..., row], *exposure(0), repeats)
        noise[..., row, row] = own * scale**2
        for column in (0, 1):
            product = light[..., row] * light[..., column]
            noise[..., row, column] += product * under_white / settings.white**2
            # one dark serves capture and reference
            apart = (1.0 - light[..., row] / settings.rho_white) * (
                1.0 - light[..., column] / settings.rho_white
            )
            noise[..., row, column] += apart * dark * scale**2
    through = light[..., 2]
    own_dark = variance(nothing, long[..., None], gain[..., None], repeats)
    beam_dark = variance(nothing, *exposure(1), repeats)
    same = (np.isclose(long, seconds[1]) & np.isclose(gain, settings.gain[1]))[..., None]
    darks = np.where(same, (1.0 - through) ** 2 * beam_dark, own_dark + through**2 * beam_dark)
    noise[..., 2, 2] = (
        variance(settings.beam * through, long[..., None], gain[..., None], repeats)
        + through**2 * variance(settings.beam, *exposure(1), 2 * repeats)
        + darks
    ) / settings.beam**2
    if instrument.has("lamp_drift"):
        noise += light[..., :, None] * light[..., None, :] * _drift(settings, repeats)
    return noise


def _per_count(instrument: Instrument, gain: FloatArray) -> FloatArray:
    """Electrons in a count at a gain."""
    if instrument.kind == "chip":
        return np.asarray(instrument.electrons_per_count_gain1 / gain)
    return np.asarray(instrument.electrons_per_count * np.ones_like(gain))


def _drift(settings: Settings, repeats: int) -> FloatArray:
    """Relative covariance of captures over their references by the lamps, (W, 3, 3)."""
    instrument = settings.instrument
    order = ("white", "grey", "beam", "black_s", "white_s", "collimated_s", "white", "grey", "beam")
    names = np.repeat(order, repeats)
    mean = np.array([(names == n) / (names == n).sum() for n in dict.fromkeys(order)])
    place = np.arange(len(names), dtype=np.float64)
    walk = mean @ np.minimum(place[:, None], place) @ mean.T
    flicker = mean @ mean.T
    # rows: black and white over the white reference, collimated over the beam reference
    ratio = np.zeros((3, 6))
    ratio[0, 3] = ratio[1, 4] = ratio[2, 5] = 1.0
    ratio[0, 0] = ratio[1, 0] = ratio[2, 2] = -1.0
    lamps = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    level = (
        ratio @ (instrument.lamp_walk**2 * walk + instrument.lamp_flicker**2 * flicker) @ ratio.T
    )
    tilted = ratio @ (instrument.lamp_tilt_walk**2 * walk) @ ratio.T
    return np.asarray(lamps * (level + settings.tilt[:, None, None] ** 2 * tilted))


def minutes(settings: Settings, light: FloatArray, *, averages: int, repeats: int) -> FloatArray:
    """Time [min] of all shots of one sample, shape of `light` without its last two axes."""
    long, _ = settings.collimated(light[..., 2])
    white, beam = settings.seconds
    per_frame = repeats * ((2 + 2 + 2 + 1) * white + (2 + 1) * beam + 2 * long)
    shots = repeats * 12
    return np.asarray((averages * per_frame + PAUSE_S * shots) / 60.0)
