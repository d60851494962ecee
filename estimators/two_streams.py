"""Two streams in closed form: coarse captures with the bands and faces of the real ones.

For what is compared with itself: how captures change from one wavelength or refractive index to
the next. The captures themselves are those of an engine.
"""

from __future__ import annotations

import numpy as np

from estimators.kubelka_munk_theory import Fluxes, faces_of, layer_reflectance
from estimators.protocol import BenchModel
from twin.optics import stack_transmittance
from twin.spectra import FloatArray


def two_streams(
    model: BenchModel, sample: int, thickness_mm: float, parameters: FloatArray
) -> FloatArray:
    """Black and white by two streams, collimated by Beer's law, shape (3, W).

    Source: Meador & Weaver (1980), J. Atmos. Sci. 37, 630-643, table 1 (quadrature), in the
    solution of Kubelka (1948).

    Args:
        model: faces, covers and backgrounds at W wavelengths.
        sample: number of the sample, for its refractive index.
        thickness_mm: thickness [mm].
        parameters: albedo, sigma_t [1/mm] and g, shape (W, 3).
    """
    albedo, sigma_t, g = parameters.T
    depth, root = sigma_t * thickness_mm, np.sqrt(3.0)
    fluxes = Fluxes(root * (1.0 - albedo) * depth, 0.5 * root * albedo * (1.0 - g) * depth)
    faces = faces_of(model, sample)
    rho = np.stack([model.rho_black, model.rho_white])
    through = (1.0 - faces.below_inside) * (1.0 - faces.below_outside)
    ground = faces.below_inside + through * rho / (1.0 - faces.below_outside * rho)
    inner = layer_reflectance(fluxes, ground)
    outer = faces.enter * faces.leave * inner / (1.0 - faces.above_inside * inner)
    beam = stack_transmittance(np.exp(-depth), model.windows(sample))
    return np.concatenate([outer, beam[None]])
