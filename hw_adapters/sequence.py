"""The runner: warm-up, exposure, every shot of the plan, and nothing lost when something fails."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from hw_adapters.assemble import assembled
from hw_adapters.bench import DeviceBench
from hw_adapters.checks import visit_notes
from hw_adapters.errors import (
    DeviceError,
    RequestOutOfLimits,
    Saturated,
    StaleFrame,
    WrongDevice,
)
from hw_adapters.exposure import Attempt, expose, is_saturated
from hw_adapters.hands import Hands
from hw_adapters.journal import Journal, Taken
from hw_adapters.plan import SCENES, PlannedShot, PlanSettings, capture_plan
from hw_adapters.protocols import (
    OUT,
    Applied,
    Frame,
    RealClock,
)
from hw_adapters.state import BEAM, PANELS
from hw_adapters.visit import begin_or_resume
from twin.errors import InputError
from twin.measurement import Measurement

Progress = Callable[[float, float], None]
"""Told (done, total) in seconds of capture."""

_START_S = 0.05
_START_GAIN = 16.0
_FIXED_EXPOSURE = (
    "Dim the lamp or close the aperture, then go on with --resume; or begin a new visit with a"
    ' shorter exposure, or exposure = "auto".'
)


class CaptureStopped(DeviceError):
    """A visit that stopped in the middle; what was captured is in its journal.

    Attributes:
        cause: the device's error.
        taken: number of shots kept.
        missing: labels of the shots that are missing.
        folder: the journal.
    """

    def __init__(
        self, cause: DeviceError, step: str, taken: int, missing: tuple[str, ...], folder: Path
    ) -> None:
        self.cause, self.taken, self.missing, self.folder = cause, taken, missing, folder
        of = f" of {taken + len(missing)}" if missing else ""
        kept = f"{taken}{of} shots are kept in {folder}"
        if missing:
            more = f" and {len(missing) - 3} more" if len(missing) > 3 else ""
            kept += f"; missing: {'; '.join(missing[:3])}{more}"
        super().__init__(
            cause.device, f"{cause.found} (during {step})", cause.expected,
            f"{cause.remedy} {kept}.",
        )  # fmt: skip


def capture_visit(
    devices: DeviceBench,
    settings: PlanSettings,
    folder: Path,
    *,
    resume: bool = False,
    progress: Progress | None = None,
    say: Callable[[str], None] | None = None,
) -> Measurement:
    """Run the whole sequence; the journal in `folder` keeps every shot as it is taken.

    Warm-up; exposure of white, beam and each sample's beam (16 attempts at most, all logged);
    then shot by shot as `capture_plan` orders them, `settings.discard` frames thrown away after
    each change. A reading that repeats the one before it although the scene has changed is taken
    again once.

    Args:
        devices: the bench.
        settings: what is captured, and how often.
        folder: folder of the journal.
        resume: go on with the journal in it.
        progress: told (done, total) in seconds of capture.
        say: told in words what happens.

    Returns:
        The measurement, origin "simulated" for a virtual bench and "measured" otherwise.

    Raises:
        CaptureStopped: a device failed; what was captured is kept.
        WrongDevice: another device than before or than the calibration is for.
        RequestOutOfLimits: settings that the sensor cannot take; nothing was begun.
        InputError: a journal of another visit, or one where none was asked for.
    """
    runner = _Runner(devices, settings, Journal(folder), say or (lambda text: None))
    try:
        return runner.run(resume=resume, progress=progress or (lambda done, total: None))
    finally:
        # Nobody wants lamps to burn on after a failure; the failure itself is what is reported.
        with contextlib.suppress(InputError):
            devices.lights.off()


class _Runner:
    def __init__(
        self,
        devices: DeviceBench,
        settings: PlanSettings,
        journal: Journal,
        say: Callable[[str], None],
    ) -> None:
        self._devices, self._settings, self._journal, self._say = devices, settings, journal, say
        self._hands = Hands(devices, settings.discard)
        self._last: tuple[str, Frame] | None = None
        self._zero: float | None = None
        self._plan: tuple[PlannedShot, ...] = ()
        self._taken: dict[int, Taken] = {}

    def run(self, *, resume: bool, progress: Progress) -> Measurement:
        """The sequence from beginning to end."""
        try:
            begin_or_resume(self._devices, self._settings, self._journal, resume=resume)
            self._taken = self._journal.shots()
            exposures = self._journal.exposures()
            if exposures is not None:
                self._plan = capture_plan(exposures, self._settings)
            if not self._plan or len(self._taken) < len(self._plan):
                self._warm_up()
                self._plan = self._plan or capture_plan(self._expose_all(), self._settings)
                self._shoot(self._plan, progress)
        except DeviceError as error:
            refused = isinstance(error, WrongDevice | RequestOutOfLimits)
            if refused and self._hands.stage == "start":
                raise
            missing = tuple(p.label for p in self._plan if p.number not in self._taken)
            self._journal.log("stopped", step=self._hands.stage, error=str(error))
            raise CaptureStopped(
                error, self._hands.stage, len(self._taken), missing, self._journal.folder
            ) from error
        return self._finish()

    # Before the first shot ------------------------------------------------------------------

    def _warm_up(self) -> None:
        seconds = self._settings.warm_up_s
        self._hands.announce("warm_up")
        if seconds <= 0:
            return
        self._say(f"warm-up: both lamps for {seconds:g} s")
        for name in (PANELS, BEAM):
            self._devices.lights.set(name, 1.0)
        self._devices.clock.sleep(seconds)
        self._devices.lights.off()

    def _expose_all(self) -> dict[str, dict[str, Applied]]:
        """Settings of every capture of every sample; written down once all are found."""
        settings, names = self._settings, [sample.name for sample in self._devices.samples]
        start = self._start()
        if settings.exposure != "auto":
            applied = self._hands.apply(replace(start, integration_s=settings.exposure))
            one = {name: applied for name in SCENES if name != "dark"}
            found = {name: dict(one) for name in names}
        else:
            white = self._expose("white_reference", names[0], start)
            beam = self._expose("beam_reference", names[0], start)
            found = {}
            for name in names:
                own = self._longer(
                    beam, self._expose("collimated", name, beam, settings.collimated_longest_s)
                )
                found[name] = {
                    capture: beam if scene.lamp == BEAM else white
                    for capture, scene in SCENES.items()
                    if capture != "dark"
                } | {"collimated": own}
        self._journal.write_exposures(found)
        return found

    def _start(self) -> Applied:
        settings, limits = self._settings, self._devices.sensor.limits
        if not limits.gains:
            time_s = limits.rounded(min(max(_START_S, limits.shortest_s), limits.longest_s))
            return Applied(time_s, settings.averages)
        gain = settings.gain if settings.gain is not None else _START_GAIN
        time_s = (settings.atime + 1) * (settings.astep + 1) * limits.step_s
        return Applied(time_s, settings.averages, gain, settings.atime, settings.astep)

    def _expose(
        self, capture: str, sample: str, start: Applied, longest_s: float = np.inf
    ) -> Applied:
        devices, sensor = self._devices, self._devices.sensor

        def log(attempt: Attempt) -> None:
            self._journal.log(
                "exposure", capture=capture, sample=sample,
                integration_s=attempt.applied.integration_s, gain=attempt.applied.gain,
                fraction=attempt.fraction, saturated=attempt.saturated,
            )  # fmt: skip

        def read(applied: Applied, scene: str = capture) -> Frame:
            self._hands.prepare(scene, sample, replace(applied, averages=1), f"expose {capture}")
            self._hands.announce(f"expose {capture}")
            return sensor.capture()

        found = expose(
            read, read(start, "dark"), sensor.limits, start, device=sensor.info.name, what=capture,
            fill=self._settings.fill, longest_s=longest_s, log=log,
        )  # fmt: skip
        self._journal.log(
            "exposed", capture=capture, sample=sample, limited=found.limited,
            integration_s=found.applied.integration_s, gain=found.applied.gain,
            fraction=found.fraction, device=devices.sensor.info.name,
        )  # fmt: skip
        self._say(
            f"exposure of {capture} of {sample!r}: {found.applied.integration_s:g} s,"
            f" gain {found.applied.gain:g}, {found.fraction:.2f} of full scale"
        )
        return replace(found.applied, averages=self._settings.averages)

    @staticmethod
    def _longer(reference: Applied, own: Applied) -> Applied:
        """The exposure of the collimated capture: its own where that is more."""
        more = own.integration_s * own.gain > reference.integration_s * reference.gain
        return own if more else reference

    # Shots ----------------------------------------------------------------------------------

    def _shoot(self, plan: tuple[PlannedShot, ...], progress: Progress) -> None:
        cost = [shot.settings.integration_s * shot.settings.averages + 0.1 for shot in plan]
        total = sum(cost)
        done = sum(cost[number] for number in self._taken)
        progress(done, total)
        for shot in plan:
            if shot.number in self._taken:
                continue
            if self._zero is None and shot.number > 0:
                self._return_to(plan[: shot.number])
            self._taken[shot.number] = self._take(shot)
            done += cost[shot.number]
            progress(done, total)
        self._hands.stage = "end"

    def _return_to(self, past: tuple[PlannedShot, ...]) -> None:
        """Go on with a visit: the bench as it was after the shots before, and its time."""
        before = past[-1]
        moved = [SCENES[shot.capture].background for shot in past]
        self._hands.move_background(next((name for name in reversed(moved) if name), OUT))
        self._hands.prepare(before.capture, before.sample, before.settings, "resume")
        earlier = self._taken.get(before.number)
        if earlier is None:
            return
        self._zero = self._devices.clock.now_s() - earlier.end_s
        started = next(self._journal.events("started"), None)
        if isinstance(self._devices.clock, RealClock) and started is not None:
            away = time.time() - float(started["wall_s"])
            self._zero = self._devices.clock.now_s() - max(away, earlier.end_s)

    def _take(self, shot: PlannedShot) -> Taken:
        stage = shot.capture
        self._hands.prepare(shot.capture, shot.sample, shot.settings, stage)
        frame = self._read(shot)
        if self._is_stale(shot, frame):
            self._journal.log("stale", number=shot.number, shot=shot.label)
            frame = self._read(shot)
            if self._is_stale(shot, frame) and "dark" in (shot.capture, (self._last or ("",))[0]):
                raise StaleFrame(
                    self._devices.sensor.info.name,
                    f"twice the same reading ({shot.label}), though the light changed",
                )
        if self._zero is None:
            self._zero = frame.time_s
            if isinstance(self._devices.clock, RealClock):
                self._journal.log("started", wall_s=time.time())
        self._last = (shot.capture, frame)
        self._devices.clock.sleep(self._settings.pause_s)
        taken = Taken(shot.number, _since(frame, self._zero), self._now())
        if is_saturated(frame):
            self._journal.put_aside(taken, "saturated")
            share = float(np.mean(frame.saturated))
            raise Saturated(
                self._devices.sensor.info.name,
                f"{share:.0%} of the pixels saturated in {shot.label}",
                remedy="" if self._settings.exposure == "auto" else _FIXED_EXPOSURE,
            )
        self._journal.keep(taken)
        return taken

    def _read(self, shot: PlannedShot) -> Frame:
        """One reading; a frame that the device says it sent twice is asked for again once."""
        self._hands.stage = shot.capture
        self._devices.announce(shot.number, shot.capture)
        try:
            return self._devices.sensor.capture()
        except StaleFrame as error:
            self._journal.log("stale", number=shot.number, shot=shot.label, error=str(error))
            self._devices.announce(shot.number, shot.capture)
            return self._devices.sensor.capture()

    def _is_stale(self, shot: PlannedShot, frame: Frame) -> bool:
        return (
            self._last is not None
            and self._last[0] != shot.capture
            and np.array_equal(self._last[1].counts, frame.counts)
        )

    def _now(self) -> float:
        return self._devices.clock.now_s() - (self._zero or 0.0)

    # The end --------------------------------------------------------------------------------

    def _finish(self) -> Measurement:
        # From the journal in any case, so that a resumed visit cannot differ from another.
        taken = self._journal.shots()
        notes = visit_notes(
            self._devices.sensor.info.name, self._devices.sensor.wavelength_nm, self._plan, taken,
            self._settings, tuple(self._journal.events("exposed")),
        )  # fmt: skip
        for note in notes:
            self._say(note)
        return assembled(self._devices, self._plan, taken, notes)


def _since(frame: Frame, zero_s: float) -> Frame:
    """The frame with its times since the beginning of the visit, to a microsecond."""
    return replace(
        frame,
        time_s=round(frame.time_s - zero_s, 6),
        pass_times_s=tuple(round(value - zero_s, 6) for value in frame.pass_times_s),
    )
