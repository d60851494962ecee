"""Uncertainty of a material from the Fisher information of its captures, before they are taken.

About the true material the captures are linear: y = J p + M e + noise, with noise of covariance N
and imperfections e of unit variance (tolerances times `modes`). What the best unbiased estimator
reaches is the inverse of the information, e marginalised:

    S = [J M]' N^-1 [J M] + diag(prior of p, 1),    covariance of p = (S^-1)_pp

(Kay 1993, "Estimation Theory", chapter 3). N is block-diagonal by sample, so that the information
of a set of samples is the sum of theirs: one table serves every choice of thicknesses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scenarios.design.modes import Modes
from scenarios.design.optics import ENGINE_ERROR, MATERIAL, Light
from twin.spectra import FloatArray

G_RANGE = 2.0
"""Width of the range of g; of albedo it is 1 (uniform priors, as least squares has them)."""
UNIFORM = 12.0
"""Precision of a uniform distribution of width 1."""


@dataclass(frozen=True, eq=False)
class Information:
    """Information of single samples with unit tolerances.

    Attributes:
        matrix: about the material, the common and the private modes, (M, K, W, D, D).
        common, private: names of the modes.
        material: albedo, sigma_t [1/mm] and g, (M, W, 3).
        thickness_mm: of the samples [mm], (K,).
        shift: by how much the material around which the captures are linear, and which an estimate
            finds, is off, (M, W, 3).
    """

    matrix: FloatArray
    common: tuple[str, ...]
    private: tuple[str, ...]
    material: FloatArray
    thickness_mm: FloatArray
    shift: FloatArray

    @classmethod
    def of(
        cls, light: Light, noise: FloatArray, modes: Modes, material: FloatArray,
        thickness_mm: FloatArray, shift: FloatArray | None = None,
    ) -> Information:  # fmt: skip
        """Information of every sample by itself.

        Args:
            light: of M materials, K thicknesses, W wavelengths.
            noise: covariance of the captures, (M, K, W, 3, 3).
            modes: of the imperfections.
            material: albedo, sigma_t and g, (M, W, 3).
            thickness_mm: [mm], (K,).
            shift: of the material around which the captures are linear, (M, W, 3); None: none.
        """
        place = np.arange(3)
        whole = noise.copy()
        whole[..., place, place] += (ENGINE_ERROR * light.value) ** 2 + 1e-18
        columns = np.concatenate([light.slope[..., :MATERIAL], modes.array], axis=-1)
        scale = np.sqrt(whole[..., place, place])
        whole /= scale[..., :, None] * scale[..., None, :]
        lean = np.linalg.solve(np.linalg.cholesky(whole), columns / scale[..., None])
        matrix = np.einsum("...ci,...cj->...ij", lean, lean)
        moved = np.zeros_like(material) if shift is None else shift
        return cls(matrix, modes.common, modes.private, material, np.asarray(thickness_mm), moved)


@dataclass(frozen=True, eq=False)
class Predicted:
    """What N sets of samples tell of M materials at W wavelengths.

    Attributes:
        covariance: of albedo, sigma_t [1/mm] and g, (N, M, W, 3, 3).
        gain: how one standard deviation of every mode moves the estimate, (N, M, W, 3, Q);
            the private modes of sample s are columns of their own.
        modes: names of these columns; those of samples with their number.
        bias: of the estimate, by the width of bands, (N, M, W, 3).
    """

    covariance: FloatArray
    gain: FloatArray
    modes: tuple[str, ...]
    bias: FloatArray

    @property
    def error(self) -> FloatArray:
        """Expected error of albedo, sigma_t and g: `standard` and `bias` together, (N, M, W, 3)."""
        return np.hypot(self.standard, self.bias)

    @property
    def standard(self) -> FloatArray:
        """Standard uncertainty of albedo, sigma_t and g, (N, M, W, 3)."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1)))


def predicted(
    information: Sequence[Information],
    samples: Sequence[Sequence[int]],
    scales: Sequence[FloatArray],
) -> Predicted:
    """Marginal covariance of the material for N sets of samples.

    Args:
        information: of the samples of each, with the same modes.
        samples: which of the K samples each has; equally many, S.
        scales: tolerances of common and private modes, (Q + P,) each.
    """
    first = information[0]
    count, common, private = len(samples[0]), len(first.common), len(first.private)
    size = MATERIAL + common + count * private
    shape = (len(samples), *first.material.shape[:2], size, size)
    total = np.zeros(shape)
    head = np.arange(MATERIAL + common)
    for number, (own, chosen, scale) in enumerate(zip(information, samples, scales, strict=True)):
        factor = np.concatenate([np.ones(MATERIAL), scale])
        for slot, k in enumerate(chosen):
            tail = MATERIAL + common + slot * private + np.arange(private)
            rows = np.concatenate([head, tail])
            part = own.matrix[:, k] * factor[:, None] * factor
            total[number][:, :, rows[:, None], rows] += part
    wide = prior_widths(information, samples)
    # in units of the prior the matrix is well conditioned
    widths = np.concatenate([wide, np.ones((*wide.shape[:-1], size - MATERIAL))], axis=-1)
    total *= widths[..., :, None] * widths[..., None, :]
    total[..., np.arange(size), np.arange(size)] += 1.0
    inverse = np.linalg.inv(total)
    inverse *= widths[..., :, None] * widths[..., None, :]
    covariance = inverse[..., :MATERIAL, :MATERIAL]
    # estimate minus truth when mode q is one standard deviation: minus the cross-covariance,
    # as the estimate of q itself falls short by what its prior of 1 weighs
    gain = -inverse[..., :MATERIAL, MATERIAL:]
    bias = np.array([own.shift for own in information])
    names = [*first.common, *(f"{p} #{s + 1}" for s in range(count) for p in first.private)]
    return Predicted(covariance, gain, tuple(names), bias)


def prior_widths(
    information: Sequence[Information], samples: Sequence[Sequence[int]]
) -> FloatArray:
    """Standard deviations of the prior, (N, M, W, 3): those of `estimators.least_squares`."""
    rows = []
    for own, chosen in zip(information, samples, strict=True):
        thickest = own.thickness_mm[list(chosen)].max()
        sigma_t = own.material[..., 1]
        flat = np.full_like(sigma_t, UNIFORM**-0.5)
        rows.append(np.stack([flat, 4.0 * (sigma_t + 1.0 / thickest), G_RANGE * flat], axis=-1))
    return np.array(rows)
