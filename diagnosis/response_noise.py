"""Whether the Monte Carlo knows its response to an effect well enough to test the effect.

A signature that is mostly noise looks like nothing, and by chance like anything.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from diagnosis.reduction import Reduction
from twin.effects import Candidate
from twin.spectra import FloatArray

LOUD_NOISE = 1.0
"""Noise of a response [standard deviations of the data] up to which it does no harm."""
TOLD_FROM_NOISE = 2.0
"""How many times its noise a response has to be."""
DRAWS = 4
"""Of the noise: each is a sum over all data, and scatters little."""


class Responses(Protocol):
    """What is asked of an engine: how well it knows a signature."""

    @property
    def paths(self) -> int:
        """Light paths of each response."""

    def signature_error(self, candidate: Candidate, material: FloatArray) -> FloatArray:
        """Standard error of an effect's signature, (k, W, S, 3)."""


def response_doubt(
    engine: Responses,
    suspect: Candidate,
    material: FloatArray,
    signature: FloatArray,
    place: np.ndarray,
    reduction: Reduction,
) -> str:
    """Why an effect cannot be tested with the Monte Carlo's response to it; "" where it can.

    Signature and noise are compared for one prior scale of every parameter, in standard
    deviations of the data once the material has taken up all it can.

    Args:
        engine: made the signature.
        suspect: the effect; one whose response is not the Monte Carlo's is never in doubt.
        material: albedo, sigma_t [1/mm] and g that the signature belongs to, (W, 3).
        signature: change of the data per unit of each parameter, (k, W, M).
        place: which sample and capture, 3 s + c, each of the M channels is, (M,).
        reduction: of the data.
    """
    if suspect.engine != "monte_carlo":
        return ""
    scale = np.array([parameter.prior_scale for parameter in suspect.parameters])

    def loudness(change: FloatArray) -> float:
        """Squared length of a change (k, W, M) in standard deviations."""
        return float(np.sum(reduction(np.moveaxis(change * scale[:, None, None], 0, -1)) ** 2))

    error = engine.signature_error(suspect, material)
    error = error.reshape(*error.shape[:2], -1)
    random = np.random.Generator(np.random.Philox(key=1))
    # all repeats of a capture share the response, and its noise
    drawn = (error * random.standard_normal(error.shape) for _ in range(DRAWS))
    noise = np.mean([loudness(one[..., place]) for one in drawn])
    signal = loudness(signature)
    if noise <= LOUD_NOISE**2 or signal >= TOLD_FROM_NOISE**2 * noise:
        return ""
    return (
        f"its response is not known well enough: {np.sqrt(signal):.1f} sigma for one prior scale,"
        f" of which {np.sqrt(noise):.1f} may be noise of the {engine.paths} light paths"
    )
