"""Captures of the translucent bench that could be made next, as the engine expects them.

Noise is that of the visit: an extra capture is taken to be as noisy as the same capture of the
nearest sample, its variance in proportion to the light. What it adds of unknowns (the thickness of
another sample, the reflectance of a grey card) is part of its covariance.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from diagnosis.problem import Channel, Extra, Problem
from diagnosis.refit import Fit
from diagnosis.screening import without_broken
from diagnosis.translucent import TranslucentCase, material_slopes, physical
from twin.bench import Bench, Sample
from twin.effects import Candidate as Suspect
from twin.effects import EffectEngine, Readout, World
from twin.errors import InputError
from twin.measurement import Measurement
from twin.spectra import FloatArray

CAPTURES = ("black", "white", "collimated")
BLACK, WHITE, COLLIMATED = range(3)
GREY = 0.5
"""Reflectance of the card in place of the black."""
GREY_ERROR = 0.01
"""Of that reflectance."""
THICKNESS_ERROR = 0.02
"""Relative, of a sample that has not been measured yet."""
MINUTES = 3.0
"""Of the visit of one sample where the measurement holds no times."""
PREPARE_SAMPLE, CHANGE_BENCH, EMPTY_BENCH = 15.0, 4.0, 2.0
"""Minutes to make another thickness ready, to change a part of the bench, to capture it empty."""
PATHS = 1024
"""Of Monte Carlo responses of a bench that has not been built."""
RANGE = (0.05, 20.0)
"""Ratios of light within which the noise is scaled."""

OF_THE_BLACK = ("black_level", "black_red", "gloss[black]")
"""Effects of the black background, which a grey card does not have."""


@dataclass(frozen=True, eq=False)
class _Plan:
    """One proposal, before the engine has predicted it.

    Attributes:
        name, cost: as of `Extra`; minutes.
        engine, world: predict it.
        captures: of the engine's three, with the name of each new channel.
        like: sample of the measurement whose noise each sample of the world has.
        noise: factor on the variance of what is independent between wavelengths.
        acts: whether an effect can show in it.
        moved: what it adds of unknowns, each a world that is one standard error away.
        same: whether the light is that of captures that are there already.
        empty: whether no material is on the bench.
    """

    name: str
    cost: float
    engine: EffectEngine
    world: World
    captures: dict[int, str]
    like: tuple[str, ...]
    noise: float = 1.0
    acts: Callable[[Suspect], bool] = field(default=lambda suspect: True)
    moved: tuple[World, ...] = ()
    same: bool = False
    empty: bool = False


def extras_of(
    case: TranslucentCase, measurement: Measurement, null: Fit, wanted: Sequence[str]
) -> tuple[Extra, ...]:
    """Captures that could be made next, with the signatures of the effects that are to be split.

    Args:
        case: what was diagnosed.
        measurement: what it was made of.
        null: its fit without effects.
        wanted: names of the effects whose signatures are needed; those of all others are 0.

    Returns:
        The proposals that this bench can predict.
    """
    problem, _ = without_broken(case.problem)
    made = []
    for plan in _plans(case, measurement):
        try:
            made.append(_extra(case, problem, null, plan(), frozenset(wanted)))
        except InputError:
            continue  # a bench or a sample that cannot be: no proposal
    return tuple(made)


def minutes_of_a_sample(measurement: Measurement) -> float:
    """How long the visit of one sample took [min]."""
    captures = measurement.captures
    if captures is None:
        return MINUTES
    end = max(shot.time_s + shot.integration_s * shot.averages for shot in captures.shots)
    minutes = end / 60.0 / len(measurement.samples)
    return float(minutes) if minutes > 0 else MINUTES


def _plans(case: TranslucentCase, measurement: Measurement) -> list[Callable[[], _Plan]]:
    engine, bench, samples = case.engine, measurement.bench, measurement.samples
    minutes = minutes_of_a_sample(measurement)
    thickness = sorted({sample.thickness_mm for sample in samples})
    every = tuple(sample.name for sample in samples)
    all_captures = dict(enumerate(CAPTURES))

    def another(thickness_mm: float) -> _Plan:
        near = min(samples, key=lambda s: abs(np.log(s.thickness_mm / thickness_mm)))
        number = every.index(near.name)
        sample = near.model_copy(update={"name": "new", "thickness_mm": thickness_mm})
        world = _nominal(bench, (sample,))
        away = sample.model_copy(update={"thickness_mm": thickness_mm * (1.0 + THICKNESS_ERROR)})
        return _Plan(
            f"another sample, {thickness_mm:g} mm thick", PREPARE_SAMPLE + minutes,
            _engine(engine, world, (number,)), world, all_captures, (near.name,),
            moved=(world.changed(samples=(away,)),),
        )  # fmt: skip

    def half() -> _Plan:
        plan = engine.readout or Readout.plan(bench, samples, engine.wavelength_nm)
        seconds = plan.integration_s.copy()
        seconds[:, 3:] *= 0.5
        return _Plan(
            "the same captures at half the integration time", minutes * len(samples),
            replace(engine, readout=replace(plan, integration_s=seconds)), engine.world,
            all_captures, every, noise=2.0, same=True,
        )  # fmt: skip

    def grey() -> _Plan:
        def card(reflectance: float) -> World:
            own = bench.background.black.model_copy(update={"reflectance": reflectance})
            background = bench.background.model_copy(update={"black": own})
            effects = tuple(e for e in bench.effects if e.name not in OF_THE_BLACK)
            fields = {"background": background, "effects": effects}
            return _nominal(bench.model_copy(update=fields), samples)

        world = card(GREY)
        return _Plan(
            f"a grey card ({100 * GREY:g} %) in place of the black background",
            CHANGE_BENCH + minutes * len(samples), _engine(engine, world), world,
            {BLACK: "grey"}, every, acts=lambda suspect: suspect.name not in OF_THE_BLACK,
            moved=(card(GREY + GREY_ERROR),),
        )  # fmt: skip

    def aperture() -> _Plan:
        wide = 2.0 * bench.detector.acceptance_deg
        detector = bench.detector.model_copy(update={"acceptance_deg": wide})
        world = _nominal(bench.model_copy(update={"detector": detector}), samples)
        return _Plan(
            f"the collimated captures with an acceptance of {wide:g} deg",
            CHANGE_BENCH + minutes * len(samples), _engine(engine, world), world,
            {COLLIMATED: "collimated, wide"}, every,
        )  # fmt: skip

    def empty() -> _Plan:
        nothing = Sample(name="no sample", thickness_mm=0.01, n=1.0)
        bare = bench.model_copy(update={"covers_above": (), "covers_below": ()})
        world = _nominal(bare, (nothing,))
        return _Plan(
            "the empty bench over the black, against the white", EMPTY_BENCH,
            replace(_engine(engine, world, (0,)), factors=()), world, {BLACK: "empty bench"},
            (every[0],),
            acts=lambda suspect: suspect.effect.place != "sample"
            and suspect.engine != "monte_carlo",
            empty=True,
        )  # fmt: skip

    return [
        lambda: another(2.0 * thickness[-1]),
        lambda: another(0.5 * thickness[0]),
        half,
        grey,
        aperture,
        empty,
    ]


def _nominal(bench: Bench, samples: tuple[Sample, ...]) -> World:
    """The world of another bench with the accepted effects that it can have."""
    kept = []
    for accepted in bench.effects:
        own = bench.model_copy(update={"effects": (accepted,)})
        try:
            World.nominal(own, samples)
        except InputError:
            continue
        kept.append(accepted)
    return World.nominal(bench.model_copy(update={"effects": tuple(kept)}), samples)


def _engine(
    engine: EffectEngine, world: World, rows: tuple[int, ...] | None = None
) -> EffectEngine:
    """An engine for another bench or sample; `rows`: samples whose factors and readout it has."""
    factors, readout = engine.factors, engine.readout
    if rows is not None:
        factors = tuple(factors[row] for row in rows) if factors else ()
        if readout is not None:
            own = list(rows)
            readout = replace(
                readout, white=readout.white[own], beam=readout.beam[own],
                integration_s=readout.integration_s[own], gain=readout.gain[own],
            )  # fmt: skip
    return EffectEngine(
        world, engine.wavelength_nm, factors, readout, least_paths=min(engine.least_paths, PATHS),
        seed=engine.seed, folder=engine.folder, threads=engine.threads, say=engine.say,
    )  # fmt: skip


def _extra(
    case: TranslucentCase, problem: Problem, null: Fit, plan: _Plan, wanted: frozenset[str]
) -> Extra:
    repeats = len(problem.repeats)
    order = [
        (repeat, sample, capture)
        for repeat in range(repeats)
        for sample in range(len(plan.like))
        for capture in plan.captures
    ]
    place = np.array([3 * sample + capture for _, sample, capture in order])
    material = physical(null.material)
    if plan.empty:
        material = np.tile([0.5, 1e-6, 0.0], (len(material), 1))

    def seen(world: World, at: FloatArray) -> FloatArray:
        light = plan.engine.intensities(world, at)
        return np.asarray(light.reshape(len(at), -1)[:, place])

    expected = seen(plan.world, material)
    if not np.all(np.isfinite(expected)):
        raise InputError("captures that are no numbers", "a bench that the engine can predict")
    jacobian = np.zeros((*expected.shape, null.material.shape[1]))
    if not plan.empty:
        jacobian = material_slopes(
            lambda at: seen(plan.world, physical(at)), null.material, expected
        )
    signatures = np.zeros((len(problem.signatures), *expected.shape))
    suspects = {suspect.name: suspect for suspect in case.suspects}
    for candidate, columns in zip(problem.candidates, problem.columns, strict=True):
        suspect = suspects[candidate.name]
        there = suspect.instance in suspect.effect.instances(plan.world)
        if candidate.name in wanted and there and plan.acts(suspect):
            slope = plan.engine.signature(suspect, material, plan.world)
            flat = slope.reshape(len(slope), len(material), -1)[..., place]
            signatures[list(columns)] = np.where(np.isfinite(flat), flat, 0.0)
    moved_by = [seen(world, material) - expected for world in plan.moved]
    independent, common = _noise(problem, null, plan, order, expected, moved_by)
    names = [sample.name for sample in plan.world.samples]
    channels = tuple(
        Channel(plan.captures[capture], f"{names[sample]}, next", repeat)
        for repeat, sample, capture in order
    )
    return Extra(
        name=plan.name, cost=plan.cost, channels=channels, independent=independent,
        common=common, jacobian=jacobian, signatures=signatures,
    )  # fmt: skip


def _noise(
    problem: Problem,
    null: Fit,
    plan: _Plan,
    order: list[tuple[int, int, int]],
    expected: FloatArray,
    moved_by: list[FloatArray],
) -> tuple[FloatArray, FloatArray]:
    """Covariance of an extra capture: what is independent, and the modes, old ones first."""
    index: dict[tuple[str, str], dict[int, int]] = {}
    for number, channel in enumerate(problem.channels):
        index.setdefault((channel.capture, channel.sample), {})[channel.repeat] = number
    own = []
    for repeat, sample, capture in order:
        there = index[CAPTURES[capture], plan.like[sample]]
        own.append(there.get(problem.repeats[repeat], there[min(there)]))
    ratio = np.clip(expected / np.maximum(null.predicted[:, own], 1e-6), *RANGE)
    root = np.sqrt(plan.noise * ratio)
    block = problem.independent[:, own][:, :, own] * root[:, :, None] * root[:, None, :]
    if len(set(own)) < len(own):  # a repeat that is not there is as noisy as the first, but new
        block = block * np.eye(len(own))
    continued = problem.common[:, :, own] * ratio
    # The engine's own modes, level and tilt of every sample and capture, come last.
    engine = min(2 * 3 * len({c.sample for c in problem.channels}), len(problem.common))
    old = np.zeros_like(continued)
    fresh = continued
    if plan.same:
        split = len(continued) - engine
        old[split:] = continued[split:]
        fresh = continued[:split]
    fresh = fresh[np.any(fresh != 0.0, axis=(1, 2))]
    rows = [old, fresh, np.array(moved_by).reshape(-1, *expected.shape)]
    return np.asarray(block), np.concatenate(rows)
