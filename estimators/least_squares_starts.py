"""Where least squares starts: a coarse grid of materials, looked through for every wavelength."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.least_squares_engine import Engine, Row
from twin.spectra import FloatArray

ALBEDO = np.array([0.02, 0.1, 0.25, 0.42, 0.58, 0.72, 0.82, 0.89, 0.94, 0.97, 0.987, 0.996])
OPTICAL_THICKNESS = np.geomspace(0.04, 20.0, 16)
"""Of the thinnest sample."""
G = np.array([-0.5, -0.1, 0.2, 0.42, 0.6, 0.74, 0.84, 0.91])
SOFT_RELATIVE, SOFT_ABSOLUTE = 0.1, 0.003
"""Differences of captures below count little: the grid is no finer."""
RIVAL = 9.0
"""Another valley of the distance is tried when its square is at most so many times the best."""
CHUNK = 50


@dataclass(frozen=True, eq=False)
class StartGrid:
    """Captures of N materials for any background, evaluated once.

    The captures of an unbounded slab are R + T rho / (1 - rho R') in the background's
    reflectance rho (Stokes 1862); the three numbers follow from three reflectances.

    Attributes:
        material: (albedo, sigma_t, g), (N, 3), g running fastest.
        direct, once, back: R, T and R' of every sample, (N, S).
        collimated: (N, S).
    """

    material: FloatArray
    direct: FloatArray
    once: FloatArray
    back: FloatArray
    collimated: FloatArray

    @classmethod
    def of(cls, engine: Engine) -> StartGrid:
        """Evaluate the quick engine at the middle wavelength."""
        thickness = np.asarray(engine.forward.nominal.thickness_mm)
        low, high = engine.coordinates.g_range
        g = G[(low < G) & (high > G)]
        if not g.size:
            g = np.array([0.5 * (low + high)])
        axes = np.meshgrid(ALBEDO, OPTICAL_THICKNESS / thickness.min(), g, indexing="ij")
        material = np.stack([axis.ravel() for axis in axes], axis=-1)
        count = len(material)
        rows = engine.quick_rows
        middle = len(rows.n) // 2
        around = [np.broadcast_to(leaf[middle], (count, *leaf.shape[1:])) for leaf in rows.around]
        n = np.full(count, rows.n[middle])

        def captures(rho_black: float, rho_white: float) -> FloatArray:
            here = Row(
                n,
                np.full(count, rho_black),
                np.full(count, rho_white),
                np.tile(thickness, (count, 1)),
                type(rows.around)(*around),
            )
            return engine.quick_values(material, here).reshape(count, -1, 3)

        first = captures(0.0, 0.5)
        direct, half = first[..., 0], first[..., 1] - first[..., 0]
        full = captures(0.0, 1.0)[..., 1] - direct
        rise = full - half
        back = np.where(rise > 1e-12, (full - 2.0 * half) / np.where(rise > 1e-12, rise, 1.0), 0.0)
        back = np.clip(back, 0.0, 0.99)
        return cls(material, direct, full * (1.0 - back), back, first[..., 2])

    def starts(
        self,
        data: FloatArray,
        sigma: FloatArray,
        rho_black: FloatArray,
        rho_white: FloatArray,
        most: int,
    ) -> NDArray[np.intp]:
        """The nearest materials, valleys over g, best first: (W, most) indices, -1 where fewer.

        Args:
            data: relative intensities, (W, S, 3); NaN where masked.
            sigma: their standard errors, (W, S, 3).
            rho_black: reflectance of the black background, (W,).
            rho_white: of the white one, (W,).
            most: how many to look for.
        """
        width = len(np.unique(self.material[:, 2]))
        found = np.full((len(data), most), -1, dtype=np.intp)
        for first in range(0, len(data), CHUNK):
            here = slice(first, first + CHUNK)
            distance = self._distance(data[here], sigma[here], rho_black[here], rho_white[here])
            by_g = distance.reshape(len(distance), -1, width)
            nearest = by_g.argmin(axis=1)
            depth = np.take_along_axis(by_g, nearest[:, None], axis=1)[:, 0]
            padded = np.pad(depth, ((0, 0), (1, 1)), constant_values=np.inf)
            valley = (depth <= padded[:, :-2]) & (depth <= padded[:, 2:])
            valley &= depth <= RIVAL * depth.min(axis=1, keepdims=True)
            rank = np.where(valley, depth, np.inf)
            order = np.argsort(rank, axis=1, kind="stable")[:, :most]
            node = np.take_along_axis(nearest, order, axis=1) * width + order
            kept = np.isfinite(np.take_along_axis(rank, order, axis=1))
            found[here, : order.shape[1]] = np.where(kept, node, -1)
        return found

    def _distance(
        self, data: FloatArray, sigma: FloatArray, rho_black: FloatArray, rho_white: FloatArray
    ) -> FloatArray:
        """Squared distance in softened standard deviations, (W, N)."""
        usable = np.isfinite(data)
        known = np.where(usable, data, 0.0)
        soft = sigma**2 + (SOFT_RELATIVE * np.abs(known) + SOFT_ABSOLUTE) ** 2
        weight = np.where(usable, 1.0 / np.where(usable, soft, 1.0), 0.0)
        total = np.zeros((len(data), len(self.material)))
        for sample in range(self.direct.shape[1]):
            for capture, rho in enumerate((rho_black, rho_white)):
                # neighbours mostly share their background
                shades, which = np.unique(np.round(rho, 3), return_inverse=True)
                gain = self.once[:, sample] / (
                    1.0 / np.maximum(shades, 1e-9)[:, None] - self.back[:, sample]
                )
                predicted = (self.direct[:, sample] + gain)[which]
                predicted -= known[:, sample, capture, None]
                total += weight[:, sample, capture, None] * predicted**2
            off = self.collimated[:, sample] - known[:, sample, 2, None]
            total += weight[:, sample, 2, None] * off**2
        return total
