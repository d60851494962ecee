"""What is true and not told: effects of the catalogue as strategies, and captures with them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from hypothesis import strategies as st

from estimators import BenchModel
from scenarios.strategies.worlds import PATHS, fast_engine, monte_carlo
from twin.bench import Bench, Sample
from twin.effects import Candidate, EffectParameter, FastLight, World
from twin.effects import candidate as candidate_of
from twin.errors import InputError
from twin.materials import OpticalProperties
from twin.spectra import FloatArray

if TYPE_CHECKING:
    from twin.effects import Catalogue

Effects = Mapping[str, Mapping[str, float]]
"""Values by parameter, by name of the effect, such as {"gap": {"gap_mm": 0.5}}."""
Captures = Callable[[BenchModel, FloatArray], FloatArray]
NEED_A_SPECTRUM = ("wavelength_shift", "bandwidth")
"""Effects that want neighbouring wavelengths: name them for problems with four or more."""
STEPS = 4
"""Steps of a value within one prior scale."""


def effects(
    names: Sequence[str] | None = None,
    *,
    bench: Bench | None = None,
    thickness_mm: Sequence[float] = (0.5, 1.0),
    most: int = 2,
    scales: float = 3.0,
    catalogue: Catalogue | None = None,
) -> st.SearchStrategy[Effects]:
    """Effects with values within their bounds; they shrink to one effect, and to none.

    Values are quarters of the effect's prior scale away from nominal, and shrink to it.

    Args:
        names: candidates such as "thickness[0.5 mm]"; None takes all that the fast engine shows.
        bench: what they can happen to; None takes the default bench.
        thickness_mm: of the samples that they can happen to.
        most: effects at once.
        scales: prior scales that a value is away from nominal at most.
        catalogue: None takes ours and those that are announced.

    Raises:
        InputError: an unknown name.
    """
    from twin.effects import catalogue as announced

    samples = tuple(Sample(name=f"{mm:g} mm", thickness_mm=mm, n=1.5) for mm in thickness_mm)
    world = World.nominal(bench or Bench(), samples)
    if names is None:
        found, _ = (catalogue or announced()).candidates(world)
        known = [
            each
            for each in found
            if each.engine != "monte_carlo" and each.effect.name not in NEED_A_SPECTRUM
        ]
        # A thickness is the simplest to read.
        known.sort(key=lambda each: each.effect.name != "thickness")
    else:
        known = [candidate_of(world, name) for name in names]
    by_name = {each.name: each for each in known}
    chosen = st.lists(st.sampled_from(list(by_name)), unique=True, max_size=most)
    drawn = chosen.flatmap(
        lambda own: st.fixed_dictionaries({name: _values(by_name[name], scales) for name in own})
    )
    return drawn.map(lambda own: _not_nominal(own, by_name)).filter(
        lambda own: _possible(world, own, by_name)
    )


def world_with(bench: Bench, samples: Sequence[Sample], effects: Effects) -> World:
    """The world of a described bench with effects.

    Raises:
        InputError: an unknown effect, or a value that cannot be.
    """
    world = World.nominal(bench, samples)
    for name, values in effects.items():
        world = candidate_of(world, name).apply(world, values)
    return world


def captures_with(
    captures: Captures, world: World, wavelength_nm: FloatArray, material: FloatArray
) -> FloatArray:
    """What the described corrections report of a world, without noise, shape (S, 3, W).

    Args:
        captures: the engine: `fast_engine`, `monte_carlo` or a function of yours, which is asked
            for the true benches.
        world: with effects.
        wavelength_nm: [nm], shape (W,).
        material: albedo, sigma_t [1/mm] and g, shape (W, 3).

    Raises:
        InputError: an effect that the engine does not show.
    """
    from twin.effects import expected_intensities, world_captures

    if captures is monte_carlo:
        albedo, sigma_t, g = material.T
        medium = OpticalProperties(wavelength_nm, albedo, sigma_t, g, None)
        found = world_captures(world, wavelength_nm, properties=medium, paths=PATHS)
        light = np.stack([[one.black, one.white, one.collimated] for one in found], axis=1).T
    elif captures is fast_engine:
        unseen = [each.name for each in world.applied if each.candidate.engine == "monte_carlo"]
        if unseen:
            raise InputError(
                f"{', '.join(unseen)} and the fast engine", "world=monte_carlo", place="effects"
            )
        light = FastLight(wavelength_nm).captures(world, material)
    else:
        if world.sublayers or world.second_lobe[0]:
            raise InputError(
                "a world with layers or another phase function",
                "fast_engine or monte_carlo",
                place="effects",
            )
        light = np.zeros((len(wavelength_nm), len(world.samples), 3))
        for view in world.views():
            model = BenchModel.of(view.bench, view.samples, wavelength_nm)
            light += np.asarray(captures(model, material)).transpose(2, 0, 1) * view.weight
    return expected_intensities(world, light, wavelength_nm).transpose(1, 2, 0)


def _values(candidate: Candidate, scales: float) -> st.SearchStrategy[dict[str, float]]:
    return st.fixed_dictionaries({p.name: _value(p, scales) for p in candidate.parameters})


def _value(parameter: EffectParameter, scales: float) -> st.SearchStrategy[float]:
    step = parameter.prior_scale / STEPS
    most = int(min(scales * parameter.prior_scale, parameter.limit) / step + 1e-9)
    low = 0 if parameter.sign == "positive" else -most
    high = 0 if parameter.sign == "negative" else most
    return st.integers(low, high).map(lambda k: round(parameter.nominal + k * step, 10))


def _not_nominal(own: Effects, known: Mapping[str, Candidate]) -> Effects:
    return {n: v for n, v in own.items() if known[n].values(v) != known[n].nominal}


def _possible(world: World, own: Effects, known: Mapping[str, Candidate]) -> bool:
    """Whether all of them can be at once: a steep wedge in a thin sample cannot."""
    try:
        for name, values in own.items():
            world = known[name].apply(world, values)
        world.views()
    except InputError:
        return False
    return True
