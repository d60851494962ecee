"""What a fluorescence visit is expected to show: white and sample, material and levels unknown.

    white_jk  = a_j b_k sum_o s_k(o) rho(o) l_j(o)
    sample_jk = a_j b_k sum_oi s_k(o) Phi[o, i] l_j(i)          (Iser et al. 2023, equation 3)

A chip cannot measure the lights: their levels a_j and its gains b_k are unknown, and the white is
data. A spectrometer measures every light bin by bin on the white: only the sample is data, and the
white's errors are in its covariance (`twin.fluorescence.corrected`). The matrix Phi has the
Gaussian prior that the estimator `donaldson` fits with, its products linearised where they ended.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from estimators.fluorescence.cells import gather
from twin.effects import Candidate as Suspect
from twin.effects.catalogue.fluorescence_bench import FluorescenceWorld
from twin.errors import InputError
from twin.fluorescence.calibration import _error_modes, _levels
from twin.fluorescence.correction import corrected
from twin.fluorescence.readings import signals
from twin.fluorescence.setup import FluorescenceSetup, detector_response, nominal_system
from twin.fluorescence.system import FluorescenceData
from twin.fluorescence.visit import FluorescenceVisit
from twin.materials import reflectance
from twin.measurement.model import BoolArray
from twin.spectra import FloatArray

PARTS = 11
"""Parts of a bin on which effects act: light moves by less than a bin. Odd: one is central."""
FREE = 0.3
"""Prior standard deviation of ln level and ln gain about the calibrated ones: all but free."""
ROUNDS = 25
"""Most Gauss-Newton steps of the unknowns: levels, gains and matrix multiply each other."""
SETTLED = 1e-3
"""Change of the unknowns in a step [prior standard deviations, all together] that ends them."""
NO_FLUORESCENCE = "a white without fluorescence"
"""What the correction expects where it refuses a white for its light."""
JAGGED = 0.02
"""Standard deviation of single rows of a matrix around all that is smooth, relative to them: what a
spectrum at one wavelength does is no sign of a bench that is wrong."""
TWIN = 1e-3
"""The twin's own error, relative, in every reading: bins of 10 nm and linearised unknowns."""
DISCREPANCIES = (0.0, 1e-3, 3e-3, 0.01, 0.03, 0.1)
"""Relative errors of the model, for the point that it is linearised about."""


@dataclass(frozen=True, eq=False)
class Readings:
    """The observation vector of a visit on the scale of its calibrated lights.

    Attributes:
        data: what estimators get.
        captures: names of the T kinds of capture, ("sample",) or ("white", "sample").
        value: (T, J, K), anything where not valid.
        variance: of what is independent, (T, J, K).
        common: errors that values share, one standard deviation each, (C, T, J, K).
        valid: (T, J, K).
        white: reflectance of the white on the emission bins, (Wo,).
        resolved: whether the lights were measured bin by bin.
    """

    data: FluorescenceData
    captures: tuple[str, ...]
    value: FloatArray
    variance: FloatArray
    common: FloatArray
    valid: BoolArray
    white: FloatArray
    resolved: bool


def readings(visit: FluorescenceVisit) -> Readings:
    """White and sample of a chip's visit, the sample alone of a spectrometer's.

    Raises:
        InputError: as `twin.fluorescence.corrected`.
    """
    data = _accepted(visit)
    rho = reflectance(visit.setup.white, visit.setup.emission_nm)
    response = data.system.sensitivities
    resolved = response.shape[0] == response.shape[1] and np.allclose(
        response, np.diag(np.diag(response))
    )
    if resolved:
        value, variance, common = data.value[None], data.variance[None], data.common[:, None]
        captures: tuple[str, ...] = ("sample",)
        valid = data.valid[None]
    else:
        found = signals(visit)
        with np.errstate(invalid="ignore"):
            ratio = float(np.nanmedian(found.sample / data.value))
        value = np.stack([found.white, found.sample]) / ratio
        variance = np.stack([found.white_variance, found.sample_variance]) / ratio**2
        valid = np.stack([data.valid, data.valid]) & np.isfinite(variance)
        safe = np.where(valid, value, 0.0)
        common = found.drift[:, ::-1] * safe
        captures = ("white", "sample")
    value = np.where(valid, value, 0.0)
    own = (TWIN * value) ** 2 + (1e-7 * np.abs(value).max()) ** 2
    variance = np.where(valid, variance, 1.0) + own
    common = np.where(valid, common, 0.0)
    return Readings(data, captures, value, variance, common, valid, rho, resolved)


