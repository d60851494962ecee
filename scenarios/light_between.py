"""Simulated light between the wavelengths at which its transport was computed.

Spectra of materials have kinks and narrow bands; two steps of the transport's grid see little of
them, the material's spectra, which are known everywhere, all. So not the intensities are
interpolated but how they differ from a closed form that has the same bands.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from twin.spectra import FloatArray

if TYPE_CHECKING:
    from twin.bench import Bench, Sample
    from twin.transport import NoiselessCaptures

NAMES = ("black", "white", "collimated")
"""The order of intensities."""
DARK = 1e-4
"""Added to reflectances before ratios are taken, which are nothing where there is no light."""
HALVED = 0.25
"""Error of an interpolation against that with twice the step, where the curve has a curvature."""
NEIGHBOURS = 5
"""Wavelengths of the transport over which the error is averaged: at one it may be 0 by chance."""


@dataclass(frozen=True, eq=False)
class LightBetween:
    """Relative intensities of one sample at any wavelength of the transport's range.

    Black and white are interpolated (monotone cubic, Fritsch and Butland 1984) as ratios to two
    streams between the same faces and backgrounds, collimated as the difference to Beer's law:
    the light scattered into the aperture. At the transport's wavelengths they are its own values.
    """

    bench: Bench
    sample: Sample
    noiseless: NoiselessCaptures

    def intensities(self, wavelength_nm: FloatArray) -> FloatArray:
        """Black, white and collimated at wavelengths (P,) [nm] inside the range, shape (3, P)."""
        from scipy.interpolate import PchipInterpolator

        _, curve = self._smooth()
        between = PchipInterpolator(self.noiseless.wavelength_nm, curve, axis=1)(wavelength_nm)
        theory = _theory(self.bench, self.sample, wavelength_nm)
        seen = np.concatenate([between[:2] * (theory[:2] + DARK), between[2:] + theory[2:]])
        # A Monte Carlo value may fall a hair below 0 where no light is; light cannot.
        return np.asarray(np.maximum(seen, 0.0))

    def standard_error(self, wavelength_nm: FloatArray) -> FloatArray:
        """Of the intensities: of the transport, and of the interpolation, shape (3, P).

        The transport's is linear between its wavelengths: between two of them the intensities
        average two independent errors, in a band even more, so that this is an upper bound. The
        interpolation's follows from leaving out every second wavelength.
        """
        grid = self.noiseless.wavelength_nm
        own = np.stack([getattr(self.noiseless, f"{name}_se") for name in NAMES])
        theory, curve = self._smooth()
        unit = np.concatenate([theory[:2] + DARK, np.ones_like(theory[2:])])
        missed = HALVED * unit * _missed(grid, curve)
        return np.stack(
            [
                np.hypot(np.interp(wavelength_nm, grid, a), np.interp(wavelength_nm, grid, b))
                for a, b in zip(own, missed, strict=True)
            ]
        )

    def _smooth(self) -> tuple[FloatArray, FloatArray]:
        """The closed form, and what is interpolated, both (3, W)."""
        theory = _theory(self.bench, self.sample, self.noiseless.wavelength_nm)
        light = np.stack([getattr(self.noiseless, name) for name in NAMES])
        ratio, excess = light[:2] / (theory[:2] + DARK), light[2:] - theory[2:]
        return theory, np.concatenate([ratio, excess])


def _theory(bench: Bench, sample: Sample, wavelength_nm: FloatArray) -> FloatArray:
    """Captures in closed form, shape (3, P)."""
    from estimators import BenchModel
    from estimators.two_streams import two_streams
    from twin.materials import optical_properties

    found = optical_properties(sample.material or "", wavelength_nm)
    parameters = np.stack([found.albedo, found.sigma_t_per_mm, found.g], axis=-1)
    model = BenchModel.of(bench, [sample], wavelength_nm)
    return two_streams(model, 0, sample.thickness_mm, parameters)


def _missed(grid: FloatArray, curve: FloatArray) -> FloatArray:
    """How far curves (3, W) are missed with twice the step, root mean square nearby, (3, W)."""
    from scipy.interpolate import PchipInterpolator

    count = grid.size
    missed = np.full(curve.shape, np.nan)
    for first in (0, 1):
        kept, left = slice(first, None, 2), slice(first + 1, count - 1, 2)
        if grid[kept].size > 1:
            missed[:, left] = PchipInterpolator(grid[kept], curve[:, kept], axis=1)(grid[left])
            missed[:, left] -= curve[:, left]
    # The first wavelength cannot be left out, and neither can the last.
    missed[:, [0, -1]] = np.nan
    known = np.isfinite(missed)
    window = np.ones(NEIGHBOURS)
    half = NEIGHBOURS // 2
    square = [np.convolve(row, window)[half : half + count] for row in np.nan_to_num(missed) ** 2]
    number = [np.convolve(row, window)[half : half + count] for row in known.astype(float)]
    return np.asarray(np.sqrt(np.array(square) / np.maximum(np.array(number), 1.0)))
