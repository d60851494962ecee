"""The importance that splits paths on their way through a deep stack, by diffusion theory.

Light that starts at one face and is wanted behind the other: the importance of a place is, up
to a factor, the share of light set free there that gets through. In a layer of single-scattering
albedo a and anisotropy factor g it solves phi'' = kappa^2 phi over optical depth, with kappa the
smallest diffusion exponent of the transport equation and D phi', D = 1 / (3 (1 - a g)), the same
on both sides of a border (Case and Zweifel 1967, chapters 6 and 8). Nothing is exact about this,
and nothing has to be: estimates keep their expectation with any importance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.spectra import FloatArray
from twin.transport.tables import FlatStack, fresnel

SIZE = 4096
LARGEST_LOG = 60.0
MILNE = 0.7104 * 1.5
LARGEST_ALBEDO = 1.0 - 1.0e-7
ORDERS = 128


@dataclass(frozen=True)
class Importance:
    """Importance over the optical depth from the face where light starts.

    Attributes:
        lowest, highest: optical depths of the table's ends (with the lead of moving straight on).
        log_importance: evenly between them, shape (SIZE + 1,).
        depth: optical depth of each layer's face on the starting side, shape (L,).
        lead: optical depth that a path about to scatter gains per unit of its direction cosine
            onwards, shape (L,): g / (1 - a g).
    """

    lowest: float
    highest: float
    log_importance: FloatArray
    depth: FloatArray
    lead: FloatArray


def diffusion_exponent(albedo: float, g: float) -> float:
    """Smallest diffusion exponent [per unit optical depth] of Henyey-Greenstein scattering.

    The spherical harmonics of the asymptotic solution obey
    (2 l + 1) (1 - a g^l) f_l = kappa ((l + 1) f_{l+1} + l f_{l-1}): 1 / kappa is the largest
    eigenvalue of a symmetric tridiagonal matrix (van de Hulst 1980, section 6.2).
    """
    order = np.arange(ORDERS)
    # g = 0 has 0**0 = 1 as its zeroth moment, as it should
    scale = np.sqrt((2 * order + 1) * (1.0 - min(albedo, LARGEST_ALBEDO) * g**order))
    beside = order[1:] / (scale[1:] * scale[:-1])
    return float(1.0 / np.linalg.eigvalsh(np.diag(beside, 1) + np.diag(beside, -1))[-1])


def _inner_reflectance(n: float) -> float:
    """Reflectance of the face to air for diffuse light inside."""
    nodes, weights = np.polynomial.legendre.leggauss(64)
    cosine, weight = 0.5 * (nodes + 1.0), 0.5 * weights
    outside = np.sqrt(np.maximum(0.0, 1.0 - n**2 * (1.0 - cosine**2)))
    reflectance = np.where(outside > 0.0, fresnel(n, 1.0, cosine, outside), 1.0)
    return float(np.sum(2.0 * cosine * weight * reflectance))


def importance_of(stack: FlatStack, albedo: float, from_below: bool) -> Importance:
    """Importance of getting through a stack, for one albedo of the counted layer.

    Args:
        stack: the layers; at least one of them scatters.
        albedo: reference albedo of the counted layer; other layers have their own.
        from_below: light starts below the stack.

    Raises:
        ValueError: no layer has an extinction coefficient.
    """
    thickness = stack.sigma_t * stack.thickness
    if not np.any(thickness > 0.0):
        raise ValueError("splitting needs a stack with a scattering layer")
    albedos = np.array(stack.albedo, dtype=np.float64)
    if stack.counted >= 0:
        albedos[stack.counted] = albedo
    lead = np.where(thickness > 0.0, stack.g / np.maximum(1e-3, 1.0 - albedos * stack.g), 0.0)
    passed = np.cumsum(thickness)
    depth = passed[-1] - passed if from_below else passed - thickness
    margin = float(np.max(np.abs(lead)))
    lowest, highest = -margin, float(passed[-1]) + margin
    x = np.linspace(lowest, highest, SIZE + 1)
    log_value = np.empty_like(x)
    layers = [i for i in range(len(thickness)) if thickness[i] > 0.0]
    if from_below:
        layers.reverse()
    reflected = _inner_reflectance(float(stack.n[layers[0]]))
    value, flux, level = 2.0 * MILNE * (1.0 + reflected) / (1.0 - reflected), 1.0, 0.0
    for i in layers:
        diffusivity = 1.0 / (3.0 * max(1e-3, 1.0 - albedos[i] * stack.g[i]))
        kappa = diffusion_exponent(float(albedos[i]), float(stack.g[i]))
        if i == layers[0]:
            within = x < depth[i] + thickness[i]
        else:
            within = (x >= depth[i]) & (x < depth[i] + thickness[i])
        if i == layers[-1]:
            within |= x >= depth[i]
        # halves of the growing and of the fading exponential
        grow = 0.5 * (value + flux / (diffusivity * kappa))
        fade = 0.5 * (value - flux / (diffusivity * kappa))
        y = kappa * (x[within] - depth[i])
        # ahead of the starting face the solution would pass through zero
        inner = grow + fade * np.exp(-2.0 * y)
        log_value[within] = level + y + np.log(np.maximum(inner, 0.15 * value * np.exp(-y)))
        y = kappa * thickness[i]
        scale = np.exp(-2.0 * y)
        value, flux = grow + fade * scale, diffusivity * kappa * (grow - fade * scale)
        level += y
    return Importance(lowest, highest, np.minimum(log_value, LARGEST_LOG), depth, lead)
