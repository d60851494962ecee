"""Depth profiles of fluence inside the plane-parallel stack, in closed form between its modes.

With the modes X, k of a layer (twin/adding_doubling/layer.py) and z counted upwards from the
middle of a layer of optical thickness 2 h, the sum of down and up is

    s(z) = X [cosh(k z) / cosh(k h) e + sinh(k z) / sinh(k h) o],

with amplitudes e, o that the windows and the illumination decide, and the fluence is the sum of
s over streams with the root of weight over cosine. So one decomposition gives the fluence of the
panels' light, of the background's, and, by reciprocity, the importance of a depth for the
detector. Fluence is per irradiance on the outer face.
"""

from __future__ import annotations

from functools import lru_cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from twin.adding_doubling.faces import Inside, Window, cosine_inside, inside, window
from twin.adding_doubling.layer import (
    THINNEST,
    Modes,
    admittance,
    even_response,
    layer_modes,
    odd_response,
    polynomials,
)
from twin.adding_doubling.linear import solve_positive
from twin.adding_doubling.phase import delta_m, henyey_greenstein_moments
from twin.adding_doubling.streams import gauss
from twin.adding_doubling.terms import BY_WAVELENGTH, Constants, Form, Geometry, Parameters
from twin.adding_doubling.terms import Surroundings as Surroundings
from twin.spectra import FloatArray

PANELS, DETECTOR, BACKGROUND, BEAM = range(4)
SMALL = 1e-3
DEPTHS = 24
CONE_NODES = 4


@lru_cache(maxsize=8)
def depth_nodes(count: int = DEPTHS) -> tuple[FloatArray, FloatArray]:
    """Gauss nodes over the depth from the top (0) to the bottom (1), and weights, (Z,) each."""
    return gauss(count)


class Fields(NamedTuple):
    """Fluence at Z depths per irradiance; leading shape (W, S) after `fields_of`.

    Attributes:
        panels: lit by the panels from above, (..., Z).
        detector: lit from where the detector looks, (..., Z).
        background: lit diffusely from below, (..., Z).
        beam: lit by the beam from below, (..., Z).
        panels_down, detector_down: share of the light that arrives below, (...).
        returned: share of diffuse light from below that comes back there, (...).
        height: irradiance on the top face over that in the reference plane, (...).
    """

    panels: Any
    detector: Any
    background: Any
    beam: Any
    panels_down: Any
    detector_down: Any
    returned: Any
    height: Any

    def lit(self, rho: Any) -> Array:
        """Fluence of the panels' light over a background, (..., Z); rho of shape (...)."""
        sent = rho * self.panels_down / (1.0 - rho * self.returned)
        found: Array = self.height[..., None] * (self.panels + sent[..., None] * self.background)
        return found

    def seen(self, rho: Any) -> Array:
        """Importance of every depth for the detector over a background, (..., Z)."""
        sent = rho * self.detector_down / (1.0 - rho * self.returned)
        found: Array = self.detector + sent[..., None] * self.background
        return found


def _waves(squared: Array, half: Array, z: Array) -> tuple[Array, Array]:
    """cosh(k z) / cosh(k h) and sinh(k z) / sinh(k h), (Z, N), analytic in k^2."""
    y = squared * half**2
    small = y < SMALL
    k = jnp.sqrt(jnp.where(small, 1.0, jnp.maximum(y, SMALL))) / half
    near, far = jnp.exp(-k * (half - z[:, None])), jnp.exp(-k * (half + z[:, None]))
    full = jnp.exp(-2.0 * k * half)
    even, odd = (near + far) / (1.0 + full), (near - far) / (1.0 - full)
    x = z[:, None] / half
    a = y * x**2
    even_small = (1 + a / 2 + a**2 / 24) / (1 + y / 2 + y**2 / 24)
    odd_small = x * (1 + a / 6 + a**2 / 120) / (1 + y / 6 + y**2 / 120)
    return jnp.where(small, even_small, even), jnp.where(small, odd_small, odd)


