"""Noiseless captures by adding-doubling, behind the interface of the Monte Carlo."""

from __future__ import annotations

import numpy as np

from twin.adding_doubling.model import captures_model
from twin.adding_doubling.streams import Streams, streams_for
from twin.bench import Bench, Sample
from twin.errors import InputError
from twin.materials import OpticalProperties, optical_properties, refractive_index
from twin.spectra import FloatArray
from twin.transport import NoiselessCaptures, reference_factor
from twin.transport.geometry import height_of_stack, reference_plane_mm

STATED_BOUND = 1e-4
"""Absolute error [1] of every capture for |g| up to 0.9."""


def captures(
    bench: Bench,
    sample: Sample,
    wavelength_nm: FloatArray,
    *,
    properties: OpticalProperties | None = None,
    streams: Streams | None = None,
    moments: FloatArray | None = None,
    contact: bool = False,
    derivatives: bool = False,
) -> NoiselessCaptures:
    """Noiseless relative intensities of one sample in the plane-parallel limit of the bench.

    What that limit leaves out is said by `CapturesModel.not_represented`. The standard errors
    are 0: the engine is deterministic; `STATED_BOUND` bounds its own error.

    Args:
        bench: the bench; covers must not scatter.
        sample: thickness and index.
        wavelength_nm: [nm], shape (W,).
        properties: the sample's medium, its second lobe included; None takes `sample.material`.
        streams: quadrature; default: more of them the larger |g| (this engine is asked once,
            `captures_model` thousands of times).
        moments: of a tabulated phase function, see `captures_model`.
        contact: the backgrounds touch the sample, see `captures_model`.
        derivatives: also d/d albedo, d/d sigma_t and d/d g.

    Raises:
        InputError: the sample has no material, a spectrum does not cover a wavelength, a
            cover scatters, or a second lobe leaves no room for the first.
    """
    wavelength = np.asarray(wavelength_nm, dtype=np.float64)
    if properties is None:
        if sample.material is None:
            raise InputError(
                "no material", "a library name or numbers", place=f"sample {sample.name}.material"
            )
        properties = optical_properties(sample.material, wavelength)
    properties.require_lobes()
    second = None
    if properties.second_share > 0.0 and moments is None:
        second = (properties.second_share, properties.second_g)
    if streams is None and moments is None:
        matched = bool(np.all(refractive_index(sample.n, wavelength) == 1.0))
        widest = float(np.max(np.abs(properties.first_g)))
        if second is not None:
            widest = max(widest, abs(second[1]))
        streams = streams_for(widest, matched)
    model = captures_model(
        bench, [sample], wavelength, streams=streams, moments=moments, contact=contact,
        second=second,
    )  # fmt: skip
    parameters = model.parameters(properties.albedo, properties.sigma_t_per_mm, properties.g)
    slopes = None
    if derivatives:
        value, jacobian = model.forward_and_jacobian(parameters)
        slopes = np.asarray(jacobian)[:, 0].transpose(1, 2, 0)
    else:
        value = model.forward(parameters)
    black, white, collimated = np.asarray(value)[:, 0].T
    nothing = np.zeros_like(black)
    height = height_of_stack(bench, sample)
    return NoiselessCaptures(
        wavelength, black, white, collimated, nothing, nothing, nothing,
        np.asarray(model.nominal.rho_black), np.asarray(model.nominal.rho_white),
        reference_factor(bench, reference_plane_mm(bench, height)),
        slopes,
    )  # fmt: skip
