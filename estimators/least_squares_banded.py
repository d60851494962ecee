"""Normal equations of all wavelengths together: a band for the spectra, a border for the rest.

Coordinates of W wavelengths meet each other only through the prior, which reaches two wavelengths
away: with them ordered by wavelength, then parameter, their matrix is a band. Errors common to
all wavelengths border it: an arrow, solved by its Schur complement.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from twin.spectra import FloatArray

BAND = 6
"""Unknowns are ordered by wavelength, then parameter: the prior reaches two wavelengths away."""
RIDGE = 1e-6
"""Precision of a coordinate that neither captures nor the prior know."""
COLUMNS = 600


def bending(wavelength_nm: FloatArray, length_nm: float) -> FloatArray:
    """The prior's precision for one coordinate, its diagonals: (3, W) for offsets 0, 1, 2."""
    count = len(wavelength_nm)
    diagonals = np.zeros((3, count))
    if count < 3:
        return diagonals
    step = np.diff(wavelength_nm)
    before, after = 1.0 / step[:-1], 1.0 / step[1:]
    weight = length_nm**3 / (0.5 * (step[:-1] + step[1:]))
    stencil = np.stack([before, -(before + after), after])
    for row in range(3):
        for column in range(row, 3):
            first = diagonals[column - row, row : row + count - 2]
            first += weight * stencil[row] * stencil[column]
    return diagonals


def bend(prior: FloatArray, place: FloatArray) -> FloatArray:
    """The prior's precision (3, W, 3) times coordinates, (W, 3)."""
    result = prior[0] * place
    for offset in (1, 2):
        part = prior[offset, :-offset]
        result[:-offset] += part * place[offset:]
        result[offset:] += part * place[:-offset]
    return np.asarray(result)


class Solved(NamedTuple):
    """Normal equations, solved under one prior."""

    step: tuple[FloatArray, FloatArray]
    """Of coordinates (W, 3) and common errors (K,), to the maximum of the posterior."""
    blocks: FloatArray
    """Covariance of the coordinates of each wavelength, (W, 3, 3); empty if not asked for."""
    log_determinant: float
    """Of the whole precision."""
    gain: float
    """By how much minus twice the log posterior falls on the step, captures taken as linear."""


@dataclass(frozen=True, eq=False)
class Normal:
    """Normal equations of W wavelengths and K common errors around one place.

    Attributes:
        blocks: of the coordinates, (W, 3, 3).
        border: between coordinates and common errors, (W, 3, K).
        corner: of the common errors with their unit prior, (K, K).
        force: slope of half the chi-square by the coordinates, (W, 3).
        pull: slope of half the cost by the common errors, (K,).
        place: coordinates, (W, 3).
        square: chi-square of the whitened captures.
    """

    blocks: FloatArray
    border: FloatArray
    corner: FloatArray
    force: FloatArray
    pull: FloatArray
    place: FloatArray
    square: float

    @classmethod
    def of(
        cls,
        lean: FloatArray,
        common: FloatArray,
        rest: FloatArray,
        place: FloatArray,
        size: FloatArray,
    ) -> Normal:
        """From whitened slopes (W, M, 3), modes (W, M, K) and residuals (W, M).

        Args:
            lean: slopes by the coordinates.
            common: what one standard deviation of each common error does.
            rest: residuals.
            place: coordinates, (W, 3).
            size: common errors, (K,).
        """
        return cls(
            lean.transpose(0, 2, 1) @ lean,
            lean.transpose(0, 2, 1) @ common,
            np.einsum("wmk,wml->kl", common, common) + np.eye(len(size)),
            np.einsum("wmp,wm->wp", lean, rest),
            np.einsum("wmk,wm->k", common, rest) + size,
            place,
            float(np.sum(rest**2)),
        )

    def sizes(self, step: FloatArray) -> FloatArray:
        """Steps (W, 3) in standard deviations of each wavelength for itself, (W,)."""
        return np.asarray(np.sqrt(np.einsum("wi,wij,wj->w", step, self.blocks, step)))

    def solved(self, prior: FloatArray, damping: float = 0.0, *, blocks: bool = True) -> Solved:
        """Solve under a prior (3, W, 3), see `bending`; a third axis for the coordinates.

        Args:
            prior: precision.
            damping: of Levenberg and Marquardt.
            blocks: whether covariances are wanted.
        """
        from scipy.linalg import cho_solve_banded, cholesky_banded

        count, kinds = len(self.blocks), len(self.corner)
        band = _band(self.blocks, prior)
        band[0] += RIDGE + damping * (1.0 + band[0])
        factor = (cholesky_banded(band, lower=True), True)
        force = (self.force + bend(prior, self.place)).ravel()
        border = self.border.reshape(3 * count, kinds)
        through = cho_solve_banded(factor, np.column_stack([force, border]))
        schur = self.corner - border.T @ through[:, 1:]
        pull = self.pull - border.T @ through[:, 0]
        size = -np.linalg.solve(schur, pull)
        step = -through[:, 0] - through[:, 1:] @ size
        gain = -float(force @ step + self.pull @ size)
        sign = np.linalg.slogdet(schur)[1]
        log_determinant = 2.0 * float(np.log(factor[0][0]).sum()) + float(sign)
        found = np.empty((0, 3, 3))
        if blocks:
            found = _inverse_blocks(factor, 3 * count)
            wide = through[:, 1:].reshape(count, 3, kinds)
            found += np.einsum("wik,kl,wjl->wij", wide, np.linalg.inv(schur), wide)
        return Solved((step.reshape(count, 3), size), found, log_determinant, gain)


def _band(normal: FloatArray, prior: FloatArray) -> FloatArray:
    """Lower band of the whole precision, (BAND + 1, 3W)."""
    count = len(normal)
    band = np.zeros((BAND + 1, count, 3))
    for row in range(3):
        for column in range(row + 1):
            band[row - column, :, column] += normal[:, row, column]
    for offset in range(3):
        band[3 * offset] += prior[offset]
    return band.reshape(BAND + 1, 3 * count)


def _inverse_blocks(factor: tuple[FloatArray, bool], size: int) -> FloatArray:
    """Diagonal 3 x 3 blocks of the inverse, (W, 3, 3)."""
    from scipy.linalg import cho_solve_banded

    blocks = np.empty((size // 3, 3, 3))
    for first in range(0, size, COLUMNS):
        width = min(COLUMNS, size - first)
        unit = np.zeros((size, width))
        unit[first + np.arange(width), np.arange(width)] = 1.0
        inverse = cho_solve_banded(factor, unit)[first : first + width]
        for w in range(width // 3):
            blocks[first // 3 + w] = inverse[3 * w : 3 * w + 3, 3 * w : 3 * w + 3]
    return blocks
