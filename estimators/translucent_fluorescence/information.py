"""What a design can tell: the Fisher information of LEDs, backgrounds and thicknesses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimators.translucent_fluorescence.data import LedMeasurement
from estimators.translucent_fluorescence.fit import Prior
from estimators.translucent_fluorescence.model import HOST, FluorescentForward, State


@dataclass(frozen=True)
class DesignInformation:
    """Standard deviations that a design allows at best (Cramer and Rao), medians over wavelength.

    Attributes:
        log_sigma_a, log_sigma_s_prime, g: of the host.
        log_excitation: of quantum yield times absorption, where it is above 5 % of its peak.
        log_integrated: of the integrated fluorescence.
        blind_directions: eigenvectors of the data's information, in units of the prior, along
            which the data tell less than the prior does.
        unknowns: number of coordinates.
    """

    log_sigma_a: float
    log_sigma_s_prime: float
    g: float
    log_excitation: float
    log_integrated: float
    blind_directions: int
    unknowns: int


def design_information(
    model: FluorescentForward,
    state: State,
    measurement: LedMeasurement,
    *,
    prior: Prior | None = None,
    engine: float = 2e-3,
) -> DesignInformation:
    """Information of a visit at a material; the values measured do not matter.

    Args:
        model: of the design's bench and samples.
        state: the material.
        measurement: lights and covariance of the design.
        prior: what is known beforehand; intervals include it.
        engine: relative error of the forward model.
    """
    expected, slope = model.jacobian(state, measurement.lights)
    root = np.linalg.cholesky(measurement.covariance(engine, expected))
    whitened = np.linalg.solve(root, slope)
    matrix, _ = (prior or Prior()).rows(model)
    before = matrix.T @ matrix
    data = whitened.T @ whitened
    covariance = np.linalg.inv(data + before)
    unit = np.linalg.inv(np.linalg.cholesky(before))
    told = np.linalg.eigvalsh(unit @ data @ unit.T)
    waves = len(model.wavelength_nm)
    deviation = np.sqrt(np.diag(covariance))[: HOST * waves].reshape(waves, HOST)
    own, excites = model.excitation.matrix, model.excites(state)
    at = slice(HOST * waves, HOST * waves + model.excitation.size)
    strong = excites > 0.05 * excites.max()
    log_sd = np.sqrt(np.einsum("wx,xy,wy->w", own, covariance[at, at], own))
    source, step = model.source(state), model.step_nm
    cells = step[:, None] * source * step
    cells = cells / cells.sum()
    gradient = np.zeros(model.coordinates)
    gradient[at] = cells.sum(axis=0) @ own
    share = step * model.emits(state)
    turned = model.emission.matrix - share @ model.emission.matrix
    gradient[at.stop :] = cells.sum(axis=1) @ turned
    g = state.material[2]
    return DesignInformation(
        float(np.median(deviation[:, 0])),
        float(np.median(deviation[:, 1])),
        float(np.median(deviation[:, 2] * (1.0 - g**2))),
        float(np.median(log_sd[strong])),
        float(np.sqrt(gradient @ covariance @ gradient)),
        int(np.sum(told < 1.0)),
        model.coordinates,
    )