def unscattered(top: Window, bottom: Window, cosine: Array, depth: Array, nodes: Array) -> Array:
    """Fluence at Z depths of light from above that has not been scattered, (Z, M)."""
    down = jnp.exp(-depth * nodes[:, None] / cosine)
    up = bottom.inside * jnp.exp(-depth * (2.0 - nodes[:, None]) / cosine)
    series = 1.0 - top.inside * bottom.inside * jnp.exp(-2.0 * depth / cosine)
    return top.through / cosine * (down + up) / series


class Layer(NamedTuple):
    """The sample's layer between its windows at one wavelength."""

    here: Inside
    modes: Modes
    top: Window
    bottom: Window
    shrink: Array


def layer_of(parameters: Parameters, around: Surroundings, form: Form) -> Layer:
    """Modes and windows of the sample at one wavelength."""
    orders = form.streams.orders
    here = inside(form.streams, parameters.n)
    top = window(parameters.n, around.above_n, around.above_depth, here.cosine, here.air_cosine)
    bottom = window(parameters.n, around.below_n, around.below_depth, here.cosine, here.air_cosine)
    scaled = delta_m(parameters.albedo, henyey_greenstein_moments(parameters.g, orders + 1))
    modes = layer_modes(here, polynomials(here, orders), scaled.albedo, scaled.moments)
    return Layer(here, modes, top, bottom, scaled.shrink)


def solve_layer(layer: Layer, depth: Array, top: Array, bottom: Array) -> tuple[Array, Array]:
    """Even and odd amplitudes for forces on both faces in the basis of the modes, (N, R)."""
    half = 0.5 * depth
    even = jnp.diag(even_response(layer.modes.squared, half))
    odd = jnp.diag(odd_response(layer.modes.squared, half))
    upper = admittance(layer.modes, layer.top.inside)
    lower = admittance(layer.modes, layer.bottom.inside)
    mean, step = 0.5 * (upper + lower), 0.5 * (upper - lower)
    matrix = jnp.block([[mean + even, step], [step, mean + odd]])
    force = jnp.concatenate([0.5 * (top + bottom), 0.5 * (top - bottom)])
    both = solve_positive(matrix, force)
    count = layer.modes.squared.shape[0]
    return both[:count], both[count:]


def _over_root(value: Array, root: Array) -> Array:
    exists = root > 0.0
    return jnp.where(exists, value / jnp.where(exists, root, 1.0), 0.0)


