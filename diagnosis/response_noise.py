"""How well the Monte Carlo has to know its response to an effect, and whether it does.

A signature that is mostly noise looks like nothing, and by chance like anything.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import numpy as np

from diagnosis.reduction import Reduction
from twin.effects import Candidate
from twin.spectra import FloatArray

LOUD_NOISE = 1.0
"""Noise of a response [standard deviations of the data] up to which it does no harm."""
TOLD_FROM_NOISE = 2.0
"""How many times its noise a response has to be."""
WELL_KNOWN = 4.0
"""How many times its noise a response should be, as long as paths for it are to be had."""
MOST_TIMES = 8
"""By which the paths of one response are multiplied at most."""
DRAWS = 4
"""Of the noise: each is a sum over all data, and scatters little."""


class Responses(Protocol):
    """What is asked of an engine: how well it knows a signature."""

    def signature_error(self, candidate: Candidate, material: FloatArray) -> FloatArray:
        """Standard error of an effect's signature, (k, W, S, 3)."""


class Loudness(NamedTuple):
    """A response to one prior scale of every parameter, in standard deviations of the data.

    Attributes:
        signal: all that is seen, noise included.
        noise: of it by the Monte Carlo.
    """

    signal: float
    noise: float

    @property
    def sure(self) -> bool:
        """Whether an effect can be tested with it."""
        return self.noise <= LOUD_NOISE or self.signal >= TOLD_FROM_NOISE * self.noise

    def doubt(self, paths: int) -> str:
        """Why an effect cannot be tested with it, a response of so many light paths; "" if sure."""
        if self.sure:
            return ""
        return (
            f"its response is not known well enough: {self.signal:.1f} sigma for one prior scale,"
            f" of which {self.noise:.1f} may be noise of the {paths} light paths"
        )

    @property
    def times_wanted(self) -> int:
        """How many times the paths would make it well known: a power of 2; 1: it is, or cannot."""
        if not math.isfinite(self.signal + self.noise):
            return 1
        true = math.sqrt(max(self.signal**2 - self.noise**2, 0.0))
        wanted = (self.noise / max(LOUD_NOISE, true / WELL_KNOWN)) ** 2
        if wanted <= 1.0:
            return 1
        times = min(2 ** math.ceil(math.log2(wanted)), MOST_TIMES)
        left = self.noise / math.sqrt(times)
        # the noise may hide as much signal as itself
        return times if left <= max(LOUD_NOISE, max(true, self.noise) / TOLD_FROM_NOISE) else 1


def loudness(
    engine: Responses,
    suspect: Candidate,
    material: FloatArray,
    signature: FloatArray,
    place: np.ndarray,
    reduction: Reduction,
) -> Loudness:
    """How loud a response is, and its noise, once the material has taken up all it can.

    Args:
        engine: made the signature.
        suspect: the effect; a response that is not the Monte Carlo's has no noise.
        material: albedo, sigma_t [1/mm] and g that the signature belongs to, (W, 3).
        signature: change of the data per unit of each parameter, (k, W, M).
        place: which sample and capture, 3 s + c, each of the M channels is, (M,).
        reduction: of the data.
    """
    if suspect.engine != "monte_carlo":
        return Loudness(math.inf, 0.0)
    scale = np.array([parameter.prior_scale for parameter in suspect.parameters])

    def squared(change: FloatArray) -> float:
        return float(np.sum(reduction(np.moveaxis(change * scale[:, None, None], 0, -1)) ** 2))

    error = engine.signature_error(suspect, material)
    error = error.reshape(*error.shape[:2], -1)
    random = np.random.Generator(np.random.Philox(key=1))
    # all repeats of a capture share the response, and its noise
    drawn = (error * random.standard_normal(error.shape) for _ in range(DRAWS))
    noise = float(np.mean([squared(one[..., place]) for one in drawn]))
    return Loudness(math.sqrt(squared(signature)), math.sqrt(noise))
