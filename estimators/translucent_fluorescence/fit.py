"""Gauss-Newton fit of host and fluorescence together, with intervals; and the blind fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from estimators.translucent_fluorescence.data import LedMeasurement
from estimators.translucent_fluorescence.model import HOST, FluorescentForward, State
from twin.errors import InputError
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from twin.bench import Bench, Sample
    from twin.bispectral import FluorescentProperties

MOST_STEPS = 60
REWEIGHTED = 2
REEMITTED = 0.03
"""Relative error of a fluorescence whose further re-emissions are left out."""
SETTLED = 0.02
"""Gain in chi-square below which a step is the last."""
Z90 = 1.6448536269514722


@dataclass(frozen=True)
class Prior:
    """What is assumed beforehand: smoothness, and weak centres that data override.

    Attributes:
        centre: of log sigma_a, log sigma_s', artanh g (coefficients in 1/mm); width: standard
            deviations of them.
        bend: standard deviation of the second difference of each over 20 nm.
        fluorescence: centre and standard deviation of log excitation and log emission
            coefficients; fluorescence_bend: of their second differences between knots.
    """

    centre: tuple[float, float, float] = (-2.5, 0.5, 0.5)
    width: tuple[float, float, float] = (3.0, 2.0, 1.0)
    bend: tuple[float, float, float] = (1.0, 0.1, 0.1)
    fluorescence: tuple[float, float] = (-5.0, 4.0)
    fluorescence_bend: float = 1.5

    def rows(self, model: FluorescentForward) -> tuple[FloatArray, FloatArray]:
        """Whitened prior: (matrix (R, P), target (R,)) of |matrix v - target|^2."""
        waves = len(model.wavelength_nm)
        total = model.coordinates
        rows, target = [], []

        def add(entries: dict[int, float], wanted: float, deviation: float) -> None:
            row = np.zeros(total)
            for column, value in entries.items():
                row[column] = value / deviation
            rows.append(row)
            target.append(wanted / deviation)

        step = float(np.median(np.diff(model.wavelength_nm))) / 20.0
        for p in range(HOST):
            for w in range(waves):
                add({HOST * w + p: 1.0}, self.centre[p], self.width[p])
            for w in range(1, waves - 1):
                ends = {HOST * (w - 1) + p: 1.0, HOST * w + p: -2.0, HOST * (w + 1) + p: 1.0}
                add(ends, 0.0, self.bend[p] * step**2)
        at = HOST * waves
        for size, centre in (
            (model.excitation.size, self.fluorescence[0]),
            (model.emission.size, 0.0),
        ):
            for k in range(size):
                add({at + k: 1.0}, centre, self.fluorescence[1])
            for k in range(1, size - 1):
                bend = {at + k - 1: 1.0, at + k: -2.0, at + k + 1: 1.0}
                add(bend, 0.0, self.fluorescence_bend)
            at += size
        return np.array(rows), np.array(target)


@dataclass(frozen=True, eq=False)
class FluorescentEstimate:
    """Host and fluorescence with intervals; W wavelengths.

    Attributes:
        wavelength_nm: (W,).
        state, covariance: unknowns and their covariance, (P, P).
        albedo, g: (W,); sigma_t_per_mm: [1/mm], with the fluorophore, (W,).
        sigma_a_per_mm, sigma_s_prime_per_mm: [1/mm], (W,); sigma_a with the fluorophore.
        excitation_per_mm: quantum yield times the fluorophore's absorption [1/mm], (W,).
        emission_per_nm: photons per nm, normalised, (W,).
        source: energy emitted at o per nm, per length and fluence at i [1/mm/nm], (W, W).
        integrated: sum of the source over both wavelengths [nm/mm]: its strength under light
            of one power per nm.
        log_sigma_a_sd, log_sigma_s_prime_sd, g_sd, log_excitation_sd: standard deviations, (W,);
        integrated_sd: relative standard deviation of `integrated`.
        chi_square, degrees: of the data; steps: of the solver; converged.
    """

    wavelength_nm: FloatArray
    state: State
    covariance: FloatArray
    albedo: FloatArray
    sigma_t_per_mm: FloatArray
    g: FloatArray
    sigma_a_per_mm: FloatArray
    sigma_s_prime_per_mm: FloatArray
    excitation_per_mm: FloatArray
    emission_per_nm: FloatArray
    source: FloatArray
    integrated: float
    log_sigma_a_sd: FloatArray
    log_sigma_s_prime_sd: FloatArray
    g_sd: FloatArray
    log_excitation_sd: FloatArray
    integrated_sd: float
    chi_square: float
    degrees: int
    steps: int
    converged: bool

    def interval(self, name: str) -> tuple[FloatArray, FloatArray]:
        """90 % interval of "sigma_a", "sigma_s_prime", "g", "excitation" or "integrated".

        Shape (W,) each; that of "integrated" is scalar.

        Raises:
            InputError: another name.
        """
        logs = {
            "sigma_a": (self.sigma_a_per_mm, self.log_sigma_a_sd),
            "sigma_s_prime": (self.sigma_s_prime_per_mm, self.log_sigma_s_prime_sd),
            "excitation": (self.excitation_per_mm, self.log_excitation_sd),
            "integrated": (np.asarray(self.integrated), np.asarray(self.integrated_sd)),
        }
        if name == "g":
            return self.g - Z90 * self.g_sd, self.g + Z90 * self.g_sd
        if name not in logs:
            raise InputError(f'the quantity "{name}"', f"g, {', '.join(logs)}", place="interval")
        value, deviation = logs[name]
        factor = np.exp(Z90 * deviation)
        return np.asarray(value / factor), np.asarray(value * factor)

    def properties(self) -> FluorescentProperties:
        """The estimate as the transport engines take it; absorption is the host's and the dye's."""
        from twin.bispectral import FluorescentProperties, bin_widths

        scattering = self.albedo * self.sigma_t_per_mm
        return FluorescentProperties(
            self.wavelength_nm, bin_widths(self.wavelength_nm), self.sigma_a_per_mm, scattering,
            self.g, np.zeros_like(scattering), self.source,
        )  # fmt: skip


def start(model: FluorescentForward, prior: Prior) -> State:
    """Where the fit begins: the prior's centre, a weak fluorescence, flat spectra."""
    host = np.tile(np.asarray(prior.centre), (len(model.wavelength_nm), 1))
    return State(
        host,
        np.full(model.excitation.size, prior.fluorescence[0]),
        np.zeros(model.emission.size),
    )


