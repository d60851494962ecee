"""What the captures of a bench are computed from: parameters, constants, form, and their parts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from twin.adding_doubling.phase import TwoTerm
from twin.adding_doubling.streams import Streams, legendre_cone
from twin.spectra import FloatArray


class Parameters(NamedTuple):
    """What a model is evaluated at; W wavelengths, S samples.

    Attributes:
        albedo: single-scattering albedo, (W,); sigma_t_per_mm: extinction coefficient
        [1/mm], (W,); g: anisotropy factor, (W,).
        n: refractive index of the sample, (W,).
        thickness_mm: [mm], (S,).
        rho_black, rho_white: reflectances of the backgrounds, (W,).
    """

    albedo: Any
    sigma_t_per_mm: Any
    g: Any
    n: Any
    thickness_mm: Any
    rho_black: Any
    rho_white: Any


class Surroundings(NamedTuple):
    """Constants by wavelength: covers (W, C) from the air inwards, cone (W, K), moments (W, M)."""

    above_n: Any
    above_depth: Any
    below_n: Any
    below_depth: Any
    cone_cosine: Any
    cone_low: Any
    cone_low_slope: Any
    cone_high: Any
    cone_high_slope: Any
    moments: Any


class Parts(NamedTuple):
    """What captures are made of; arrays of one shape.

    Attributes:
        direct: radiance factor without any light from a background.
        once: what one bounce at a perfectly white background adds.
        returned: share of diffuse light from the background that comes back to it.
        unscattered: share of the beam that arrives unscattered; scattered: scattered into the
            detector's cone.
    """

    direct: Any
    once: Any
    returned: Any
    unscattered: Any
    scattered: Any

    def captures(self, rho_black: Any, rho_white: Any) -> Array:
        """Black, white, collimated, shape (..., 3), for reflectances of the parts' shape."""

        def over(rho: Any) -> Array:
            found: Array = self.direct + rho * self.once / (1.0 - rho * self.returned)
            return found

        return jnp.stack(
            [over(rho_black), over(rho_white), self.unscattered + self.scattered], axis=-1
        )


class Geometry(NamedTuple):
    """What of a bench is the same at all wavelengths: detector, panels, planes, samples' inside."""

    detector: Any
    panel_share: Any
    panel_cosine: Any
    panel_streams: Any
    planes: Any
    thickness_mm: Any
    cone_cosine: Any
    second: TwoTerm = TwoTerm(0.0, 0.0)
    sublayers: Any = ()
    beam: Any = ()


class ObliqueBeam(NamedTuple):
    """A beam whose directions differ from the axis.

    Attributes:
        cosine: in air, of its unscattered light that is accepted.
        share: by which scattered light is divided, because the empty bench collects no more of
            the beam, (S,).
        divergence_deg: half-angle of all its light [deg]; tilt_deg: of its axis [deg].
    """

    cosine: Any
    share: Any
    divergence_deg: Any
    tilt_deg: Any

    def blur(self, n: FloatArray, count: int) -> FloatArray:
        """By what the beam weakens Legendre orders of what is scattered, (W, count).

        The mean over a cone of directions, times P_l of its axis (addition theorem of Legendre
        polynomials, averaged over azimuth).

        Args:
            n: refractive index of the sample, (W,).
            count: orders 0 to count - 1.
        """
        half, tilt = (
            np.sqrt(1.0 - (math.sin(math.radians(each)) / n) ** 2)
            for each in (max(float(self.divergence_deg), 1e-3), float(self.tilt_deg))
        )
        order = np.arange(count)
        cone = 2.0 * legendre_cone(half, count)[0] / (2 * order + 1) / (1.0 - half)[:, None]
        # d c_l / d cosine = -(2 l + 1) / 2 P_l
        axis = -2.0 * legendre_cone(tilt, count)[1] / (2 * order + 1)
        return np.asarray(cone * axis)


class Constants(NamedTuple):
    """Everything that a bench puts into the program besides its parameters."""

    around: Surroundings
    geometry: Geometry


@dataclass(frozen=True)
class Form:
    """What a program is compiled for; benches of one form and shape share it."""

    streams: Streams
    tabulated: bool
    contact: bool
    mirrored: bool
    two_term: bool = False
    layered: bool = False
    oblique: bool = False


BY_WAVELENGTH = Parameters(0, 0, 0, 0, None, 0, 0)
