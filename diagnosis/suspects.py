"""Entries of a catalogue as candidates of a problem: what each does to the data, or why not."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np

from diagnosis.problem import Candidate
from twin.effects import Candidate as Suspect
from twin.effects import LeftOut
from twin.spectra import FloatArray


class Named(Protocol):
    """Anything with a name."""

    @property
    def name(self) -> str:
        """Unique in its catalogue."""


AnySuspect = TypeVar("AnySuspect", bound=Named)


@dataclass(frozen=True, eq=False)
class Judgeable(Generic[AnySuspect]):
    """Suspects whose signatures can be used, and the others.

    Attributes:
        suspects: in the order of the catalogue.
        signatures: change of the data per unit of each of their parameters, (E, W, M).
        left_out: the others, each with the reason.
    """

    suspects: tuple[AnySuspect, ...]
    signatures: FloatArray
    left_out: tuple[LeftOut, ...]


def judgeable(
    suspects: Sequence[AnySuspect],
    signature: Callable[[AnySuspect], FloatArray],
    shape: tuple[int, ...],
    *,
    left_out: Iterable[LeftOut] = (),
    doubt: Callable[[AnySuspect, FloatArray], str] | None = None,
    say: Callable[[str], None],
    progress: Callable[[float, float], None] | None = None,
) -> Judgeable[AnySuspect]:
    """Signatures of suspects; one that cannot be used is named and left out, the rest goes on.

    Args:
        suspects: of the catalogue.
        signature: change of the data per unit of each parameter of a suspect, (k, W, M).
        shape: of the data, (W, M).
        left_out: what could not be used before.
        doubt: why a signature had better not be used, or ""; None: never.
        say: told of everything that is left out.
        progress: called with (done, total) suspects.
    """
    kept: list[AnySuspect] = []
    rows = [np.empty((0, *shape))]
    failed = list(left_out)
    for number, suspect in enumerate(suspects, start=1):
        try:
            own = signature(suspect)
            why = _unusable(own) or (doubt(suspect, own) if doubt is not None else "")
        except Exception as error:  # noqa: BLE001 - a user's entry may raise anything
            why = f"{type(error).__name__}: {error}"
        if why:
            failed.append(LeftOut(suspect.name, why))
        else:
            kept.append(suspect)
            rows.append(own)
        if progress is not None:
            progress(number, len(suspects))
    for each in failed:
        say(f"left out: {each.name}: {each.reason}")
    return Judgeable(tuple(kept), np.concatenate(rows), tuple(failed))


def _unusable(signature: FloatArray) -> str:
    """Why a signature says nothing, or ""."""
    if not np.isfinite(signature).all():
        return "gives values that are no numbers"
    return "" if np.any(signature) else "changes nothing in these data"


def candidate_of(suspect: Suspect, known: bool = False) -> Candidate:
    """A candidate of the bench's catalogue as the problem has it.

    Args:
        suspect: of the catalogue.
        known: it is described already: about its value nothing is even.
    """
    signs = {"any": 0, "positive": 1, "negative": -1}
    own = suspect.parameters
    return Candidate(
        effect=suspect.effect.name,
        instance=suspect.instance,
        parameters=tuple(p.name for p in own),
        units=tuple(p.unit for p in own),
        prior_scale=tuple(p.prior_scale for p in own),
        sign=tuple(signs[p.sign] for p in own),
        limit=tuple(min(p.limit, 10.0 * p.prior_scale) for p in own),
        even=tuple(p.even and not known for p in own),
    )
