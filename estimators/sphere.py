"""Material from readings with integrating spheres: inverse adding-doubling with uncertainty.

visit = read_rxt("phantom.rxt")
estimate = SphereEstimator(SphereSettings(method="comparison", g=0.9)).estimate(visit)
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from estimators.result import Status
from estimators.sphere_result import SphereEstimate
from estimators.sphere_solver import Box, Solution, better, covariance_of, solve
from estimators.sphere_start import start_places
from twin.errors import InputError
from twin.measurement.rxt import SphereVisit
from twin.spectra import FloatArray
from twin.spheres import LossTable, SphereModel
from twin.spheres.readings import Method

if TYPE_CHECKING:
    from twin.spheres.lost import LostLight

DEPTH_BOUNDS = (1e-3, 1e3)
ALBEDO_BOUNDS = (1e-7, 1.0 - 1e-7)
G_BOUND = 0.98


@dataclass(frozen=True)
class SphereSettings:
    """Options of the sphere estimator.

    Attributes:
        method: "substitution", or "comparison" for a dual-beam instrument: no file says which.
        g: anisotropy factor where it is not found; None takes the file's column, else 0.
        hold_g: hold g even where M_U would let it be found.
        incidence_deg: angle of the beam [degrees]; None takes the file's column, else 0.
        unscattered_in_r, unscattered_in_t: collected share of the unscattered light; None
            takes the file's column, else 1.
        lost_light: take off the light that misses the ports, found by Monte Carlo.
        log2_paths, seed: of that Monte Carlo.
        relative_sigma, absolute_sigma: standard deviation of M_R and M_T: a share of the
            reading plus a constant. Files state no noise.
        unscattered_relative_sigma, unscattered_absolute_sigma: the same of M_U, which a
            detector far away reads over many decades.
        inconsistent_chi_square: a fit worse than this says that no material gives the readings.
    """

    method: Method = "substitution"
    g: float | None = None
    hold_g: bool = False
    incidence_deg: float | None = None
    unscattered_in_r: float | None = None
    unscattered_in_t: float | None = None
    lost_light: bool = True
    log2_paths: int = 16
    seed: int = 0
    relative_sigma: float = 0.005
    absolute_sigma: float = 0.002
    unscattered_relative_sigma: float = 0.02
    unscattered_absolute_sigma: float = 1e-5
    inconsistent_chi_square: float = 9.0
    max_steps: int = 60

    def __post_init__(self) -> None:
        if self.g is not None and not abs(self.g) <= G_BOUND:
            raise InputError(f"g {self.g:g}", f"{-G_BOUND:g} to {G_BOUND:g}", place="g")
        for name in ("relative_sigma", "unscattered_relative_sigma"):
            if not 0.0 <= getattr(self, name) < 1.0:
                raise InputError(f"{getattr(self, name):g}", "0 to less than 1", place=name)
        for name in ("absolute_sigma", "unscattered_absolute_sigma"):
            if not 0.0 < getattr(self, name) < 1.0:
                raise InputError(f"{getattr(self, name):g}", "above 0 to less than 1", place=name)
        if not 8 <= self.log2_paths <= 26:
            raise InputError(f"{self.log2_paths}", "8 to 26", place="log2_paths")


class SphereEstimator:
    """(albedo, sigma_t, g) of every row by bounded least squares.

    With M_R, M_T and M_U all three are found; with two readings g is held; one reading leaves
    the material open. Source of the method: Prahl, van Gemert and Welch (1993), Applied Optics
    32, 559; the search, the lost light and the uncertainties are done differently here.
    """

    name = "sphere"

    def __init__(self, settings: SphereSettings | None = None) -> None:
        self.settings = settings or SphereSettings()

    def estimate(self, visit: SphereVisit) -> SphereEstimate:
        """Estimate the material of every row.

        A row that cannot be used gets a status, never an exception.

        Raises:
            InputError: the visit as a whole contradicts the settings.
        """
        settings = self.settings
        model = SphereModel.of(
            visit,
            method=settings.method,
            incidence_deg=settings.incidence_deg,
            unscattered_in_r=settings.unscattered_in_r,
            unscattered_in_t=settings.unscattered_in_t,
            lost_light=settings.lost_light,
        )
        value, sigma = np.where(visit.valid, visit.value, np.nan), self._sigma(visit)
        readings = visit.valid.sum(axis=1)
        held = (readings < 3) | settings.hold_g
        usable = readings >= 2
        g = np.where(np.isfinite(visit.g), visit.g, 0.0)
        if settings.g is not None:
            g = np.full(visit.rows, settings.g)
        g = np.clip(g, -G_BOUND, G_BOUND)
        searched = np.stack([usable, usable, usable & ~held], axis=1)
        box = self._box(model)
        start = start_places(model, value, sigma, g, held)

        def plain(parameters: FloatArray, rows: NDArray[np.int_]) -> tuple[FloatArray, FloatArray]:
            found, slopes, _ = model.at_rows(parameters, rows)
            return found, slopes

        def fit(first: FloatArray) -> Solution:
            return solve(plain, value, sigma, first, searched, box, max_steps=settings.max_steps)

        solution = better(fit(start[0]), fit(start[1]))
        table = model.loss_table(
            g if bool(held.all()) else None, log2_paths=settings.log2_paths, seed=settings.seed
        )
        lost = None
        if table is not None and usable.any():
            solution, lost = self._with_losses(model, table, solution, value, sigma, searched, box)
            sigma = _with_engine_error(sigma, lost, solution)
        return self._result(visit, model, solution, lost, value, sigma, searched, held, g)

    def _with_losses(
        self, model: SphereModel, table: LossTable, solution: Solution, value: FloatArray,
        sigma: FloatArray, searched: NDArray[np.bool_], box: Box,
    ) -> tuple[Solution, LostLight]:  # fmt: skip
        """The fit once more with the light that misses the ports taken off."""

        def predict(
            parameters: FloatArray, rows: NDArray[np.int_]
        ) -> tuple[FloatArray, FloatArray]:
            lost = table.at(parameters, model.n[rows])
            found, slopes, _ = model.at_rows(parameters, rows, lost)
            return found, slopes

        solution = solve(
            predict, value, sigma, solution.parameters, searched, box,
            max_steps=self.settings.max_steps,
        )  # fmt: skip
        return solution, table.at(solution.parameters, model.n)

    def _sigma(self, visit: SphereVisit) -> FloatArray:
        s = self.settings
        relative = np.array([s.relative_sigma, s.relative_sigma, s.unscattered_relative_sigma])
        constant = np.array([s.absolute_sigma, s.absolute_sigma, s.unscattered_absolute_sigma])
        return np.asarray(relative * np.nan_to_num(visit.value) + constant)

    @staticmethod
    def _box(model: SphereModel) -> Box:
        low, high = np.empty((model.rows, 3)), np.empty((model.rows, 3))
        low[:, 0], high[:, 0] = ALBEDO_BOUNDS
        low[:, 1] = DEPTH_BOUNDS[0] / model.thickness_mm
        high[:, 1] = DEPTH_BOUNDS[1] / model.thickness_mm
        low[:, 2], high[:, 2] = -G_BOUND, G_BOUND
        return Box(low, high)

    def _result(
        self, visit: SphereVisit, model: SphereModel, solution: Solution, lost: LostLight | None,
        value: FloatArray, sigma: FloatArray, searched: NDArray[np.bool_],
        held: NDArray[np.bool_], g: FloatArray,
    ) -> SphereEstimate:  # fmt: skip
        settings = self.settings
        usable = searched[:, 0]
        covariance, identifiable = covariance_of(solution, value, sigma, searched)
        chi = np.nansum(((solution.readings - value) / sigma) ** 2, axis=1)
        total, error = value[:, 0] + value[:, 1], np.hypot(sigma[:, 0], sigma[:, 1])
        with np.errstate(invalid="ignore"):
            impossible = (total > 1.0 + 3.0 * error) | (
                value[:, 2] > value[:, 1] + 3.0 * np.hypot(sigma[:, 1], sigma[:, 2])
            )
        status = np.full(visit.rows, Status.OK, dtype=np.int8)
        status[solution.at_bound.any(axis=1)] = Status.AT_BOUND
        # what cannot be told apart stays so wherever the search has stopped
        status[~identifiable[:, :2].all(axis=1) | (searched[:, 2] & ~identifiable[:, 2])] = (
            Status.NOT_IDENTIFIABLE
        )
        status[chi > settings.inconsistent_chi_square] = Status.INCONSISTENT
        status[~solution.converged] = Status.NOT_CONVERGED
        status[impossible] = Status.CONTRADICTORY
        few = ~usable
        possible = visit.valid.sum(axis=1)
        status[few & (possible == 1)] = Status.NOT_IDENTIFIABLE
        status[few & (possible == 0)] = Status.MASKED
        masked = few | (len(visit.measured) > 1) & (possible < 2)
        status[masked & (len(visit.measured) > 1)] = Status.MASKED
        blank = few | impossible
        parameters = np.where(blank[:, None], np.nan, solution.parameters)
        covariance[blank] = np.nan
        identifiable[blank] = False
        zero = np.zeros(visit.rows)
        shares = lost.share if lost is not None else np.zeros((visit.rows, 4))
        statistics = {
            "chi_square": np.where(blank, np.nan, chi),
            "steps": solution.steps,
            "lost_reflectance": np.where(blank, zero, shares[:, 0]),
            "lost_transmittance": np.where(blank, zero, shares[:, 1]),
        }
        return SphereEstimate(
            estimator=self.name,
            source=visit.file,
            wavelength_nm=visit.wavelength_nm,
            albedo=parameters[:, 0],
            sigma_t_per_mm=parameters[:, 1],
            g=parameters[:, 2],
            g_held=held,
            covariance=covariance,
            identifiable=identifiable,
            status=status,
            value=value,
            sigma=np.where(np.isfinite(value), sigma, np.nan),
            fitted=np.where(blank[:, None], np.nan, solution.readings),
            settings={k: "" if v is None else v for k, v in asdict(settings).items()},
            messages=self._messages(visit, status, held & usable, g, lost, blank),
            statistics=statistics,
        )

    def _messages(
        self, visit: SphereVisit, status: NDArray[np.int8], held: NDArray[np.bool_],
        g: FloatArray, lost: LostLight | None, blank: NDArray[np.bool_],
    ) -> tuple[str, ...]:  # fmt: skip
        s = self.settings
        said = list(visit.reasons)
        noise = (
            f"The file states no noise; taken: {s.relative_sigma:.2%} of M_R and M_T plus"
            f" {s.absolute_sigma:g}"
        )
        if "M_U" in visit.measured:
            noise += (
                f", {s.unscattered_relative_sigma:.2%} of M_U plus {s.unscattered_absolute_sigma:g}"
            )
        said.append(noise + ".")
        if held.any():
            values = np.unique(g[held])
            text = f"{values[0]:g}" if values.size == 1 else f"{values[0]:g} to {values[-1]:g}"
            why = "as asked" if s.hold_g else "for want of M_U"
            said.append(
                f"g was held at {text} in {int(held.sum())} rows, {why}; its uncertainty is not"
                " in the intervals. sigma_t goes with 1 / (1 - g); mu_a and mu_s' depend on g"
                " little where the sample is thick (mu_s' times thickness above 1) only."
            )
        if len(visit.measured) < 2:
            said.append(
                f"Only {visit.measured[0]} was measured: one number cannot tell absorption from"
                " scattering. Measure M_T too."
            )
        if visit.spheres == 0:
            said.append("No spheres: the readings were taken as reflectance and transmittance.")
        elif lost is None:
            said.append("Light that misses the ports was not taken off.")
        elif not blank.all():
            rows = ~blank
            said.append(
                "Light that misses the ports, found by Monte Carlo: up to"
                f" {lost.share[rows, 0].max():.4f} in M_R and {lost.share[rows, 1].max():.4f} in"
                f" M_T (standard errors up to {lost.standard_error[rows, :2].max():.1e},"
                " included in the uncertainty)."
            )
        for code, text in _STATUS_TEXTS.items():
            number = int(np.sum(status == code))
            if number:
                said.append(f"{number} of {visit.rows} rows {Status(code).name.lower()}: {text}")
        return tuple(said)


_STATUS_TEXTS = {
    Status.AT_BOUND: "the fit lies on the border of what can be (no absorption, no scattering).",
    Status.NOT_IDENTIFIABLE: "the readings leave at least one parameter open; see `identifiable`.",
    Status.INCONSISTENT: "no material of this thickness and index gives these readings; check"
    " wall reflectance, ports, standards and whether the unscattered light was collected.",
    Status.CONTRADICTORY: "M_R + M_T exceeds 1, or M_U exceeds M_T; no values are given.",
    Status.MASKED: "fewer than two possible readings.",
    Status.NOT_CONVERGED: "the search stopped before it had settled; allow more steps.",
}


def _with_engine_error(sigma: FloatArray, lost: LostLight, solution: Solution) -> FloatArray:
    """Standard deviations with the Monte Carlo's error of the lost light added."""
    extra = np.zeros_like(sigma)
    extra[:, :2] = lost.standard_error[:, :2]
    return np.asarray(np.hypot(sigma, np.where(np.isfinite(extra), extra, 0.0)))
