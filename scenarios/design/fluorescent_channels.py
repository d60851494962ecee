"""Lights and channels that many candidate set-ups share: one forward matrix and noise for all.

A pool holds every light of some set-ups with one detector under one protocol. Exposure is chosen
light by light, so what a light shows, and how noisily, does not depend on which other lights are
there; only what the white calibrates in common (gains of channels) does, and that is taken from the
pool. A candidate is then a choice of rows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from scenarios.design.fluorescent_errors import capture_errors
from scenarios.design.fluorescent_prior import Population
from twin.errors import InputError
from twin.fluorescence import (
    FluorescenceProtocol,
    FluorescenceSetup,
    Illuminant,
    corrected,
    nominal_system,
    simulate_fluorescence,
)
from twin.materials import reflectance
from twin.spectra import FloatArray

LEAST_SIGNAL = 1.0
"""Directions of the channels under one light are kept whose signal has this share of the variance
of the noise, the middle roughness of single cells included."""
NOISE_SEED = 20_231_101
MOST_LIGHTS = 60


@dataclass(frozen=True, eq=False)
class Pool:
    """Lights x channels of several candidates, reduced to the directions that carry signal.

    L counts directions, `light` says under which light each is.

    Attributes:
        design: captures of every unknown cell, (L, C + D).
        light: (L,).
        noise: covariance of the captures of each material, (B, L, L).
        draws: errors of the captures in simulated visits, (B, S, L).
        members: which lights each candidate has, by number.
        candidates: numbers of the candidates among those asked for.
    """

    design: FloatArray
    light: NDArray[np.intp]
    noise: FloatArray
    draws: FloatArray
    members: tuple[NDArray[np.intp], ...]
    candidates: tuple[int, ...]


def pools(
    setups: Sequence[FluorescenceSetup],
    protocols: Sequence[FluorescenceProtocol],
    population: Population,
    draws: int,
    least_signal: float = LEAST_SIGNAL,
    errors: Mapping[str, float] | None = None,
    simulated: bool = False,
) -> list[Pool]:
    """Group candidates by detector and protocol, and describe each group once.

    Args:
        setups: N candidates.
        protocols: one for each.
        population: materials, on the wavelengths of the set-ups.
        draws: draws of the noise for each material, S.
        least_signal: directions with less signal over noise are left out; 0: all are kept.
        errors: of parts, by effect, in prior scales; they are drawn with the noise, unknown to the
            estimator.
        simulated: draws are the errors of simulated captures; else of their stated covariance,
            the same for a light whatever else is in the pool.

    Raises:
        InputError: a set-up on other wavelengths than the population.
    """
    grid = population.cells
    groups: dict[str, list[int]] = {}
    for number, (setup, protocol) in enumerate(zip(setups, protocols, strict=True)):
        same = np.array_equal(setup.emission_nm, grid.emission_nm) and np.array_equal(
            setup.excitation_nm, grid.excitation_nm
        )
        if not same:
            raise InputError(
                f"the set-up {setup.name!r} on {setup.emission_nm[0]:g} to"
                f" {setup.emission_nm[-1]:g} nm, excitation from {setup.excitation_nm[0]:g} nm",
                "the wavelengths of the population", place="setups",
            )  # fmt: skip
        detector = setup.detector.model_copy(update={"white_rate_electrons_per_s": 1.0})
        key = "|".join((detector.model_dump_json(), str(setup.white), protocol.model_dump_json()))
        groups.setdefault(key, []).append(number)
    return [
        _pool(
            [setups[n] for n in numbers], protocols[numbers[0]], population, tuple(numbers),
            draws, least_signal, errors or {},
            simulated,
        )
        for numbers in groups.values()
    ]  # fmt: skip


def subset_pool(
    setup: FluorescenceSetup, subsets: Sequence[Sequence[int]], protocol: FluorescenceProtocol,
    population: Population, draws: int, least_signal: float = LEAST_SIGNAL,
    errors: Mapping[str, float] | None = None,
    simulated: bool = False,
) -> Pool:  # fmt: skip
    """The pool of one set-up whose candidates are some of its lights each, by number.

    Raises:
        InputError: a subset without a light or with one that is not there.
    """
    count = len(setup.lights)
    for subset in subsets:
        if not subset or min(subset) < 0 or max(subset) >= count:
            raise InputError(
                f"the lights {tuple(subset)}", f"one or more of 0 to {count - 1}", place="subsets"
            )
    whole = pools([setup], [protocol], population, draws, least_signal, errors, simulated)[0]
    members = tuple(np.array(sorted(set(each)), dtype=np.intp) for each in subsets)
    return replace(whole, members=members, candidates=tuple(range(len(members))))


def _pool(
    setups: Sequence[FluorescenceSetup], protocol: FluorescenceProtocol, population: Population,
    numbers: tuple[int, ...], draws: int, least_signal: float, errors: Mapping[str, float],
    simulated: bool,
) -> Pool:  # fmt: skip
    lights: list[Illuminant] = []
    rates: list[float] = []
    known: dict[str, int] = {}
    keys: list[int] = []
    members = []
    for setup in setups:
        chosen = []
        for light, rate in zip(setup.lights, white_rates(setup), strict=True):
            # The same LED may be the brightest in one set and outshone in another.
            plain = light.model_copy(update={"name": "x", "power": 1.0})
            key = f"{plain.model_dump_json()}{rate:.5g}"
            if key not in known:
                known[key] = len(lights)
                lights.append(light)
                keys.append(crc32(key.encode()))
                rates.append(rate)
            chosen.append(known[key])
        members.append(np.array(chosen))
    if len(lights) > MOST_LIGHTS:
        raise InputError(
            f"{len(lights)} different lights with one detector", f"{MOST_LIGHTS} or fewer",
            place="setups", remedy="Predict them in several calls.",
        )  # fmt: skip
    numbered = [
        light.model_copy(update={"name": f"{number}"}) for number, light in enumerate(lights)
    ]
    pool = together(setups[0], numbered, rates)
    system = nominal_system(pool)
    full = system.design().reshape(-1, *population.cells.below_diagonal.shape)
    cells = population.cells
    design = np.concatenate(
        [full[:, cells.below_diagonal], full[:, cells.diagonal[0], cells.diagonal[1]]], axis=1
    )
    visits = [
        [
            corrected(
                simulate_fluorescence(pool, each, protocol=protocol, seed=_seed(number, draw))
            )
            for draw in range(draws if simulated else 1)
        ]
        for number, each in enumerate(population.materials)
    ]
    shape = visits[0][0].value.shape
    variance = np.array([np.where(each[0].valid, each[0].variance, 1.0) for each in visits])
    projection, light_of = _projection(design, variance, population, shape, least_signal)
    wrong = np.zeros((len(visits), draws, variance[0].size))
    if errors:
        known_errors = capture_errors(pool, cells.matrix(*_split(population)), errors)
        wrong = known_errors.drawn(draws, NOISE_SEED)
    noise, drawn = [], []
    for number, (own, spread) in enumerate(zip(visits, variance, strict=True)):
        modes = own[0].common.reshape(len(own[0].common), -1)
        shared = modes @ projection.T
        noise.append((projection * spread.reshape(-1)) @ projection.T + shared.T @ shared)
        stated = _normal(keys, number, draws, shape[1]) * np.sqrt(spread.reshape(-1))
        truth = population.materials[number].physical().matrix.reshape(-1)
        errors_seen = [
            np.where(
                each.valid.reshape(-1),
                each.value.reshape(-1) - each.system.design().reshape(each.value.size, -1) @ truth,
                instead,
            )
            for each, instead in zip(own, stated, strict=simulated)
        ]
        if not simulated:
            random = np.random.Generator(np.random.Philox(key=[NOISE_SEED, number]))
            stated += random.standard_normal((draws, len(modes))) @ modes
        errors_of = np.array(errors_seen) if simulated else stated
        drawn.append((errors_of + wrong[number]) @ projection.T)
    return Pool(
        projection @ design, light_of, np.array(noise), np.array(drawn), tuple(members), numbers
    )


def _seed(material: int, draw: int) -> int:
    return NOISE_SEED + material + 100_000 * draw


def _normal(keys: Sequence[int], material: int, draws: int, channels: int) -> FloatArray:
    """Standard normals (S, J K), the same for a light whatever else is in the pool."""
    each = [
        np.random.Generator(np.random.Philox(key=[key, NOISE_SEED + material])).standard_normal(
            (draws, channels)
        )
        for key in keys
    ]
    return np.concatenate(each, axis=1)


def _split(population: Population) -> tuple[FloatArray, FloatArray]:
    """Fluorescence cells (B, C) and reflectances (B, D)."""
    return population.truth[:, : population.size], population.truth[:, population.size :]


def white_rates(setup: FluorescenceSetup) -> FloatArray:
    """Signal [electrons/s] of the brightest channel on the white under each light, (J,)."""
    system = nominal_system(setup)
    seen = system.white(reflectance(setup.white, setup.emission_nm)).max(axis=1)
    return np.asarray(seen / seen.max() * setup.detector.white_rate_electrons_per_s)


def together(
    like: FluorescenceSetup, lights: Sequence[Illuminant], rates: Sequence[float]
) -> FluorescenceSetup:
    """A set-up with other lights, each as bright as stated.

    In a simulated visit the brightest light of a set-up brings the detector its
    `white_rate_electrons_per_s`: a light would grow brighter when others are left out. Here powers
    and rate are set so that every light keeps its own.

    Args:
        like: where everything else comes from.
        lights: J of them, names unique.
        rates: signal [electrons/s] on the white in the brightest channel under each, (J,).
    """
    plain = like.model_copy(update={"lights": tuple(lights)})
    level = np.array(rates) / white_rates(plain)
    level /= level.max()
    lit = tuple(
        light.model_copy(update={"power": light.power * float(factor)})
        for light, factor in zip(lights, level, strict=True)
    )
    detector = like.detector.model_copy(update={"white_rate_electrons_per_s": max(rates)})
    return plain.model_copy(update={"lights": lit, "detector": detector})


def _projection(
    design: FloatArray, variance: FloatArray, population: Population, shape: tuple[int, ...],
    least_signal: float,
) -> tuple[FloatArray, NDArray[np.intp]]:  # fmt: skip
    """Directions (L, J K) that carry signal, light by light, and the light of each, (L,)."""
    channels = shape[1]
    usual = np.mean([p.covariance for each in population.priors for p in each], axis=0)
    sigma = np.sqrt(variance.mean(axis=0))
    middle = float(np.median(population.roughness))
    rows, light = [], []
    for number in range(shape[0]):
        part = slice(number * channels, (number + 1) * channels)
        seen = design[part]
        single = seen[:, : population.size]
        noise = np.diag(sigma[number] ** 2) + middle**2 * single @ single.T
        white = np.linalg.inv(np.linalg.cholesky(noise))
        size, vector = np.linalg.eigh(white @ seen @ usual @ seen.T @ white.T)
        for each in np.flatnonzero(size >= least_signal)[::-1]:
            row = np.zeros(shape[0] * channels)
            row[part] = vector[:, each] @ white
            rows.append(row)
            light.append(number)
    return np.array(rows), np.array(light, dtype=np.intp)
