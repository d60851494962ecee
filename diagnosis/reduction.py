"""Data reduced to what the material cannot explain: whitened, material profiled out, exactly.

With y = J d + sum_k c_k z_k + e, e of block-diagonal covariance, z standard normal and the
material change d free, the residual is whitened per wavelength (symmetrically, so that a whitened
channel stays as near as possible to its channel: Kessy, Lewin and Strimmer 2018, "Optimal
whitening and decorrelation", ZCA-cor), projected on the complement of the material's Jacobian per
wavelength, and only then are the common modes whitened, by their low rank (Woodbury 1950). As
error contrasts (Patterson and Thompson 1971) carry all that generalised least squares leaves of
the data, the order is exact: the result is standard normal on the complement, and no matrix of
the size of the data squared is ever formed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from diagnosis.problem import Problem, Smoothness
from twin.errors import InputError
from twin.measurement.model import BoolArray
from twin.spectra import FloatArray

RANK = 1e-9
"""Singular values below this share of the largest belong to directions that do nothing."""
RIDGE = 1e-2
"""A material change of one unit that moves the data by less than 0.1 sigma is not stepped."""


@dataclass(frozen=True, eq=False)
class Reduction:
    """The map from data space (W, M) to standard normal residuals, n = W M entries.

    Attributes:
        valid: False where masked, shape (W, M).
        root: symmetric whitening matrices, zero rows and columns where masked, (W, M, M).
        basis: orthonormal basis of the material's whitened Jacobian, (W, M, P); zero columns
            where its rank is lower.
        singular: singular values of the whitened Jacobian, (W, P).
        turn: right singular vectors, (W, P, P).
        modes: whitened common modes before the projection, (W, M, K).
        common: orthonormal directions of the projected common modes, (n, K').
        spread: standard deviations along them beside the unit noise, (K',).
    """

    valid: BoolArray
    root: FloatArray
    basis: FloatArray
    singular: FloatArray
    turn: FloatArray
    modes: FloatArray
    common: FloatArray
    spread: FloatArray

    @classmethod
    def of(
        cls,
        problem: Problem,
        jacobian: FloatArray,
        *,
        valid: BoolArray | None = None,
        prior: Smoothness | None = None,
    ) -> Reduction:
        """The reduction of a problem about a fit.

        Args:
            problem: W wavelengths, M channels, K common modes.
            jacobian: derivatives by the material at the fit, shape (W, M, P).
            valid: a part of the problem's valid data; None: all of them.
            prior: None leaves the material free at every wavelength; a smoothness prior makes it
                part of the covariance instead.

        Raises:
            InputError: an independent covariance that is not positive definite.
        """
        use = problem.valid if valid is None else valid & problem.valid
        modes = np.moveaxis(problem.common, 0, -1)
        independent = problem.independent
        if prior is not None:
            nugget = jacobian * np.asarray(prior.nugget)
            independent = independent + nugget @ np.swapaxes(nugget, 1, 2)
            modes = np.concatenate(
                [modes, material_modes(problem.wavelength_nm, jacobian, prior)], axis=2
            )
            jacobian = np.zeros((*use.shape, 0))
        root = whitening(independent, use)
        return cls._finish(use, root, root @ jacobian, root @ modes)

    @classmethod
    def _finish(
        cls, valid: BoolArray, root: FloatArray, jacobian: FloatArray, modes: FloatArray
    ) -> Reduction:
        basis, singular, turn = np.linalg.svd(jacobian, full_matrices=False)
        kept = singular > RANK * np.max(singular, initial=1e-300)
        basis = basis * kept[:, None, :]
        projected = modes - basis @ (np.swapaxes(basis, 1, 2) @ modes)
        flat = projected.reshape(valid.size, modes.shape[2])
        # By the small Gram matrix; what it loses is far below the unit noise beside it.
        variance, vector = np.linalg.eigh(flat.T @ flat)
        some = variance > 1e-12 * max(1.0, float(np.max(variance, initial=0.0)))
        spread = np.sqrt(variance[some])
        common = flat @ (vector[:, some] / spread)
        return cls(
            valid=valid,
            root=root,
            basis=basis,
            singular=np.where(kept, singular, 0.0),
            turn=turn,
            modes=modes,
            common=common,
            spread=spread,
        )

    def about(self, jacobian: FloatArray) -> Reduction:
        """The same covariance and mask about another fit; jacobian of shape (W, M, P)."""
        return self._finish(self.valid, self.root, self.root @ jacobian, self.modes)

    @property
    def freedom(self) -> int:
        """Degrees of freedom that are left: data less directions of the material."""
        return int(self.valid.sum() - np.sum(self.singular > 0))

    def __call__(self, change: FloatArray) -> FloatArray:
        """Reduce data or columns of data, shape (W, M) or (W, M, E), to (n,) or (n, E)."""
        return self._whiten_common(self.project(self._whiten(change)))

    def _whiten(self, change: FloatArray) -> FloatArray:
        columns = change if change.ndim == 3 else change[:, :, None]
        # Masked entries may hold anything, NaN included.
        known = np.where(self.valid[:, :, None], columns, 0.0)
        return np.asarray((self.root @ known).reshape(change.shape))

    def project(self, whitened: FloatArray) -> FloatArray:
        """Take the material's directions off whitened (W, M) or (W, M, E); (n,) or (n, E)."""
        columns = whitened if whitened.ndim == 3 else whitened[:, :, None]
        left = columns - self.basis @ (np.swapaxes(self.basis, 1, 2) @ columns)
        flat = left.reshape(self.valid.size, columns.shape[2])
        return np.asarray(flat if whitened.ndim == 3 else flat[:, 0])

    def _whiten_common(self, flat: FloatArray) -> FloatArray:
        along = self.common.T @ flat
        shrink = 1.0 - 1.0 / np.sqrt(1.0 + self.spread**2)
        return np.asarray(flat - self.common @ (along.T * shrink).T)

    def simulate(self, generator: np.random.Generator, draws: int) -> FloatArray:
        """Residuals of the no-effect model, shape (n, draws): normal on the complement."""
        noise = generator.standard_normal((*self.valid.shape, draws))
        return self.project(noise * self.valid[:, :, None])

    def material_step(self, change: FloatArray, modes: bool = True) -> FloatArray:
        """Generalised least-squares change of the material, shape (W, P), for data (W, M)."""
        whitened = self._whiten(change)
        if modes and self.modes.shape[2]:
            projected = self.project(self.modes)
            inner = np.eye(projected.shape[1]) + projected.T @ projected
            amplitude = np.linalg.solve(inner, projected.T @ self.project(whitened))
            whitened = whitened - self.modes @ amplitude
        along = np.einsum("wmp,wm->wp", self.basis, whitened)
        filtered = along * self.singular / (self.singular**2 + RIDGE)
        return np.asarray(np.einsum("wqp,wq->wp", self.turn, filtered))

    def material_sd(self) -> FloatArray:
        """Standard error of the material's coordinates from the independent noise, (W, P)."""
        scaled = self.turn / np.sqrt(self.singular**2 + RIDGE)[:, :, None]
        return np.asarray(np.sqrt(np.sum(scaled**2, axis=1)))

    def misfit(self, residual: FloatArray) -> float:
        """Chi-square of a residual (W, M) with the material held where it is."""
        whitened = self._whiten(residual).ravel()
        flat = self.modes.reshape(whitened.size, self.modes.shape[2])
        inner = np.eye(flat.shape[1]) + flat.T @ flat
        along = flat.T @ whitened
        return float(whitened @ whitened - along @ np.linalg.solve(inner, along))


def whitening(covariance: FloatArray, valid: BoolArray) -> FloatArray:
    """ZCA-cor whitening matrices, shape (W, M, M), zero where masked.

    Raises:
        InputError: a covariance that is not positive definite.
    """
    variance = np.diagonal(covariance, axis1=1, axis2=2)
    if not np.all(np.isfinite(variance[valid])) or np.any(variance[valid] <= 0):
        raise InputError(
            "a variance that is not above 0", "the noise of every valid datum", place="independent"
        )
    both = valid[:, :, None] & valid[:, None, :]
    scale = np.where(valid, np.sqrt(np.where(valid, variance, 1.0)), 1.0)
    correlation = np.where(both, covariance, 0.0) / (scale[:, :, None] * scale[:, None, :])
    correlation = correlation + (~valid)[:, :, None] * np.eye(valid.shape[1])
    value, vector = np.linalg.eigh(correlation)
    if np.any(value <= 1e-12 * valid.shape[1]):
        raise InputError(
            "a covariance between channels that is not positive definite",
            "one that is; fully shared errors belong into the common modes or have noise beside"
            " them",
            place="independent",
        )
    root = (vector / np.sqrt(value)[:, None, :]) @ np.swapaxes(vector, 1, 2)
    return np.asarray(np.where(both, root / scale[:, None, :], 0.0))


def material_modes(
    wavelength_nm: FloatArray, jacobian: FloatArray, prior: Smoothness
) -> FloatArray:
    """Common modes of a material that is smooth over wavelength, shape (W, M, K).

    The mean over wavelength is left all but free (30 sd).
    """
    between = smooth_kernel(wavelength_nm, prior.length_nm)
    value, vector = np.linalg.eigh(between + 900.0)
    kept = value > 1e-6 * value[-1] / 900.0
    shapes = vector[:, kept] * np.sqrt(value[kept])
    modes = [
        jacobian[:, :, coordinate, None] * (sd * shapes)[:, None, :]
        for coordinate, sd in enumerate(prior.sd)
    ]
    return np.concatenate(modes, axis=2)


def smooth_kernel(wavelength_nm: FloatArray, length_nm: float) -> FloatArray:
    """Squared-exponential correlation between wavelengths, shape (W, W)."""
    apart = (wavelength_nm[:, None] - wavelength_nm[None, :]) / length_nm
    return np.asarray(np.exp(-0.5 * apart**2))
