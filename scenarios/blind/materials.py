"""Two families of materials with random smooth spectra, drawn by different laws.

"ink": bands of a dye in a host of power-law scattering, as `scenarios.stress.spectra` draws them.

"resin", held out for the published run: a turbid resin. With u from 0 to 1 over 360 to 740 nm

    sigma_s = s (c + (1 - c) exp(-r u))            filler: c uniform 0.2..1, r uniform 0.5..3
    1 - g   = (1 - g0) (1 + q (u - 1/2))           q uniform -0.5..0.5
    sigma_a = s (a0 + y exp(-u / t) + sum_k b_k / (1 + ((u - u_k) / w_k)^2)^2)

an edge in the blue that yellows (Urbach 1953: exponential tails), y log-uniform 0.003..1, t uniform
0.08..0.3, and up to three overtone-like bands of squared Lorentzian shape, w_k uniform 0.06..0.2,
b_k log-uniform 0.002..1, on a floor a0 log-uniform 0.002..0.1.

Both stay within albedo 0.5 to 0.995, sigma_t 1 to 8 per mm and g 0 to 0.9.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from scenarios.stress.spectra import TRIES, spectrum_inside
from twin.errors import InputError
from twin.spectra import FloatArray

GRID_NM = np.arange(360.0, 741.0, 5.0)
LOW = np.array([0.5, 1.0, 0.0])
HIGH = np.array([0.995, 8.0, 0.9])
"""Least and greatest albedo, sigma_t [1/mm] and g."""


def medium(family: str, stream: np.random.Generator) -> dict[str, Any]:
    """A material as a scenario takes it: tables of albedo, sigma_t_per_mm and g.

    Args:
        family: "ink" or "resin".
        stream: random numbers.

    Raises:
        InputError: an unknown family.
    """
    if family == "ink":
        found = spectrum_inside(stream, GRID_NM, stream.random(2), LOW, HIGH)
    elif family == "resin":
        found = _resin(stream)
    else:
        raise InputError(f'"{family}"', "ink or resin", place="family")
    nodes = GRID_NM.tolist()
    names = ("albedo", "sigma_t_per_mm", "g")
    return {
        name: {"wavelength_nm": nodes, "value": column.tolist()}
        for name, column in zip(names, found.T, strict=True)
    }


def _resin(stream: np.random.Generator) -> FloatArray:
    u = (GRID_NM - GRID_NM[0]) / np.ptp(GRID_NM)
    for _ in range(TRIES):
        size = np.exp(stream.uniform(np.log(LOW[1]), np.log(HIGH[1])))
        constant, rate = stream.uniform(0.2, 1.0), stream.uniform(0.5, 3.0)
        scattering = constant + (1.0 - constant) * np.exp(-rate * u)
        forward = 1.0 - stream.uniform(0.1, 1.0) * (1.0 + stream.uniform(-0.5, 0.5) * (u - 0.5))
        absorption = np.full(u.shape, _even_in_log(stream, 0.002, 0.1))
        tail = stream.uniform(0.08, 0.3)
        absorption = absorption + _even_in_log(stream, 0.003, 1.0) * np.exp(-u / tail)
        for _ in range(int(stream.integers(0, 4))):
            centre, width = stream.uniform(0.0, 1.0), stream.uniform(0.06, 0.2)
            height = _even_in_log(stream, 0.002, 1.0)
            absorption = absorption + height / (1.0 + ((u - centre) / width) ** 2) ** 2
        total = scattering + absorption
        found = np.stack([scattering / total, size * total, forward], axis=-1)
        if np.all((found >= LOW) & (found <= HIGH)):
            return np.asarray(found)
    raise InputError(f"no resin inside the ranges in {TRIES} tries", "ranges that leave room")


def _even_in_log(stream: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(stream.uniform(np.log(low), np.log(high))))
