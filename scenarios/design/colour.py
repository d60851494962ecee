"""CIEDE2000 of a slab that is predicted from an uncertain material.

The slab is 5 mm thick, between cover glasses over an ideal black, lit and seen as on the bench.
Errors of the material that are common to all wavelengths add up in a colour, independent ones
average out; a detector with few channels misses what the spectrum does between them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scenarios.design.fisher import Predicted
from scenarios.design.media import Medium
from scenarios.design.optics import MATERIAL, solved
from twin.bench import Bench
from twin.spectra import FloatArray

THICKNESS_MM = 5.0
FINE_STEP_NM = 10.0
SMALL_LAB = 0.05
"""Step in L*, a* and b* over which the metric of CIEDE2000 is taken."""
STEP = 1e-4


@dataclass(frozen=True, eq=False)
class Slabs:
    """Slabs of M materials, seen through their values at W wavelengths.

    Attributes:
        by_material: derivatives of L*, a*, b* by albedo, sigma_t and g at every wavelength,
            (M, W, 3, 3).
        metric: of CIEDE2000 at every colour: DE^2 = d' metric d, (M, 3, 3).
        between: CIEDE2000 by what the spectrum does between the wavelengths, (M,).
    """

    by_material: FloatArray
    metric: FloatArray
    between: FloatArray

    @classmethod
    def of(cls, media: Sequence[Medium], wavelength_nm: FloatArray) -> Slabs:
        """Slabs of materials.

        Args:
            media: M of them.
            wavelength_nm: of the detector [nm], (W,).
        """
        import colour

        from scenarios.report.colour import Observer

        low, high = float(wavelength_nm[0]), float(wavelength_nm[-1])
        observer = Observer(low, high)
        steps = max(int(np.ceil((high - low) / FINE_STEP_NM)), 1)
        fine = np.linspace(low, high, steps + 1)
        linear = np.stack(
            [np.interp(observer.wavelength_nm, wavelength_nm, unit)
             for unit in np.eye(len(wavelength_nm))], axis=0
        )  # fmt: skip
        slopes, metrics, between = [], [], []
        for medium in media:
            seen, slope = _seen(medium, wavelength_nm)
            here = np.array(observer.swatch(seen @ linear).lab)
            by_factor = np.array(
                [(np.array(observer.swatch((seen + STEP * unit) @ linear).lab) - here) / STEP
                 for unit in np.eye(len(seen))]
            )  # fmt: skip
            slopes.append(by_factor[:, :, None] * slope[:, None, :])
            metrics.append(_metric(here))
            full = _seen(medium, fine)[0]
            there = np.array(observer.swatch(np.interp(observer.wavelength_nm, fine, full)).lab)
            between.append(float(colour.delta_E(here, there, method="CIE 2000")))
        return cls(np.array(slopes), np.array(metrics), np.array(between))

    def parts(self, found: Predicted) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Root mean square CIEDE2000 (N, M).

        And its square by every mode (N, M, Q) and by the bias of the estimate (N, M).
        """
        by_mode = np.einsum("mwlp,nmwpq->nmlq", self.by_material, found.gain)
        modes = np.einsum("nmlq,mlk,nmkq->nmq", by_mode, self.metric, by_mode)
        noise = found.covariance - np.einsum("nmwpq,nmwrq->nmwpr", found.gain, found.gain)
        lab = np.einsum("mwlp,nmwpr,mwkr->nmlk", self.by_material, noise, self.by_material)
        independent = np.maximum(np.einsum("nmlk,mlk->nm", lab, self.metric), 0.0)
        moved = np.einsum("mwlp,nmwp->nml", self.by_material, found.bias)
        bias = np.einsum("nml,mlk,nmk->nm", moved, self.metric, moved)
        total = independent + modes.sum(axis=-1) + bias + self.between**2
        return np.sqrt(total), modes, bias

    def de2000(self, found: Predicted) -> FloatArray:
        """Root mean square CIEDE2000, (N, M)."""
        return self.parts(found)[0]


def _seen(medium: Medium, wavelength_nm: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Radiance factor of the slab (W,) and its slopes by the material (W, 3)."""
    value, slope = solved(Bench(), medium, THICKNESS_MM, wavelength_nm)
    return value[:, 0], slope[:, 0, :MATERIAL]


def _metric(lab: FloatArray) -> FloatArray:
    """Metric of CIEDE2000 at a colour, (3, 3): by differences along all directions in pairs."""
    import colour

    unit = SMALL_LAB * np.eye(3)

    def square(step: FloatArray) -> float:
        return float(colour.delta_E(lab, lab + step, method="CIE 2000")) ** 2 / SMALL_LAB**2

    metric = np.diag([square(each) for each in unit])
    for i in range(3):
        for j in range(i):
            mixed = 0.25 * (square(unit[i] + unit[j]) - square(unit[i] - unit[j]))
            metric[i, j] = metric[j, i] = mixed
    return metric
