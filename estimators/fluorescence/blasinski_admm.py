"""The convex program of Blasinski et al. 2020 for several fluorophores, by ADMM.

    minimise |residual|_F^2 + alpha |grad B_r w|^2 + beta |grad T(X)|_F^2 + gamma |T(X) grad'|_F^2
             + eta |W|_*,     X = B_m W B_x',  T = strictly lower triangle (row = emission)
    subject to 0 <= B_r w <= 1 and T(X) >= 0

Splits for the box, the sign and the singular values (Boyd et al. 2011, sections 3.1, 4.4 and 6).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimators.fluorescence.blasinski_bases import Bases
from estimators.fluorescence.cells import Cells
from twin.spectra import FloatArray

RELAXATION = 1.6
"""Over-relaxation (Boyd et al. 2011, section 3.4.3)."""


@dataclass(frozen=True, kw_only=True)
class Weights:
    """Weights of the penalties; the defaults are those of the published simulations."""

    alpha: float = 0.1
    """Of the gradient of the reflectance."""
    beta: float = 0.1
    """Of the gradient along the emission."""
    gamma: float = 0.1
    """Of the gradient along the excitation."""
    eta: float = 0.1
    """Of the nuclear norm."""


@dataclass(frozen=True, eq=False)
class Program:
    """The fixed parts for one set-up, on captures scaled to a brightest white of 1.

    Attributes:
        diagonal: captures of the reflectance weights, (M, R).
        fluorescence: captures of the flattened W, (M, X M').
        cells: fluorescence cells of the flattened W, (C, X M').
        smooth: quadratic penalties of (w, W) for alpha, beta and gamma, each (P, P).
        bases: as given.
    """

    diagonal: FloatArray
    fluorescence: FloatArray
    cells: FloatArray
    smooth: tuple[FloatArray, FloatArray, FloatArray]
    bases: Bases

    @classmethod
    def of(cls, design: FloatArray, cells: Cells, bases: Bases) -> Program:
        """Of the captures (M, Wo, Wi) of every cell of the photon matrix."""
        outer = np.einsum("oa,ib->oiab", bases.emission, bases.excitation)
        outer = outer * cells.below_diagonal[:, :, None, None]
        rows, columns = cells.below_diagonal.shape
        number = bases.emission.shape[1] * bases.excitation.shape[1]
        reflect = bases.reflectance.shape[1]
        flat = outer.reshape(rows * columns, number)
        size = reflect + number
        smooth = [np.zeros((size, size)) for _ in range(3)]
        steps = np.diff(bases.reflectance, axis=0)
        smooth[0][:reflect, :reflect] = steps.T @ steps
        along = np.diff(outer, axis=0).reshape(-1, number)
        smooth[1][reflect:, reflect:] = along.T @ along
        across = np.diff(outer, axis=1).reshape(-1, number)
        smooth[2][reflect:, reflect:] = across.T @ across
        on_diagonal = design[:, cells.diagonal[0], cells.diagonal[1]]
        return cls(
            on_diagonal @ bases.reflectance,
            design.reshape(len(design), -1) @ flat,
            flat[cells.below_diagonal.reshape(-1)],
            (smooth[0], smooth[1], smooth[2]),
            bases,
        )

    def solve(
        self,
        value: FloatArray,
        weights: Weights,
        *,
        use: FloatArray | None = None,
        iterations: int = 250,
        rho: float = 0.1,
    ) -> tuple[FloatArray, FloatArray, float]:
        """Reflectance weights (B, R) and matrices W (B, X, M') of captures (B, M).

        Args:
            value: captures.
            weights: of the penalties.
            use: which captures to use, (M,); None: all.
            iterations: of the ADMM.
            rho: its penalty.

        Returns:
            w, W and the largest primal residual at the end.
        """
        kept = slice(None) if use is None else use
        reflect = self.diagonal.shape[1]
        capture = np.concatenate([self.diagonal, self.fluorescence], axis=1)[kept]
        size = capture.shape[1]
        split = np.zeros((self.bases.reflectance.shape[0] + len(self.cells) + size - reflect, size))
        rows_r = slice(0, self.bases.reflectance.shape[0])
        rows_x = slice(rows_r.stop, rows_r.stop + len(self.cells))
        rows_w = slice(rows_x.stop, None)
        split[rows_r, :reflect] = self.bases.reflectance
        split[rows_x, reflect:] = self.cells
        split[rows_w, reflect:] = np.eye(size - reflect)
        factors = (weights.alpha, weights.beta, weights.gamma)
        system = 2.0 * capture.T @ capture + rho * split.T @ split
        for factor, penalty in zip(factors, self.smooth, strict=True):
            system += 2.0 * factor * penalty
        inverse = np.linalg.inv(system)
        target = 2.0 * capture.T @ value[:, kept].T
        shape = (self.bases.emission.shape[1], self.bases.excitation.shape[1])
        batch = len(value)
        z = np.zeros((len(split), batch))
        u = np.zeros_like(z)
        x = np.zeros((size, batch))
        gap = np.inf
        for _ in range(iterations):
            x = inverse @ (target + rho * (split.T @ (z - u)))
            image = split @ x
            relaxed = RELAXATION * image + (1.0 - RELAXATION) * z
            wanted = relaxed + u
            z = np.empty_like(wanted)
            z[rows_r] = np.clip(wanted[rows_r], 0.0, 1.0)
            z[rows_x] = np.maximum(wanted[rows_x], 0.0)
            z[rows_w] = _shrink(wanted[rows_w], shape, weights.eta / rho)
            u = wanted - z
            gap = float(np.abs(image - z).max())
        return x[:reflect].T, x[reflect:].T.reshape(batch, *shape), gap

    def predict(self, reflect: FloatArray, matrix: FloatArray) -> FloatArray:
        """Captures (B, M) of a solution."""
        flat = matrix.reshape(len(matrix), -1)
        return np.asarray(reflect @ self.diagonal.T + flat @ self.fluorescence.T)


def _shrink(flat: FloatArray, shape: tuple[int, int], threshold: float) -> FloatArray:
    """Singular values less a threshold (Cai, Candes and Shen 2010), of columns (X M', B)."""
    matrices = flat.T.reshape(-1, *shape)
    left, value, right = np.linalg.svd(matrices, full_matrices=False)
    small = np.maximum(value - threshold, 0.0)
    return np.asarray(((left * small[:, None, :]) @ right).reshape(len(matrices), -1).T)
