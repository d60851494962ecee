"""General-purpose optimisers on the weighted sum of squares, one wavelength at a time.

For comparison and teaching (seed sections 3.3.4 and 3.3.5): all of them reach the minimum that
least squares reaches, with many more looks at the engine. Valid where the fast engine is: a
plane-parallel stack and a Henyey-Greenstein phase function with g of -0.9 to 0.97, sigma_t
between optical depths of 0.002 and 60 at the mean thickness.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from queue import SimpleQueue
from threading import Thread
from typing import Any, NamedTuple

import numpy as np

from estimators.objective import Objective, Solved
from estimators.protocol import BenchModel
from estimators.result import EstimateResult
from twin.errors import InputError
from twin.measurement.relative import RelativeIntensities
from twin.spectra import FloatArray

VALID = (
    "{name} is valid where the fast engine is (plane-parallel stack, Henyey-Greenstein phase"
    " function); it finds the minimum nearest to the best point of a coarse grid, and its"
    " covariance is that of the linearised engine there"
)
FIRST_STEP = 0.3
"""Edge of the first simplex and length of the first steps, in coordinates."""


@dataclass(frozen=True)
class SearchSettings:
    """Options of `nelder-mead` and `powell`."""

    evaluations: int = 1500
    """Looks at chi-square for each wavelength before the search counts as not converged."""
    tolerance: float = 1e-6
    """Change of the coordinates and of chi-square below which a search stops."""
    lost_sigma: float = 3.0
    """Captures that contradict each other by more standard errors are contradictory."""

    def __post_init__(self) -> None:
        """Reject what cannot be meant.

        Raises:
            InputError: an option out of its range.
        """
        _above("evaluations", self.evaluations, 1)
        _above("tolerance", self.tolerance, 0.0)
        _above("lost_sigma", self.lost_sigma, 0.0)


@dataclass(frozen=True)
class AdamSettings:
    """Options of `adam`."""

    steps: int = 700
    rate: float = 0.1
    """Length of the first step in coordinates."""
    lost_sigma: float = 3.0
    """Captures that contradict each other by more standard errors are contradictory."""

    def __post_init__(self) -> None:
        """Reject what cannot be meant.

        Raises:
            InputError: an option out of its range.
        """
        _above("steps", self.steps, 1)
        _above("rate", self.rate, 0.0)
        _above("lost_sigma", self.lost_sigma, 0.0)


class _Search:
    """A method of scipy.optimize on chi-square, every wavelength for itself."""

    name = ""

    def __init__(self, model: BenchModel, settings: SearchSettings | None = None) -> None:
        self.model = model
        self.settings = settings or SearchSettings()

    def estimate(self, intensities: RelativeIntensities) -> EstimateResult:
        """Estimate the material; see `estimators.protocol.Estimator`."""
        objective = Objective(self.model, intensities, self.settings.lost_sigma)
        theta = objective.start()
        settled, looks = np.ones(len(theta), dtype=bool), np.zeros(len(theta))
        which = np.flatnonzero(objective.solvable)

        def evaluate(points: FloatArray) -> FloatArray:
            every = theta.copy()
            every[which] = points
            return objective.chi_square(every)[which]

        for w, end in zip(which, side_by_side(self._solve, theta[which], evaluate), strict=True):
            settled[w], looks[w] = end.settled, end.evaluations
            theta[w] = end.x
        return objective.result(
            self.name,
            Solved(
                theta=theta,
                settled=settled,
                evaluations=looks,
                settings=asdict(self.settings),
                messages=(VALID.format(name=self.name),),
            ),
        )

    def _solve(self, look: Callable[[FloatArray], float], start: FloatArray) -> End:
        raise TypeError(f"found {type(self).__name__}; expected one of its methods")


class NelderMeadEstimator(_Search):
    """The simplex of Nelder & Mead (1965), Computer J. 7, 308-313, by scipy.optimize.

    Valid where the fast engine is; needs no derivatives. Started twice, the second time from
    where the first ended: a simplex can collapse before it has arrived.
    """

    name = "nelder-mead"

    def _solve(self, look: Callable[[FloatArray], float], start: FloatArray) -> End:
        from scipy.optimize import minimize

        spent, found = 0, None
        for edge in (FIRST_STEP, 0.1 * FIRST_STEP):
            simplex = np.vstack([start, start + edge * np.eye(start.size)])
            options = {
                "initial_simplex": simplex,
                "maxfev": self.settings.evaluations - spent,
                "xatol": self.settings.tolerance,
                "fatol": self.settings.tolerance,
            }
            found = minimize(look, start, method="Nelder-Mead", options=options)
            start, spent = found.x, spent + int(found.nfev)
            if not found.success:
                return End(start, False, spent)
        return End(start, True, spent)


class PowellEstimator(_Search):
    """Conjugate directions of Powell (1964), Computer J. 7, 155-162, by scipy.optimize.

    Valid where the fast engine is; needs no derivatives.
    """

    name = "powell"

    def _solve(self, look: Callable[[FloatArray], float], start: FloatArray) -> End:
        from scipy.optimize import minimize

        options = {
            "maxfev": self.settings.evaluations,
            "xtol": self.settings.tolerance,
            "ftol": self.settings.tolerance,
            "direc": FIRST_STEP * np.eye(start.size),
        }
        found = minimize(look, start, method="Powell", options=options)
        return End(np.asarray(found.x), bool(found.success), int(found.nfev))


class AdamEstimator:
    """Adaptive moments of Kingma & Ba (2015), "Adam", algorithm 1, all wavelengths at once.

    Valid where the fast engine is; uses its derivatives. The step length falls to zero along a
    cosine (Loshchilov & Hutter 2017), or the estimate would circle the minimum for ever; where
    it did not get there in time it says NOT_CONVERGED.
    """

    name = "adam"

    def __init__(self, model: BenchModel, settings: AdamSettings | None = None) -> None:
        self.model = model
        self.settings = settings or AdamSettings()

    def estimate(self, intensities: RelativeIntensities) -> EstimateResult:
        """Estimate the material; see `estimators.protocol.Estimator`."""
        options = self.settings
        objective = Objective(self.model, intensities, options.lost_sigma)
        theta = adam(
            lambda at: objective.linear(at).slope,
            objective.start(),
            0.5 * options.rate * (1.0 + np.cos(np.linspace(0.0, np.pi, options.steps))),
        )
        return objective.result(
            self.name,
            Solved(
                theta=theta,
                settled=np.ones(len(theta), dtype=bool),
                evaluations=np.full(len(theta), float(options.steps)),
                settings=asdict(options),
                messages=(VALID.format(name=self.name),),
            ),
        )


def adam(
    gradient: Callable[[FloatArray], FloatArray],
    start: FloatArray,
    rates: FloatArray,
    *,
    first: float = 0.9,
    second: float = 0.99,
) -> FloatArray:
    """Where Adam ends, shape of the start.

    Args:
        gradient: of what is minimised, in the shape of its argument.
        start: any shape.
        rates: length of every step, shape (steps,).
        first: decay of the mean of the gradients (beta 1).
        second: decay of the mean of their squares (beta 2).
    """
    theta, mean, square = start.copy(), np.zeros_like(start), np.zeros_like(start)
    for step, rate in enumerate(rates, 1):
        slope = gradient(theta)
        mean = first * mean + (1.0 - first) * slope
        square = second * square + (1.0 - second) * slope**2
        length = np.sqrt(square / (1.0 - second**step))
        theta = theta - rate * mean / (1.0 - first**step) / (length + 1e-12)
    return theta


class End(NamedTuple):
    """Where one search stopped: coordinates (3,), whether content, looks at the function."""

    x: FloatArray
    settled: bool
    evaluations: int


def side_by_side(
    solve: Callable[[Callable[[FloatArray], float], FloatArray], End],
    start: FloatArray,
    evaluate: Callable[[FloatArray], FloatArray],
) -> list[End]:
    """Run one search per row, and look at the function for all of them at once.

    A search of scipy calls back for one point; the engine costs as much for one point as for
    many. So every search waits in a thread of its own until all the others have asked too.

    Args:
        solve: called with a function (3,) to float and a start (3,).
        start: shape (N, 3).
        evaluate: from points (N, 3) to values (N,); called in the caller's thread alone.
    """
    count = len(start)
    asked: SimpleQueue[tuple[int, FloatArray | None, Any]] = SimpleQueue()
    answers: list[SimpleQueue[float]] = [SimpleQueue() for _ in range(count)]

    def search(row: int) -> None:
        def look(point: FloatArray) -> float:
            asked.put((row, np.array(point), None))
            return answers[row].get()

        try:
            asked.put((row, None, solve(look, start[row].copy())))
        except (ArithmeticError, ValueError) as error:
            asked.put((row, None, error))

    points = start.copy()
    ends: list[Any] = [None] * count
    for row in range(count):
        Thread(target=search, args=(row,), daemon=True).start()
    running = count
    while running:
        waiting = []
        for row, point, end in [asked.get() for _ in range(running)]:
            if point is None:
                ends[row] = end
            else:
                points[row] = point
                waiting.append(row)
        running = len(waiting)
        if running:
            values = evaluate(points)
            for row in waiting:
                answers[row].put(float(values[row]))
    for end in ends:
        if isinstance(end, Exception):
            raise end
    return ends


def _above(place: str, found: float, least: float) -> None:
    if not found > least:
        raise InputError(f"{found:g}", f"a number above {least:g}", place=place)
