"""What slabs between slides do to light, for many slabs at once and without slopes."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from twin.errors import InputError
from twin.spectra import FloatArray
from twin.spheres.readings import SampleLight

PIECE = 32
"""Slabs that are computed together."""


@cache
def _program(cosine: float) -> Any:
    """Compiled light of many slabs without slopes."""
    import jax
    import jax.numpy as jnp

    from twin.adding_doubling.slab import TAIL_ORDERS, Plan, Problem, _one
    from twin.adding_doubling.streams import make_streams

    streams = make_streams(16, 16, looked_at=(cosine,))
    asked = (int(np.argmin(np.abs(streams.air_cosine - cosine))),)
    plan = Plan(streams, asked, (), False, False, True)

    def light(albedo: Any, depth: Any, g: Any, n: Any, slide_n: Any, slide_depth: Any) -> Any:
        slide, absorbing = slide_n[None], slide_depth[None]
        moments = jnp.zeros(TAIL_ORDERS).at[0].set(1.0)
        f = _one(
            Problem(albedo, depth, g, n, slide, absorbing, slide, absorbing, moments, 0.0), plan
        )
        return jnp.stack(
            [
                f["reflectance"][0], f["transmittance"][0], f["URU"], f["UTU"],
                f["unscattered_reflectance"][0], f["unscattered_transmittance"][0],
            ]
        )  # fmt: skip

    return jax.jit(jax.vmap(light))


def slab_light(
    cosine: float, parameters: FloatArray, thickness_mm: FloatArray, n: FloatArray,
    slide_n: FloatArray, slide_depth: FloatArray,
) -> SampleLight:  # fmt: skip
    """What N slabs between slides do to a beam and to diffuse light, arrays (N,).

    Args:
        cosine: of the beam's angle in air.
        parameters: albedo, sigma_t [1/mm] and g, (N, 3).
        thickness_mm: of the slabs, (N,).
        n: their refractive index, (N,).
        slide_n: refractive index of both slides, (N,).
        slide_depth: optical thickness of each slide, (N,).

    Raises:
        InputError: a thickness or an index that cannot be.
    """
    if np.any(thickness_mm <= 0.0) or np.any(n < 1.0):
        raise InputError("a slab without thickness, or of an index below 1", "above", place="slab")
    program = _program(cosine)
    albedo, sigma_t, g = parameters.T
    columns = (albedo, sigma_t * thickness_mm, g, n, slide_n, slide_depth)
    count = len(parameters)
    missing = -count % PIECE
    padded = [np.concatenate([c, np.repeat(c[:1], missing)]) for c in columns]
    parts = [
        np.asarray(program(*(c[start : start + PIECE] for c in padded)))
        for start in range(0, count + missing, PIECE)
    ]
    return SampleLight(*np.concatenate(parts)[:count].T)
