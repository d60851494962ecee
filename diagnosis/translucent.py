"""From a measurement of the translucent bench to the problem that is diagnosed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from diagnosis.kept import KeptEngine
from diagnosis.problem import Channel, EffectValues, Problem, Smoothness
from diagnosis.reduction import Reduction
from diagnosis.refit import fit
from diagnosis.response_noise import Loudness, loudness
from diagnosis.suspects import candidate_of, judgeable
from twin.effects import Candidate as Suspect
from twin.effects import Catalogue, EffectEngine, LeftOut, Readout, World, catalogue
from twin.errors import InputError
from twin.measurement import Measurement, observations, relative_intensities
from twin.measurement.model import BoolArray
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from estimators.map_grid import Map

NAMES = ("logit albedo", "ln sigma_t", "artanh g")
STEP = 1e-6
"""Of the one-sided differences by which the material's slopes are taken, in its coordinates."""
FARTHEST = (12.0, 12.0, 2.6)
"""Largest |coordinates| at which the twin is asked: beyond, nothing changes."""
RESPONSE_ERROR = 0.025
"""Relative standard error of the engine's responses: what makes the 93 values that were fitted to
measurements of known worlds by the Monte Carlo (the blind suite's development family) likeliest."""
FIRST_GUESS = (0.9, 2.0, 0.5)
"""Albedo, sigma_t [1/mm] and g where no estimator answers."""
SMOOTH = Smoothness(length_nm=60.0, sd=(2.0, 1.0, 0.5), nugget=(0.02, 0.01, 0.01))
"""The prior of the spectra with which the verdict is compared."""

Say = Callable[[str], None]


def _silent(text: str) -> None:
    """Say nothing."""


@dataclass(frozen=True, eq=False)
class TranslucentCase:
    """A problem and what it was made of.

    Attributes:
        problem: what `diagnose` takes.
        engine: evaluates worlds.
        suspects: the catalogue's candidates in the order of `problem.candidates`.
        left_out: entries of the catalogue that could not be used, and why.
        reasons: what was masked and assumed.
    """

    problem: Problem
    engine: EffectEngine
    suspects: tuple[Suspect, ...]
    left_out: tuple[LeftOut, ...]
    reasons: tuple[str, ...]


def translucent_case(
    measurement: Measurement,
    *,
    effects: Catalogue | None = None,
    maps: Sequence[Map] = (),
    folder: Path | None = None,
    threads: int | None = None,
    paths: int = 8192,
    material: FloatArray | None = None,
    readout: Readout | None = None,
    say: Say = _silent,
    progress: Callable[[float, float], None] | None = None,
) -> TranslucentCase:
    """The problem of a visit to the translucent bench, its signatures at the no-effect fit.

    Args:
        measurement: the visit.
        effects: the catalogue; None takes ours and what is installed.
        maps: appearance maps of the samples, which know the finite bench; without them the bench
            is taken as unbounded.
        folder: of the cached responses of the Monte Carlo; None takes the user's.
        threads: of the Monte Carlo.
        paths: of its responses; up to 8 times as many of those that are mostly noise.
        material: albedo, sigma_t [1/mm] and g, shape (W, 3), where signatures are taken; None
            takes the fit without effects.
        readout: brightness and exposures; None takes the visit's counts.
        say: told of what a person should know.
        progress: called with (done, total) candidates.

    Raises:
        InputError: the visit cannot be used as a whole.
    """
    data = observations(measurement)
    world = World.nominal(measurement.bench, measurement.samples)
    factors, error = _finite(measurement, data.wavelength_nm, maps)
    if readout is None and measurement.captures is not None:
        readout = Readout.of(measurement)
    engine = KeptEngine(
        world, data.wavelength_nm, factors, readout, least_paths=paths, folder=folder,
        threads=threads, say=say,
    )  # fmt: skip
    names = [sample.name for sample in measurement.samples]
    place = np.array(
        [3 * names.index(row.sample) + ("black", "white", "collimated").index(row.capture)
         for row in data.rows]
    )  # fmt: skip
    found, left_out = (effects or catalogue()).candidates(world)
    twin = _Twin(engine, world, place, {each.name: each for each in found})
    start = _first_guess(measurement, maps) if material is None else coordinates(*material.T)
    bare = Problem(
        wavelength_nm=data.wavelength_nm,
        channels=tuple(Channel(row.capture, row.sample, row.repeat) for row in data.rows),
        value=np.where(data.valid, data.value, 0.0),
        valid=data.valid,
        independent=data.independent,
        common=np.concatenate([data.common, _engine_modes(data.value, data.valid, place, error)]),
        material=start,
        forward=twin.forward,
        jacobian=twin.jacobian,
        signatures=np.empty((0, *data.value.shape)),
        candidates=(),
        thickness_mm={sample.name: sample.thickness_mm for sample in measurement.samples},
        material_prior=SMOOTH,
        material_names=NAMES,
        material_reach=FARTHEST,
        response_error=RESPONSE_ERROR,
    )
    fitted = fit(bare).material if material is None else start
    at = physical(fitted)
    reduction = Reduction.of(bare, bare.jacobian(fitted, {}))

    heard: dict[str, Loudness] = {}

    def taken(suspect: Suspect) -> FloatArray:
        own = engine.signature(suspect, at)
        seen = np.asarray(own.reshape(*own.shape[:2], -1)[..., place])
        heard[suspect.name] = loudness(engine, suspect, at, seen, place, reduction)
        return seen

    def signature(suspect: Suspect) -> FloatArray:
        own = taken(suspect)
        times = heard[suspect.name].times_wanted
        if times == 1:
            return own
        engine.more_paths[suspect.name] = times * paths
        return taken(suspect)

    tested = judgeable(
        found,
        signature,
        data.value.shape,
        left_out=left_out,
        doubt=lambda suspect, _: heard[suspect.name].doubt(engine.paths(suspect)),
        say=say,
        progress=progress,
    )
    known = {each.name for each in measurement.bench.effects}
    problem = replace(
        bare,
        material=fitted,
        signatures=tested.signatures,
        candidates=tuple(candidate_of(each, each.name in known) for each in tested.suspects),
    )
    return TranslucentCase(problem, engine, tested.suspects, tested.left_out, data.reasons)


