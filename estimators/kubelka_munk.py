"""The closed form of Kubelka and Munk from two backgrounds, with Beer's law beside it.

A diffuse-flux theory: two fluxes, upwards and downwards, each perfectly diffuse everywhere.
Sources: Kubelka & Munk (1931), "Ein Beitrag zur Optik der Farbanstriche", Z. tech. Phys. 12,
593-601; Kubelka (1948), J. Opt. Soc. Am. 38, 448-457; Saunderson (1942), J. Opt. Soc. Am. 32,
727-736; van Gemert & Star (1987), Lasers Life Sci. 1, 287-298.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.kubelka_munk_theory import (
    Faces,
    Fluxes,
    coefficients,
    faces_of,
    layer_fluxes,
    layer_reflectance,
)
from estimators.protocol import BenchModel
from estimators.result import QUANTILE_LEVELS, EstimateResult, Status, gaussian_quantiles
from estimators.screening import Screened, assembled, identified, screen
from twin.errors import InputError
from twin.measurement.relative import RelativeIntensities
from twin.optics import Windows, sigma_t_from_transmittance, stack_transmittance
from twin.spectra import FloatArray

VALID = (
    "kubelka-munk is valid for thick, weakly absorbing samples in diffuse light; this bench lights"
    " at 45 degrees and looks at 0: expect albedo wrong by some 0.05, by some 0.005 where it is"
    " above 0.85 in an optical depth above 2, and g as a rough guess at best; the stated"
    " uncertainty holds the noise alone"
)
SMALLEST = 1e-9
"""Standard error that is added to every capture when samples are weighted, so that captures
without stated noise can be weighted at all."""


@dataclass(frozen=True)
class KubelkaMunkSettings:
    """Options of the Kubelka-Munk estimator."""

    saunderson: bool = True
    """Take the reflections of the faces off (Saunderson 1942); False: as if n were 1."""
    lost_sigma: float = 3.0
    """Light below so many standard errors is lost in noise; captures that contradict each other
    by more are contradictory."""
    inconsistent_sigma: float = 4.0
    """Samples that disagree by more standard errors are called inconsistent."""

    def __post_init__(self) -> None:
        """Reject what cannot be meant.

        Raises:
            InputError: an option out of its range.
        """
        for name in ("lost_sigma", "inconsistent_sigma"):
            if not getattr(self, name) > 0.0:
                raise InputError(f"{getattr(self, name):g}", "a number above 0", place=name)


class KubelkaMunkEstimator:
    """K and S from I_black and I_white, sigma_t from I_collimated, for every sample.

    Steps: Saunderson's correction I = enter * leave * R / (1 - k2 R), without the specular term,
    which misses the detector; backgrounds as they are seen through the lower face; K and S by
    Kubelka (1948); sigma_t by Beer's law; then K = 2 sigma_a and S = 3/4 sigma_s (1 - g) -
    1/4 sigma_a (van Gemert & Star 1987). The covariance is that of the captures through the
    numerical Jacobian of these closed forms; samples are combined by the inverse of
    their variances.

    Valid for thick, weakly absorbing samples in diffuse light. It breaks down at 45/0 (light is
    not diffuse near the face, and the glance at 0 degrees sees less internal reflection than
    k2), for albedo below about 0.5 (fluxes are not diffuse), for optical depths below about 2,
    and where in-scattered light hides in the collimated capture. The stated uncertainty holds
    the noise, not these errors; samples that disagree show them (INCONSISTENT).
    """

    name = "kubelka-munk"

    def __init__(self, model: BenchModel, settings: KubelkaMunkSettings | None = None) -> None:
        self.model = model
        self.settings = settings or KubelkaMunkSettings()

    def estimate(self, intensities: RelativeIntensities) -> EstimateResult:
        """Estimate the material; see `estimators.protocol.Estimator`."""
        model, options = self.model, self.settings
        model.check(intensities)
        thickness = np.asarray(intensities.thickness_mm, dtype=np.float64)
        screened = screen(model, intensities, options.lost_sigma)
        samples, _, count = screened.value.shape
        faces = [self._faces(s) for s in range(samples)]
        clear = [model.windows(s) for s in range(samples)]
        alone = np.empty((samples, count, 3))
        slopes = np.empty((samples, count, 3, 3))
        for s in range(samples):
            alone[s] = self._closed_form(screened.value[s], thickness[s], clear[s], faces[s])
            slopes[s] = self._jacobian(screened.value[s], thickness[s], clear[s], faces[s])
        sample_status = self._sample_status(screened, alone, slopes)
        alone[sample_status >= Status.NOT_IDENTIFIABLE] = np.nan

        parameters, covariance, scatter = _combined(
            alone, slopes, screened.covariance, sample_status == Status.OK
        )
        torn = scatter > options.inconsistent_sigma
        covariance[torn] *= scatter[torn, None, None] ** 2
        error = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
        identifiable = identified(parameters, error)
        status = sample_status.min(axis=0).astype(np.int8)
        status[(status == Status.OK) & screened.noiseless] = Status.NO_NOISE_STATED
        low, high = np.array([0.0, 0.0, -1.0]), np.array([1.0, np.inf, 1.0])
        with np.errstate(invalid="ignore"):
            beyond = ((parameters < low) | (parameters > high)) & np.isfinite(parameters)
            far = np.maximum(low - parameters, parameters - high) > options.lost_sigma * error
        good = status < Status.AT_BOUND
        status[good & beyond.any(axis=1)] = Status.AT_BOUND
        vague = ~(identifiable | (beyond & far)).all(axis=1)
        status[(status <= Status.AT_BOUND) & vague] = Status.NOT_IDENTIFIABLE
        identifiable &= ~(beyond & far)
        status[torn & (status < Status.INCONSISTENT)] = Status.INCONSISTENT
        messages = [VALID]
        if np.any(beyond & far):
            messages.append(
                f"{int((beyond & far).any(axis=1).sum())} of {count} wavelengths with an albedo or"
                " g that no material has: the theory does not hold there"
            )
        return assembled(
            self.name,
            model,
            intensities,
            screened,
            parameters=parameters,
            covariance=covariance,
            quantile_level=QUANTILE_LEVELS,
            quantile=gaussian_quantiles(parameters, error),
            identifiable=identifiable,
            status=status,
            sample_estimate=alone,
            sample_status=sample_status,
            predicted=self._predicted(parameters, thickness, clear, faces),
            model_error=np.zeros_like(screened.value),
            settings=asdict(options),
            messages=messages,
            statistics=_statistics(parameters, scatter),
        )

    def _faces(self, sample: int) -> Faces:
        if self.settings.saunderson:
            return faces_of(self.model, sample)
        nothing = np.zeros(self.model.wavelength_nm.size)
        return Faces(nothing + 1.0, nothing + 1.0, nothing, nothing, nothing)

    def _grounds(self, faces: Faces) -> FloatArray:
        """Backgrounds as the layer sees them through its lower face, shape (2, W)."""
        rho = np.stack([self.model.rho_black, self.model.rho_white])
        outside, inside = faces.below_outside, faces.below_inside
        return np.asarray(inside + (1 - inside) * (1 - outside) * rho / (1 - outside * rho))

    def _closed_form(
        self, value: FloatArray, thickness: float, clear: Windows, faces: Faces
    ) -> FloatArray:
        """Albedo, sigma_t [1/mm] and g, (W, 3), from black, white and collimated, (3, W)."""
        passed = faces.enter * faces.leave
        within = value[:2] / (passed + faces.above_inside * value[:2])
        fluxes = layer_fluxes(within, self._grounds(faces))
        sigma_t, _ = sigma_t_from_transmittance(value[2], thickness, clear)
        sigma_a = 0.5 * fluxes.absorbed / thickness
        with np.errstate(divide="ignore", invalid="ignore"):
            reduced = (fluxes.scattered / thickness + 0.25 * sigma_a) / 0.75
            return np.stack([1 - sigma_a / sigma_t, sigma_t, 1 - reduced / (sigma_t - sigma_a)], -1)

    def _jacobian(
        self, value: FloatArray, thickness: float, clear: Windows, faces: Faces
    ) -> FloatArray:
        """Derivatives of the closed form by the captures, (W, 3 parameters, 3 captures)."""
        slope = np.empty((value.shape[1], 3, 3))
        for capture in range(3):
            step = np.zeros_like(value)
            step[capture] = 1e-5 * np.maximum(np.abs(value[capture]), 1e-3)
            with np.errstate(invalid="ignore"):
                change = self._closed_form(value + step, thickness, clear, faces)
                change -= self._closed_form(value - step, thickness, clear, faces)
            slope[..., capture] = change / (2.0 * step[capture])[:, None]
        return slope

    def _sample_status(
        self, screened: Screened, alone: FloatArray, slopes: FloatArray
    ) -> NDArray[np.int8]:
        """What became of every sample, shape (S, W)."""
        limit, noise, value = self.settings.lost_sigma, screened.sigma, screened.value
        status = screened.status.copy()
        status[(status == Status.OK) & ~screened.usable.all(axis=1)] = Status.MASKED
        good = status == Status.OK
        spread = np.hypot(noise[:, 0], noise[:, 1])
        opaque = np.abs(value[:, 1] - value[:, 0]) <= limit * spread
        blind = ~np.isfinite(alone).all(axis=2) | ~np.isfinite(slopes).all(axis=(2, 3))
        status[good & (opaque | blind)] = Status.NOT_IDENTIFIABLE
        lost = (value[:, 2] <= limit * noise[:, 2]) | (value[:, 2] <= 0.0)
        status[good & lost] = Status.COLLIMATED_LOST
        return status

    def _predicted(
        self,
        parameters: FloatArray,
        thickness: FloatArray,
        clear: list[Windows],
        faces: list[Faces],
    ) -> FloatArray:
        """Captures of a material (W, 3) by the theory, shape (S, 3, W)."""
        coefficient = coefficients(parameters)
        captures = []
        for s, height in enumerate(thickness):
            around = faces[s]
            with np.errstate(invalid="ignore", over="ignore"):
                inner = layer_reflectance(
                    Fluxes(coefficient.absorbed * height, coefficient.scattered * height),
                    self._grounds(around),
                )
                through = np.exp(-parameters[:, 1] * height)
            outer = around.enter * around.leave * inner / (1 - around.above_inside * inner)
            beam = stack_transmittance(through, clear[s])
            captures.append(np.concatenate([outer, beam[None]]))
        return np.stack(captures)


def _statistics(parameters: FloatArray, scatter: FloatArray) -> dict[str, FloatArray]:
    k, s = coefficients(parameters)
    with np.errstate(divide="ignore", invalid="ignore"):
        infinite = s / (k + s + np.sqrt(k * (k + 2.0 * s)))
    return {
        "kubelka_munk_k_per_mm": k,
        "kubelka_munk_s_per_mm": s,
        "reflectance_infinite": infinite,
        "disagreement_sigma": scatter,
    }


def _combined(
    alone: FloatArray, slopes: FloatArray, noise: FloatArray, used: NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Samples put together, every parameter by the inverse of its variances.

    Generalised least squares would use the correlations of the parameters too; where the theory
    fails and samples disagree, that drags the mean far outside of what any sample says.

    Args:
        alone: estimates of the samples, shape (S, W, 3).
        slopes: their derivatives by the captures, shape (S, W, 3, 3).
        noise: covariance of the captures, shape (W, 3S, 3S).
        used: which samples count, shape (S, W).

    Returns:
        Estimates (W, 3), covariance (W, 3, 3), largest disagreement of two parameters in
        standard errors (W,), which is 0 where one sample decides alone.
    """
    samples, count = used.shape
    counts = used[..., None]
    alone, slopes = np.where(counts, alone, 0.0), np.where(counts[..., None], slopes, 0.0)
    own = noise.reshape(count, samples, 3, samples, 3)
    spread = np.einsum("swic,wsctd,twjd->wsitj", slopes, own, slopes, optimize=True)
    floor = SMALLEST**2 * (slopes**2).sum(axis=3)
    variance = np.einsum("wsisi->swi", spread)
    with np.errstate(divide="ignore", invalid="ignore"):
        weight = np.asarray(np.where(counts, 1.0 / (variance + floor), 0.0))
        weight = weight / weight.sum(axis=0)
    mean = np.where(np.asarray(used.any(axis=0))[:, None], (weight * alone).sum(axis=0), np.nan)
    covariance = np.einsum("swi,wsitj,twj->wij", weight, spread, weight, optimize=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        pull = np.abs(alone - mean) / np.sqrt(variance)
    pull = np.where(counts & (variance > 0.0), pull, 0.0).max(axis=(0, 2))
    return mean, covariance, np.asarray(np.where(used.sum(axis=0) > 1, pull, 0.0))
