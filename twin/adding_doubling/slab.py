"""Everything a slab in air does to light, batched: hemispheres, directions and cones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import ArrayLike

from twin.adding_doubling.faces import Inside, Window, inside, specular, window
from twin.adding_doubling.layer import THINNEST, admittance, layer_modes, polynomials, respond
from twin.adding_doubling.phase import (
    delta_m,
    from_moments,
    henyey_greenstein,
    henyey_greenstein_moments,
    high_moments,
)
from twin.adding_doubling.single import Ray, reflected_once, transmitted_once
from twin.adding_doubling.streams import Streams, cone_average, make_streams
from twin.errors import InputError
from twin.spectra import FloatArray

TAIL_ORDERS = 384
"""Legendre orders that follow the forward peak into a cone: enough for |g| up to 0.96."""


@dataclass(frozen=True)
class SlabOptics:
    """What a slab does, for every problem of a batch (...); A asked cosines in air.

    Attributes:
        UR1, UT1: total reflectance and transmittance of light along the normal.
        URU, UTU: of perfectly diffuse light.
        cosines: the asked cosines in air, shape (A,).
        reflectance, transmittance: total, of a beam at these cosines, (..., A).
        unscattered_reflectance, unscattered_transmittance: their parts without scattering.
        reflected_factor, transmitted_factor: radiance factor (pi times radiance over incident
            irradiance, mean over azimuth) of scattered light, (..., A out, A in).
        cone_transmittance: share of a beam along the normal that leaves below inside each
            asked cone, unscattered light included, (..., C).

    Light arrives from above; every figure counts specular light unless its name says otherwise.
    """

    UR1: FloatArray
    UT1: FloatArray
    URU: FloatArray
    UTU: FloatArray
    cosines: FloatArray
    reflectance: FloatArray
    transmittance: FloatArray
    unscattered_reflectance: FloatArray
    unscattered_transmittance: FloatArray
    reflected_factor: FloatArray
    transmitted_factor: FloatArray
    cone_transmittance: FloatArray


class Problem(NamedTuple):
    """One slab, scalars but for the covers (C,) and the moments (M,)."""

    albedo: Any
    depth: Any
    g: Any
    n: Any
    above_n: Any
    above_depth: Any
    below_n: Any
    below_depth: Any
    moments: Any
    rho: Any


@dataclass(frozen=True)
class Plan:
    """What is static in a batch of slabs: streams, asked directions and cones."""

    streams: Streams
    asked: tuple[int, ...]
    cones: tuple[float, ...]
    tabulated: bool
    contact: bool
    mirrored: bool


def azimuthal_phase(
    problem: Problem, tabulated: bool, one: Array, other: Array
) -> tuple[Array, Array]:
    """Phase function between two cosines, mean over azimuth: (with a turn, without)."""
    azimuth = (jnp.arange(32) + 0.5) * jnp.pi / 32
    side = jnp.sqrt(jnp.maximum((1.0 - one**2) * (1.0 - other**2), 0.0))
    spread = side[..., None] * jnp.cos(azimuth)

    def mean(sign: float) -> Array:
        cosine = sign * (one * other)[..., None] + spread
        if tabulated:
            return from_moments(problem.moments, cosine).mean(axis=-1)
        return henyey_greenstein(problem.g, cosine).mean(axis=-1)

    return mean(-1.0), mean(1.0)


def cone_share(
    through: Array,
    returned: Array,
    depth: Array,
    albedo: Array,
    peak: Array,
    tail: Array,
    low: Array,
    high: Array,
) -> Array:
    """Unscattered light and the forward peak inside a cone around the normal.

    What delta-M counts as not scattered is told apart again order by order: far orders l
    decay as exp(-tau (1 - albedo chi_l)), whatever the low orders do (Goudsmit and Saunderson
    1940, Phys. Rev. 57, 24). Light that is reflected inside once more travels three times as
    far; further rounds are left to the unscattered part.

    Args:
        through: product of both windows' transmittances at the normal.
        returned: product of their reflectances from inside.
        depth: optical thickness, scalar.
        albedo: single-scattering albedo, scalar.
        peak: share of scattering in the forward peak of delta-M.
        tail: moments chi_l of the orders from the truncation on, shape (K,).
        low: sum of the cone's coefficients below the truncation.
        high: the cone's coefficients from there on, shape (K,).
    """
    total = through * jnp.exp(-depth) / (1.0 - returned * jnp.exp(-2.0 * depth))
    for rounds in (0, 1):
        way = (2 * rounds + 1) * depth
        plain = jnp.exp(-way)
        kept = (jnp.exp(-way * (1.0 - albedo * peak)) - plain) * low
        spread = jnp.sum(high * (jnp.exp(-way * (1.0 - albedo * tail)) - plain), axis=-1)
        total = total + through * returned**rounds * (kept + spread)
    return total


def _moments(problem: Problem, plan: Plan) -> tuple[Array, Array]:
    """Moments up to the truncation, and the K far ones."""
    orders = plan.streams.orders
    if plan.tabulated:
        return problem.moments[: orders + 1], problem.moments[orders:TAIL_ORDERS]
    tail = high_moments(problem.g, orders, TAIL_ORDERS - orders)
    return henyey_greenstein_moments(problem.g, orders + 1), tail


def _discrete_phase(polynomial: Array, moments: Array) -> tuple[Array, Array]:
    """The scaled phase function as the streams see it: (with a turn, without), (N, N) each."""
    order = jnp.arange(polynomial.shape[0])
    strength = (2.0 * order + 1.0) * moments
    turned = strength * (1.0 - 2.0 * (order % 2))
    return (polynomial.T * turned) @ polynomial, (polynomial.T * strength) @ polynomial


def _cone_coefficients(n: Array, cosine: float, orders: int) -> tuple[Array, Array]:
    """Low sum and far coefficients of a cone given by its cosine in air."""
    x = jnp.sqrt(1.0 - (1.0 - cosine**2) / n**2)

    def step(carry: tuple[Array, Array], order: Array) -> tuple[Any, Array]:
        before, here = carry
        after = ((2.0 * order + 1.0) * x * here - order * before) / (order + 1.0)
        return (here, after), 0.5 * (before - after)

    order = jnp.arange(1.0, TAIL_ORDERS)
    rest: Array
    _, rest = jax.lax.scan(step, (jnp.ones_like(x), x), order)
    every = jnp.concatenate([0.5 * (1.0 - x)[None], rest])
    return jnp.sum(every[:orders]), every[orders:]


def _one(problem: Problem, plan: Plan) -> dict[str, Array]:
    """All figures of one slab."""
    streams, first = plan.streams, plan.streams.trapped
    air = slice(first, None)
    here: Inside = inside(streams, problem.n)
    top = window(problem.n, problem.above_n, problem.above_depth, here.cosine, here.air_cosine)
    bottom = window(problem.n, problem.below_n, problem.below_depth, here.cosine, here.air_cosine)
    moments, tail = _moments(problem, plan)
    scaled = delta_m(problem.albedo, moments)
    depth = scaled.shrink * problem.depth + THINNEST
    polynomial = polynomials(here, streams.orders)
    layer = layer_modes(here, polynomial, scaled.albedo, scaled.moments)
    lambert = 2.0 * jnp.asarray(streams.air_weight * streams.air_cosine)
    asked = np.array(plan.asked, dtype=int)
    # what arrives from above: a beam in each asked direction, one along the normal, diffuse light
    beams = np.eye(streams.air)[:, [*plan.asked, streams.normal]]
    arriving = jnp.concatenate([beams, lambert[:, None]], axis=1)
    flux_in = jnp.concatenate([jnp.zeros((first, arriving.shape[1])), arriving])
    root = here.root_weight * jnp.sqrt(here.cosine)
    drive = flux_in * _over(top.through, root)[:, None]
    source = 2.0 * drive / (1.0 + top.inside)[:, None]
    # light on the lower face as a Lambertian backing sends it, in the air or in the medium
    flux = root**2 * (1.0 if plan.contact else (here.air_cosine > 0.0) * 1.0)
    flux = flux / jnp.sum(flux)
    if plan.contact:
        nothing = jnp.zeros_like(bottom.inside)
        bottom = Window(nothing, jnp.ones_like(nothing), nothing)
    drive_below = _over(bottom.through, root) * flux
    zero = jnp.zeros_like(root)[:, None]
    s_top, s_bottom = respond(
        layer,
        admittance(layer, top.inside),
        None if plan.mirrored else admittance(layer, bottom.inside),
        depth,
        jnp.concatenate([source, zero], axis=1),
        jnp.concatenate(
            [jnp.zeros_like(source), (2.0 * drive_below / (1.0 + bottom.inside))[:, None]], axis=1
        ),
    )
    up = (s_top - jnp.concatenate([drive, zero], axis=1)) / (1.0 + top.inside)[:, None]
    down = s_bottom.at[:, -1].add(-drive_below) / (1.0 + bottom.inside)[:, None]
    up, down = (top.through * root)[:, None] * up, (bottom.through * root)[:, None] * down
    mirror, clear = specular(top, bottom, here.cosine, depth)
    mirror_true, clear_true = specular(top, bottom, here.cosine, problem.depth)

    reflected = up[air, :-1] + top.outside[air][:, None] * arriving
    back_up = up[air, -1]
    # a Lambertian face of reflectance rho below: all light between it and the slab summed
    received = jnp.sum(down[:, :-1], axis=0)
    returned = jnp.sum(down[:, -1] + bottom.outside * flux)
    lit = problem.rho * received / (1.0 - problem.rho * returned)
    reflected = reflected + back_up[:, None] * lit[None, :]
    transmitted = down[air, :-1]

    turned, straight = _discrete_phase(polynomial[:, air][:, asked], scaled.moments)
    mu = here.cosine[air][asked]
    true_turned, true_straight = azimuthal_phase(problem, plan.tabulated, mu[:, None], mu[None, :])

    def rays(near: Window, far: Window, axis: int) -> Ray:
        here_and_windows = (here.cosine, near.through, near.inside, far.inside)
        return Ray(*(jnp.expand_dims(v[air][asked], axis) for v in here_and_windows))

    light, above, below = rays(top, bottom, 0), rays(top, bottom, 1), rays(bottom, top, 1)
    # single scattering with the true phase function in place of the truncated one
    scale = 1.0 / (1.0 - scaled.peak)
    common = (problem.n, scaled.albedo, depth)
    back, ahead = true_turned * scale - turned, true_straight * scale - straight
    up_more = reflected_once(light, above, *common, back, ahead)
    down_more = transmitted_once(light, below, *common, back, ahead)
    count = len(plan.asked)
    scattered_up = (reflected - mirror[air][:, None] * arriving) / lambert[:, None]
    scattered_down = (transmitted - clear[air][:, None] * arriving) / lambert[:, None]
    cones = []
    at = first + streams.normal
    for cosine in plan.cones:
        low, high = _cone_coefficients(problem.n, cosine, streams.orders)
        average = jnp.asarray(_padded_average(streams, cosine))
        peak_light = cone_share(
            top.through[at] * bottom.through[at], top.inside[at] * bottom.inside[at],
            problem.depth, problem.albedo, scaled.peak, tail, low, high,
        )  # fmt: skip
        cones.append((1.0 - cosine**2) * (average @ scattered_down[:, count]) + peak_light)
    return {
        "UR1": jnp.sum(reflected[:, count]),
        "UT1": jnp.sum(transmitted[:, count]),
        "URU": jnp.sum(reflected[:, count + 1]),
        "UTU": jnp.sum(transmitted[:, count + 1]),
        "reflectance": jnp.sum(reflected, axis=0)[:count],
        "transmittance": jnp.sum(transmitted, axis=0)[:count],
        "unscattered_reflectance": mirror_true[air][asked],
        "unscattered_transmittance": clear_true[air][asked],
        "reflected_factor": scattered_up[asked, :count] + up_more,
        "transmitted_factor": scattered_down[asked, :count] + down_more,
        "cone_transmittance": jnp.stack(cones) if cones else jnp.zeros(0),
    }


def _over(value: Array, root: Array) -> Array:
    """Value over root, and 0 for a stream that does not exist."""
    exists = root > 0.0
    return jnp.where(exists, value / jnp.where(exists, root, 1.0), 0.0)


def _padded_average(streams: Streams, cosine: float) -> FloatArray:
    """`cone_average` over the streams that carry weight; the others get none."""
    real = streams.air_weight > 1e-7
    whole = np.zeros(streams.air)
    whole[real] = cone_average(
        Streams(
            streams.air_cosine[real], streams.air_weight[real], streams.trapped_cosine,
            streams.trapped_weight, streams.orders, int(np.argmax(streams.air_cosine[real])),
        ),
        cosine,
    )  # fmt: skip
    return whole


@lru_cache(maxsize=64)
def _program(
    air: int, trapped: int, orders: int | None, cosines: tuple[float, ...],
    cones: tuple[float, ...], tabulated: bool, contact: bool, mirrored: bool,
) -> Any:  # fmt: skip
    streams = make_streams(air, trapped, orders=orders, looked_at=cosines)
    asked = tuple(int(np.argmin(np.abs(streams.air_cosine - c))) for c in cosines)
    plan = Plan(streams, asked, cones, tabulated, contact, mirrored)
    return jax.jit(jax.vmap(partial(_one, plan=plan)))


def slab_optics(
    albedo: ArrayLike,
    optical_thickness: ArrayLike,
    g: ArrayLike = 0.0,
    n: ArrayLike = 1.0,
    *,
    covers_above: Sequence[tuple[float, float]] = (),
    covers_below: Sequence[tuple[float, float]] = (),
    cosines: Sequence[float] = (),
    cones_deg: Sequence[float] = (),
    moments: FloatArray | None = None,
    backing: ArrayLike = 0.0,
    contact: bool = False,
    air: int = 16,
    trapped: int = 16,
    orders: int | None = None,
) -> SlabOptics:
    """Reflectances, transmittances and radiance factors of slabs in air, by adding-doubling.

    Args:
        albedo: single-scattering albedo; this and the next three broadcast to the batch (...).
        optical_thickness: extinction coefficient times thickness; may be infinite.
        g: anisotropy factor.
        n: refractive index.
        covers_above: (refractive index, optical depth) of clear or absorbing covers on top,
            top to bottom.
        covers_below: the same for those under the slab.
        cosines: cosines in air of the directions asked for.
        cones_deg: half-angles [deg] of the cones asked for.
        moments: Legendre moments chi_l of a tabulated phase function, chi_0 = 1, shape (M,);
            `g` is then not used. Missing orders are 0.
        backing: reflectance of an unbounded Lambertian face below, with or without a gap of air.
            UT1 and all other transmittances are those of the slab alone.
        contact: the face touches the medium optically: no interface and no covers below.
        air: streams that leave the slab, see `make_streams`; 16 and 16 give 1e-4 up to g = 0.95.
        trapped: streams that total reflection keeps inside.
        orders: Legendre orders; None takes as many as streams.

    Raises:
        InputError: a parameter outside its range.
    """
    arrays = np.broadcast_arrays(
        *(np.asarray(v, dtype=np.float64) for v in (albedo, optical_thickness, g, n, backing))
    )
    shape = arrays[0].shape
    flat = [array.reshape(-1) for array in arrays]
    _check(flat)
    if np.all(flat[3] == 1.0):
        # without total reflection all streams belong to the air
        air, trapped = air + trapped, 0
    table = np.zeros(TAIL_ORDERS)
    table[0] = 1.0
    if moments is not None:
        given = np.asarray(moments, dtype=np.float64)
        if given.ndim != 1 or not 1 <= len(given) <= TAIL_ORDERS or abs(given[0] - 1) > 1e-9:
            raise InputError(
                f"moments of shape {given.shape}",
                f"1 to {TAIL_ORDERS} Legendre moments, the first of them 1",
                place="moments",
            )
        table[: len(given)] = given
    asked = tuple(float(c) for c in cosines)
    below = list(reversed(covers_below))
    program = _program(
        air, trapped, orders, asked, tuple(float(np.cos(np.radians(c))) for c in cones_deg),
        moments is not None, contact, not contact and list(covers_above) == below,
    )  # fmt: skip
    size = len(flat[0])

    def covers(given: Sequence[tuple[float, float]], column: int) -> FloatArray:
        return np.tile(np.array([cover[column] for cover in given]), (size, 1)).reshape(size, -1)

    depth = np.minimum(flat[1], 1e6)
    result = program(
        Problem(
            flat[0], depth, flat[2], flat[3], covers(covers_above, 0), covers(covers_above, 1),
            covers(below, 0), covers(below, 1), np.tile(table, (size, 1)), flat[4],
        )
    )  # fmt: skip
    return SlabOptics(
        cosines=np.array(asked),
        **{k: np.asarray(v).reshape((*shape, *v.shape[1:])) for k, v in result.items()},
    )


def _check(flat: list[FloatArray]) -> None:
    """Ranges of albedo, optical thickness, g, n and backing."""
    names = ("albedo", "optical thickness", "g", "n", "backing")
    lows, highs = (0.0, 0.0, -0.999, 1.0, 0.0), (1.0, np.inf, 0.999, 4.0, 1.0)
    for name, values, low, high in zip(names, flat, lows, highs, strict=True):
        bad = ~((values >= low) & (values <= high))
        if np.any(bad):
            raise InputError(f"{name} {values[bad][0]:g}", f"{low:g} to {high:g}", place=f"{name}")
