"""Spectra that move as a whole when one of their values is moved."""

from __future__ import annotations

import numpy as np

from twin.spectra import FloatArray


def move_share(base: FloatArray, index: int, value: float) -> FloatArray:
    """A spectrum of shares moved to a value at one wavelength; all odds change by one factor.

    Shares stay inside 0 to 1. Where the spectrum is 0 or 1 at that wavelength, there is no such
    factor, and the value holds everywhere. Shape (W,).
    """
    here = float(base[index])
    if not (0.0 < here < 1.0 and 0.0 < value < 1.0):
        return np.full_like(base, value)
    factor = value * (1.0 - here) / ((1.0 - value) * here)
    odds = factor * base
    return np.asarray(odds / (1.0 - base + odds))


def move_scale(base: FloatArray, index: int, value: float) -> FloatArray:
    """A spectrum of at least 0 scaled to a value at one wavelength, shape (W,)."""
    here = float(base[index])
    return np.asarray(base * (value / here)) if here > 0.0 else np.full_like(base, value)


def move_cosine(base: FloatArray, index: int, value: float) -> FloatArray:
    """A spectrum of mean cosines moved to a value at one wavelength; -1 to 1 is kept, (W,)."""
    return np.asarray(2.0 * move_share(0.5 * (1.0 + base), index, 0.5 * (1.0 + value)) - 1.0)