def _accepted(visit: FluorescenceVisit) -> FluorescenceData:
    """Corrected captures, also where light on the white looks as if the white fluoresced.

    A filter that leaks or channels that talk look so too: that is for the diagnosis to say.
    """
    try:
        return corrected(visit)
    except InputError as error:
        if error.expected != NO_FLUORESCENCE:
            raise
        refused = error.found
    found = signals(visit)
    nominal = nominal_system(visit.setup)
    expected = nominal.white(reflectance(visit.setup.white, visit.setup.emission_nm))
    level, gain = _levels(found, expected, visit.setup.channel_names)
    light = level[:, None] * nominal.illuminants
    scale = float(light.max())
    system = replace(
        nominal, illuminants=light / scale, sensitivities=nominal.sensitivities * gain[:, None]
    )
    value = np.where(found.valid, found.sample / scale, np.nan)
    modes = _error_modes(found, level[:, None] * gain * expected)
    words = f"{refused}: estimators refuse that as a white that fluoresces, which it may be"
    return FluorescenceData(
        system, value, found.sample_variance / scale**2,
        modes * np.where(found.valid, value, 0.0), found.valid,
        (*visit.provenance.notes, *found.reasons, words), (), visit.sample, visit.truth,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Lit:
    """Lights and channels of one hypothesis.

    Attributes:
        light: of the sample, (J, Wi).
        white_light: of the white, (J, Wi).
        response: (K, Wo).
    """

    light: FloatArray
    white_light: FloatArray
    response: FloatArray


@dataclass(frozen=True, eq=False)
class FluorescenceBench:
    """The bench as calibrated, and what effects make of it.

    Effects act on tenths of a bin, where the light of a lamp can move by a nanometre; only what
    they change is binned and added to what was calibrated.
    """

    setup: FluorescenceSetup
    readings: Readings

    @cached_property
    def world(self) -> FluorescenceWorld:
        """Lights and channels on the tenths of the excitation bins."""
        system = self.readings.data.system
        grid = system.excitation_nm
        step = float(grid[1] - grid[0])
        inside = (np.arange(PARTS) + 0.5) / PARTS - 0.5
        fine = (grid[:, None] + step * inside).reshape(-1)
        shape = np.array([each.spectrum(fine) for each in self.setup.lights]) * step / PARTS
        nominal = self._binned(shape) * PARTS
        level = (nominal * system.illuminants).sum(axis=1) / (nominal**2).sum(axis=1)
        if self.readings.resolved:
            seen = np.repeat(self._padded(system.sensitivities), PARTS, axis=1)
        else:
            seen = self._channels(fine)
        return FluorescenceWorld(fine, level[:, None] * shape, seen)

    def _channels(self, fine: FloatArray) -> FloatArray:
        """Sensitivities of a chip between the centres of the bins, (K, W)."""
        emission, own = self.readings.data.system.emission_nm, self.readings.data.system
        step = float(emission[1] - emission[0]) / PARTS
        finer = emission[0] + step * np.arange(PARTS * (emission.size - 1) + 1)
        shape = detector_response(self.setup.detector, finer)
        # The outermost bins may count by half: between them and the next that is no shape.
        shape[:, 0] = 2.0 * shape[:, 1] - shape[:, 2]
        shape[:, -1] = 2.0 * shape[:, -2] - shape[:, -3]
        at = shape[:, ::PARTS]
        gain = (own.sensitivities * at).sum(axis=1) / (at**2).sum(axis=1)
        found = np.array([np.interp(fine, finer, row) for row in gain[:, None] * shape])
        return np.where(fine > emission[0] - step * PARTS / 2, found, 0.0)

    def _padded(self, rows: FloatArray) -> FloatArray:
        system = self.readings.data.system
        extra = system.excitation_nm.size - system.emission_nm.size
        return np.concatenate([np.zeros((len(rows), extra)), rows], axis=1)

    @staticmethod
    def _binned(rows: FloatArray) -> FloatArray:
        """Means over bins, (N, W) of (N, W PARTS)."""
        return np.asarray(rows.reshape(len(rows), -1, PARTS).mean(axis=2))

    def lit(self, suspects: Mapping[str, Suspect], values: Mapping[str, FloatArray]) -> Lit:
        """Lights and channels with effects at given deviations from nominal.

        Raises:
            InputError: values that cannot be.
        """
        system, before = self.readings.data.system, self.world
        after = before
        for name, away in values.items():
            suspect = suspects[name]
            after = suspect.apply(after, np.array(suspect.nominal) + away)
        if after is before:
            return Lit(system.illuminants, system.illuminants, system.sensitivities)
        change = self._binned(after.illuminants - before.illuminants) * PARTS
        moved = after.sensitivities - before.sensitivities
        if self.readings.resolved:
            moved = self._binned(moved)[:, -system.emission_nm.size :]
        else:
            # A channel is said at the centres of the bins.
            pick = slice(PARTS * (system.excitation_nm.size - system.emission_nm.size)
                         + PARTS // 2, None, PARTS)  # fmt: skip
            own = before.sensitivities[:, pick]
            there = own > 1e-9 * own.max()
            moved = moved[:, pick] * np.where(there, system.sensitivities, 1.0)
            moved /= np.where(there, own, 1.0)
        response = system.sensitivities + moved
        if not self.readings.resolved:
            light = system.illuminants + change
            return Lit(light, light, response)
        # The white was read with the same channels: it says what the lights then were.
        light = system.illuminants
        if np.any(moved):
            light = self._measured_again(response)
        return Lit(light + change, light, response)

    def _measured_again(self, response: FloatArray) -> FloatArray:
        """Lights that other channels would have shown the same white of, (J, Wi)."""
        system, rho = self.readings.data.system, self.readings.white
        own = system.illuminants[:, -system.emission_nm.size :]
        model = response * rho
        left = own @ (system.sensitivities * rho).T - own @ model.T
        gram = model.T @ model + 1e-6 * np.max(np.abs(model)) ** 2 * np.eye(len(rho))
        light = system.illuminants.copy()
        light[:, -own.shape[1] :] += left @ model @ np.linalg.inv(gram)
        return light


@dataclass(frozen=True, eq=False)
class MaterialPrior:
    """Gaussian prior of the matrix: mean plus root times standard normal unknowns.

    Attributes:
        mean: (Wo, Wi).
        root: (R, Wo, Wi).
    """

    mean: FloatArray
    root: FloatArray


def material_prior(data: FluorescenceData) -> MaterialPrior:
    """The prior that the estimator `donaldson` ends with.

    Directions that no capture sees stay: under other lights and channels one may.
    Its most probable fit: Gaussian background (reflectance and cells) plus products, these
    linearised about their fitted parameters t with their own prior t ~ N(0, 1). Every row may be
    a little brighter or darker than that (`JAGGED`).

    Raises:
        InputError: captures that no estimator can use.
    """
    from estimators.fluorescence.background import reduce
    from estimators.fluorescence.donaldson import DonaldsonSettings
    from estimators.fluorescence.products import Products
    from estimators.fluorescence.search import candidates

    captures, settings = gather([data]), DonaldsonSettings()
    prior, cells = settings.background, captures.cells
    reduced = reduce(captures, prior, settings.directions)
    model = Products(reduced.design, cells, settings.shapes, reduced.diagonal_design)
    fits = candidates(reduced, model, settings.amplitudes, settings.steps, settings.products)
    best = max(fits, key=lambda one: float(one.log_evidence[0]))
    found, kernel = best.reduced, best.reduced.kernels
    count, size = len(kernel.cell), len(kernel.cell) + len(kernel.diagonal)
    covariance = found.unknowns(best.amplitude, 0)
    mean = np.zeros(size)
    mean[count:] = prior.reflectance_mean
    if best.products:
        places = np.argwhere(cells.below_diagonal)
        each = np.zeros((size, *cells.below_diagonal.shape))
        each[np.arange(count), places[:, 0], places[:, 1]] = 1.0
        on = np.eye(size)[:, count:]
        whole = Products(each, cells, settings.shapes, on)
        one, slope = whole.values_and_jacobian(best.parameters)
        mean += one[0] - slope[0] @ best.parameters[0].reshape(-1)
        covariance += slope[0] @ slope[0].T
    seen = np.concatenate([np.zeros(count), found.reflectance[0]])
    if best.products:
        seen[:count] = model.fluorescence(best.parameters)[0]
    row = np.concatenate([cells.emission, cells.diagonal_nm])
    covariance += JAGGED**2 * np.outer(seen, seen) * (row[:, None] == row)
    root = _root(covariance).T
    return MaterialPrior(
        cells.matrix(mean[:count], mean[count:]), cells.matrix(root[:, :count], root[:, count:])
    )


def _root(covariance: FloatArray) -> FloatArray:
    value, vector = np.linalg.eigh(covariance)
    kept = value > 1e-12 * value[-1]
    return np.asarray(vector[:, kept] * np.sqrt(value[kept]))


@dataclass(frozen=True, eq=False)
class Unknowns:
    """Matrix, levels and gains as U standard normal numbers, and their best values.

    Attributes:
        readings: the observation vector.
        prior: of the matrix; R of the unknowns.
    """

    readings: Readings
    prior: MaterialPrior

    @cached_property
    def _root(self) -> FloatArray:
        return self._whitening(0.0)

    def _whitening(self, discrepancy: float) -> FloatArray:
        """Inverse root of the valid readings' covariance, (N, N)."""
        data = self.readings
        valid = data.valid.reshape(-1)
        common = data.common.reshape(len(data.common), -1)[:, valid]
        variance = data.variance + (discrepancy * data.value) ** 2
        covariance = np.diag(variance.reshape(-1)[valid]) + common.T @ common
        return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))

    @property
    def size(self) -> int:
        """U: of the matrix, then levels and gains of a chip's visit."""
        own = len(self.prior.root)
        return own if self.readings.resolved else own + sum(self.readings.value.shape[1:])

    def matrix(self, unknown: FloatArray) -> FloatArray:
        """The Donaldson matrix (Wo, Wi) of unknowns (U,)."""
        own = unknown[: len(self.prior.root)]
        return np.asarray(self.prior.mean + np.tensordot(own, self.prior.root, 1))

    def expected(self, lit: Lit, unknown: FloatArray) -> FloatArray:
        """Expected readings, (T, J, K)."""
        return self._expected(lit, self.matrix(unknown), self._factor(unknown))

    def _factor(self, unknown: FloatArray) -> FloatArray:
        _, rows, columns = self.readings.value.shape
        rest = FREE * unknown[len(self.prior.root) :]
        if not rest.size:
            return np.ones((rows, columns))
        return np.asarray(np.exp(rest[:rows, None] + rest[None, rows : rows + columns]))

    def _expected(self, lit: Lit, matrix: FloatArray, factor: FloatArray) -> FloatArray:
        sample = lit.light @ matrix.T @ lit.response.T
        if self.readings.resolved:
            return np.asarray(sample[None])
        white = lit.white_light[:, -len(self.readings.white) :] * self.readings.white
        return np.asarray(np.stack([white @ lit.response.T, sample]) * factor)

    def calibrated(self, lit: Lit, unknown: FloatArray) -> FluorescenceData:
        """The data with lights and channels as these unknowns have them."""
        _, rows, columns = self.readings.value.shape
        rest = np.exp(FREE * unknown[len(self.prior.root) :])
        if not rest.size:
            rest = np.ones(rows + columns)
        system = replace(
            self.readings.data.system, illuminants=lit.light * rest[:rows, None],
            sensitivities=lit.response * rest[rows:, None],
        )  # fmt: skip
        return replace(self.readings.data, system=system)

    def slopes(self, lit: Lit, unknown: FloatArray) -> FloatArray:
        """Derivatives of the readings by the unknowns, (U, T, J, K)."""
        factor = self._factor(unknown)
        moved = lit.light @ np.swapaxes(self.prior.root, 1, 2) @ lit.response.T
        rows = np.zeros((self.size, *self.readings.value.shape))
        rows[: len(moved), -1] = moved * factor
        if not self.readings.resolved:
            now = FREE * self.expected(lit, unknown)
            start, (_, lights, channels) = len(moved), now.shape
            for index in range(lights):
                rows[start + index, :, index] = now[:, index]
            for index in range(channels):
                rows[start + lights + index, :, :, index] = now[:, :, index]
        return rows

    def fitted(
        self, lit: Lit, start: FloatArray | None = None, discrepancy: float = 0.0
    ) -> FloatArray:
        """Most probable unknowns (U,) of the readings under given lights and channels.

        Args:
            lit: lights and channels.
            start: (U,); None starts at the prior's mean.
            discrepancy: relative error of the model that is allowed for beside the noise.
        """
        valid = self.readings.valid.reshape(-1)
        unknown = np.zeros(self.size) if start is None else start
        value = self.readings.value.reshape(-1)[valid]
        root = self._root if discrepancy == 0.0 else self._whitening(discrepancy)
        for _ in range(ROUNDS):
            slope = self.slopes(lit, unknown).reshape(self.size, -1)[:, valid] @ root.T
            left = value - self.expected(lit, unknown).reshape(-1)[valid]
            target = root @ left + unknown @ slope
            inner = np.eye(target.size) + slope.T @ slope
            before, unknown = unknown, slope @ np.linalg.solve(inner, target)
            if self.readings.resolved or np.linalg.norm(unknown - before) < SETTLED:
                break  # without levels and gains one step is exact
        return np.asarray(unknown)

    def robust(self, lit: Lit) -> FloatArray:
        """Unknowns (U,) that no gap has bent: about them the problem is linearised.

        The least of `DISCREPANCIES` that the readings do not contradict is allowed for: none where
        there is no gap, and then these are the most probable unknowns.
        """
        valid = self.readings.valid.reshape(-1)
        value = self.readings.value.reshape(-1)[valid]
        unknown = np.zeros(self.size)
        for discrepancy in DISCREPANCIES:
            unknown = self.fitted(lit, discrepancy=discrepancy)
            left = value - self.expected(lit, unknown).reshape(-1)[valid]
            white = self._whitening(discrepancy) @ left
            if white @ white + unknown @ unknown < value.size + 5.0 * np.sqrt(2.0 * value.size):
                break
        return unknown
