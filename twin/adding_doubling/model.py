"""Differentiable captures of a bench, built once and evaluated thousands of times."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import ArrayLike

from twin.adding_doubling.faces import Window, cosine_inside, inside, specular, window
from twin.adding_doubling.layer import THINNEST, admittance, layer_modes, polynomials, respond
from twin.adding_doubling.panels import panel_light, plane_factors
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
from twin.adding_doubling.streams import (
    Streams,
    cone_average,
    interpolation,
    legendre_cone,
    make_streams,
)
from twin.adding_doubling.sublayers import inner_layers, respond_inside, sublayers_of
from twin.bench import Bench, Sample
from twin.errors import InputError
from twin.materials import optical_properties, reflectance, refractive_index
from twin.spectra import FloatArray

BLACK, WHITE, COLLIMATED = range(3)
DERIVED = ("albedo", "sigma_t_per_mm", "g")


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

        Addition theorem: the mean over a cone of directions, times P_l of its axis.
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


def _captures(parameters: Parameters, constants: Constants, form: Form) -> Array:
    rho = (jnp.asarray(parameters.rho_black), jnp.asarray(parameters.rho_white))
    return parts_of(parameters, constants, form).captures(*(each[:, None] for each in rho))


def _slopes(
    parameters: Parameters, constants: Constants, form: Form, names: tuple[str, ...]
) -> tuple[Array, Array]:
    return value_and_slopes(lambda moved: _captures(moved, constants, form), parameters, names)


_parts = jax.jit(parts_of, static_argnames=("form",))
_forward = jax.jit(_captures, static_argnames=("form",))
_jacobian = jax.jit(_slopes, static_argnames=("form", "names"))

BY_WAVELENGTH = Parameters(0, 0, 0, 0, None, 0, 0)


@dataclass(frozen=True, eq=False)
class CapturesModel:
    """Black, white and collimated relative intensities of samples of one material.

    Attributes:
        wavelength_nm: [nm], (W,).
        nominal: index, thicknesses and background reflectances of the bench; albedo, sigma_t
            and g of the first sample's material, or NaN when it is unknown.
        not_represented: what of this bench a plane-parallel stack cannot show.
        constants, form: what `parts_of` needs besides parameters.
    """

    wavelength_nm: FloatArray
    nominal: Parameters
    not_represented: tuple[str, ...]
    constants: Constants
    form: Form

    def parameters(
        self, albedo: ArrayLike, sigma_t_per_mm: ArrayLike, g: ArrayLike, **nuisances: ArrayLike
    ) -> Parameters:
        """Parameters with every array in its full shape; nuisances default to the nominal."""
        given = self.nominal._replace(
            albedo=albedo, sigma_t_per_mm=sigma_t_per_mm, g=g, **nuisances
        )
        return Parameters(
            *(
                np.broadcast_to(np.asarray(value, dtype=np.float64), np.shape(shape_of))
                for value, shape_of in zip(given, self.nominal, strict=True)
            )
        )

    def forward(self, parameters: Parameters) -> Array:
        """Relative intensities, shape (W, S, 3): black, white, collimated.

        A pure function of JAX arrays: it can be traced, differentiated both ways and batched.
        """
        return cast(Array, _forward(parameters, self.constants, self.form))

    def parts(self, parameters: Parameters) -> Parts:
        """What the captures are made of, arrays of shape (W, S); a pure function as `forward`."""
        return cast(Parts, _parts(parameters, self.constants, self.form))

    def forward_and_jacobian(
        self, parameters: Parameters, names: tuple[str, ...] = DERIVED
    ) -> tuple[Array, Array]:
        """`forward`, and its derivatives by the named parameters, shape (W, S, 3, names).

        Each capture depends on its own wavelength and sample alone, so the derivative by a
        parameter of shape (W,) or (S,) is taken for all of them at once. At an index of exactly
        1 the critical angle appears, and the derivative by n means nothing.
        """
        return cast("tuple[Array, Array]", _jacobian(parameters, self.constants, self.form, names))


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


def captures_model(
    bench: Bench,
    samples: Sequence[Sample],
    wavelength_nm: ArrayLike,
    *,
    streams: Streams | None = None,
    moments: FloatArray | None = None,
    contact: bool = False,
    second: tuple[float, float] | None = None,
    sublayers: Sequence[tuple[float, float, float]] = (),
    beam: ObliqueBeam | None = None,
) -> CapturesModel:
    """A differentiable model of the bench for samples that differ in thickness alone.

    Args:
        bench: covers, panels, backgrounds, acceptance of the detector.
        samples: S samples of one material with one refractive index.
        wavelength_nm: [nm], shape (W,).
        streams: quadrature; default 12 and 8 (0 for a sample of index 1): 1e-4 absolute for g
            up to 0.9. `make_streams(16, 16)` reaches that up to 0.95.
        moments: Legendre moments of a tabulated phase function, (M,) or (W, M), in place of g.
        contact: the backgrounds touch the sample optically (no covers below, no air).
        second: share and g of a second Henyey-Greenstein lobe beside one that keeps the mean
            cosine at the parameter g (see `twin.bench.Medium`); None for none, whatever the
            samples' material: a model says what is assumed, not what is true.
        sublayers: of every sample from the top down: share of the thickness, and factors on the
            scattering and on the absorption coefficient; none for samples that are the same all
            through.
        beam: directions of the beam; None takes it as upright and parallel, whatever the bench.

    Raises:
        InputError: samples of several indices, a scattering cover, bad moments, moments together
            with a second lobe, or sublayers that are no layers.
    """
    wavelength = np.atleast_1d(np.asarray(wavelength_nm, dtype=np.float64))
    given = tuple(samples)
    if not given:
        raise InputError("no sample", "one sample or more", place="samples")
    if any(sample.n != given[0].n for sample in given):
        raise InputError(
            "samples of several refractive indices", "one index", place="samples",
            remedy="Build a model for each of them",
        )  # fmt: skip
    n = np.array(refractive_index(given[0].n, wavelength))
    if np.any(n < 1.0):
        raise InputError(f"a refractive index of {n.min():g}", "1 or more", place="n")
    matched = bool(np.all(n == 1.0))
    if streams is None:
        streams = make_streams(18, 0) if matched else make_streams(12, 8)
    if not streams.trapped and not matched:
        raise InputError(
            "streams without trapped ones for an index above 1", "trapped streams",
            place="streams",
        )  # fmt: skip
    mirrored = tuple(bench.covers_above) == tuple(reversed(bench.covers_below))
    if second is not None and moments is not None:
        raise InputError("moments and a second lobe", "one of them", place="moments")
    form = Form(
        streams, moments is not None, contact, mirrored, second is not None, bool(sublayers),
        beam is not None,
    )  # fmt: skip
    geometry, light = _geometry(bench, given, streams)
    if second is not None:
        geometry = geometry._replace(second=TwoTerm(*second))
    if sublayers:
        geometry = geometry._replace(sublayers=sublayers_of(sublayers))
    if beam is not None:
        geometry = geometry._replace(beam=beam)
    around = _surroundings(bench, wavelength, n, geometry, streams.orders, moments)
    return CapturesModel(
        wavelength,
        _nominal(bench, given, wavelength, n),
        not_represented(bench, light.highest),
        jax.tree.map(jnp.asarray, Constants(around, geometry)),
        form,
    )


def _geometry(bench: Bench, samples: tuple[Sample, ...], streams: Streams) -> tuple[Geometry, Any]:
    light = panel_light(bench)
    cone = math.cos(math.radians(bench.detector.acceptance_deg))
    to_panels = light.share @ interpolation(streams.air_cosine, light.cosine)
    geometry = Geometry(
        detector=cone_average(streams, cone),
        panel_share=light.share,
        panel_cosine=light.cosine,
        panel_streams=to_panels,
        planes=plane_factors(bench, samples),
        thickness_mm=np.array([sample.thickness_mm for sample in samples]),
        cone_cosine=cone,
    )
    return geometry, light


def _surroundings(
    bench: Bench,
    wavelength: FloatArray,
    n: FloatArray,
    geometry: Geometry,
    orders: int,
    moments: FloatArray | None,
) -> Surroundings:
    count = len(wavelength)

    def covers(layers: Sequence[Any]) -> tuple[FloatArray, FloatArray]:
        index, depth = np.empty((2, count, len(layers)))
        for number, layer in enumerate(layers):
            index[:, number] = refractive_index(layer.n, wavelength)
            depth[:, number] = 0.0
            if layer.medium is not None:
                own = optical_properties(layer.medium, wavelength)
                if np.any(own.albedo * own.sigma_t_per_mm > 0.0):
                    raise InputError(
                        "a cover that scatters", "clear or absorbing covers", place="covers",
                        remedy="Use the Monte Carlo (twin.transport.captures)",
                    )  # fmt: skip
                depth[:, number] = own.sigma_t_per_mm * layer.thickness_mm
        return index, depth

    above_n, above_depth = covers(bench.covers_above)
    below_n, below_depth = covers(tuple(reversed(bench.covers_below)))
    x = np.sqrt(1.0 - (1.0 - geometry.cone_cosine**2) / n**2)
    value, slope = legendre_cone(x, TAIL_ORDERS)
    if isinstance(geometry.beam, ObliqueBeam):
        blur = geometry.beam.blur(n, TAIL_ORDERS)
        value, slope = value * blur, slope * blur
    table = np.zeros((count, TAIL_ORDERS))
    if moments is not None:
        own_moments = np.asarray(moments, dtype=np.float64)
        known = own_moments.shape[-1]
        if (
            own_moments.ndim > 2
            or not 1 <= known <= TAIL_ORDERS
            or np.any(np.abs(own_moments[..., 0] - 1.0) > 1e-9)
        ):
            raise InputError(
                f"moments of shape {own_moments.shape}",
                f"(M,) or (W, M) with M up to {TAIL_ORDERS}, the first of them 1",
                place="moments",
            )
        table[:, :known] = own_moments
    return Surroundings(
        above_n, above_depth, below_n, below_depth, x,
        value[:, :orders].sum(axis=1), slope[:, :orders].sum(axis=1),
        value[:, orders:], slope[:, orders:], table,
    )  # fmt: skip


def _nominal(
    bench: Bench, samples: tuple[Sample, ...], wavelength: FloatArray, n: FloatArray
) -> Parameters:
    unknown = np.full(len(wavelength), np.nan)
    own = (unknown, unknown, unknown)
    if samples[0].material is not None:
        known = optical_properties(samples[0].material, wavelength)
        own = (known.albedo, known.sigma_t_per_mm, known.g)
    return Parameters(
        *own,
        n,
        np.array([sample.thickness_mm for sample in samples]),
        reflectance(bench.background.black.reflectance, wavelength),
        reflectance(bench.background.white.reflectance, wavelength),
    )


def not_represented(bench: Bench, highest_cosine: float) -> tuple[str, ...]:
    """What of a bench a plane-parallel stack cannot show, in words."""
    said = [
        f"backgrounds of finite size behind a gap of {bench.background.gap_mm:g} mm: "
        "an unbounded plane stands for them",
        f"the detector's spots ({bench.detector.spot_panels_mm:g} and "
        f"{bench.detector.spot_beam_mm:g} mm): scattered light is collected from all of the face",
    ]
    if bench.size_mm is not None:
        width, length = bench.size_mm
        said.insert(0, f"light lost at the sides of a sample of {width:g} x {length:g} mm")
        if bench.offset_mm != (0.0, 0.0):
            x, y = bench.offset_mm
            said.insert(1, f"the sample's place, ({x:g}, {y:g}) mm off the axis")
    if bench.beam.divergence_deg > 0.0:
        said.append(f"the beam's divergence of {bench.beam.divergence_deg:g} degrees")
    if bench.beam.tilt_deg != 0.0:
        said.append(f"the beam's tilt of {bench.beam.tilt_deg:g} degrees")
    if bench.background.glossy:
        said.append("the gloss of a background")
    if highest_cosine > math.cos(math.radians(bench.detector.acceptance_deg)):
        said.append("the mirror image of a panel inside the detector's acceptance")
    return tuple(said)
