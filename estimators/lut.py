"""The look-up-table estimator of the appearance map (Iser et al. 2022, section 4.3)."""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np
from numpy.typing import NDArray

from estimators.beer_law import beer_check
from estimators.draws import NINETY_HIGH, NINETY_LOW
from estimators.lut_index import at_the_map, brought
from estimators.lut_neighbourhood import Neighbourhoods
from estimators.lut_plain import Table, look_up_measured, residuals
from estimators.lut_settings import LutSettings
from estimators.map_grid import MapNodes
from estimators.protocol import BenchModel, fingerprint
from estimators.result import QUANTILE_LEVELS, EstimateResult, Status
from estimators.screening import counted, impossible, left_out, screen
from twin.errors import InputError
from twin.measurement.relative import RelativeIntensities
from twin.spectra import FloatArray


class LutEstimator:
    """Interpolation in the irregular appearance map, with a random neighbourhood.

    Every sample's captures are looked up in the map of its thickness by linear barycentric
    interpolation; the neighbourhood of the captures is drawn at random, looked up draw by draw
    and summarised by its median; samples are combined. Draws outside the map do not count,
    and how many they are is reported by the status.
    """

    name = "lut"

    def __init__(self, model: BenchModel, settings: LutSettings | None = None) -> None:
        """Prepare the maps.

        Args:
            model: the bench, with one appearance map per sample.
            settings: options; the defaults give honest intervals, `LutSettings.of_the_seed()`
                the published procedure.

        Raises:
            InputError: not one usable map per sample.
        """
        self.model = model
        self.settings = settings or LutSettings()
        if len(model.maps) != len(model.sample_names):
            raise InputError(
                f"{len(model.maps)} appearance maps for {len(model.sample_names)} samples",
                "one appearance map per sample",
                remedy="Compute them with `benchtwin map`.",
            )
        self._tables: list[Table] = []
        rho = (float(np.median(model.rho_black)), float(np.median(model.rho_white)))
        for source, name in zip(model.maps, model.sample_names, strict=True):
            try:
                grid = MapNodes.of(source, fixed_g=self.settings.fixed_g)
            except ValueError as error:
                raise InputError(
                    str(error).removeprefix("found ").split("; expected ")[0],
                    str(error).split("; expected ")[-1],
                    place=f"appearance map of {name}",
                ) from None
            self._tables.append(Table(grid, grid.power(model.rho_black, model.rho_white), rho))

    def estimate(self, intensities: RelativeIntensities) -> EstimateResult:
        """Look the captures up; see `estimators.protocol.Estimator`."""
        model, options = self.model, self.settings
        model.check(intensities)
        self._check_thickness(intensities)
        count = model.wavelength_nm.size
        screened = screen(model, _needed(intensities, options), options.lost_sigma)
        cut = look_up_measured(self._tables, screened, options)
        mapped = at_the_map(model, model.maps)
        if mapped is not None:
            first = np.stack(
                [table.grid.parameters(cut.place[s]) for s, table in enumerate(self._tables)]
            )
            screened = brought(model, mapped, intensities.thickness_mm, first, screened)
            cut = look_up_measured(self._tables, screened, options)
        covariance = screened.covariance
        with np.errstate(invalid="ignore"):
            alone = np.stack(
                [
                    table.grid.parameters(np.nan_to_num(cut.place[s]))
                    for s, table in enumerate(self._tables)
                ]
            )
        alone[cut.status >= Status.CONTRADICTORY] = np.nan
        sample_status = cut.status
        if options.draws:
            clouds, whole, sample_status, torn = Neighbourhoods(
                self._tables, options, cut, covariance
            ).summary()
            for s, cloud in enumerate(clouds):
                good = np.isfinite(cloud.median).all(axis=1)
                alone[s, good] = cloud.median[good]
            estimate, matrix, quantile = whole.median.copy(), whole.covariance, whole.quantile
        else:
            torn = np.zeros(count, dtype=bool)
            used = (sample_status == Status.OK)[..., None]
            number = used.sum(axis=0)
            estimate = np.where(used, alone, 0.0).sum(axis=0) / np.maximum(number, 1)
            estimate[number[:, 0] == 0] = np.nan
            matrix = np.full((count, 3, 3), np.nan)
            quantile = np.full((QUANTILE_LEVELS.size, count, 3), np.nan)

        identifiable = self._identifiable(quantile, estimate)
        status = _worst_needed(sample_status)
        status[screened.noiseless & (status == Status.OK)] = Status.NO_NOISE_STATED
        wanted = identifiable[:, :2] if options.fixed_g is not None else identifiable
        vague = ~wanted.all(axis=1) & (status < Status.NOT_IDENTIFIABLE)
        status[vague] = Status.NOT_IDENTIFIABLE
        torn |= impossible(sample_status)
        status[torn & (status < Status.INCONSISTENT)] = Status.INCONSISTENT
        # Without the beam's light the thickness bounds sigma_t from below, and nothing from above.
        identifiable[status == Status.COLLIMATED_LOST, 1] = False
        # Where no sample lies in the map, the nearest material of the nearest sample is shown.
        stranded = np.isnan(estimate).any(axis=1)
        reach = np.where(np.isfinite(cut.distance), cut.distance, np.inf)
        closest = alone[reach.argmin(axis=0), np.arange(count)]
        estimate = np.where((stranded & (status == Status.OUTSIDE_MAP))[:, None], closest, estimate)
        identifiable[status >= Status.OUTSIDE_MAP] = False

        residual, normalised = residuals(self._tables, screened, estimate)
        beer, beer_error = beer_check(intensities, model)
        settings = {
            key: "none" if value is None else value
            for key, value in asdict(options).items()
            if key != "threads"
        }
        return EstimateResult(
            estimator=self.name,
            wavelength_nm=model.wavelength_nm,
            albedo=estimate[:, 0].copy(),
            sigma_t_per_mm=estimate[:, 1].copy(),
            g=estimate[:, 2].copy(),
            covariance=matrix,
            quantile_level=QUANTILE_LEVELS,
            quantile=quantile,
            identifiable=identifiable,
            status=status,
            sample_names=tuple(intensities.sample_names),
            thickness_mm=np.asarray(intensities.thickness_mm, dtype=np.float64),
            sample_estimate=alone,
            sample_status=sample_status,
            distance=cut.distance,
            residual=residual,
            residual_normalised=normalised,
            beer_sigma_t_per_mm=beer,
            beer_standard_error_per_mm=beer_error,
            settings=settings,
            fingerprint=fingerprint(
                intensities,
                model.fingerprint_parts(),
                [self.name, repr(settings), *(table.grid.digest for table in self._tables)],
            ),
            messages=(
                *intensities.reasons,
                *left_out(intensities.sample_names, sample_status, status),
                *counted(status),
            ),
        )

    def _check_thickness(self, intensities: RelativeIntensities) -> None:
        for table, thickness, name in zip(
            self._tables, intensities.thickness_mm, intensities.sample_names, strict=True
        ):
            if abs(table.grid.thickness_mm - thickness) > 1e-6 * thickness:
                raise InputError(
                    f"an appearance map of {table.grid.thickness_mm:g} mm",
                    f"one of {float(thickness):g} mm, the thickness of the sample",
                    place=f"appearance map of {name}",
                )

    def _identifiable(self, quantile: FloatArray, estimate: FloatArray) -> NDArray[np.bool_]:
        """Whether the 90 % interval is narrow against the map's range, shape (W, 3)."""
        if not self.settings.draws:
            return np.isfinite(estimate)
        axes = self._tables[0].grid.axes
        low, high = quantile[NINETY_LOW].copy(), quantile[NINETY_HIGH].copy()
        span = np.array([axis[-1] - axis[0] for axis in axes])
        positive = axes[1][axes[1] > 0]
        span[1] = np.log(positive[-1] / positive[0])
        with np.errstate(invalid="ignore"):
            width = high - low
            width[:, 1] = np.log(
                np.maximum(high[:, 1], positive[0]) / np.maximum(low[:, 1], positive[0])
            )
            narrow = width <= self.settings.unidentifiable_share * span
        if self.settings.fixed_g is not None:
            narrow[:, 2] = False
        return np.asarray(narrow & np.isfinite(estimate))


def _needed(intensities: RelativeIntensities, options: LutSettings) -> RelativeIntensities:
    """The captures that the look-up uses: with a fixed g not the collimated one."""
    if options.fixed_g is None:
        return intensities
    valid = np.asarray(intensities.valid).copy()
    valid[:, 2] = False
    return replace(intensities, valid=valid)


def _worst_needed(sample_status: NDArray[np.int8]) -> NDArray[np.int8]:
    """Status of all samples together: that of the best one, (S, W) to (W,)."""
    return np.asarray(sample_status.min(axis=0), dtype=np.int8)
