"""The estimator `donaldson`: fluorophores as smooth products over a smooth Gaussian background."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field

import numpy as np

from estimators.fluorescence.background import BackgroundPrior, Reduced, reduce
from estimators.fluorescence.cells import Captures, checked, fingerprint, gather, groups
from estimators.fluorescence.fit import Fit
from estimators.fluorescence.posterior_draws import (
    UNDETERMINED,
    draws,
    hidden,
    means,
    misshapen,
    remaining_variance,
    weights,
)
from estimators.fluorescence.products import Products, ShapePrior
from estimators.fluorescence.result import LEVELS, BoolArray, FluorescenceResult, FluorescenceStatus
from estimators.fluorescence.search import candidates
from twin.errors import InputError
from twin.fluorescence.system import FluorescenceData
from twin.spectra import FloatArray

HIDDEN, VEILED = 0.6, 0.1
"""Amplitude, over `ALONE`, of fluorescence that may hide in undetermined and in all other cells;
the captures take it away where they see it. From the coverage on generated matrices."""
SMOOTHER = 0.7
"""Roughness where there are products, over the one that the evidence chose without any: the edges
of products count as roughness then. From error and coverage on generated matrices."""


@dataclass(frozen=True, kw_only=True)
class DonaldsonSettings:
    """Options of the estimator `donaldson`."""

    products: int = 2
    """Most fluorophores; 0: the smooth background alone, linear and quick."""
    amplitudes: tuple[float, ...] = (6e-3, 2e-3, 5e-4)
    """Standard deviations of cells that no product explains, coarse to fine."""
    steps: int = 15
    """Most solver steps per candidate."""
    directions: int = 200
    """Directions of the captures that are kept."""
    draws: int = 200
    """Posterior draws; 0: none, and no intervals."""
    seed: int = 1
    shapes: ShapePrior = field(default_factory=ShapePrior)
    background: BackgroundPrior = field(default_factory=BackgroundPrior)

    def __post_init__(self) -> None:
        for name, low, high in (
            ("products", 0, 4), ("steps", 1, 1000), ("directions", 1, 10000),
            ("draws", 0, 100000), ("seed", 0, 2**63),
        ):  # fmt: skip
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
                raise InputError(f"{value!r}", f"an integer of {low} to {high}", place=name)
        if not self.amplitudes or min(self.amplitudes) <= 0.0:
            raise InputError(f"{self.amplitudes}", "one or more above 0", place="amplitudes")


class DonaldsonEstimator:
    """Donaldson matrices by products of peaks, a Gaussian background, and evidence.

    Every fluorophore is an emission times an excitation spectrum (positive, peaked, otherwise
    free), the reflectance and what products cannot explain are Gaussian processes that are
    marginalised in closed form; candidates with 0 to `products` fluorophores and backgrounds of
    several strengths are weighed by their evidence. Intervals come from draws.
    """

    def __init__(self, settings: DonaldsonSettings | None = None) -> None:
        self._settings = settings or DonaldsonSettings()

    @property
    def name(self) -> str:
        """Name in the registry and in reports."""
        return "donaldson"

    def estimate(self, data: FluorescenceData) -> FluorescenceResult:
        """Estimate one matrix.

        Raises:
            InputError: captures that cannot be used.
        """
        return self.estimate_batch([data])[0]

    def estimate_batch(self, data: list[FluorescenceData]) -> list[FluorescenceResult]:
        """Estimate several; those of one set-up with the same valid captures share their work.

        Raises:
            InputError: captures that cannot be used.
        """
        for one in data:
            checked(one)
        found: dict[int, FluorescenceResult] = {}
        for group in groups(data):
            members = [data[index] for index in group]
            found.update(zip(group, self._group(members), strict=True))
        return [found[index] for index in range(len(data))]

    def _group(self, data: list[FluorescenceData]) -> list[FluorescenceResult]:
        settings = self._settings
        captures = gather(data)
        reduced = reduce(captures, settings.background, settings.directions)
        if settings.products:
            reduced = reduced.but(roughness=SMOOTHER * reduced.roughness)
        model = Products(reduced.design, captures.cells, settings.shapes, reduced.diagonal_design)
        fits = candidates(reduced, model, settings.amplitudes, settings.steps, settings.products)
        weight = weights(fits)
        matrix = means(model, fits, weight)
        remaining = remaining_variance(reduced)
        dark = captures.system.blind()[captures.cells.below_diagonal]
        unseen = (remaining > UNDETERMINED) | dark
        least = np.sqrt(np.maximum(1.0, UNDETERMINED / np.maximum(remaining, 1e-6)))
        least = np.where(unseen, HIDDEN * least, VEILED)
        prior = reduced.kernels.draws(max(settings.draws, 1), settings.seed)
        widened = hidden(reduced, prior, least)
        results = []
        for index, one in enumerate(data):
            drawn = None
            if settings.draws:
                estimate = matrix[index][captures.cells.below_diagonal]
                unshown = widened
                if settings.products:
                    unshown = widened + misshapen(reduced, prior, index, estimate, remaining)
                drawn = draws(
                    model, fits, weight, index, settings.draws, prior,
                    settings.seed + 1, unshown,
                )  # fmt: skip
            results.append(
                self._result(one, captures, reduced, fits, weight, index, matrix, drawn, unseen)
            )
        return results

    def _result(
        self, data: FluorescenceData, captures: Captures, reduced: Reduced, fits: list[Fit],
        weight: FloatArray, index: int, matrices: FloatArray, drawn: FloatArray | None,
        unseen: BoolArray,
    ) -> FluorescenceResult:  # fmt: skip
        cells, matrix = captures.cells, matrices[index]
        best = fits[int(weight[:, index].argmax())]
        freedom = reduced.value.shape[1]
        excess = float(best.chi_square[index]) / freedom
        inconsistent = best.chi_square[index] > freedom + 5.0 * np.sqrt(2.0 * freedom)
        messages = list(data.reasons)
        if drawn is not None and inconsistent:
            drawn = matrix + (drawn - matrix) * np.sqrt(excess)
            drawn[:, cells.below_diagonal] = np.maximum(drawn[:, cells.below_diagonal], 0.0)
            messages.append(f"intervals widened by {np.sqrt(excess):.3g}")
        undetermined = np.zeros(matrix.shape, dtype=bool)
        undetermined[cells.below_diagonal] = unseen
        undetermined |= captures.system.blind()
        if undetermined.any():
            messages.append(_where(undetermined, cells.emission_nm, cells.excitation_nm))
        predicted = captures.design.reshape(len(captures.design), -1) @ matrix.reshape(-1)
        residual = predicted - captures.value[index]
        sigma = np.sqrt(np.diagonal(captures.covariance[index]))
        if drawn is None:
            deviation = np.full(matrix.shape, np.nan)
            quantile = np.full((LEVELS.size, *matrix.shape), np.nan)
        else:
            deviation = drawn.std(axis=0)
            quantile = np.quantile(drawn, LEVELS, axis=0)
        return FluorescenceResult(
            estimator=self.name, sample=data.sample,
            emission_nm=cells.emission_nm, excitation_nm=cells.excitation_nm,
            matrix=matrix, standard_deviation=deviation,
            quantile_level=LEVELS, quantile=quantile, undetermined=undetermined,
            status=self._status(data, captures, index, bool(inconsistent), undetermined, quantile,
                                bool(best.converged[index])),
            residual=captures.full(residual), residual_normalised=captures.full(residual / sigma),
            settings=_plain(self._settings),
            fingerprint=fingerprint(data, self.name, asdict(self._settings)),
            messages=tuple(messages),
            statistics={
                "chi_square": float(best.chi_square[index]), "directions": float(freedom),
                "products": float(sum(w * f.products for w, f in
                                      zip(weight[:, index], fits, strict=True))),
                "background_amplitude": float(best.amplitude),
                "roughness": float(reduced.roughness[index]),
                "log_evidence": float(best.log_evidence[index]),
            },
            draws=drawn,
        )  # fmt: skip

    @staticmethod
    def _status(
        data: FluorescenceData, captures: Captures, index: int, inconsistent: bool,
        undetermined: FloatArray, quantile: FloatArray, converged: bool,
    ) -> FluorescenceStatus:  # fmt: skip
        if not converged:
            return FluorescenceStatus.NOT_CONVERGED
        if inconsistent:
            return FluorescenceStatus.INCONSISTENT
        if not data.valid.all():
            return FluorescenceStatus.MASKED
        if np.any(undetermined):
            return FluorescenceStatus.UNDETERMINED_CELLS
        if captures.assumed[index]:
            return FluorescenceStatus.NO_NOISE_STATED
        low = quantile[0][captures.cells.below_diagonal]
        if np.isfinite(low).all() and not np.any(low > 1e-4):
            return FluorescenceStatus.NO_FLUORESCENCE_SEEN
        return FluorescenceStatus.OK


def _where(flagged: FloatArray, emission: FloatArray, excitation: FloatArray) -> str:
    rows, columns = np.nonzero(flagged)
    return (
        f"{rows.size} undetermined cells, emission {emission[rows.min()]:g} to"
        f" {emission[rows.max()]:g} nm, excitation {excitation[columns.min()]:g} to"
        f" {excitation[columns.max()]:g} nm"
    )


def _plain(settings: DonaldsonSettings) -> dict[str, str | int | float]:
    kinds = (str, int, float)
    return {k: v if isinstance(v, kinds) else str(v) for k, v in asdict(settings).items()}
