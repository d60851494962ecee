"""The estimator `gmm-adam`: the published fit of six Gaussians and a free diagonal by Adam.

Source: Iser, Lachiver, Wilkie 2023, section 3.4, as published: loss = Euclidean norm of the
difference (equation 4), three loops with decreasing steps, each from the best of the one before,
then the bounded MESE of the diagonal with eight moments (Peters et al. 2019). It knows no noise
and gives no interval. What the text leaves open, and what is done here:

- illuminants and sensitivities are scaled to a common peak of 1, as in its figure 6;
- the means are read as (excitation, emission) = (400, 400), (550, 550), (700, 700), (400, 550),
  (400, 700), (550, 700) nm: "every corner of the triangle" in which emission is longer;
- the penalty of a diagonal outside [0, 1] is 100 times the sum of the squared excess;
- weights stay at 0 or above and variances at 100 nm^2 or above by projection after every step;
- Adam's own constants are those of Kingma and Ba 2015, and its averages start anew in every loop.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from estimators.fluorescence.cells import Captures, checked, fingerprint, gather, groups
from estimators.fluorescence.result import LEVELS, FluorescenceResult, FluorescenceStatus
from twin.errors import InputError
from twin.fluorescence.mixture import Gaussian, MixtureModel
from twin.fluorescence.system import FluorescenceData
from twin.spectra import FloatArray

LOOPS = ((100, 0.10), (200, 0.05), (800, 0.02))
"""Iterations and step of every loop."""
DIAGONAL_STEP, GAUSSIAN_STEP = 0.05, 200.0
START_MEANS = ((400, 400), (550, 550), (700, 700), (400, 550), (400, 700), (550, 700))
"""Means (excitation, emission) [nm] at the start."""
START_VARIANCE, START_WEIGHT, START_DIAGONAL = 4000.0, 100.0, 0.5
PENALTY = 100.0
SMALLEST_VARIANCE = 100.0
MOMENTS = 8

Parameters = dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class GmmAdamSettings:
    """Options of the estimator `gmm-adam`."""

    whole_program: bool = True
    """Compile the whole fit as one program; False: compile one gradient, and loop in Python, as
    the published code does (slow, for comparing times)."""
    mese: bool = True
    """Replace the fitted diagonal by its bounded MESE, as published."""

    def __post_init__(self) -> None:
        for name in ("whole_program", "mese"):
            if not isinstance(getattr(self, name), bool):
                raise InputError(f"{getattr(self, name)!r}", "true or false", place=name)


class GmmAdamEstimator:
    """The seed's estimator (Iser et al. 2023): a Gaussian mixture by Adam, then bounded MESE."""

    def __init__(self, settings: GmmAdamSettings | None = None) -> None:
        self._settings = settings or GmmAdamSettings()

    @property
    def name(self) -> str:
        """Name in the registry and in reports."""
        return "gmm-adam"

    def estimate(self, data: FluorescenceData) -> FluorescenceResult:
        """Estimate one matrix.

        Raises:
            InputError: captures that cannot be used; a matrix that is not 400 to 700 nm.
        """
        return self.estimate_batch([data])[0]

    def estimate_batch(self, data: list[FluorescenceData]) -> list[FluorescenceResult]:
        """Estimate several, one after another."""
        results: dict[int, FluorescenceResult] = {}
        for one in data:
            checked(one)
        for group in groups(data):
            captures = gather([data[index] for index in group])
            for row, index in enumerate(group):
                results[index] = self._one(data[index], captures, captures.value[row])
        return [results[index] for index in range(len(data))]

    def _one(
        self, data: FluorescenceData, captures: Captures, value: FloatArray
    ) -> FluorescenceResult:
        from twin.fluorescence.mese import moments, reconstruct

        system = data.system
        light, sight = float(system.illuminants.max()), float(system.sensitivities.max())
        given = captures.full(value) / (light * sight)
        valid = np.isfinite(given)
        grid = captures.cells
        fit = _program(
            self._settings.whole_program, tuple(grid.emission_nm), tuple(grid.excitation_nm)
        )
        best, loss = fit(
            np.where(valid, given, 0.0), valid.astype(np.float64),
            system.illuminants / light, system.sensitivities / sight,
        )  # fmt: skip
        fitted = {name: np.asarray(array, dtype=np.float64) for name, array in best.items()}
        cells = _fluorescence(fitted, grid.emission_nm, grid.excitation_nm)
        free = fitted["diagonal"]
        span = (float(grid.diagonal_nm[0]), float(grid.diagonal_nm[-1]))
        moment = np.asarray(
            moments(free, MOMENTS, wavelength_nm=grid.diagonal_nm, range_nm=span), dtype=np.float64
        )
        smooth = np.asarray(reconstruct(moment, grid.diagonal_nm, span).value, dtype=np.float64)
        diagonal = smooth if self._settings.mese else free
        matrix = grid.matrix(cells[grid.below_diagonal], diagonal)
        residual = captures.design.reshape(len(value), -1) @ matrix.reshape(-1) - value
        sigma = np.sqrt(np.diagonal(captures.covariance[0]))
        nan = np.full(matrix.shape, np.nan)
        return FluorescenceResult(
            estimator=self.name, sample=data.sample,
            emission_nm=grid.emission_nm, excitation_nm=grid.excitation_nm, matrix=matrix,
            standard_deviation=nan, quantile_level=LEVELS,
            quantile=np.broadcast_to(nan, (LEVELS.size, *matrix.shape)).copy(),
            undetermined=captures.system.blind(),
            status=FluorescenceStatus.OK if valid.all() else FluorescenceStatus.MASKED,
            residual=captures.full(residual), residual_normalised=captures.full(residual / sigma),
            settings=asdict(self._settings),
            fingerprint=fingerprint(data, self.name, asdict(self._settings)),
            messages=data.reasons,
            statistics={"loss": float(loss), "iterations": float(sum(n for n, _ in LOOPS))},
            mixture=_mixture(fitted, moment, data.sample, span),
        )  # fmt: skip