def coordinates(albedo: FloatArray, sigma_t_per_mm: FloatArray, g: FloatArray) -> FloatArray:
    """Coordinates of the fit, shape (W, 3), of spectra of shape (W,) each."""
    inside = np.clip(albedo, 1e-5, 1.0 - 1e-6)
    return np.stack(
        [
            np.log(inside) - np.log1p(-inside),
            np.log(np.maximum(sigma_t_per_mm, 1e-4)),
            np.arctanh(np.clip(g, -0.99, 0.99)),
        ],
        axis=-1,
    )


def physical(coordinate: FloatArray) -> FloatArray:
    """Albedo, sigma_t [1/mm] and g, shape (W, 3), of coordinates of the fit (W, 3)."""
    x = np.clip(coordinate, -np.array(FARTHEST), FARTHEST)
    return np.stack([1.0 / (1.0 + np.exp(-x[:, 0])), np.exp(x[:, 1]), np.tanh(x[:, 2])], axis=-1)


def material_slopes(
    forward: Callable[[FloatArray], FloatArray], material: FloatArray, here: FloatArray
) -> FloatArray:
    """Derivatives (W, M, 3) of data by the coordinates: a wavelength depends on itself alone.

    Args:
        forward: coordinates of the fit (W, 3) to data (W, M).
        material: the coordinates.
        here: the data there.
    """
    columns = []
    for index in range(material.shape[1]):
        moved = material.copy()
        moved[:, index] += STEP
        columns.append((forward(moved) - here) / STEP)
    return np.stack(columns, axis=-1)


@dataclass(frozen=True, eq=False)
class _Twin:
    """The prediction of all channels, and its slopes by the material."""

    engine: EffectEngine
    world: World
    place: np.ndarray
    suspects: Mapping[str, Suspect]

    def _world(self, values: EffectValues) -> World:
        world = self.world
        for name, away in values.items():
            suspect = self.suspects[name]
            world = suspect.apply(world, np.array(suspect.nominal) + away)
        return world

    def forward(self, material: FloatArray, values: EffectValues) -> FloatArray:
        """Expected data (W, M); NaN for a world that cannot be.

        Raises:
            InputError: the world that is described cannot be.
        """
        try:
            world = self._world(values)
            seen = self.engine.intensities(world, physical(material))
        except InputError:
            if not values:
                raise
            return np.full((len(material), self.place.size), np.nan)
        return np.asarray(seen.reshape(len(material), -1)[:, self.place])

    def jacobian(self, material: FloatArray, values: EffectValues) -> FloatArray:
        """Derivatives by the coordinates, (W, M, 3).

        Stray light and width couple wavelengths a little; that part of the slope is left out.
        """
        here = self.forward(material, values)
        return material_slopes(lambda moved: self.forward(moved, values), material, here)


def _finite(
    measurement: Measurement, wavelength_nm: FloatArray, maps: Sequence[Map]
) -> tuple[tuple, FloatArray]:  # type: ignore[type-arg]
    """Factors of the finite bench, and the engine's relative error, shape (S, 3)."""
    from estimators import BenchModel
    from estimators.forward import Forward

    plain = measurement.bench.model_copy(update={"effects": ()})
    forward = Forward.of(BenchModel.of(plain, measurement.samples, wavelength_nm, maps))
    return forward.factors, forward.relative_error


def _engine_modes(
    value: FloatArray, valid: BoolArray, place: np.ndarray, error: FloatArray
) -> FloatArray:
    """The engine's own error: level and tilt over wavelength of each sample's captures."""
    tilt = np.linspace(-1.0, 1.0, len(value))[:, None] if len(value) > 1 else np.zeros((1, 1))
    seen = np.where(valid, value, 0.0)
    rows = []
    for channel, relative in enumerate(error.ravel()):
        own = seen * (place == channel) * relative
        rows += [own * np.sqrt(0.5), own * tilt * np.sqrt(1.5)]
    return np.array(rows)


def _first_guess(measurement: Measurement, maps: Sequence[Map]) -> FloatArray:
    """Coordinates of a first estimate, neighbours' where it does not answer, (W, 3).

    With maps by look-up: least squares is better and the fit that follows as good, but its program
    takes a fresh process ten seconds to build.
    """
    from estimators import BenchModel, estimator

    intensities = relative_intensities(measurement)
    plain = measurement.bench.model_copy(update={"effects": ()})
    model = BenchModel.of(plain, measurement.samples, intensities.wavelength_nm, maps)
    options = {"draws": 0} if maps else {}
    name = "lut" if maps else "least-squares"
    result = estimator(name, model, **options).estimate(intensities)
    found = result.parameters
    known = np.isfinite(found).all(axis=1)
    if not known.any():
        found, known = np.tile(FIRST_GUESS, (len(found), 1)), np.ones(len(found), bool)
    index = np.arange(len(found))
    filled = np.stack([np.interp(index, index[known], row[known]) for row in found.T])
    return coordinates(*filled)
