"""Fluorophores as products of an emission and an excitation spectrum, with a prior on their shape.

    cell(o, i) = sum_k exp(u_k(o) + v_k(i)),   emission o longer than excitation i  (Kasha's rule)
    u = ln peak + ln lognormal(o; peak wavelength, width, skew) + deviation(o)
    v =           ln lognormal(i; peak wavelength, width, skew) + deviation(i)
    reflectance  = what there is without fluorophores - sum_k dip_k exp(v_k)

Light that a fluorophore absorbs is not reflected: the reflectance, which captures tell well, shows
where it is excited, which they tell less well.

The log-normal peak is that of Siano and Metzler 1969; a soft floor of exp(-7) lets deviations act
in its tails. Deviations are Gaussian processes in their first eigenvectors. All parameters are
whitened: standard normal a priori. Widths and skews are broader than those of 375 published
fluorophores (of McNamara and Boswell and of Life Technologies) as they look in a film or a turbid
paint, whose ln widths are 3.9 with 0.4 and 4.3 with 0.4: paints hold several dyes. All scales were
chosen on generated matrices (docs/fluorescence_estimators.md), none on measured ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from estimators.fluorescence.background_prior import matern52
from estimators.fluorescence.cells import Cells
from twin.spectra import FloatArray

FLOOR = -7.0
"""Logarithm of the soft floor of a spectrum whose peak is 1."""
_STEPS = (0.1, 1e-3, 1e-3)
_LARGEST = 3.0


@dataclass(frozen=True, kw_only=True)
class ShapePrior:
    """Means and standard deviations of the shape parameters."""

    log_peak: tuple[float, float] = (-2.8, 1.5)
    """ln of the peak cell [energy per 10 nm emission bin]."""
    emission_nm: tuple[float, float] = (540.0, 90.0)
    emission_log_width: tuple[float, float] = (4.1, 0.3)
    """ln of the full width at half maximum [nm]."""
    emission_skew: tuple[float, float] = (0.43, 0.17)
    stokes_nm: tuple[float, float] = (50.0, 50.0)
    """Emission peak less excitation peak [nm]."""
    excitation_log_width: tuple[float, float] = (5.4, 1.0)
    excitation_skew: tuple[float, float] = (-0.3, 0.85)
    deviation: tuple[float, float] = (0.3, 0.3)
    """Standard deviations of ln emission and ln excitation around the log-normal peak."""
    deviation_length_nm: tuple[float, float] = (28.0, 30.0)
    deviation_terms: int = 12
    dip: tuple[float, float] = (0.15, 0.15)
    """Share of the light that is not reflected where a fluorophore absorbs most [-]; (0, 0):
    reflectance and fluorescence know nothing of each other."""


def log_peak(wavelength: FloatArray, shape: FloatArray) -> FloatArray:
    """Logarithm of log-normal peaks with floor, shape (N, W), of (peak, ln width, skew), (N, 3)."""
    centre, log_width, skew = shape[:, 0:1], shape[:, 1:2], shape[:, 2:3]
    x = 2.0 * (wavelength - centre) / np.exp(log_width)
    straight = np.abs(skew) < 1e-3
    safe = np.where(straight, 1.0, skew)
    z = np.where(straight, x, np.log(np.maximum(1.0 + safe * x, 1e-3)) / safe)
    return np.asarray(np.logaddexp(-np.log(2.0) * z**2, FLOOR))


@dataclass(frozen=True, eq=False)
class Products:
    """The forward model of the products for captures in m directions.

    Attributes:
        design: (m, Wo, Wi), zero outside the fluorescence.
        cells: the unknowns.
        prior: of the shapes.
        diagonal_design: of the reflectance, (m, D); None: captures of the fluorescence alone.
    """

    design: FloatArray
    cells: Cells
    prior: ShapePrior
    diagonal_design: FloatArray | None = None

    @cached_property
    def _bases(self) -> tuple[FloatArray, FloatArray]:
        grids = (self.cells.emission_nm, self.cells.excitation_nm)
        sigma, length = self.prior.deviation, self.prior.deviation_length_nm
        found = []
        for grid, s, scale in zip(grids, sigma, length, strict=True):
            value, vector = np.linalg.eigh(s**2 * matern52(grid[:, None] - grid, scale))
            root = vector * np.sqrt(np.maximum(value, 0.0))
            found.append(np.ascontiguousarray(root[:, ::-1][:, : self.prior.deviation_terms]))
        return found[0], found[1]

    @property
    def size(self) -> int:
        """Parameters per product, P."""
        return 7 + 2 * self.prior.deviation_terms + self.dips

    @cached_property
    def dips(self) -> bool:
        """Whether products take from the reflectance; then that is their last parameter."""
        return any(self.prior.dip)

    @cached_property
    def _mean_scale(self) -> tuple[FloatArray, FloatArray]:
        p = self.prior
        pairs = np.array(
            [
                p.log_peak, p.emission_nm, p.emission_log_width, p.emission_skew,
                p.stokes_nm, p.excitation_log_width, p.excitation_skew,
            ]
        )  # fmt: skip
        return pairs[:, 0], pairs[:, 1]

    def start(self, peak: FloatArray, emission_nm: FloatArray, shift_nm: FloatArray) -> FloatArray:
        """Whitened parameters (..., P) of given peaks, all else at its mean."""
        mean, scale = self._mean_scale
        out = np.zeros((*np.shape(peak), self.size))
        out[..., 0] = (np.log(np.maximum(peak, 1e-5)) - mean[0]) / scale[0]
        out[..., 1] = (emission_nm - mean[1]) / scale[1]
        out[..., 4] = (shift_nm - mean[4]) / scale[4]
        return np.clip(out, -3.0, 3.0)

    def spectra(self, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Emission (..., Wo) and excitation (..., Wi) spectra of parameters (..., P)."""
        emission, excitation, _, _ = self._spectra(parameters.reshape(-1, self.size), False)
        lead = parameters.shape[:-1]
        return emission.reshape(*lead, -1), excitation.reshape(*lead, -1)

    def _spectra(
        self, t: FloatArray, derivatives: bool
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Spectra (N, Wo), (N, Wi) and derivatives of their logarithms, (N, W, P)."""
        mean, scale = self._mean_scale
        base_u, base_v = self._bases
        terms = self.prior.deviation_terms
        p = mean + scale * t[:, :7]
        out, into = self.cells.emission_nm, self.cells.excitation_nm
        emission = p[:, 1:4]
        excitation = np.column_stack([p[:, 1] - p[:, 4], p[:, 5], p[:, 6]])
        u = log_peak(out, emission)
        v = log_peak(into, excitation)
        du = np.zeros((len(t), out.size, self.size))
        dv = np.zeros((len(t), into.size, self.size))
        if derivatives:
            gu, gv = _slopes(out, emission, u), _slopes(into, excitation, v)
            du[:, :, 0] = scale[0]
            du[:, :, 1:4] = gu * scale[1:4]
            du[:, :, 7 : 7 + terms] = base_u
            dv[:, :, 1] = gv[:, :, 0] * scale[1]
            dv[:, :, 4] = -gv[:, :, 0] * scale[4]
            dv[:, :, 5:7] = gv[:, :, 1:] * scale[5:7]
            dv[:, :, 7 + terms : 7 + 2 * terms] = base_v
        u = u + p[:, :1] + t[:, 7 : 7 + terms] @ base_u.T
        v = v + t[:, 7 + terms : 7 + 2 * terms] @ base_v.T
        return np.exp(np.minimum(u, _LARGEST)), np.exp(np.minimum(v, _LARGEST)), du, dv

    def values(self, parameters: FloatArray) -> FloatArray:
        """Captures in m directions, (B, m), of parameters (B, K, P)."""
        emission, excitation = self.spectra(parameters)
        cells = np.einsum("bko,bki->boi", emission, excitation)
        found = np.tensordot(cells, self.design, axes=((1, 2), (1, 2)))
        if self.diagonal_design is not None:
            found = found + self.reflectance(parameters) @ self.diagonal_design.T
        return np.asarray(found)

    def values_and_jacobian(self, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Captures (B, m) and their derivatives (B, m, K P) of parameters (B, K, P)."""
        batch, products, size = parameters.shape
        count = batch * products
        em, ex, du, dv = self._spectra(parameters.reshape(count, size), True)
        m, rows, columns = self.design.shape
        by_emission = (self.design.reshape(m * rows, columns) @ ex.T).reshape(m, rows, count)
        by_emission = by_emission.transpose(2, 0, 1) * em[:, None, :]
        flat = self._transposed.reshape(m * columns, rows)
        by_excitation = (flat @ em.T).reshape(m, columns, count)
        by_excitation = by_excitation.transpose(2, 0, 1) * ex[:, None, :]
        value = by_emission.sum(axis=2).reshape(batch, products, m).sum(axis=1)
        jacobian = by_emission @ du + by_excitation @ dv
        if self.dips and self.diagonal_design is not None:
            taken, slope = self._taken(parameters.reshape(count, size), ex, dv)
            value -= (taken.reshape(batch, products, -1).sum(axis=1)) @ self.diagonal_design.T
            jacobian -= self.diagonal_design @ slope
        stacked = jacobian.reshape(batch, products, m, size).transpose(0, 2, 1, 3)
        return value, np.ascontiguousarray(stacked).reshape(batch, m, products * size)

    def _taken(
        self, t: FloatArray, excitation: FloatArray, slope: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """What products (N, P) take from the reflectance, (N, D), and its slopes (N, D, P)."""
        mean, scale = self.prior.dip
        curve = excitation[:, self.cells.diagonal[1]]
        taken = (mean + scale * t[:, -1:]) * curve
        slopes = taken[:, :, None] * slope[:, self.cells.diagonal[1]]
        slopes[:, :, -1] = scale * curve
        return taken, slopes

    def reflectance(self, parameters: FloatArray) -> FloatArray:
        """Changes of the reflectance (B, D) by products of parameters (B, K, P)."""
        batch, products, size = parameters.shape
        if not self.dips or products == 0:
            return np.zeros((batch, self.cells.diagonal_nm.size))
        t = parameters.reshape(-1, size)
        _, excitation, _, slope = self._spectra(t, False)
        taken, _ = self._taken(t, excitation, slope)
        return np.asarray(-taken.reshape(batch, products, -1).sum(axis=1))

    @cached_property
    def _transposed(self) -> FloatArray:
        return np.ascontiguousarray(self.design.transpose(0, 2, 1))

    def fluorescence(self, parameters: FloatArray) -> FloatArray:
        """Cells (B, C) of parameters (B, K, P)."""
        emission, excitation = self.spectra(parameters)
        matrix = np.einsum("bko,bki->boi", emission, excitation)
        return np.asarray(matrix[:, self.cells.below_diagonal])


def _slopes(wavelength: FloatArray, shape: FloatArray, value: FloatArray) -> FloatArray:
    """Derivatives of `log_peak`, whose values (N, W) are known, by its shape, (N, W, 3)."""
    shifted = (shape[:, None, :] + np.diag(_STEPS)).reshape(-1, 3)
    moved = log_peak(wavelength, shifted).reshape(len(shape), 3, -1)
    return np.asarray(((moved - value[:, None, :]) / np.array(_STEPS)[:, None]).transpose(0, 2, 1))
