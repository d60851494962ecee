"""Least squares with the fast engine: all captures of all samples, wavelength by wavelength."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

import numpy as np

from estimators.beer import beer_check
from estimators.least_squares_coordinates import Coordinates
from estimators.least_squares_settings import LeastSquaresSettings
from estimators.protocol import BenchModel, fingerprint
from estimators.result import QUANTILE_LEVELS, EstimateResult, Status
from twin.measurement.relative import RelativeIntensities
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from estimators.least_squares_engine import Engine
    from estimators.least_squares_fit import Fit
    from estimators.least_squares_input import Seen
    from estimators.least_squares_joint import Joint
    from estimators.least_squares_starts import StartGrid
    from estimators.least_squares_verdict import Linearised

__all__ = ["LeastSquaresEstimator", "LeastSquaresSettings"]


class LeastSquaresEstimator:
    """Levenberg-Marquardt (optimistix) on whitened captures in coordinates without bounds.

    The captures are weighted by their covariance and the engine's error. The covariance of the
    result is that of Gauss and Newton; intervals follow the coordinates, or are cut off at a
    bound that is near (`Coordinates.quantiles`). The prior of the uniform distribution over the
    bounds enters the covariance, never the estimate. Sources: Levenberg (1944), Q. Appl. Math.
    2, 164; Marquardt (1963), J. SIAM 11, 431; JCGM 100:2008.

    `statistics` of the result: `steps` (evaluations of either engine), `chi_square`,
    `degrees_of_freedom`, `starts`, `starts_agreeing`. `sample_estimate` is linearised around the
    common estimate. With `joint` (or `smoothness_nm` above 0), all wavelengths are fitted together,
    see `estimators.least_squares_joint`; degrees of freedom are then what smoothing leaves.
    """

    name = "least-squares"

    def __init__(self, model: BenchModel, settings: LeastSquaresSettings | None = None) -> None:
        self.model = model
        self.settings = settings or LeastSquaresSettings()
        self._built: tuple[Engine, StartGrid] | None = None

    def engine(self) -> tuple[Engine, StartGrid]:
        """The engine and its grid of starts, built when first asked for and kept.

        Raises:
            InputError: see `estimators.forward.Forward.of`.
        """
        from estimators.least_squares_engine import Engine
        from estimators.least_squares_starts import StartGrid

        if self._built is None:
            options = self.settings
            coordinates = Coordinates(options.g_range)
            engine = Engine.of(self.model, coordinates, options.steps, options.cores)
            self._built = engine, StartGrid.of(engine)
        return self._built

    def estimate(self, intensities: RelativeIntensities) -> EstimateResult:
        """Fit every wavelength; see `estimators.protocol.Estimator`.

        Raises:
            InputError: intensities of another bench, a bench that the engine cannot show, or a
                covariance that is none.
        """
        from estimators.least_squares_fit import fit
        from estimators.least_squares_input import prepare
        from estimators.least_squares_joint import fit_jointly
        from estimators.least_squares_verdict import linearise

        self.model.check(intensities)
        options = self.settings
        engine, grid = self.engine()
        seen = prepare(intensities, engine.forward.relative_error, options)
        found = fit(engine, grid, seen.whitened, self.model.wavelength_nm, options.starts)
        thickness = np.asarray(intensities.thickness_mm, dtype=np.float64)
        if not options.together:
            line = linearise(found, seen, engine.coordinates, thickness)
            return self._result(intensities, seen, found, line)
        wavelength = self.model.wavelength_nm
        joint = fit_jointly(engine, found, seen, wavelength, options.smoothness_nm, thickness)
        return self._result(intensities, seen, joint.fit, joint.line, joint)

    def _result(
        self,
        intensities: RelativeIntensities,
        seen: Seen,
        found: Fit,
        line: Linearised,
        joint: Joint | None = None,
    ) -> EstimateResult:
        from estimators.least_squares_verdict import birge, identifiable, status_of, words

        model, options = self.model, self.settings
        coordinates = Coordinates(options.g_range)
        samples, count = len(model.sample_names), model.wavelength_nm.size
        spent = np.full(count, 3.0) if joint is None else joint.spent
        freedom = np.maximum(seen.whitened.used.sum(axis=1) - spent, 0.0)
        factor, torn = birge(found.chi_square, freedom, options.inconsistent_probability)
        covariance = line.covariance * factor[:, None, None]
        quantile = coordinates.quantiles(found.place, line.centre, covariance)
        known = identifiable(quantile, line, coordinates, options)
        status = status_of(found, seen, line, known, torn, coordinates, options)
        empty = (status == Status.MASKED) | (status == Status.CONTRADICTORY)
        known[empty | (status == Status.NOT_CONVERGED)] = False
        said = words(seen, known, status, line, coordinates, model.wavelength_nm)
        natural = np.where(empty[:, None], np.nan, line.natural)
        covariance[empty] = np.nan
        quantile[:, empty] = np.nan
        residual, normalised = _residuals(found, seen, samples)
        beer, beer_error = beer_check(intensities, model)
        settings = {
            key: _plain(value) for key, value in asdict(options).items() if key != "threads"
        }
        statistics = {
            "steps": found.steps.astype(np.float64),
            "chi_square": np.where(empty, np.nan, found.chi_square),
            "degrees_of_freedom": freedom,
            "starts": found.starts.astype(np.float64),
            "starts_agreeing": found.agreeing.astype(np.float64),
        }
        if joint is not None:
            from estimators.least_squares_joint import SMOOTH

            for name, length in zip(SMOOTH, joint.length_nm, strict=True):
                statistics[f"smoothness_{name}_nm"] = np.full(count, length)
        return EstimateResult(
            estimator=self.name,
            wavelength_nm=model.wavelength_nm,
            albedo=natural[:, 0].copy(),
            sigma_t_per_mm=natural[:, 1].copy(),
            g=natural[:, 2].copy(),
            covariance=covariance,
            quantile_level=QUANTILE_LEVELS,
            quantile=quantile,
            identifiable=known,
            status=status,
            sample_names=tuple(intensities.sample_names),
            thickness_mm=np.asarray(intensities.thickness_mm, dtype=np.float64),
            sample_estimate=_alone(found, seen, line, coordinates, samples),
            sample_status=np.select(
                [seen.contradictory, seen.masked, seen.lost],
                [Status.CONTRADICTORY, Status.MASKED, Status.COLLIMATED_LOST],
                Status.OK,
            ).astype(np.int8),
            distance=np.full((samples, count), np.nan),
            residual=residual,
            residual_normalised=normalised,
            beer_sigma_t_per_mm=beer,
            beer_standard_error_per_mm=beer_error,
            settings=settings,
            fingerprint=fingerprint(
                intensities, model.fingerprint_parts(), [self.name, repr(settings)]
            ),
            messages=(*intensities.reasons, *said),
            statistics=statistics,
        )


def _plain(value: object) -> str | int | float:
    """An option as a result stores it."""
    if isinstance(value, tuple):
        return ", ".join(f"{bound:g}" for bound in value)
    return str(value).lower() if isinstance(value, bool) else value  # type: ignore[return-value]


def _residuals(found: Fit, seen: Seen, samples: int) -> tuple[FloatArray, FloatArray]:
    """Predicted minus measured, plain and in standard deviations, both (S, 3, W)."""
    used = seen.whitened.used
    with np.errstate(divide="ignore", invalid="ignore"):
        plain = np.where(used, found.value - seen.whitened.data, np.nan)
        normalised = np.where(used, plain / seen.whitened.sigma, np.nan)
    shape = (samples, 3, len(used))
    return plain.T.reshape(shape).copy(), normalised.T.reshape(shape).copy()


def _alone(
    found: Fit, seen: Seen, line: Linearised, coordinates: Coordinates, samples: int
) -> FloatArray:
    """What every sample alone would say, one Gauss-Newton step from the common one, (S, W, 3)."""
    from estimators.least_squares_fit import WEAK

    rest = np.where(seen.whitened.used, found.value - seen.whitened.data, 0.0)
    slope = np.where(np.isfinite(found.slope), found.slope, 0.0)
    alone = np.full((samples, len(rest), 3), np.nan)
    for s in range(samples):
        part = slice(3 * s, 3 * s + 3)
        used = seen.whitened.used[:, part]
        block = seen.covariance[:, part, part] + np.where(used, 0.0, 1.0)[:, :, None] * np.eye(3)
        weighted = np.linalg.solve(block, slope[:, part] * used[..., None])
        normal = slope[:, part].transpose(0, 2, 1) @ weighted + np.diag(WEAK)
        force = np.einsum("wmp,wm->wp", weighted, rest[:, part])
        step = -np.linalg.solve(normal, force[..., None])[..., 0]
        place = found.place + np.clip(step, -3.0, 3.0)
        alone[s] = np.where(
            np.asarray(used.all(axis=1))[:, None], coordinates.natural(place)[0], np.nan
        )
    return alone