def _one(parameters: Parameters, around: Surroundings, geometry: Geometry, form: Form) -> Fields:
    """Fields at one wavelength, leading shape (S,)."""
    layer = layer_of(parameters, around, form)
    here, top, bottom = layer.here, layer.top, layer.bottom
    first = form.streams.trapped
    count = here.cosine.shape[0]
    air = slice(first, None)
    root = here.root_weight * jnp.sqrt(here.cosine)
    flux = jnp.zeros((count, 4))
    flux = flux.at[air, PANELS].set(jnp.asarray(geometry.panel_streams))
    flux = flux.at[air, DETECTOR].set(jnp.asarray(geometry.detector))
    diffuse = root**2 * (here.air_cosine > 0.0)
    flux = flux.at[:, BACKGROUND].set(diffuse / jnp.sum(diffuse))
    flux = flux.at[first + form.streams.normal, BEAM].set(1.0)
    above = jnp.asarray([1.0, 1.0, 0.0, 0.0])
    drive_top = _over_root(top.through, root)[:, None] * flux * above
    drive_bottom = _over_root(bottom.through, root)[:, None] * flux * (1.0 - above)
    shape = layer.modes.shape
    force_top = shape.T @ (2.0 * drive_top / (1.0 + top.inside)[:, None])
    force_bottom = shape.T @ (2.0 * drive_bottom / (1.0 + bottom.inside)[:, None])
    fluence_of = (here.root_weight / jnp.sqrt(here.cosine)) @ shape
    nodes = jnp.asarray(depth_nodes()[0])
    # directions of the panels, then of the detector's cone, each with its share
    across, weight = gauss(CONE_NODES)
    cone_air = geometry.cone_cosine + (1.0 - geometry.cone_cosine) * across
    cone_share = weight * cone_air / jnp.sum(weight * cone_air)
    exact_air = jnp.concatenate([jnp.asarray(geometry.panel_cosine), cone_air])
    exact_mu = cosine_inside(parameters.n, exact_air)
    exact_top = window(parameters.n, around.above_n, around.above_depth, exact_mu, exact_air)
    exact_bottom = window(parameters.n, around.below_n, around.below_depth, exact_mu, exact_air)
    panel_count = len(geometry.panel_share)

    def part(of: Window) -> Window:
        return Window(of.inside[air], of.through[air], of.outside[air])

    def sample(thickness: Array, plane: Array, nominal: Array) -> Fields:
        depth = layer.shrink * parameters.sigma_t_per_mm * thickness + THINNEST
        e, o = solve_layer(layer, depth, force_top, force_bottom)
        even, odd = _waves(layer.modes.squared, 0.5 * depth, depth * (0.5 - nodes))
        fluence = (even * fluence_of) @ e + (odd * fluence_of) @ o
        # unscattered light is told exactly; only the smooth rest is interpolated
        seen = unscattered(part(top), part(bottom), here.cosine[air], depth, nodes)
        true = unscattered(exact_top, exact_bottom, exact_mu, depth, nodes)
        panels = fluence[:, PANELS] - seen @ geometry.panel_streams
        panels = panels + true[:, :panel_count] @ geometry.panel_share
        detector = fluence[:, DETECTOR] - seen @ geometry.detector
        detector = detector + true[:, panel_count:] @ cone_share
        down = shape @ (e - o) - drive_bottom
        down = (bottom.through * root / (1.0 + bottom.inside))[:, None] * down
        arrived = jnp.sum(down, axis=0)
        returned = arrived[BACKGROUND] + jnp.sum(bottom.outside * flux[:, BACKGROUND])
        shift = thickness - nominal
        height = jnp.exp(plane[0] + shift * (plane[1] + 0.5 * shift * plane[2]))
        return Fields(
            panels, detector, fluence[:, BACKGROUND], fluence[:, BEAM],
            arrived[PANELS], arrived[DETECTOR], returned, height,
        )  # fmt: skip

    return jax.vmap(sample)(
        parameters.thickness_mm, jnp.asarray(geometry.planes), jnp.asarray(geometry.thickness_mm)
    )


def fields_of(parameters: Parameters, constants: Constants, form: Form) -> Fields:
    """Fields at W wavelengths for S samples: a pure function for programs built around it."""
    by_wavelength = jax.vmap(partial(_one, form=form), in_axes=(BY_WAVELENGTH, 0, None))
    found: Fields = by_wavelength(parameters, *constants)
    return found


def bispectral_of(
    fields: Fields, thickness_mm: Array, rho: Array, n: Array, source: Array
) -> Array:
    """Bispectral radiance factor of one re-emission over one background, (S, W out, W in).

        B(o, i) = source(o, i) / (4 n_o^2) integral of lit_i(z) seen_o(z) dz

    Emission is isotropic, 1 / (4 pi) per sr; its way to the detector is that of light from the
    detector reversed, and radiance that leaves a medium is divided by n^2.

    Args:
        fields: of W wavelengths and S samples.
        thickness_mm: (S,).
        rho: reflectance of the background, (W,).
        n: index of the sample, (W,).
        source: [1/mm/nm], (W, W), of `FluorescentProperties`.
    """
    weight = jnp.asarray(depth_nodes()[1])
    lit, seen = fields.lit(rho[:, None]), fields.seen(rho[:, None])
    depth = jnp.einsum("osz,z,isz->soi", seen, weight, lit) * thickness_mm[:, None, None]
    found: Array = depth * source / (4.0 * n[:, None] ** 2)
    return found
