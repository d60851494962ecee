"""The weighted sum of squares that the optimisers minimise, and what follows at its minimum."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.beer import beer_check
from estimators.draws import NINETY_HIGH, NINETY_LOW
from estimators.forward import Forward
from estimators.protocol import BenchModel
from estimators.result import QUANTILE_LEVELS, EstimateResult, Status, normal_deviate
from estimators.screening import RANGE, SHARE, Screened, Setting, assembled, screen
from twin.bench import Bench, Sample
from twin.measurement.relative import RelativeIntensities
from twin.spectra import FloatArray

UNKNOWNS = 3
DEPTHS = (2e-3, 60.0)
"""Optical depths of the mean thickness between which sigma_t is sought."""
ANISOTROPY = (-0.9, 0.97)
SMALLEST_ERROR = 1e-6
"""Absolute error [1] of the engine where a capture itself goes to zero."""
WEAK = 1.0 / 400.0
"""Precision that every coordinate has without data: its whole range is some 20 wide."""
EDGE = 1e-5
"""Share of the range within which an estimate lies at its bound."""
SETTLED = 0.01
"""Chi-square that one more Gauss-Newton step may still promise where a solver has settled."""
TORN = 6.3e-5
"""Probability of a chi-square (4 standard deviations) below which samples are inconsistent."""


class Coordinates(NamedTuple):
    """Unbounded coordinates of albedo, sigma_t and g: logits of their place in the range."""

    thickness_mm: float

    @property
    def _range(self) -> tuple[FloatArray, FloatArray]:
        low = np.array([0.0, np.log(DEPTHS[0] / self.thickness_mm), ANISOTROPY[0]])
        high = np.array([1.0, np.log(DEPTHS[1] / self.thickness_mm), ANISOTROPY[1]])
        return low, high

    def parameters(self, theta: FloatArray) -> FloatArray:
        """Albedo, sigma_t [1/mm] and g of coordinates, shape (..., 3)."""
        low, high = self._range
        found = low + (high - low) * share(theta)
        found[..., 1] = np.exp(found[..., 1])
        return np.asarray(found)

    def slope(self, theta: FloatArray) -> FloatArray:
        """Derivative of every parameter by its coordinate, shape (..., 3)."""
        low, high = self._range
        part = share(theta)
        found = (high - low) * part * (1.0 - part)
        found[..., 1] *= self.parameters(theta)[..., 1]
        return np.asarray(found)

    def of(self, parameters: FloatArray) -> FloatArray:
        """Coordinates of parameters, moved inside their range where needed, shape (..., 3)."""
        low, high = self._range
        value = parameters.copy()
        value[..., 1] = np.log(value[..., 1])
        part = np.clip((value - low) / (high - low), 1e-4, 1.0 - 1e-4)
        return np.asarray(np.log(part / (1.0 - part)))


def share(theta: FloatArray) -> FloatArray:
    """Place in the range, 0 to 1, of coordinates of any shape (...)."""
    return np.asarray(0.5 * (1.0 + np.tanh(0.5 * theta)))


class Linear(NamedTuple):
    """Whitened residuals (W, M) and their derivatives by the coordinates (W, M, 3)."""

    residual: FloatArray
    jacobian: FloatArray

    @property
    def fisher(self) -> FloatArray:
        """Fisher information of the coordinates, shape (W, 3, 3)."""
        return np.asarray(np.einsum("wmi,wmj->wij", self.jacobian, self.jacobian))

    @property
    def slope(self) -> FloatArray:
        """Half the gradient of chi-square, shape (W, 3)."""
        return np.asarray(np.einsum("wmi,wm->wi", self.jacobian, self.residual))


class Objective:
    """Chi-square of a visit by wavelength: captures against the fast engine.

    The weights are the inverse of the captures' covariance with the engine's own error added.

    Attributes:
        coordinates: unbounded coordinates of the material.
        solvable: wavelengths with at least as many captures as unknowns, shape (W,).
    """

    def __init__(self, model: BenchModel, intensities: RelativeIntensities, limit: float) -> None:
        model.check(intensities)
        self.model, self.intensities, self.limit = model, intensities, limit
        self.screened: Screened = screen(model, intensities, limit)
        self.engine = engine_of(model)
        used = self.screened.usable & (self.screened.status == Status.OK)[:, None]
        self.used = used.reshape(-1, used.shape[2]).T
        self.solvable: NDArray[np.bool_] = self.used.sum(axis=1) >= UNKNOWNS
        self.coordinates = Coordinates(float(np.mean(intensities.thickness_mm)))
        self.value = self.screened.value.reshape(self.used.shape[1], -1).T
        relative = np.asarray(self.engine.relative_error).ravel()
        self.engine_error = np.hypot(relative * self.value, SMALLEST_ERROR)
        self._whiten = _whitening(self.screened.covariance, self.engine_error, self.used)

    def chi_square(self, theta: FloatArray) -> FloatArray:
        """Weighted sum of squares at coordinates (W, 3), shape (W,)."""
        return np.asarray((self._residual(self._forward(theta)) ** 2).sum(axis=1))

    def linear(self, theta: FloatArray) -> Linear:
        """Whitened residuals and derivatives at coordinates (W, 3), shapes (W, M), (W, M, 3)."""
        at = self.engine.parameters(*self.coordinates.parameters(theta).T)
        value, jacobian = self.engine.forward_and_jacobian(at)
        slope = np.asarray(jacobian).reshape(*self.value.shape, UNKNOWNS)
        slope = slope * self.coordinates.slope(theta)[:, None, :]
        return Linear(
            self._residual(np.asarray(value).reshape(self.value.shape)), self._whiten @ slope
        )

    def start(self) -> FloatArray:
        """The best of a coarse grid around Beer's sigma_t, coordinates of shape (W, 3)."""
        beer, _ = beer_check(self.intensities, self.model)
        positive = np.where(np.isfinite(beer) & (beer > 0.0), beer, 0.0)
        # Strong scattering into the aperture makes Beer's sigma_t too small, never too large.
        base = positive.max(axis=0)
        base = np.where(base > 0.0, base, 3.0 / self.coordinates.thickness_mm)
        best, least = np.zeros((base.size, UNKNOWNS)), np.full(base.size, np.inf)
        for albedo in (0.1, 0.4, 0.7, 0.9, 0.97, 0.995):
            for g in (-0.2, 0.3, 0.6, 0.85):
                for factor in (1.0, 1.3, 3.0):
                    ones = np.ones_like(base)
                    theta = self.coordinates.of(
                        np.stack([albedo * ones, factor * base, g * ones], -1)
                    )
                    chi_square = self.chi_square(theta)
                    better = chi_square < least
                    best[better], least[better] = theta[better], chi_square[better]
        return best

    def result(self, name: str, solved: Solved) -> EstimateResult:
        """What the coordinates at the end mean; see `EstimateResult`."""
        theta = solved.theta
        linear = self.linear(theta)
        fisher = linear.fisher + WEAK * np.eye(UNKNOWNS)
        inverse = np.linalg.inv(fisher)
        slope = linear.slope
        promised = np.einsum("wi,wij,wj->w", slope, inverse, slope)
        chi_square = (linear.residual**2).sum(axis=1)
        freedom = self.used.sum(axis=1) - UNKNOWNS
        torn = (freedom > 0) & (chi_square > _critical(freedom))
        inverse[torn] *= (chi_square / np.maximum(freedom, 1))[torn, None, None]

        scale = self.coordinates.slope(theta)
        spread = np.sqrt(np.diagonal(inverse, axis1=1, axis2=2))
        quantile = self.coordinates.parameters(
            theta + normal_deviate(QUANTILE_LEVELS)[:, None, None] * spread
        )
        width = quantile[NINETY_HIGH] - quantile[NINETY_LOW]
        width[:, 1] = np.log(quantile[NINETY_HIGH, :, 1] / quantile[NINETY_LOW, :, 1])
        identifiable = width <= SHARE * RANGE
        # Noise alone can make darkness look like a sharp sigma_t, and with it albedo and g.
        lost = self._lost()
        identifiable &= ~lost[:, None]
        place = share(theta)

        status = np.full(theta.shape[0], Status.OK, dtype=np.int8)
        status[self.screened.noiseless] = Status.NO_NOISE_STATED
        status[((place < EDGE) | (place > 1.0 - EDGE)).any(axis=1)] = Status.AT_BOUND
        status[~identifiable.all(axis=1)] = Status.NOT_IDENTIFIABLE
        status[torn] = Status.INCONSISTENT
        status[lost] = Status.COLLIMATED_LOST
        status[(promised > SETTLED) | ~solved.settled] = Status.NOT_CONVERGED
        refused = (self.screened.status == Status.CONTRADICTORY).any(axis=0)
        status[~self.solvable] = np.where(refused, Status.CONTRADICTORY, Status.MASKED)[
            ~self.solvable
        ]
        number = self.screened.status.shape[0]
        few = (~self.solvable & (self.used.sum(axis=1) > 0)).sum()
        messages = [f"{few} of {status.size} wavelengths with fewer captures than unknowns"]
        return assembled(
            name,
            self.model,
            self.intensities,
            self.screened,
            parameters=self.coordinates.parameters(theta),
            covariance=scale[:, :, None] * inverse * scale[:, None, :],
            quantile_level=QUANTILE_LEVELS,
            quantile=quantile,
            identifiable=identifiable,
            status=status,
            sample_estimate=np.full((number, status.size, UNKNOWNS), np.nan),
            sample_status=self.screened.status,
            predicted=self._forward(theta).T.reshape(self.screened.value.shape),
            model_error=self.engine_error.T.reshape(self.screened.value.shape),
            settings=solved.settings,
            messages=[*solved.messages, *(messages if few else [])],
            statistics={
                "chi_square": chi_square,
                "degrees_of_freedom": freedom.astype(np.float64),
                "chi_square_still_promised": promised,
                "evaluations": solved.evaluations,
            },
        )

    def _lost(self) -> NDArray[np.bool_]:
        """Whether no sample's collimated capture stands out of the noise, shape (W,)."""
        used = self.used[:, 2::3]
        seen = used & (self.value[:, 2::3] > self.limit * self.screened.sigma[:, 2].T)
        return np.asarray(used.any(axis=1) & ~seen.any(axis=1))

    def _forward(self, theta: FloatArray) -> FloatArray:
        at = self.engine.parameters(*self.coordinates.parameters(theta).T)
        return np.asarray(self.engine.forward(at)).reshape(self.value.shape)

    def _residual(self, predicted: FloatArray) -> FloatArray:
        rest = np.where(self.used, predicted - self.value, 0.0)
        return np.asarray(np.einsum("wij,wj->wi", self._whiten, rest))


