"""The fast route: bispectral radiance factors as products of two depth profiles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from twin.bench import Bench, Sample
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from twin.adding_doubling import CapturesModel
    from twin.bispectral.medium import FluorescentProperties


@dataclass(frozen=True)
class Donaldson:
    """Bispectral captures of S samples at W wavelengths.

    Attributes:
        wavelength_nm: [nm], (W,).
        elastic: relative intensities black, white, collimated of each wavelength's own light,
            (S, 3, W).
        fluorescent: bispectral radiance factor per nm [1/nm] over black and white, and what the
            beam excites in the collimated capture, (S, 3, W out, W in); 0 where in >= out.
    """

    wavelength_nm: FloatArray
    elastic: FloatArray
    fluorescent: FloatArray


@lru_cache(maxsize=1)
def _program() -> Any:
    """The compiled program: fields and bispectral factors of black, white and collimated."""
    import jax
    import jax.numpy as jnp

    from twin.bispectral.fields import bispectral_of, depth_nodes, fields_of

    def run(parameters: Any, constants: Any, source: Any, form: Any) -> Any:
        fields = fields_of(parameters, constants, form)
        common = (parameters.thickness_mm, parameters.n)

        def over(rho: Any) -> Any:
            return bispectral_of(fields, common[0], rho, common[1], source)

        weight = jnp.asarray(depth_nodes()[1])
        beam = jnp.einsum("osz,z,isz->soi", fields.detector, weight, fields.beam)
        beam = beam * common[0][:, None, None] * source / (4.0 * common[1][:, None] ** 2)
        cone = 1.0 - constants.geometry.cone_cosine**2
        return jnp.stack(
            [over(parameters.rho_black), over(parameters.rho_white), cone * beam], axis=1
        )

    return jax.jit(run, static_argnames=("form",))


def fast_model(
    bench: Bench, samples: Sequence[Sample], wavelength_nm: FloatArray, g: FloatArray
) -> CapturesModel:
    """The plane-parallel engine with as many streams as the anisotropy asks for."""
    from twin.adding_doubling import captures_model
    from twin.adding_doubling.streams import streams_for
    from twin.materials import refractive_index

    matched = bool(np.all(refractive_index(samples[0].n, wavelength_nm) == 1.0))
    streams = streams_for(float(np.max(np.abs(g), initial=0.0)), matched)
    return captures_model(bench, samples, wavelength_nm, streams=streams)


def fluorescence_of(
    model: CapturesModel,
    albedo: ArrayLike,
    sigma_t_per_mm: ArrayLike,
    g: ArrayLike,
    source: FloatArray,
) -> FloatArray:
    """Bispectral radiance factors per nm of one re-emission, (S, 3, W out, W in).

    Args:
        model: of `fast_model`.
        albedo: of the medium with its fluorophores, (W,).
        sigma_t_per_mm: the same [1/mm], (W,).
        g: anisotropy factor, (W,).
        source: [1/mm/nm], (W, W), see `FluorescentProperties`.

    The collimated capture collects what leaves inside the detector's cone on all of the face.
    """
    parameters = model.parameters(albedo, sigma_t_per_mm, g)
    found = _program()(parameters, model.constants, source, model.form)
    return np.asarray(found)


def donaldson(
    bench: Bench, samples: Sequence[Sample], properties: FluorescentProperties
) -> Donaldson:
    """Elastic and fluorescent captures by the plane-parallel engine, one re-emission.

    Reabsorption on the way is in it; light that is reabsorbed and emitted again is not: it is
    a share of the fluorescence of about energy yield times the reabsorbed share, which
    `trace_bispectral` tells apart.

    Args:
        bench: covers must not scatter; sides and edges are not seen (`CapturesModel`).
        samples: S samples of one material and index.
        properties: of `fluorescent_properties`.

    Raises:
        InputError: a bench or samples that plane-parallel layers cannot show.
    """
    wave = properties.wavelength_nm
    own = (properties.albedo, properties.sigma_t_per_mm, properties.g)
    model = fast_model(bench, samples, wave, properties.g)
    elastic = np.asarray(model.forward(model.parameters(*own)))
    fluorescent = fluorescence_of(model, *own, properties.source)
    return Donaldson(wave, elastic.transpose(1, 2, 0), fluorescent)
