"""Small visits for the tests of measurements."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from twin.bench import Background, Backgrounds, Bench, Sample
from twin.errors import InputError
from twin.instrument import Spectrometer
from twin.measurement import Captures, Measurement, Provenance, Shot, Truth

Answer = TypeVar("Answer")


def answer_of(read: Callable[[], Answer]) -> tuple[Answer | None, InputError | None]:
    """What a reader returns, or the clear error; anything else it raises goes through."""
    try:
        return read(), None
    except InputError as error:
        return None, error


WAVELENGTH_NM = np.array([450.0, 550.0, 650.0])
RHO_WHITE = 0.98
QUIET = Spectrometer(
    pixels_nm=tuple(WAVELENGTH_NM), off=("lamp_drift", "nonlinearity", "stray_light")
)


def bench(instrument: Spectrometer = QUIET) -> Bench:
    """The default bench with a white of known reflectance."""
    white = Background(reflectance=RHO_WHITE)
    return Bench(background=Backgrounds(white=white), instrument=instrument)


def readings(samples: tuple[str, ...] = ("a", "b")) -> list[tuple[Shot, list[float]]]:
    """One reading of everything, with whole numbers that can be checked by hand."""
    table = [
        (Shot("dark", 0.1), [100.0, 110.0, 120.0]),
        (Shot("dark", 0.2), [150.0, 160.0, 170.0]),
        (Shot("white_reference", 0.1), [10100.0, 20110.0, 30120.0]),
        (Shot("black_reference", 0.1), [400.0, 710.0, 1020.0]),
        (Shot("beam_reference", 0.1), [5100.0, 8110.0, 10120.0]),
    ]
    for factor, name in enumerate(samples, start=1):
        table += [
            (Shot("black", 0.1, name), [100.0 + 1000.0 * factor, 2110.0, 3120.0]),
            (Shot("white", 0.1, name), [100.0 + 3000.0 * factor, 8110.0, 9120.0]),
            (Shot("collimated", 0.2, name), [150.0 + 1000.0 * factor, 1760.0, 2170.0]),
        ]
    return table


def visit(
    table: list[tuple[Shot, list[float]]] | None = None,
    *,
    samples: tuple[str, ...] = ("a", "b"),
    saturated: np.ndarray | None = None,
    instrument: Spectrometer = QUIET,
    provenance: Provenance | None = None,
    truth: Truth | None = None,
) -> Measurement:
    """A measurement out of readings."""
    table = readings(samples) if table is None else table
    counts = np.array([values for _, values in table])
    mask = np.zeros(counts.shape, bool) if saturated is None else saturated
    return Measurement(
        bench=bench(instrument),
        samples=tuple(
            Sample(name=name, thickness_mm=0.5 * index)
            for index, name in enumerate(samples, start=1)
        ),
        captures=Captures(tuple(shot for shot, _ in table), WAVELENGTH_NM, counts, mask),
        provenance=provenance or Provenance(origin="simulated", seed=7, software="benchtwin test"),
        truth=truth,
    )
