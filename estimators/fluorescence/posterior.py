"""The estimator `fluorescence-posterior`: emcee over Gaussians and the diagonal's MESE."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace

import numpy as np

from estimators.fluorescence.background import BackgroundPrior, Reduced, reduce
from estimators.fluorescence.cells import checked, fingerprint, gather
from estimators.fluorescence.donaldson import DonaldsonEstimator, DonaldsonSettings
from estimators.fluorescence.export import mixture_of
from estimators.fluorescence.mixture_posterior import (
    MULTIPLIER_SCALE,
    MULTIPLIERS,
    MixtureDensity,
    relabelled,
)
from estimators.fluorescence.nonnegative import back_on_captures
from estimators.fluorescence.result import LEVELS, FluorescenceResult, FluorescenceStatus
from estimators.posterior_sampler import Chain, Student, sample
from twin.errors import InputError
from twin.fluorescence.mixture import Gaussian, MixtureModel
from twin.fluorescence.system import FluorescenceData
from twin.spectra import FloatArray

BACKGROUND = BackgroundPrior(reflectance=((0.03, 40.0),))
"""What Gaussians and a MESE of eight moments cannot follow."""

STARTS = 6
LONG_ENOUGH = 10.0
"""Autocorrelation times that a chain must be long."""
COARSE = (2e-2, 6e-3)
"""Amplitudes of the background on the way to the mode."""


@dataclass(frozen=True, kw_only=True)
class FluorescencePosteriorSettings:
    """Options of the estimator `fluorescence-posterior`."""

    gaussians: int = 3
    """Number of Gaussians; the published fit has 6, which one or two fluorophores do not fill."""
    amplitude: float = 2e-3
    """Standard deviation of smooth cells that the Gaussians do not follow."""
    effective_samples: int = 200
    """Wanted; with fewer, or a chain shorter than ten autocorrelation times, the status says so."""
    steps: int = 12000
    """Most steps of the ensemble."""
    draws: int = 400
    seed: int = 1

    def __post_init__(self) -> None:
        for name, low, high in (
            ("gaussians", 1, 12), ("effective_samples", 10, 10**6), ("steps", 10, 10**6),
            ("draws", 2, 10**5), ("seed", 0, 2**31),
        ):  # fmt: skip
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
                raise InputError(f"{value!r}", f"an integer of {low} to {high}", place=name)
        if not self.amplitude > 0.0:
            raise InputError(f"{self.amplitude!r}", "a number above 0", place="amplitude")


class FluorescencePosteriorEstimator:
    """Draws of Gaussians, moments and matrices given the captures and their noise.

    Started at the mode near the estimate of `donaldson`; emcee (Foreman-Mackey et al. 2013) with
    independent proposals from that mode, differential evolution and stretch moves.
    """

    def __init__(self, settings: FluorescencePosteriorSettings | None = None) -> None:
        self._settings = settings or FluorescencePosteriorSettings()

    @property
    def name(self) -> str:
        """Name in the registry and in reports."""
        return "fluorescence-posterior"

    def estimate_batch(self, data: list[FluorescenceData]) -> list[FluorescenceResult]:
        """Estimate several, one after another."""
        return [self.estimate(one) for one in data]

    def estimate(self, data: FluorescenceData) -> FluorescenceResult:
        """Sample the posterior of one sample.

        Raises:
            InputError: captures that cannot be used.
        """
        settings = self._settings
        checked(data)
        captures = gather([data])
        rough = DonaldsonEstimator(DonaldsonSettings(draws=0)).estimate(data)
        # The diagonal is a parameter here: the background holds only what the MESE cannot follow.
        reduced = replace(
            reduce(captures, BACKGROUND, captures.value.shape[1]),
            reflectance=np.clip(rough.reflectance, 0.01, 1.0)[None],
        )
        density = MixtureDensity(reduced, settings.gaussians, settings.amplitude)
        mode, covariance = _best_mode(density, rough, settings.seed)
        proposal = Student.normal(mode, covariance)
        random = np.random.Generator(np.random.Philox(key=settings.seed))
        walkers = 2 * density.size + 2
        scatter = random.standard_normal((walkers, density.size)) @ proposal.factor.T
        chain = sample(
            density.log_probability, mode + 0.5 * scatter,
            np.random.RandomState(settings.seed), proposal=proposal, burn_in=200,
            effective_samples=settings.effective_samples, steps=settings.steps,
        )  # fmt: skip
        scale = np.sqrt(np.diagonal(covariance))
        points, order = relabelled(chain.thinned(settings.draws), mode, scale, settings.gaussians)
        swapped = float(np.mean(np.any(order != np.arange(settings.gaussians), axis=1)))
        drawn = _matrices(density, points, random)
        natural = density.natural(points)
        natural[..., 0] *= 2.0 * np.pi * np.sqrt(natural[..., 3] * natural[..., 4])
        moment = _moments(density, points)
        matrix = drawn.mean(axis=0)
        residual = (
            captures.design.reshape(captures.value.shape[1], -1) @ matrix.reshape(-1)
            - captures.value[0]
        )
        sigma = np.sqrt(np.diagonal(captures.covariance[0]))
        status, messages = rough.status, rough.messages
        length = len(chain.values) / max(chain.autocorrelation_time, 1.0)
        if chain.effective_sample_size < settings.effective_samples or length < LONG_ENOUGH:
            status = FluorescenceStatus.NOT_CONVERGED
            messages = (*messages, _how_short(settings, chain, length))
        return FluorescenceResult(
            estimator=self.name, sample=data.sample, emission_nm=rough.emission_nm,
            excitation_nm=rough.excitation_nm, matrix=matrix,
            standard_deviation=drawn.std(axis=0), quantile_level=LEVELS,
            quantile=np.quantile(drawn, LEVELS, axis=0), undetermined=rough.undetermined,
            status=status, residual=captures.full(residual),
            residual_normalised=captures.full(residual / sigma), settings=asdict(settings),
            fingerprint=fingerprint(data, self.name, asdict(settings)), messages=messages,
            statistics={
                "autocorrelation_time": chain.autocorrelation_time,
                "effective_sample_size": chain.effective_sample_size,
                "acceptance_fraction": chain.acceptance_fraction,
                "share_relabelled": swapped,
            },
            draws=drawn, mixture=_mean_mixture(data, captures.cells.diagonal_nm, natural, moment),
            mixture_draws=natural, moment_draws=moment,
        )  # fmt: skip


def _how_short(settings: FluorescencePosteriorSettings, chain: Chain, length: float) -> str:
    """What a chain that did not converge lacks, and what helps."""
    return (
        f"the chain of {len(chain.values)} steps is {length:.1f} autocorrelation times long"
        f" (wanted: {LONG_ENOUGH:g}) and worth {chain.effective_sample_size:.0f} independent draws"
        f" (wanted: {settings.effective_samples}): its intervals are rough. Allow about"
        f" {_enough(settings, chain, length):.0f} steps, take fewer Gaussians than"
        f" {settings.gaussians}, or the intervals of `donaldson`"
    )


def _enough(settings: FluorescencePosteriorSettings, chain: Chain, length: float) -> float:
    """Steps that would do if the autocorrelation time stayed, rounded up to two digits."""
    size = max(chain.effective_sample_size, 1e-3)
    more = max(LONG_ENOUGH / max(length, 1e-3), settings.effective_samples / size)
    steps = more * len(chain.values)
    unit = 10.0 ** (np.floor(np.log10(steps)) - 1.0)
    return float(np.ceil(steps / unit) * unit)


def _best_mode(
    density: MixtureDensity, rough: FluorescenceResult, seed: int
) -> tuple[FloatArray, FloatArray]:
    """The best of several modes, (P,), and its inverse Hessian, (P, P).

    Each search goes from a background that may explain much to one that explains little.
    """
    random = np.random.Generator(np.random.Philox(key=seed))
    first = _start(density, rough)
    found = []
    for attempt in range(STARTS):
        point = first + 0.3 * (attempt > 0) * random.standard_normal(first.size)
        for amplitude in (*COARSE, density.amplitude):
            point, covariance = replace(density, amplitude=amplitude).mode(point)
        found.append((float(density.log_probability(point[None])[0]), attempt, point, covariance))
    _, _, point, covariance = max(found, key=lambda each: each[:2])
    return point, covariance


def _start(density: MixtureDensity, rough: FluorescenceResult) -> FloatArray:
    model = mixture_of(rough, density.gaussians)
    natural = np.array(
        [
            [g.weight, g.excitation_nm, g.emission_nm, g.excitation_variance_nm2,
             g.emission_variance_nm2]
            for g in model.gaussians
        ]
    )  # fmt: skip
    natural[:, 0] /= 2.0 * np.pi * np.sqrt(natural[:, 3] * natural[:, 4])
    angle = np.tan(np.pi * (np.clip(rough.reflectance, 0.02, 0.98) - 0.5))
    ridge = np.diag(0.1 / MULTIPLIER_SCALE**2)
    basis = density.basis
    multipliers = np.linalg.solve(basis.T @ basis + ridge, basis.T @ angle)
    return density.whitened(natural, np.asarray(multipliers, dtype=np.float64))


def _matrices(
    density: MixtureDensity, points: FloatArray, random: np.random.Generator
) -> FloatArray:
    """Matrices (K, Wo, Wi) of points (K, P), with draws of the background given each."""
    reduced: Reduced = density.reduced
    cells = reduced.captures.cells
    prior = reduced.kernels.draws(len(points), int(random.integers(2**31)))
    factor = np.linalg.cholesky(reduced.noise[0])
    noise = random.standard_normal((len(points), len(factor))) @ factor.T
    background = density.amplitude * prior.cell + reduced.roughness[0] * prior.rough
    background[:, reduced.kernels.near] += prior.leak * reduced.leak_scale[0]
    cell = density.fluorescence(points)
    reflectance = density.reflectance(points)
    left = reduced.value[0] - noise
    left -= cell.reshape(len(points), -1) @ reduced.design.reshape(len(reduced.design), -1).T
    deviation = reflectance - reduced.prior.reflectance_mean + prior.diagonal
    left -= background @ reduced.cell_design.T + deviation @ reduced.diagonal_design.T
    gain = reduced.gain(density.amplitude, 0)
    move = np.asarray(np.linalg.solve(reduced.covariance(density.amplitude, 0), gain))
    size = background.shape[1]
    free = np.concatenate(
        [cell[:, cells.below_diagonal] + background, reflectance + prior.diagonal], axis=1
    )
    design = np.concatenate([reduced.cell_design, reduced.diagonal_design], axis=1)
    found = back_on_captures(free + left @ move, design, move, size)
    return cells.matrix(found[:, :size], found[:, size:])


def _moments(density: MixtureDensity, points: FloatArray) -> FloatArray:
    from twin.fluorescence.mese import moments

    grid = density.reduced.captures.cells.diagonal_nm
    span = (float(grid[0]), float(grid[-1]))
    signal = density.reflectance(points)
    return np.asarray(moments(signal, MULTIPLIERS, wavelength_nm=grid, range_nm=span))


def _mean_mixture(
    data: FluorescenceData, grid: FloatArray, natural: FloatArray, moment: FloatArray
) -> MixtureModel:
    middle = np.median(natural, axis=0)
    return MixtureModel(
        name=data.sample, range_nm=(float(grid[0]), float(grid[-1])),
        gaussians=tuple(
            Gaussian(
                weight=float(p[0]), excitation_nm=float(p[1]), emission_nm=float(p[2]),
                excitation_variance_nm2=float(p[3]), emission_variance_nm2=float(p[4]),
            )
            for p in middle
        ),
        moments=tuple(float(c) for c in moment.mean(axis=0)),
    )  # fmt: skip
