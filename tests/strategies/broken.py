"""Deliberately broken estimators: Kubelka-Munk with one planted mistake each.

In the world of `tests.strategies.worlds.two_fluxes` the estimator itself is exact, so that what
is found is what was planted.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from estimators import BenchModel, EstimateResult, Status
from estimators.kubelka_munk import KubelkaMunkEstimator
from twin.measurement.relative import RelativeIntensities
from twin.spectra import FloatArray


class Broken:
    """A sound estimator between a change of its input and one of its output."""

    name = "broken"
    found_by: tuple[str, ...] = ()
    """Properties of which each one must find the mistake."""

    def __init__(self, model: BenchModel) -> None:
        self.model = model

    def estimate(self, intensities: RelativeIntensities) -> EstimateResult:
        given = self.before(intensities)
        return self.after(KubelkaMunkEstimator(self.model).estimate(given), intensities)

    def before(self, given: RelativeIntensities) -> RelativeIntensities:
        return given

    def after(self, result: EstimateResult, given: RelativeIntensities) -> EstimateResult:
        return result


def stretched(result: EstimateResult, factor: float | FloatArray) -> EstimateResult:
    """Intervals times a factor around their median."""
    middle = result.quantile[5]
    return replace(
        result,
        covariance=result.covariance * np.asarray(factor) ** 2,
        quantile=middle + (result.quantile - middle) * factor,
    )


class PerCentimetre(Broken):
    found_by = ("no_confident_wrong_answer", "intervals_cover")

    def after(self, result: EstimateResult, given: RelativeIntensities) -> EstimateResult:
        unit = np.array([1.0, 10.0, 1.0])
        return replace(
            result,
            sigma_t_per_mm=10.0 * result.sigma_t_per_mm,
            covariance=result.covariance * unit * unit[:, None],
            quantile=result.quantile * unit,
        )


class SwapsBlackAndWhite(Broken):
    found_by = ("says_when_contradictory", "intervals_cover")

    def before(self, given: RelativeIntensities) -> RelativeIntensities:
        return replace(given, value=given.value[:, [1, 0, 2]])


class IgnoresTheLastSample(Broken):
    found_by = ("order_of_samples",)

    def before(self, given: RelativeIntensities) -> RelativeIntensities:
        valid = given.valid.copy()
        valid[1:] = False
        return replace(given, valid=valid)


class HalvesItsIntervals(Broken):
    found_by = ("intervals_cover",)

    def after(self, result: EstimateResult, given: RelativeIntensities) -> EstimateResult:
        return stretched(result, 0.5)


class StandardDeviationForStandardError(Broken):
    found_by = ("intervals_cover",)

    def after(self, result: EstimateResult, given: RelativeIntensities) -> EstimateResult:
        return stretched(result, np.sqrt(given.repeats))


class FillsInOneHalf(Broken):
    found_by = ("says_when_masked", "says_when_not_a_number")

    def after(self, result: EstimateResult, given: RelativeIntensities) -> EstimateResult:
        holes = np.isnan(result.parameters)
        return replace(
            result,
            albedo=np.where(holes[:, 0], 0.5, result.albedo),
            sigma_t_per_mm=np.where(holes[:, 1], 0.5, result.sigma_t_per_mm),
            g=np.where(holes[:, 2], 0.5, result.g),
            status=np.zeros_like(result.status),
        )


class SortsThicknessesAlone(Broken):
    found_by = ("order_of_samples",)

    def before(self, given: RelativeIntensities) -> RelativeIntensities:
        return replace(given, thickness_mm=np.sort(given.thickness_mm))


class IgnoresTheMask(Broken):
    found_by = ("masked_values_do_not_matter",)

    def before(self, given: RelativeIntensities) -> RelativeIntensities:
        return replace(given, valid=np.isfinite(given.value))


class TakesEverySampleForOneMillimetre(Broken):
    found_by = ("scale_equivariant", "says_when_thickness_is_missing")

    def before(self, given: RelativeIntensities) -> RelativeIntensities:
        return replace(given, thickness_mm=np.ones_like(given.thickness_mm))


class AddsTheGlassesToTheThickness(Broken):
    found_by = ("no_confident_wrong_answer",)

    def before(self, given: RelativeIntensities) -> RelativeIntensities:
        return replace(given, thickness_mm=given.thickness_mm + 0.3)


class ClipsTheAlbedo(Broken):
    found_by = ("no_confident_wrong_answer", "intervals_cover")

    def after(self, result: EstimateResult, given: RelativeIntensities) -> EstimateResult:
        quantile = result.quantile.copy()
        quantile[..., 0] = np.minimum(quantile[..., 0], 0.6)
        return replace(result, albedo=np.minimum(result.albedo, 0.6), quantile=quantile)


class ClipsTheTransmittance(Broken):
    found_by = ("says_when_transmittance_above_one",)

    def before(self, given: RelativeIntensities) -> RelativeIntensities:
        value = given.value.copy()
        value[:, 2] = np.minimum(value[:, 2], 0.9)
        return replace(given, value=value)


class RaisesAtNaN(Broken):
    found_by = ("says_when_not_a_number",)

    def before(self, given: RelativeIntensities) -> RelativeIntensities:
        if not np.isfinite(given.value).all():
            raise FloatingPointError("found NaN")
        return given


class DrawsWithoutSeed(Broken):
    found_by = ("repeatable",)
    calls = 0

    def after(self, result: EstimateResult, given: RelativeIntensities) -> EstimateResult:
        DrawsWithoutSeed.calls += 1
        return replace(result, albedo=result.albedo + 1e-4 * DrawsWithoutSeed.calls)


class HidesThatNoNoiseWasStated(Broken):
    found_by = ("says_when_no_noise_is_stated",)

    def after(self, result: EstimateResult, given: RelativeIntensities) -> EstimateResult:
        hidden = result.status == Status.NO_NOISE_STATED
        return replace(result, status=np.where(hidden, Status.OK, result.status).astype(np.int8))


class AddsRepeatsUp(Broken):
    found_by = ("averages_never_widen",)

    def after(self, result: EstimateResult, given: RelativeIntensities) -> EstimateResult:
        return stretched(result, float(given.repeats))


class BelievesTheWhiteBehindOpaqueSamples(Broken):
    found_by = ("opaque_ignores_background",)

    def after(self, result: EstimateResult, given: RelativeIntensities) -> EstimateResult:
        blind = np.isnan(result.albedo) & np.isfinite(given.value).all(axis=(0, 1))
        count = blind.size
        covariance = np.where(blind[:, None, None], 1e-4 * np.eye(3), result.covariance)
        identifiable = result.identifiable.copy()
        identifiable[:, 0] |= blind
        return replace(
            result,
            albedo=np.where(blind, self.model.rho_white, result.albedo),
            covariance=covariance,
            identifiable=identifiable,
            status=np.where(blind, Status.OK, result.status).astype(np.int8).reshape(count),
        )


class OneBadWavelengthSpoilsAll(Broken):
    found_by = ("says_when_masked",)

    def after(self, result: EstimateResult, given: RelativeIntensities) -> EstimateResult:
        if given.valid.all():
            return result
        status = np.full_like(result.status, Status.MASKED)
        nothing = np.full_like(result.albedo, np.nan)
        return replace(result, status=status, albedo=nothing, sigma_t_per_mm=nothing, g=nothing)


class HidesThatSamplesDisagree(Broken):
    found_by = ("says_when_misled",)

    def after(self, result: EstimateResult, given: RelativeIntensities) -> EstimateResult:
        torn = result.status == Status.INCONSISTENT
        widened = np.where(torn, result.statistics["disagreement_sigma"], 1.0)[:, None, None]
        return replace(
            result,
            covariance=result.covariance / widened**2,
            identifiable=result.identifiable | torn[:, None],
            status=np.where(torn, Status.OK, result.status).astype(np.int8),
        )


ALL_BROKEN = tuple(Broken.__subclasses__())
