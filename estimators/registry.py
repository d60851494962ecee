"""Estimators by name: ours, and those that other packages announce.

Another package announces an estimator in its pyproject.toml:

    [project.entry-points."benchtwin.estimators"]
    mine = "mine.fit:make"

where `make(model: BenchModel, **settings) -> Estimator`.
"""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Callable
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from estimators.protocol import BenchModel, Estimator
from twin.errors import InputError
from twin.toml import near_misses

GROUP = "benchtwin.estimators"
Factory = Callable[..., Estimator]
"""(model: BenchModel, **settings) -> Estimator."""


def _lut(model: BenchModel, **settings: Any) -> Estimator:
    from estimators.lut import LutEstimator
    from estimators.lut_settings import LutSettings

    return LutEstimator(model, LutSettings(**settings))


def _lut_seed(model: BenchModel, **settings: Any) -> Estimator:
    from estimators.lut import LutEstimator
    from estimators.lut_settings import LutSettings

    return LutEstimator(model, LutSettings.of_the_seed(**settings))


def _beer(model: BenchModel, **settings: Any) -> Estimator:
    from estimators.beer import BeerEstimator, BeerSettings

    return BeerEstimator(model, BeerSettings(**settings))


_OURS: dict[str, Factory] = {"lut": _lut, "lut-seed": _lut_seed, "beer": _beer}


def _lut_options() -> frozenset[str]:
    from estimators.lut_settings import LutSettings

    return frozenset(field.name for field in dataclasses.fields(LutSettings))


def _beer_options() -> frozenset[str]:
    from estimators.beer import BeerSettings

    return frozenset(field.name for field in dataclasses.fields(BeerSettings))


_OPTIONS: dict[str, Callable[[], frozenset[str]]] = {
    "lut": _lut_options,
    "lut-seed": _lut_options,
    "beer": _beer_options,
}


def names() -> tuple[str, ...]:
    """Names of all estimators, sorted."""
    return tuple(sorted({*_OURS, *_announced()}))


def estimator(name: str, model: BenchModel, **settings: Any) -> Estimator:
    """Make an estimator.

    Args:
        name: one of `names()`.
        model: what is known of the bench.
        settings: the estimator's own options.

    Raises:
        InputError: an unknown name or option, an announced estimator that cannot be loaded or
            is none.
    """
    announced = _announced()
    if name in _OURS:
        factory: Any = _OURS[name]
    elif name in announced:
        try:
            factory = announced[name].load()
        except (ImportError, AttributeError) as error:
            raise InputError(
                f"an estimator that cannot be loaded ({error})",
                f"a function at {announced[name].value}",
                place=name,
                remedy="Install its package again.",
            ) from error
    else:
        close = difflib.get_close_matches(name, names())
        raise InputError(
            f'"{name}"',
            f"one of {', '.join(names())}",
            place="estimator",
            remedy=f'Did you mean "{close[0]}"?' if close else "",
        )
    known = _OPTIONS.get(name)
    for option in settings:
        if known is not None and option not in known():
            raise InputError(
                f"the unknown option `{option}` of {name}",
                f"one of {', '.join(sorted(known()))}",
                place="estimator.options",
                remedy=near_misses(option, sorted(known())),
            )
    try:
        made = factory(model, **settings)
    except TypeError as error:
        raise InputError(
            f"options {', '.join(settings) or 'none'} ({error})",
            "options that this estimator has",
            place=name,
        ) from error
    if not isinstance(made, Estimator):
        raise InputError(f"a {type(made).__name__}", "an object with name and estimate", place=name)
    return made


def _announced() -> dict[str, EntryPoint]:
    return {point.name: point for point in entry_points(group=GROUP) if point.name not in _OURS}
