"""Differentiable captures of a bench, built once and evaluated thousands of times."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import ArrayLike

from twin.adding_doubling.panels import panel_light, plane_factors
from twin.adding_doubling.phase import TwoTerm
from twin.adding_doubling.program import compiled_forward, compiled_jacobian, compiled_parts
from twin.adding_doubling.slab import TAIL_ORDERS
from twin.adding_doubling.streams import (
    Streams,
    cone_average,
    interpolation,
    legendre_cone,
    make_streams,
)
from twin.adding_doubling.sublayers import sublayers_of
from twin.adding_doubling.terms import (
    Constants,
    Form,
    Geometry,
    ObliqueBeam,
    Parameters,
    Parts,
    Surroundings,
)
from twin.bench import Bench, Sample
from twin.errors import InputError
from twin.materials import optical_properties, reflectance, refractive_index
from twin.spectra import FloatArray

DERIVED = ("albedo", "sigma_t_per_mm", "g")


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
        return cast(Array, compiled_forward(parameters, self.constants, self.form))

    def parts(self, parameters: Parameters) -> Parts:
        """What the captures are made of, arrays of shape (W, S); a pure function as `forward`."""
        return cast(Parts, compiled_parts(parameters, self.constants, self.form))

    def forward_and_jacobian(
        self, parameters: Parameters, names: tuple[str, ...] = DERIVED
    ) -> tuple[Array, Array]:
        """`forward`, and its derivatives by the named parameters, shape (W, S, 3, names).

        Each capture depends on its own wavelength and sample alone, so the derivative by a
        parameter of shape (W,) or (S,) is taken for all of them at once. At an index of exactly
        1 the critical angle appears, and the derivative by n means nothing.
        """
        return cast(
            "tuple[Array, Array]", compiled_jacobian(parameters, self.constants, self.form, names)
        )


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