@dataclass(frozen=True, eq=False, kw_only=True)
class Solved:
    """Where a solver stopped.

    Attributes:
        theta: coordinates, shape (W, 3).
        settled: whether the solver itself is content, shape (W,).
        evaluations: how often it looked at chi-square, shape (W,).
        settings: its options.
        messages: sentences for the result.
    """

    theta: FloatArray
    settled: NDArray[np.bool_]
    evaluations: FloatArray
    settings: Mapping[str, Setting]
    messages: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Known:
    """What makes two bench models the same to the engine."""

    bench: Bench | None
    samples: tuple[Sample, ...]
    wavelength_nm: tuple[float, ...]
    model: BenchModel = field(compare=False)


def engine_of(model: BenchModel) -> Forward:
    """The engine of a bench, compiled once for the last few benches.

    Raises:
        InputError: as `Forward.of`.
    """
    return _engine(_Known(model.bench, model.samples, tuple(model.wavelength_nm.tolist()), model))


@lru_cache(maxsize=8)
def _engine(known: _Known) -> Forward:
    return Forward.of(known.model)


def _whitening(
    covariance: FloatArray, engine_error: FloatArray, used: NDArray[np.bool_]
) -> FloatArray:
    """Matrices (W, M, M) that turn residuals into independent ones of variance 1."""
    size = used.shape[1]
    both = used[:, :, None] & used[:, None, :]
    whole = np.where(both, covariance, 0.0)
    diagonal = np.arange(size)
    whole[:, diagonal, diagonal] += np.where(used, engine_error, 1.0) ** 2
    # Whitened by its own standard errors first: captures differ by orders of magnitude.
    scale = np.sqrt(whole[:, diagonal, diagonal])
    value, vector = np.linalg.eigh(whole / (scale[:, :, None] * scale[:, None, :]))
    root = 1.0 / np.sqrt(np.maximum(value, 1e-10))
    whiten = root[:, :, None] * vector.transpose(0, 2, 1) / scale[:, None, :]
    return np.asarray(np.where(used[:, None, :], whiten, 0.0))


def _critical(freedom: NDArray[np.int_]) -> FloatArray:
    from scipy.stats import chi2

    return np.asarray(chi2.isf(TORN, np.maximum(freedom, 1)))
