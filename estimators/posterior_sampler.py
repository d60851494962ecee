"""emcee on a vectorised log-probability: mixed moves, autocorrelation time, a verdict.

Moves: a Metropolis step with independent proposals from a Student distribution fitted to the
posterior, differential evolution (Nelson et al. 2013) and the stretch move (Goodman and Weare
2010). emcee's snooker move is left out: in 3.1.6 its proposals are not balanced (a standard
normal in three dimensions comes out with variance 0.79).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from twin.spectra import FloatArray

STUDENT = 6.0
"""Degrees of freedom of the independent proposals: heavier tails than a posterior's."""
BLOCK = 100
ENOUGH = 50.0
"""Autocorrelation times that a chain must be long to be called converged."""

LogProbability = Callable[[FloatArray], FloatArray]
"""Points (K, N) to (K,)."""


@dataclass(frozen=True, eq=False)
class Chain:
    """What the sampler leaves.

    Attributes:
        values: (steps, walkers, N), burn-in left out.
        autocorrelation_time: of the slowest parameter [steps].
        acceptance_fraction: mean over walkers.
        converged: whether the chain is long enough and has the effective samples wanted.
    """

    values: FloatArray
    autocorrelation_time: float
    acceptance_fraction: float
    converged: bool

    @property
    def effective_sample_size(self) -> float:
        """Draws of all walkers over the autocorrelation time."""
        steps, walkers, _ = self.values.shape
        return float(steps * walkers / max(self.autocorrelation_time, 1.0))

    def thinned(self, draws: int) -> FloatArray:
        """Evenly spaced draws, shape (draws, N)."""
        flat = self.values.reshape(-1, self.values.shape[-1])
        return np.asarray(flat[np.linspace(0, len(flat) - 1, draws).round().astype(np.intp)])


@dataclass(frozen=True, eq=False)
class Student:
    """A multivariate Student distribution.

    Attributes:
        centre: (N,); factor: lower factor of its scale matrix, (N, N); inverse: of the factor.
    """

    centre: FloatArray
    factor: FloatArray
    inverse: FloatArray

    @classmethod
    def of(cls, points: FloatArray) -> Student:
        """Fitted to points (K, N)."""
        return cls.normal(points.mean(axis=0), np.atleast_2d(np.cov(points.T)))

    @classmethod
    def normal(cls, centre: FloatArray, covariance: FloatArray) -> Student:
        """As wide as a normal distribution with this covariance (N, N)."""
        ridge = np.diag(np.diagonal(covariance) * 1e-9 + 1e-300)
        factor: FloatArray = np.asarray(np.linalg.cholesky(covariance + ridge), dtype=np.float64)
        return cls(centre, factor, np.asarray(np.linalg.inv(factor), dtype=np.float64))

    def propose(self, coordinates: FloatArray, random: Any) -> tuple[FloatArray, FloatArray]:
        """Proposals and ln q(x) - ln q(x') for emcee's `MHMove`, of points (K, N)."""
        count, size = coordinates.shape
        normal = random.standard_normal((count, size))
        scale = np.sqrt(STUDENT / random.chisquare(STUDENT, count))
        proposed = self.centre + (normal * scale[:, None]) @ self.factor.T
        return proposed, self._log(coordinates) - self._log(proposed)

    def _log(self, points: FloatArray) -> FloatArray:
        z = (points - self.centre) @ self.inverse.T
        power = -0.5 * (STUDENT + points.shape[1])
        return np.asarray(power * np.log1p((z**2).sum(axis=1) / STUDENT))


def sample(
    log_probability: LogProbability,
    first: FloatArray,
    random_state: np.random.RandomState,
    *,
    proposal: Student | None = None,
    burn_in: int = 50,
    effective_samples: int = 1000,
    steps: int = 6000,
) -> Chain:
    """Run one ensemble until it is long enough, or the limit of steps is reached.

    Args:
        log_probability: vectorised; minus infinity where a point is not allowed.
        first: positions of the walkers, (walkers, N).
        random_state: all the randomness there is.
        proposal: for independent proposals; None: ensemble moves alone.
        burn_in: steps that are left out.
        effective_samples: wanted.
        steps: most steps.
    """
    import emcee

    walkers, size = first.shape
    ensemble = [(emcee.moves.DEMove(), 0.85), (emcee.moves.StretchMove(), 0.15)]
    moves = ensemble
    if proposal is not None:
        moves = [(move, 0.5 * weight) for move, weight in ensemble]
        moves.append((emcee.moves.MHMove(proposal.propose), 0.5))
    sampler = emcee.EnsembleSampler(walkers, size, log_probability, vectorize=True, moves=moves)
    state = emcee.State(first, random_state=random_state.get_state())
    state = sampler.run_mcmc(state, burn_in, skip_initial_state_check=True)
    sampler.reset()
    tau, enough, run = np.inf, False, 0
    block = BLOCK
    while run < steps and not enough:
        block = min(block, steps - run)
        state = sampler.run_mcmc(state, block, skip_initial_state_check=True)
        run += block
        tau = autocorrelation_time(sampler.get_chain())
        wanted = max(ENOUGH * tau, effective_samples * tau / walkers)
        enough = bool(run >= wanted)
        block = int(min(max(wanted - run, BLOCK / 2), 2 * run)) + 1
    return Chain(
        np.asarray(sampler.get_chain()), tau, float(np.mean(sampler.acceptance_fraction)), enough
    )


def autocorrelation_time(values: FloatArray) -> float:
    """Integrated autocorrelation time of the slowest parameter, of (steps, walkers, N) [steps].

    Source: Sokal (1996), as in emcee, with the mean over walkers taken off all walkers alike;
    at least 1. Infinite where a parameter never moved.
    """
    steps = len(values)
    moved = values - values.mean(axis=(0, 1))
    length = 1 << (2 * steps - 1).bit_length()
    spectrum = np.fft.rfft(moved, n=length, axis=0)
    power = (spectrum.real**2 + spectrum.imag**2).mean(axis=1)
    correlation = np.fft.irfft(power, n=length, axis=0)[:steps]
    if not np.all(correlation[0] > 0.0):
        return float("inf")
    times = 2.0 * np.cumsum(correlation / correlation[0], axis=0) - 1.0
    longest = 1.0
    for time in times.T:
        short = np.arange(steps) < 5.0 * time
        window = int(np.argmin(short)) if not short.all() else steps - 1
        longest = max(longest, float(time[window]))
    return longest
