"""How bright the captures of a visit are and how long they take: what signal effects need.

Relative intensities say nothing of counts. A dark offset, a curve of the detector or a step of
the gain need them: from the measurement itself, or as the automatic exposure would choose them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.bench import Bench, Sample
from twin.effects.world import (
    BEAM_REFERENCE,
    COLLIMATED,
    LIT,
    WHITE_REFERENCE,
)
from twin.errors import InputError
from twin.instrument import MultispectralChip, auto_exposure, electrons_of_counts
from twin.materials import lamp, reflectance
from twin.measurement import Measurement
from twin.spectra import FloatArray

FILL = 0.8
"""Share of full scale at which a planned reference is read."""


@dataclass(frozen=True, eq=False)
class Readout:
    """Brightness of the references and settings of all captures, S samples, W wavelengths.

    Attributes:
        wavelength_nm: [nm], shape (W,).
        white: signal of the white reference [electrons/s], shape (S, W); stray light and
            an offset are in it where it was read and not planned.
        beam: signal of the beam reference [electrons/s], shape (S, W); the same.
        integration_s: of the captures in the order `LIT` [s], shape (S, 6).
        gain: of the captures, shape (S, 6).
        planned: whether it is the light itself, planned or known, and not a visit's readings.
    """

    wavelength_nm: FloatArray
    white: FloatArray
    beam: FloatArray
    integration_s: FloatArray
    gain: FloatArray
    planned: bool = True

    @classmethod
    def plan(
        cls,
        bench: Bench,
        samples: Sequence[Sample],
        wavelength_nm: FloatArray,
        *,
        collimated_s: Sequence[float] | None = None,
    ) -> Readout:
        """As the automatic exposure sets a visit: references fill 0.8 of the range.

        Args:
            bench: lamps, white and instrument.
            samples: S of them.
            wavelength_nm: [nm], shape (W,); the brightest of them counts.
            collimated_s: integration time [s] of each sample's collimated capture; None takes
                that of the beam reference.

        Raises:
            InputError: a spectrum that does not cover the wavelengths, or a lamp too bright.
        """  # fmt: skip
        instrument = bench.instrument
        wavelength = np.asarray(wavelength_nm, dtype=np.float64)
        rates, settings = [], []
        lit = (
            (
                lamp(bench.panel_spectrum, wavelength)
                * reflectance(bench.background.white.reflectance, wavelength)
                * (1.0 - bench.background.white.gloss),
                instrument.white_rate_electrons_per_s,
            ),
            (lamp(bench.beam.spectrum, wavelength), instrument.beam_rate_electrons_per_s),
        )
        for spectrum, peak in lit:
            rate = peak * spectrum / spectrum.max()
            brightest = np.full(len(instrument.wavelength_nm), rate.max())
            rates.append(rate)
            settings.append(auto_exposure(instrument, brightest, fraction=FILL))
        count = len(samples)
        seconds = np.full((count, len(LIT)), settings[0].integration_s)
        seconds[:, [BEAM_REFERENCE, COLLIMATED]] = settings[1].integration_s
        gain = np.full((count, len(LIT)), getattr(settings[0].instrument, "gain", 1.0))
        gain[:, [BEAM_REFERENCE, COLLIMATED]] = getattr(settings[1].instrument, "gain", 1.0)
        if collimated_s is not None:
            seconds[:, COLLIMATED] = collimated_s
        white, beam = (np.tile(rate, (count, 1)) for rate in rates)
        return cls(wavelength, white, beam, seconds, gain)

    @classmethod
    def of(cls, measurement: Measurement, wavelength_nm: FloatArray | None = None) -> Readout:
        """From the counts of a visit; planned where it has none.

        Args:
            measurement: the visit.
            wavelength_nm: [nm], shape (W,), inside its range; None takes its own.

        Raises:
            InputError: a capture or reference is missing.
        """
        pixels = measurement.wavelength_nm
        wavelength = pixels if wavelength_nm is None else np.asarray(wavelength_nm, dtype=float)
        captures = measurement.captures
        if captures is None:
            return cls.plan(measurement.bench, measurement.samples, wavelength)
        instrument = measurement.bench.instrument
        count = len(measurement.samples)
        seconds, gain = np.ones((2, count, len(LIT)))
        rate = np.zeros((2, count, wavelength.size))
        for number, sample in enumerate(measurement.samples):
            for row, capture in enumerate(LIT):
                own = [
                    index
                    for owner in (sample.name, "")
                    for index, shot in enumerate(captures.shots)
                    if (shot.capture, shot.sample) == (capture, owner)
                ]
                if not own and capture == "black_reference":
                    seconds[number, row] = seconds[number, WHITE_REFERENCE]
                    gain[number, row] = gain[number, WHITE_REFERENCE]
                    continue
                if not own:
                    raise InputError(
                        f"no {capture}", "one of every sample or of the visit",
                        place=f"sample {sample.name!r}",
                    )  # fmt: skip
                shot = captures.shots[own[0]]
                seconds[number, row], gain[number, row] = shot.integration_s, shot.gain
                if capture in ("white_reference", "beam_reference"):
                    set_to = instrument
                    if isinstance(instrument, MultispectralChip):
                        set_to = instrument.model_copy(update={"gain": shot.gain})
                    counts = captures.counts[own[0]]
                    charge = electrons_of_counts(set_to, counts)
                    dark = instrument.dark_current_electrons_per_s
                    light = charge / shot.integration_s - dark * instrument.has("dark_current")
                    known = np.isfinite(light)
                    least = 1e-6 * np.max(light[known], initial=1.0)
                    rate[int(capture == "beam_reference"), number] = np.maximum(
                        np.interp(wavelength, pixels[known], light[known]), least
                    )
        return cls(wavelength, rate[0], rate[1], seconds, gain, planned=False)

    @property
    def exposure(self) -> FloatArray:
        """Integration time times gain [s], shape (S, 6)."""
        return np.asarray(self.integration_s * self.gain)
