"""A smooth closed-form appearance map for tests and benchmarks of the estimators.

Not the bench: the two-stream solution of Kubelka and Munk (1931) for a slab with diffuse
internal reflection at its faces over a Lambertian background, and the unscattered beam with a
little in-scattering. It has the shape of the real map: unique inside, collapsed at albedo 0
and where no light comes back.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.spectra import FloatArray

TERMS = 8
OUTSIDE_IN, INSIDE_OUT = 0.092, 0.596  # diffuse reflectances of a face, n 1.5 (Walsh 1926)
CLEAR = 0.9231  # transmittance of a clear slab, n 1.5, normal incidence


@dataclass(frozen=True)
class FakeMap:
    """The attributes of an appearance map that the estimators use."""

    albedo: FloatArray
    sigma_t_per_mm: FloatArray
    g: FloatArray
    thickness_mm: float
    n: float
    exponent: FloatArray
    black_series: FloatArray
    white_series: FloatArray
    collimated: FloatArray
    black_se: FloatArray
    white_se: FloatArray
    collimated_se: FloatArray


def _join(upper: tuple[FloatArray, ...], lower: tuple[FloatArray, ...]) -> tuple[FloatArray, ...]:
    ra, td, rb, tu = upper
    sa, sd, sb, su = lower
    open_ = 1.0 - rb * sa
    return ra + td * sa * tu / open_, td * sd / open_, sb + su * rb * sd / open_, su * tu / open_


def forward(
    albedo: FloatArray, sigma_t: FloatArray, g: FloatArray, thickness_mm: float
) -> tuple[FloatArray, FloatArray]:
    """Series coefficients (..., TERMS) over exponents 0..TERMS-1, and collimated (...)."""
    scattering = albedo * sigma_t
    k = 2.0 * (sigma_t - scattering) + 1e-9
    s = 0.75 * scattering * (1.0 - g)
    gamma = np.sqrt(k * (k + 2.0 * s))
    x = gamma * thickness_mm
    bottom = (k + s) * -np.expm1(-2.0 * x) + gamma * (1.0 + np.exp(-2.0 * x))
    r, t = s * -np.expm1(-2.0 * x) / bottom, 2.0 * gamma * np.exp(-x) / bottom
    one = np.ones_like(r)
    enter = (OUTSIDE_IN * one, (1 - OUTSIDE_IN) * one, INSIDE_OUT * one, (1 - INSIDE_OUT) * one)
    leave = (INSIDE_OUT * one, (1 - INSIDE_OUT) * one, OUTSIDE_IN * one, (1 - OUTSIDE_IN) * one)
    above, down, below, up = _join(_join(enter, (r, t, r, t)), leave)
    series = np.empty((*r.shape, TERMS))
    # Specular light from outside misses the detector, hence without the face's reflection.
    series[..., 0] = above - OUTSIDE_IN
    for term in range(1, TERMS):
        series[..., term] = down * up * below ** (term - 1)
    in_scattered = 1e-3 * scattering * thickness_mm * (1.0 + g)
    return series, CLEAR * np.exp(-sigma_t * thickness_mm) * (1.0 + in_scattered)


def captures(
    albedo: FloatArray,
    sigma_t: FloatArray,
    g: FloatArray,
    thickness_mm: float,
    rho_black: FloatArray,
    rho_white: FloatArray,
) -> FloatArray:
    """Exact black, white and collimated intensities, shape (3, ...)."""
    series, collimated = forward(albedo, sigma_t, g, thickness_mm)
    exponent = np.arange(TERMS, dtype=np.float64)
    black = (series * np.asarray(rho_black)[..., None] ** exponent).sum(axis=-1)
    white = (series * np.asarray(rho_white)[..., None] ** exponent).sum(axis=-1)
    return np.stack([black, white, collimated])


def fake_map(
    thickness_mm: float,
    *,
    shape: tuple[int, int, int] = (40, 60, 10),
    relative_se: float = 0.0,
    sigma_t: tuple[float, float] = (0.05, 40.0),
) -> FakeMap:
    """A map with steps that shrink towards albedo 1 and towards small sigma_t."""
    albedo = 1.0 - np.linspace(1.0, 0.0, shape[0]) ** 3
    extinction = np.geomspace(*sigma_t, shape[1])
    g = np.linspace(-0.4, 0.95, shape[2])
    series, collimated = forward(*np.meshgrid(albedo, extinction, g, indexing="ij"), thickness_mm)
    exponent = np.arange(TERMS, dtype=np.float64)
    black = (series * 0.03**exponent).sum(axis=-1)
    white = (series * 0.99**exponent).sum(axis=-1)
    return FakeMap(
        albedo,
        extinction,
        g,
        thickness_mm,
        1.5,
        exponent,
        series,
        series.copy(),
        collimated,
        relative_se * black,
        relative_se * white,
        relative_se * collimated,
    )