def _mixture(
    fitted: dict[str, FloatArray], moment: FloatArray, name: str, span: tuple[float, float]
) -> MixtureModel:
    rows = zip(
        fitted["weight"], fitted["excitation"], fitted["emission"],
        fitted["excitation_variance"], fitted["emission_variance"], strict=True,
    )  # fmt: skip
    gaussians = tuple(
        Gaussian(
            weight=float(w), excitation_nm=float(i), emission_nm=float(o),
            excitation_variance_nm2=float(vi), emission_variance_nm2=float(vo),
        )
        for w, i, o, vi, vo in rows
    )  # fmt: skip
    return MixtureModel(
        name=name, range_nm=span, gaussians=gaussians, moments=tuple(float(c) for c in moment)
    )


def _fluorescence(p: Parameters, emission: Any, excitation: Any, xp: Any = np) -> Any:
    """Cells (Wo, Wi) of Gaussians (equations 5 and 6), 0 where emission is not longer."""
    into = xp.exp(-0.5 * (excitation - p["excitation"][:, None]) ** 2
                  / p["excitation_variance"][:, None])  # fmt: skip
    out = xp.exp(-0.5 * (emission - p["emission"][:, None]) ** 2 / p["emission_variance"][:, None])
    area = 2.0 * np.pi * xp.sqrt(p["excitation_variance"] * p["emission_variance"])
    cells = (out * (p["weight"] / area)[:, None]).T @ into
    return xp.where(emission[:, None] > excitation + 1e-6, cells, 0.0)


@lru_cache(maxsize=8)
def _program(
    whole: bool, emission_nm: tuple[float, ...], excitation_nm: tuple[float, ...]
) -> Callable[..., tuple[Parameters, Any]]:
    from twin.adding_doubling.runtime import prepare_jax

    prepare_jax()
    import jax
    import jax.numpy as jnp

    emission, excitation = jnp.array(emission_nm), jnp.array(excitation_nm)
    same = jnp.abs(emission[:, None] - excitation) < 1e-6
    count = int(same.sum())
    place = jnp.argwhere(same, size=count)
    means = jnp.array(START_MEANS, dtype=jnp.float64)
    number = len(START_MEANS)
    start: Parameters = {
        "diagonal": jnp.full(count, START_DIAGONAL), "weight": jnp.full(number, START_WEIGHT),
        "excitation": means[:, 0], "emission": means[:, 1],
        "excitation_variance": jnp.full(number, START_VARIANCE),
        "emission_variance": jnp.full(number, START_VARIANCE),
    }  # fmt: skip
    scale = {name: DIAGONAL_STEP if name == "diagonal" else GAUSSIAN_STEP for name in start}
    smallest = {"weight": 0.0, "excitation_variance": SMALLEST_VARIANCE,
                "emission_variance": SMALLEST_VARIANCE}  # fmt: skip

    def loss(p: Parameters, value: Any, valid: Any, light: Any, sight: Any) -> Any:
        matrix = _fluorescence(p, emission, excitation, jnp)
        matrix = matrix.at[place[:, 0], place[:, 1]].add(p["diagonal"])
        error = (value - light @ matrix.T @ sight.T) * valid
        diagonal = p["diagonal"]
        outside = jnp.maximum(-diagonal, 0.0) ** 2 + jnp.maximum(diagonal - 1.0, 0.0) ** 2
        return jnp.sqrt(jnp.sum(error**2) + 1e-30) + PENALTY * outside.sum()

    gradient = jax.value_and_grad(loss)

    def adam(state: Any, pair: tuple[Any, Parameters], step: float) -> Any:
        found, slope = pair
        p, mean, square, time, best, least = state
        better = found < least
        best = jax.tree.map(lambda a, b: jnp.where(better, a, b), p, best)
        least = jnp.where(better, found, least)
        time = time + 1.0
        mean = jax.tree.map(lambda a, b: 0.9 * a + 0.1 * b, mean, slope)
        square = jax.tree.map(lambda a, b: 0.999 * a + 0.001 * b * b, square, slope)
        moved = {}
        for name, old in p.items():
            m, v = mean[name] / (1.0 - 0.9**time), square[name] / (1.0 - 0.999**time)
            new = old - step * scale[name] * m / (jnp.sqrt(v) + 1e-8)
            moved[name] = jnp.maximum(new, smallest[name]) if name in smallest else new
        return moved, mean, square, time, best, least

    def fresh(p: Parameters) -> Any:
        zero = jax.tree.map(jnp.zeros_like, p)
        return p, zero, zero, 0.0, p, jnp.inf

    def one_program(*given: Any) -> tuple[Parameters, Any]:
        p, least = start, jnp.inf
        for count, step in LOOPS:

            def body(state: Any, _: Any, step: float = step) -> tuple[Any, None]:
                return adam(state, gradient(state[0], *given), step), None

            state, _ = jax.lax.scan(body, fresh(p), None, length=count)
            p, least = state[4], state[5]
        return p, least

    compiled = jax.jit(gradient)

    def python_loop(*given: Any) -> tuple[Parameters, Any]:
        p, least = start, jnp.inf
        for count, step in LOOPS:
            state = fresh(p)
            for _ in range(count):
                state = adam(state, compiled(state[0], *given), step)
            p, least = state[4], state[5]
        return p, least

    return jax.jit(one_program) if whole else python_loop
