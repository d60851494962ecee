"""The estimator `blasinski`: the published peer, re-implemented from its description.

Source: Blasinski, Farrell, Wandell 2020, "Simultaneous surface reflectance and fluorescence
spectra estimation" (IEEE TIP 29), the method for several fluorophores. It works in photons, knows
no noise and gives no interval. Captures are scaled so that a perfect white gives 1 in the brightest
one, which is what the weights refer to.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from estimators.fluorescence.blasinski_admm import Program, Weights
from estimators.fluorescence.blasinski_bases import Bases, generated_bases
from estimators.fluorescence.cells import Captures, checked, fingerprint, gather, groups
from estimators.fluorescence.result import LEVELS, FluorescenceResult, FluorescenceStatus
from twin.errors import InputError
from twin.fluorescence.donaldson import from_photons
from twin.fluorescence.system import FluorescenceData
from twin.spectra import FloatArray

GRID = np.logspace(-3.0, 1.0, 10)
"""Weights that cross-validation tries."""


@dataclass(frozen=True, kw_only=True)
class BlasinskiSettings:
    """Options of the estimator `blasinski`."""

    alpha: float = 0.1
    beta: float = 0.1
    gamma: float = 0.1
    eta: float = 0.1
    iterations: int = 250
    rho: float = 0.1
    bases: Bases | None = None
    """Bases in photon units; None: those of spectra that are generated."""

    def __post_init__(self) -> None:
        for name in ("alpha", "beta", "gamma", "eta"):
            if not getattr(self, name) >= 0.0:
                raise InputError(f"{getattr(self, name)!r}", "a weight of 0 or more", place=name)
        if not self.rho > 0.0:
            raise InputError(f"{self.rho!r}", "a penalty above 0", place="rho")
        if self.iterations < 1:
            raise InputError(f"{self.iterations!r}", "1 or more", place="iterations")

    @property
    def weights(self) -> Weights:
        """Weights of the penalties."""
        return Weights(alpha=self.alpha, beta=self.beta, gamma=self.gamma, eta=self.eta)


class BlasinskiEstimator:
    """Bases, smoothness, positivity and a small nuclear norm, by ADMM."""

    def __init__(self, settings: BlasinskiSettings | None = None) -> None:
        self._settings = settings or BlasinskiSettings()

    @property
    def name(self) -> str:
        """Name in the registry and in reports."""
        return "blasinski"

    @property
    def settings(self) -> BlasinskiSettings:
        """Options in use."""
        return self._settings

    def estimate(self, data: FluorescenceData) -> FluorescenceResult:
        """Estimate one matrix.

        Raises:
            InputError: captures that cannot be used.
        """
        return self.estimate_batch([data])[0]

    def estimate_batch(self, data: list[FluorescenceData]) -> list[FluorescenceResult]:
        """Estimate several; those of one set-up together."""
        for one in data:
            checked(one)
        found: dict[int, FluorescenceResult] = {}
        for group in groups(data):
            members = [data[index] for index in group]
            found.update(zip(group, self._group(members), strict=True))
        return [found[index] for index in range(len(data))]

    def _group(self, data: list[FluorescenceData]) -> list[FluorescenceResult]:
        captures = gather(data)
        program, scale = prepare(captures, self._settings.bases)
        reflect, core, gap = program.solve(
            captures.value / scale, self._settings.weights,
            iterations=self._settings.iterations, rho=self._settings.rho,
        )  # fmt: skip
        cells = captures.cells
        photons = cells.matrix(
            np.maximum(core.reshape(len(core), -1) @ program.cells.T, 0.0),
            np.clip(reflect @ program.bases.reflectance.T, 0.0, 1.0),
        )
        matrices = from_photons(photons, cells.emission_nm, cells.excitation_nm)
        options = {k: v for k, v in vars(self._settings).items() if k != "bases"}
        results = []
        for index, (one, matrix) in enumerate(zip(data, matrices, strict=True)):
            predicted = captures.design.reshape(len(captures.design), -1) @ matrix.reshape(-1)
            residual = predicted - captures.value[index]
            sigma = np.sqrt(np.diagonal(captures.covariance[index]))
            nan = np.full(matrix.shape, np.nan)
            status = FluorescenceStatus.OK if one.valid.all() else FluorescenceStatus.MASKED
            results.append(FluorescenceResult(
                estimator=self.name, sample=one.sample, emission_nm=cells.emission_nm,
                excitation_nm=cells.excitation_nm, matrix=matrix, standard_deviation=nan,
                quantile_level=LEVELS,
                quantile=np.broadcast_to(nan, (LEVELS.size, *matrix.shape)).copy(),
                undetermined=captures.system.blind(), status=status,
                residual=captures.full(residual),
                residual_normalised=captures.full(residual / sigma),
                settings=options, fingerprint=fingerprint(one, self.name, asdict(self._settings)),
                messages=one.reasons,
                statistics={"primal_residual": gap, "iterations": self._settings.iterations},
            ))  # fmt: skip
        return results


def prepare(captures: Captures, bases: Bases | None) -> tuple[Program, float]:
    """The program of a set-up, and what captures are divided by."""
    cells = captures.cells
    chosen = bases or generated_bases(cells.emission_nm, cells.excitation_nm)
    scale = float(captures.diagonal_design.sum(axis=1).max())
    ratio = cells.excitation_nm[None, :] / cells.emission_nm[:, None]
    return Program.of(captures.design * ratio / scale, cells, chosen), scale


def _with(settings: BlasinskiSettings, names: Sequence[str], weight: float) -> BlasinskiSettings:
    changes: dict[str, Any] = dict.fromkeys(names, weight)
    return replace(settings, **changes)


def cross_validated(
    data: Sequence[FluorescenceData],
    settings: BlasinskiSettings | None = None,
    *,
    grid: FloatArray = GRID,
    folds: int = 5,
    seed: int = 1,
) -> BlasinskiSettings:
    """Weights with the smallest error of captures that were left out, for all samples together.

    One weight after another over the grid (alpha, then beta = gamma, then eta, then alpha again),
    every one judged by the relative error of left-out captures summed over samples and folds.

    Raises:
        InputError: fewer captures than folds.
    """
    chosen = settings or BlasinskiSettings()
    random = np.random.Generator(np.random.Philox(key=seed))
    parts = []
    for group in groups(data):
        captures = gather([data[index] for index in group])
        count = captures.value.shape[1]
        if not 2 <= folds <= count:
            raise InputError(f"{folds} folds", f"2 to {count}", place="folds")
        program, scale = prepare(captures, chosen.bases)
        parts.append((program, captures.value / scale, random.permutation(count) % folds))

    def error(trial: BlasinskiSettings) -> float:
        total = 0.0
        for (program, value, fold), number in itertools.product(parts, range(folds)):
            out = fold == number
            reflect, core, _ = program.solve(
                value, trial.weights, use=~out, iterations=trial.iterations, rho=trial.rho
            )
            left = (program.predict(reflect, core) - value)[:, out]
            total += float(((left / np.linalg.norm(value, axis=1, keepdims=True)) ** 2).sum())
        return total

    for names in (("alpha",), ("beta", "gamma"), ("eta",), ("alpha",)):
        trials = [_with(chosen, names, float(each)) for each in grid]
        errors = [error(each) for each in trials]
        chosen = trials[int(np.argmin(errors))]
    return chosen