@dataclass(frozen=True)
class _Solved:
    state: State
    covariance: FloatArray
    chi_square: float
    steps: int
    converged: bool


def _solve(
    model: FluorescentForward,
    measurement: LedMeasurement,
    prior: Prior,
    first: State,
    engine: tuple[float, float],
    free: np.ndarray,
    known: bool = False,
) -> _Solved:
    """The fit; what is proportional to the light is weighed by a fit of its own before."""

    def covariance(state: State) -> FloatArray:
        lights = measurement.lights
        parts = (model.predict(state, lights), model.emitted(state, lights))
        return measurement.covariance(engine[0], *parts, engine[1])

    begin = covariance(first) if known else measurement.covariance()
    solved = _minimise(model, measurement, prior, first, begin, free)
    for _ in range(REWEIGHTED):
        weight = covariance(solved.state)
        again = _minimise(model, measurement, prior, solved.state, weight, free)
        solved = replace(again, steps=again.steps + solved.steps)
    return solved


def _minimise(
    model: FluorescentForward,
    measurement: LedMeasurement,
    prior: Prior,
    first: State,
    covariance: FloatArray,
    free: np.ndarray,
) -> _Solved:
    """Levenberg-Marquardt on the whitened data and prior, over the free coordinates."""
    # whitened once: the covariance stays the same over the steps
    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    matrix, target = prior.rows(model)
    data, lights = measurement.values, measurement.lights

    def terms(state: State) -> tuple[FloatArray, FloatArray, float]:
        value, slope = model.jacobian(state, lights)
        whitened = whiten @ np.column_stack([data - value, slope])
        residual = np.concatenate([whitened[:, 0], target - matrix @ state.vector])
        slopes = np.concatenate([whitened[:, 1:], matrix])[:, free]
        return residual, slopes, float(whitened[:, 0] @ whitened[:, 0])

    state, damping = first, 1e-2
    residual, slopes, chi_square = terms(state)
    converged, steps = False, 0
    while steps < MOST_STEPS and not converged:
        steps += 1
        normal = slopes.T @ slopes
        gain = slopes.T @ residual
        cost = residual @ residual
        while True:
            damped = normal + damping * np.diag(np.diag(normal))
            move = np.zeros(len(free))
            move[free] = np.clip(np.linalg.solve(damped, gain), -1.5, 1.5)
            trial = state.moved(state.vector + move)
            found = terms(trial)
            if found[0] @ found[0] <= cost or damping > 1e9:
                break
            damping *= 4.0
        if damping > 1e9:
            break
        # what is left to gain, in units of chi-square
        converged = float(gain @ move[free]) < SETTLED
        state, (residual, slopes, chi_square) = trial, found
        damping = max(damping / 6.0, 1e-9)
    spread = np.zeros((len(free), len(free)))
    spread[np.ix_(free, free)] = np.linalg.inv(slopes.T @ slopes)
    return _Solved(state, spread, chi_square, steps, converged)


