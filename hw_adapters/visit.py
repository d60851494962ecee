"""Which visit a journal belongs to: the same devices, samples and settings from first to last."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from hw_adapters.assemble import pixels_inside
from hw_adapters.bench import DeviceBench
from hw_adapters.errors import RequestOutOfLimits, WrongDevice
from hw_adapters.journal import Journal
from hw_adapters.plan import PlanSettings
from hw_adapters.protocols import DeviceInfo, MultispectralSensor, Spectrometer
from twin.errors import InputError

_SAME_DEVICES = ("devices", "wavelength_nm")


def begin_or_resume(
    devices: DeviceBench, settings: PlanSettings, journal: Journal, *, resume: bool
) -> None:
    """Check the devices, and begin or go on with the journal.

    Raises:
        WrongDevice: another device than before or than the calibration is for.
        RequestOutOfLimits: settings that the sensor cannot take.
        InputError: a journal of another visit, or one where none was asked for.
    """
    infos = devices.devices
    check_sensor(devices, infos[0])
    check_settings(infos[0].name, devices.sensor, settings)
    visit: dict[str, Any] = {
        "devices": [asdict(info) for info in infos],
        "wavelength_nm": [float(value) for value in devices.sensor.wavelength_nm],
        "bench": devices.bench.model_dump(mode="json"),
        "samples": [sample.model_dump(mode="json") for sample in devices.samples],
        "settings": settings.model_dump(mode="json"),
        "seed": devices.seed,
        "range_nm": list(devices.range_nm) if devices.range_nm else None,
        "scenario": devices.scenario,
    }
    if not journal.started:
        journal.begin(visit)
        return
    if not resume:
        raise InputError(
            "the journal of a visit", "an empty folder", file=journal.folder,
            remedy="Go on with it by --resume, or name another folder with --out.",
        )  # fmt: skip
    before = journal.visit()
    # With nothing captured nothing can mix: settings may be mended. Another device is still told.
    empty = journal.exposures() is None and not journal.shots()
    for key, value in visit.items():
        if before.get(key) != value and (key in _SAME_DEVICES or not empty):
            _differs(journal, key, before, visit)
    if empty:
        journal.begin(visit)


def check_settings(
    device: str, sensor: Spectrometer | MultispectralSensor, settings: PlanSettings
) -> None:
    """Refuse what the sensor cannot take before anything is switched on.

    Args:
        device: what messages call the sensor.
        sensor: the sensor.
        settings: of the visit.

    Raises:
        RequestOutOfLimits: an exposure, gain or number of averages outside its limits, or one
            that it does not have.
    """
    limits, exposure = sensor.limits, settings.exposure
    if isinstance(sensor, MultispectralSensor):
        if exposure != "auto":
            raise RequestOutOfLimits(
                device, f"a request for an exposure of {exposure:g} s", 'exposure = "auto"',
                "The time of a chip is that of `atime` and `astep`; its gain is searched for.",
            )  # fmt: skip
        time_s = (settings.atime + 1) * (settings.astep + 1) * limits.step_s
        limits.check(device, time_s, settings.averages, settings.gain)
        return
    time_s = limits.shortest_s if exposure == "auto" else exposure
    limits.check(device, time_s, settings.averages, settings.gain)


def check_sensor(devices: DeviceBench, info: DeviceInfo) -> None:
    """Refuse another sensor than the bench file or the calibration names.

    Args:
        devices: the bench.
        info: what its sensor says it is.

    Raises:
        WrongDevice: another serial number, or other wavelengths.
        InputError: no pixel lies in the range that is wanted.
    """
    if devices.serial and info.serial != devices.serial:
        raise WrongDevice(
            info.name, f"the serial number {info.serial!r}",
            f"{devices.serial!r}, which the bench file names or its calibration is for",
        )  # fmt: skip
    wavelength = devices.sensor.wavelength_nm
    pixels_inside(wavelength, devices.range_nm)
    wanted = devices.calibrated_nm
    if wanted is None:
        return
    if wanted.shape != wavelength.shape or np.abs(wanted - wavelength).max() > 0.05:
        raise WrongDevice(
            info.name,
            f"{wavelength.size} wavelengths from {wavelength[0]:.2f} to {wavelength[-1]:.2f} nm",
            f"those of the calibration, {wanted.size} from {wanted[0]:.2f} to {wanted[-1]:.2f} nm",
            "Calibrate this spectrometer (benchtwin calibrate), or connect the one that was.",
        )


def _differs(journal: Journal, key: str, before: dict[str, Any], now: dict[str, Any]) -> None:
    """Refuse to mix two visits in one journal."""
    if key in _SAME_DEVICES:
        old, new = before["devices"], now["devices"]
        for was, is_ in zip(old, new, strict=True):
            if (was["model"], was["serial"]) != (is_["model"], is_["serial"]):
                raise WrongDevice(
                    f"{is_['model']} {is_['serial']}".strip(),
                    f"another {is_['kind']} than the visit was begun with",
                    f"{was['model']} {was['serial']}".strip(),
                    "Connect the former one and go on with --resume, or begin a new visit.",
                )
        if key == "devices":  # only another version of a driver
            journal.log("devices", devices=new)
            return
        raise WrongDevice(
            _named(now), "other wavelengths than the visit was begun with",
            "the same wavelengths", "Begin a new visit with this spectrometer.",
        )  # fmt: skip
    raise InputError(
        f"another {key.replace('_', ' ')} than the visit was begun with", "the same",
        file=journal.folder, place=key,
        remedy="Undo the change in the bench file, or begin a new visit with --out.",
    )  # fmt: skip


def _named(visit: dict[str, Any]) -> str:
    """The sensor of a visit, as messages call it."""
    sensor = visit["devices"][0]
    return f"{sensor['model']} {sensor['serial']}".strip()
