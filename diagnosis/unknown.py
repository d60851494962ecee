"""The alternative that no catalogue knows: smooth discrepancies of any channel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from diagnosis.problem import Problem
from diagnosis.reduction import Reduction, smooth_kernel
from twin.spectra import FloatArray

LENGTH_NM = 80.0
"""Correlation length of what an unknown effect does over wavelength [nm]."""
AMPLITUDES = (0.003, 0.01, 0.03, 0.1)
"""Relative discrepancies that are considered, equally likely."""
FLOOR = 0.02
"""Relative intensity below which a discrepancy is no longer relative."""


def smooth_columns(
    problem: Problem,
    level: FloatArray,
    functions: FloatArray,
    *,
    by: str = "block",
    floor: float = FLOOR,
) -> FloatArray:
    """Deviations of channels that are smooth over wavelength, shape (W, M, groups F).

    Args:
        problem: with its channels.
        level: expected data, (W, M): deviations are relative to it.
        functions: F shapes over wavelength, (W, F).
        by: "block" for one deviation per (capture, sample), in all repeats alike; "channel" for
            one per channel; "capture" or "capture_repeat" for one per capture (and repeat); "all"
            for one in all.
        floor: level below which deviations are no longer relative to it.
    """
    keys: list[tuple[object, ...]] = []
    for index, channel in enumerate(problem.channels):
        keys.append(
            {
                "block": (channel.capture, channel.sample),
                "channel": (index,),
                "capture": (channel.capture,),
                "capture_repeat": (channel.capture, channel.repeat),
                "all": (),
            }[by]
        )
    groups = list(dict.fromkeys(keys))
    member = np.array([[key == group for group in groups] for key in keys], dtype=float)
    size = np.abs(level) + floor
    columns = (size[:, :, None] * member)[:, :, :, None] * functions[:, None, None, :]
    return np.asarray(columns.reshape(*level.shape, -1))


def process_functions(wavelength_nm: FloatArray) -> FloatArray:
    """Shapes of a Gaussian process of unit variance, half of it constant, (W, F)."""
    kernel = 0.5 + 0.5 * smooth_kernel(wavelength_nm, LENGTH_NM)
    value, vector = np.linalg.eigh(kernel)
    kept = value > 1e-3 * value[-1]
    return np.asarray(vector[:, kept] * np.sqrt(value[kept]))


def polynomials(wavelength_nm: FloatArray, count: int) -> FloatArray:
    """The first orthogonal polynomials over the wavelengths, (W, count)."""
    span = max(float(np.ptp(wavelength_nm)), 1e-9)
    place = 2.0 * (wavelength_nm - wavelength_nm[0]) / span - 1.0
    count = min(count, len(wavelength_nm))
    return np.asarray(np.polynomial.legendre.legvander(place, count - 1))


@dataclass(frozen=True, eq=False)
class Unknown:
    """The Gaussian-process alternative in reduced space.

    Attributes:
        direction: orthonormal directions, (n, U).
        strength: variance along each at unit relative amplitude, (U,).
    """

    direction: FloatArray
    strength: FloatArray

    @classmethod
    def of(cls, problem: Problem, reduction: Reduction, level: FloatArray) -> Unknown:
        """About an expected level of the data, shape (W, M)."""
        functions = process_functions(problem.wavelength_nm)
        columns = reduction(smooth_columns(problem, level, functions))
        direction, root, _ = np.linalg.svd(columns, full_matrices=False)
        kept = root > 1e-6 * np.max(root, initial=1e-300)
        return cls(direction[:, kept], root[kept] ** 2)

    def log_evidence(self, along: FloatArray) -> FloatArray:
        """Log B over no effect of residuals with components `along`, (draws, U) to (draws,)."""
        parts = []
        for amplitude in AMPLITUDES:
            variance = amplitude**2 * self.strength
            parts.append(
                0.5 * along**2 @ (variance / (1.0 + variance)) - 0.5 * np.sum(np.log1p(variance))
            )
        return np.asarray(logsumexp(parts, axis=0) - np.log(len(AMPLITUDES)))
