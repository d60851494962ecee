"""Posterior of (albedo, sigma_t, g) by ensemble sampling, nuisances marginalised."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from estimators.beer import beer_check
from estimators.posterior_coordinates import Coordinates, coarse
from estimators.posterior_data import Data
from estimators.posterior_engine import Engine
from estimators.posterior_joint import sample_jointly
from estimators.posterior_local import Local, Whitened, sample_locally
from estimators.posterior_mode import Mode, find_mode, starts, whiteners
from estimators.posterior_result import Findings, assembled, blank
from estimators.posterior_settings import PosteriorSettings
from estimators.protocol import BenchModel
from estimators.result import EstimateResult, Status
from twin.measurement.relative import RelativeIntensities
from twin.spectra import FloatArray

TORN = 0.001
"""Probability of a chi-square by chance below which captures are called inconsistent."""


class PosteriorEstimator:
    """Draws from the posterior of the material given all captures of all samples.

    The likelihood is Gaussian with the captures' covariance, the fast engine's own error and the
    stated nuisances. Nuisances enter linearly around the most probable material, so that their
    integral is the Gaussian with covariance C + sum_i p_i^2 (dF/dv_i)(dF/dv_i)^T, the
    derivatives taken there. Sampled with emcee (Foreman-Mackey et al. 2013) on an emulator of
    the engine whose error is measured at draws of the chain.
    """

    name = "posterior"

    def __init__(self, model: BenchModel, settings: PosteriorSettings | None = None) -> None:
        self.model = model
        self.settings = settings or PosteriorSettings()
        self._engine: Engine | None = None

    def estimate(self, intensities: RelativeIntensities) -> EstimateResult:
        """Sample the posterior; see `estimators.protocol.Estimator`.

        Raises:
            InputError: intensities of another bench, a bench that the fast engine cannot show,
                or an uncertain refractive index of exactly 1.
        """
        model, settings = self.model, self.settings
        model.check(intensities)
        settings.check(model)
        data = Data.of(intensities, settings)
        beer = beer_check(intensities, model)
        before = data.status()
        usable = np.flatnonzero(before < Status.CONTRADICTORY)
        if not usable.size:
            return blank(model, settings, intensities, data, beer)
        engine = self._engine_for(usable)
        coordinates = Coordinates.of(settings)
        here = _Wavelengths(engine, coordinates, settings, data, usable)
        mode = here.first_mode(_first_sigma_t(beer[0], settings)[usable])
        covariance, bare, mode, torn = here.noise(mode)
        alone = here.alone(mode, covariance)
        if settings.joint:
            local, messages, torn = sample_jointly(
                engine, coordinates, settings, here.whitened(bare), mode, here.relative_error
            )
        else:
            messages = ()
            sampled = settings.sample_nuisances and bool(settings.stated())
            local = sample_locally(
                engine,
                coordinates,
                settings,
                here.whitened(covariance),
                mode,
                here.whitened(bare) if sampled else None,
            )
        found = Findings(usable, local, mode, covariance, alone, torn, messages)
        return assembled(model, settings, intensities, data, beer, engine, coordinates, found)

    def _engine_for(self, usable: NDArray[np.intp]) -> Engine:
        wanted = tuple(int(w) for w in usable)
        if self._engine is None or self._engine.wanted != wanted:
            self._engine = Engine(self.model, wanted)
        return self._engine


class _Wavelengths:
    """The usable wavelengths' captures and how the noise of each is put together."""

    def __init__(
        self,
        engine: Engine,
        coordinates: Coordinates,
        settings: PosteriorSettings,
        data: Data,
        usable: NDArray[np.intp],
    ) -> None:
        self.engine, self.coordinates, self.settings = engine, coordinates, settings
        self.data = replace(
            data,
            value=data.value[usable],
            covariance=data.covariance[usable],
            valid=data.valid[usable],
            noiseless=data.noiseless[usable],
        )
        error = engine.forward.relative_error
        self.relative_error = error if settings.engine_error else np.zeros_like(error)

    def first_mode(self, sigma_t: FloatArray) -> Mode:
        """The most probable materials with the noise of the measured captures alone."""
        value = self.data.value
        covariance = self.data.with_error(value, self.engine.forward.relative_error)
        white = whiteners(covariance, self.data.valid)
        begin = starts(self.engine, self.coordinates, value, white, sigma_t)
        return find_mode(self.engine, self.coordinates, value, white, begin)

    def noise(self, mode: Mode) -> tuple[FloatArray, FloatArray, Mode, NDArray[np.bool_]]:
        """Covariance with and without nuisances (W, M, M), the mode by it, and where it is torn.

        Captures that no material explains (chi-square beyond chance) have their covariance
        widened by chi-square over its degrees of freedom (Birge 1932).
        """
        from scipy.special import chdtri

        x = coarse(mode.x, 20)
        material = self.coordinates.material(x)
        captures = self.engine.at(material[None])[0]
        # Common errors of the engine are nuisances of joint spectra, noise of single ones.
        error = self.relative_error * (0.0 if self.settings.joint else 1.0)
        bare = self.data.with_error(captures, error)
        slopes = self.engine.nuisance_slopes(material[None], self.settings)[0]
        total = bare + slopes @ slopes.transpose(0, 2, 1)
        if self.settings.joint:
            own = self.relative_error.reshape(-1) * captures
            total = total + own[:, :, None] ** 2 * np.eye(own.shape[1])
        again = self._mode(total, x)
        freedom = np.maximum(self.data.valid.sum(axis=1) - 3, 1)
        torn = again.chi_square > chdtri(freedom, TORN)
        factor = coarse(np.where(torn, again.chi_square / freedom, 1.0))
        total = total * factor[:, None, None]
        bare = bare * factor[:, None, None]
        if torn.any():
            again = self._mode(total, again.x)
        return total, bare, again, torn

    def _mode(self, covariance: FloatArray, x: FloatArray) -> Mode:
        white = whiteners(covariance, self.data.valid)
        return find_mode(self.engine, self.coordinates, self.data.value, white, x[None])

    def alone(self, mode: Mode, covariance: FloatArray) -> FloatArray:
        """The most probable material of every sample by itself, shape (S, W, 3)."""
        found = []
        for s in range(self.engine.samples):
            own = np.zeros_like(self.data.valid)
            own[:, 3 * s : 3 * s + 3] = self.data.valid[:, 3 * s : 3 * s + 3]
            if np.array_equal(own, self.data.valid):
                found.append(self.coordinates.material(mode.x))
                continue
            white = whiteners(covariance, own)
            best = find_mode(self.engine, self.coordinates, self.data.value, white, mode.x[None])
            material = self.coordinates.material(best.x)
            material[own.sum(axis=1) < 3] = np.nan
            found.append(material)
        return np.stack(found)

    def whitened(self, covariance: FloatArray) -> Whitened:
        """The captures in units of their noise."""
        white = whiteners(covariance, self.data.valid)
        return Whitened(white, np.einsum("wij,wj->wi", white, self.data.value))


def _first_sigma_t(beer: FloatArray, settings: PosteriorSettings) -> FloatArray:
    """Guess [1/mm] from Beer's law, (S, W) to (W,); the middle of the prior where it has none."""
    low, high = settings.sigma_t_low_per_mm, settings.sigma_t_high_per_mm
    known = np.isfinite(beer) & (beer > 0.0)
    total = np.where(known, beer, 0.0).sum(axis=0)
    number = known.sum(axis=0)
    guess = np.where(number > 0, total / np.maximum(number, 1), np.sqrt(low * high))
    return np.asarray(np.clip(guess, 1.1 * low, 0.9 * high))


__all__ = ["Local", "PosteriorEstimator", "PosteriorSettings"]