def _described(model: FluorescentForward, solved: _Solved, degrees: int) -> FluorescentEstimate:
    state, covariance = solved.state, solved.covariance
    waves = len(model.wavelength_nm)
    albedo, total, g = state.material
    deviation = np.sqrt(np.diag(covariance))[: HOST * waves].reshape(waves, HOST)
    source = model.source(state)
    excites = slice(HOST * waves, HOST * waves + model.excitation.size)
    own = model.excitation.matrix
    log_sd = np.sqrt(np.einsum("wx,xy,wy->w", own, covariance[excites, excites], own))
    step, share = model.step_nm, model.step_nm * model.emits(state)
    integrated = float(step @ source @ step)
    cells = step[:, None] * source * step / max(integrated, 1e-300)
    slope = np.zeros(model.coordinates)
    slope[excites] = cells.sum(axis=0) @ own
    turned = model.emission.matrix - share @ model.emission.matrix
    slope[excites.stop :] = cells.sum(axis=1) @ turned
    return FluorescentEstimate(
        wavelength_nm=model.wavelength_nm,
        state=state,
        covariance=covariance,
        albedo=albedo,
        sigma_t_per_mm=total,
        g=g,
        sigma_a_per_mm=np.exp(state.host[:, 0]),
        sigma_s_prime_per_mm=np.exp(state.host[:, 1]),
        excitation_per_mm=model.excites(state),
        emission_per_nm=model.emits(state),
        source=source,
        integrated=integrated,
        log_sigma_a_sd=deviation[:, 0],
        log_sigma_s_prime_sd=deviation[:, 1],
        g_sd=deviation[:, 2] * (1.0 - g**2),
        log_excitation_sd=np.where(model.excitation.inside, log_sd, np.nan),
        integrated_sd=float(np.sqrt(slope @ covariance @ slope)),
        chi_square=solved.chi_square,
        degrees=degrees,
        steps=solved.steps,
        converged=solved.converged,
    )


def estimate(
    measurement: LedMeasurement,
    bench: Bench,
    samples: Sequence[Sample],
    *,
    model: FluorescentForward | None = None,
    prior: Prior | None = None,
    engine: float = 2e-3,
    paths: int = 0,
    rounds: int = 1,
    seed: int = 0,
    threads: int | None = None,
) -> FluorescentEstimate:
    """Absorption, scattering and fluorescence of one material, together.

    Gauss-Newton on all data at once, the covariance of the answer from its last step. With
    `paths` the fit is repeated with what a Monte Carlo at the first answer says of the finite
    bench and of light that is emitted more than once; without it 4 to 5 % of a strong
    fluorescence is that light, and is counted twice.

    Args:
        measurement: of the samples on the bench.
        bench: the bench.
        samples: on it; their material is never looked at.
        model: another model than the default one of the bench.
        prior: None: the default one.
        engine: relative error of the forward model, in the covariance of the data.
        paths: of the Monte Carlo for each wavelength and sample; 0: none.
        rounds: how often the correction is renewed.
        seed: of the Monte Carlo.
        threads: None takes all processors.

    Raises:
        InputError: a bench that plane-parallel layers cannot show, or other wavelengths.
    """
    from estimators.translucent_fluorescence.correction import correction_of

    wave = measurement.wavelength_nm
    own = model or FluorescentForward.of(bench, samples, wave)
    if not np.array_equal(own.wavelength_nm, wave) or len(samples) != len(measurement.collimated):
        raise InputError(
            "a model of other wavelengths or samples", "those of the measurement", place="model"
        )
    belief = prior or Prior()
    free = np.ones(own.coordinates, dtype=bool)
    solved = _solve(own, measurement, belief, start(own, belief), (engine, REEMITTED), free)
    degrees = len(measurement.values) - own.coordinates
    for number in range(rounds if paths else 0):
        found = _described(own, solved, degrees)
        correction = correction_of(
            bench, samples, found.properties(), paths=paths, seed=seed + 1000 * number,
            threads=threads,
        )  # fmt: skip
        own = own.corrected(correction)
        spread = float(np.hypot(engine, correction.error))
        both = (spread, correction.emission_error)
        solved = _solve(own, measurement, belief, solved.state, both, free, known=True)
    return _described(own, solved, degrees)


def estimate_blind(
    measurement: LedMeasurement,
    bench: Bench,
    samples: Sequence[Sample],
    *,
    model: FluorescentForward | None = None,
    prior: Prior | None = None,
    engine: float = 2e-3,
) -> FluorescentEstimate:
    """The same fit without fluorescence in the model: what the seed's method would answer.

    Its measurement has one broad light; all of its signal is taken for reflected light.
    """
    own = model or FluorescentForward.of(bench, samples, measurement.wavelength_nm)
    belief = prior or Prior()
    first = start(own, belief)
    nothing = State(first.host, np.full(own.excitation.size, -60.0), first.emission)
    free = np.zeros(own.coordinates, dtype=bool)
    free[: first.host.size] = True
    solved = _solve(own, measurement, belief, nothing, (engine, 0.0), free)
    return _described(own, solved, len(measurement.values) - int(free.sum()))
