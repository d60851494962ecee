"""Captures at one wavelength as a pure function of JAX arrays, and its compiled forms."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from twin.adding_doubling.faces import Window, cosine_inside, inside, specular, window
from twin.adding_doubling.layer import THINNEST, admittance, layer_modes, polynomials, respond
from twin.adding_doubling.phase import (
    TwoTerm,
    delta_m,
    from_moments,
    henyey_greenstein,
    henyey_greenstein_moments,
    high_moments,
)
from twin.adding_doubling.single import Ray, reflected_once, reflected_once_inside
from twin.adding_doubling.slab import TAIL_ORDERS, cone_share
from twin.adding_doubling.sublayers import inner_layers, respond_inside
from twin.adding_doubling.terms import (
    BY_WAVELENGTH,
    Constants,
    Form,
    Geometry,
    Parameters,
    Parts,
    Surroundings,
)


def _phase_of(form: Form, g: Array, moments: Array, second: TwoTerm, cosine: Array) -> Array:
    if form.tabulated:
        return from_moments(moments, cosine)
    if form.two_term:
        return second.phase(g, cosine)
    return henyey_greenstein(g, cosine)


def _one(parameters: Parameters, around: Surroundings, geometry: Geometry, form: Form) -> Array:
    """Parts of the captures at one wavelength, shape (S, 5): see `Parts`."""
    streams, g, n = form.streams, parameters.g, parameters.n
    first, orders = streams.trapped, streams.orders
    air, normal = slice(first, None), streams.normal
    here = inside(streams, n)
    panel_air = jnp.asarray(geometry.panel_cosine)
    panel_mu = cosine_inside(n, panel_air)
    count, panels = here.cosine.shape[0], panel_air.shape[0]
    cosine = jnp.concatenate([here.cosine, panel_mu])
    air_cosine = jnp.concatenate([here.air_cosine, panel_air])
    if form.oblique:
        beam_air = jnp.asarray(geometry.beam.cosine)[None]
        cosine = jnp.concatenate([cosine, cosine_inside(n, beam_air)])
        air_cosine = jnp.concatenate([air_cosine, beam_air])
    top_all = window(n, around.above_n, around.above_depth, cosine, air_cosine)
    bottom_all = (
        top_all
        if form.mirrored
        else window(n, around.below_n, around.below_depth, cosine, air_cosine)
    )
    top, bottom = _part(top_all, slice(0, count)), _part(bottom_all, slice(0, count))
    if form.tabulated:
        moments, tail = around.moments[: orders + 1], around.moments[orders:]
    elif form.two_term:
        moments = geometry.second.moments(g, orders + 1)
        tail = geometry.second.high_moments(g, orders, TAIL_ORDERS - orders)
    else:
        moments = henyey_greenstein_moments(g, orders + 1)
        tail = high_moments(g, orders, TAIL_ORDERS - orders)
    scaled = delta_m(parameters.albedo, moments)
    polynomial = polynomials(here, orders)
    root = here.root_weight * jnp.sqrt(here.cosine)
    flux_top = jnp.zeros(count).at[air].set(jnp.asarray(geometry.detector))
    drive_top = jnp.where(root > 0.0, top.through / jnp.where(root > 0.0, root, 1.0), 0.0)
    drive_top = drive_top * flux_top
    lambert = 2.0 * jnp.asarray(streams.air_weight * streams.air_cosine)
    if form.layered:
        inner = inner_layers(here, polynomial, parameters.albedo, moments, geometry.sublayers)

        def between(below: Window) -> Any:
            return partial(respond_inside, inner, top.inside, below.inside)

        def depths_of(true_depth: Array) -> tuple[Any, ...]:
            depths = inner.depth * true_depth + THINNEST
            once = partial(reflected_once_inside, n=n, albedo=inner.albedo, depth=depths)
            return depths, jnp.sum(depths), inner.true_depth * true_depth, inner.true_albedo, once

    else:
        layer = layer_modes(here, polynomial, scaled.albedo, scaled.moments)
        top_admittance = admittance(layer, top.inside)

        def between(below: Window) -> Any:
            same = form.mirrored and below is bottom
            other = None if same else admittance(layer, below.inside)
            return partial(respond, layer, top_admittance, other)

        def depths_of(true_depth: Array) -> tuple[Any, ...]:
            depth = scaled.shrink * true_depth + THINNEST
            once = partial(reflected_once, n=n, albedo=scaled.albedo, depth=depth)
            return depth, depth, true_depth, parameters.albedo, once

    # phase function between the normal and every stream, as the streams see it
    strength = (2.0 * jnp.arange(orders) + 1.0) * scaled.moments
    turned = strength * (1.0 - 2.0 * (jnp.arange(orders) % 2))
    weighted = polynomial[:, air] * polynomial[:, first + normal][:, None]
    seen_back, seen_ahead = turned @ weighted, strength @ weighted
    sharpness = 1.0 / (1.0 - scaled.peak)
    true_back = _phase_of(form, g, around.moments, geometry.second, -panel_mu) * sharpness
    true_ahead = _phase_of(form, g, around.moments, geometry.second, panel_mu) * sharpness

    # far orders of the cone's coefficients move with n to first order
    moved = jnp.sqrt(1.0 - (1.0 - geometry.cone_cosine**2) / n**2) - around.cone_cosine
    low = around.cone_low + around.cone_low_slope * moved
    high = around.cone_high + around.cone_high_slope * moved

    def system(below: Window) -> Any:
        """Responses to the detector's directions from above and to diffuse light from below."""
        if form.contact and below is not bottom:
            flux_below = root**2
        else:
            flux_below = root**2 * (here.air_cosine > 0.0)
        flux_below = flux_below / jnp.sum(flux_below)
        passed = below.through / jnp.where(root > 0.0, root, 1.0)
        drive_below = jnp.where(root > 0.0, passed, 0.0) * flux_below
        zero = jnp.zeros_like(root)
        from_top = jnp.stack([2.0 * drive_top / (1.0 + top.inside), zero], axis=1)
        from_below = jnp.stack([zero, 2.0 * drive_below / (1.0 + below.inside)], axis=1)
        react = between(below)

        def at(depths: Array) -> tuple[Array, Array, Array]:
            s_top, s_bottom = react(depths, from_top, from_below)
            up = s_top - jnp.stack([drive_top, zero], axis=1)
            up = (top.through * root / (1.0 + top.inside))[:, None] * up
            down = s_bottom - jnp.stack([zero, drive_below], axis=1)
            down = (below.through * root / (1.0 + below.inside))[:, None] * down
            returned = jnp.sum(down[:, 1] + below.outside * flux_below)
            return up, down, returned

        return at

    through_air = system(bottom)
    open_below = Window(jnp.zeros_like(root), jnp.ones_like(root), jnp.zeros_like(root))
    backed = system(open_below) if form.contact else through_air
    backed_bottom = open_below if form.contact else bottom
    panel = slice(count, count + panels)
    nothing = jnp.zeros_like(panel_mu)
    open_panel = Window(nothing, jnp.ones_like(nothing), nothing)
    panel_below = open_panel if form.contact else _part(bottom_all, panel)
    panel_top = _part(top_all, panel)
    # diffuse light from below over the air's own: 1, or 1 / n^2 in optical contact
    spread = 1.0 / jnp.sum(lambert)
    if form.contact:
        spread = root[first + normal] ** 2 / jnp.sum(root**2) / lambert[normal]

    def unscattered_at(index: int, true_depth: Array) -> Array:
        top, bottom, mu = _part(top_all, index), _part(bottom_all, index), cosine[index]
        rounds = top.inside * bottom.inside * jnp.exp(-2.0 * true_depth / mu)
        return top.through * bottom.through * jnp.exp(-true_depth / mu) / (1.0 - rounds)

    def sample(thickness: Array, plane: Array, nominal: Array, share: Array) -> Array:
        depths, depth, true_depth, albedo, once = depths_of(parameters.sigma_t_per_mm * thickness)
        up, down, returned = backed(depths)
        mirror, clear_backed = specular(top, backed_bottom, here.cosine, depth)
        at = first + normal

        def ray(values: Any) -> Ray:
            return Ray(*values)

        view = ray((here.cosine[at], top.through[at], top.inside[at], backed_bottom.inside[at]))
        nodes = ray(
            (here.cosine[air], top.through[air], top.inside[air], backed_bottom.inside[air])
        )
        lights = ray((panel_mu, panel_top.through, panel_top.inside, panel_below.inside))
        once_seen = once(nodes, view, back=seen_back, ahead=seen_ahead)
        once_true = once(lights, view, back=true_back, ahead=true_ahead)
        # single scattering is told exactly; only the smooth rest is interpolated to the panels
        specular_part = (mirror - top.outside)[air] * flux_top[air]
        smooth = (up[air, 0] - specular_part) / lambert - once_seen
        direct = geometry.panel_streams @ smooth + geometry.panel_share @ once_true
        received = jnp.sum(down[:, 0])
        _, clear_panels = specular(panel_top, panel_below, panel_mu, depth)
        scattered_up = up[air, 1] / lambert - spread * clear_backed[air]
        sent = geometry.panel_streams @ scattered_up
        sent = sent + spread * (geometry.panel_share @ clear_panels)
        shift = thickness - nominal
        height = jnp.exp(plane[0] + shift * (plane[1] + 0.5 * shift * plane[2]))
        free_down = through_air(depths)[1] if form.contact else down
        _, clear = specular(top, bottom, here.cosine, depth)
        scattered = (free_down[at, 0] - clear[at] * flux_top[at]) / lambert[normal]
        peak_light = cone_share(
            top.through[at] * bottom.through[at], top.inside[at] * bottom.inside[at],
            true_depth, albedo, scaled.peak, tail, low, high,
        )  # fmt: skip
        total = (1.0 - geometry.cone_cosine**2) * scattered + peak_light
        rounds = top.inside[at] * bottom.inside[at] * jnp.exp(-2.0 * true_depth)
        unscattered = top.through[at] * bottom.through[at] * jnp.exp(-true_depth) / (1.0 - rounds)
        into = total - unscattered
        if form.oblique:
            # beyond the forward peak light that is scattered hardly knows where it came from
            unscattered, into = unscattered_at(count + panels, true_depth), into / share
        return jnp.stack([height * direct, height * sent * received, returned, unscattered, into])

    shares = geometry.beam.share if form.oblique else jnp.ones_like(parameters.thickness_mm)
    return jax.vmap(sample)(
        parameters.thickness_mm, jnp.asarray(geometry.planes), jnp.asarray(geometry.thickness_mm),
        jnp.asarray(shares),
    )  # fmt: skip


