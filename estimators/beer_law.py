"""Beer's law through windows: what the collimated capture alone says of sigma_t."""

from __future__ import annotations

import numpy as np

from estimators.protocol import BenchModel
from twin.measurement.relative import RelativeIntensities
from twin.optics import sigma_t_from_transmittance
from twin.spectra import FloatArray


def beer_check(
    intensities: RelativeIntensities, model: BenchModel
) -> tuple[FloatArray, FloatArray]:
    """sigma_t [1/mm] from the collimated capture and its standard error, both (S, W).

    All internal reflections of faces and covers are taken off in closed form; in-scattered
    light is not, so that strong forward scattering makes sigma_t too small (Iser et al. 2022,
    fig. 6). NaN where the capture is masked or not positive.
    """
    count = len(intensities.sample_names)
    values, errors = [], []
    for sample in range(count):
        valid = np.asarray(intensities.valid)[sample, 2]
        total = np.where(valid, np.asarray(intensities.value)[sample, 2], np.nan)
        sigma_t, slope = sigma_t_from_transmittance(
            total, float(intensities.thickness_mm[sample]), model.windows(sample)
        )
        variance = np.asarray(intensities.covariance)[:, 3 * sample + 2, 3 * sample + 2]
        values.append(sigma_t)
        errors.append(np.abs(slope) * np.sqrt(variance))
    return np.stack(values), np.stack(errors)
