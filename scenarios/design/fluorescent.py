"""Predicted accuracy of fluorescence set-ups, before a part is bought.

The estimator `donaldson` is a Gaussian prior about products (fluorophores), seen through lights and
channels. About each material of a population its products are linearised (`fluorescent_prior`), so
that its answer is linear in the captures,

    estimate = mean + S A' (A S A' + roughness^2 A A' + N)^-1 (A (truth - mean) + noise)

with A the set-up, S the prior and N the noise of the protocol; only the products themselves, which
are exponentials of their parameters, are evaluated at the parameters so found. The difference from
the truth is the smoothing bias of that material plus what drawn noise adds; the typical value over
the materials is the prediction. Cells are kept at 0 or more and reflectances inside 0 to 1 by
alternating projections, so the gain of non-negativity is in the figures, not calibrated afterwards.
Numbers of products and the roughness are weighed by their evidence, as in the estimator. Nothing is
fitted to simulations.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from scenarios.design.fluorescent_channels import LEAST_SIGNAL, Pool, pools, subset_pool
from scenarios.design.fluorescent_fitted import SEARCH, FittedEstimates
from scenarios.design.fluorescent_linear import LinearEstimates
from scenarios.design.fluorescent_prior import Population
from twin.errors import InputError
from twin.fluorescence import FluorescenceProtocol, FluorescenceSetup
from twin.spectra import FloatArray

CHUNK = 32
"""Candidates whose matrices are in memory at one time."""


@dataclass(frozen=True, eq=False)
class FluorescentPrediction:
    """What each of N set-ups will make of B materials.

    Attributes:
        lower: RMSE of the fluorescence cells (465 on the seed's wavelengths), (N, B).
        diagonal: RMSE of the reflectance, (N, B).
        colour: median over the wavelengths of CIEDE2000 under monochromatic light, (N, B).
    """

    lower: FloatArray
    diagonal: FloatArray
    colour: FloatArray

    @property
    def rmse_lower(self) -> FloatArray:
        """Typical of the materials: geometric mean, (N,)."""
        return typical(self.lower)

    @property
    def rmse_diagonal(self) -> FloatArray:
        """Geometric mean over the materials, (N,)."""
        return typical(self.diagonal)

    @property
    def de2000(self) -> FloatArray:
        """Geometric mean over the materials, (N,)."""
        return typical(self.colour)

    def standard_error(self, name: str) -> FloatArray:
        """Of "rmse_lower", "rmse_diagonal" or "de2000" over the population, (N,).

        Raises:
            InputError: another name.
        """
        known = {"rmse_lower": self.lower, "rmse_diagonal": self.diagonal, "de2000": self.colour}
        if name not in known:
            raise InputError(f"{name!r}", f"one of {', '.join(known)}", place="name")
        spread = np.log(known[name]).std(axis=1, ddof=1) / np.sqrt(known[name].shape[1])
        return np.asarray(typical(known[name]) * spread)


def typical(values: FloatArray) -> FloatArray:
    """Geometric mean over the last axis: one material gone wrong does not decide it."""
    return np.asarray(np.exp(np.log(values).mean(axis=-1)))


def predict_fluorescence(
    setups: Sequence[FluorescenceSetup],
    population: Population,
    protocol: FluorescenceProtocol | Sequence[FluorescenceProtocol] | None = None,
    *,
    draws: int = 2,
    least_signal: float = LEAST_SIGNAL,
    errors: Mapping[str, float] | None = None,
    steps: int = 0,
    noise: float = 1.0,
) -> FluorescentPrediction:
    """Predict the errors of the estimator `donaldson`.

    Args:
        setups: N candidates, all on the population's wavelengths; those that share lights and
            detector share the work.
        population: `linearised_population` of the materials of interest, two or more.
        protocol: one for all, or one for each.
        draws: draws of the noise for each material, S; the same for all candidates.
        least_signal: what the channels under one light are reduced by (`Pool`).
        errors: of cheap parts: how many prior scales of each effect of the fluorescence bench
            (`fluorescent_errors.effect_names`) are drawn, unknown to the estimator; None: none.
        steps: most steps by which products are fitted to every candidate's captures
            (`fluorescent_fitted.STEPS`); 0: the linear step alone.
        noise: factor on the errors of the captures, for asking what they matter.

    Raises:
        InputError: no set-up, not as many protocols, other wavelengths, fewer than two materials.
    """
    _check(len(setups), population, draws)
    if protocol is None or isinstance(protocol, FluorescenceProtocol):
        protocols = [protocol or FluorescenceProtocol()] * len(setups)
    else:
        protocols = list(protocol)
    if len(protocols) != len(setups):
        raise InputError(f"{len(protocols)} protocols", f"one, or {len(setups)}", place="protocol")
    groups = [
        replace(each, noise=noise**2 * each.noise, draws=noise * each.draws)
        for each in pools(setups, protocols, population, draws, least_signal, errors, steps > 0)
    ]
    return _predicted(groups, len(setups), population, draws, steps)


def predict_light_subsets(
    setup: FluorescenceSetup,
    subsets: Sequence[Sequence[int]],
    population: Population,
    protocol: FluorescenceProtocol | None = None,
    *,
    draws: int = 2,
    least_signal: float = LEAST_SIGNAL,
    errors: Mapping[str, float] | None = None,
    steps: int = 0,
) -> FluorescentPrediction:
    """The same for some of the lights of one set-up each: the quick way to try thousands.

    Args:
        setup: with all lights.
        subsets: N choices of lights, by number.
        population: as in `predict_fluorescence`, like all that follows.
        protocol: shots and settings.
        draws: of the noise.
        least_signal: as there.
        errors: as there.
        steps: as there.

    Raises:
        InputError: as `predict_fluorescence`; a light that is not there.
    """
    _check(len(subsets), population, draws)
    pool = subset_pool(
        setup, subsets, protocol or FluorescenceProtocol(), population, draws, least_signal, errors,
        steps > 0,
    )  # fmt: skip
    return _predicted([pool], len(subsets), population, draws, steps)


def _check(count: int, population: Population, draws: int) -> None:
    for found, least, what in (
        (count, 1, "set-ups"), (len(population.materials), 2, "materials"), (draws, 1, "draws"),
    ):  # fmt: skip
        if found < least:
            raise InputError(f"{found} {what}", f"{least} or more", place=what)


def _predicted(
    groups: Sequence[Pool], size: int, population: Population, draws: int, steps: int
) -> FluorescentPrediction:
    batch, count = len(population.materials), population.size
    lower, diagonal = np.zeros((size, batch)), np.zeros((size, batch))
    lab = np.zeros((size, batch, draws, population.cells.excitation_nm.size, 3))
    truth = population.truth[:, None]

    def judge(part: tuple[LinearEstimates | FittedEstimates, Pool, int]) -> None:
        method, pool, begin = part
        numbers = list(pool.candidates[begin : begin + CHUNK])
        estimate = method.estimates(pool.members[begin : begin + CHUNK])
        error = (estimate - truth) ** 2
        lower[numbers] = np.sqrt(error[..., :count].mean(axis=-1)).mean(axis=-1)
        diagonal[numbers] = np.sqrt(error[..., count:].mean(axis=-1)).mean(axis=-1)
        lab[numbers] = _lab(population, estimate)

    # candidates know nothing of each other: any number of threads gives the same numbers
    with ThreadPoolExecutor(max_workers=os.cpu_count()) as threads:
        for pool in groups:
            linear = LinearEstimates.of(pool, population)
            method = FittedEstimates(linear, steps) if steps else linear
            begins = range(0, len(pool.members), CHUNK)
            list(threads.map(judge, [(method, pool, begin) for begin in begins]))
    if steps:
        lower *= SEARCH
    return FluorescentPrediction(lower, diagonal, _colour(population, lab))


def _lab(population: Population, values: FloatArray) -> FloatArray:
    from estimators.fluorescence.colour import monochromatic_lab

    cells, count = population.cells, population.size
    matrix = cells.matrix(values[..., :count], values[..., count:])
    return monochromatic_lab(matrix, cells.emission_nm)


def _colour(population: Population, lab: FloatArray) -> FloatArray:
    """Median CIEDE2000 over wavelengths, mean over draws, (N, B)."""
    import colour

    truth = np.broadcast_to(_lab(population, population.truth)[:, None], lab.shape)
    difference = np.asarray(colour.delta_E(lab, truth, method="CIE 2000"))
    return np.asarray(np.median(difference, axis=-1).mean(axis=-1))
