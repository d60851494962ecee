"""From an accepted effect to a description that has it."""

from __future__ import annotations

from collections.abc import Sequence

from twin.bench import AcceptedEffect, Bench, Sample
from twin.effects.effect import Candidate, Values
from twin.effects.world import World


def accept(
    bench: Bench,
    samples: Sequence[Sample],
    candidate: Candidate,
    values: Values,
    uncertainty: Sequence[float] = (),
    *,
    plain: bool = True,
) -> tuple[Bench, tuple[Sample, ...]]:
    """The description of bench and samples with one more effect.

    Args:
        bench: as described so far.
        samples: as described so far.
        candidate: the effect.
        values: its fitted values.
        uncertainty: standard errors of the values, one for each parameter, or ().
        plain: write fields of the bench and the samples where the effect is that (such as the
            acceptance or a thickness); False keeps every effect in `Bench.effects`, with its
            uncertainty.

    Returns:
        (bench, samples). What is written into plain fields is from then on what the corrections
        believe, too: a white's reflectance, the instrument's stray light.

    Raises:
        InputError: values that cannot be.
    """
    given = tuple(samples)
    found = candidate.values(values)
    if plain and candidate.effect.plain:
        before = World.nominal(bench.model_copy(update={"effects": ()}), given)
        after = candidate.apply(before, found)
        return after.bench.model_copy(update={"effects": bench.effects}), after.samples
    entry = AcceptedEffect(
        name=candidate.name, values=found, uncertainty=tuple(float(u) for u in uncertainty)
    )
    kept = tuple(each for each in bench.effects if each.name != candidate.name)
    return bench.model_copy(update={"effects": (*kept, entry)}), given
