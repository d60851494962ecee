"""The hands of a sequence: they bring the bench from one scene to the next."""

from __future__ import annotations

from hw_adapters.bench import DeviceBench
from hw_adapters.errors import StaleFrame
from hw_adapters.plan import SCENES, Scene
from hw_adapters.protocols import Applied, MultispectralSensor
from hw_adapters.state import SCRATCH
from twin.errors import InputError


class Hands:
    """Moves what has to be moved, and nothing else; throws frames away after each change.

    Args:
        devices: the bench.
        discard: frames thrown away after each change.

    Attributes:
        stage: step of the sequence that runs.
    """

    def __init__(self, devices: DeviceBench, discard: int) -> None:
        self.stage = "start"
        self._devices, self._frames = devices, discard
        self._scratch = SCRATCH
        self._scene: Scene | None = None
        self._sample: tuple[str, bool] | None = None
        self._background = ""
        self._applied: Applied | None = None

    def move_background(self, position: str) -> None:
        """Put a background in place whatever comes next.

        Raises:
            DeviceError: the stage fails.
        """
        self._background = ""
        self._devices.stage.move_to(position)
        self._background = position

    def prepare(self, capture: str, sample: str, applied: Applied, stage: str) -> None:
        """Sample, background, light and settings as wanted; stale frames thrown away.

        Args:
            capture: the capture whose scene is wanted.
            sample: sample whose height, and if the capture wants it whose presence, is wanted.
            applied: settings of the sensor.
            stage: step of the sequence.

        Raises:
            DeviceError: a device fails; the step after it is repeated in the next call.
        """
        self.stage = stage
        devices, scene = self._devices, SCENES[capture]
        self.announce(stage)
        changed = False
        if self._sample != (sample, scene.present):
            self._sample = None
            devices.holder.place(sample, scene.present)
            self._sample = (sample, scene.present)
            changed = True
        if scene.background not in ("", self._background):
            self.move_background(scene.background)
            changed = True
        if self._scene is None or self._scene.lamp != scene.lamp:
            self._scene = None
            devices.lights.off()
            if scene.lamp:
                devices.lights.set(scene.lamp, 1.0)
            devices.clock.sleep(devices.lights.settle_s)
            changed = True
        self._scene = scene
        if self._applied != applied:
            self._applied = None
            self.apply(applied)
            self._applied = applied
            changed = True
        for _ in range(self._frames if changed else 0):
            self.announce(stage)
            self._discard()

    def _discard(self) -> None:
        try:
            self._devices.sensor.discard()
        except StaleFrame:
            # It is thrown away in any case; another one takes its place.
            self._devices.sensor.discard()

    def apply(self, applied: Applied) -> Applied:
        """Set the sensor; returns what it really has.

        Raises:
            InputError: no registers for a chip.
            DeviceError: the sensor refuses or fails.
        """
        sensor = self._devices.sensor
        if isinstance(sensor, MultispectralSensor):
            if applied.atime is None or applied.astep is None:
                raise InputError(
                    "no registers", "atime and astep of a chip", place=sensor.info.name
                )
            return sensor.configure(applied.gain, applied.atime, applied.astep, applied.averages)
        return sensor.configure(applied.integration_s, applied.averages)

    def announce(self, stage: str) -> None:
        """A reading that is no part of the plan."""
        self.stage = stage
        self._devices.announce(self._scratch, stage)
        self._scratch += 1
