"""Calibration of a sensor on its bench: dark, white, wavelengths, linearity.

Everything is measured with the devices of a `DeviceBench`, so the same checks run on the twin, on
stand-ins and on real devices.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from hw_adapters.bench import DeviceBench
from hw_adapters.errors import Saturated
from hw_adapters.exposure import expose
from hw_adapters.plan import SCENES, PlanSettings
from hw_adapters.protocols import Applied, DeviceInfo, Frame, MultispectralSensor
from hw_adapters.state import SCRATCH
from twin.errors import InputError
from twin.spectra import FloatArray

LAMP_LINES_NM: MappingProxyType[str, tuple[float, ...]] = MappingProxyType(
    {
        "mercury-argon": (
            404.656, 435.833, 546.074, 576.960, 579.066, 696.543, 706.722, 738.398, 750.387,
            763.511, 772.376,
        ),
        "neon": (585.249, 614.306, 633.443, 640.225, 650.653, 667.828, 692.947, 703.241, 724.517),
        "fluorescent": (404.656, 435.833, 546.074, 611.6),
    }
)  # fmt: skip
"""Wavelengths [nm] in air of strong lines. Mercury, argon and neon: Sansonetti and Martin 2005,
"Handbook of Basic Atomic Spectroscopic Data", J. Phys. Chem. Ref. Data 34, 1559. The last line of
a fluorescent tube is the europium emission of its phosphor, a nanometre wide."""

GAIN_STEPS = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
"""Gains of a chip that are compared with each other."""

_PEAK_REACH_NM = 4.0
_PEAK_SIGMAS = 8.0
_SERIES = (0.05, 0.1, 0.2, 0.4, 0.7, 1.0, 1.1)


@dataclass(frozen=True, eq=False)
class LineCheck:
    """Lines of a known lamp as the spectrometer sees them.

    Attributes:
        true_nm: wavelengths [nm] of the lines that were found, shape (L,).
        seen_nm: where they were seen [nm], shape (L,).
        missing_nm: lines [nm] in the spectrometer's range that were not found.
    """

    true_nm: FloatArray
    seen_nm: FloatArray
    missing_nm: tuple[float, ...]

    @property
    def worst_nm(self) -> float:
        """Greatest error [nm]; NaN without a line."""
        return float(np.abs(self.seen_nm - self.true_nm).max()) if self.true_nm.size else np.nan


@dataclass(frozen=True, eq=False)
class Linearity:
    """Counts per second along a series of integration times (or gains).

    Attributes:
        setting: integration times [s], or gains, increasing, shape (K,).
        fill: brightest pixel over full scale, shape (K,).
        deviation: counts above the dark per unit of setting, relative to their mean, shape (K,).
        of: "integration time" or "gain".
    """

    setting: FloatArray
    fill: FloatArray
    deviation: FloatArray
    of: str

    @property
    def worst(self) -> float:
        """Greatest relative deviation."""
        return float(np.abs(self.deviation).max())


@dataclass(frozen=True, eq=False)
class Calibration:
    """What a calibration found.

    Attributes:
        info: the sensor.
        wavelength_nm: its wavelengths [nm], shape (P,).
        settings: the exposure of the white.
        dark, white: counts at that exposure, shape (P,) each.
        dark_noise_counts: standard deviation [counts] of a pixel from frame to frame, median.
        linearity: along a series.
        lines: wavelength check; None where no lamp with lines was named.
        notes: what a person should know, each with its remedy.
    """

    info: DeviceInfo
    wavelength_nm: FloatArray
    settings: Applied
    dark: FloatArray
    white: FloatArray
    dark_noise_counts: float
    linearity: Linearity
    lines: LineCheck | None
    notes: tuple[str, ...]


def _ignored(there: bool) -> None:
    """The lamp is there already."""


def calibrate(
    devices: DeviceBench,
    settings: PlanSettings,
    *,
    lamp: str = "",
    hold_lamp: Callable[[bool], None] = _ignored,
    frames: int = 16,
) -> Calibration:
    """Dark, white, linearity, and the wavelengths against the lines of a known lamp.

    Args:
        devices: the bench.
        settings: wanted fill and warm-up.
        lamp: one of `LAMP_LINES_NM`, or "" for no check.
        hold_lamp: called with True when that lamp is to be held before the sensor (the bench's
            own lamps are off), with False when it can be taken away.
        frames: darks from which the noise is taken, at least 2.

    Raises:
        InputError: an unknown lamp, a lamp for a chip, or fewer than two frames.
        DeviceError: a device fails, or the white saturates at the shortest time.
    """
    if lamp and lamp not in LAMP_LINES_NM:
        raise InputError(f"the lamp {lamp!r}", f"one of {', '.join(LAMP_LINES_NM)}", place="lamp")
    if frames < 2:
        raise InputError(f"{frames} frames", "at least 2", place="frames")
    bench = _Bench(devices, settings)
    if lamp and bench.is_chip:
        raise InputError(
            "a chip, which resolves no lines", "a spectrometer for the wavelength check",
            place="lamp",
        )  # fmt: skip
    try:
        bench.warm_up()
        exposed = bench.expose()
        darks = np.array([bench.read("dark", exposed).counts for _ in range(frames)])
        white = bench.read("white_reference", exposed)
        line_counts = None
        if lamp:
            hold_lamp(True)
            try:
                line_counts = bench.read("dark", exposed).counts
            finally:
                hold_lamp(False)
        linearity = bench.linearity(exposed)
    finally:
        bench.lights_off()
    lines = None
    if line_counts is not None:
        above = line_counts - darks.mean(axis=0)
        lines = check_lines(devices.sensor.wavelength_nm, above, LAMP_LINES_NM[lamp])
    noise = float(np.median(darks.std(axis=0, ddof=1)))
    return Calibration(
        info=devices.sensor.info,
        wavelength_nm=devices.sensor.wavelength_nm,
        settings=exposed,
        dark=np.asarray(darks.mean(axis=0)),
        white=white.counts,
        dark_noise_counts=noise,
        linearity=linearity,
        lines=lines,
        notes=_notes(devices.sensor.info.name, linearity, lines),
    )


def check_lines(
    wavelength_nm: FloatArray, counts: FloatArray, lines_nm: tuple[float, ...]
) -> LineCheck:
    """Find the lines of a lamp near where they should be: centroids of the peaks.

    Args:
        wavelength_nm: wavelengths [nm] of the pixels, shape (P,).
        counts: reading of the lamp above the dark [counts], shape (P,).
        lines_nm: true wavelengths [nm]; lines nearer than the reach to each other are skipped.
    """
    noise = 1.4826 * float(np.median(np.abs(counts - np.median(counts))))
    true, seen, missing = [], [], []
    for line in lines_nm:
        if not wavelength_nm[0] + 1 <= line <= wavelength_nm[-1] - 1:
            continue
        if any(0 < abs(line - other) < _PEAK_REACH_NM for other in lines_nm):
            continue
        near = np.abs(wavelength_nm - line) <= _PEAK_REACH_NM
        if np.count_nonzero(near) < 3:  # pixels too far apart to see a line
            missing.append(line)
            continue
        values = counts[near] - counts[near].min()
        if values.max() <= max(_PEAK_SIGMAS * noise, 1.0):
            missing.append(line)
            continue
        # The part above half of the peak: a neighbour's foot does not pull the centroid.
        weight = np.where(values >= 0.5 * values.max(), values, 0.0)
        true.append(line)
        seen.append(float(np.sum(weight * wavelength_nm[near]) / weight.sum()))
    return LineCheck(np.array(true), np.array(seen), tuple(missing))


class _Bench:
    """The devices as a calibration uses them."""

    def __init__(self, devices: DeviceBench, settings: PlanSettings) -> None:
        self._devices, self._settings = devices, settings
        self._number = SCRATCH

    @property
    def is_chip(self) -> bool:
        return isinstance(self._devices.sensor, MultispectralSensor)

    def warm_up(self) -> None:
        if self._settings.warm_up_s > 0:
            self._devices.lights.set("panels", 1.0)
            self._devices.clock.sleep(self._settings.warm_up_s)

    def lights_off(self) -> None:
        try:
            self._devices.lights.off()
        except InputError:
            return  # the error that stopped the calibration is the one to report

    def expose(self) -> Applied:
        limits = self._devices.sensor.limits
        if self.is_chip:
            now = self._settings
            time_s = (now.atime + 1) * (now.astep + 1) * limits.step_s
            start = Applied(time_s, 1, now.gain or 16.0, now.atime, now.astep)
        else:
            start = Applied(limits.rounded(max(0.05, limits.shortest_s)))
        found = expose(
            lambda applied: self.read("white_reference", applied), self.read("dark", start),
            limits, start, device=self._devices.sensor.info.name, what="white_reference",
            fill=self._settings.fill,
        )  # fmt: skip
        return found.applied

    def read(self, capture: str, applied: Applied) -> Frame:
        devices, scene = self._devices, SCENES[capture]
        self._announce("calibrate")
        devices.holder.place(devices.samples[0].name, scene.present)
        if scene.background:
            devices.stage.move_to(scene.background)
        devices.lights.off()
        if scene.lamp:
            devices.lights.set(scene.lamp, 1.0)
        devices.clock.sleep(devices.lights.settle_s)
        sensor = devices.sensor
        if isinstance(sensor, MultispectralSensor):
            sensor.configure(applied.gain, applied.atime or 0, applied.astep or 0, applied.averages)
        else:
            sensor.configure(applied.integration_s, applied.averages)
        for _ in range(self._settings.discard):
            self._announce("calibrate")
            sensor.discard()
        self._announce("calibrate")
        return sensor.capture()

    def _announce(self, stage: str) -> None:
        self._devices.announce(self._number, stage)
        self._number += 1

    def linearity(self, exposed: Applied) -> Linearity:
        """A series of integration times of a spectrometer, or of gains of a chip."""
        limits = self._devices.sensor.limits
        averages = max(exposed.averages, 4)
        if self.is_chip:
            series = [
                replace(exposed, gain=gain, averages=averages)
                for gain in GAIN_STEPS
                if gain <= exposed.gain
            ]
        else:
            times = sorted({limits.rounded(part * exposed.integration_s) for part in _SERIES})
            series = [
                replace(exposed, integration_s=time, averages=averages)
                for time in times
                if limits.shortest_s <= time <= limits.longest_s
            ]
        settings, fill, signals = [], [], []
        for applied in series:
            dark, white = self.read("dark", applied), self.read("white_reference", applied)
            if white.saturated.any():
                continue
            settings.append(applied.gain if self.is_chip else applied.integration_s)
            fill.append(float(white.counts.max()) / white.full_scale)
            signals.append(white.counts - dark.counts)
        if not signals:
            raise Saturated(self._devices.sensor.info.name, "white saturated along the series")
        # The same pixels all along, chosen where noise matters least: pixels chosen anew in each
        # reading would be those whose noise is upward.
        lit = signals[-1] > 0.5 * signals[-1].max()
        setting = np.array(settings)
        slope = np.array([float(signal[lit].mean()) for signal in signals]) / setting
        return Linearity(
            setting, np.array(fill), slope / np.median(slope) - 1.0,
            "gain" if self.is_chip else "integration time",
        )  # fmt: skip


def _notes(device: str, linearity: Linearity, lines: LineCheck | None) -> tuple[str, ...]:
    notes = []
    if linearity.worst > 0.02:
        at = float(linearity.setting[int(np.abs(linearity.deviation).argmax())])
        notes.append(
            f"the {device} deviates by {linearity.worst:.1%} from proportion to the"
            f" {linearity.of} at {at:g}: describe the curve (instrument.nonlinearity), or stay at"
            f" one {linearity.of} for readings and references"
        )
    if lines is not None and lines.true_nm.size and lines.worst_nm > 1.0:
        notes.append(
            f"lines of the lamp are seen up to {lines.worst_nm:.2f} nm from where they are by the"
            f" {device}: correct its wavelength coefficients"
        )
    if lines is not None and lines.missing_nm:
        where = ", ".join(f"{value:.1f}" for value in lines.missing_nm)
        notes.append(
            f"the {device} does not see the lines at {where} nm: bring the lamp nearer, or use a"
            " longer integration time"
        )
    return tuple(notes)
