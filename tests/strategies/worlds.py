"""The theory of Kubelka and Munk as a world of its own: exact, closed form, instant."""

from __future__ import annotations

import numpy as np

from estimators import BenchModel
from estimators.kubelka_munk_theory import (
    Fluxes,
    coefficients,
    faces_of,
    layer_reflectance,
)
from twin.optics import stack_transmittance
from twin.spectra import FloatArray


def two_fluxes(model: BenchModel, material: FloatArray) -> FloatArray:
    """Captures (S, 3, W) of a material (W, 3) in perfectly diffuse light."""
    found = []
    both = coefficients(material)
    for s, sample in enumerate(model.samples):
        faces, height = faces_of(model, s), sample.thickness_mm
        outside, inside = faces.below_outside, faces.below_inside
        rho = np.stack([model.rho_black, model.rho_white])
        ground = inside + (1 - inside) * (1 - outside) * rho / (1 - outside * rho)
        fluxes = Fluxes(both.absorbed * height, both.scattered * height)
        inner = layer_reflectance(fluxes, ground)
        outer = faces.enter * faces.leave * inner / (1 - faces.above_inside * inner)
        beam = stack_transmittance(np.exp(-material[:, 1] * height), model.windows(s))
        found.append(np.concatenate([outer, beam[None]]))
    return np.stack(found)
