"""Specular transfer of a layered stack, tabulated over the cosine in air.

For a fixed direction in air the layers form a one-dimensional problem: reflectances and
transmittances of everything above and below a layer follow by adding interfaces one by one
(incoherent light, unpolarised Fresnel; Stokes 1862).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from twin.spectra import FloatArray

TABLE_SIZE = 1024
COLUMNS = 8


@dataclass(frozen=True)
class FlatStack:
    """A stack at one wavelength, top to bottom; every array has shape (L,).

    Attributes:
        thickness: [mm]; n: refractive index; sigma_t: [1/mm] (0 = clear); g: anisotropy
        factor; albedo: of every layer but the counted one; counted: index of the layer whose
        albedo stays free, or -1.
        second_share, second_g: second lobe of the phase function (see `twin.bench.Medium`), or
        None for none in any layer.
    """

    thickness: FloatArray
    n: FloatArray
    sigma_t: FloatArray
    g: FloatArray
    albedo: FloatArray
    counted: int
    second_share: FloatArray | None = None
    second_g: FloatArray | None = None

    @property
    def first_g(self) -> FloatArray:
        """Anisotropy factor of the first lobe of every layer, shape (L,)."""
        if self.second_share is None or self.second_g is None:
            return self.g
        return np.asarray((self.g - self.second_share * self.second_g) / (1.0 - self.second_share))

    @property
    def height(self) -> float:
        """Sum of the thicknesses [mm]."""
        return float(self.thickness.sum())


def fresnel(n1: float, n2: float, cos1: FloatArray, cos2: FloatArray) -> FloatArray:
    """Unpolarised Fresnel reflectance from the cosines on both sides of an interface."""
    with np.errstate(invalid="ignore", divide="ignore"):
        s = (n1 * cos1 - n2 * cos2) / (n1 * cos1 + n2 * cos2)
        p = (n1 * cos2 - n2 * cos1) / (n1 * cos2 + n2 * cos1)
        reflectance = 0.5 * (s * s + p * p)
    # grazing light in air between equal indices meets no interface at all
    return np.where(np.isfinite(reflectance), reflectance, 0.0 if n1 == n2 else 1.0)


def _cosines(n: FloatArray, cos_air: FloatArray) -> FloatArray:
    """Cosine inside each layer, shape (L, M)."""
    return np.sqrt(np.maximum(1e-12, 1.0 - (1.0 - cos_air**2)[None, :] / n[:, None] ** 2))


def _approach(
    n: FloatArray, absorbed: FloatArray, cosines: FloatArray, cos_air: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Everything above each layer, seen from inside it, by adding downwards from the air.

    Takes n (L,), the one-way attenuation and the cosine of each layer (L, M), and the cosines
    in air (M,).

    Returns:
        (T, R) of all above layer i, shape (L, M) each, and (T, R) of the whole stack seen from
        the last air below, shape (M,) each.
    """
    count = len(n)
    transmitted, reflected = np.empty((2, *cosines.shape))
    t_above = np.ones_like(cos_air)
    r_above = np.zeros_like(cos_air)
    n_previous, cos_previous, fade = 1.0, cos_air, np.ones_like(cos_air)
    for i in range(count + 1):
        n_here = n[i] if i < count else 1.0
        cos_here = cosines[i] if i < count else cos_air
        r = fresnel(n_here, n_previous, cos_here, cos_previous)
        t = 1.0 - r
        r_faded = r_above * fade * fade
        series = 1.0 / (1.0 - r * r_faded)
        t_above, r_above = t * fade * t_above * series, r + t * t * r_faded * series
        if i < count:
            transmitted[i], reflected[i] = t_above, r_above
            n_previous, cos_previous, fade = n_here, cos_here, absorbed[i]
    return transmitted, reflected, t_above, r_above


def stack_transfer(
    stack: FlatStack, cos_air: FloatArray, from_below: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Unscattered transmittance and specular reflectance of the whole stack.

    Args:
        stack: the layers.
        cos_air: cosines of the angle in air, shape (M,).
        from_below: light arrives from below.

    Returns:
        (T, R), shape (M,) each.
    """
    order = slice(None) if from_below else slice(None, None, -1)
    cosines = _cosines(stack.n, cos_air)
    fade = np.exp(-(stack.sigma_t * stack.thickness)[:, None] / cosines)
    _, _, t, r = _approach(stack.n[order], fade[order], cosines[order], cos_air)
    return t, r


def transfer_table(stack: FlatStack, from_below: bool) -> FloatArray:
    """Table [layer or whole stack, cosine, column] that the connection kernel reads.

    Rows 0..L-1: T, R of all above the layer; T, R of all below it; lateral shift [mm] through
    all above; through all below; slopes of both shifts over the tangent in air [mm]. Row L: T,
    R, shift [mm] of the whole stack as seen from the side where light starts, d T and d R /
    d sigma_t [mm] of the counted layer, and the slope of the shift.
    """
    cos_air = np.linspace(0.0, 1.0, TABLE_SIZE + 1)
    cosines = _cosines(stack.n, cos_air)
    fade = np.exp(-(stack.sigma_t * stack.thickness)[:, None] / cosines)
    count = len(stack.n)
    table = np.zeros((count + 1, TABLE_SIZE + 1, COLUMNS))
    t_up, r_up, _, _ = _approach(stack.n, fade, cosines, cos_air)
    t_down, r_down, _, _ = _approach(stack.n[::-1], fade[::-1], cosines[::-1], cos_air)
    tangent = np.sqrt(np.maximum(0.0, 1.0 - cosines**2)) / cosines
    shift = stack.thickness[:, None] * tangent
    through = np.cumsum(shift, axis=0)
    slope = stack.thickness[:, None] * (cos_air / cosines) ** 3 / stack.n[:, None]
    steep = np.cumsum(slope, axis=0)
    table[:count, :, 0] = t_up
    table[:count, :, 1] = r_up
    table[:count, :, 2] = t_down[::-1]
    table[:count, :, 3] = r_down[::-1]
    table[:count, :, 4] = through - shift
    table[:count, :, 5] = through[-1] - through
    table[:count, :, 6] = steep - slope
    table[:count, :, 7] = steep[-1] - steep
    table[count, :, 5] = steep[-1]
    t, r = stack_transfer(stack, cos_air, from_below)
    table[count, :, 0] = t
    table[count, :, 1] = r
    table[count, :, 2] = through[-1]
    if stack.counted >= 0:
        table[count, :, 3], table[count, :, 4] = _slopes(stack, cos_air, from_below)
    return table


def _slopes(
    stack: FlatStack, cos_air: FloatArray, from_below: bool
) -> tuple[FloatArray, FloatArray]:
    """Slopes of T and R over sigma_t of the counted layer [mm], by central differences."""
    step = 1e-5 / stack.thickness[stack.counted]
    sides = []
    for direction in (-1.0, 1.0):
        sigma = stack.sigma_t.copy()
        sigma[stack.counted] += direction * step
        moved = replace(stack, sigma_t=sigma)
        sides.append(stack_transfer(moved, cos_air, from_below))
    (t0, r0), (t1, r1) = sides
    return (t1 - t0) / (2 * step), (r1 - r0) / (2 * step)
