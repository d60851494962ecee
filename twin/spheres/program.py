"""One compiled program: readings of a sphere measurement and their slopes, by JAX.

Importing this module imports JAX. Batches are cut into pieces of one size, so that nothing is
compiled again for another number of wavelengths; streams are those of `twin.adding_doubling`.
"""

from __future__ import annotations

from functools import lru_cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from twin.adding_doubling.slab import TAIL_ORDERS, Plan, Problem, _one
from twin.adding_doubling.streams import make_streams
from twin.spectra import FloatArray
from twin.spheres.readings import (
    Lost,
    SampleLight,
    SphereSetup,
    Surfaces,
    sphere_readings,
)

PIECE = 128
"""Problems that are computed together."""


class Inputs(NamedTuple):
    """What may differ between the problems of a batch, (W,) but for the last two.

    Attributes:
        thickness_mm: of the sample; n: its refractive index.
        slide_n, slide_depth: refractive index and optical thickness of both slides.
        wall_r, wall_t, standard_r, standard_t: see `twin.spheres.readings.Surfaces`.
        lost: shares of lost light, (W, 4); lost_slope: by (albedo, sigma_t, g), (W, 4, 3).
    """

    thickness_mm: Any
    n: Any
    slide_n: Any
    slide_depth: Any
    wall_r: Any
    wall_t: Any
    standard_r: Any
    standard_t: Any
    lost: Any
    lost_slope: Any


def _readings(
    parameters: Any, inputs: Inputs, *, plan: Plan, setup: SphereSetup
) -> tuple[Any, tuple[Any, Any]]:
    albedo, sigma_t, g = parameters
    slide_n, slide_depth = inputs.slide_n[None], inputs.slide_depth[None]
    moments = jnp.zeros(TAIL_ORDERS).at[0].set(1.0)
    figures = _one(
        Problem(
            albedo, sigma_t * inputs.thickness_mm, g, inputs.n, slide_n, slide_depth,
            slide_n, slide_depth, moments, 0.0,
        ),
        plan,
    )  # fmt: skip
    light = SampleLight(
        figures["reflectance"][0], figures["transmittance"][0], figures["URU"], figures["UTU"],
        figures["unscattered_reflectance"][0], figures["unscattered_transmittance"][0],
    )  # fmt: skip
    step = parameters - jax.lax.stop_gradient(parameters)
    lost = Lost(*(inputs.lost + inputs.lost_slope @ step))
    surfaces = Surfaces(inputs.wall_r, inputs.wall_t, inputs.standard_r, inputs.standard_t)
    reading_r, reading_t = sphere_readings(setup, light, lost, surfaces)
    readings = jnp.stack([reading_r, reading_t, light.unscattered_transmittance])
    return readings, (readings, jnp.stack(light))


@lru_cache(maxsize=32)
def _program(setup: SphereSetup, cosine: float, air: int, trapped: int) -> Any:
    streams = make_streams(air, trapped, looked_at=(cosine,))
    asked = (int(np.argmin(np.abs(streams.air_cosine - cosine))),)
    plan = Plan(streams, asked, (), False, False, True)
    slopes = jax.jacfwd(partial(_readings, plan=plan, setup=setup), has_aux=True)
    return jax.jit(jax.vmap(slopes))


def readings_and_slopes(
    setup: SphereSetup,
    cosine: float,
    parameters: FloatArray,
    inputs: Inputs,
    *,
    air: int = 16,
    trapped: int = 16,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Readings of W materials.

    Args:
        setup: spheres and method.
        cosine: of the beam's angle in air.
        parameters: (albedo, sigma_t [1/mm], g), shape (W, 3).
        inputs: what else differs between the problems.
        air: streams that leave the slab, see `twin.adding_doubling.make_streams`.
        trapped: streams that total reflection keeps inside.

    Returns:
        (M_R, M_T, M_U), shape (W, 3); slopes by the parameters, shape (W, 3, 3); and the six
        figures of `SampleLight`, shape (W, 6).
    """
    program = _program(setup, cosine, air, trapped)
    count = len(parameters)
    size = -(-count // PIECE) * PIECE

    def padded(values: FloatArray) -> FloatArray:
        values = np.asarray(values, dtype=np.float64)
        return np.concatenate([values, np.repeat(values[:1], size - count, axis=0)])

    whole = [padded(parameters), *(padded(v) for v in inputs)]
    parts = []
    for start in range(0, size, PIECE):
        first, *rest = (v[start : start + PIECE] for v in whole)
        slopes, (readings, light) = program(first, Inputs(*rest))
        parts.append((np.asarray(readings), np.asarray(slopes), np.asarray(light)))
    columns = zip(*parts, strict=True)
    readings, slopes, light = (np.concatenate(column)[:count] for column in columns)
    return readings, slopes, light
