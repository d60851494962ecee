"""What the Ocean USB650 is made of: pixels, wavelengths, limits, and how a frame travels.

Nothing here needs a driver library: the twin describes the same instrument without any.

Source: seabreeze 2.11 (`seabreeze/pyseabreeze/devices.py`, class USB650;
`features/spectrometer.py`, class SeaBreezeSpectrometerFeatureOOI2K).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.instrument import Spectrometer

PIXELS = 2048
FRAME_BYTES = 2 * PIXELS + 1
FULL_SCALE = 4095
BLOCK = 64
"""Pixels whose low bytes travel together, before their high bytes."""
SYNC = 0x69
SHORTEST_MS, LONGEST_MS = 3, 655_350
"""Integration times [ms] that the device takes."""
COEFFICIENTS = (350.0, 0.327, -4.0e-6, 0.0)
"""Wavelength [nm] of pixel p: c0 + c1 p + c2 p**2 + c3 p**3, about 350 to 1000 nm."""


def frame_bytes(counts: NDArray[np.integer]) -> bytes:
    """A frame on the wire: per 64 pixels 64 low bytes, then 64 high bytes; a sync byte at the end.

    Args:
        counts: readings [counts], shape (2048,), 0 to 4095.

    Raises:
        ValueError: another shape, another type, or readings that 12 bits do not hold.
    """
    values = np.asarray(counts)
    if values.shape != (PIXELS,) or not np.issubdtype(values.dtype, np.integer):
        raise ValueError(
            f"found a frame of {values.dtype}, shape {values.shape};"
            f" expected whole numbers, shape ({PIXELS},)"
        )
    if values.min() < 0 or values.max() > FULL_SCALE:
        raise ValueError(
            f"found counts {values.min()} to {values.max()}; expected 0 to {FULL_SCALE}"
        )
    pairs = values.astype("<u2").view(np.uint8).reshape(-1, BLOCK, 2)
    return pairs.transpose(0, 2, 1).tobytes() + bytes([SYNC])


def coefficient_text(value: float) -> str:
    """A coefficient as the EEPROM holds it: at most 14 characters, which are then the truth."""
    for digits in range(9, 0, -1):
        text = f"{value:.{digits}g}"
        if len(text) <= 14:
            return text
    raise ValueError(f"found {value!r}; expected a number of at most 14 characters")


def wavelengths_nm(coefficients: Sequence[float] = COEFFICIENTS) -> NDArray[np.float64]:
    """Wavelength [nm] of every pixel as seabreeze computes it from the EEPROM, shape (2048,)."""
    pixel = np.arange(PIXELS, dtype=np.float64)
    total = np.zeros(PIXELS)
    for power, value in enumerate(coefficients):
        total = total + float(coefficient_text(value)) * pixel**power
    return total


def usb650_instrument(**changes: Any) -> Spectrometer:
    """The USB650 as the twin describes it: the pixels and the converter of its stand-in.

    Electrons, noise and dark level are those of a Sony ILX511 in an Ocean USB2000 (operating
    manual, "CCD detector specifications": 62 500 electrons, 12 bits, 2.5 to 4 counts of noise).

    Args:
        **changes: fields of `twin.instrument.Spectrometer` to set otherwise.
    """
    fields: dict[str, Any] = {
        "pixels_nm": tuple(wavelengths_nm().tolist()),
        "bandwidth_nm": 2.0,
        "adc_bits": 12,
        "electrons_per_count": 15.3,
        "full_well_electrons": 66_000.0,
        "read_noise_electrons": 46.0,
        "dark_level_counts": 120.0,
        "shortest_s": SHORTEST_MS / 1000,
        "longest_s": (LONGEST_MS - 1) / 1000,
        "white_rate_electrons_per_s": 4e5,
        "beam_rate_electrons_per_s": 1e6,
    }
    return Spectrometer(**(fields | changes))
