"""The virtual bench that all devices of one bench share: what is lit, what lies where, what time.

A light switched on over one wire changes the spectrum read over another, because both act on one
`BenchState`. Behind it stands the twin: ready rates of electrons for every capture, and the
instrument that turns them into counts. The random numbers depend on (seed, shot number, frame)
alone, so that devices in process and on the wire agree count for count.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from hw_adapters.errors import DeviceError, RequestOutOfLimits, UnknownCommand
from hw_adapters.faults import Faults
from hw_adapters.frames import RawFrame, ShotFrames
from hw_adapters.protocols import OUT, VirtualClock
from twin.errors import InputError
from twin.instrument import Instrument, MultispectralChip, expected_electrons, lamp_drift
from twin.spectra import FloatArray

PANELS, BEAM = "panels", "beam"
"""Names of the two lamps, numbered in this order as `twin.instrument.lamp_drift` counts them."""
LAMPS = (PANELS, BEAM)
POSITIONS = ("black", "white", OUT)
"""Positions of the background stage."""

SCRATCH = 1 << 40
"""Shot numbers from here on are no part of a plan: exposures tried, frames thrown away."""

_NAME = "virtual bench"
_UNSETTLED = 0.05  # share of the light that a lamp lacks right after a change

_CAPTURES: Mapping[tuple[str, str, bool], str] = MappingProxyType(
    {
        (PANELS, "white", False): "white_reference",
        (PANELS, "black", False): "black_reference",
        (PANELS, "white", True): "white",
        (PANELS, "black", True): "black",
        (BEAM, OUT, False): "beam_reference",
        (BEAM, OUT, True): "collimated",
    }
)
"""(lamp, background, sample in place) -> capture (bench.md, Captures)."""


class BenchState:
    """One virtual bench with its clock, its faults and the twin's light.

    Args:
        instrument: the sensor that looks at the bench; its `averages` are not used.
        rates: (capture, sample) -> signal [electrons/s] at full drive, shape (P,) each, as
            `twin.instrument.electron_rates` gives it; references carry the name of the sample at
            whose height the holder stands. Darks need no entry.
        samples: names of the samples, the first in the holder's height at first.
        seed: seed of lamps and noise.
        clock: the clock; None starts a virtual one at 0.
        settle_s: time [s] a lamp needs after a change; read earlier, it gives up to 5 % less.
        faults: what is to go wrong; None: nothing.

    Attributes:
        clock, faults, seed, samples, settle_s: as given.

    Raises:
        InputError: rates of the wrong length, or of an unknown sample.
    """

    def __init__(
        self,
        instrument: Instrument,
        rates: Mapping[tuple[str, str], FloatArray],
        *,
        samples: tuple[str, ...],
        seed: int = 1,
        clock: VirtualClock | None = None,
        settle_s: float = 0.5,
        faults: Faults | None = None,
    ) -> None:
        pixels = len(instrument.wavelength_nm)
        for (capture, sample), rate in rates.items():
            if np.shape(rate) != (pixels,):
                raise InputError(
                    f"rates of shape {np.shape(rate)} for {capture} of {sample!r}",
                    f"one for each of {pixels} pixels",
                )
            if sample not in samples:
                raise InputError(f"rates of sample {sample!r}", f"one of {', '.join(samples)}")
        if not samples:
            raise InputError("no sample", "one sample or more")
        off = tuple(name for name in instrument.off if name != "averages")
        self._instrument = instrument.model_copy(update={"averages": 1, "off": off})
        self._rates = dict(rates)
        self.samples = samples
        self.seed = seed
        self.clock = clock or VirtualClock()
        self.faults = faults or Faults()
        self.settle_s = settle_s
        self._drive = dict.fromkeys(LAMPS, 0.0)
        self._changed = dict.fromkeys(LAMPS, -np.inf)
        self._background, self._sample, self._present = OUT, samples[0], False
        self._shot, self._frames = SCRATCH, ShotFrames(seed, SCRATCH)
        self._own_lamp: FloatArray | None = None
        self._drift: dict[int, FloatArray] = {}
        self._lock = threading.RLock()

    @property
    def instrument(self) -> Instrument:
        """The sensor as described, with one average."""
        return self._instrument

    @property
    def situation(self) -> tuple[str, str]:
        """(capture, sample): what is on the bench now.

        Raises:
            DeviceError: lamps, background and sample stand as in no capture.
        """
        lit = [name for name in LAMPS if self._drive[name] > 0]
        if not lit:
            return "dark", self._sample
        capture = _CAPTURES.get((lit[0], self._background, self._present))
        if len(lit) > 1 or capture is None or (capture, self._sample) not in self._rates:
            inside = f"{self._sample!r} in the holder" if self._present else "an empty holder"
            raise DeviceError(
                _NAME,
                f"{' and '.join(lit)} lit, background {self._background!r}, {inside}",
                "a situation of the capture plan: one lamp; panels with black or white, the beam"
                " without a background",
                "Move the stage, change the sample, or switch a lamp off.",
            )
        return capture, self._sample

    # What the sequence says -----------------------------------------------------------------

    def announce(self, shot: int, stage: str = "") -> None:
        """Say which shot comes next: its noise depends on the seed and this number alone."""
        with self._lock:
            self._shot, self._frames = shot, ShotFrames(self.seed, shot)
            self.faults.stage = stage

    # What devices do to the bench -----------------------------------------------------------

    def set_lamp(self, name: str, drive: float) -> None:
        """Drive a lamp ("panels" or "beam") at a share of its full light, 0 to 1.

        Raises:
            UnknownCommand: no such lamp.
            RequestOutOfLimits: a drive outside 0 to 1.
        """
        if name not in LAMPS:
            raise UnknownCommand(_NAME, f"the lamp {name!r}", f"one of {', '.join(LAMPS)}")
        if not 0.0 <= drive <= 1.0:
            raise RequestOutOfLimits(_NAME, f"a drive of {drive:g} for {name}", "0 to 1")
        with self._lock:
            if drive != self._drive[name]:
                self._drive[name] = float(drive)
                self._changed[name] = self.clock.now_s()

    def drive(self, name: str) -> float:
        """Drive of a lamp, 0 to 1."""
        return self._drive[name]

    def lamps_off(self) -> None:
        """Switch every lamp off."""
        for name in LAMPS:
            self.set_lamp(name, 0.0)

    def move_background(self, position: str) -> None:
        """Put a background in place: "black", "white", or "out" for none.

        Raises:
            UnknownCommand: no such position.
        """
        if position not in POSITIONS:
            raise UnknownCommand(
                _NAME, f"the position {position!r}", f"one of {', '.join(POSITIONS)}"
            )
        with self._lock:
            self._background = position

    @property
    def background(self) -> str:
        """The background in place, or "out"."""
        return self._background

    def place_sample(self, sample: str, present: bool) -> None:
        """Put the holder at a sample's height, with or without the sample in it.

        Raises:
            UnknownCommand: no such sample.
        """
        if sample not in self.samples:
            raise UnknownCommand(
                _NAME, f"the sample {sample!r}", f"one of {', '.join(self.samples)}"
            )
        with self._lock:
            self._sample, self._present = sample, present

    def shine(self, rate_electrons_per_s: FloatArray | None) -> None:
        """Hold another lamp before the sensor, as for a wavelength check; None: take it away.

        Args:
            rate_electrons_per_s: its signal [electrons/s], shape (P,), on top of everything else.

        Raises:
            InputError: the wrong number of pixels.
        """
        if rate_electrons_per_s is not None:
            pixels = len(self._instrument.wavelength_nm)
            if np.shape(rate_electrons_per_s) != (pixels,):
                raise InputError(
                    f"rates of shape {np.shape(rate_electrons_per_s)}", f"shape ({pixels},)"
                )
        with self._lock:
            self._own_lamp = rate_electrons_per_s

    # What a sensor reads --------------------------------------------------------------------

    def frame(
        self,
        integration_s: float | None = None,
        *,
        gain: float | None = None,
        atime: int | None = None,
        astep: int | None = None,
    ) -> RawFrame:
        """The next frame of the announced shot in the present situation; no time passes.

        Args:
            integration_s: integration time [s] of a spectrometer.
            gain: nominal gain of a chip.
            atime: its register ATIME.
            astep: its register ASTEP.

        Returns:
            Counts and saturation, shape (P,) each.

        Raises:
            DeviceError: a situation in which the twin has no light.
            InputError: settings that the instrument does not have.
        """
        with self._lock:
            faults = self.faults.active()
            instrument, time_s = self._set(integration_s, gain, atime, astep, faults)
            return self._frames.next(instrument, self._electrons(instrument, time_s, faults))

    def whole_counts(
        self,
        integration_s: float | None = None,
        *,
        gain: float | None = None,
        atime: int | None = None,
        astep: int | None = None,
    ) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
        """`frame` as a stand-in on a wire sends it: whole numbers [counts], shape (P,).

        Raises:
            DeviceError, InputError: as `frame`; an instrument with "quantisation" off.
        """
        if not self._instrument.has("quantisation"):
            raise InputError(
                'an instrument with "quantisation" off', "whole counts, which a wire carries",
                place="instrument.off",
            )  # fmt: skip
        return self.frame(integration_s, gain=gain, atime=atime, astep=astep).counts.astype(
            np.int64
        )

    def _set(
        self,
        integration_s: float | None,
        gain: float | None,
        atime: int | None,
        astep: int | None,
        faults: frozenset[str],
    ) -> tuple[Instrument, float]:
        """The instrument as it is set, and its integration time [s]."""
        instrument = self._instrument
        if not isinstance(instrument, MultispectralChip):
            if integration_s is None:
                raise InputError("no integration time", "seconds, of a spectrometer")
            return instrument, integration_s
        wanted = {"gain": gain, "atime": atime, "astep": astep}
        update = {name: value for name, value in wanted.items() if value is not None}
        if "gain_step_error" in faults and update.get("gain", instrument.gain) > 16:
            update["gain"] = 0.93 * update.get("gain", instrument.gain)
        chip = instrument.model_copy(update=update)
        return chip, chip.integration_s

    def _electrons(
        self, instrument: Instrument, time_s: float, faults: frozenset[str]
    ) -> FloatArray:
        """Mean charge [electrons] of a frame in the present situation, shape (P,)."""
        rate, lamp = self._light()
        if "lamp_drift" in faults:
            rate = 0.95 * rate
        if "saturation" in faults:
            rate = 50.0 * rate
        mean = expected_electrons(instrument, rate, time_s, lamp=lamp)
        if "light_leak" in faults:
            brightest = max(float(np.max(rate)) for rate in self._rates.values())
            mean = mean + 0.002 * brightest * time_s
        if self._own_lamp is not None:
            mean = mean + self._own_lamp * time_s
        if "hot_pixel" in faults:
            hot = np.zeros_like(mean)
            hot[len(hot) // 3] = 0.3 * instrument.full_well_electrons
            mean = mean + hot
        return mean

    def _light(self) -> tuple[FloatArray, FloatArray]:
        """Rates [electrons/s] without drift, and the drift's factor, shape (P,) each."""
        situation = self.situation
        pixels = len(self._instrument.wavelength_nm)
        if situation[0] == "dark":
            return np.zeros(pixels), np.ones(pixels)
        name = next(name for name in LAMPS if self._drive[name] > 0)
        level = self._drive[name] * self._settled(name)
        rate = self._rates[situation]
        # At full, steady drive the rates go through untouched, bit for bit.
        return rate if level == 1.0 else level * rate, self._drift_of(LAMPS.index(name))

    def _settled(self, name: str) -> float:
        """Share of the light that a lamp gives so soon after a change."""
        left = self._changed[name] + self.settle_s - self.clock.now_s()
        if left <= 1e-9:
            return 1.0
        return 1.0 - _UNSETTLED * min(1.0, left / self.settle_s)

    def _drift_of(self, lamp: int) -> FloatArray:
        """Factor on a lamp's light in the present shot, shape (P,)."""
        row = 0 if self._shot >= SCRATCH else self._shot
        known = self._drift.get(lamp)
        if known is None or len(known) <= row:
            # Fewer shots give the beginning of the same sequence: make it longer when needed.
            size = max(64, 1 << int(row).bit_length())
            known = lamp_drift(self._instrument, size, seed=self.seed, lamp=lamp)
            self._drift[lamp] = known
        return np.asarray(known[row])
