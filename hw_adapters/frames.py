"""The frames of one shot, one at a time, as a cable asks for them.

`twin.instrument.simulate_counts` returns the mean of a shot's frames. A driver reads frame by
frame; so the same random numbers are drawn here in the same order, and the mean of the first N
frames of a shot is `simulate_counts` of an instrument with N averages, bit for bit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.instrument import Instrument, counts_of_electrons
from twin.instrument.streams import Stream, generator
from twin.spectra import FloatArray


@dataclass(frozen=True, eq=False)
class RawFrame:
    """One exposure.

    Attributes:
        counts: reading [counts], whole numbers unless "quantisation" is off, shape (P,).
        saturated: True where the top of the range was reached, shape (P,).
    """

    counts: FloatArray
    saturated: NDArray[np.bool_]


class ShotFrames:
    """The frames of one shot, drawn one after the other.

    Args:
        seed: seed of the visit.
        shot: number of the shot.
    """

    def __init__(self, seed: int, shot: int) -> None:
        self._photons = generator(Stream.SHOT_NOISE, seed, shot)
        self._reader = generator(Stream.READ_NOISE, seed, shot)

    def next(self, instrument: Instrument, mean_electrons: FloatArray) -> RawFrame:
        """The next frame; the order of the steps is that of `simulate_counts`.

        Args:
            instrument: the instrument as it is set.
            mean_electrons: `twin.instrument.expected_electrons` of the frame, shape (P,).
        """
        saturated = np.zeros(mean_electrons.shape, dtype=np.bool_)
        if instrument.has("shot_noise"):
            charge = self._photons.poisson(mean_electrons).astype(np.float64)
        else:
            charge = mean_electrons
        if instrument.has("saturation"):
            saturated |= charge >= instrument.full_well_electrons
            charge = np.minimum(charge, instrument.full_well_electrons)
        reading = counts_of_electrons(instrument, charge)
        if instrument.has("read_noise"):
            noise = instrument.read_noise_electrons / instrument.electrons_per_count
            reading = reading + noise * self._reader.standard_normal(mean_electrons.shape)
        if instrument.has("quantisation"):
            reading = np.floor(reading + 0.5)
        if instrument.has("saturation"):
            saturated |= reading >= instrument.full_scale_counts
            reading = np.clip(reading, 0, instrument.full_scale_counts)
        return RawFrame(np.asarray(reading, dtype=np.float64), saturated)
