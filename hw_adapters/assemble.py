"""From the journal's shots to the measurement that estimators read."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from hw_adapters.bench import DeviceBench
from hw_adapters.journal import Taken
from hw_adapters.plan import PlannedShot
from twin.bench import Bench
from twin.errors import InputError
from twin.instrument import Instrument, Spectrometer
from twin.measurement import Captures, Measurement, Provenance, Shot
from twin.spectra import FloatArray


def assembled(
    devices: DeviceBench,
    plan: tuple[PlannedShot, ...],
    taken: Mapping[int, Taken],
    notes: tuple[str, ...],
) -> Measurement:
    """The measurement of a complete visit.

    Args:
        devices: the bench.
        plan: the shots in their order.
        taken: the shots in the journal, by number.
        notes: what the checks found.

    Returns:
        The measurement; of a virtual bench with origin "simulated" and its seed.

    Raises:
        InputError: a shot is missing, or no pixel lies in the range.
    """
    missing = [shot.label for shot in plan if shot.number not in taken]
    if missing:
        raise InputError(f"no {missing[0]}", "every shot of the plan")
    wavelength = devices.sensor.wavelength_nm
    inside = pixels_inside(wavelength, devices.range_nm)
    ordered = [taken[shot.number] for shot in plan]
    shots = tuple(
        Shot(
            capture=planned.capture,
            integration_s=found.frame.applied.integration_s,
            sample=planned.sample,
            repeat=planned.repeat,
            averages=found.frame.applied.averages,
            time_s=found.frame.time_s,
            gain=found.frame.applied.gain,
        )
        for planned, found in zip(plan, ordered, strict=True)
    )
    return Measurement(
        bench=described(devices.bench, wavelength[inside]),
        samples=devices.samples,
        captures=Captures(
            shots,
            wavelength[inside],
            np.array([each.frame.counts[inside] for each in ordered]),
            np.array([each.frame.saturated[inside] for each in ordered]),
            light_se=devices.light_se,
        ),
        provenance=Provenance(
            origin="simulated" if devices.origin == "virtual" else "measured",
            seed=devices.seed,
            serial_numbers=tuple(info.serial for info in devices.devices if info.serial),
            software=_software(),
            scenario=devices.scenario,
            noise=devices.noise,
            notes=(*_who(devices), *notes),
        ),
        truth=devices.truth,
    )


def described(bench: Bench, wavelength_nm: FloatArray) -> Bench:
    """The bench with the wavelengths that its sensor really has [nm], shape (P,)."""
    instrument: Instrument = bench.instrument
    if np.array_equal(instrument.wavelength_nm, wavelength_nm):
        return bench
    if not isinstance(instrument, Spectrometer):
        raise InputError(
            f"a sensor with {wavelength_nm.size} channels",
            f"the {len(instrument.wavelength_nm)} channels of the bench's description",
            place="bench.instrument.channels",
            remedy="Describe the channels of the chip, or connect the one that is described.",
        )
    pixels = tuple(float(value) for value in wavelength_nm)
    return bench.model_copy(
        update={"instrument": instrument.model_copy(update={"pixels_nm": pixels})}
    )


def pixels_inside(
    wavelength: FloatArray, range_nm: tuple[float, float] | None
) -> NDArray[np.bool_]:
    """Which pixels enter the measurement, shape (P,).

    Raises:
        InputError: none of them.
    """
    if range_nm is None:
        return np.ones(wavelength.shape, dtype=np.bool_)
    inside = (wavelength >= range_nm[0]) & (wavelength <= range_nm[1])
    if not inside.any():
        raise InputError(
            f"no pixel from {range_nm[0]:g} to {range_nm[1]:g} nm",
            f"a range that overlaps {wavelength[0]:g} to {wavelength[-1]:g} nm",
            place="range_nm",
        )
    return np.asarray(inside)


def _who(devices: DeviceBench) -> tuple[str, ...]:
    """Which devices took part, with their seam."""
    return tuple(f"{info.kind}: {info.name} ({info.seam})" for info in devices.devices)


def _software() -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return f"benchtwin {version('benchtwin')}"
    except PackageNotFoundError:
        return "benchtwin (not installed)"