def _part(of: Window, where: slice | int) -> Window:
    return Window(of.inside[where], of.through[where], of.outside[where])


def parts_of(parameters: Parameters, constants: Constants, form: Form) -> Parts:
    """Parts of the captures, (W, S) each: a pure function for programs built around it."""
    by_wavelength = jax.vmap(partial(_one, form=form), in_axes=(BY_WAVELENGTH, 0, None))
    return Parts(*jnp.moveaxis(by_wavelength(parameters, *constants), -1, 0))


def value_and_slopes(
    function: Callable[[Parameters], Array], parameters: Parameters, names: tuple[str, ...]
) -> tuple[Array, Array]:
    """A function of parameters, and its derivatives by the named ones, (..., names).

    For functions whose entry at one wavelength and sample depends on parameters of its own
    wavelength and sample alone. One pass forwards, and one linear pass for all names.
    """
    own = {name: jnp.asarray(getattr(parameters, name)) for name in names}
    value, slope = jax.linearize(lambda values: function(parameters._replace(**values)), own)
    if not names:
        return value, jnp.zeros((*value.shape, 0))
    directions = {
        name: jnp.zeros((len(names), *array.shape)).at[row].set(1.0)
        for row, (name, array) in enumerate(own.items())
    }
    return value, jnp.moveaxis(jax.vmap(slope)(directions), 0, -1)


def _captures(parameters: Parameters, constants: Constants, form: Form) -> Array:
    rho = (jnp.asarray(parameters.rho_black), jnp.asarray(parameters.rho_white))
    return parts_of(parameters, constants, form).captures(*(each[:, None] for each in rho))


def _slopes(
    parameters: Parameters, constants: Constants, form: Form, names: tuple[str, ...]
) -> tuple[Array, Array]:
    return value_and_slopes(lambda moved: _captures(moved, constants, form), parameters, names)


compiled_parts = jax.jit(parts_of, static_argnames=("form",))
compiled_forward = jax.jit(_captures, static_argnames=("form",))
compiled_jacobian = jax.jit(_slopes, static_argnames=("form", "names"))
