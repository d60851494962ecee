"""The noise of sphere readings, which files do not state: from repeats, else assumed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.problem import Problem
from diagnosis.sphere_twin import SphereTwin
from twin.spectra import FloatArray

FEWEST = 4
"""Differences between repeats from which on they say what the noise is."""


@dataclass(frozen=True)
class SphereNoise:
    """Standard deviations of readings.

    Attributes:
        relative: share of the reading that is independent between readings.
        absolute: constant beside it.
        calibration: share of M_R, M_T and M_U that is common to all their readings.
        filling: relative standard deviation of the concentration of one filling, which all its
            readings share; only where concentrations are given.
        reason: where these come from.
    """

    relative: float = 0.005
    absolute: float = 0.0005
    calibration: tuple[float, float, float] = (0.005, 0.005, 0.01)
    filling: float = 0.0
    reason: str = (
        "noise: files state none; assumed 0.5 % of every reading plus 0.0005 independent, and"
        " 0.5 % of M_R and M_T and 1 % of M_U common to all"
    )


def noise_of(
    problem: Problem, twin: SphereTwin, given: SphereNoise | None, fillings: Sequence[int] | None
) -> tuple[Problem, SphereNoise]:
    """The problem with its covariance, and the noise that was taken.

    What repeats of one dilution differ by is split into the direction that a wrong
    concentration has (relative to the readings, at the material the problem starts from) and
    the rest, which is noise; the rest's directions share one relative standard deviation.

    Args:
        problem: its material is where derivatives are taken.
        twin: of the problem.
        given: None finds it.
        fillings: equal numbers for samples that repeat one dilution, or none.
    """
    count = len(twin.captures)
    value = problem.value.reshape(len(problem.value), len(twin.samples), count)
    valid = problem.valid.reshape(value.shape)
    moved = _by_concentration(problem, twin).reshape(value.shape)
    noise = given or SphereNoise()
    if given is None and fillings is not None:
        noise = _from_repeats(value, valid, moved, np.asarray(fillings), noise)
    sd = noise.relative * np.abs(value) + noise.absolute
    independent = np.zeros((*problem.value.shape, problem.value.shape[1]))
    diagonal = np.arange(problem.value.shape[1])
    independent[:, diagonal, diagonal] = sd.reshape(len(sd), -1) ** 2
    if twin.concentration is not None and noise.filling > 0.0:
        for sample in range(len(twin.samples)):
            block = slice(sample * count, (sample + 1) * count)
            shift = noise.filling * moved[:, sample]
            independent[:, block, block] += shift[:, :, None] * shift[:, None, :]
    level = {"M_R": 0, "M_T": 1, "M_U": 2}
    modes = []
    for column, capture in enumerate(twin.captures):
        own = np.zeros_like(value)
        own[..., column] = noise.calibration[level[capture]] * value[..., column]
        modes.append(own.reshape(problem.value.shape))
    engine = twin.lost_error(problem.material).reshape(value.shape)
    for number, column in np.ndindex(len(twin.models), count):
        own = np.zeros_like(value)
        # every visit has walks of its own, which all its rows share
        own[..., column] = engine[..., column] * (twin.visit == number)
        if own.any():
            modes.append(own.reshape(problem.value.shape))
    return replace(problem, independent=independent, common=np.array(modes)), noise


def _by_concentration(problem: Problem, twin: SphereTwin) -> FloatArray:
    """Change of the readings per relative change of every sample's concentration, (W, M)."""
    slopes = problem.jacobian(problem.material, {})
    first = [index for index, name in enumerate(twin.names) if name.startswith("ln sigma_t")]
    return np.asarray(slopes[:, :, first].sum(axis=2))


def _from_repeats(
    value: FloatArray, valid: np.ndarray, moved: FloatArray, fillings: np.ndarray,
    assumed: SphereNoise,
) -> SphereNoise:  # fmt: skip
    """Relative noise, and scatter of fillings, from repeats; (W, S, C) arrays."""
    rest = along = 0.0
    freedom = free_along = 0
    for number in np.unique(fillings):
        own = np.flatnonzero(fillings == number)
        for wave in range(len(value)):
            kept = own[valid[wave, own].all(axis=1) & (value[wave, own] > 0.0).all(axis=1)]
            if len(kept) < 2:
                continue
            logs = np.log(value[wave, kept])
            away = logs - logs.mean(axis=0)
            direction = (moved[wave, kept] / value[wave, kept]).mean(axis=0)
            length = float(np.linalg.norm(direction))
            part = away @ direction / length
            left = away - np.outer(part, direction / length)
            # the constant part of the noise weighs more in dark readings
            rest += float(np.sum(left**2))
            along += float(np.sum((part / length) ** 2))
            freedom += (len(kept) - 1) * (value.shape[2] - 1)
            free_along += len(kept) - 1
    if freedom < FEWEST:
        return assumed
    relative = float(np.sqrt(rest / freedom))
    filling = float(np.sqrt(along / free_along))
    return replace(
        assumed,
        relative=relative,
        absolute=assumed.absolute / 5.0,
        filling=filling,
        reason=(
            f"noise: from {free_along} differences between repeats {relative:.2%} of every"
            f" reading plus {assumed.absolute / 5.0:g} independent, fillings differ by"
            f" {filling:.2%} in concentration; assumed: 0.5 % of M_R and M_T and 1 % of M_U"
            " common to all"
        ),
    )
