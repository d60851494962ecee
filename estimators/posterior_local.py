"""Posteriors of every wavelength for itself: boxes, pilot, emulator, chain, check."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from estimators.posterior_box import FIRST_HALF_WIDTH, Box
from estimators.posterior_coordinates import Coordinates, random_state, wavelength_stream
from estimators.posterior_emulator import Emulator, Source, WithNuisances, emulators
from estimators.posterior_engine import Engine
from estimators.posterior_mode import Mode
from estimators.posterior_sampler import Chain, LogProbability, Student, sample
from estimators.posterior_settings import PosteriorSettings
from twin.spectra import FloatArray

PILOT_STEPS = 80
ROUNDS = 4
"""Boxes that a pilot may try: each is fitted to what the pilot in the one before found."""
CHECKS = 24
FALLBACK = 10.0
"""An error of more tolerances than this at draws of the chain calls the engine itself."""
MOST_EXACT_STEPS = 1500
"""Of a chain on the engine itself, which costs milliseconds a step."""
PILOT, MAIN, POINTS = 1, 2, 3
"""Purposes of the streams of random numbers."""


@dataclass(frozen=True, eq=False)
class Whitened:
    """Measured captures in units of their noise.

    Attributes:
        white: whitening matrices, (W, M, M).
        value: whitened measured captures, (W, M).
    """

    white: FloatArray
    value: FloatArray


@dataclass(frozen=True, eq=False)
class Local:
    """The chain of one wavelength.

    Attributes:
        x: coordinates, (steps, walkers, 3).
        nuisances: in standard deviations, (steps, walkers, N).
        chain: as it was run.
        emulator_error: largest error of the whitened captures at draws [standard deviations].
        exact: the engine itself was used.
        touched: the chain still reached the end of its box.
    """

    x: FloatArray
    nuisances: FloatArray
    chain: Chain
    emulator_error: float
    exact: bool
    touched: bool


def first_boxes(mode: Mode) -> list[Box]:
    """Boxes of some Laplace standard deviations around the modes."""
    return [
        Box.laplace(centre, np.linalg.inv(precision), FIRST_HALF_WIDTH)
        for centre, precision in zip(mode.x, mode.precision, strict=True)
    ]


def log_probability(
    coordinates: Coordinates, emulator: Emulator, target: FloatArray
) -> LogProbability:
    """Of points (K, 3 + N): t of the box and N nuisances in standard deviations.

    Args:
        coordinates: priors.
        emulator: M whitened captures, and their changes by N nuisances.
        target: whitened measured captures, (M,).
    """
    box, size = emulator.box, target.size

    def of(points: FloatArray) -> FloatArray:
        t, nuisances = points[:, :3], points[:, 3:]
        output = emulator(t)
        residual = output[:, :size] - target
        if nuisances.shape[1]:
            slopes = output[:, size:].reshape(len(t), size, -1)
            residual = residual + np.einsum("kmn,kn->km", slopes, nuisances)
        value = -0.5 * np.sum(residual**2, axis=1) - 0.5 * np.sum(nuisances**2, axis=1)
        value += coordinates.log_prior(box.y(t))
        return np.where(box.inside(t), value, -np.inf)

    return of


def walkers_in(
    box: Box, draws: FloatArray, walkers: int, stream: np.random.Generator
) -> FloatArray:
    """Distinct members of draws (K, 3) of t inside the box, with a trace of scatter."""
    inside = draws[box.inside(draws)]
    chosen = inside[stream.permutation(len(inside))[:walkers]]
    if len(chosen) < walkers:
        chosen = np.resize(chosen, (walkers, 3))
    moved = chosen + 1e-3 * (box.high - box.low) * stream.standard_normal(chosen.shape)
    return np.asarray(np.clip(moved, box.low, box.high))


def sample_locally(
    engine: Engine,
    coordinates: Coordinates,
    settings: PosteriorSettings,
    whitened: Whitened,
    mode: Mode,
    bare: Whitened | None = None,
) -> list[Local]:
    """Chains of all W wavelengths of the engine.

    Args:
        engine: the engine.
        coordinates: priors.
        settings: options.
        whitened: captures by their noise with all nuisances in it.
        mode: the most probable materials.
        bare: captures by their noise alone, when the nuisances are to be sampled.
    """
    wavelength = engine.model.wavelength_nm[list(engine.wanted)]
    source = rich = Source(engine, coordinates, whitened.white)
    boxes, pilots = _pilots(source, settings, whitened, mode, wavelength)
    extra = 0
    if bare is not None:
        source = Source(engine, coordinates, bare.white)
        rich = WithNuisances(engine, coordinates, bare.white, settings)
        extra = engine.nuisance_slopes(coordinates.material(mode.x)[None], settings).shape[-1]
        whitened = bare
    tolerance = settings.emulator_tolerance
    checks = np.stack([_spread(draws, CHECKS) for draws in pilots], axis=1)
    fitted = emulators(rich, boxes, checks, tolerance)
    chains = []
    for w, emulator in enumerate(fitted):
        stream = wavelength_stream(settings.seed, wavelength[w], MAIN)
        first = walkers_in(emulator.box, pilots[w], settings.walkers, stream)
        first = np.concatenate([first, stream.standard_normal((len(first), extra))], axis=1)
        target = whitened.value[w]
        proposal = _proposal(pilots[w], extra)
        chains.append(
            _chain(
                log_probability(source.coordinates, emulator, target),
                first,
                stream,
                proposal,
                settings,
            )
        )
    errors = _errors_at_draws(source, fitted, chains, whitened)
    found = []
    for w, (emulator, chain) in enumerate(zip(fitted, chains, strict=True)):
        t = chain.values[..., :3]
        exact = bool(errors[w] > FALLBACK * tolerance) and not extra
        error = float(errors[w])
        if exact:
            chain = _with_engine(source, w, emulator.box, whitened, chain, settings, wavelength[w])
            t, error = chain.values, 0.0
        # the engine itself holds beyond the box
        touched = not exact and bool(emulator.box.touched_sides(t.reshape(-1, 3)).any())
        found.append(Local(emulator.box.y(t), chain.values[..., 3:], chain, error, exact, touched))
    return found


def _proposal(pilot: FloatArray, extra: int) -> Student:
    """Material from the pilot, nuisances from their prior."""
    spread = np.eye(3 + extra)
    spread[:3, :3] = np.cov(pilot.T)
    return Student.normal(np.concatenate([pilot.mean(axis=0), np.zeros(extra)]), spread)


def _chain(
    log_prob: LogProbability,
    first: FloatArray,
    stream: np.random.Generator,
    proposal: Student,
    settings: PosteriorSettings,
) -> Chain:
    return sample(
        log_prob,
        first,
        random_state(stream),
        proposal=proposal,
        effective_samples=settings.effective_samples,
        steps=settings.steps,
    )


def _pilots(
    source: Source,
    settings: PosteriorSettings,
    whitened: Whitened,
    mode: Mode,
    wavelength: FloatArray,
) -> tuple[list[Box], list[FloatArray]]:
    """Boxes that hold the posteriors, and draws of t in them, each (K, 3)."""
    boxes = first_boxes(mode)
    pilots: list[FloatArray] = [np.empty((0, 3))] * len(boxes)
    starts = []
    for w, box in enumerate(boxes):
        stream = wavelength_stream(settings.seed, wavelength[w], POINTS)
        starts.append(np.clip(stream.standard_normal((400, 3)), box.low, box.high))
    active = np.arange(len(boxes))
    for turn in range(ROUNDS):
        part = source if active.size == len(boxes) else source.narrowed(active)
        checks = np.stack([_spread(starts[w], CHECKS // 2) for w in active], axis=1)
        loose = 10.0 * settings.emulator_tolerance
        fitted = emulators(part, [boxes[w] for w in active], checks, loose)
        again = []
        for emulator, w in zip(fitted, active.tolist(), strict=True):
            box = emulator.box
            stream = wavelength_stream(settings.seed, wavelength[w], PILOT + 16 * (turn + 1))
            chain = sample(
                log_probability(source.coordinates, emulator, whitened.value[w]),
                walkers_in(box, starts[w], settings.walkers, stream),
                random_state(stream),
                burn_in=PILOT_STEPS // 2,
                steps=PILOT_STEPS,
            )
            t = chain.values.reshape(-1, 3)
            sides = box.touched_sides(t)
            x = box.y(t)
            boxes[w] = Box.around(x, sides)
            pilots[w] = starts[w] = boxes[w].t(x)
            if sides.any() or emulator.error > 4.0 * loose:
                again.append(w)
        active = np.array(again, dtype=np.intp)
        if not active.size:
            break
    return boxes, pilots


def _spread(draws: FloatArray, count: int) -> FloatArray:
    return np.asarray(draws[np.linspace(0, len(draws) - 1, count).astype(np.intp)])


def _errors_at_draws(
    source: Source, fitted: list[Emulator], chains: list[Chain], whitened: Whitened
) -> FloatArray:
    """Largest error of the whitened captures at draws of the chains, shape (W,)."""
    t = np.stack([chain.thinned(CHECKS)[:, :3] for chain in chains], axis=1)
    truth = source.outputs(np.stack([e.box.y(t[:, w]) for w, e in enumerate(fitted)], axis=1))
    size = whitened.value.shape[1]
    return np.array(
        [np.abs(e(t[:, w])[:, :size] - truth[:, w]).max() for w, e in enumerate(fitted)]
    )


def _with_engine(
    source: Source,
    w: int,
    box: Box,
    whitened: Whitened,
    before: Chain,
    settings: PosteriorSettings,
    wavelength_nm: float,
) -> Chain:
    """The chain again, with the engine itself in place of the polynomial."""
    one = source.narrowed(np.array([w]))
    target = whitened.value[w]
    # far out the coordinates are bent out of shape, and walkers that stray there come back late
    wide = replace(box, low=box.low - 1.0, high=box.high + 1.0)

    def log_prob(t: FloatArray) -> FloatArray:
        x = box.y(t)
        residual = one.outputs(x[:, None, :])[:, 0] - target
        value = -0.5 * np.sum(residual**2, axis=1) + source.coordinates.log_prior(x)
        return np.where(wide.inside(t), value, -np.inf)

    stream = wavelength_stream(settings.seed, wavelength_nm, MAIN + 16)
    draws = before.thinned(20 * settings.walkers)
    first = walkers_in(box, draws, settings.walkers, stream)
    few = replace(settings, steps=min(settings.steps, MOST_EXACT_STEPS))
    return _chain(log_prob, first, stream, Student.of(draws), few)
