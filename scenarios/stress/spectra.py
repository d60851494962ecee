"""Random smooth spectra of materials: absorption bands in a host of power-law scattering.

A spectrum over the share u = (wavelength - first) / (last - first) of a visit's range is

    sigma_s   = s v^-b                              b uniform from 0 to 2.5
    1 - g     = (1 - g0) v^c                        c uniform from -0.4 to 0.4
    sigma_a   = s (a0 + sum_k a_k exp(-(u - u_k)^2 / (2 w_k^2)))

with v the wavelength over that of the middle; one to four bands, their centres u_k uniform from
-0.1 to 1.1, their widths w_k log-uniform from 0.08 to 0.27 (24 to 80 nm of 300 nm), their heights
a_k log-uniform from 0.003 to 5, the floor a0 from 0.0005 to 0.2. s and g0 cover their ranges as in
a random design. A spectrum that leaves a range anywhere is drawn again. Scattering in powers of
the wavelength: Jacques (2013), Phys. Med. Biol. 58, R37, section 2; Gaussian bands are what dyes
and pigments commonly show.

Nothing here is what a smoothness prior of an estimator assumes: these are no splines.
"""

from __future__ import annotations

import numpy as np

from twin.errors import InputError
from twin.spectra import FloatArray

POWER = (0.0, 2.5)
"""Exponent of scattering."""
FORWARD = (-0.4, 0.4)
"""Exponent of 1 - g."""
BANDS = (1, 4)
CENTRE = (-0.1, 1.1)
WIDTH = (0.08, 0.27)
HEIGHT = (3e-3, 5.0)
FLOOR = (5e-4, 0.2)
"""Absorption between bands, in units of the scattering in the middle."""
TRIES = 10_000


def smooth_spectrum(
    stream: np.random.Generator,
    wavelength_nm: FloatArray,
    sigma_s_per_mm: float,
    g: float,
) -> FloatArray:
    """One spectrum, (albedo, sigma_t [1/mm], g) at W wavelengths, shape (W, 3).

    Args:
        stream: random numbers.
        wavelength_nm: increasing [nm], shape (W,), two or more.
        sigma_s_per_mm: scattering in the middle of the range [1/mm].
        g: anisotropy factor there.
    """
    first, last = wavelength_nm[0], wavelength_nm[-1]
    share = (wavelength_nm - first) / (last - first)
    relative = wavelength_nm / (0.5 * (first + last))
    scattering = relative ** -stream.uniform(*POWER)
    forward = 1.0 - (1.0 - g) * relative ** stream.uniform(*FORWARD)
    absorption = np.full(share.shape, _even_in_log(stream, FLOOR))
    for _ in range(int(stream.integers(BANDS[0], BANDS[1] + 1))):
        centre, width = stream.uniform(*CENTRE), _even_in_log(stream, WIDTH)
        height = _even_in_log(stream, HEIGHT)
        absorption = absorption + height * np.exp(-0.5 * ((share - centre) / width) ** 2)
    total = scattering + absorption
    return np.stack([scattering / total, sigma_s_per_mm * total, forward], axis=-1)


def spectrum_inside(
    stream: np.random.Generator,
    wavelength_nm: FloatArray,
    start: FloatArray,
    low: FloatArray,
    high: FloatArray,
) -> FloatArray:
    """The first spectrum that stays inside the ranges, shape (W, 3).

    Args:
        stream: random numbers.
        wavelength_nm: increasing [nm], shape (W,).
        start: shares (0 to 1) of the ranges of sigma_t and g, where the middle of the spectrum is
            tried first, shape (2,); later tries are anywhere.
        low: least albedo, sigma_t [1/mm] and g, shape (3,).
        high: greatest.

    Raises:
        InputError: ranges that no spectrum stays in.
    """
    share = start
    for _ in range(TRIES):
        sigma_s = float(low[1] * (high[1] / low[1]) ** share[0])
        g = float(1.0 - (1.0 - low[2]) * ((1.0 - high[2]) / (1.0 - low[2])) ** share[1])
        found = smooth_spectrum(stream, wavelength_nm, sigma_s, g)
        if np.all((found >= low) & (found <= high)):
            return found
        share = stream.random(2)
    raise InputError(
        f"no smooth spectrum inside the ranges in {TRIES} tries",
        "ranges that leave room for absorption bands",
        place="materials",
        remedy="Widen albedo, sigma_t_per_mm and g.",
    )


def _even_in_log(stream: np.random.Generator, ends: tuple[float, float]) -> float:
    low, high = np.log(ends)
    return float(np.exp(stream.uniform(low, high)))
